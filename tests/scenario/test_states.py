"""Blocks of states of the filter: what a scenario may name, and what they change of the filter's noise."""

from pathlib import Path

import numpy as np
import pytest

from shefex_nav.instruments import state_sizes
from shefex_nav.onboard.navigation import integrity_watch
from shefex_nav.onboard.navigation.state import DEFAULT_STATES, OPTIONAL, initial_covariance
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.json_schema import json_schema
from shefex_nav.scenario.load import ScenarioError, load

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"


BAROMETER = "barometer={rate: 10 Hz, bias: 100 Pa, noise: 5 Pa}"
MAGNETOMETER = "magnetometer={rate: 10 Hz, hard_iron: 500 nT, noise: 50 nT}"
SUN = "sun_sensor={rate: 10 Hz, boresight: [0, 1, 0], field_of_view: 1 rad, noise: 1 mrad, alignment: 1 mrad}"


def nav_params(states, *overrides):
    return params_onboard.nav_params(load(SCENARIO, [f"navigation.states=[{', '.join(states)}]", *overrides]))


def test_a_scenario_may_name_every_block_of_the_filter():
    known = OPTIONAL | state_sizes()
    named = json_schema()["$defs"]["Navigation"]["properties"]["states"]["oneOf"][1]["items"]
    assert named["enum"] == list(known)
    states = tuple(known)[1:]
    params = nav_params(states, BAROMETER, MAGNETOMETER, SUN)
    assert params.states == states
    for name in states:
        P = initial_covariance(params, name)
        assert P.shape == (known[name],) * 2
        assert np.all(P.diagonal() > 0.0) or name == "range_bias"  # that receiver has none


@pytest.mark.parametrize(
    ("states", "place", "words"),
    [
        ("[mounting, gyro_skale]", "navigation.states.1", "'gyro_skale' is not known"),
        ("[gyro_scale, mounting, gyro_roll_column]", "navigation.states.2", "estimate the same error"),
        ("[gyro_roll_column, gyro_misalignment]", "navigation.states.0", "'gyro_misalignment'"),
        ("[clock, clock]", "navigation.states.1", "'clock' is named twice"),
        (
            "clock",
            "navigation.states",
            "choose from: automatic, or give a list of: gyro_roll_column, gyro_scale, ",
        ),
        ("clock", "navigation.states", "did you mean '[clock]'?"),
    ],
)
def test_wrong_names_are_refused_with_place_and_value(states, place, words):
    with pytest.raises(ScenarioError) as caught:
        load(SCENARIO, [f"navigation.states={states}"])
    (line,) = str(caught.value).splitlines()
    assert f"{place}:" in line and words in line


def test_what_is_estimated_is_no_noise_as_well():
    """Scale factor and misalignment of the gyros share a term; the rms of three axes."""
    nothing, gyro = nav_params(()).imu, load(SCENARIO).imu.gyro
    assert nothing == nav_params(DEFAULT_STATES).imu
    assert nav_params(("gyro_scale",)).imu.gyro_cross == pytest.approx(gyro.misalignment * np.sqrt(2.0 / 3.0))
    assert nav_params(("gyro_misalignment",)).imu.gyro_cross == pytest.approx(
        gyro.scale_factor / np.sqrt(3.0)
    )
    every = nav_params(
        ("gyro_scale", "gyro_misalignment", "gyro_g_sensitivity", "accel_scale", "gravity")
    ).imu
    gone = {
        "gyro_cross": 0.0,
        "spun_along": 0.0,
        "spun_across": 0.0,
        "gyro_g_sensitivity": 0.0,
        "accel_scale": 0.0,
        "gravity": 0.0,
    }
    assert every == nothing._replace(**gone)
    assert min(nothing.gyro_g_sensitivity, nothing.accel_scale, nothing.gravity) > 0.0
    assert nav_params(("accel_misalignment",)).imu == nothing._replace(accel_misalignment=0.0)


def test_g_sensitivity_counts_in_the_watch_over_the_gyros_as_block_and_as_noise():
    """Without it, braking in the air would look like a broken gyro to a filter that estimates it."""
    sigma = load(SCENARIO).imu.gyro.g_sensitivity
    for states in ((), ("gyro_g_sensitivity",)):
        assert integrity_watch.start(nav_params(states)).gyros.noise[2] == sigma**2


def test_missions_that_feel_their_weight_for_minutes_estimate_what_goes_with_it():
    """On the ground and under a parachute these errors are biases; the filter's noise is that of thrust."""
    found = []
    for path in sorted(SCENARIO.parent.glob("*.yaml")):
        scenario = load(path)
        if scenario.ground is not None or (scenario.vehicle and scenario.vehicle.parachute):
            found.append(path.stem)
            assert {"gyro_g_sensitivity", "accel_misalignment"} <= set(scenario.navigation.states), path.stem
    assert found == ["baro_2d_gps", "night_sky", "rexus_like", "rexus_spinning"]
