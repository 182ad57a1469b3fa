"""Gain and read noise from the background: its variance over its mean (Janesick, Photon Transfer, 2007).

A background of m grey values above black has the variance (r / g)^2 + m / g + 1/12, with g electrons for a
grey value, a read noise of r electrons, and the rounding to whole numbers. One level of the sky tells one
sum of both; levels that differ (exposures, glow, parts of the field) tell the gain, and with the black level
that somebody has to say, the read noise. The variance is that of differences of neighbouring pixels: what
varies smoothly is not in it. A fixed pattern of the detector is in it, as if it were read noise.
"""

from typing import NamedTuple

import numpy as np

TILES = 4  # along each side of a picture
CLIP_SIGMA, ROUNDS = 4.0, 20  # of differences; a normal distribution loses CLIPPED of its variance by that
CLIPPED = 0.00113
FEWEST = 500  # differences of a tile
ROUNDING = 1.0 / 12.0  # grey values^2
WEIGHINGS = 2  # by the fitted line: by its own variance a level counts for more where that came out low
LEAST_DN = 0.45  # a smaller noise is not seen: rounding does not treat it as a noise of its own
MOST_CUT = 0.002  # of the pixels at grey value 0, where noise may be cut off: half a per cent of the variance
ABOVE = 0.841345, 0.977250  # of a normal variable, below its mean plus one and two sigma
CERTAIN = 5.0  # sigma that the slope of the variance must differ from zero: gain known to 20 %


class Level(NamedTuple):
    """Noise at a level of the sky, in one tile of one picture."""

    mean: float  # grey values
    variance: float  # grey values^2, rounding included
    sigma: float  # of the variance


class Noise(NamedTuple):
    """What the levels tell; (value, sigma), or None with a reason in `why`."""

    background: tuple  # grey values, noise of a pixel at the level below, without rounding
    level_dn: float  # weighted mean of all levels, darker ones weigh more
    gain: tuple | None  # electrons for a grey value
    read_noise: tuple | None  # electrons
    why: dict  # name -> words, of what is not told
    range_dn: tuple  # lowest and highest level


def levels(grey, covered):
    """Levels of a picture. grey, covered : (rows, columns) grey values; pixels that show more than sky"""
    found = []
    for rows in np.array_split(np.arange(grey.shape[0]), TILES):
        for columns in np.array_split(np.arange(grey.shape[1] // 2 * 2), TILES):
            first, last = columns[0] // 2 * 2, (columns[-1] + 1) // 2 * 2
            tile = np.s_[rows[0] : rows[-1] + 1, first:last]
            one = _level(grey[tile].astype(float), covered[tile])
            if one is not None:
                found.append(one)
    return found


def of_cut(grey, flat, covered):
    """Noise of a pixel where grey value 0 cuts it off [grey values]; 0 where it does not.

    One and two sigma above a mean that is no more than one below the cut nothing is cut off. Quantiles below
    would see next to no noise, and call it hot pixels.

    grey, flat : (rows, columns) grey values, and without background;  covered : as of `levels`
    """
    lowest = grey[~covered] == 0.0
    if not len(lowest) or grey.min() < 0.0 or lowest.mean() <= MOST_CUT:
        return 0.0
    one, two = np.quantile(flat[~covered], ABOVE)
    return float(two - one)


def _level(grey, covered):
    """Level of a tile with an even number of columns; None where too little sky is seen, or only half of it:
    a sky near grey value 0 has no noise below.
    """
    left, right = grey[:, 0::2], grey[:, 1::2]
    free = ~(covered[:, 0::2] | covered[:, 1::2])
    lowest = np.minimum(left, right)[free]
    if len(lowest) and lowest.min() == 0.0 and np.mean(lowest == 0.0) > 2.0 * MOST_CUT:  # of two pixels
        return None
    d, level = (left - right)[free] / np.sqrt(2.0), 0.5 * (left + right)[free]
    n = 0
    for _ in range(ROUNDS):
        if len(d) < FEWEST or len(d) == n:
            break
        n = len(d)
        near = np.abs(d) <= CLIP_SIGMA * d.std()
        d, level = d[near], level[near]
    if len(d) < FEWEST:
        return None
    variance = float((d**2).mean()) / (1.0 - CLIPPED)
    return Level(float(level.mean()), variance, max(variance, ROUNDING) * float(np.sqrt(2.0 / len(d))))


def told(levels, black_dn=None, gain=None):
    """Noise of levels; None where none is seen at all.

    black_dn : grey value without charge, None where nobody says it;  gain : electrons for a grey value as
    somebody says it, for the read noise where the levels do not tell it
    """
    mean, variance, sigma = np.array(levels).T
    own = np.maximum(variance, ROUNDING)
    relative, fitted = sigma / own, own  # there is no line yet
    for _ in range(1 + WEIGHINGS):
        W = (relative * np.clip(fitted, 0.5 * own, 2.0 * own)) ** -2.0  # [E] a tile that is none of sky
        at = float((W * mean).sum() / W.sum())
        middle = float((W * variance).sum() / W.sum()) - ROUNDING
        slope, slope_sigma, grown = _slope(mean - at, variance - ROUNDING - middle, W)
        fitted = middle + ROUNDING + slope * (mean - at)
    middle_sigma = float(W.sum() ** -0.5)
    if middle < LEAST_DN**2:
        return None
    middle_sigma *= grown
    background = np.sqrt(middle), 0.5 * middle_sigma / np.sqrt(middle)
    why, found, range_dn = {}, None, (float(mean.min()), float(mean.max()))
    if slope > CERTAIN * slope_sigma:
        found = 1.0 / slope, slope_sigma / slope**2
    else:
        why["gain"] = f"backgrounds of {range_dn[0]:.4g} to {range_dn[1]:.4g} DN are too alike"
    read = _read_noise((middle, middle_sigma), at, (slope, slope_sigma), black_dn, gain, found, why)
    return Noise(background, at, found, read, why, range_dn)


def _slope(x, y, W):
    """Slope of a weighted line through 0, 0, its sigma, and the factor of sigmas that the scatter says."""
    weight = float((W * x * x).sum())
    if weight <= 0.0:
        return 0.0, np.inf, 1.0
    slope = float((W * x * y).sum()) / weight
    chi2 = float((W * (y - slope * x) ** 2).sum())
    grown = max(1.0, np.sqrt(chi2 / max(len(x) - 2, 1)))
    return slope, grown * weight**-0.5, grown


def _read_noise(middle, at, slope, black_dn, gain, found, why):
    """(read noise, sigma) [electrons] or None, with the reason in `why`. Pairs are (value, sigma)."""
    if black_dn is None:
        why["read_noise"] = "nobody says the black level; give --camera"
        return None
    if found is None and gain is None:
        why["read_noise"] = "the gain is not told"
        return None
    m = at - black_dn
    if found is None:  # with the gain of the camera file, of which no error is known
        square, error = gain**2 * (middle[0] - m / gain), gain**2 * middle[1]
        why["read_noise_gain"] = f"with the gain of the camera file, {gain:.4g} electron/DN"
    else:  # r^2 = V / b^2 - m / b: V and b are independent, as m is counted from the mean level
        b, sigma_b = slope
        square = middle[0] / b**2 - m / b
        error = np.hypot(middle[1] / b**2, sigma_b * (2.0 * middle[0] / b**3 - m / b**2))
    if square < 2.0 * error or square <= 0.0:
        why["read_noise"] = "it is less than the noise of the sky's light lets see"
        return None
    return float(np.sqrt(square)), float(0.5 * error / np.sqrt(square))
