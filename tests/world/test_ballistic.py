"""Bodies that fall: against Kepler's orbits, terminal velocity and the momentum of what is dropped."""

import numpy as np
import pytest
from scipy.optimize import brentq

from shefex_nav import prepare
from shefex_nav.errors import UserError
from shefex_nav.geometry import frames, rotation
from shefex_nav.scenario import load, params
from shefex_nav.world.flight import ballistic, fly, start, surroundings
from shefex_nav.world.flight import params as p


def surrounded(*told):
    scenario = load.load("shefex2_andoya", told)
    return start.surround(params.flight_params(scenario), prepare.earth_rotation(scenario))[0]


def height(world, t_s, r_i):
    return surroundings.height(world.shape, frames.dcm_ie(world.earth, t_s).T @ r_i)


def thrown(world, up_m, velocity_l):
    """State in frame i of a body above the launcher, with a velocity east, north, up over the Earth."""
    up = world.rail.r_e / np.linalg.norm(world.rail.r_e)
    east = np.cross([0.0, 0.0, 1.0], up) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], up))
    C_el = np.column_stack([east, np.cross(up, east), up])
    return frames.inertial_from_ecef(world.earth, 0.0, world.rail.r_e + up_m * up, C_el @ velocity_l)


def kepler(gm, r, v, t_s):
    """Place on the ellipse of a state after t_s, by Kepler's equation."""
    a = 1.0 / (2.0 / np.linalg.norm(r) - v @ v / gm)
    n = np.sqrt(gm / a**3)
    cosine, sine = 1.0 - np.linalg.norm(r) / a, r @ v / np.sqrt(gm * a)  # e cos E, e sin E at first

    def equation(change):
        return change - cosine * np.sin(change) + sine * (1.0 - np.cos(change)) - n * t_s

    change = brentq(equation, -10.0, 10.0, xtol=1e-15)
    f = 1.0 - a / np.linalg.norm(r) * (1.0 - np.cos(change))
    g = t_s - (change - np.sin(change)) / n
    return f * r + g * v


@pytest.mark.parametrize("velocity", [[300.0, 1500.0, 1800.0], [-2500.0, 0.0, 900.0], [0.0, 0.0, 100.0]])
@pytest.mark.parametrize("ground", [0.0, 1200.0, -80.0])
def test_a_fall_in_a_vacuum_ends_where_kepler_says(velocity, ground):
    world = surrounded("earth.gravity=point")
    r, v = thrown(world, 40e3, np.array(velocity))
    found = ballistic.fall(world, ballistic.Body(10.0, None), 0.0, r, v, ground=ground)
    gm = world.coarse[0]
    top = found.t_s[np.argmax([height(world, t, x) for t, x in zip(found.t_s, found.r_i, strict=True)])]
    down = brentq(lambda t: height(world, t, kepler(gm, r, v, t)) - ground, top + 1.0, found.t_s[-1] + 30.0)
    tolerance = 2e-3 if ground >= 0.0 else 0.5  # below the ellipsoid it goes straight on
    assert found.t_s[-1] == pytest.approx(down, abs=tolerance / 100.0)
    np.testing.assert_allclose(found.r_i[-1], kepler(gm, r, v, down), atol=tolerance)
    assert height(world, found.t_s[-1], found.r_i[-1]) == pytest.approx(ground, abs=1e-6)


def test_a_body_with_drag_falls_with_its_terminal_velocity():
    """m g = rho V^2 S C_D / 2; its speed follows the density with a lag of 2 % at most here."""
    world = surrounded()
    drag = p.Spent(0.5, np.array([0.0, 1.0]), np.array([1.2, 1.2]))
    found = ballistic.fall(world, ballistic.Body(60.0, drag), 0.0, *thrown(world, 9000.0, np.zeros(3)))
    _, v_e = frames.ecef_from_inertial(world.earth, found.t_s[-1], found.r_i[-1], found.v_i[-1])
    assert np.linalg.norm(v_e) == pytest.approx(np.sqrt(2.0 * 60.0 * 9.823 / (1.225 * 0.6)), rel=0.01)


def test_a_body_that_the_air_stops_at_once_is_refused_in_words():
    """A veil of 1 g and 10 km2 keeps its speed for some ns, for hours."""
    world, drag = surrounded(), p.Spent(1e7, np.array([0.0, 1.0]), np.array([1.2, 1.2]))
    with pytest.raises(UserError, match="slowed down too fast"):
        ballistic.fall(world, ballistic.Body(1e-3, drag), 0.0, *thrown(world, 9000.0, np.zeros(3)))


def test_fixed_steps_end_within_millimetres():
    world = surrounded()
    drag = p.Spent(0.8, np.array([0.0, 1.0]), np.array([1.0, 1.0]))
    state = thrown(world, 60e3, np.array([0.0, 700.0, 1200.0]))
    exact, quick = (
        ballistic.fall(world, ballistic.Body(980.0, drag), 0.0, *state, tolerance=tolerance)
        for tolerance in (1e-10, -0.2)
    )
    assert np.linalg.norm(exact.r_i[-1] - quick.r_i[-1]) < 0.02


def test_a_wind_carries_what_falls_slowly():
    told = "wind={height: [0 m, 30 km], speed: [10 m/s, 10 m/s], from: [180 deg, 180 deg]}"
    drag = p.Spent(20.0, np.array([0.0, 1.0]), np.array([1.0, 1.0]))
    calm, windy = surrounded(), surrounded(told)
    r, v = thrown(calm, 3000.0, np.zeros(3))
    falls = [ballistic.fall(world, ballistic.Body(60.0, drag), 0.0, r, v) for world in (calm, windy)]
    moved = frames.dcm_ie(calm.earth, falls[0].t_s[-1]).T @ (falls[1].r_i[-1] - falls[0].r_i[-1])
    assert np.linalg.norm(moved) == pytest.approx(10.0 * falls[0].t_s[-1], rel=0.03)


def test_what_begins_below_the_ground_does_not_fall():
    world = surrounded()
    state = thrown(world, 500.0, np.zeros(3))
    assert ballistic.fall(world, ballistic.Body(1.0, None), 0.0, *state, ground=800.0) is None


def test_momentum_is_kept_when_a_stage_is_dropped():
    """Springs push both ways; masses of payload and empty stage, velocities of their centres of mass.

    The tip-off is given to what flies on alone, so that it is left out here.
    """
    told = ["vehicle.stages.Orion.separation.impulse=500 N s", "vehicle.yo_yo=null"]
    told += ["vehicle.stages.Orion.separation.tip_off=[0 deg/s, 0 deg/s]"]
    scenario = load.load("rexus_like", told)
    flight = prepare.fly_vehicle(scenario, 1)
    (dropped,) = flight.dropped
    configurations, way = fly.configurations(params.flight_params(scenario)), flight.trajectory
    after = int(np.searchsorted(way.t_s, 76.0 - 1e-9))
    states = []
    for k, one in ((after - 1, configurations[0]), (after, configurations[1])):
        C_ib, lever = rotation.dcm_from_quat(way.q_ib[k]), fly.lever(one, way.t_s[k])
        states.append(way.v_i[k] + C_ib @ np.cross(way.omega_ib_b[k], lever))
    before, payload = states
    before = before - 9.6 * (way.t_s[after] - way.t_s[after - 1]) * way.r_i[after] / np.linalg.norm(
        way.r_i[after]
    )
    assert dropped.t_s == 76.0 and dropped.stage == 0
    np.testing.assert_allclose((112.0 * payload + 140.0 * dropped.v_i) / 252.0, before, atol=3e-3)
    C_ib = rotation.dcm_from_quat(way.q_ib[after])
    apart = C_ib.T @ (payload - dropped.v_i)
    assert apart[0] == pytest.approx(500.0 / 112.0 + 500.0 / 140.0, abs=0.1)
