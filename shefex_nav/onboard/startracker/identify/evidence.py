"""How much better 'these stars' explains a frame than chance: the logarithm of a Bayes factor.

In: an attitude that may be right, the detections, the catalogue. Out: the attitude adjusted to all stars that
fit it, and the odds for it. The simulator's noise is not assumed: the centroid error may be a few times what
was said and has a heavy tail, the zero point of the brightness is free, the share of the stars that are
detected and the faintest one that can be are not known, the focal length may be a little off.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.onboard.startracker.identify.ellipses import Ellipses, apart, log_area, weigh, weighted2
from shefex_nav.onboard.startracker.identify.lever import REACH_PX, STAR_GATE, gate_of, reach_of
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS
from shefex_nav.onboard.startracker.tables import cell_of

MAX_STARS = 160  # predicted in one frame; more than four times the usual field
OUTSIDE_PX = 2.0  # a star just beyond the border may still be a detection
BORDER_PX = 5.0  # a predicted star nearer to the border may be missing
WIDE_GATE = 14.0  # centroid errors, for the first adjustment; holds the largest of NOISE_SCALES
GATE = 4.5  # of the noise seen in the frame
SETTLED = 0.2  # of the noise: a smaller step is the last
NOISE_SCALES = (1.0, 1.8, 3.4)  # times the centroid error, and how likely each is
NOISE_WEIGHTS = (0.45, 0.28, 0.27)
TAIL_SHARE, TAIL_SCALE = 0.06, 4.0  # of the centroids have an error this much larger: double stars
ZERO_POINT_SIGMA = 0.7  # mag; the median detection tells the zero point that well before any match
DEEPER = 0.2  # share of the cameras that see many stars fainter than the catalogue
MUTE = 0.1  # share of the frames whose brightness says nothing
FOCAL_SIGMA = 0.004  # relative error of the focal length ...
FOCAL_SHARE = 0.2  # ... of the cameras whose focal length is off


class Scene(NamedTuple):
    """One frame: what was detected and what is known of the camera."""

    xy_px: np.ndarray  # (n, 2) of an ideal pinhole, brightest first
    mag: np.ndarray  # (n,) -2.5 log10 flux
    has_flux: bool
    width_px: float
    height_px: float
    focal_px: float  # nominal
    cx_px: float
    cy_px: float
    border_px: float  # within it a predicted star may be missing: BORDER_PX + what the lens displaces
    centroid_error: float  # px, of an ordinary centroid, per axis
    magnitude_error: float
    ellipses: Ellipses | None  # of the detections; None: all round


class Prior(NamedTuple):
    """What was known of the attitude before the frame."""

    known: bool
    C_ci: np.ndarray  # (3, 3)
    P_c: np.ndarray  # (3, 3) rad^2


class View(NamedTuple):
    """Stars predicted in the frame; arrays of MAX_STARS of which the first n count."""

    row: np.ndarray
    xy_px: np.ndarray
    det: np.ndarray  # detection, -1 where none
    distance2: np.ndarray  # px^2 to the detection, weighted as in `ellipses`
    taken: np.ndarray  # working space: star of each detection of a frame, -1
    spare: np.ndarray  # working space


class Trial(NamedTuple):
    """An attitude under examination, and what of it is free."""

    C: np.ndarray  # (3, 3) C_ci, written
    focal_px: float
    n_par: int  # 3: the attitude is adjusted; 4: the focal length, too


class Fit(NamedTuple):
    """What `adjust` has made of a trial."""

    C: np.ndarray  # (3, 3) C_ci
    focal_px: float
    n_par: int  # of the trial
    n: int  # stars in the view; 0 where the field does not hold enough of them
    L: np.ndarray  # (4, 4) factor of the information, px^-2 rad^2
    log_det: float  # of the information
    noise_px: float  # of the centroids


@inner
def new_view():
    """Room for the stars of one frame."""
    return View(
        np.empty(MAX_STARS, dtype=np.int64),
        np.empty((MAX_STARS, 2)),
        np.empty(MAX_STARS, dtype=np.int64),
        np.empty(MAX_STARS),
        np.empty(MAX_DETECTIONS, dtype=np.int64),
        np.empty(MAX_STARS),
    )


@inner
def predict(stars, scene, C, focal_px, view):
    """Fill `view` with the stars that the attitude C = C_ci puts into the frame; how many."""
    n, nine = 0, t3.matrix(C)
    outside_px = OUTSIDE_PX + (scene.border_px - BORDER_PX)
    cell = cell_of(nine[6], nine[7], nine[8])
    for e in range(stars.start[cell], stars.start[cell + 1]):
        s = stars.row[e]
        X, Y, Z = t3.rotated(nine, t3.row(stars.u_i, s))
        if Z <= 0.1:
            continue
        x, y = scene.cx_px + focal_px * X / Z, scene.cy_px + focal_px * Y / Z
        if x < -outside_px or y < -outside_px or n == MAX_STARS:
            continue
        if x > scene.width_px - 1.0 + outside_px or y > scene.height_px - 1.0 + outside_px:
            continue
        view.row[n], view.xy_px[n, 0], view.xy_px[n, 1] = s, x, y
        n += 1
    return n


@inner
def match(scene, view, n, gate_px, noise_px):
    """Likeliest detection within the gate of each star, each detection to its nearest star; matches.

    The likeliest is the one of highest density at the star's place for centroid errors of noise_px:
    a small ellipse a little further off may be likelier than a large one.
    """
    n_det, ellipses = scene.xy_px.shape[0], scene.ellipses
    taken, matches, gate2, of_area = view.taken, 0, gate_px * gate_px, 2.0 * noise_px * noise_px
    taken[:n_det] = -1
    for s in range(n):
        view.det[s], view.distance2[s], least = -1, gate2, np.inf
        x, y = view.xy_px[s, 0], view.xy_px[s, 1]
        for k in range(n_det):
            d2 = weighted2(ellipses, k, scene.xy_px[k, 0] - x, scene.xy_px[k, 1] - y)
            if d2 < gate2 and d2 + of_area * log_area(ellipses, k) < least:
                view.det[s], view.distance2[s], least = k, d2, d2 + of_area * log_area(ellipses, k)
        matches += _take(view, taken, s)
    return matches


@inner
def match_first(scene, ellipses, view, n, gate_px, lever, noise_px):
    """As `match`, for an attitude that is only as good as the pair of detections it comes from.

    Distances from ellipses are weighted with the covariance of place and prediction together.
    """
    if ellipses is None:
        return match(scene, view, n, gate_px, noise_px)
    n_det, taken, matches = scene.xy_px.shape[0], view.taken, 0
    taken[:n_det] = -1
    for s in range(n):
        view.det[s], view.distance2[s], least = -1, 0.0, np.inf
        x, y = view.xy_px[s, 0], view.xy_px[s, 1]
        reach = reach_of(ellipses, lever, x, y)
        for k in range(n_det):
            dx, dy = scene.xy_px[k, 0] - x, scene.xy_px[k, 1] - y
            if abs(dx) > REACH_PX or abs(dy) > REACH_PX:
                continue
            q, det = gate_of(ellipses, lever, reach, k, dx, dy)
            if q < 1.0 and STAR_GATE**2 * q + np.log(det) < least:
                least = STAR_GATE**2 * q + np.log(det)
                view.det[s], view.distance2[s] = k, q * lever.gate2
        matches += _take(view, taken, s)
    return matches


@inner
def _take(view, taken, s):
    """Give star s its detection unless a nearer star has it; by how much the number of matches grows."""
    k = view.det[s]
    if k < 0:
        return 0
    rival = taken[k]
    if rival >= 0 and view.distance2[rival] <= view.distance2[s]:
        view.det[s] = -1
        return 0
    if rival >= 0:
        view.det[rival] = -1
    taken[k] = s
    return 0 if rival >= 0 else 1


@inner
def jacobian(x, y):
    """d(X/Z, Y/Z)/d(phi, ln f) for a small turn phi of the stars about the camera axes: 8 numbers.

    The stars turn against the camera: phi = -dtheta_c of `turn_slopes`.
    """
    dx, dy = turn_slopes(x, y)
    return -dx[0], -dx[1], -dx[2], -dy[0], -dy[1], -dy[2], x, y


@inner
def slopes(scene, xy_px, k, focal_px):
    """X/Z and Y/Z of place k of some, (n, 2) px."""
    return (xy_px[k, 0] - scene.cx_px) / focal_px, (xy_px[k, 1] - scene.cy_px) / focal_px


@inner
def information(scene, view, n, focal_px, noise_px, N, g):
    """Normal equations of the matched stars, in pixels, for a free focal length: N (4, 4), right side g (4,).

    Stars far from their detection, against the noise, weigh little. Written: the lower triangle of N, and g.
    """
    N[:], g[:] = 0.0, 0.0
    for s in range(n):
        k = view.det[s]
        if k < 0:
            continue
        x, y = slopes(scene, view.xy_px, s, focal_px)
        a, b, c, d, e, f, p, q = jacobian(x, y)
        columns = (a, d), (b, e), (c, f), (p, q)
        one = focal_px / (1.0 + view.distance2[s] / (9.0 * noise_px * noise_px))
        rx, ry = apart(scene.xy_px, k, view.xy_px, s)
        rx, ry = weigh(scene.ellipses, k, one * rx, one * ry)
        two = one * focal_px
        for j in range(4):
            ux, uy = columns[j]
            wx, wy = weigh(scene.ellipses, k, two * ux, two * uy)
            g[j] += ux * rx + uy * ry
            for i in range(j, 4):
                N[i, j] += columns[i][0] * wx + columns[i][1] * wy


@inner
def cholesky(N, n_par):
    """Lower factor L of N = L L' in place; ln det N, or -inf when it is singular."""
    log_det = 0.0
    for a in range(n_par):
        for b in range(a + 1):
            value = N[a, b]
            for c in range(b):
                value -= N[a, c] * N[b, c]
            if a > b:
                N[a, b] = value / N[b, b]
            elif value <= 1e-9 * N[a, a]:
                return -np.inf
            else:
                N[a, a] = np.sqrt(value)
                log_det += np.log(value)
    return log_det


@inner
def solve_cholesky(L, g, n_par):
    """Solution of L L' x = g in place of g."""
    for a in range(n_par):
        for c in range(a):
            g[a] -= L[a, c] * g[c]
        g[a] /= L[a, a]
    for a in range(n_par - 1, -1, -1):
        for c in range(a + 1, n_par):
            g[a] -= L[c, a] * g[c]
        g[a] /= L[a, a]


@inner
def turn(C, phi):
    """exp(skew(phi)) C in place, for a small phi; the rows are made orthonormal again."""
    for c in range(3):
        x, y, z = C[0, c], C[1, c], C[2, c]
        C[0, c] = x + phi[1] * z - phi[2] * y
        # the second row follows from the other two, below
        C[2, c] = z + phi[0] * y - phi[1] * x
    norm = np.sqrt(C[2, 0] ** 2 + C[2, 1] ** 2 + C[2, 2] ** 2)
    for c in range(3):
        C[2, c] /= norm
    along = C[0, 0] * C[2, 0] + C[0, 1] * C[2, 1] + C[0, 2] * C[2, 2]
    for c in range(3):
        C[0, c] -= along * C[2, c]
    norm = np.sqrt(C[0, 0] ** 2 + C[0, 1] ** 2 + C[0, 2] ** 2)
    for c in range(3):
        C[0, c] /= norm
    for c in range(3):
        p, q = (c + 1) % 3, (c + 2) % 3
        C[1, c] = C[2, p] * C[0, q] - C[2, q] * C[0, p]


@inner
def sort(values, m):
    """Sort the first m of a few values, in place."""
    for k in range(1, m):
        j, value = k, values[k]
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value


@inner
def median(values, m):
    """Median of the first m of a few values, which are sorted in place."""
    sort(values, m)
    return 0.5 * (values[(m - 1) // 2] + values[m // 2])


@inner
def gather_distances(view, n):
    """Write the squared distances of the matches among n stars to view.spare; how many there are."""
    m = 0
    for s in range(n):
        if view.det[s] >= 0:
            view.spare[m] = view.distance2[s]
            m += 1
    return m


@inner
def noise_seen(scene, view, n):
    """Noise of the centroids from the median distance of the matches, within what is thought possible."""
    m = gather_distances(view, n)
    seen = np.sqrt(median(view.spare, m) / 1.386) if m > 0 else 0.0  # 2 ln 2: median of chi^2_2
    return min(max(seen, scene.centroid_error), NOISE_SCALES[-1] * scene.centroid_error)


@inner
def _all_within(view, n, gate_px):
    """Whether no match is further than the gate."""
    for s in range(n):
        if view.det[s] >= 0 and view.distance2[s] > gate_px * gate_px:
            return False
    return True


@inner
def after_first(scene, ellipses, gate_px):
    """Gate of the second step of `adjust`: the first one, with ellipses, was no multiple of the error."""
    wide_px = WIDE_GATE * scene.centroid_error
    return min(gate_px, wide_px) if ellipses is None else wide_px


@inner
def adjust(stars, scene, trial, view, gate_px, lever, min_stars):
    """Turn trial.C until the predicted stars fit their detections, from a wide gate to the noise. -> Fit

    The first gate is gate_px; where the detections have ellipses, what the lever says. A field that does not
    hold min_stars is no fit.
    """
    C, focal_px, n_par = trial
    noise_px = NOISE_SCALES[-1] * scene.centroid_error
    L, g, log_det, n = np.zeros((4, 4)), np.empty(4), -np.inf, 0
    for step in range(4):
        n = predict(stars, scene, C, focal_px, view)
        if step == 0:
            matches = match_first(scene, scene.ellipses, view, n, gate_px, lever, noise_px)
        else:
            matches = match(scene, view, n, gate_px, noise_px)
        if matches < min_stars:
            return Fit(C, focal_px, n_par, 0, L, log_det, noise_px)
        if step > 0:
            noise_px = noise_seen(scene, view, n)
        information(scene, view, n, focal_px, noise_px, L, g)
        log_det = cholesky(L, n_par)
        if log_det == -np.inf:
            return Fit(C, focal_px, n_par, 0, L, log_det, noise_px)
        if step == 3:
            break
        solve_cholesky(L, g, n_par)
        turn(C, g)
        growth = g[3] if n_par == 4 else 0.0
        focal_px *= 1.0 + growth
        moved_px = focal_px * max(abs(g[0]), abs(g[1]), abs(g[2]), abs(growth))
        if step > 0 and moved_px < SETTLED * noise_px and _all_within(view, n, GATE * noise_px):
            break
        gate_px = after_first(scene, scene.ellipses, gate_px) if step == 0 else GATE * noise_px
    return Fit(C, focal_px, n_par, n, L, log_det, noise_px)
