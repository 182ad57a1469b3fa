"""The section barometer: absent by default, what is refused, and what the filter takes from it."""

import numpy as np
import pytest
from broken import DEFAULT, the_message

from shefex_nav.onboard.navigation import measure_barometer
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.load import load

SENSOR = {"rate": "10 Hz", "bias": "100 Pa", "noise": "5 Pa"}
STATES = "navigation.states=[mounting, baro_bias, baro_scale]"


def section(**changes):
    given = {key: value for key, value in (SENSOR | changes).items() if value is not None}
    return "barometer={" + ", ".join(f"{key}: {value}" for key, value in given.items()) + "}"


def test_there_is_none_unless_it_is_given():
    assert params_onboard.nav_params(load(DEFAULT)).aids == ()
    assert load(DEFAULT).barometer is None


def test_the_filter_assumes_what_the_sensor_is_said_to_have():
    more = section(drift="20 Pa", drift_time="200 s", quantum="12 Pa", lag="30 ms")
    (aid,) = params_onboard.nav_params(load(DEFAULT, [more, STATES])).aids
    (model,), (of_bias, of_scale) = aid.expect.args, aid.blocks
    np.testing.assert_allclose(of_bias.walk, [20.0 * np.sqrt(2.0 / 200.0), 0.0])
    assert measure_barometer.white(model) == pytest.approx(np.hypot(5.0, 12.0 / np.sqrt(12.0)))
    assert model.settings.lag == pytest.approx(0.03)
    bias, metres = np.sqrt(np.diag(of_bias.P))
    assert bias == pytest.approx(np.hypot(100.0, 20.0))
    assert metres == pytest.approx(800.0 / (1.225 * 9.80665))
    column = of_scale.P[:3, :3]
    thick = np.array([1500.0, 2000.0, 1500.0])
    assert 90.0 < np.sqrt(thick @ column @ thick) < 140.0  # m, of the height of a level at 5 km


def test_a_filter_may_do_without_it():
    scenario = load(DEFAULT, [section(), "navigation.barometer.used=false"])
    assert params_onboard.nav_params(scenario).aids == ()
    assert scenario.barometer.rate == 10.0


@pytest.mark.parametrize(
    ("overrides", "field", "words"),
    [
        ([section()], "navigation.states", "a barometer needs the state of its bias"),
        ([STATES], "navigation.states", "'baro_bias' is of a barometer: give section barometer"),
        ([section(rate="30 Hz"), STATES], "barometer", "30 Hz does not divide the on-board clock"),
        ([section(lowest="130 kPa"), STATES], "barometer", "130000 Pa must be below highest, 120000 Pa"),
        ([section(noise="5"), STATES], "barometer.noise", "5 Pa"),
        ([section(noise="5 m"), STATES], "barometer.noise", "is a length, expected a pressure"),
        ([section(bias=None), STATES], "barometer", "bias"),
        (
            [section(port="{mach: [0, 1], coefficient: [0]}"), STATES],
            "barometer",
            "1 values for 2 Mach numbers",
        ),
        (
            [section(port="{mach: [1, 0.5], coefficient: [0, 0]}"), STATES],
            "barometer",
            "0.5 does not follow on 1; they must increase",
        ),
        (
            [section(), STATES, "navigation.barometer.unused_mach=[1.3, 0.8]"],
            "navigation.barometer.unused_mach",
            "1.3 is above 0.8; the lower comes first",
        ),
        ([section(day="{temperature: -3 K}"), STATES], "barometer.day.temperature", "must not be negative"),
    ],
)
def test_what_is_refused(overrides, field, words):
    said = [line for line in _said(overrides) if field in line]
    assert any(words in line for line in said), _said(overrides)


def _said(overrides):
    from broken import messages

    return messages(DEFAULT, overrides)


def test_a_receiver_tells_what_its_section_says():
    assert load(DEFAULT).gps.fix == "full"
    assert "'height' is not known" in the_message(DEFAULT, ["gps.fix=height"])


def test_which_drift_of_the_barometer_is_looked_for_and_covered():
    """A rate of pressure, or any; a chance."""

    def rule(*told):
        more = [f"navigation.barometer.drift.{one}" for one in told]
        (aid,) = params_onboard.nav_params(load(DEFAULT, [section(), STATES, *more])).aids
        return tuple(aid.drift)[:3]

    assert rule() == (1e-9, np.inf, "Pa")
    assert rule("fastest=0.5 hPa/s", "chance=1e-6") == (1e-6, 50.0, "Pa")
    assert rule("fastest=any") == rule()
    for told, words in (("fastest=-1 Pa/s", "must not be negative"), ("chance=0.5", "must be at most 0.001")):
        assert words in the_message(DEFAULT, [section(), STATES, f"navigation.barometer.drift.{told}"])
