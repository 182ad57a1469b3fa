"""Keys that a scenario does not know: what was meant, for the mistakes that people make."""

import time

import pytest
from broken import DEFAULT, messages

from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.load import load

MEANT = {
    # spelling
    "launch.elevaton=80 deg": "did you mean 'elevation'?",
    "launch.azimut=80 deg": "did you mean 'azimuth'?",
    "star_tracker.exposure.longst=1 ms": "did you mean 'longest'?",
    "vehicle.stages.S40M.dry.masss=22 kg": "did you mean 'mass'?",
    "star_tracker.detect={}": "did you mean 'detection'?",
    "programm={}": "did you mean 'programme'?",
    # one and many
    "gps.outage=[]": "did you mean 'outages'?",
    "vehicle.stage={}": "did you mean 'stages'?",
    "imu.gyros={}": "did you mean 'gyro'?",
    "navigation.state=[gyro_scale]": "did you mean 'states'?",
    "requirement={}": "did you mean 'requirements'?",
    # another way to write words
    "star_camera.optics.focalLength=25 mm": "did you mean 'focal_length'?",
    "star_camera.optics.focal-length=25 mm": "did you mean 'focal_length'?",
    "gps.Latency=0.2 s": "did you mean 'latency'?",
    "mission.timelimit=700 s": "did you mean 'time_limit'?",
    "vehicle.coldgas={}": "did you mean 'cold_gas'?",
    # the unit in the key
    "star_camera.optics.focal_length_mm=25":
        "did you mean 'focal_length'? Its unit stands beside the value: 'focal_length: 25 mm'",
    "gps.latency_s=0.2": "Its unit stands beside the value: 'latency: 0.2 s'",
    "imu.gyro.bias_deg_h=1": "'bias: 1 deg/h'",
    "star_tracker.rate_hz=5": "'rate: 5 Hz'",
    # abbreviations and words of others
    "launch.lat=60 deg": "did you mean 'latitude'?",
    "launch.altitude=10 m": "did you mean 'height'?",
    "imu.accel={}": "did you mean 'accelerometer'?",
    "imu.gyro.arw=0.1 deg/sqrt(h)": "did you mean 'random_walk'?",
    "programme.pointing.begin=100 s": "did you mean 'from'?",
    "log.frequency=10 Hz": "did you mean 'rate'?",
    "star_camera.detector.width=1024": "did you mean 'columns'?",
    "star_camera.detector.height=1024": "did you mean 'rows'?",
    "mission.date=2012-01-01T00:00:00Z": "did you mean 'epoch'?",
    "star_tracker.max_rate=2 deg/s": "did you mean 'highest_rate'?",
    "navigation.gate=1e-3": "did you mean 'gate_probability'?",
    # another section
    "star_camera.focal_length=25 mm": "it belongs under star_camera.optics",
    "star_tracker.read_noise=5 electron": "it belongs under star_camera.detector",
    "star_tracker.camera={}": "did you mean star_camera?",
    "gps.lever_arm=[0 m, 0 m, 0 m]": "it belongs under gps.antenna",
    "gps.leverarm=[0 m, 0 m, 0 m]": "did you mean gps.antenna.lever_arm?",
    "detector={}": "it belongs under star_camera",
    "focal_length=25 mm": "it belongs under star_camera.optics",
    "vehicle.stages.S40M.mass=22 kg":
        "it belongs under vehicle.stages.S40M.dry or vehicle.stages.S40M.propellant",
    "vehicle.stages.S40M.thrust=20 kN": "it belongs under vehicle.stages.S40M.motor",
    "atmosphere.f107=100": "it belongs under atmosphere.msis",
    "vehicle.star_tracker={}": "it is a section of its own, at the left margin",
    "star_camera.lens={focal_length: 25 mm}": "did you mean 'optics'?",
    # dispersions name fields by their paths
    "dispersions.launch.elevatoin={normal: 1 deg}": "did you mean 'elevation'?",
    "dispersions.star_camera.focal_length={normal: 1 mm}": "it belongs under star_camera.optics",
}  # fmt: skip


@pytest.mark.parametrize("override", MEANT)
def test_what_was_meant(override):
    said = messages(DEFAULT, [override])
    assert any(MEANT[override] in line for line in said), said


@pytest.mark.parametrize(
    ("override", "known"),
    [
        ("navigation.told.star_camera.rate=5", "mounting, optics"),  # errors of GPS satellites have one, too
        ("navigation.told.star_camera.read_noise=5 electron", "mounting, optics"),  # is the world's alone
        ("log.latency=0.1 s", "rate, frames"),
        ("vehicle.cold_gas.thrist=5 N", "torque, arm, specific_impulse, "),  # not the thrust of a motor
        ("vehicle.payload.thrist=5 N", "mass, "),
        ("imu.gyro.read_noize=1 deg/h", "bias, "),
        ("star_camera.rate=5 Hz", "mounting, optics, detector, "),
    ],
)
def test_a_place_far_away_is_no_hint_if_many_have_such_a_key(override, known):
    (said,) = messages(DEFAULT, [override])
    assert f"unknown key; known here: {known}" in said


def test_nothing_is_guessed_of_a_word_that_is_like_no_other():
    (said,) = messages(DEFAULT, ["star_tracker.colour=red"])
    assert "unknown key; known here: enabled, on, " in said


def test_of_hundreds_of_errors_the_first_fifty_are_told(tmp_path):
    path = tmp_path / "many.yaml"
    path.write_text("extends: night_sky.yaml\n" + "".join(f"k{k}: 1\n" for k in range(60)))
    with pytest.raises(ScenarioError) as caught:
        load(path)
    lines = str(caught.value).splitlines()
    assert len(lines) == 51 and "many.yaml:51:1: k49: unknown key" in lines[-1]
    assert "more errors are told when these are mended" in lines[0]


KEYS = {
    "in one section": lambda n: "".join(f"k{k}: 1\n" for k in range(n)),
    "taken away": lambda n: "".join(f"k{k}: null\n" for k in range(n)),
    "in sections": lambda n: "vehicle: {stages: {" + ", ".join(f"s{k}: {{a: 1}}" for k in range(n)) + "}}\n",
    "of an unknown unit": lambda n: (
        "faults: {gps: [" + ", ".join(f"{{fault: outage, from: {k} x}}" for k in range(n)) + "]}\n"
    ),
}


@pytest.mark.parametrize("kind", KEYS)
def test_the_time_for_many_errors_grows_with_their_number_only(kind, tmp_path):
    """Eight times as many take some eight times as long, not 64 times."""
    took = []
    for count in (250, 2000):
        path = tmp_path / f"{count}.yaml"
        path.write_text("extends: night_sky.yaml\n" + KEYS[kind](count))
        began = time.process_time()
        with pytest.raises(ScenarioError) as caught:
            load(path)
        took.append(time.process_time() - began)
    assert took[1] < 1.0 + 16.0 * took[0] and took[1] < 4.0
    assert len(caught.value.messages) <= 101
