"""Mistakes of logic in software of a user's own that its errors look like, where the truth is in the log.

Each is a fit of the errors with one parameter at most, in windows of some seconds. It is told where it
explains nearly all of an error that is far larger than the software believes, in windows that follow each
other and agree in the parameter:

- the solution in another convention: attitude conjugated, with the scalar last, of the camera, of the
  Earth-fixed axes; position in Earth-fixed axes or kilometres; velocity relative to the Earth,
- the solution of an earlier or later instant: position error along the velocity, attitude error along the
  rate. In inertial axes a vehicle on the pad moves with 500 m/s at most: an instant shows at once,
- turns that are not those of the IMU: increments in degrees, one sample of four, the other way round,
- a lever arm of the GPS antenna that was left out, taken twice or the other way round: by the fixes less the
  solution, in which what is wrong with all fixes of some time drops out.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry import frames
from shefex_nav.geometry.rotation import dcms_from_quats, rotvec_between
from shefex_nav.report import error_figures
from shefex_nav.report.lever_arm import of_gps
from shefex_nav.report.pairing import at_rows, same_times, stretches

EXPLAINS, EXPLAINS_ALONE = 0.95, 0.98  # share of the squares; of what has nothing that changes to go by
SUSPECT = 3.0  # times its sigmas, that an error is in a window
WINDOW_S, LEAST_S, FEWEST = 10.0, 0.5, 3  # width of a window at most and at least; windows that agree
AGREE = 0.2  # share by which parameters of windows that agree may differ
CHANGES = 1.5  # times, by which a velocity or a rate changes if a shift can be told from a constant error
STEP_S = 0.1  # of the errors that are looked at
LARGE = {"attitude": np.radians(10.0), "position": 1e4, "velocity": 50.0}  # of another convention
SHORTEST_S, LONGEST_S = 1e-3, 10.0  # a shift of time
TURN_RAD, FEWEST_TURNS, OTHER = 0.03, 50, 0.05  # of a tick; ticks; by which a factor differs from 1
TURNS = (  # factor, what it means
    (180.0 / np.pi, "increments, which are in radians, are multiplied by 180/pi"),
    (np.pi / 180.0, "increments, which are in radians, are multiplied by pi/180"),
    (0.25, "one of the four samples of a tick is used"),
    (-1.0, "the attitude is turned the other way round"),
    (2.0, "increments are used twice"),
    (0.5, "increments are halved"),
    (0.01, "increments, which are angles, are multiplied by the time of a tick"),
)


class Fit(NamedTuple):
    """What the errors of a time fit."""

    what: str
    from_s: float
    until_s: float
    explained: float  # share of the squares


class _Looked(NamedTuple):
    """Errors at K times, and what they may be made of."""

    t_s: np.ndarray  # (K,)
    errors: dict  # quantity: (K, 3)
    truth: object  # of arrays over K
    nav: object  # of arrays over K
    ratio: dict  # quantity: (K,) error over its sigma, infinite where the software does not say
    windows: list  # of (first, end)


def found(data, errors, scenario=None):
    """Fits of a RunData of software of a user's own: list, empty where nothing fits.

    errors : navigation_errors.NavErrors;  scenario : Scenario of the run; None where it cannot be read
    """
    if len(errors.t_s) < FEWEST:
        return []
    looked = _looked(data, errors)
    if not looked.windows:
        return []
    fits = [*_conventions(data, looked), *_turns(data), *_shifts(looked)]
    wrong = any((one > SUSPECT).any() for one in looked.ratio.values())
    if wrong and not any("position" in one.what for one in fits):
        fits += [Fit(*one) for one in of_gps(data, scenario)]
    return fits


def _looked(data, errors):
    """_Looked of a run, thinned out."""
    i, j = same_times(data.truth.t_s, data.nav.t_s)
    step = max(1, round(STEP_S / max(float(np.median(np.diff(errors.t_s))), SAME_S)))
    i, j, t_s = i[::step], j[::step], errors.t_s[::step]
    vectors = errors.position_i, errors.velocity_i, errors.attitude_b
    known_s, ratio = error_figures.ratios(data, errors)
    nearest = np.searchsorted(known_s, t_s).clip(0, max(len(known_s) - 1, 0))
    ratios = {}
    for name, one in ratio.items():
        value = one[nearest] if len(one) else np.full(len(t_s), np.inf)
        ratios[name] = np.where(np.isfinite(value), value, np.inf)
    width_s = float(np.clip((t_s[-1] - t_s[0]) / FEWEST, LEAST_S, WINDOW_S))
    edges = np.searchsorted(t_s, np.arange(t_s[0], t_s[-1], width_s))
    windows = [(a, b) for a, b in zip(edges, [*edges[1:], len(t_s)], strict=True) if b - a >= FEWEST]
    quantities = dict(zip(error_figures.BLOCKS, (one[::step] for one in vectors), strict=True))
    return _Looked(t_s, quantities, at_rows(data.truth, i), at_rows(data.nav, j), ratios, windows)


# ----------------------------------------------------------------------------------------------------------
# Another convention.


def _conventions(data, looked):
    """Fits of solutions in another convention, one of each quantity at most."""
    for quantity, meant in _meant(data, looked).items():
        squares = (looked.errors[quantity] ** 2).sum(axis=1)
        best = None
        for words, left in meant:
            rows = _longest([_explained(squares[a:b], left[a:b]) for a, b in looked.windows], looked)
            least = LARGE[quantity] ** 2
            if rows is None or squares[rows].mean() < least or (best and _length(best) >= _length(rows)):
                continue
            rows = _to_its_ends(rows, left < (1.0 - EXPLAINS) * squares)
            share = _explained(squares[rows], left[rows])
            span = float(looked.t_s[rows.start]), float(looked.t_s[rows.stop - 1])
            best = Fit(f"{words} (explains {_percent(share)} of the {quantity} error)", *span, share)
        if best:
            yield best


def _length(span):
    """Of a Fit in seconds, or of a slice in about as many."""
    return span.until_s - span.from_s if isinstance(span, Fit) else (span.stop - span.start) * STEP_S


def _longest(shares, looked):
    """Rows of the longest run of two windows and more that are explained: slice; None without any."""
    runs = [one for one in stretches(np.array(shares) > EXPLAINS) if one[1] - one[0] >= 2]
    if not runs:
        return None
    first, end = max(runs, key=lambda one: one[1] - one[0])
    return slice(looked.windows[first][0], looked.windows[end - 1][1])


def _to_its_ends(rows, fits):
    """The same rows with those before and behind that fit too: windows do not begin where a mistake does."""
    first, end = rows.start, rows.stop
    while first > 0 and fits[first - 1]:
        first -= 1
    while end < len(fits) and fits[end]:
        end += 1
    return slice(first, end)


def _meant(data, looked):
    """{quantity: list of (words, squares (K,) of what is left of the error)}."""
    truth, nav = looked.truth, looked.nav
    C_ei = np.swapaxes(frames.dcms_ie(data.mission.earth, looked.t_s), 1, 2)
    moved = np.roll(truth.q_ib, -1, axis=1)  # as [x, y, z, w]
    C_ib = dcms_from_quats(truth.q_ib)
    attitudes = {
        "q_ib the other way round (its conjugate)": np.swapaxes(C_ib, 1, 2),
        "q_ib with the scalar last; it is [w, x, y, z]": dcms_from_quats(moved),
        "q_ib in Earth-fixed axes (q_eb)": C_ei @ C_ib,
        "q_ib of the star camera (q_ic)": C_ib @ data.mission.C_bc,
    }
    given = dcms_from_quats(nav.q_ib)
    turns = [(words, _angle(given, C) ** 2) for words, C in attitudes.items()]
    r_e = np.einsum("kij,kj->ki", C_ei, truth.r_i)
    against = truth.v_i - np.cross(frames.omega_ie_i(data.mission.earth), truth.r_i)
    velocities = {
        "v_i relative to the Earth": against,
        "v_i relative to the Earth, in its axes": np.einsum("kij,kj->ki", C_ei, against),
    }
    places = {"r_i in Earth-fixed axes; it is in inertial ones": r_e, "r_i in kilometres": 1e-3 * truth.r_i}
    return {
        "attitude": turns,
        "position": [(words, ((nav.r_i - one) ** 2).sum(axis=1)) for words, one in places.items()],
        "velocity": [(words, ((nav.v_i - one) ** 2).sum(axis=1)) for words, one in velocities.items()],
    }


def _angle(A, B):
    """Angles between matrices (K, 3, 3): (K,)."""
    return np.arccos(np.clip(0.5 * (np.einsum("kij,kij->k", A, B) - 1.0), -1.0, 1.0))


# ----------------------------------------------------------------------------------------------------------
# Another instant.


def _shifts(looked):
    """Fits of solutions of an earlier or later instant: one of both, or of position or attitude alone."""
    motions = {"position": looked.truth.v_i, "attitude": looked.truth.omega_ib_b}
    fits = {name: _shift(looked, name, motion) for name, motion in motions.items()}
    position, attitude = fits["position"], fits["attitude"]
    if position and attitude and abs(position[0] - attitude[0]) < AGREE * abs(position[0]):
        also = f" and {_percent(attitude[1].explained)} of the attitude error"
        fits = {"position": (position[0], position[1]._replace(what=f"{position[1].what}{also}"))}
    for one in fits.values():
        if one:
            yield one[1]._replace(what=f"{one[1].what})")


def _shift(looked, quantity, motion):
    """(shift [s], Fit) of one quantity, motion (K, 3); None where nothing fits."""
    error = looked.errors[quantity]
    fits = [_scaled(motion[a:b], error[a:b]) for a, b in looked.windows]
    suspect = [bool(np.median(looked.ratio[quantity][a:b]) > SUSPECT) for a, b in looked.windows]
    shifts, shares = np.array(fits).T
    good = (shares > EXPLAINS) & np.array(suspect) & (np.abs(shifts) < LONGEST_S)
    run = _agreeing(shifts, good & (np.abs(shifts) > SHORTEST_S))
    if run is None:
        return None
    rows = slice(looked.windows[run[0]][0], looked.windows[run[1] - 1][1])
    shift_s, share = _scaled(motion[rows], error[rows])
    size = np.linalg.norm(motion[rows], axis=1)
    changes = size.max() > CHANGES * size.min()
    if share < (EXPLAINS if changes else EXPLAINS_ALONE) or (quantity == "attitude" and not changes):
        return None
    age = "old" if shift_s > 0.0 else "ahead"
    explains = f"(explains {_percent(share)} of the {quantity} error"
    what = f"a solution that is {abs(shift_s):.3f} s {age} {explains}"
    return shift_s, Fit(what, float(looked.t_s[rows.start]), float(looked.t_s[rows.stop - 1]), share)


def _agreeing(values, good):
    """(first, end) of the longest run of FEWEST and more good windows whose values agree; None without any"""
    best = None
    for first in np.flatnonzero(good).tolist():
        end = first + 1
        while end < len(good) and good[end] and abs(values[end] / values[first] - 1.0) < AGREE:
            end += 1
        if end - first >= FEWEST and (best is None or end - first > best[1] - best[0]):
            best = first, end
    return best


# ----------------------------------------------------------------------------------------------------------
# Turns that are not those of the IMU.


def _turns(data):
    """Fit of the turn of the attitude from tick to tick against that of the IMU, while it is small."""
    i, j = same_times(data.imu.t_valid_s, data.nav.t_s)
    if len(j) < FEWEST_TURNS:
        return
    t_s, dtheta_b = data.nav.t_s[j], data.imu.dtheta_b[i].sum(axis=1)[1:]
    turned = rotvec_between(data.nav.q_ib[j][:-1], data.nav.q_ib[j][1:])
    one_tick = (np.diff(j) == 1) & data.imu.valid[i][1:]
    chosen = one_tick & (np.linalg.norm(dtheta_b, axis=1) < TURN_RAD)
    if np.count_nonzero(chosen) < FEWEST_TURNS:
        return
    chosen &= np.linalg.norm(turned, axis=1) < 2.0 * np.median(np.linalg.norm(turned[chosen], axis=1)) + 1.0
    factor, share = _scaled(dtheta_b[chosen], turned[chosen])
    if share < EXPLAINS or abs(factor - 1.0) < OTHER:
        return
    meant = [words for one, words in TURNS if abs(factor / one - 1.0) < OTHER]
    why = f": {meant[0]}" if meant else ""
    what = f"an attitude that turns {factor:.3g} times as fast as the IMU says{why}"
    span = t_s[1:][chosen]
    told = f"{what} (explains {_percent(share)} of its turns)"
    yield Fit(told, float(span[0]), float(span[-1]), share)


# ----------------------------------------------------------------------------------------------------------


def _scaled(x, y):
    """k of y = k x by least squares, and the share of the squares that it explains. (m, 3), (m, 3)"""
    xx, yy = float((x * x).sum()), float((y * y).sum())
    if not (xx > 0.0 and yy > 0.0):
        return 0.0, 0.0
    k = float((x * y).sum()) / xx
    return k, 1.0 - float(((y - k * x) ** 2).sum()) / yy


def _explained(squares, left):
    """Share of squared errors (m,) that is not left."""
    total = float(squares.sum())
    return 1.0 - float(left.sum()) / total if total > 0.0 else 0.0


def _percent(share):
    return f"{100.0 * share:.1f} %" if share < 0.9995 else "over 99.9 %"
