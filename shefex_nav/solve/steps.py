"""The compiled loops of `lens`: Gauss-Newton steps of attitude and lens.

In: stars and detections of one picture. Out: what fits them, with its covariance. The unknowns are eleven:
turn of the camera (3), ln f, and the seven `terms` of the lens: k1, k2, p1, p2, k3, and where its axis meets
the picture, from the middle, over f (2). The attitude C_ci is that of axes through the middle of the picture;
the lens is turned against them by `to_axis`. So a shift of the principal point moves no star in the middle,
and only a wide field tells it.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.distortion import BEHIND, bent_one, slopes_one, straight_one
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.solve.centroid_noise import axes_of, noise_of

UNKNOWNS = 11
LEAST_GATE_PX = 1.5
NOISE_GATE = 4.0  # standard deviations, in the end
LEAST_NOISE_PX = 0.08  # of what is proposed; what is proved has a floor of its own
CONVERGED = 4  # steps with the final gate
SINGULAR = 1e-13  # of a pivot, of a matrix with ones on its diagonal
STEPS = 12  # of the adjustment, a bound only: four are usual
SMALL = 1e-8  # rad; the next step is smaller by its square
OUTLIER = 4.0  # standard deviations; a star further from where the lens puts it is named, not weighed
FEWEST, SHARE = 5, 0.6  # of the stars, that are weighed at least


@inner
def turned(C_ci, turn_c):
    """Attitude after a small turn of the camera (3,) rad, in its axes."""
    D, out = dcm_from_rotvec(turn_c), np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(3):
                out[a, b] += D[a, c] * C_ci[c, b]
    return out


@inner
def to_axis(C_ci, terms):
    """Attitude of the lens (3, 3), from that of the middle of the picture: its axis is seen at terms[5:].

    The shortest turn that brings the middle to where the lens sees it.
    """
    x, y = straight_one(terms[:5], -terms[5], -terms[6])
    r = np.hypot(x, y)
    angle = np.arctan(r) / r if r > 0.0 else 1.0
    return turned(C_ci, np.array([-angle * y, angle * x, 0.0]))


@kernel
def axis_of(C_ci, terms):
    """`to_axis`, for those who are not compiled."""
    return to_axis(C_ci, terms)


@inner
def ideal_of(C_ci, u_i, s):
    """X/Z and Y/Z of star s in the camera, NaN behind it."""
    Z = C_ci[2, 0] * u_i[s, 0] + C_ci[2, 1] * u_i[s, 1] + C_ci[2, 2] * u_i[s, 2]
    if not Z > BEHIND:
        return np.nan, np.nan
    X = C_ci[0, 0] * u_i[s, 0] + C_ci[0, 1] * u_i[s, 1] + C_ci[0, 2] * u_i[s, 2]
    Y = C_ci[1, 0] * u_i[s, 0] + C_ci[1, 1] * u_i[s, 1] + C_ci[1, 2] * u_i[s, 2]
    return X / Z, Y / Z


@inner
def project(C_ci, focal_px, terms, u_i, size_px, ideal, seen_px, inside):
    """Fill ideal x, y (m, 2), pixels (m, 2), and which are in the picture (m,), of the stars (m, 3)."""
    C_ai = to_axis(C_ci, terms)
    cx, cy = principal_point(focal_px, terms, size_px)
    for s in range(u_i.shape[0]):
        ideal[s, 0], ideal[s, 1] = ideal_of(C_ai, u_i, s)
        x, y = bent_one(terms, ideal[s, 0], ideal[s, 1])
        seen_px[s, 0], seen_px[s, 1] = cx + focal_px * x, cy + focal_px * y
        inside[s] = -1.0 < seen_px[s, 0] < size_px[0] and -1.0 < seen_px[s, 1] < size_px[1]


@inner
def principal_point(focal_px, terms, size_px):
    """Where the axis of the lens meets the picture: x, y [px]."""
    return (
        0.5 * (size_px[0] - 1.0) + focal_px * terms[5],
        0.5 * (size_px[1] - 1.0) + focal_px * terms[6],
    )


@inner
def fill_jacobian(focal_px, terms, x, y, J):
    """Derivatives of a pixel by the eleven unknowns. J : (2, 11), filled;  x, y : X/Z, Y/Z of the lens

    The turn is about the axes of the lens, which are those of the middle of the picture to a per cent.
    """
    r2 = x * x + y * y
    xx, xy, yy = slopes_one(terms, x, y)
    by_x, by_y = turn_slopes(x, y)
    for a in range(3):  # the stars turn against the camera
        J[0, a] = -(xx * by_x[a] + xy * by_y[a])
        J[1, a] = -(xy * by_x[a] + yy * by_y[a])
    bent_x, bent_y = bent_one(terms, x, y)
    J[0, 3], J[1, 3] = terms[5] + bent_x, terms[6] + bent_y  # the principal point is a multiple of f
    J[0, 4], J[1, 4] = x * r2, y * r2
    J[0, 5], J[1, 5] = x * r2 * r2, y * r2 * r2
    J[0, 6], J[1, 6] = 2.0 * x * y, r2 + 2.0 * y * y
    J[0, 7], J[1, 7] = r2 + 2.0 * x * x, 2.0 * x * y
    J[0, 8], J[1, 8] = x * r2**3, y * r2**3
    J[0, 9], J[1, 9] = 1.0 - J[0, 1], -J[1, 1]  # the picture is shifted, and the lens turned back
    J[0, 10], J[1, 10] = J[0, 0], 1.0 + J[1, 0]
    for a in range(UNKNOWNS):
        J[0, a] *= focal_px
        J[1, a] *= focal_px


@kernel
def jacobians(focal_px, terms, ideal):
    """Derivatives of pixels by the eleven unknowns. terms : (7,);  ideal : (n, 2) X/Z, Y/Z -> (n, 2, 11)"""
    J = np.empty((ideal.shape[0], 2, UNKNOWNS))
    for n in range(ideal.shape[0]):
        fill_jacobian(focal_px, terms, ideal[n, 0], ideal[n, 1], J[n])
    return J


@inner
def add_star(N, b, J, W, rx, ry):
    """Add a star to normal equations. W : (xx, xy, yy), its weight;  rx, ry : its residual [px]"""
    for a in range(UNKNOWNS):
        wx, wy = W[0] * J[0, a] + W[1] * J[1, a], W[1] * J[0, a] + W[2] * J[1, a]
        b[a] += wx * rx + wy * ry
        for c in range(UNKNOWNS):
            N[a, c] += wx * J[0, c] + wy * J[1, c]


@inner
def solved(N, b, terms, prior):
    """Whether normal equations have an answer; change (11,), covariance (11, 11) with the prior of the lens.

    N, b : of the stars alone;  prior : (7,) standard deviations of the terms, 0 of what does not change
    """
    rows, m = np.empty(UNKNOWNS, dtype=np.int64), 0
    for a in range(UNKNOWNS):
        if a < 4 or prior[a - 4] > 0.0:
            rows[m] = a
            m += 1
    A, right, scale, M = np.empty((m, m)), np.empty(m), np.empty(m), np.zeros((m, m))
    for i in range(m):
        a = rows[i]
        right[i] = b[a]
        for j in range(m):
            A[i, j] = N[a, rows[j]]
        if a >= 4:
            told = prior[a - 4] ** -2.0
            A[i, i] += told
            right[i] -= told * terms[a - 4]
        scale[i] = 1.0 / np.sqrt(max(A[i, i], 1e-300))
    change, covariance = np.zeros(UNKNOWNS), np.zeros((UNKNOWNS, UNKNOWNS))
    # A = L L', then inverse = inverse(L)' inverse(L)
    for i in range(m):
        for j in range(i + 1):
            total = A[i, j] * scale[i] * scale[j]
            for c in range(j):
                total -= A[i, c] * A[j, c]
            if i == j:
                if not total > SINGULAR:
                    return False, change, covariance
                A[i, i] = np.sqrt(total)
            else:
                A[i, j] = total / A[j, j]
    for j in range(m):
        M[j, j] = 1.0 / A[j, j]
        for i in range(j + 1, m):
            total = 0.0
            for c in range(j, i):
                total -= A[i, c] * M[c, j]
            M[i, j] = total / A[i, i]
    for i in range(m):
        for j in range(m):
            total = 0.0
            for c in range(max(i, j), m):
                total += M[c, i] * M[c, j]
            total *= scale[i] * scale[j]
            covariance[rows[i], rows[j]] = total
            change[rows[i]] += total * right[j]
    return True, change, covariance


@inner
def match(seen_px, inside, xy_px, gate_px, star):
    """Mutually nearest stars and detections within the gate; how many. star : (n,), filled, -1 where none

    Of the stars in the order of their rows of pixels only those within the gate are looked at.

    seen_px : (m, 2) places of the stars;  inside : (m,) which may be matched
    """
    n, m, known = xy_px.shape[0], seen_px.shape[0], 0
    back, near = np.full(m, -1, dtype=np.int64), np.full(m, gate_px * gate_px)
    order = np.flatnonzero(inside)
    order = order[np.argsort(seen_px[order, 1])]
    down = seen_px[order, 1]
    for i in range(n):
        star[i], least = -1, gate_px * gate_px
        for p in range(np.searchsorted(down, xy_px[i, 1] - gate_px), len(down)):
            if down[p] > xy_px[i, 1] + gate_px:
                break
            s = order[p]
            d2 = (seen_px[s, 0] - xy_px[i, 0]) ** 2 + (seen_px[s, 1] - xy_px[i, 1]) ** 2
            if d2 < least:
                star[i], least = s, d2
            if d2 < near[s]:
                back[s], near[s] = i, d2
    for i in range(n):
        if star[i] >= 0 and back[star[i]] != i:
            star[i] = -1
        known += star[i] >= 0
    return known


@inner
def spread_of(residual_px, star, n_known):
    """Standard deviation per axis from the median of the residuals; few stars, few degrees of freedom."""
    squares, m = np.empty(n_known), 0
    for i in range(len(star)):
        if star[i] >= 0:
            squares[m] = residual_px[i, 0] ** 2 + residual_px[i, 1] ** 2
            m += 1
    median = np.median(squares) / 1.386  # 2 ln 2: median of chi^2 with 2
    return max(np.sqrt(median * 2 * m / max(2 * m - 4, 1)), LEAST_NOISE_PX)


@kernel
def fitted(proposal, u_i, xy_px, size_px, prior, gates_px, least):
    """Least squares from a proposal, stars matched anew at each step; see `lens.fit`.

    Parameters
    ----------
    proposal : C_ci (3, 3), focal_px float, terms (7,)
    u_i : (m, 3) stars;  xy_px : (n, 2) detections
    size_px : (width, height), floats
    prior : (7,) standard deviations of the terms, 0 where they are told
    gates_px : of the first steps
    least : int, matches

    Returns
    -------
    ok : bool;  C_ci, focal_px, terms;  star : (n,) row of the stars, -1
    residual_px : (n, 2), 0 where unmatched;  noise_px : float;  covariance : (11, 11)
    """
    C_ci, focal_px, terms = proposal[0].copy(), proposal[1], proposal[2].copy()
    n, m, start_px, last = xy_px.shape[0], u_i.shape[0], focal_px, len(gates_px) + CONVERGED - 1
    seen, ideal, inside = np.empty((m, 2)), np.empty((m, 2)), np.empty(m, dtype=np.bool_)
    star, residual, J = np.full(n, -1, dtype=np.int64), np.zeros((n, 2)), np.empty((2, UNKNOWNS))
    covariance, noise = np.zeros((UNKNOWNS, UNKNOWNS)), np.inf
    for step in range(last + 1):
        project(C_ci, focal_px, terms, u_i, size_px, ideal, seen, inside)
        gate_px = max(gates_px[step] if step < len(gates_px) else NOISE_GATE * noise, LEAST_GATE_PX)
        known = match(seen, inside, xy_px, gate_px, star)
        if known < least:
            return False, C_ci, focal_px, terms, star, residual, noise, covariance
        for i in range(n):
            for a in range(2):
                residual[i, a] = xy_px[i, a] - seen[star[i], a] if star[i] >= 0 else 0.0
        noise = spread_of(residual, star, known)
        N, b = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS)
        for i in range(n):
            if star[i] >= 0:
                rx, ry = residual[i]
                w = noise**-2.0 / (1.0 + (rx * rx + ry * ry) / (3.0 * noise) ** 2)  # bad stars held down
                fill_jacobian(focal_px, terms, ideal[star[i], 0], ideal[star[i], 1], J)
                add_star(N, b, J, (w, 0.0, w), rx, ry)
        ok, change, covariance = solved(N, b, terms, prior)
        if not ok:
            return False, C_ci, focal_px, terms, star, residual, noise, covariance
        if step < last:
            C_ci, focal_px = turned(C_ci, change[:3]), focal_px * np.exp(change[3])
            terms += change[4:]
            if not 0.5 < focal_px / start_px < 2.0:  # no fit, whatever it is
                return False, C_ci, focal_px, terms, star, residual, noise, covariance
    return True, C_ci, focal_px, terms, star, residual, noise, covariance


@kernel
def adjusted(C_ci, focal_px, terms, prior, u_i, xy_px, P_px, size_px):
    """Weighted least squares over stars that have a name; see `lens.adjust`.

    Returns
    -------
    ok : bool;  C_ci, focal_px, terms;  covariance : (11, 11), as the noise that was found makes it
    used : (n,) bool;  n_lens : squares that the unknowns take;  multiple, floor2 : of `noise_of`
    """
    n, n_lens, multiple, floor2 = len(xy_px), 4.0, 1.0, 0.0
    C_ci, terms = C_ci.copy(), terms.copy()
    values, turn = axes_of(P_px)
    used, kept = np.ones(n, dtype=np.bool_), np.empty(n, dtype=np.bool_)
    ideal, residual = np.empty((n, 2)), np.empty((n, 2))
    along2, J, covariance = np.empty((n, 2)), np.empty((2, UNKNOWNS)), np.zeros((UNKNOWNS, UNKNOWNS))
    for _ in range(STEPS):
        C_ai = to_axis(C_ci, terms)
        cx, cy = principal_point(focal_px, terms, size_px)
        for i in range(n):
            ideal[i, 0], ideal[i, 1] = ideal_of(C_ai, u_i, i)
            x, y = bent_one(terms, ideal[i, 0], ideal[i, 1])
            rx, ry = xy_px[i, 0] - cx - focal_px * x, xy_px[i, 1] - cy - focal_px * y
            residual[i, 0], residual[i, 1] = rx, ry
            along2[i, 0] = (turn[i, 0] * rx + turn[i, 1] * ry) ** 2
            along2[i, 1] = (turn[i, 0] * ry - turn[i, 1] * rx) ** 2
        multiple, floor2 = noise_of(along2[used], values[used], n_lens)
        for i in range(n):
            whole = multiple * values[i] + floor2
            kept[i] = along2[i, 0] / whole[0] + along2[i, 1] / whole[1] < OUTLIER**2
        if kept.sum() >= max(float(FEWEST), SHARE * n):
            used[:] = kept
        N, b = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS)
        for i in range(n):
            if used[i]:
                xx, xy = multiple * P_px[i, 0, 0] + floor2, multiple * P_px[i, 0, 1]
                yy = multiple * P_px[i, 1, 1] + floor2
                det = xx * yy - xy * xy
                fill_jacobian(focal_px, terms, ideal[i, 0], ideal[i, 1], J)
                add_star(N, b, J, (yy / det, -xy / det, xx / det), residual[i, 0], residual[i, 1])
        ok, change, covariance = solved(N, b, terms, prior)
        if not ok:
            return False, C_ci, focal_px, terms, covariance, used, n_lens, multiple, floor2
        n_lens = (covariance * N).sum()  # of which a prior leaves a part
        C_ci, focal_px = turned(C_ci, change[:3]), focal_px * np.exp(change[3])
        terms += change[4:]
        if np.abs(change[:3]).max() < SMALL:
            break
    return True, C_ci, focal_px, terms, covariance, used, n_lens, multiple, floor2
