"""Figures of one run: the object that `run --json` and `report --json` print.

Every figure is computed from the records of the run and its truth; one that does not apply is None.

Definitions
-----------
- Errors are truth minus estimate; position and velocity errors are norms in inertial axes, attitude errors
  rotation vectors in body axes (navigation) or camera axes (star tracker; z is the boresight).
- A star fix is wrong if it is given as good and more than 0.5 deg off, in the window or out of it.
- The window is where the true rate is at most 2 deg/s and the true exclusion angles are met. A tick of the
  camera without a frame counts in it if both neighbours do.
- `no_fix` counts why frames of the window gave none, `no_fix_outside` the others.
- `by_rate` counts the frames whose exclusion angles are met, in the window or too fast for it, by the true
  rate; its scatter and its NEES are those of the fixes (with their own covariance) less the run's mean error,
  which is that of the principal point and of a lens that is told otherwise; what the mean of n fixes takes of
  their squares is given back, n / (n - 1). The truth of a fix is the
  attitude at the instant of its frame, not the mean of the exposure.
- Errors of star fixes are in the camera's own axes and have no part of its mounting: `mounting_error_deg` is
  the rotation from the nominal to the true mounting, which an attitude of the body has.
- `cross_axis_rms` is per axis, over x and y; `max` is of the whole rotation angle.
- `outside` counts the frames out of the window: too near to the Sun, else to the Earth's limb, else faster
  than 2 deg/s, whatever `star_tracker.highest_rate` is.
- `full_table_share` is of all frames in which objects were found: those with `most_objects` of them.
- The star phase is from the first frame in the window to the last, whatever software flies.
- `star_aided` has the errors from the second star fix to the end: an attitude begins with two that agree.
- `solution_share` is the part of the ticks of truth at which there is a solution; the errors are over these.
- NEES: position, velocity and attitude at whole seconds since the start of the run, from the first star fix
  that the filter accepts to entry, or to the end of a run without one. Software that tells of no gates begins
  where its solution is star aided. Software of a user's own that never uses a star fix, as far as it says,
  begins at the start of the run; `why` says so, and why there is no figure. Where no covariance is of a whole
  second, the first in each second counts. `times_sigma` is the root of the same per degree of freedom, of
  position, velocity and attitude each.
- `beyond_sigma` lists where an error was far beyond its sigma (`error_figures`). `measurements` are of GPS
  and star tracker, `nis` of every sensor with gate results (`sensor_use`, `innovations`). `unknown` and
  `errors_fit` are of software of a user's own alone (`sensor_use`, `likely_mistakes`).
- Entry is the first descent through 100 km. Speed is relative to the Earth, range along the ellipsoid from
  the start to the impact; without an impact there is none. Without truth, or with one of a part of the
  solution's time alone (`truth_s`), the flight is that of the solution (`of`). The greatest height is an
  apogee only if the data go on beyond it; `climbs_at_km` if they do not.
- `simulated_s` is the time from the first sample of truth or solution, at `simulated_from_s`, to the last.
- `warnings` are of the scenario against the flight (`programme`); None where no scenario can be read.
- `requirements` are those of the scenario, judged by this object; none where no scenario can be read.
- Attitude control: the pointing error is the true attitude against the wanted one, the whole angle, or that
  of the roll axis alone while the spin is left alone; in the phases POINTING.
"""

import math

import numpy as np

from shefex_nav.onboard.navigation.quantity import about
from shefex_nav.report import (
    error_figures,
    flight,
    innovations,
    likely_mistakes,
    local_level,
    programme,
    requirements,
    sensor_use,
    star_metrics,
    trust,
)
from shefex_nav.report.configured import of_run
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.report.pairing import pointing_error, whole_time
from shefex_nav.report.track import earth_fixed
from shefex_nav.scenario import lens, told
from shefex_nav.scenario.document import dotted

ENTRY_HEIGHT = 100e3  # m


def summarise(data, *, log=None, from_s=None, scenario=None):
    """The summary object of a RunData: plain dict of numbers, texts and None, ready for JSON.

    `log` is the path that the object names. A replay of external data, or whoever names a mission time
    `from_s`, gets the errors in local level axes from then on as well (`local_level`). `scenario` is that of
    the run, where it is at hand; otherwise the one in the log is read.
    """
    truth, known = data.truth, of_run(data, scenario)
    track = earth_fixed(data.mission.earth, truth)
    entry = entry_index(track.height)
    whole_s = whole_time(data)
    simulated_s = None if whole_s is None else whole_s[1] - whole_s[0]
    wall_s = data.summary.wall_s if data.summary else None
    result = {
        "scenario": data.mission.scenario,
        "seed": data.mission.seed,
        "version": data.mission.version,
        "software": {
            section: f"{name}, sha256 {hash_[:12]}" if hash_ else name
            for section, name, hash_ in data.mission.software
        },
        "log": None if log is None else str(log),
        "ended_early": data.ended_early,
        "failure": data.failure or None,
        "until_s": data.until_s,
        "simulated_s": simulated_s,
        "simulated_from_s": None if whole_s is None else whole_s[0],
        "wall_s": wall_s,
        "setup_s": data.summary.setup_s if data.summary else None,
        "real_time_factor": simulated_s / wall_s if simulated_s and wall_s else None,
        "flight": flight.of(data, track, entry),
        "attitude_control": _attitude_control(data),
        "star_tracker": star_metrics.summarise(data, known),
        "navigation": _navigation(data, track.height, entry, known),
        "told_otherwise": _told_otherwise(known.scenario),
        "warnings": _warnings(data, known.scenario),
    }
    if from_s is not None or local_level.is_replay(data):
        result["navigation"] |= local_level.summarise(data, from_s)
    result = _without_nan(result)
    judged = () if known.requirements is None else requirements.judge(known.requirements, result)
    is_part = result["ended_early"] or result["until_s"] is not None
    return result | {"requirements": requirements.objects(judged, is_part)}


def _warnings(data, scenario):
    """What the scenario gets wrong of the flight: list of field and text."""
    if scenario is None:
        return None
    found = programme.warnings(scenario, programme.of_data(data))
    return [{"field": dotted(one.field), "text": one.text} for one in found]


def _told_otherwise(scenario):
    """What the computer on board takes the sensors for and is not true: list of field and text."""
    if scenario is None:
        return None
    found = [*told.words(scenario), lens.words(scenario.star_camera, told.as_told(scenario).star_camera)]
    return [{"field": dotted(one[0]), "text": one[1]} for one in found if one is not None]


def entry_index(height):
    """Index of the first sample at or below 100 km after having been above it, or None."""
    above = np.flatnonzero(height > ENTRY_HEIGHT)
    if not len(above):
        return None
    below = np.flatnonzero(height[above[0] :] <= ENTRY_HEIGHT)
    return int(above[0] + below[0]) if len(below) else None


def _attitude_control(data):
    """Gas used and pointing error; None without attitude control."""
    control = data.control
    if not len(control.t_s):
        return None
    error_deg = np.degrees(pointing_error(control, data.truth))
    return {
        "propellant_kg": float(control.propellant_kg[-1]),
        "pointing_error_deg": error_figures.of_sizes(error_deg),
    }


def _navigation(data, height, entry, known):
    errors = navigation_errors(data)
    position, velocity, attitude_deg = map(error_figures.of_sizes, error_figures.sizes(errors))
    ticks, entry_s = len(data.truth.t_s), None if entry is None else float(data.truth.t_s[entry])
    return {
        "solution_share": len(errors.t_s) / ticks if ticks else None,
        "position_error_m": position,
        "velocity_error_m_s": velocity,
        "attitude_error_deg": attitude_deg,
        "star_phase": error_figures.star_phase(data, errors),
        "star_aided": error_figures.star_aided(data, errors),
        "while_pointing": error_figures.while_pointing(data.truth, errors),
        "at_entry": None if entry is None else error_figures.at_entry(data, errors, entry_s, height[entry]),
        "nees": error_figures.nees_summary(data, errors, math.inf if entry is None else entry_s),
        "beyond_sigma": [one._asdict() for one in error_figures.beyond_sigma(data, errors)],
        **_of_own_software(data, errors, known),
        **({"measurements": sensor_use.measurements(data)} if sensor_use.flew(data) else {}),
        "instruments": instrument_use(data.gates),
        "nis": innovations.summarise(data.gates, text=data.mission.scenario_text),
        "integrity": trust.trust(data, entry_s, known),
    }


def _of_own_software(data, errors, known):
    """What is looked at where software of a user's own navigates."""
    if not sensor_use.is_own(data):
        return {}
    fits = {"errors_fit": [one._asdict() for one in likely_mistakes.found(data, errors, known.scenario)]}
    return fits | ({"unknown": sensor_use.unknown(data)} if sensor_use.flew(data) else {})


def _without_nan(value):
    """The same with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


# ----------------------------------------------------------------------------------------------------------
# How many readings of the instruments beside IMU, GPS and stars reached the filter's gate, and were used.


def instrument_use(gates):
    """Sequence of GateResult -> {name of an instrument: {"readings": at the gate, "used": of these}}"""
    found = {}
    for gate in gates:
        if gate.dof and about(gate.sensor) is None:
            counts = found.setdefault(gate.sensor, {"readings": 0, "used": 0})
            counts["readings"] += 1
            counts["used"] += bool(gate.accepted)
    return dict(sorted(found.items()))
