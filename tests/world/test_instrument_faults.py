"""Faults of instruments: what each does to the readings, of any record, and what it leaves alone."""

from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
import pytest

from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.instruments import faults
from shefex_nav.instruments.barometer import BAROMETER, Barometer, BarometerReading
from shefex_nav.instruments.instrument import Column, Fault, FaultKind, Instrument, Measured, Sampled
from shefex_nav.instruments.magnetometer import MAGNETOMETER, Magnetometer
from shefex_nav.instruments.sun_sensor import SUN_SENSOR, SunReading
from shefex_nav.scenario.of_settings import section, settings
from shefex_nav.settings import choice, declared
from shefex_nav.world import faults as world_faults
from shefex_nav.world.fault_settings import Faults


class Wind(NamedTuple):
    """A record of a plug-in: several fields, of which two can be wrong by a number."""

    t_valid_s: float
    t_available_s: float
    speed: Annotated[float, Column("m/s", "of the air")]
    direction: Annotated[np.ndarray, Column("", "unit vector", (3,))]
    gusts: Annotated[int, Column("", "counted")]
    angle: Annotated[float, Column("deg", "in a unit that is not SI")]
    valid: Annotated[bool, Column("", "whether it measures")]


class WindSettings(Sampled):
    """Of a wind sensor."""


class Iced(Fault):
    """It reads half."""

    fault: Literal["iced"] = choice()


def halved(fault, reading, last):
    return reading._replace(speed=0.5 * reading.speed)


WIND = Instrument("wind_sensor", WindSettings, Wind, measure=None, faults=(FaultKind(Iced, halved),))
NORTH = np.array([1.0, 0.0, 0.0])
SAID = Measured([Wind(0.1 * k, 0.1 * k + 0.02, float(k), NORTH, k, 1.0, k > 5) for k in range(20)], "drawn")
BARO = settings(
    section(Barometer).model_validate(
        {"rate": "10 Hz", "bias": "0 Pa", "noise": "1 Pa", "quantum": "3 Pa", "lowest": "10 hPa"}
    )
)


def fault(one, kind, start, end, **values):
    (of,) = (each.settings for each in faults.kinds(one) if faults.name_of(each.settings) == kind)
    given = dict.fromkeys(faults.fields_of(of)) if len(faults.fields_of(of)) > 1 else {}
    return of(fault=kind, start=start, end=end, **{**given, **values})


def said(*several, one=WIND, given=None, measured=SAID):
    return faults.applied(one, given, several, measured)


def column(measured, name):
    return np.array([getattr(reading, name) for reading in measured.readings])


def test_kinds_follow_from_the_fields_of_the_record():
    assert [faults.name_of(kind.settings) for kind in faults.kinds(WIND)] == [*faults.GENERAL, "iced"]
    by_name = {faults.name_of(kind.settings): kind.settings for kind in faults.kinds(WIND)}
    assert faults.fields_of(by_name["bias"]) == ("speed", "direction")
    units = {name: declared(by_name[name])["speed"][1].unit for name in ("bias", "drift", "scale")}
    assert units == {"bias": "m/s", "drift": "m/s/s", "scale": ""}
    read = settings(
        section(by_name["drift"]).model_validate(
            {"fault": "drift", "from": "1 s", "until": "2 s", "speed": "36 km/h/s"}
        )
    )
    assert read.speed == pytest.approx(10.0) and read.words == "speed 10 m/s/s"


def test_a_stuck_instrument_repeats_its_last_reading_at_its_own_times():
    stuck = said(fault(WIND, "stuck", 0.95, 1.35))
    np.testing.assert_array_equal(column(stuck, "speed"), [*range(10), 9, 9, 9, 9, *range(14, 20)])
    np.testing.assert_array_equal(column(stuck, "gusts"), column(stuck, "speed"))
    for name in ("t_valid_s", "t_available_s"):
        np.testing.assert_array_equal(column(stuck, name), column(SAID, name))
    assert stuck.errors == "drawn"
    assert said(fault(WIND, "stuck", -1.0, 0.5)).readings == SAID.readings  # there is nothing to repeat


def test_times_of_a_fault_begin_with_it_and_end_before_its_end():
    silent = said(fault(WIND, "silent", 0.5, 1.0))
    np.testing.assert_array_equal(column(silent, "speed"), [*range(5), *range(10, 20)])


def test_a_reading_stamped_after_a_stuck_instrument_is_not_the_one_repeated():
    """Another fault may shift stamps: its readings come before those with earlier stamps."""
    shifted = list(SAID.readings)
    shifted[9] = shifted[9]._replace(t_valid_s=1.9)
    stuck = said(fault(WIND, "stuck", 0.95, 1.35), measured=Measured(shifted, "drawn"))
    np.testing.assert_array_equal(column(stuck, "speed"), [*range(10), 8, 8, 8, 8, *range(14, 20)])


def test_late_readings_keep_their_instants():
    late = said(fault(WIND, "late", 0.5, 1.0, by=0.3))
    more = column(late, "t_available_s") - column(SAID, "t_available_s")
    np.testing.assert_allclose(more, np.repeat([0.0, 0.3, 0.0], [5, 5, 10]), atol=1e-12)
    np.testing.assert_array_equal(column(late, "t_valid_s"), column(SAID, "t_valid_s"))


def test_bias_drift_and_scale_change_the_field_that_is_named():
    wrong = said(
        fault(WIND, "bias", 0.5, 1.0, speed=100.0),
        fault(WIND, "drift", 1.0, 1.5, speed=10.0),
        fault(WIND, "scale", 1.5, 1.7, direction=(0.1, 0.0, -1.0)),
    )
    speed = column(wrong, "speed") - column(SAID, "speed")
    np.testing.assert_allclose(speed, [0] * 5 + [100] * 5 + [0, 1, 2, 3, 4] + [0] * 5, atol=1e-9)
    np.testing.assert_allclose(column(wrong, "direction")[14:18, 0], [1.0, 1.1, 1.1, 1.0])
    assert SAID.readings[15].direction is NORTH and NORTH[0] == 1.0  # the healthy ones are left alone


def test_faults_at_the_same_time_add_up_and_those_of_what_is_sent_come_last():
    both = said(fault(WIND, "stuck", 0.95, 1.2), fault(WIND, "bias", 0.85, 1.3, speed=100.0))
    np.testing.assert_allclose(column(both, "speed")[8:14], [8, 109, 109, 109, 112, 13])


def test_a_kind_of_its_own_is_one_function():
    np.testing.assert_allclose(column(said(fault(WIND, "iced", 0.5, 0.65)), "speed")[4:8], [4, 2.5, 3, 7])


def pressures(sensed):
    sensed = [BarometerReading(0.1 * k, 0.1 * k + 0.02, p) for k, p in enumerate(sensed)]
    return Measured([BAROMETER.limited(BARO, one) for one in sensed], None, sensed)


def test_what_a_barometer_reads_with_a_bias_is_in_whole_quanta_and_within_its_range():
    """And of what it sensed, not what it said: 50000 + 2 Pa is counted as 50001, not 50001 + 2 as 50004."""
    healthy = pressures([50000.0, 50003.1, 1001.0, 119999.0, 200.0])
    np.testing.assert_allclose(column(healthy, "pressure"), [50001, 50004, 1002, 120000, 1000])
    for error, expected in ((2.0, [50001, 50004, 1002, 120000, 1000]), (-900.0, [49101, 49104, 1000])):
        bias = fault(BAROMETER, "bias", -1, 9, pressure=error)
        wrong = said(bias, one=BAROMETER, given=BARO, measured=healthy)
        np.testing.assert_allclose(column(wrong, "pressure")[: len(expected)], expected)
    assert list(column(wrong, "at_limit")) == [False, False, True, False, True]
    wrong = said(
        fault(BAROMETER, "bias", -1, 9, pressure=1300.0), one=BAROMETER, given=BARO, measured=healthy
    )
    assert column(wrong, "pressure")[4] == 1500.0 and not column(wrong, "at_limit")[4]


def test_an_axis_of_a_magnetometer_ends_at_its_range():
    given = settings(
        section(Magnetometer).model_validate({"rate": "10 Hz", "hard_iron": "0 nT", "noise": "1 nT"})
    )
    sensed = [MAGNETOMETER.record(0.1, 0.1, np.array([2e-5, 1e-5, -4e-5]))]
    healthy = Measured([MAGNETOMETER.limited(given, one) for one in sensed], None, sensed)
    wrong = said(
        fault(MAGNETOMETER, "bias", 0, 1, field_b=(1e-6, 0.0, -3e-4)),
        one=MAGNETOMETER, given=given, measured=healthy,
    )  # fmt: skip
    (reading,) = wrong.readings
    np.testing.assert_allclose(reading.field_b, [2.1e-5, 1e-5, -2e-4])
    assert reading.at_limit and not healthy.readings[0].at_limit


def test_a_sun_sensor_with_a_bias_still_gives_a_direction():
    healthy = Measured([SunReading(0.1, 0.1, NORTH, True), SunReading(0.2, 0.2, np.full(3, np.nan), False)])
    bias = fault(SUN_SENSOR, "bias", 0, 1, s_b=(0.0, 0.1, 0.0))
    seen, unseen = said(bias, one=SUN_SENSOR, measured=healthy).readings
    np.testing.assert_allclose(seen.s_b, np.array([1.0, 0.1, 0.0]) / np.sqrt(1.01))
    assert np.isnan(unseen.s_b).all() and not unseen.seen


def test_the_log_has_an_event_at_the_begin_and_at_the_end():
    import synthetic_trajectory

    none = Faults(imu=(), gps=(), star_tracker=())
    several = {"barometer": [fault(BAROMETER, "bias", 2.0, 5.0, pressure=500.0)]}
    events = world_faults.events(
        none, synthetic_trajectory.fly(end_s=10.0), EarthRotation(np.eye(3), np.eye(3), 0.0, 0.0), several
    )
    assert [(event.t_s, event.name, event.detail) for event in events] == [
        (2.0, "fault_barometer_bias", "pressure 500 Pa"),
        (5.0, "fault_barometer_bias_end", ""),
    ]


def test_a_healthy_instrument_says_what_it_says_anyway():
    assert said() is SAID
    other = replace(fault(WIND, "bias", 50.0, 60.0, speed=1.0), end=61.0)
    assert all(a is b for a, b in zip(said(other).readings, SAID.readings, strict=True))


def test_a_stuck_instrument_repeats_what_it_has_measured():
    """Its last reading before the fault has no echo: it holds the one before that."""
    readings = list(SAID.readings)
    nothing = {"speed": np.nan, "direction": np.full(3, np.nan), "angle": np.nan}
    readings[9] = readings[9]._replace(**nothing)
    stuck = faults.applied(WIND, None, (fault(WIND, "stuck", 0.95, 1.35),), Measured(readings))
    assert [one.speed for one in stuck.readings[10:14]] == [8.0] * 4
    readings[8] = readings[8]._replace(angle=np.nan)  # a field that is never there is no lost echo
    stuck = faults.applied(WIND, None, (fault(WIND, "stuck", 0.95, 1.35),), Measured(readings))
    assert [one.speed for one in stuck.readings[10:14]] == [8.0] * 4
