"""Whether the lever arm of the GPS antenna is in a solution: of the fixes less the solution, how much of it.

A filter follows its fixes: what is wrong with all of them for a while is in the solution too, and drops out
of the difference. What stays is the arm, turned with the vehicle: once where it is taken into account, not at
all where it was left out, since the solution is that of the antenna then.
"""

import numpy as np

from shefex_nav.clock import SAME_S, TICK_HZ
from shefex_nav.geometry import frames, rotation
from shefex_nav.report.pairing import same_times

WINDOW_S, FEWEST_FIXES, FEWEST_WINDOWS = 40.0, 10, 3
NEAR = 5.0  # sigmas of a fix, within which the solution follows it
SIGMAS = 4.0  # by which what is found differs from 1 if it is told
AGREES, SURE = 2.5, 0.25  # sigmas from what is meant; largest sigma
MEANT = (
    (0.0, "left out: the solution is that of the antenna"),
    (2.0, "taken the other way round"),
    (-1.0, "taken twice"),
)


def of_gps(data, scenario):
    """(what, from_s, until_s, explained) where the arm is not in the solution: list of one at most.

    data : RunData;  scenario : Scenario of the run, None where it cannot be read
    """
    gps = getattr(scenario, "gps", None)
    if gps is None:
        return []
    arm_b = np.array(gps.antenna.lever_arm, dtype=float)
    differences = _differences(data, arm_b)
    if not np.linalg.norm(arm_b) or not len(differences):
        return []
    share, sigma = _pooled(differences)
    if not (sigma < SURE and abs(share - 1.0) > SIGMAS * sigma):
        return []
    meant = next((words for one, words in MEANT if abs(share - one) < max(AGREES * sigma, 0.1)), None)
    if meant is None:
        return []
    said = f"{share:.2f} +- {sigma:.2f} of it is in the fixes less the position, where 1 is right"
    what = f"the lever arm of the GPS antenna (gps.antenna.lever_arm) {meant} ({said})"
    t_s = differences[:, 0]
    return [(what, float(t_s[0]), float(t_s[-1]), None)]


def _differences(data, arm_b):
    """(m, 7) time, fix less position of the solution, true arm, in inertial axes, where it follows fixes."""
    i, j = same_times(data.truth.t_s, data.nav.t_s)
    t_s, out = data.nav.t_s[j], []
    for fix in data.gps:
        if not fix.valid or fix.horizontal or not len(t_s):
            continue
        k = int(np.argmin(np.abs(t_s - fix.t_valid_s)))
        after_s = fix.t_valid_s - t_s[k]
        if abs(after_s) > 0.5 / TICK_HZ + SAME_S:
            continue
        r_i, _ = frames.inertial_from_ecef(data.mission.earth, fix.t_valid_s, fix.r_ea_e, np.zeros(3))
        turned = rotation.quat_from_rotvec(data.truth.omega_ib_b[i[k]] * after_s)
        q_ib = rotation.quat_multiply(data.truth.q_ib[i[k]], turned)
        apart_i = r_i - data.nav.r_i[j[k]] - data.nav.v_i[j[k]] * after_s
        if apart_i @ apart_i < NEAR**2 * np.trace(fix.R_r_e):
            out.append([fix.t_valid_s, *apart_i, *rotation.quat_rotate(q_ib, arm_b)])
    return np.array(out).reshape(-1, 7)


def _pooled(differences):
    """How much of the arm there is, and the sigma of that, by what windows find each. (m, 7)"""
    found = []
    window = np.floor(differences[:, 0] / WINDOW_S)
    for one in np.unique(window):
        rows = differences[window == one]
        if len(rows) >= FEWEST_FIXES:
            apart, arm = rows[:, 1:4], rows[:, 4:7]
            squares = (arm**2).sum()
            share = (apart * arm).sum() / squares
            sigma = (apart - share * arm).std() / np.sqrt(squares)
            found.append((share, sigma))
    if len(found) < FEWEST_WINDOWS:
        return np.nan, np.inf
    share, sigma = np.array(found).T
    weight = sigma**-2.0
    mean = (weight * share).sum() / weight.sum()
    excess = (weight * (share - mean) ** 2).sum() / (len(found) - 1)  # of windows that differ more
    return float(mean), float(np.sqrt(max(1.0, excess) / weight.sum()))
