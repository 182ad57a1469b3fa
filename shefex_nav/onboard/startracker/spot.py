"""The light that a star leaves in the pixels: a Gaussian spot, drawn along its streak, integrated over each.

In: a `Shape`, the place of a star, the pixels of a window. Out: the share of its light in each pixel and how
that changes with place and shape; what the frame shows there, with its variance. A spot as narrow as a pixel
must be integrated: its height in the middle of a pixel is not the light in it.
"""

from math import erf, exp, pi, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.startracker.scan import BACKGROUND, FLUX, NOISE, X, Y

PER_SIGMA = 128  # steps of the tables below; linear interpolation is good to 2e-6
REACH = 6  # sigmas
_Z = np.arange(-REACH * PER_SIGMA, REACH * PER_SIGMA + 2) / PER_SIGMA
NORMAL = np.array([[0.5 * (1.0 + erf(z / sqrt(2.0))), exp(-0.5 * z * z) / sqrt(2.0 * pi)] for z in _Z])

FREE_SUMS = {"reassoc", "contract", "arcp", "nsz"}  # fastmath of sums, without what infinite variances forbid
STEP_SIGMAS = 1.6  # two spots this far apart, in sigmas, add up to a smooth ridge
WINDOW = (2.5, 5.0)  # sigmas, least and greatest radius of the pixels that are used
WINDOW_NOISE = 0.5  # the window reaches to where the star's light is this fraction of the noise
LARGEST_REACH = 31  # px
LAYERS = 9  # of work memory: light, its slopes, edges, light seen, its variance, its change with the shape
SPOT, TO_X, TO_Y, EDGES, SEEN, VARIANCE, TO_XX, TO_XY, TO_YY = range(LAYERS)
WORK = (LAYERS, 2 * LARGEST_REACH + 2, 2 * LARGEST_REACH + 2)  # layers of the greatest window


class Shape(NamedTuple):
    """A Gaussian spot drawn along a straight line; plain numbers, passed on to compiled code."""

    sigma_px: float
    streak_x: float  # px, from one end of the streak to the other
    streak_y: float


class Picture(NamedTuple):
    """A frame, and what its grey values are worth."""

    image_dn: np.ndarray  # (rows, columns)
    bad_pixels: np.ndarray  # (n, 2) int64 row, column; what the frame shows there is not used
    saturation_dn: int  # grey value of a saturated pixel
    dn_per_electron: float  # 0 where it is not known: the shot noise of the stars is left out


@inner
def spots_of(shape):
    """Gaussian spots that together are a streak: (n, 3) x, y from its middle, sigma; equal shares of light.

    n points at equal steps d have the variance d^2 (n^2 - 1) / 12, a line of length L has L^2 / 12.
    """
    length = np.hypot(shape.streak_x, shape.streak_y)
    n = int(np.ceil(length / (STEP_SIGMAS * shape.sigma_px))) + 1 if length > 0.2 * shape.sigma_px else 1
    spots = np.zeros((n, 3))
    step = 1.0 / np.sqrt(n * n - 1.0) if n > 1 else 0.0
    for k in range(n):
        along = (k - 0.5 * (n - 1)) * step
        spots[k, 0], spots[k, 1], spots[k, 2] = along * shape.streak_x, along * shape.streak_y, shape.sigma_px
    return spots


@inner(forceinline=True)
def normal(z):
    """Normal distribution and density at z, linear between the steps of a table."""
    place = min(max((z + REACH) * PER_SIGMA, 0.0), 2.0 * REACH * PER_SIGMA)
    index = np.uint64(place)
    part = place - index
    next_one = index + np.uint64(1)
    c = NORMAL[index, 0] + part * (NORMAL[next_one, 0] - NORMAL[index, 0])
    d = NORMAL[index, 1] + part * (NORMAL[next_one, 1] - NORMAL[index, 1])
    return c, d


@inner
def _edges(centre, first, n, sigma, share, slope):
    """Share of a spot's light in each of n pixels from `first` on, and its derivative to the centre."""
    inverse = 1.0 / sigma
    below_c, below_d = 0.0, 0.0
    for k in range(n + 1):
        above_c, above_d = normal((first + k - 0.5 - centre) * inverse)
        above_d *= inverse
        if k > 0:
            share[k - 1], slope[k - 1] = above_c - below_c, below_d - above_d
        below_c, below_d = above_c, above_d


@inner
def model(spots, x, y, window, work):
    """Write the light of a star of flux one, and its derivatives to x and y, to its layers of work."""
    left, top, width, height = window
    edges = work[EDGES]
    columns, column_slopes, rows, row_slopes = edges[0], edges[1], edges[2], edges[3]
    share = 1.0 / spots.shape[0]
    for k in range(spots.shape[0]):
        _edges(x + spots[k, 0], left, width, spots[k, 2], columns, column_slopes)
        _edges(y + spots[k, 1], top, height, spots[k, 2], rows, row_slopes)
        for r in range(height):
            light, slope = rows[r] * share, row_slopes[r] * share
            spot, to_x, to_y = work[SPOT, r], work[TO_X, r], work[TO_Y, r]
            if k == 0:
                for c in range(width):
                    spot[c] = light * columns[c]
                    to_x[c] = light * column_slopes[c]
                    to_y[c] = slope * columns[c]
            else:
                for c in range(width):
                    spot[c] += light * columns[c]
                    to_x[c] += light * column_slopes[c]
                    to_y[c] += slope * columns[c]


@inner
def _curved(spot, x, y, window, work):
    """Shares of one spot of a star at x, y in each column, their slopes, the same of rows; curves of both."""
    left, top, width, height = window
    edges = work[EDGES]
    columns, column_slopes, rows, row_slopes, column_curves, row_curves = (
        edges[0], edges[1], edges[2], edges[3], edges[4], edges[5]
    )  # fmt: skip
    _edges(x + spot[0], left, width, spot[2], columns, column_slopes)
    _edges(y + spot[1], top, height, spot[2], rows, row_slopes)
    _edge_curves(x + spot[0], left, width, spot[2], column_curves)
    _edge_curves(y + spot[1], top, height, spot[2], row_curves)
    return columns, column_slopes, rows, row_slopes, column_curves, row_curves


@inner
def curves(spots, x, y, window, work):
    """Write how the light of a star of flux one changes with xx, xy, yy of the spot's covariance.

    A Gaussian spreads as heat does: dG/dS_xx = d2G/dx2 / 2, dG/dS_xy = d2G/dxdy. A streak changes otherwise,
    its light grows at the ends: see `_streak_curves`.
    """
    if spots.shape[0] > 1:
        _streak_curves(spots, x, y, window, work)
        return
    _, _, width, height = window
    columns, column_slopes, rows, row_slopes, column_curves, row_curves = _curved(
        spots[0], x, y, window, work
    )
    for r in range(height):
        for c in range(width):
            work[TO_XX, r, c] = rows[r] * column_curves[c]
            work[TO_XY, r, c] = row_slopes[r] * column_slopes[c]
            work[TO_YY, r, c] = row_curves[r] * columns[c]


@inner
def _streak_curves(spots, x, y, window, work):
    """... of a streak of length L, spot k at a_k L along it, the variance along it S_gg = L^2/12 + S_ss.

    With G_k the light of a spot, its slopes along and across the streak, and H = sum (G_xx + G_yy) / 2:
    dS_gg draws the spots apart, (6 / L) sum a_k G_k,along; dS_gs turns them, (12 / L) sum a_k G_k,across;
    dS_ss makes them wider at the same S_gg, H - (6 / L) sum a_k G_k,along. For L -> 0 that is heat again.
    """
    _, _, width, height = window
    n = spots.shape[0]
    length = 2.0 * sqrt((n + 1.0) / (n - 1.0)) * np.hypot(spots[0, 0], spots[0, 1])
    c, s = -spots[0, 0], -spots[0, 1]
    half = np.hypot(c, s)
    c, s = c / half, s / half
    drawn_x, drawn_y, wider = work[TO_XX], work[TO_XY], work[TO_YY]  # sums over the spots, until the end
    drawn_x[:height, :width], drawn_y[:height, :width], wider[:height, :width] = 0.0, 0.0, 0.0
    share = 1.0 / n
    for k in range(n):
        part = share * (c * spots[k, 0] + s * spots[k, 1]) / length
        edges = _curved(spots[k], x, y, window, work)
        columns, column_slopes, rows, row_slopes, column_curves, row_curves = edges
        for i in range(height):
            light, slope = part * rows[i], part * row_slopes[i]
            row, curve = share * rows[i], share * row_curves[i]
            for j in range(width):
                drawn_x[i, j] += light * column_slopes[j]
                drawn_y[i, j] += slope * columns[j]
                wider[i, j] += row * column_curves[j] + curve * columns[j]
    for i in range(height):
        for j in range(width):
            gg = (c * drawn_x[i, j] + s * drawn_y[i, j]) * 6.0 / length
            gs = (c * drawn_y[i, j] - s * drawn_x[i, j]) * 12.0 / length
            ss = wider[i, j] - gg
            work[TO_XX, i, j] = c * c * gg + s * s * ss - c * s * gs
            work[TO_XY, i, j] = 2.0 * c * s * (gg - ss) + (c * c - s * s) * gs
            work[TO_YY, i, j] = s * s * gg + c * c * ss + c * s * gs


@inner
def _edge_curves(centre, first, n, sigma, curve):
    """Half the second derivative to the centre of the shares of `_edges`.

    Of Phi(z), z = (edge - centre) / sigma, the second derivative is -z phi(z) / sigma^2.
    """
    scale = -0.5 / (sqrt(2.0 * pi) * sigma * sigma)
    below = 0.0
    for k in range(n + 1):
        z = (first + k - 0.5 - centre) / sigma
        above = scale * z * exp(-0.5 * z * z)
        if k > 0:
            curve[k - 1] = above - below
        below = above


@inner
def window_of(star, spots, shape):
    """First and last column and row of the pixels that are used for a star."""
    half_x, half_y = abs(spots[0, 0]), abs(spots[0, 1])
    sigma = spots[0, 2]
    peak = star[FLUX] / (2.0 * pi * sigma * (sigma + 0.8 * np.hypot(half_x, half_y)))
    radius = np.sqrt(2.0 * np.log(max(peak / (WINDOW_NOISE * star[NOISE]), 1.0)))
    radius = min(max(radius, WINDOW[0]), WINDOW[1]) * sigma
    reach_x = min(int(radius + half_x + 0.5), LARGEST_REACH)
    reach_y = min(int(radius + half_y + 0.5), LARGEST_REACH)
    column, row = int(np.rint(star[X])), int(np.rint(star[Y]))
    left, right = max(0, column - reach_x), min(shape[1] - 1, column + reach_x)
    top, bottom = max(0, row - reach_y), min(shape[0] - 1, row + reach_y)
    return left, top, right - left + 1, bottom - top + 1


@inner
def pixels(picture, star, spots, others, window, work):
    """Write the light of one star, without the others', and its variance to their layers of work.

    others : (m, 3 or more) x, y and flux of each. The variance lacks the star's own shot noise; that of a
    saturated or bad pixel is infinite. Returns how many are not.
    """
    left, top, width, height = window
    light, variance = work[SEEN], work[VARIANCE]
    noise2, n = star[NOISE] ** 2, 0
    for r in range(height):
        for c in range(width):
            value = picture.image_dn[top + r, left + c]
            light[r, c] = value - star[BACKGROUND]
            variance[r, c] = noise2 if value < picture.saturation_dn else np.inf
            n += value < picture.saturation_dn
    for k in range(picture.bad_pixels.shape[0]):
        r, c = picture.bad_pixels[k, 0] - top, picture.bad_pixels[k, 1] - left
        if 0 <= r < height and 0 <= c < width and variance[r, c] < np.inf:
            variance[r, c] = np.inf
            n -= 1
    for j in range(others.shape[0]):
        model(spots, others[j, 0], others[j, 1], window, work)
        for r in range(height):
            for c in range(width):
                other = others[j, 2] * work[SPOT, r, c]
                light[r, c] -= other
                variance[r, c] += other * picture.dn_per_electron
    return n
