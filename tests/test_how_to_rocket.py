"""The example rocket of the how-to flies, and its messages are those that the mistakes give."""

import re

import pytest
from test_scenarios import ROOT, SCENARIOS, flight_of

from shefex_nav.report import programme
from shefex_nav.scenario import load

HOW_TO = ROOT / "docs" / "describe-your-rocket.md"


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Path of the rocket of the how-to, written as its reader would write it."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "scenarios").symlink_to(SCENARIOS)
    (folder / "my_rocket").mkdir()
    for text in re.findall(r"^```\w*\n(.*?)^```", HOW_TO.read_text(), re.M | re.S):
        named = re.match(r"[#;] (my_rocket/\S+)\n", text)
        if named:
            (folder / named[1]).write_text(text)
    return folder / "my_rocket" / "rocket.yaml"


def test_example_of_the_how_to_flies(example):
    assert {path.name for path in example.parent.iterdir()} == {
        "motor.eng",
        "aero.csv",
        "wind.csv",
        "rocket.yaml",
    }
    flight = flight_of(load.load(example))
    assert flight.height_km("apogee") == pytest.approx(11.0, abs=0.2)
    assert "parachute" in flight.at and "impact" in flight.at


def test_example_of_the_how_to_is_warned_of_nothing(example):
    assert programme.foreseen(load.load(example)) == ()


def of_the_default():
    """Override with the states that the example would have if it named none."""
    return f"navigation.states=[{', '.join(load.load(SCENARIOS / 'shefex2_andoya.yaml').navigation.states)}]"


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "vehicle.parachute.at=40 s",
            "vehicle.parachute.at: 40 s is before the apogee, T+42.9 s: it opens on the way up",
        ),
        (
            of_the_default(),
            "navigation.states: gyro_g_sensitivity and accel_misalignment are missing: "
            "the vehicle hangs on its parachute for 700 s, ",
        ),
    ],
)
def test_warnings_of_the_how_to(example, override, words):
    (warned,) = programme.foreseen(load.load(example, [override]))
    assert f"{'.'.join(warned.field)}: {warned.text}".startswith(words)
    assert f"| `{words}" in HOW_TO.read_text()


MESSAGES = {
    "vehicle.stages.Booster.dry.mass=22": "22 has no unit; write it with one",
    "vehicle.stages.Booster.dry.mas=22 kg": "unknown key; did you mean 'mass'?",
    "vehicle.stages.Booster.propellant.mass=30 kg": (
        "30 kg does not agree within 2 % with 20 kg in the header of the motor file"
    ),
    "vehicle.stages.Booster.motor.specific_impulse=260 s": (
        "260 s does not agree within 2 %: the thrust curve has 45412 N s in vacuum"
    ),
    "vehicle.payload.mass=900 kg": "the vehicle would not lift off",
    "vehicle.stages.Booster.separation={at: 5 s}": "5 s is before the burn-out of its motor, 8 s",
    "vehicle.stages.Booster.separation.at=25 s": "is missing; the payload flies alone",
    "vehicle.stages.Booster.aerodynamics.roll_by_cant=[0, 0]": "there are no fins that it could turn",
    "programme.hold={task: hold, from: 10 s, until: 20 s}": (
        "tasks are flown by a cold-gas system (or write attitude: prescribed)"
    ),
    "gps.outages=[{event: burnout_1, shortest: 1 s, longest: 2 s}]": (
        "'burnout_1' is no event of this flight; did you mean 'burn_out_1'?"
    ),
    "imu.vibration.boost=[5 gee, 5 gee]": "2 values for 1 stage",
}


@pytest.mark.parametrize("override", MESSAGES)
def test_messages_of_the_how_to(example, override):
    """Each message that the how-to explains is what the mistake it is about gives."""
    with pytest.raises(load.ScenarioError) as refused:
        load.load(example, [override])
    assert MESSAGES[override] in str(refused.value)
    assert MESSAGES[override] in HOW_TO.read_text()
