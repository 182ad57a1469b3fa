"""The filter's covariance while the instruments stand still: `night_sky` without its stars.

At rest specific force is the same all the time, and so is what goes with it. A filter that takes it for noise
believes its gyro biases too much and its velocity too little. The authority is the bound, in which every
error of the world is a state, gravity beyond J2 as the filter assumes it: a filter that knows as much has the
same sigmas.
"""

from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.laws import FIELD_TIME_S
from shefex_nav.onboard.navigation.state import ATT, BA, BG, POS, VEL
from shefex_nav.scenario import load, params_onboard
from shefex_nav.verify import bound, bound_model, flown, over_bound

SCENARIO = Path(__file__).parents[2] / "scenarios" / "night_sky.yaml"
BRIEFLY = "star_tracker.enabled=false", "mission.time_limit=180 s", "star_tracker.off=180 s"
EVERY_S = 30.0


@pytest.fixture(scope="module")
def world():
    return prepare.build_world(load.load(SCENARIO, BRIEFLY), 0)


@pytest.fixture(scope="module")
def bounded(world):
    """Sigmas of the bound every 30 s, body axes: (6, 15) in the order of the filter's errors."""
    scenario = load.load(SCENARIO, BRIEFLY)
    flight = over_bound.flight_of(scenario, world, [])
    gravity = scenario.navigation.gravity_error, FIELD_TIME_S
    layout = bound_model.sources(flight.imu, flight.camera, *gravity)
    rows = []
    for k, output in bound.outputs(flight, layout, every_s=EVERY_S):
        C_bi = rotation.dcm_from_quat(flight.trajectory.q_ib[k]).T
        moving = [
            C_bi @ output.P[at, at] @ C_bi.T for at in (bound_model.POS, bound_model.VEL, bound_model.PSI)
        ]
        rows.append([*moving, *(of_bias(layout, output.P, triad) for triad in ("gyro", "accel"))])
    return sigmas(rows)


def of_bias(layout, P, triad):
    """Covariance of turn-on and in-run bias together: (3, 3)."""
    sums = np.zeros((3, layout.n))
    for name in (f"{triad}_bias", f"{triad}_in_run_bias"):
        sums[:, layout.places[name]] = np.eye(3)
    return sums @ P @ sums.T


def sigmas(rows):
    """Lists of five covariances (3, 3) -> (m, 15)."""
    return np.sqrt([np.concatenate([np.diag(P) for P in row]) for row in rows])


def told(world, *overrides):
    """Sigmas that the filter tells at the same times, in the same axes: (6, 15)."""
    scenario = load.load(SCENARIO, (*BRIEFLY, *overrides))
    nav = params_onboard.nav_params(scenario)
    there = world._replace(computer=world.computer._replace(nav=nav))
    run, trajectory, rows = flown.filter_run(scenario, 0, [], world=there), world.flight.trajectory, []
    for t_s in np.arange(EVERY_S, 181.0, EVERY_S):
        n, k = (int(np.searchsorted(times, t_s - 1e-6)) for times in (run.t_s, trajectory.t_s))
        C_bi, P = rotation.dcm_from_quat(trajectory.q_ib[k]).T, run.P[n]
        moving = [C_bi @ P[at, at] @ C_bi.T for at in (POS, VEL)]
        rows.append([*moving, *(P[at, at] for at in (ATT, BG, BA))])
    return sigmas(rows)


def test_the_filter_at_rest_knows_as_much_as_can_be_known(world, bounded):
    """All 15 sigmas, 1.5 %; in-run biases that walk, where they should wander about zero, make 1 % of it."""
    ratio = told(world) / bounded
    assert ratio.shape == (6, 15)
    assert ratio.min() > 0.998
    assert ratio.max() < 1.015


@pytest.mark.parametrize(
    ("block", "errors", "least", "most"),
    [("gyro_g_sensitivity", BG, 0.7, 0.85), ("accel_misalignment", VEL, 1.8, 2.5)],
)
def test_what_goes_with_thrust_is_no_noise_at_rest(world, bounded, block, errors, least, most):
    """Left to noise, as in flight: gyro biases about the level axes too sure, velocity too unsure."""
    states = [name for name in load.load(SCENARIO).navigation.states if name != block]
    ratio = (told(world, f"navigation.states=[{', '.join(states)}]") / bounded)[-1, errors]
    extreme = ratio.min() if errors is BG else ratio.max()
    assert least < extreme < most
