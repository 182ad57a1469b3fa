"""The light of one star in the pixels around its streak: what was seen, and what the model says.

In: the frame and the path of a streak. Out: arrays over the pixels of its window. The model is a Gaussian
spot on the exact path (`streak_path`): across, the Gaussian; along, the difference of two normal
distributions at the ends, which are those of each row's own exposure. The square of a pixel adds its variance
1/12 px^2 to the spot's: the light in a pixel is within 0.2 per cent of the peak's of the integral over the
pixel for a spot of sigma = 1 px, and within 0.7 at 0.6 px.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.background import is_bad
from shefex_nav.onboard.startracker.spot import REACH, normal
from shefex_nav.onboard.startracker.streak_path import (
    BEGIN,
    END,
    LENGTH,
    SAG,
    SHARE,
    SKEW,
    TX,
    TY,
    X0,
    Y0,
    Y1,
)

PIXEL_VARIANCE = 1.0 / 12.0  # px^2 per axis
MOST_PIXELS = 12000  # of one streak's window
ACROSS_SIGMAS = 3.5  # half width of the window
BEYOND_SIGMAS = 4.0  # the window ends so far beyond the ends and the search
NEIGHBOUR_ERROR = 0.1  # of a neighbour's light, that its model may be off by [E]


class Picture(NamedTuple):
    """A frame and what is known of its pixels."""

    image_dn: np.ndarray  # (rows, columns) uint8 or uint16
    bad: np.ndarray  # bit map of `background.bad_map`
    saturation_dn: int  # pixels at or above it have no weight, as bad ones


class Spot(NamedTuple):
    """How the light of a star comes."""

    s: float  # px, width of the Gaussian with the pixel's own variance
    dn_per_electron: float  # 0 where it is not known: no shot noise


class Ground(NamedTuple):
    """What a pixel shows without a star."""

    level_dn: float
    noise_dn: float  # standard deviation


class Pixels(NamedTuple):
    """Pixels of a window: what was seen, and a model's light of flux one; (n,) each."""

    x: np.ndarray  # px
    y: np.ndarray
    light: np.ndarray  # DN above the level
    variance: np.ndarray  # DN^2 without the star's own; infinite where a pixel has no weight
    model: np.ndarray
    d_along: np.ndarray  # px^-1, derivatives of the model to a shift of the star
    d_across: np.ndarray
    time: np.ndarray  # s from the frame's instant


@kernel
def memory_of(n):
    """Pixels with room for n, not written."""
    one, two, three, four = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    return Pixels(one, two, three, four, np.empty(n), np.empty(n), np.empty(n), np.empty(n))


@inner
def first_of(pixels, n):
    """The first n pixels, in the same memory."""
    x, y, light, variance, model, d_along, d_across, time = pixels
    return Pixels(x[:n], y[:n], light[:n], variance[:n], model[:n], d_along[:n], d_across[:n], time[:n])


@inner
def window_of(picture, path, s, extra_px, ground, memory):
    """Pixels around a streak: place, light above the level, variance.

    Parameters
    ----------
    picture : Picture
    path : (NUMBERS,)
    s : px, width of the spot with the pixel's own variance
    extra_px : (along, across) that the streak may be off
    ground : Ground
    memory : Pixels, overwritten

    Returns
    -------
    Pixels, in `memory`; none if they are too many
    n_saturated : number of saturated ones among them
    """
    image_dn, bad, saturation_dn = picture
    xs, ys, light, variance = memory.x, memory.y, memory.light, memory.variance
    rows, columns = image_dn.shape
    tx, ty = path[TX], path[TY]
    wide = ACROSS_SIGMAS * s + 0.5 + abs(path[SAG]) + extra_px[1]
    far = BEYOND_SIGMAS * s + 0.5 + extra_px[0]
    high = far * abs(ty) + wide * abs(tx)
    top = max(0, int(np.ceil(min(path[Y0], path[Y1]) - high)))
    bottom = min(rows - 1, int(np.floor(max(path[Y0], path[Y1]) + high)))
    n, n_saturated, noise2 = 0, 0, ground.noise_dn * ground.noise_dn
    for r in range(top, bottom + 1):
        left, right = _columns_of(path, r - path[Y0], wide, far)
        for c in range(max(0, int(np.ceil(left))), min(columns - 1, int(np.floor(right))) + 1):
            if n == xs.shape[0]:
                return first_of(memory, 0), 0
            value = image_dn[r, c]
            is_used = value < saturation_dn and not is_bad(bad, r * columns + c)
            n_saturated += value >= saturation_dn
            xs[n], ys[n], light[n] = c, r, value - ground.level_dn
            variance[n] = noise2 if is_used else np.inf
            n += 1
    return first_of(memory, n), n_saturated


@inner
def _columns_of(path, dy, wide, far):
    """First and last column, not rounded, of a window in the row dy below its first end."""
    tx, ty, x_0 = path[TX], path[TY], path[X0]
    left, right = x_0 - 1e6, x_0 + 1e6
    if abs(ty) > 1e-6:  # across = dy tx - dx ty within +- wide
        one, two = (dy * tx - wide) / ty, (dy * tx + wide) / ty
        left, right = max(left, x_0 + min(one, two)), min(right, x_0 + max(one, two))
    elif abs(dy * tx) > wide:
        return 0.0, -1.0
    if abs(tx) > 1e-6:  # along = dx tx + dy ty within -far ... length + far
        one, two = (-far - dy * ty) / tx, (path[LENGTH] + far - dy * ty) / tx
        left, right = max(left, x_0 + min(one, two)), min(right, x_0 + max(one, two))
    elif dy * ty < -far or dy * ty > path[LENGTH] + far:
        return 0.0, -1.0
    return left, right


@inner
def share_below(z):
    """Normal distribution at z, 0 and 1 beyond REACH."""
    if z <= -REACH:
        return 0.0
    return normal(z)[0] if z < REACH else 1.0


@inner(fastmath=True)
def bell(z2):
    """Normal density at z, of z squared < REACH^2: (exp(-z^2/32))^16 by the series, to 1e-6 of the peak.

    The compiler takes many pixels at a time.
    """
    q = z2 * (1.0 / 32.0)
    e = 1.0 - q * (1.0 - q * (0.5 - q * (1.0 / 6.0 - q * (1.0 / 24.0 - q * (1.0 / 120.0 - q / 720.0)))))
    e *= e
    e *= e
    e *= e
    return 0.3989422804014327 * e * e


@kernel
def light_at(path, s, x, y):
    """Light in a pixel of a star of flux one: itself, derivatives to a shift along and across, time.

    s is the width with the pixel's own variance. The plain form, for a few pixels and as the reference of
    `draw`, which takes many at a time and so needs a series in place of the table and no early end.
    """
    dx, dy = x - path[X0], y - path[Y0]
    along = dx * path[TX] + dy * path[TY]
    u = min(max(along / path[LENGTH], 0.0), 1.0)
    across = dy * path[TX] - dx * path[TY] - 4.0 * path[SAG] * u * (1.0 - u)
    z = across / s
    time = path[BEGIN] + u * (path[END] - path[BEGIN])
    from_first = (along - path[SKEW] * dy) / s
    from_last = (along - path[LENGTH] - path[SKEW] * (y - path[Y1])) / s
    if abs(z) > REACH or from_first < -REACH or from_last > REACH:
        return 0.0, 0.0, 0.0, time
    line = path[SHARE] * normal(z)[1] / s
    light, end = line, 0.0
    if from_first < REACH:
        c, d = normal(from_first)
        light, end = line * c, -line * d / s
    if from_last > -REACH:
        c, d = normal(from_last)
        light -= line * c
        end += line * d / s
    return light, end, light * z / s, time


@inner(error_model="numpy", fastmath=True)
def draw(path, s, pixels):
    """Write the model of flux one, its derivatives and the times: `light_at` of all pixels at once.

    The ends are looked up only where there is one.
    """
    tx, ty, x_0, y_0, length = path[TX], path[TY], path[X0], path[Y0], path[LENGTH]
    bend, per_length, per_s, begin = 4.0 * path[SAG], 1.0 / length, 1.0 / s, path[BEGIN]
    seen, height, far2 = path[END] - path[BEGIN], path[SHARE] / s, 1.0 * REACH * REACH
    xs, ys, _, _, model, ends, slopes, time = pixels
    n = xs.shape[0]
    for k in range(n):
        dx, dy = xs[k] - x_0, ys[k] - y_0
        along = dx * tx + dy * ty
        u = min(max(along * per_length, 0.0), 1.0)
        z = (dy * tx - dx * ty - bend * u * (1.0 - u)) * per_s
        model[k] = height * bell(min(z * z, far2))
        slopes[k] = z * per_s
        time[k] = begin + u * seen
        ends[k] = along
    skew = path[SKEW]
    for k in range(n):
        from_first = (ends[k] - skew * (ys[k] - y_0)) * per_s
        from_last = (ends[k] - length - skew * (ys[k] - path[Y1])) * per_s
        line = model[k]
        if from_first > REACH and from_last < -REACH:
            ends[k] = 0.0
        else:
            c_first, d_first = normal(from_first)
            c_last, d_last = normal(from_last)
            line *= c_first - c_last
            ends[k] = model[k] * (d_last - d_first) * per_s
            model[k] = line
        slopes[k] *= line


@inner
def take_away(path, spot, flux, pixels):
    """Take a neighbour's light out of the pixels and put its shot noise into their variance."""
    for k in range(pixels.x.shape[0]):
        light = flux * light_at(path, spot.s, pixels.x[k], pixels.y[k])[0]
        pixels.light[k] -= light
        pixels.variance[k] += light * spot.dn_per_electron + (NEIGHBOUR_ERROR * light) ** 2


@kernel(error_model="numpy")
def width2(s, level, pixels):
    """Variance of the spot across, px^2, that of a pixel included, by moments under the model as window.

    Spot S and window W = s^2 together have the variance m = (1/S + 1/W)^-1, near S = W: m = W/2 + (S - W)/4
    (adaptive moments: Bernstein & Jarvis 2002, AJ 123, 583).
    """
    total, second = 0.0, 0.0
    for k in range(pixels.x.shape[0]):
        if pixels.variance[k] < np.inf and pixels.model[k] > 0.0:
            across = pixels.d_across[k] * s * s / pixels.model[k]
            light = pixels.model[k] * (pixels.light[k] - level)
            total += light
            second += light * across * across
    return max(4.0 * second / total - s * s, 0.0) if total > 0.0 else s * s
