"""The section magnetometer: absent by default, what is refused, and what the filter takes from it."""

import numpy as np
import pytest
from broken import DEFAULT, messages

from shefex_nav.environment import magnetic_field
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.load import load

SENSOR = {"rate": "10 Hz", "hard_iron": "500 nT", "noise": "50 nT"}
STATES = "navigation.states=[mounting, hard_iron]"


def section(**changes):
    return "magnetometer={" + ", ".join(f"{key}: {value}" for key, value in (SENSOR | changes).items()) + "}"


def of_filter(*overrides):
    """Aid of the filter, and what it assumes."""
    (aid,) = params_onboard.nav_params(load(DEFAULT, overrides)).aids
    return aid, aid.expect.args[0]


def test_there_is_none_unless_it_is_given():
    assert load(DEFAULT).magnetometer is None
    assert params_onboard.nav_params(load(DEFAULT)).aids == ()


def test_the_filter_assumes_what_the_sensor_is_said_to_have():
    aid, model = of_filter(section(soft_iron="0.3 %", quantum="150 nT"), STATES)
    sensor = model.settings
    assert (sensor.noise, sensor.quantum, sensor.soft_iron) == pytest.approx((50e-9, 150e-9, 3e-3))
    np.testing.assert_allclose(aid.blocks[0].P, 500e-9**2 * np.eye(3))
    np.testing.assert_allclose(model.sigma_n, magnetic_field.sigma_n(2012.47), rtol=1e-3)
    assert model.use.rows == "field" and aid.renewal is not None
    aid, model = of_filter(section(), STATES, "navigation.magnetometer.rows=heading")
    assert model.use.rows == "heading" and aid.renewal is None


@pytest.mark.parametrize(
    ("overrides", "field", "words"),
    [
        ([section()], "navigation.states", "a magnetometer needs the state of its hard iron"),
        ([STATES], "navigation.states", "'hard_iron' is of a magnetometer: give section magnetometer"),
        ([section(rate="30 Hz"), STATES], "magnetometer.rate", "30 Hz does not divide the on-board clock"),
        ([section(noise="5 Pa"), STATES], "magnetometer.noise", "is a pressure, expected"),
        ([section(range="0 uT"), STATES], "magnetometer.range", "must be greater than zero"),
        ([section(soft_iron="80 %"), STATES], "magnetometer.soft_iron", "50 %"),
        (
            [section(), STATES, "mission.epoch=1985-06-22T19:18:00Z"],
            "mission.epoch",
            "the magnetic field is not known 25 years outside its models",
        ),
        ([section(), STATES, "navigation.magnetometer.rows=compass"], "rows", "compass"),
    ],
)
def test_what_is_refused(overrides, field, words):
    said = messages(DEFAULT, overrides)
    assert any(field in line and words in line for line in said), said
