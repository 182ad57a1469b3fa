"""Do the axes of the IMU's file point to where the scenario says? By what it senses of gravity and thrust.

The specific force against that of the truth, over the whole and at rest; without truth, what points up at
rest against a vehicle that climbs: it stands nose up.
"""

from itertools import permutations, product

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.geometry import euler, wgs84
from shefex_nav.replay import dataset, series
from shefex_nav.scenario.data_table import DataError

FIELD = "data.axes"
STILL = 0.5  # m/s
LEAD_S = 0.5  # [E] before the first motion that a receiver tells
SECOND_S, MOST_SECONDS = 1.0, 100
MOST_TURN = np.radians(10.0)  # within a second
STEEP = np.cos(np.radians(45.0))  # of the angle to up
TILTED, TILT_SLACK = np.radians(20.0), np.radians(5.0)  # [E]
CLIMBS = 20.0  # m/s
SIDES = ("forward", "right", "down")
OPPOSITE = {"forward": "backward", "right": "left", "down": "up"}


def check(scenario, data, fixes):
    """(field, text) to warn of, a list; DataError where the specific force points elsewhere than the declared
    axes have it. ReplayScenario, Dataset, its fixes that are valid
    """
    if not fixes:
        return []
    g = float(np.linalg.norm(gravity.normal_gravity_e(fixes[0].r_ea_e)))
    slack = 5.0 * np.sqrt(3.0) * scenario.imu.accelerometer.bias / g + TILT_SLACK
    if data.truth is not None:
        return _against_truth(data, scenario.data.axes, g, slack)
    return _against_climb(data, scenario.data.axes, fixes, g, slack)


def _against_truth(data, axes, g, slack):
    """The specific force against that of the truth, second by second: its acceleration less gravity.

    At rest it is looked at once more: thrust along an axis hides that the others point elsewhere.
    """
    begin_s, end_s = max(data.imu.t_s[0], data.truth.t_s[0]), min(data.imu.t_s[-1], data.truth.t_s[-1])
    parts = {
        "median": _specific_forces(data, g, begin_s, end_s),
        "at rest, median": _specific_forces(data, g, begin_s, min(rest_end_of_truth(data.truth), end_s)),
    }
    parts = {name: forces for name, forces in parts.items() if len(forces[0])}
    tilts = {name: _tilt(*forces) for name, forces in parts.items()}
    name = next((name for name, tilt in tilts.items() if tilt > slack), None)
    if name is None:
        return []
    fitting = [one for one in _right_handed() if _fit(parts.values(), axes, one, slack)]
    fits = " or ".join(f"[{', '.join(one)}]" for one in fitting) or "no other axes"
    words = (
        f"in axes [{', '.join(axes)}] the specific force points {np.degrees(tilts[name]):.0f} deg from where "
        f"the truth has it ({name} of {len(parts[name][0])} s); it fits in {fits}"
    )
    if tilts[name] > max(TILTED, slack) and (name == "median" or fitting):
        raise DataError(f"{FIELD}: {words}: check these and the angles of the truth")
    return [(FIELD, words)]


def _fit(parts, axes, others, slack):
    """Whether other axes than those that are told fit in all parts, of (sensed, true) specific forces."""
    return all(
        _tilt(dataset.body_axes(dataset.file_axes(sensed_b, axes), others), true_b) <= slack
        for sensed_b, true_b in parts
    )


def rest_end_of_truth(truth):
    """Until when the truth has the vehicle stand still, s; -inf if it moves from the first row on."""
    moving = np.flatnonzero(np.linalg.norm(truth.v_e, axis=1) > STILL)
    last = len(truth.t_s) - 1 if not len(moving) else int(moving[0]) - 1
    return float(truth.t_s[last]) if last >= 0 else -np.inf


def _tilt(a, b):
    """Median of the angles between vectors (n, 3)."""
    cosine = np.sum(a * b, axis=1) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _right_handed():
    """The 24 ways in which axes of a file can point forward, right and down."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            if np.linalg.det(np.diag(signs) @ np.eye(3)[list(order)]) > 0.0:
                yield tuple(f"{'-' if s < 0.0 else ''}{'xyz'[k]}" for k, s in zip(order, signs, strict=True))


def _specific_forces(data, g, begin_s, end_s):
    """Means over seconds as the IMU sensed them and as the truth has them: (k, 3), (k, 3) m/s^2, body axes.

    Seconds in which the vehicle turns, or falls freely, are left out.
    """
    imu, truth = data.imu, data.truth
    n = int(np.clip((end_s - begin_s) / SECOND_S, 0, MOST_SECONDS))
    gained, sensed_b, true_b = np.cumsum(imu.dv_b, axis=0), [], []
    for first_s in np.linspace(begin_s, end_s - SECOND_S, n):
        ends_s = np.array([first_s, first_s + SECOND_S])
        sensed = np.diff(series.between(ends_s, imu.t_s, gained), axis=0)[0] / SECOND_S
        rows = np.clip(np.searchsorted(truth.t_s, [*ends_s, ends_s.mean()]), 0, len(truth.t_s) - 1)
        C_first, C_last, C_nb = (euler.dcm_from_euler(*truth.angles[k]) for k in rows)
        v_e = series.between(ends_s, truth.t_s, truth.v_e)
        C_en = wgs84.level_axes(truth.r_e[rows[2]])
        coriolis_e = 2.0 * np.cross([0.0, 0.0, wgs84.OMEGA], v_e.mean(axis=0))
        true = C_nb.T @ (C_en.T @ (np.diff(v_e, axis=0)[0] / SECOND_S + coriolis_e) - [0.0, 0.0, g])
        steady = np.trace(C_first.T @ C_last) > 1.0 + 2.0 * np.cos(MOST_TURN)
        if steady and min(np.linalg.norm(sensed), np.linalg.norm(true)) > 0.5 * g:
            sensed_b.append(sensed)
            true_b.append(true)
    return np.array(sensed_b).reshape(-1, 3), np.array(true_b).reshape(-1, 3)


def _against_climb(data, axes, fixes, g, slack):
    """What points up at rest against a vehicle that climbs afterwards."""
    end_s = rest_end(fixes)
    imu, rows = data.imu, np.flatnonzero(data.imu.t_s <= end_s)[1:]
    span_s = imu.t_s[rows[-1]] - imu.t_s[0] if len(rows) else 0.0
    if span_s < SECOND_S:
        return []
    f_b = imu.dv_b[rows].sum(axis=0) / span_s
    if abs(np.linalg.norm(f_b) - g) > slack * g:
        return []  # not at rest, or wrong by a unit: `align` refuses that
    up_b = f_b / np.linalg.norm(f_b)
    climb = next((fix for fix in fixes if np.linalg.norm(fix.v_ea_e) > CLIMBS), None)
    if climb is None or _upward(climb) < STEEP or up_b[0] > STEEP:
        return []
    words = f"at rest the file's axis {of_file(up_b, axes)} points up, which data.axes calls {_side(up_b)}"
    return [(FIELD, f"{words}; then the vehicle climbs: one that stands nose up has forward there")]


def rest_end(fixes):
    """Until when the vehicle stands still, s; -inf if nothing says that it does."""
    if not np.isfinite(fixes[0].v_ea_e).all():
        return -np.inf
    t_s = np.array([fix.t_valid_s for fix in fixes])
    speed = np.array([np.linalg.norm(fix.v_ea_e) for fix in fixes])
    moving = np.flatnonzero(speed > still_speed(fixes))
    last = len(t_s) - 1 if not len(moving) else int(moving[0]) - 1
    return float(t_s[last]) - LEAD_S if last >= 0 else -np.inf


def still_speed(fixes):
    """m/s, up to which fixes are of a vehicle that stands still."""
    return STILL + 3.0 * float(np.sqrt(np.mean([np.trace(fix.R_v_e) for fix in fixes])))


def _upward(fix):
    """Cosine of the angle between the velocity of a fix and up."""
    return float(-wgs84.level_axes(fix.r_ea_e)[:, 2] @ fix.v_ea_e / np.linalg.norm(fix.v_ea_e))


def _side(u_b):
    """The side of the body that is nearest to a direction, such as 'forward' or 'left'."""
    k = int(np.argmax(np.abs(u_b)))
    return SIDES[k] if u_b[k] > 0.0 else OPPOSITE[SIDES[k]]


def of_file(u_b, axes):
    """The axis of the file that is nearest to a direction in body axes, such as '-y'."""
    k = int(np.argmax(np.abs(u_b)))
    sign = u_b[k] * (-1.0 if axes[k][0] == "-" else 1.0)
    return axes[k][-1] if sign > 0.0 else f"-{axes[k][-1]}"
