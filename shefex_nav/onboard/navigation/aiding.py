"""Instruments that the filter uses besides GPS and stars.

Such an instrument says what it expects of a reading where the filter believes to be (`Here`), and what the
reading tells of the errors (`aid.Linearised`). The rest is the same for all of them: errors that last longer
than from one reading to the next let one reading pass the gate with all of their variance, and readings that
follow on each other count less together than each by itself (`measurements.lasting_factor`); readings that
contradict the filter by the same amount again and again may be those of a new bias (`aid.Renewal`); those of
an instrument that repeats itself, while what it should say has changed by more than noise, are not used.
"""

from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation.measurements import lasting_factor
from shefex_nav.onboard.navigation.sensor import Sensor, Trial, never
from shefex_nav.onboard.navigation.settings import Release
from shefex_nav.onboard.navigation.state import X_Q, X_R, X_V

SIGMAS = 3.0  # of the noise, within which two readings agree
MOTION = np.r_[X_R, X_V, X_Q]  # where position, velocity and attitude are packed
REPEATED = 10  # [E] readings with the very same values in a row, which white noise does not give
REPEATS = "not used: it repeats itself"


class Here:
    """Where the filter believes the vehicle to be at an instant, and where the errors of its states stand.

    t_s : mission time
    x : packed nominal values (X,)
    r_i, v_i : (3,) m, m/s, of the IMU, inertial axes
    """

    def __init__(self, layout, earth, t_s, x):
        """Layout, EarthRotation, s, packed nominal values (X,)"""
        self._layout, self._earth, self.x = layout, earth, x
        self.t_s, self.r_i, self.v_i = t_s, x[X_R], x[X_V]

    @cached_property
    def C_ib(self):
        """Body axes to inertial axes: (3, 3)."""
        return rotation.dcm_from_quat(self.x[X_Q])

    @cached_property
    def C_ie(self):
        """Earth-fixed axes to inertial axes: (3, 3)."""
        return frames.dcm_ie(self._earth, self.t_s)

    @cached_property
    def _earth_fixed(self):
        return frames.ecef_from_inertial(self._earth, self.t_s, self.r_i, self.v_i)

    @property
    def r_e(self):
        """Position, Earth-fixed axes: (3,) m."""
        return self._earth_fixed[0]

    @property
    def v_e(self):
        """Velocity relative to the Earth, Earth-fixed axes: (3,) m/s."""
        return self._earth_fixed[1]

    @cached_property
    def place(self):
        """Geodetic latitude and longitude [rad], height above the ellipsoid [m]."""
        return wgs84.geodetic_from_ecef(self.r_e)

    @property
    def height(self):
        """Above the ellipsoid, m."""
        return self.place[2]

    @cached_property
    def C_en(self):
        """North, east and down to Earth-fixed axes: (3, 3)."""
        return wgs84.dcm_en(*self.place[:2])

    @cached_property
    def up_i(self):
        """Vertical, inertial axes: (3,) unit vector."""
        return self.C_ie @ -self.C_en[:, 2]

    def rows(self, m):
        """H of m rows, all zero: (m, n)."""
        return np.zeros((m, self._layout.n))

    def columns(self, block):
        """Where the errors of a block stand in H: slice, an empty one if it is not estimated.

        KeyError if there is no such block.

        block : `position` (inertial axes, m), `velocity` (likewise, m/s), `attitude` (rotation from the
            estimate to the truth, body axes, rad), `gyro_bias`, `accel_bias`, or an optional one
        """
        if block not in self._layout.places:
            raise KeyError(f"there is no block '{block}'; there are {', '.join(self._layout.places)}")
        return self._layout.places[block] or slice(0, 0)

    def value(self, block):
        """Estimate of a block that is no position, velocity or attitude: (size,); None: not estimated."""
        return self.x[self._layout.values[block]] if self._layout.places.get(block) else None


class Offset(NamedTuple):
    """A reading against the filter, for the comparison with the next."""

    t_valid_s: float
    z: np.ndarray  # (m,)
    variances: np.ndarray  # (m,) of the noise


class Repeated(NamedTuple):
    """Readings of an instrument, one after the other, whose values are the very same."""

    reading: Any  # the first of them
    t_s: float  # of the tick in which it lies
    motion: np.ndarray  # packed position, velocity and attitude there
    times: int = 1
    is_stuck: bool = False


def sensor(aid):
    """Sensor of an Aid."""
    renewal = aid.renewal
    return Sensor(
        partial(_linearise, aid),
        None if renewal is None else renewal.block,
        np.inf if renewal is None else renewal.forgotten,
        never if renewal is None else partial(_trial, aid),
        reset_note="" if renewal is None else renewal.note,
        counted=partial(_counted, aid),
        unfit=partial(_unfit, aid),
        apart=partial(_apart, aid),
        gate_probability=aid.gate_probability,
    )


def _apart(aid, nav, now, reading):
    """Linearised of a reading, its noise and what lasts apart."""
    return aid.expect(Here(nav.layout, nav.earth, now.t_s, now.x), reading)


def _linearise(aid, nav, now, reading):
    """As `sensor.Linearise`."""
    seen = _apart(aid, nav, now, reading)
    return seen.z, seen.H, seen.R + sum(variance for variance, _ in seen.lasting)


def _counted(aid, nav, reading, R, gap_s):
    """Noise with which a reading that has passed the gate counts. gap_s : since the one used before it"""
    seen = aid.expect(Here(nav.layout, nav.earth, reading.t_valid_s, nav.history.x), reading)
    R = seen.R
    for variance, lasts_s in seen.lasting:
        R = R + variance * lasting_factor(1.0, lasts_s, gap_s)
    return R


def _unfit(aid, nav, t_s, x, reading):
    """As `Sensor.unfit`."""
    if aid.drift and (found := nav.watch.drifts[aid.name].found):
        return found
    here = Here(nav.layout, nav.earth, t_s, x)
    repeats = _repeats(aid, nav, here, reading)
    reason = "" if aid.unfit is None else aid.unfit(here, reading)
    return reason or (REPEATS if repeats else "")


def _repeats(aid, nav, here, reading):
    """Whether an instrument repeats itself although what is expected has changed: it is stuck."""
    run = nav.watch.repeated.get(aid.name)
    if run is None or not all(map(np.array_equal, reading[2:], run.reading[2:])):
        nav.watch.repeated[aid.name] = Repeated(reading, here.t_s, here.x[MOTION].copy())
        return False
    run = run._replace(times=run.times + 1)
    if run.times >= REPEATED and not run.is_stuck:
        x = here.x.copy()  # with the errors of the instrument that are believed now
        x[MOTION] = run.motion
        first = aid.expect(Here(nav.layout, nav.earth, run.t_s, x), run.reading)
        now = aid.expect(here, reading)
        moved = np.abs(now.z - first.z) > SIGMAS * np.sqrt(first.R.diagonal() + now.R.diagonal())
        run = run._replace(is_stuck=bool(moved.any()))
    nav.watch.repeated[aid.name] = run
    return run.is_stuck


def _trial(aid, nav, now, z, R, reading):
    """Readings that are off by the same amount again and again are those of a new bias."""
    seen = aid.expect(Here(nav.layout, nav.earth, now.t_s, now.x), reading)
    rule = Release(rejections=aid.renewal.rejections, duration=aid.renewal.duration_s)
    return Trial(rule, Offset(reading.t_valid_s, z, seen.R.diagonal()), offsets_agree)


def offsets_agree(earlier, later):
    """Whether two rejected readings, Offset each, are off by the same amount."""
    apart = np.abs(later.z - earlier.z)
    alike = apart <= SIGMAS * np.sqrt(earlier.variances + later.variances)
    return bool(later.t_valid_s > earlier.t_valid_s and alike.all())
