"""A scenario with a trajectory to its Flight: read once, flown again and again."""

from functools import lru_cache

import numpy as np

from shefex_nav.clock import IMU_HZ, SAME_S, TICK_HZ
from shefex_nav.geometry import frames, wgs84
from shefex_nav.scenario import surroundings
from shefex_nav.scenario.data_table import DataError
from shefex_nav.trajectory import along, plausible, reading
from shefex_nav.trajectory.ccsds import Epoch
from shefex_nav.world.flight import given, track
from shefex_nav.world.flight.params import Air


def fly(scenario, earth):
    """Flight of a Scenario with a trajectory; DataError where its file cannot be flown."""
    return _flown(_Same(scenario), _Numbers(earth))[0]


def oddities(scenario, earth):
    """list of plausible.Oddity of the file of a Scenario with a trajectory."""
    return _flown(_Same(scenario), _Numbers(earth))[1]


def begins_at(trajectory, earth):
    """Latitude and longitude below the first sample of a Trajectory, rad."""
    r_e, _ = frames.ecef_from_inertial(earth, trajectory.t_s[0], trajectory.r_i[0], trajectory.v_i[0])
    return wgs84.geodetic_from_ecef(r_e)[:2]


class _Same:
    """A scenario, equal to another of the same flight."""

    def __init__(self, scenario):
        self.scenario = scenario
        mission, atmosphere = scenario.mission, scenario.atmosphere
        self._key = repr((scenario.trajectory, mission.epoch, mission.start, mission.time_limit, atmosphere,
                          scenario.earth, len(scenario.imu.vibration.boost), scenario.plugins))  # fmt: skip

    def __hash__(self):
        return hash(self._key)

    def __eq__(self, other):
        return self._key == other._key


class _Numbers(_Same):
    """EarthRotation, likewise."""

    def __init__(self, earth):
        self.earth = earth
        self._key = b"".join(np.asarray(one).tobytes() for one in earth)


@lru_cache(maxsize=2)
def _flown(same, numbers):
    """Flight, and list of Oddity."""
    scenario, earth = same.scenario, numbers.earth
    section = scenario.trajectory
    rows = reading.rows(section, earth, Epoch(scenario.mission.epoch, scenario.earth.ut1_minus_utc))
    plausible.refuse(rows, earth)
    of_rows = rows.t_s, rows.r_i, rows.v_i, rows.a_i, rows.rounding_m, rows.rounding_m_s
    curve = track.Track(*of_rows, plausible.at_rest(rows, earth))
    turning, last_s = _turning(section, rows, curve, earth)
    span = _span(scenario, rows, last_s, earth)
    motion = track.Given(curve, turning, earth, rows.t_s[0])
    place = curve.at(rows.t_s[:1])[0][0]
    r_e = frames.dcm_ie(earth, float(rows.t_s[0])).T @ place
    air = surroundings.air(scenario, wgs84.geodetic_from_ecef(r_e)[:2])
    params = given.GivenParams(
        *span, float(IMU_HZ), surroundings.gravity(scenario), Air(air, scenario.atmosphere.density),
        len(scenario.imu.vibration.boost), tuple(section.separations), rows.known,
    )  # fmt: skip
    flown = given.fly(motion, params, earth)
    return flown, plausible.found(rows, flown, earth)


def _turning(section, rows, curve, earth):
    """track.Turning, and the time [s] until which it and the positions are known."""
    attitudes = rows.attitudes
    if attitudes is None:
        t_s, q_ib = along.velocity((rows.t_s, curve), earth, section.attitude.roll_rate)
        return track.Turning(t_s, q_ib, 0.0), rows.t_s[-1]
    plausible.refuse_turns(attitudes)
    first_s = attitudes.t_s[0]
    if first_s > rows.t_s[0] + SAME_S:
        words = f"begins at T{first_s:+.3f} s, after the positions, which begin at T{rows.t_s[0]:+.3f} s"
        raise DataError(f"{attitudes.table.file}: {words}")
    turning = track.Turning(attitudes.t_s, attitudes.q_ib, attitudes.rounding)
    return turning, min(rows.t_s[-1], attitudes.t_s[-1])


def _span(scenario, rows, last_s, earth):
    """First and last mission time [s] of the flight."""
    mission, section, first_s = scenario.mission, scenario.trajectory, float(rows.t_s[0])
    if mission.start < first_s - section.pad - SAME_S:
        words = f"its first row is at T{first_s:+.3f} s, and mission.start is {mission.start:g} s"
        say = f"pad: {first_s - mission.start:g} s lets it stand there before that"
        raise DataError(f"{rows.table.file}: {words}; {say}, or let the mission start later")
    if mission.start > last_s - 1.0:
        words = f"it ends at T{last_s:+.3f} s, within a second of mission.start, {mission.start:g} s"
        raise DataError(f"{rows.table.file}: {words}; is lift_off or the epoch right?")
    if mission.start < first_s - SAME_S:
        plausible.refuse_moving(rows, earth)
    if rows.known is not None:  # a log ends with a tick, the flight in it with its impact
        impact_s = rows.known.instants.get("impact", -np.inf)
        last_s = impact_s if last_s < impact_s < last_s + 1.0 / TICK_HZ else last_s
    return float(mission.start), float(min(mission.time_limit, last_s))
