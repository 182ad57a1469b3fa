"""Are the gyros in the unit that the scenario says? By the motion, where it turns.

Between two fixes the specific force is known twice: by the GNSS velocities, in axes of the Earth, and by the
accelerometers, which the gyros turn into axes that do not turn. Over some seconds one rotation must take one
to the other (Wahba's problem, solved by the singular value decomposition). With gyros in a wrong unit none
does, as soon as the direction of the force changes or the vehicle turns under it; with the right unit one
does. Where the vehicle never turns nothing is said. At rest the bias hides the Earth's
rate, so that only readings that are far too large are noticed there (`align`).

A bias or noise of the gyros can make a unit fit that turns them off. So another unit must also fit better
than gyros that say nothing; what they say at rest is taken off.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.geometry import wgs84
from shefex_nav.replay import clocks, imu_axes
from shefex_nav.scenario.data_table import DataError

WINDOW_S = 30.0  # [E] in which the drift of a gyro worth a filter is small
PAIR_S = 0.45  # [E] shortest time between two fixes that are compared
FEWEST = 4  # [E] pairs in a window
FORCE_NOISE = 0.05  # [E] m/s^2, error of a mean force: latency, vibration, the turn of the Earth
FORCE_SHARE = 0.005  # [E] of the force: scale factors
FITS = 4.0  # [E] squared differences over their noise, per degree of freedom, up to which a unit fits
BETTER = 5.0  # [E] times by which it must fit better than the one that is told, and than no gyros
APART = 20.0  # [E] least ratio of two units: less may be a bias
DEGREE = np.pi / 180.0
RATES = {"rad/s": 1.0, "deg/s": DEGREE, "mrad/s": 1e-3, "mdeg/s": 1e-3 * DEGREE, "deg/h": DEGREE / 3600.0}
ANGLES = {"rad": 1.0, "deg": DEGREE, "mrad": 1e-3, "urad": 1e-6, "arcsec": DEGREE / 3600.0}


class Fit(NamedTuple):
    """A unit that fits, where the one that is told does not."""

    name: str
    misfit: float  # per degree of freedom
    told_misfit: float


def check(scenario, data):
    """DataError if the gyros fit the motion in another unit only. ReplayScenario, Dataset"""
    columns = scenario.data.imu
    unit = getattr(columns, "gyro_unit", None)
    kind = "increment" if scenario.data.format == "kf_gins" else "rate"
    units, told = (RATES if kind == "rate" else ANGLES), 1.0
    if unit is not None:
        units, told = (RATES if unit.kind == "rate" else ANGLES), unit.factor
    found = find(
        data.imu, data.fixes, np.array(scenario.gnss.lever_arm), {k: v / told for k, v in units.items()}
    )
    if found is None:
        return
    name = next((name for name, size in units.items() if abs(size / told - 1.0) < 1e-9), "their unit")
    field = "data.imu" if unit is None else "data.imu.gyro_unit"
    raise DataError(
        f"{field}: the gyros, taken as {name}, do not turn as GNSS velocities and accelerometers show "
        f"(squared differences {found.told_misfit:.3g} times their noise); as {found.name} they do "
        f"({found.misfit:.2g})"
    )


def find(imu, fixes, arm_b, ratios):
    """Fit of a unit that the motion shows; None where the one that is told fits, or nothing is shown.

    imu : Increments;  fixes : GpsFix;  arm_b : (3,) m;  ratios : {unit: its size over the one that is told}
    """
    fixes = [fix for fix in fixes if fix.valid and np.isfinite(fix.v_ea_e[0])]
    windows = _windows(fixes, imu.t_s)
    if not windows:
        return None
    imu = _without_bias(imu, imu_axes.rest_end(fixes))
    told = _misfit(imu, arm_b, windows, 1.0)
    if told <= FITS:
        return None
    others = {name: ratio for name, ratio in ratios.items() if not 1.0 / APART < ratio < APART}
    least, name = min((_misfit(imu, arm_b, windows, ratio), name) for name, ratio in others.items())
    if least > FITS or BETTER * least > min(told, _misfit(imu, arm_b, windows, 0.0)):
        return None
    return Fit(name, least, told)


def _without_bias(imu, rest_end_s):
    """Increments less what the gyros say at rest, where there is a rest of some length."""
    rows = np.flatnonzero(imu.t_s <= rest_end_s)
    if not len(rows) or imu.t_s[rows[-1]] - imu.t_s[0] < imu_axes.SECOND_S:
        return imu
    bias = imu.dtheta_b[rows[1:]].sum(axis=0) / (imu.t_s[rows[-1]] - imu.t_s[0])
    return imu._replace(dtheta_b=imu.dtheta_b - np.outer(np.diff(imu.t_s, prepend=imu.t_s[0]), bias))


def _windows(fixes, t_s):
    """[(times (n, 2) s, forces (n, 3) m/s^2 in frame e, sigmas (n,))] of the fixes within the IMU's data."""
    fixes = [fix for fix in fixes if t_s[0] <= fix.t_valid_s <= t_s[-1]]
    pairs, last = [], None
    for fix in fixes:
        span_s = np.inf if last is None else fix.t_valid_s - last.t_valid_s
        if PAIR_S <= span_s <= clocks.LONGEST_S:
            pairs.append((last, fix))
        if span_s >= PAIR_S:
            last = fix
    of_window = {}
    for pair in pairs:
        of_window.setdefault(int((pair[0].t_valid_s - t_s[0]) / WINDOW_S), []).append(pair)
    return [_forces(window) for window in of_window.values() if len(window) >= FEWEST]


def _forces(pairs):
    """Specific forces by GNSS, as of `_windows`."""
    times_s = np.array([[one.t_valid_s for one in pair] for pair in pairs])
    forces, sigmas = [], []
    for (earlier, later), span_s in zip(pairs, np.diff(times_s)[:, 0], strict=True):
        coriolis = 2.0 * np.cross([0.0, 0.0, wgs84.OMEGA], 0.5 * (earlier.v_ea_e + later.v_ea_e))
        f = (later.v_ea_e - earlier.v_ea_e) / span_s + coriolis - gravity.normal_gravity_e(later.r_ea_e)
        noise = np.sqrt(np.trace(earlier.R_v_e + later.R_v_e) / 3.0) / span_s
        forces.append(f)
        sigmas.append(np.linalg.norm([noise, FORCE_NOISE, FORCE_SHARE * np.linalg.norm(f)]))
    return times_s, np.array(forces), np.array(sigmas)


def _misfit(imu, arm_b, windows, ratio):
    """Squared differences over their noise per degree of freedom, of gyros `ratio` times as large."""
    seen = clocks.Seen(imu._replace(dtheta_b=ratio * imu.dtheta_b), arm_b)
    total = freedom = 0.0
    for times_s, forces, sigmas in windows:
        gained = seen.at(times_s[:, 1], seen.gained) - seen.at(times_s[:, 0], seen.gained)
        felt = gained / np.diff(times_s) / sigmas[:, None]
        said = forces / sigmas[:, None]
        U, size, Vt = np.linalg.svd(said.T @ felt)
        size[2] *= np.linalg.det(U) * np.linalg.det(Vt)  # rotations only, no mirror
        total += max(np.sum(said**2) + np.sum(felt**2) - 2.0 * np.sum(size), 0.0)
        freedom += 3.0 * len(said) - 3.0
    return total / freedom
