"""How a star looks in this frame: the width of its spot and the streak that the motion makes of it.

In: the frame and its objects. Out: `Shape`, one for all stars of the frame, and how well it is known. Nothing
is known beforehand: the brightest objects tell it.

    second moments that the scan took of each -> their median: a first shape, of a spot or of a line
         -> least squares over the pixels: the covariance S = (xx, xy, yy) of the spot that all share, with
            place and flux of each star eliminated

The moments alone will not do. A spot that is narrower than a pixel is not sampled by the pixels, its moments
depend on where in the pixel it lies, and a model of the wrong width puts it off by an error that repeats with
the pixels. The fit integrates the spot over each pixel. An object whose own S lies far from that of the
others, a double star or a particle hit, pulls with constant force (Huber). Where the fit finds no end, the
first shape stays, with a covariance of the size by which first shapes are wrong.
"""

from math import erf

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.attitude import det3, inverse3, times
from shefex_nav.onboard.startracker.likelihood import misfit_growth
from shefex_nav.onboard.startracker.scan import FLUX, NOISE, PIXELS, SATURATED, XX, XY, YY, X, Y
from shefex_nav.onboard.startracker.spot import (
    SEEN,
    SPOT,
    TO_X,
    TO_XX,
    TO_XY,
    TO_Y,
    TO_YY,
    VARIANCE,
    WORK,
    Shape,
    curves,
    model,
    pixels,
    spots_of,
    window_of,
)

MOST_STARS = 9  # brightest ones that are measured
LEAST_SIGNAL = 8.0  # of an object, in noise; what is fainter may be noise itself
BLOCK_VARIANCE = 2.0 / 3.0  # px^2 per axis, of the 3x3 pixels of a block
EXCESS = (
    0.15  # px^2 per axis, of these moments over S: of the pixel, and of the sampling [E, rendered frames]
)
LEAST_SIGMA = 0.3  # px; a narrower spot lies in one pixel and has no shape
UNKNOWN_PART = 0.15  # of the width, standard deviation where the frame does not show it [E]
LINE = 2.0  # greater over smaller variance from which a spot is taken for a line, L = 3.5 sigma
LINE_STEPS = 16  # of the integral over half a line
LINE_ROUNDS = 9  # of bisection: its length to 1/500
MOST_ROUNDS = 12  # of Gauss and Newton, all stars together
SMALL_CHANGE = 0.02  # of the shape, see `_part`: the next would be its square
GREATEST_CHANGE = 0.5  # of the shape in one round, part of the eigenvalue of each direction
FARTHEST_PX = 1.0  # of a star from the place that the scan gave
HUBER = 2.0  # sigmas of an object's own shape from that of all
PRIOR_DOF = 30.0  # weight of the expected misfit against the one seen [E]
SINGULAR = 1e-12  # of a determinant, against the product of the diagonal
NO_OTHERS = np.empty((0, 3))


@inner
def measure(picture, table, default_sigma_px):
    """Shape of the stars in a frame.

    Parameters
    ----------
    picture : Picture
    table : (n, scan.COLUMNS) objects, brightest first
    default_sigma_px : width where the frame shows no clear star that is not saturated

    Returns
    -------
    Shape
    P_S : (3, 3) px^4, covariance of xx, xy, yy of the spot
    """
    chosen = _clear_stars(table)
    n = len(chosen)
    if n == 0:
        return Shape(default_sigma_px, 0.0, 0.0), _unknown(default_sigma_px)
    moments = np.empty((3, n))
    for k in range(n):
        star = chosen[k]
        moments[0, k], moments[1, k], moments[2, k] = table[star, XX], table[star, XY], table[star, YY]
    first = _possible(_unweighted(np.median(moments[0]), np.median(moments[1]), np.median(moments[2])))
    S, P_S, is_found = _fitted(picture, table[chosen], first)
    if not is_found:
        return _shape(first), _doubted(first)
    return _shape(S), P_S


@kernel
def streak_px(picture, table, default_sigma_px):
    """Length of the streak that the motion of the camera has made of the stars; arguments as of `measure`."""
    shape, _ = measure(picture, table, default_sigma_px)
    return np.hypot(shape.streak_x, shape.streak_y)


@inner
def _clear_stars(table):
    """Rows of the brightest objects that are not saturated and no noise."""
    n = 0
    chosen = np.empty(MOST_STARS, dtype=np.int64)
    for k in range(table.shape[0]):
        signal_to_noise = table[k, FLUX] / (table[k, NOISE] * np.sqrt(table[k, PIXELS]))
        if table[k, SATURATED] == 0 and signal_to_noise > LEAST_SIGNAL and n < MOST_STARS:
            chosen[n] = k
            n += 1
    return chosen[:n]


@inner
def _unknown(sigma_px):
    """Covariance of the shape where only the data sheet tells it: a round spot, S = sigma^2."""
    variance = (2.0 * UNKNOWN_PART * sigma_px**2) ** 2
    P_S = np.zeros((3, 3))
    P_S[0, 0] = P_S[0, 2] = P_S[2, 0] = P_S[2, 2] = variance
    return P_S


@inner
def _eigen(xx, xy, yy):
    """Eigenvalues of a symmetric matrix, great and small, and the direction of the great one."""
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = np.hypot(half, xy)
    return mean + radius, mean - radius, 0.5 * np.arctan2(xy, half)


@inner
def _doubted(S):
    """Covariance of a shape that only the moments tell: each eigenvalue by itself, and the direction."""
    great, small, angle = _eigen(S[0], S[1], S[2])
    part, P_S = 2.0 * UNKNOWN_PART, np.zeros((3, 3))
    c, s = np.cos(angle), np.sin(angle)
    for sigma, d in (
        (part * great, (c * c, c * s, s * s)),
        (part * small, (s * s, -c * s, c * c)),
        (part * np.sqrt(great * small), (-2.0 * c * s, c * c - s * s, 2.0 * c * s)),
    ):
        for i in range(3):
            for j in range(3):
                P_S[i, j] += sigma**2 * d[i] * d[j]
    return P_S


@inner
def _unweighted(xx, xy, yy):
    """Covariance of a spot from the moments that the scan took, weighted with the spot smoothed over a block.

    Of a Gaussian the product of spot, variance s, and weight, variance s + 2/3, has along an axis the
    variance m = s (s + 2/3) / (2 s + 2/3); solved for s. A line is flat, and so is its product with the
    weight: taken for a Gaussian it would come out up to 1.4 times too long.
    """
    great, small, angle = _eigen(xx, xy, yy)
    s_great, s_small = _variance(great), _variance(small)
    if s_great > LINE * s_small:
        s_great = s_small + _length(great, max(s_small, LEAST_SIGMA**2)) ** 2 / 12.0
    return _symmetric(s_great - EXCESS, s_small - EXCESS, angle)


@inner
def _variance(moment):
    """... of a Gaussian along an axis."""
    b = BLOCK_VARIANCE
    return moment - 0.5 * b + np.sqrt((moment - 0.5 * b) ** 2 + b * moment) if moment > 0.0 else 0.0


@inner
def _length(moment, variance):
    """... of a line, of spots of that variance [px]."""
    low, high = 0.0, np.sqrt(12.0 * (2.0 * moment + BLOCK_VARIANCE))
    for _ in range(LINE_ROUNDS):
        middle = 0.5 * (low + high)
        if _weighted_moment(middle, variance) < moment:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner
def _weighted_moment(length, variance):
    """Second moment along a line of its light times its weight [px^2]."""
    a, b = 1.0 / np.sqrt(2.0 * variance), 1.0 / np.sqrt(2.0 * (variance + BLOCK_VARIANCE))
    step = (0.5 * length + 3.0 * np.sqrt(variance)) / LINE_STEPS
    total, moment = 0.0, 0.0
    for k in range(LINE_STEPS):
        x = (k + 0.5) * step
        left, right = x + 0.5 * length, x - 0.5 * length
        product = (erf(left * a) - erf(right * a)) * (erf(left * b) - erf(right * b))
        total += product
        moment += product * x * x
    return moment / total if total > 0.0 else variance


@inner
def _symmetric(great, small, angle):
    """(xx, xy, yy) of a matrix with these eigenvalues."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([great * c * c + small * s * s, (great - small) * c * s, great * s * s + small * c * c])


@inner
def _possible(S):
    """S with eigenvalues no smaller than LEAST_SIGMA^2."""
    great, small, angle = _eigen(S[0], S[1], S[2])
    return _symmetric(max(great, LEAST_SIGMA**2), max(small, LEAST_SIGMA**2), angle)


@inner
def _shape(S):
    """Spot and streak of a covariance: a line of length L adds L^2/12 along itself."""
    great, small, angle = _eigen(S[0], S[1], S[2])
    length = np.sqrt(12.0 * max(great - small, 0.0))
    return Shape(np.sqrt(small), length * np.cos(angle), length * np.sin(angle))


@inner
def _fitted(picture, stars, S):
    """S of largest likelihood for some stars, from a first one, its covariance, and whether it was found.

    Gauss-Newton over S and place and flux p of each star. With A, B, C the blocks of a star's normal matrix
    and a, c its right sides, p eliminated: J = C - B' A^-1 B, g = c - B' A^-1 a; the star by itself would
    change S by J^-1 g, all together by (sum w J)^-1 sum w g.
    """
    n, work = len(stars), np.empty(WORK)
    p = np.empty((n, 3))
    p[:, 0], p[:, 1], p[:, 2] = stars[:, X], stars[:, Y], stars[:, FLUX]
    J, g, back = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3, 4))
    good = np.empty(n, dtype=np.bool_)
    P_S = np.zeros((3, 3))
    for _ in range(MOST_ROUNDS):
        spots = spots_of(_shape(S))
        for k in range(n):
            good[k] = _one(picture, stars[k], p[k], spots, work, J[k], g[k], back[k])
        if not good.any():
            break
        change, P_S = _together(J[good], g[good])
        part, is_small = _part(S, change)
        change *= min(1.0, GREATEST_CHANGE / max(part, 1e-12))
        S = _possible(S + change)
        if is_small:
            return S, P_S, True
        for k in range(n):
            if good[k]:
                step = back[k, :, 3] - times(back[k, :, :3], change)
                p[k, 0], p[k, 1] = p[k, 0] + step[0], p[k, 1] + step[1]
                p[k, 2] = max(p[k, 2] + step[2], 0.3 * p[k, 2])
    return S, P_S, False


@inner
def _part(S, change):
    """Greatest part of S that changes, each direction by its own eigenvalue; whether the next is negligible.

    It is where the ends of a streak move by less than 2 SMALL_CHANGE of its width: along, a part of
    sqrt(great small).
    """
    great, small, angle = _eigen(S[0], S[1], S[2])
    c, s = np.cos(angle), np.sin(angle)
    along = abs(c * c * change[0] + 2.0 * c * s * change[1] + s * s * change[2])
    across = abs(s * s * change[0] - 2.0 * c * s * change[1] + c * c * change[2])
    mean = np.sqrt(great * small)
    turned = abs(c * s * (change[2] - change[0]) + (c * c - s * s) * change[1]) / mean
    is_small = max(along / mean, across / small, turned) < SMALL_CHANGE
    return max(along / great, across / small, turned), is_small


@inner
def _one(picture, star, p, spots, work, J, g, back):
    """Write J, g and (A^-1 B, A^-1 a) of one star; returns whether it tells anything."""
    if np.hypot(p[0] - star[X], p[1] - star[Y]) > FARTHEST_PX:
        return False
    window = window_of(star, spots, picture.image_dn.shape)
    n = pixels(picture, star, spots, NO_OTHERS, window, work)
    model(spots, p[0], p[1], window, work)
    curves(spots, p[0], p[1], window, work)
    M = _sums(p[2], window, picture.dn_per_electron, work)
    A = M[:3, :3].copy()
    if not det3(A) > SINGULAR * A[0, 0] * A[1, 1] * A[2, 2] > 0.0:
        return False
    inverse = inverse3(A)
    for j in range(4):
        back[:, j] = times(inverse, M[:3, 3 + j])
    for i in range(3):
        B = M[:3, 3 + i]
        for j in range(3):
            J[i, j] = M[3 + i, 3 + j] - (B[0] * back[0, j] + B[1] * back[1, j] + B[2] * back[2, j])
        g[i] = M[3 + i, 6] - (B[0] * back[0, 3] + B[1] * back[1, 3] + B[2] * back[2, 3])
    if not det3(J) > SINGULAR * M[3, 3] * M[4, 4] * M[5, 5]:
        return False
    own, chi2 = times(inverse3(J), g), M[6, 6]
    for i in range(3):
        chi2 -= back[i, 3] * M[i, 6] + g[i] * own[i]
    growth = misfit_growth(chi2, max(n - 6.0, 1.0), PRIOR_DOF)
    J /= growth
    g /= growth
    return True


@inner(error_model="numpy")
def _sums(flux, window, dn_per_electron, work):
    """Products of what changes the light of a star, weighted and summed over the pixels: (7, 7).

    Of x, y, flux, xx, xy, yy, and of what the model leaves over.
    """
    _, _, width, height = window
    n = width * height
    D, weighted = np.empty((7, n)), np.empty((7, n))
    shot, k = flux * dn_per_electron, 0
    for r in range(height):
        for c in range(width):
            spot = work[SPOT, r, c]
            weight = 1.0 / (work[VARIANCE, r, c] + shot * spot)
            D[0, k], D[1, k], D[2, k] = flux * work[TO_X, r, c], flux * work[TO_Y, r, c], spot
            D[3, k], D[4, k] = flux * work[TO_XX, r, c], flux * work[TO_XY, r, c]
            D[5, k], D[6, k] = flux * work[TO_YY, r, c], work[SEEN, r, c] - flux * spot
            for i in range(7):
                weighted[i, k] = weight * D[i, k]
            k += 1
    M = np.empty((7, 7))
    for i in range(7):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += weighted[i, k] * D[j, k]
            M[i, j] = M[j, i] = total
    return M


@inner
def _together(J, g):
    """Change of S that the stars agree on, those far from the others with a bounded pull; its covariance."""
    n = len(J)
    total, pull, chi2 = np.zeros((3, 3)), np.zeros(3), 0.0
    for k in range(n):
        own = times(inverse3(J[k]), g[k])
        distance = np.sqrt(max(own[0] * g[k, 0] + own[1] * g[k, 1] + own[2] * g[k, 2], 0.0))
        weight = min(1.0, HUBER / max(distance, 1e-12))
        total += weight * J[k]
        pull += weight * g[k]
        chi2 += weight * distance**2
    inverse = inverse3(total)
    return times(inverse, pull), inverse * misfit_growth(chi2, max(3.0 * (n - 1), 1.0), PRIOR_DOF)
