"""A world in which the field of the Earth is another one: what its accelerometers sense."""

from collections import namedtuple
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.environment import gravity
from shefex_nav.environment.models import BUILT_IN
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Trajectory
from shefex_nav.verify import field
from shefex_nav.world import imu

EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 1.234, wgs84.OMEGA)
DT = 1.0 / 400.0


def tumbling(seconds):
    """Trajectory on a straight line at 2 km/s, turning about all axes; nothing else of it matters."""
    n = round(seconds / DT) + 1
    t_s = DT * np.arange(n)
    r_i = np.array([2.2e6, 0.6e6, 6.1e6]) + np.outer(t_s, [1500.0, -1200.0, 500.0])
    q_ib = np.array([rotation.quat_from_rotvec(t * np.array([0.9, -0.4, 0.2])) for t in t_s])
    zeros, ones, quiet = np.zeros((n, 3)), np.ones(n), np.zeros(n, dtype=np.int8)
    return Trajectory(
        t_s, quiet, r_i, zeros, q_ib, zeros, zeros, zeros, zeros, ones, ones, ones, ones, quiet, ones
    )


def world_of(trajectory):
    n = len(trajectory.t_s)
    data = imu.ImuData(trajectory.t_s, np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n, dtype=bool), None)
    fields = {"flight": SimpleNamespace(trajectory=trajectory), "earth": EARTH, "imu": data}
    Small = namedtuple("Small", fields)
    return Small(**fields)


class Fielded(SimpleNamespace):
    """What of a scenario says which field it flies in."""

    MODELS = BUILT_IN


def scenario_with(kind, degree):
    return Fielded(earth=SimpleNamespace(gravity=kind, gravity_degree=degree))


@pytest.mark.parametrize("seed", range(3))
def test_the_turned_field_has_the_same_size_and_the_vehicle_the_same_path(seed):
    """Velocity felt more, in inertial axes, is what gravity gives less: -(R - I) times the difference, R a
    rotation that is the same along the flight; sample by sample, R found from the samples themselves."""
    world = world_of(tumbling(20.0))
    path = world.flight.trajectory
    known = gravity.load("egm96", 12)
    found = field.rotated(scenario_with("egm96", 12), world, np.random.default_rng(seed))
    C_ib = np.array([rotation.dcm_from_quat(q) for q in path.q_ib[1:]])
    more_i = -np.einsum("nij,nj->ni", C_ib, found.imu.dv_b[1:]) / DT
    difference = []
    for t_s, r_i in zip(path.t_s[1:] - 0.5 * DT, 0.5 * (path.r_i[1:] + path.r_i[:-1]), strict=True):
        C_ie = frames.dcm_ie(EARTH, t_s)
        r_e = C_ie.T @ r_i
        difference.append(C_ie @ (gravity.gravity_e(known, r_e) - gravity.gravity_j2_e(r_e)))
    difference = np.array(difference)
    elsewhere = difference + more_i
    size = np.linalg.norm(difference, axis=1)
    np.testing.assert_allclose(np.linalg.norm(elsewhere, axis=1), size, rtol=1e-4)
    assert np.abs(elsewhere - difference).max() > 0.1 * size.max()
    changed = [np.diff(one[::400], axis=0) for one in (difference, elsewhere)]  # turned with it
    np.testing.assert_allclose(*(np.linalg.norm(one, axis=1) for one in changed), rtol=0.02)
    assert np.array_equal(found.imu.dtheta_b, world.imu.dtheta_b) and found.flight is world.flight
    assert not world.imu.dv_b.any()


def test_directions_are_even():
    """Mean of the turned difference over many draws: nothing, within four standard errors."""
    world = world_of(tumbling(1.0))
    scenario, n = scenario_with("egm96", 4), 300
    first = []
    _, (start, *_) = field.beyond(gravity.load("egm96", 4), world.flight.trajectory, EARTH)
    for seed in range(n):
        found = field.rotated(scenario, world, np.random.default_rng(seed))
        first.append(start - rotation.dcm_from_quat(world.flight.trajectory.q_ib[1]) @ found.imu.dv_b[1] / DT)
    scatter = np.linalg.norm(start) / np.sqrt(3.0 * n)
    assert np.abs(np.mean(first, axis=0)).max() < 4.0 * scatter


def test_a_world_of_the_on_board_field_has_nothing_to_turn():
    world = world_of(tumbling(2.0))
    found = field.rotated(scenario_with("j2", 2), world, np.random.default_rng(0))
    assert np.abs(found.imu.dv_b).max() < 1e-9 * DT
