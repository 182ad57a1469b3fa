"""What software of a user's own says of a picture, checked and carried over the wire."""

import numpy as np
import pytest
from own_flights import reckoning

from shefex_nav import prepare, simulate
from shefex_nav.onboard.navigation.mean_rate import SEEN
from shefex_nav.onboard.navigator import PREDICTION_FLOOR
from shefex_nav.onboard.own_navigation import besides_mean_rate, covered
from shefex_nav.onboard.startracker import tracker
from shefex_nav.onboard.startracker.tracker import Context
from shefex_nav.records import ImuBlock
from shefex_nav.scenario.load import load
from shefex_nav.software import messages

TABLE = np.array([[-0.05, 1e-5, 0.0, -2e-5], [0.0, 0.0, 0.0, 0.0], [0.05, 1e-5, 0.0, -2e-5]])


def test_a_context_comes_back_as_it_went():
    sent = Context(
        np.arange(3.0), 0.1, 1.0, 0.5, omega_c=np.ones(3), P_omega_c=np.eye(3), unsteady_c=TABLE,
        unsteady_variance=1e-12,
    )  # fmt: skip
    got = messages.unpack(*next(messages.split(messages.pack(sent))))
    for one, other in zip(sent, got, strict=True):
        np.testing.assert_array_equal(one, other)


def blocks(rate, n=20, samples=4, dt_s=0.0025):
    """ImuBlocks from time zero on of a body that turns by rate(t)."""
    made = []
    for k in range(n):
        t_s = (k * samples + np.arange(samples) + 0.5) * dt_s
        turned = np.array([rate(t) for t in t_s]) * dt_s
        made.append(
            ImuBlock(
                (k + 1) * samples * dt_s, (k + 1) * samples * dt_s, dt_s, turned, 0 * turned, False, True
            )
        )
    return made


def test_gyros_say_how_the_body_turns_besides_its_mean_rate():
    """Of a steady acceleration: a t^2 / 2 from the middle."""
    alpha = np.array([0.0, 0.4, -0.2])
    table, variance = besides_mean_rate(blocks(lambda t: alpha * t), 0.052, 0.148, 0.1, 1e-12)
    np.testing.assert_allclose(table[:, 1:], 0.5 * np.outer(table[:, 0] ** 2, alpha), atol=1e-6)
    assert (table[0, 0], table[-1, 0]) == pytest.approx((-0.048, 0.048)) and variance > 1e-12


def test_noise_of_the_gyros_is_left_alone():
    alpha, noise = np.array([0.0, 0.4, 0.0]), (0.5 * 0.4 * 0.048**2) ** 2 / (3.0 * SEEN)
    for more, rows in ((0.9, 41), (1.1, 0)):
        table, variance = besides_mean_rate(blocks(lambda t: alpha * t), 0.052, 0.148, 0.1, more * noise)
        assert (len(table) > 0) == (rows > 0) and variance <= 1.2 * noise


def test_blocks_with_a_gap_say_nothing():
    whole = blocks(lambda t: np.zeros(3))
    assert covered(whole, 0.001, 0.199)
    assert not covered(whole[1:], 0.001, 0.199) and not covered(whole[:-1], 0.001, 0.199)
    assert not covered([*whole[:5], *whole[6:]], 0.001, 0.199)


def test_what_is_predicted_of_a_picture_has_the_correlations_of_the_attitude(tmp_path):
    """Along (1, 1, 1) the errors of three axes that go together add up: three times the variance."""
    path = reckoning(
        tmp_path,
        """P = numpy.diag([1.0, 1, 1, 1, 1, 1, 4e-6, 4e-6, 4e-6])
        P[6:, 6:] += 3.9e-6 * (1.0 - numpy.eye(3))
        return Estimate(self.r, self.v, self.q, P)""",
    )
    path.write_text("import numpy\n" + path.read_text())
    override = f"navigation.software={path}:Reckoning"
    scenario = prepare.settled(load("night_sky", [override], trust=True))
    seen, world = [], prepare.build_world(scenario, 1)

    def step(*given):
        seen.append(given[3])
        return tracker.step(*given)

    for _ in simulate.route(world, scenario, 1, until_s=1.5, step=step):
        pass
    C_bc = world.computer.nav.C_bc
    P_theta_b = 1e-7 * np.eye(3) + 3.9e-6 * np.ones((3, 3))
    mounting = scenario.star_camera.mounting.error
    wanted = C_bc.T @ P_theta_b @ C_bc + (mounting**2 + PREDICTION_FLOOR**2) * np.eye(3)
    np.testing.assert_allclose(seen[-1].P_c, wanted, rtol=1e-6, atol=1e-14)
