"""Hot pixels: bright at one place of the detector, whatever the camera looks at.

A pixel near a star of the catalogue says nothing in that picture. Of what is left, it has to stand out in
nearly all pictures, which look in at least FEWEST directions: a star or a satellite is elsewhere then.
"""

from typing import NamedTuple

import numpy as np

STANDS_OUT = 3.0  # of the noise, in one picture
TOGETHER = 7.0  # of the noise, of the mean over the pictures
FEWEST = 3  # directions
SHARE = 0.9  # of the pictures in which no star is near
MOVED_PX = 10.0  # stars have to move between two directions
STEPS = 20  # of an average over what is not seen
NEAR_PX = 4.0  # of a star, beside the width of its spot


class Bright(NamedTuple):
    """Pixels that stand out in one picture."""

    pixel: np.ndarray  # (k,) int64, row times columns + column; ascending
    excess: np.ndarray  # (k,) grey values above the sky around
    noise: float  # grey values


class HotPixels(NamedTuple):
    """What was found."""

    row_column: np.ndarray  # (k, 2)
    excess: np.ndarray  # (k,) grey values, mean over the pictures in which no star is near
    sigma: np.ndarray  # (k,)
    directions: int
    why: str  # why nothing can be said; empty where it can


def bright(flat, noise):
    """Bright of a picture without its background. flat : (rows, columns) grey values;  noise : of a pixel"""
    pixel = np.flatnonzero(flat > STANDS_OUT * noise)
    return Bright(pixel, flat.ravel()[pixel].astype(float), noise)


def directions(shifts, m):
    """Number of the direction of each picture: those in which stars move by less than MOVED_PX share one.

    shifts : function of two picture numbers -> (k, 2) px, how far stars move between them, NaN where they
        leave;  m : how many pictures -> (m,)
    """
    numbers, firsts = np.zeros(m, dtype=int), []
    for n in range(m):
        for number, other in enumerate(firsts):
            if np.median(np.hypot(*shifts(n, other).T)) < MOVED_PX:  # false of NaN
                numbers[n] = number
                break
        else:
            numbers[n] = len(firsts)
            firsts.append(n)
    return numbers


def find(pictures, covered, direction, size_px):
    """HotPixels.

    pictures : list of Bright;  covered : list of (rows, columns) bool, where a star is near
    direction : (m,) number of the direction of each picture;  size_px : (width, height)
    """
    n_directions = len(set(direction.tolist()))
    if n_directions < FEWEST:
        nothing = np.zeros((0, 2), dtype=int), np.zeros(0), np.zeros(0)
        ways = "one direction" if n_directions == 1 else f"{n_directions} directions"
        words = f"the pictures look in {ways}; from {FEWEST} on stars and hot pixels can be told apart"
        return HotPixels(*nothing, n_directions, words)
    n = size_px[0] * size_px[1]
    seen, able, total, weight, whole = np.zeros((5, n))
    ways = np.zeros(n, dtype=np.int64)
    for number in range(n_directions):
        here = np.zeros(n, dtype=bool)
        for k in np.flatnonzero(direction == number):
            one, free = pictures[k], ~covered[k].ravel()
            able += free
            whole += free / one.noise**2
            known = free[one.pixel]
            at = one.pixel[known]
            seen[at] += 1.0
            total[at] += one.excess[known] / one.noise**2
            weight[at] += one.noise**-2.0
            here[at] = True
        ways += here
    with np.errstate(divide="ignore", invalid="ignore"):
        together = total / np.sqrt(weight)
    hot = (ways >= FEWEST) & (seen >= SHARE * able) & (together > TOGETHER)
    at = np.flatnonzero(hot)
    rows_columns = np.column_stack(np.divmod(at, size_px[0]))
    excess = _excess(seen[at], able[at], total[at], weight[at], whole[at])
    return HotPixels(rows_columns, excess, whole[at] ** -0.5, n_directions, "")


def _excess(seen, able, total, weight, whole):
    """Mean over the pictures in which no star is near, with those in which a pixel did not stand out: (k,).

    What is below STANDS_OUT of the noise there is what a Gaussian has below it, step by step (EM algorithm).

    seen, able : how many pictures it stands out in, of how many;  total, weight, whole : sums of excess and
    of 1, over noise^2, of the former, and of 1 of the latter
    """
    from scipy.special import log_ndtr

    mean, hidden = total / weight, np.maximum(whole - weight, 0.0)
    # of the pictures where it did not
    sigma = np.sqrt((able - seen) / np.where(hidden > 0.0, hidden, np.inf))
    for _ in range(STEPS):
        z = np.where(sigma > 0.0, STANDS_OUT - mean / np.where(sigma > 0.0, sigma, 1.0), 0.0)
        below = mean - sigma * np.exp(-0.5 * z * z - log_ndtr(z)) / np.sqrt(2.0 * np.pi)
        mean = (total + hidden * below) / whole
    return mean


def near_stars(xy_px, radius_px, size_px):
    """Which pixels are within a radius of places. (n, 2), (n,) -> (rows, columns) bool"""
    width, height = size_px
    covered = np.zeros((height, width), dtype=bool)
    for (x, y), radius in zip(xy_px, np.broadcast_to(radius_px, len(xy_px)), strict=True):
        r0, r1 = max(int(y - radius), 0), min(int(y + radius) + 2, height)
        c0, c1 = max(int(x - radius), 0), min(int(x + radius) + 2, width)
        if r0 < r1 and c0 < c1:
            d2 = (np.arange(c0, c1) - x) ** 2 + ((np.arange(r0, r1) - y) ** 2)[:, None]
            covered[r0:r1, c0:c1] |= d2 <= radius**2
    return covered
