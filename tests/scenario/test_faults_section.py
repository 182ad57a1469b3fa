"""Section `faults`: what is read, and what is said about nonsense."""

import pickle

import numpy as np
import pytest
from broken import DEFAULT, TEXT, check_one_message

from shefex_nav.scenario import aboard
from shefex_nav.scenario.load import load, load_text
from shefex_nav.scenario.of_settings import settings
from shefex_nav.world.fault_settings import Faults

GOOD = """
faults:
  imu:
    - {fault: stuck, sensor: gyro, axis: y, from: 300 s, until: 310 s}
    - {fault: dead, sensor: accelerometer, axis: x, from: 10 s, until: 20 s}
    - {fault: dropout, from: 320 s, until: 320.05 s}
    - {fault: gyro_bias, axis: x, rate: 0.1 deg/s, from: 30 s, until: 40 s}
    - {fault: gyro_scale, axis: x, factor: -2 %, from: 30 s, until: 40 s}
    - {fault: accelerometer_bias, axis: z, acceleration: -5 mgee, from: 30 s, until: 40 s}
    - {fault: accelerometer_scale, axis: y, factor: 300 ppm, from: 30 s, until: 40 s}
  gps:
    - {fault: freeze, from: 1 s, until: 60 s}
    - {fault: jump, position: [300 m, 0 m, 0 m], from: 100 s, until: 110 s}
    - {fault: drift, rate: [0 m/s, 2 m/s, 0 m/s], velocity_too: true, from: 120 s, until: 140 s}
    - {fault: delay, by: 0.3 s, time: late, from: 150 s, until: 160 s}
  star_tracker:
    - {fault: wrong_fixes, every: 10, smallest: 0.5 deg, largest: 180 deg, from: 230 s, until: 400 s}
    - {fault: bias, angles: [0.1 deg, 0 deg, 0 deg], from: 300 s, until: 400 s}
"""


def faults(scenario):
    return settings(scenario.faults)


def test_without_the_section_nothing_goes_wrong():
    assert faults(load(DEFAULT)) == Faults(imu=(), gps=(), star_tracker=())


def test_faults_are_read_in_si(tmp_path):
    path = tmp_path / "faulty.yaml"
    path.write_text(TEXT + GOOD, encoding="utf-8")
    wrong = faults(load(path))
    imu, gps, stars = wrong.imu, wrong.gps, wrong.star_tracker
    assert [fault.name for fault in imu] == [
        *("gyro_y_stuck", "accelerometer_x_dead", "dropout", "gyro_x_bias", "gyro_x_scale"),
        *("accelerometer_z_bias", "accelerometer_y_scale"),
    ]
    errors = [imu[3].rate, imu[4].factor, imu[5].acceleration, imu[6].factor]
    assert errors == pytest.approx([np.radians(0.1), -0.02, -5e-3 * 9.80665, 300e-6])
    assert (imu[0].start, imu[0].end) == (300.0, 310.0)
    assert [fault.fault for fault in gps] == ["freeze", "jump", "drift", "delay"]
    assert (gps[3].by, gps[3].time) == (pytest.approx(0.3), "late")
    assert gps[1].position == (300.0, 0.0, 0.0) and gps[2].velocity_too
    assert (stars[0].every, stars[0].smallest) == (10, pytest.approx(np.radians(0.5)))
    assert stars[1].angles == pytest.approx([np.radians(0.1), 0.0, 0.0])


@pytest.mark.parametrize(
    ("good", "bad", "field", "words"),
    [
        ("fault: freeze", "fault: @freze", "faults.gps.0.fault", "did you mean 'freeze'?"),
        ("time: late", "time: @latee", "faults.gps.3.time", "did you mean 'late'?"),
        ("by: 0.3 s", "by: @-0.3 s", "faults.gps.3.by", "must be greater than zero"),
        ("until: 60 s", "until: @0.5 s", "faults.gps.0.until", "0.5 s must be later than from, 1 s"),
        ("sensor: gyro", "sensor: @giro", "faults.imu.0.sensor", "choose from: gyro, accelerometer"),
        (
            "acceleration: -5 mgee",
            "acceleration: @-5 deg/s",
            "faults.imu.5.acceleration",
            "an acceleration",
        ),
        ("factor: -2 %", "factor: @-2 m", "faults.imu.4.factor", "expected a plain ratio"),
        ("axis: y", "axis: @roll", "faults.imu.0.axis", "'roll' is not known; choose from: x, y, z"),
        ("smallest: 0.5 deg", "smallest: @190 deg", "faults.star_tracker.0.smallest", "180 deg"),
        (
            "from: 120 s, until: 140 s",
            "from: @700 s, until: 740 s",
            "faults.gps.2.from",
            "after mission.time_limit",
        ),
    ],
)
def test_nonsense_is_refused_in_one_line(tmp_path, good, bad, field, words):
    check_one_message(tmp_path, good, bad, field, words, text=TEXT + GOOD)


BAROMETER = """
barometer: {rate: 10 Hz, bias: 100 Pa, noise: 5 Pa}
navigation: {states: [gravity, baro_bias, baro_scale]}
"""
INSTRUMENTS = """
faults:
  barometer:
    - {fault: stuck, from: 60 s, until: 90 s}
    - {fault: bias, pressure: -5 hPa, from: 100 s, until: 110 s}
    - {fault: drift, pressure: 60 Pa/min, from: 120 s, until: 130 s}
    - {fault: scale, pressure: 1 %, from: 140 s, until: 150 s}
    - {fault: late, by: 300 ms, from: 160 s, until: 170 s}
    - {fault: silent, from: 180 s, until: 190 s}
"""


def extended(tmp_path, text):
    """Scenario of text beside the default."""
    path = tmp_path / "faulty.yaml"
    path.write_text(f"extends: {DEFAULT}\n{text}", encoding="utf-8")
    return load(path)


def test_faults_of_an_instrument_are_read_in_si_and_go_to_another_process(tmp_path):
    scenario = extended(tmp_path, BAROMETER + INSTRUMENTS)
    wrong = aboard.wrong(scenario)["barometer"]
    assert [fault.name for fault in wrong] == ["stuck", "bias", "drift", "scale", "late", "silent"]
    assert [fault.words for fault in wrong[:4]] == [
        "",
        "pressure -500 Pa",
        "pressure 1 Pa/s",
        "pressure 0.01",
    ]
    assert (wrong[4].by, wrong[5].start, wrong[5].end) == (pytest.approx(0.3), 180.0, 190.0)
    again = pickle.loads(pickle.dumps(scenario))
    assert aboard.wrong(again)["barometer"] == wrong
    assert aboard.wrong(load_text(scenario.source, "log"))["barometer"] == wrong


@pytest.mark.parametrize(
    ("good", "bad", "field", "words"),
    [
        ("barometer:\n    -", "@barometr:\n    -", "faults.barometr", "did you mean 'barometer'?"),
        (
            "faults:",
            "faults:\n  sun_sensor: @[{fault: silent, from: 1 s, until: 2 s}]",
            "faults.sun_sensor",
            "there is none aboard; give section sun_sensor, or leave it out",
        ),
        ("fault: stuck", "fault: @stuk", "faults.barometer.0.fault", "did you mean 'stuck'?"),
        ("{fault: bias, pressure", "{fault: bias, @presure", "faults.barometer.1.presure", "'pressure'?"),
        ("-5 hPa", "@-5 m", "faults.barometer.1.pressure", "is a length, expected a pressure"),
        ("60 Pa/min", "@60 Pa", "faults.barometer.2.pressure", "such as '1 Pa/s'"),
        ("1 %", "@1 Pa", "faults.barometer.3.pressure", "expected a plain ratio"),
        ("300 ms", "@-300 ms", "faults.barometer.4.by", "must be greater than zero"),
        ("until: 190 s", "until: @170 s", "faults.barometer.5.until", "must be later than from, 180 s"),
    ],
)
def test_nonsense_about_an_instrument_is_refused_in_one_line(tmp_path, good, bad, field, words):
    text = f"extends: {DEFAULT}\n{BAROMETER}{INSTRUMENTS}"
    check_one_message(tmp_path, good, bad, field, words, text=text)
