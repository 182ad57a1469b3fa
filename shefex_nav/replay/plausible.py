"""Do the series of a data set fit each other, as the scenario describes them? Before anything is navigated.

- Velocities against the change of the positions between two fixes, or two rows of truth.
- Truth against the positions of the fixes.
- The axes of the IMU (`imu_axes`).
- Times of fixes and IMU: a GNSS whose times are in another unit would be used by nobody (`meeting`).
- A position that a receiver says for a long time while the vehicle moves. The filter notices that fix by fix
  (`onboard.navigation.integrity_gps`); here it is said of the data as a whole (`repeats`).

What disagrees beyond any noise, and what another frame or unit explains, is refused with what would fit. What
is only odd (noise that was stated too small does it, too) is a warning.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import wgs84
from shefex_nav.replay import dataset, imu_axes, series
from shefex_nav.scenario.data_table import DataError

LONG_S = 5.0  # [E] shorter repetitions are common and harmless
SHAKEN = 1.0  # [E] m/s^2, standard deviation of the specific force that a vehicle at rest does not have
FEWEST_FIXES = 5  # valid fixes, of which something can be said
FEW_FIXES = 2  # fixes within the times of the IMU that are next to none
MOST_FIT = 0.5  # [E] of the fixes, that meet the IMU if another unit is right
TIME_UNITS = {**dataset.UNITS, 60.0: "min"}  # factor to seconds: name
LONGEST_PAIR_S = 5.0  # [E] between two fixes whose positions are compared
FEWEST_PAIRS = 3  # [E] in motion
MOVING = 5.0  # bounds, by which a position has to change
MISFIT, SHARE = 6.0, 0.3  # [E] bounds, and share of the way, from which on velocities do not fit positions
ODD, ODD_SHARE = 4.0, 0.1  # [E] likewise, from which on that is odd
FITS, FITS_SHARE = 3.0, 0.15  # [E] up to which they fit
FRAMES = ("ned", "enu", "ecef")
SPEED_UNITS = {"km/h": 3.6, "knots": 1.943844, "ft/s": 3.28084, "cm/s": 100.0, "km/s": 1e-3}  # of 1 m/s
FAR_M, FAR = 1000.0, 50.0  # [E] truth and fixes that are further apart are not of one vehicle; bounds
APART = 10.0  # [E] bounds, from which on that is odd


class Oddity(NamedTuple):
    """Something to warn of."""

    field: str  # of the scenario
    text: str


class _Track(NamedTuple):
    """Positions and velocities with their noise, in the order of time."""

    t_s: np.ndarray  # (n,)
    r_e: np.ndarray  # (n, 3) m
    v_e: np.ndarray  # (n, 3) m/s
    sigma_r: np.ndarray  # (n,) m, of all axes together
    sigma_v: np.ndarray  # (n,) m/s


def check(scenario, data):
    """list of Oddity of a ReplayScenario and its Dataset; DataError where they are impossible."""
    found, files = [], scenario.data
    fixes = [fix for fix in data.fixes if fix.valid]
    if fixes and np.isfinite(fixes[0].v_ea_e).all():
        found += _velocities("gnss", getattr(files, "gnss", None), _of_fixes(fixes))
    if data.truth is not None:
        truth = data.truth
        found += _truth(scenario, truth, fixes)
        small = np.full(len(truth.t_s), 0.01)
        found += _velocities(
            "truth", files.truth, _Track(truth.t_s, truth.r_e, truth.v_e, 10.0 * small, small)
        )
    return found + [Oddity(*one) for one in imu_axes.check(scenario, data, fixes)]


def _of_fixes(fixes):
    columns = [np.array([getattr(fix, name) for fix in fixes]) for name in ("t_valid_s", "r_ea_e", "v_ea_e")]
    sigmas = [np.sqrt([np.trace(getattr(fix, name)) for fix in fixes]) for name in ("R_r_e", "R_v_e")]
    return _Track(*columns, *sigmas)


# velocities


def _velocities(section, columns, track):
    """Whether velocities are the change of positions. 'gnss' or 'truth', their columns if a CSV, _Track"""
    declared = getattr(columns, "velocity_frame", "ned")
    field = f"data.{section}.velocity_frame" if hasattr(columns, "velocity_frame") else f"data.{section}"
    misfit, share, gap = _misfit(track)
    if misfit <= ODD or share <= ODD_SHARE:
        return []
    words = (
        f"the velocities, taken as {declared}, differ from the change of the positions by {gap:.3g} m/s "
        f"({100.0 * share:.0f} % of the way, median)"
    )
    fitting = [
        (*fit[1::-1], said)
        for said, v_e in _otherwise(track, declared)
        if (fit := _misfit(track._replace(v_e=v_e)))[0] < FITS and fit[1] < FITS_SHARE
    ]
    if fitting and misfit > MISFIT and share > SHARE:
        raise DataError(f"{field}: {words}; they fit as {min(fitting)[-1]}")
    hint = f"; they fit better as {min(fitting)[-1]}" if fitting else ""
    return [Oddity(field, f"{words}{hint}")]


def _misfit(track):
    """How far velocities are from the change of positions, over the time in motion: three medians.

    The velocity between two fixes is the mean of both; it may have changed at any instant between them.

    -> misfit in bounds of noise and acceleration, its share of the way, m/s; zeros with too little motion
    """
    dt_s, way, dv = np.diff(track.t_s), np.diff(track.r_e, axis=0), np.diff(track.v_e, axis=0)
    said = 0.5 * (track.v_e[1:] + track.v_e[:-1]) * dt_s[:, None]
    noise = np.sqrt(
        track.sigma_r[1:] ** 2
        + track.sigma_r[:-1] ** 2
        + 0.25 * dt_s**2 * (track.sigma_v[1:] ** 2 + track.sigma_v[:-1] ** 2)
    )
    bound = noise + 0.5 * dt_s * np.linalg.norm(dv, axis=1)
    length = np.maximum(np.linalg.norm(way, axis=1), np.linalg.norm(said, axis=1))
    used = (dt_s <= LONGEST_PAIR_S) & (length > MOVING * noise)
    if np.count_nonzero(used) < FEWEST_PAIRS:
        return 0.0, 0.0, 0.0
    gap = np.linalg.norm(way - said, axis=1)[used]
    return tuple(float(np.median(gap / one[used])) for one in (bound, length, dt_s))


def _otherwise(track, declared):
    """(words, (n, 3) m/s in frame e) of what the same columns would be in other frames and units."""
    C_en = _level_axes(track.r_e)
    v_n = np.einsum("kji,kj->ki", C_en, track.v_e)
    given = {"ned": v_n, "enu": series.ned_or_enu(v_n), "ecef": track.v_e}[declared]

    def turned(v_n):
        return np.einsum("kij,kj->ki", C_en, v_n)

    readings = {
        "ned": turned(given),
        "enu": turned(series.ned_or_enu(given)),
        "ecef": given,
    }
    for frame in FRAMES:
        if frame != declared:
            yield f"'velocity_frame: {frame}'", readings[frame]
    if declared != "ecef":
        yield (
            "velocities with the sign of the third column turned: down in ned, up in enu",
            readings[declared] - 2.0 * turned(np.array([0.0, 0.0, 1.0]) * v_n),
        )
    for unit, of_one in SPEED_UNITS.items():
        yield f"velocities in {unit}: give them in m/s", track.v_e / of_one


def _level_axes(r_e):
    """C_en at positions (n, 3) m: (n, 3, 3)."""
    return np.array([wgs84.level_axes(place) for place in r_e])


# truth


def _truth(scenario, truth, fixes):
    """Whether truth and the positions of the fixes are of one vehicle."""
    inside = [fix for fix in fixes if truth.t_s[0] <= fix.t_valid_s <= truth.t_s[-1]]
    if len(inside) < FEWEST_PAIRS:
        return []
    t_s, r_e = (np.array([getattr(fix, name) for fix in inside]) for name in ("t_valid_s", "r_ea_e"))
    noise = np.sqrt([np.trace(fix.R_r_e) for fix in inside]) + np.linalg.norm(scenario.gnss.lever_arm)
    bent = np.linalg.norm(np.diff(truth.r_e, n=2, axis=0), axis=1)  # what a straight line between rows lacks
    bound = noise + (np.interp(t_s, truth.t_s[1:-1], bent) / 8.0 if len(bent) else 0.0)

    def away(truth_e):
        gap = series.between(t_s, truth.t_s, truth_e) - r_e
        if inside[0].horizontal:
            gap = np.einsum("kji,kj->ki", _level_axes(r_e)[:, :, :2], gap)
        return np.linalg.norm(gap, axis=1)

    gap = away(truth.r_e)
    typical, limit = float(np.median(gap)), float(np.median(bound))
    if typical <= APART * limit:
        return []
    words = f"{truth.table.file}: truth is {_length(typical)} from the positions of the fixes (median)"
    if typical <= max(FAR_M, FAR * limit):
        return [
            Oddity(
                "data.truth.position", f"{words}; heights above the sea on one side, or clocks that differ?"
            )
        ]
    near = max(FAR_M, FAR * limit)
    fitting = [(m, said) for said, other in _read_otherwise(scenario, truth.r_e)
               if (m := float(np.median(away(other)))) < near]  # fmt: skip
    if fitting:
        raise DataError(f"{words}; {min(fitting)[1]}, it is {_length(min(fitting)[0])} from them")
    raise DataError(f"{words}; no other unit explains that: check columns, units and clocks of both files")


def _length(metres):
    return f"{metres:.3g} m" if metres < 1000.0 else f"{metres / 1000.0:,.4g} km".replace(",", " ")


def _read_otherwise(scenario, r_e):
    """(words, (n, 3) m in frame e) of truth with other units; columns that cannot be so are left out."""
    declared = getattr(scenario.data.truth, "position_frame", "geodetic")
    if declared == "ecef":
        yield "if its columns are kilometres", 1e3 * r_e
        yield "if its columns are feet", 0.3048 * r_e
        return
    latitude, longitude, height = np.array([wgs84.geodetic_from_ecef(place) for place in r_e]).T
    turn = np.degrees(1.0)
    readings = {
        "if its angles are radians, not degrees (angle_unit: rad)": (
            latitude * turn,
            longitude * turn,
            height,
        ),
        "if its longitude is radians": (latitude, longitude * turn, height),
        "if latitude and longitude change places": (longitude, latitude, height),
        "if its heights are kilometres": (latitude, longitude, 1e3 * height),
        "if its heights are feet": (latitude, longitude, 0.3048 * height),
        "if its heights are millimetres": (latitude, longitude, 1e-3 * height),
        "if the sign of its longitude is turned": (latitude, -longitude, height),
        "if the sign of its latitude is turned": (-latitude, longitude, height),
    }
    for words, (north, east, up) in readings.items():
        if np.abs(north).max() <= 0.5 * np.pi:
            yield (
                words,
                np.array([wgs84.ecef_from_geodetic(*one) for one in zip(north, east, up, strict=True)]),
            )


def meeting(scenario, data):
    """(field, text) to warn of, a list; DataError if another unit fits. ReplayScenario, Dataset"""
    t_s = np.array([fix.t_valid_s for fix in data.fixes if fix.valid])
    begin_s, end_s = float(data.imu.t_s[0]), float(data.imu.t_s[-1])
    if len(t_s) < FEWEST_FIXES or _within(t_s, begin_s, end_s) >= FEW_FIXES:
        return []
    words = (
        f"{_within(t_s, begin_s, end_s)} of {len(t_s)} valid fixes lie within the times of the IMU, "
        f"{begin_s:.6g} to {end_s:.6g} s; they are from {t_s.min():.6g} to {t_s.max():.6g} s"
    )
    columns = scenario.data.gnss if scenario.data.format == "csv" else None
    told = 1.0 if columns is None else columns.time_unit.factor
    for factor, name in TIME_UNITS.items():
        ratio = factor / told
        if ratio != 1.0 and _within(t_s * ratio, begin_s, end_s) >= max(MOST_FIT * len(t_s), FEW_FIXES):
            field = "data.gnss" if columns is None else "data.gnss.time_unit"
            raise DataError(f"{field}: {words}; they fit as {name}")
    return [("data.gnss", f"{words}. The others are not used: check times and units")]


def _within(t_s, begin_s, end_s):
    return int(((t_s >= begin_s) & (t_s <= end_s)).sum())


def longest_repeat(imu, fixes):
    """First and last time [s] and number of the fixes of the longest repetition in motion; None without one.

    imu : Increments;  fixes : GpsFix
    """
    found, begin = None, 0
    places = [fix.r_ea_e.tolist() if fix.valid else None for fix in fixes]
    said = [k for k, place in enumerate(places) if place is not None]
    for i, k in enumerate(said):
        if places[k] != places[said[begin]]:
            begin = i
        first_s, last_s = fixes[said[begin]].t_valid_s, fixes[k].t_valid_s
        if last_s - first_s > max(LONG_S, found[1] - found[0] if found else 0.0):
            found = first_s, last_s, i - begin + 1
    if found is None:
        return None
    inside = (imu.t_s > found[0]) & (imu.t_s <= found[1])
    dt_s = np.diff(imu.t_s, prepend=imu.t_s[0] - 1.0)[inside, None]
    felt = imu.dv_b[inside] / dt_s
    return found if len(felt) > 1 and np.linalg.norm(felt.std(axis=0)) > SHAKEN else None


def repeats(imu, fixes):
    """(field, text) to warn of."""
    found = longest_repeat(imu, fixes)
    if found is not None:
        first_s, last_s, count = found
        yield (
            "data.gnss",
            f"the position repeats itself to the last digit for {last_s - first_s:.1f} s, from "
            f"T{first_s:+.1f} s to T{last_s:+.1f} s ({count} fixes), while the IMU senses motion; "
            "the filter leaves it out",
        )
    strange = [fix for fix in fixes if fix.n_satellites == dataset.NONSENSE]
    if strange:
        text = f"the number of satellites of {len(strange)} fixes is none that there can be"
        yield "data.gnss.satellites", f"{text}; they count as fixes all the same"
