"""Are accelerometers and gyros in the units that the scenario says?

Accelerometers, by the size of what they sense at rest. A vehicle that stands still feels gravity, whatever
its axes are. Its size is the median of means over seconds: noise is gone from them, and one bump does not
count. Where nothing says that the vehicle stands still, nothing is said: free fall and flights from the first
row on have no rest.

Gyros, by the motion, where it turns. Between two fixes the specific force is known twice: by the GNSS
velocities, in axes of the Earth, and by the accelerometers, which the gyros turn into axes that do not turn.
Over some seconds one rotation must take one to the other (Wahba's problem, solved by the singular value
decomposition). With gyros in a wrong unit none does, as soon as the direction of the force changes or the
vehicle turns under it; with the right unit one does. Where the vehicle never turns nothing is said. At rest
the bias hides the Earth's rate, so that only readings that are far too large are noticed there (`align`). A
bias or noise of the gyros can make a unit fit that turns them off. So another unit must also fit better than
gyros that say nothing; what they say at rest is taken off.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gravity
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
FEWEST_S = 3  # [E] seconds at rest
MOST_TURN = np.radians(30.0)  # within a second, by which a mean of the force loses 1 %
MARGIN = 0.1  # [E] of gravity: above any calibration of a sensor that navigates, below any two units' ratio
NOTHING = 0.02  # [E] of gravity: up to there, and what the sensors may err, gravity is not sensed
SIGMAS = 5.0
MOVED_M = 50.0  # [E] by which the place of a vehicle at rest may seem to move, and sigmas
LONGEST_GAP_S = 5.0  # [E] in what says that it stands still
UNSTEADY = 0.1  # [E] of the larger of both forces, by which the seconds of a vehicle at rest may differ
GEE = 9.80665
ACCELERATIONS = {"m/s2": 1.0, "gee": GEE, "mgee": 1e-3 * GEE, "ft/s2": 0.3048, "cm/s2": 0.01, "mm/s2": 1e-3}
INCREMENTS = {"m/s": 1.0, "gee s": GEE, "mgee s": 1e-3 * GEE, "ft/s": 0.3048, "cm/s": 0.01, "mm/s": 1e-3}
ENOUGH_NAMES = 3


class Rest(NamedTuple):
    """A time in which the vehicle stands still."""

    begin_s: float
    end_s: float
    who: str  # says so
    change: float  # m/s, of the velocity that it may hide
    r_e: np.ndarray  # (3,) m, where it stands


def accelerometers(scenario, data):
    """(field, text) to warn of, a list; DataError if another unit fits. ReplayScenario, Dataset"""
    rest = at_rest(scenario, data)
    if rest is None:
        return []
    felt, spread = _felt(data.imu, rest)
    g = float(np.linalg.norm(gravity.normal_gravity_e(rest.r_e)))
    if not np.isfinite(felt) or spread > UNSTEADY * max(felt, g):
        return []
    sheet, span_s = scenario.imu.accelerometer, rest.end_s - rest.begin_s
    of_sensor = SIGMAS * np.sqrt(3.0) * np.hypot(sheet.bias, sheet.scale_factor * g)
    next_to_nothing = of_sensor + NOTHING * g + rest.change / span_s
    slack = next_to_nothing + (MARGIN - NOTHING) * g
    if abs(felt - g) <= slack:
        return []
    field, told, others = _readings(scenario, float(np.median(np.diff(data.imu.t_s))))
    words = (
        f"at rest, {rest.begin_s:.1f} s to {rest.end_s:.1f} s by {rest.who}, the accelerometers, taken as "
        f"{told}, sense {felt:.4g} m/s2; gravity there is {g:.4g} m/s2"
    )
    off = {name: abs(felt * ratio - g) for name, ratio in others.items()}
    fitting = sorted((name for name, gap in off.items() if gap <= slack), key=off.get)[:ENOUGH_NAMES]
    if felt <= next_to_nothing:
        fitting += ["accelerations without gravity: the navigation needs the specific force, which has it"]
    if fitting:
        raise DataError(f"{field}: {words}; they fit as {' or '.join(fitting)}")
    hint = "no other unit explains that: check unit and scale of the file, and what says that it stands still"
    return [(field, f"{words}; {hint}")]


def at_rest(scenario, data):
    """Rest at the begin of a Dataset by its truth, by GNSS velocities or by the alignment; None if none says
    so, or no place is known."""
    fixes, imu_s = [fix for fix in data.fixes if fix.valid], data.imu.t_s
    settings, truth, rest = scenario.alignment, data.truth, None
    if truth is not None:
        end_s = min(imu_axes.rest_end_of_truth(truth), _leaves(truth.t_s, truth.r_e, 0.0))
        rest = Rest(float(truth.t_s[0]), end_s, "the truth", 2.0 * imu_axes.STILL, truth.r_e[0])
    elif fixes and np.isfinite(fixes[0].v_ea_e).all():
        t_s, r_e = (np.array([getattr(fix, name) for fix in fixes]) for name in ("t_valid_s", "r_ea_e"))
        sigma = float(np.sqrt(np.mean([np.trace(fix.R_r_e) for fix in fixes])))
        end_s = min(imu_axes.rest_end(fixes), _leaves(t_s, r_e, sigma))
        change = 2.0 * imu_axes.still_speed(fixes)
        rest = Rest(float(t_s[0]), end_s, "the velocities of GNSS", change, r_e[0])
    elif fixes and settings.method in ("static", "rail"):
        begin_s = max(float(scenario.mission.start), float(imu_s[0]))
        rest = Rest(begin_s, begin_s + settings.duration, "alignment.duration", 0.0, fixes[0].r_ea_e)
    if rest is None:
        return None
    rest = rest._replace(begin_s=max(rest.begin_s, float(imu_s[0])), end_s=min(rest.end_s, float(imu_s[-1])))
    return rest if rest.end_s - rest.begin_s >= FEWEST_S * imu_axes.SECOND_S else None


def _leaves(t_s, r_e, sigma):
    """Until when positions say that it stays, s: velocities may be zero because they are not known.

    It ends at a gap, too: a receiver that is lost in flight and found again on the ground saw none of it.
    """
    away = np.linalg.norm(r_e - r_e[0], axis=1) > MOVED_M + SIGMAS * sigma
    gone = away | (np.diff(t_s, prepend=t_s[0]) > LONGEST_GAP_S)
    return float(t_s[int(np.argmax(gone)) - 1]) if gone.any() else np.inf


def _felt(imu, rest):
    """Size of the force felt in a Rest: median of its seconds, and how far their quartiles are apart, m/s^2.

    Seconds in which the vehicle turns are left out; NaN if too few are left.
    """
    n = int((rest.end_s - rest.begin_s) / imu_axes.SECOND_S)
    at_s = rest.begin_s + imu_axes.SECOND_S * np.arange(n + 1)
    forces, turns = (
        np.column_stack([np.diff(np.interp(at_s, imu.t_s, np.cumsum(column))) for column in values.T])
        for values in (imu.dv_b / imu_axes.SECOND_S, imu.dtheta_b)
    )
    sizes = np.linalg.norm(forces, axis=1)[np.linalg.norm(turns, axis=1) < MOST_TURN]
    if len(sizes) < FEWEST_S:
        return np.nan, np.nan
    first, middle, third = np.percentile(sizes, [25.0, 50.0, 75.0])
    return float(middle), float(third - first)


def _unit_named(units, told):
    """Name of the unit that is told. units : {name: size};  told : size"""
    return next((name for name, size in units.items() if abs(size / told - 1.0) < 1e-9), "their unit")


def _readings(scenario, dt_s):
    """Field of the unit, its name, and {words of another reading: its size over that of the one told}.

    dt_s : sample interval, which is left out where rates are told as increments or the other way round
    """
    columns = scenario.data.imu
    unit = getattr(columns, "accelerometer_unit", None)
    if unit is not None:
        field, kind, told = "data.imu.accelerometer_unit", unit.kind, unit.factor
    else:
        kind = "increment" if scenario.data.format == "kf_gins" else "rate"
        field, told = "data.imu", 1.0
    if kind == "rate":
        same, per = ACCELERATIONS, INCREMENTS
        crossed, again, size = "increments of a sample, in", "m/s2 divided by the sample interval", dt_s
    else:
        same, per = INCREMENTS, ACCELERATIONS
        crossed, again, size = "rates, in", "m/s multiplied by the sample interval", 1.0 / dt_s
    name = _unit_named(same, told)
    found = {other: one / told for other, one in same.items() if other != name}
    found |= {f"{crossed} {other} (sample interval {dt_s:.4g} s)": one / size / told
              for other, one in per.items() if other in ("m/s", "gee s", "m/s2", "gee")}  # fmt: skip
    found[f"{again} once more ({dt_s:.4g} s)"] = size / told
    found[f"{next(iter(same))} multiplied by 9.80665 once more"] = 1.0 / GEE / told
    return field, name, found


class Fit(NamedTuple):
    """A unit that fits, where the one that is told does not."""

    name: str
    misfit: float  # per degree of freedom
    told_misfit: float


def gyros(scenario, data):
    """DataError if the gyros fit the motion in another unit only. ReplayScenario, Dataset"""
    columns = scenario.data.imu
    unit = getattr(columns, "gyro_unit", None)
    kind = "increment" if scenario.data.format == "kf_gins" else "rate"
    units, told = (RATES if kind == "rate" else ANGLES), 1.0
    if unit is not None:
        units, told = (RATES if unit.kind == "rate" else ANGLES), unit.factor
    found = find_gyro_unit(
        data.imu, data.fixes, np.array(scenario.gnss.lever_arm), {k: v / told for k, v in units.items()}
    )
    if found is None:
        return
    name = _unit_named(units, told)
    field = "data.imu" if unit is None else "data.imu.gyro_unit"
    raise DataError(
        f"{field}: the gyros, taken as {name}, do not turn as GNSS velocities and accelerometers show "
        f"(squared differences {found.told_misfit:.3g} times their noise); as {found.name} they do "
        f"({found.misfit:.2g})"
    )


def find_gyro_unit(imu, fixes, arm_b, ratios):
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
        f = clocks.force_between(earlier, later, span_s)
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
