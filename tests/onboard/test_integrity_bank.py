"""Bank of windows over innovations: what it raises, what it lets pass, and what becomes of the solution."""

import numpy as np
import pytest
from navigation_flight import DT, EARTH, MODEL, PARAMS, alignment, fly, gps_fix

from shefex_nav.onboard.navigation import fusion, gate, integrity, integrity_watch
from shefex_nav.onboard.navigation.eskf import Grown, grown
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate
from shefex_nav.onboard.navigation.integrity_bank import CALM, WINDOWS, Stream, _worst, limits
from shefex_nav.onboard.navigation.sensor import Trial
from shefex_nav.onboard.navigation.settings import Release
from shefex_nav.records import Doubt, GpsFix

SECONDS, FROM_S = 70, 30
QUIET = MODEL._replace(gravity=0.0, accel_scale=0.0, accel_misalignment=0.0)


def taken(innovations):
    stream = Stream(innovations.shape[1])
    return [stream.take(w) for w in innovations]


def reference(kept, n, windows, sizes, run):
    """The window that is furthest beyond its limit, written slowly."""
    found = []
    for k, m in enumerate(windows):
        if m <= n:
            w = kept[n - m : n]
            along = w.sum(axis=0)
            found.append(((w * w).sum() / sizes[k], k, False))
            found.append((along @ along / m / run, k, True))
    worst = max(found, default=(0.0,))
    return worst[1:] if worst[0] > 1.0 else (-1, False)


@pytest.mark.parametrize("d", [1, 3, 6])
def test_compiled_windows_are_those_written_slowly(d):
    rng = np.random.default_rng(d)
    sizes, run = limits(d, 0.05)  # a limit that is passed now and then
    for _ in range(300):
        n = int(rng.integers(1, 128))
        kept = rng.standard_normal((128, d)) + rng.choice([0.0, 0.3])
        k, of_run, _ = _worst(kept, n, WINDOWS, sizes, run)
        assert (k, of_run) == reference(kept, n, WINDOWS, sizes, run)


def test_each_limit_has_its_chance():
    """20 000 windows of white innovations: 1 % of them beyond, within 4 sigma of the binomial law."""
    rng, n, count = np.random.default_rng(5), 8, 20_000
    sizes, run = limits(3, 0.01, (n,))
    w = rng.standard_normal((count, n, 3))
    along = w.sum(axis=1)
    for share in (((w * w).sum(axis=(1, 2)) > sizes[0]).mean(), ((along**2).sum(axis=1) / n > run).mean()):
        assert abs(share - 0.01) < 4.0 * np.sqrt(0.01 * 0.99 / count)


def test_white_innovations_raise_no_alarm():
    """Sixty flights of a thousand innovations; at 1e-9 a test, some alarm has a chance of 1.2e-3."""
    for seed in range(60):
        assert not any(taken(np.random.default_rng(seed).standard_normal((1000, 3))))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_innovations_on_one_side_are_found_though_each_is_small(sign):
    rng = np.random.default_rng(2)
    w = rng.standard_normal((200, 3)) + sign * np.array([1.0, 0.0, -1.0])
    found = [one for one in taken(w) if one]
    assert (w[:64] ** 2).sum(axis=1).max() < 30.0
    assert "on one side" in found[0].words
    assert np.sign(found[0].mean[0]) == sign
    assert found[0].excess == pytest.approx(2.0 / 3.0, abs=0.5)
    turned = w * rng.choice([-1.0, 1.0], (200, 1))
    assert not [one for one in taken(turned) if one and "on one side" in one.words]


def test_three_steps_and_too_large_a_scatter_are_found():
    rng = np.random.default_rng(3)
    step = np.vstack([rng.standard_normal((50, 3)), 3 * [[4.0, 2.0, 0.0]]])  # each inside a gate of 21
    assert taken(step)[-1].words == "on one side: of 3 fixes"
    scattered = 3.0 * rng.standard_normal((10, 3))
    assert any(taken(scattered))


def test_calm_needs_innovations_of_the_right_size():
    rng, stream = np.random.default_rng(4), Stream(3)
    for _ in range(CALM - 1):
        stream.take(rng.standard_normal(3))
        assert not stream.calm()
    stream.take(np.zeros(3))
    assert stream.calm()
    for _ in range(CALM):
        stream.take(2.5 * rng.standard_normal(3))
    assert not stream.calm()


def flown(bias, seed, glitch=None):
    """Filter, [(s, alarms, doubts, velocity error over sigma)]: accelerometer off by `bias` for 6 s.

    glitch : function of the time of a fix in s and of the GpsFix -> GpsFix
    """
    blocks, states = fly(SECONDS)
    rng, nav, rows = np.random.default_rng(seed), None, []
    params = PARAMS._replace(imu=QUIET, motors=np.zeros((0, 2)), states=(), sigma_blocks={})
    nav = fusion.start(params, alignment(states[0]), EARTH)
    noise = np.repeat([QUIET.gyro_random_walk, QUIET.accel_random_walk], 3) * np.sqrt(DT)
    for n, (block, state) in enumerate(zip(blocks, states[1:], strict=True), 1):
        read = noise * rng.standard_normal((4, 6))
        read[:, 4] += bias * DT * (FROM_S <= n / 100.0 < FROM_S + 6)
        fusion.advance(
            nav, block._replace(dtheta_b=block.dtheta_b + read[:, :3], dv_b=block.dv_b + read[:, 3:])
        )
        if n % 100 == 20 and n > 100:
            fix = gps_fix(blocks, states, (n - 20) / 100.0, 0.2, rng)
            fusion.fuse(nav, [("gps", glitch(n // 100, fix) if glitch else fix)])
            error = nav.history.x[3:6] - state.v_i
            off = np.abs(error / np.sqrt(np.diag(nav.history.P)[3:6])).max()
            rows.append((n / 100.0, dict(nav.watch.alarms), nav.watch.graver_doubts(nav.health, False), off))
    return nav, rows


def velocity_off(seconds, *offsets):
    """Glitch: velocities of some seconds are off by one vector each."""

    def glitch(second, fix):
        if second not in seconds:
            return fix
        return fix._replace(v_ea_e=fix.v_ea_e + np.array(offsets[seconds.index(second)]))

    return glitch


@pytest.fixture(scope="module")
def biased():
    return flown(0.12, 1)


def test_an_error_that_every_gate_lets_pass_withdraws_the_solution(biased):
    nav, rows = biased
    assert nav.health["gps_velocity"].rejected == 0
    during = [row for row in rows if FROM_S < row[0] < FROM_S + 7]
    assert any("gps" in row[1] for row in during)
    for _, alarms, doubts, _ in rows:
        assert (doubts == Doubt.CONTRADICTED).all() == ("gps" in alarms)


def test_the_solution_comes_back_and_is_as_good_as_it_says(biased):
    _, rows = biased
    assert not rows[-1][1]
    assert (rows[-1][2] == Doubt.NONE).all()
    assert max(row[3] for row in rows[-10:]) < 5.0


@pytest.mark.parametrize("seed", [1, 2])
def test_without_an_error_nothing_is_raised(seed):
    nav, rows = flown(0.0, seed)
    assert not any(row[1] for row in rows)
    assert not [one for one in nav.watch.changes() if "innovations" in one.source]


@pytest.mark.parametrize("offsets", [[[5.0, 0.0, 0.0]], [[5.0, 0.0, 0.0], [0.0, -5.0, 0.0]]])
def test_velocities_that_are_refused_mislead_nobody(offsets):
    """One wrong velocity, and two that do not agree: nothing grows, no noise is blamed, no alarm."""
    nav, rows = flown(0.0, 1, velocity_off([30, 31][: len(offsets)], *offsets))
    quiet, _ = flown(0.0, 1)
    assert not any(row[1] for row in rows)
    assert nav.noise.imu == 1.0 and nav.noise.sensors == {}
    np.testing.assert_allclose(np.diag(nav.history.P), np.diag(quiet.history.P), rtol=0.1)
    assert (rows[-1][2] == Doubt.NONE).all()


def test_an_alarm_ends_though_the_receiver_gives_no_velocity_any_more():
    def silent(second, fix):
        return fix._replace(v_ea_e=np.full(3, np.nan)) if second > FROM_S + 8 else fix

    _, rows = flown(0.12, 1, silent)
    assert any(row[1] for row in rows)
    assert not rows[-1][1]


def position_off(offset):
    """Glitch: positions are off by a function of the second, m."""
    return lambda second, fix: fix._replace(r_ea_e=fix.r_ea_e + np.array(offset(second)))


def test_a_position_that_was_believed_in_the_end_stays_in_doubt():
    """60 m off from 30 s on, for good: refused for half a minute, then believed; who is right is open."""
    nav, rows = flown(0.0, 1, position_off(lambda second: [60.0 * (second >= 30), 0.0, 0.0]))
    assert nav.health["gps_position"].rejected == 0
    assert nav.watch.moved.largest == pytest.approx(60.0, abs=5.0)
    only_position = [Doubt.CONTRADICTED, Doubt.NONE, Doubt.NONE]
    assert all(row[2].tolist() == only_position for row in rows if row[0] > 31.0)


def test_a_position_that_runs_away_and_takes_the_filter_with_it_stays_in_doubt():
    nav, rows = flown(0.0, 1, position_off(lambda second: [max(0.0, 0.4 * (second - 25)), 0.0, 0.0]))
    since_s = next(row[0] for row in rows if row[1])
    assert nav.watch.moved
    assert all(row[2][0] == Doubt.CONTRADICTED for row in rows if row[0] >= since_s)


def test_positions_wait_for_what_becomes_of_a_velocity_that_is_far_off():
    """Both run away at 2 m/s: positions inside the gate must not bring the velocity along."""

    def away(second, fix):
        off = np.array([2.0 * (second >= 30), 0.0, 0.0])
        return fix._replace(v_ea_e=fix.v_ea_e + off, r_ea_e=fix.r_ea_e + max(second - 30, 0) * off)

    nav, rows = flown(0.0, 1, away)
    assert nav.watch.step.largest == pytest.approx(2.0, abs=0.3)
    assert all((row[2] == Doubt.CONTRADICTED).all() for row in rows if row[0] > 31.0)
    refused = position([2.0, 0.0, 0.0])
    held, health = HEALTHY._replace(used=5, far=True, in_a_row=1, evidence=refused), nav.health
    fix = position([0.0, 0.0, 0.0]).fix
    for velocity, waits in (
        (held, True),
        (held._replace(in_a_row=6), False),
        (held._replace(far=False), False),
    ):
        health["gps_velocity"] = velocity
        assert gate._receiver_is_doubtful(nav, fix) == waits
    health["gps_velocity"] = held
    assert not gate._receiver_is_doubtful(nav, fix._replace(t_valid_s=20.0))  # it is too long ago
    assert not gate._receiver_is_doubtful(nav, fix._replace(v_ea_e=np.full(3, np.nan)))


@pytest.mark.parametrize(
    "far, narrow, insists", [(True, True, True), (True, False, False), (False, True, False)]
)
def test_a_velocity_that_passes_only_just_after_it_was_far_off_insists(far, narrow, insists):
    before = HEALTHY._replace(rejected=2, far=far, first=position([2.0, 0.0, 0.0]))
    assert gate._insists("gps_velocity", before, position([0.5, 0.8, 0.0]), narrow) == insists
    assert not gate._insists("gps_velocity", before, position([0.4, 0.8, 0.0]), narrow)  # to another side


def test_a_velocity_that_was_far_off_once_does_not_withdraw_all_that_follows():
    """5 m/s along x in one fix, and the next one across by so much that it passes only just."""
    _, rows = flown(0.0, 1, velocity_off([30, 31], [5.0, 0.0, 0.0], [0.0, 0.17, 0.0]))
    assert (rows[-1][2] == Doubt.NONE).all()


def test_only_a_step_back_says_that_the_receiver_was_wrong():
    nav, _ = flown(0.0, 1)
    watch = nav.watch
    watch.accept_position(np.array([60.0, 0.0, 0.0]))
    assert not watch.moved  # a fix that is just outside the gate is no step
    watch.far = True
    for z, over in (([60.0, 0.0, 0.0], False), ([0.0, 60.0, 0.0], False), ([0.0, -58.0, 3.0], False),
                    ([-61.0, 2.0, 0.0], True)):  # fmt: skip
        watch.accept_position(np.array(z))
        assert (not watch.moved) == over


@pytest.mark.parametrize("sigma, widened", [(20.0, False), (25.0, True)])
def test_a_gate_that_has_widened_says_nothing_of_a_position(sigma, widened):
    earlier = position([30.0, 0.0, 0.0])._replace(P=100.0 * np.eye(3))
    later = position([25.0, 0.0, 0.0])._replace(P=sigma**2 * np.eye(3))
    assert integrity.has_widened(earlier, later) == widened


def test_stars_in_alarm_without_gps_leave_nothing_to_be_used():
    nav, _ = flown(0.0, 1)
    nav.watch.alarms["star_tracker"] = 1.0
    assert nav.watch.graver_doubts(nav.health, False).tolist() == [0, 0, Doubt.CONTRADICTED]
    nav.watch.reasons["gps"] = "no fix"
    assert (nav.watch.graver_doubts(nav.health, False) == Doubt.CONTRADICTED).all()


def test_a_position_that_jumps_alone_is_doubted_alone():
    nav, _ = flown(0.0, 1)
    used = HEALTHY._replace(used=10)
    health = nav.health | {"gps_velocity": used, "gps_position": used._replace(rejected=3, in_a_row=3)}
    assert nav.watch.graver_doubts(health, False).tolist() == [Doubt.CONTRADICTED, Doubt.NONE, Doubt.NONE]
    health["star_tracker"] = used._replace(in_a_row=integrity_watch.CONTRADICTIONS)
    both = [Doubt.CONTRADICTED, Doubt.NONE, Doubt.CONTRADICTED]
    assert nav.watch.graver_doubts(health, False).tolist() == both
    health["gps_velocity"] = used._replace(rejected=3, in_a_row=3)
    assert (nav.watch.graver_doubts(health, False) == Doubt.CONTRADICTED).all()


def after_star_fix(P, sigma):
    """Covariance of attitude and mounting, of which stars see the sum."""
    H = np.hstack([np.eye(3), np.eye(3)])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + sigma**2 * np.eye(3))
    return P - K @ H @ P


TIED = np.block([[np.eye(3), -np.eye(3)], [-np.eye(3), np.eye(3)]]) * 1e-6 + 1e-14 * np.eye(6)


def test_growing_tells_nothing_of_what_stars_cannot_tell_apart():
    """Attitude and mounting, each known to 1 mrad, their sum to 1e-4 of it."""
    P = np.zeros((12, 12))
    P[6:, 6:] = TIED
    larger = grown(P, 3.0, np.full(12, np.inf)).of(P)[6:, 6:]
    np.testing.assert_allclose(larger, 9.0 * TIED)
    assert np.diag(after_star_fix(larger, 1e-6)).min() > 0.99 * 9.0 * 1e-6


def test_an_attitude_grows_by_itself_beyond_the_mounting_that_it_is_tied_to():
    """A mounting may be 1.5 mrad on two axes: stars tell neither from the other, by more than that.

    With the correlation as it was, the next star fix told both to 1e-3 of what they are known to.
    """
    P, most = np.zeros((12, 12)), np.full(12, np.inf)
    P[6:, 6:], most[9:11] = TIED, 1.5e-3
    growth = grown(P, 3.0, most)
    np.testing.assert_allclose(growth.factors, [1.0] * 6 + [3.0] * 3 + [1.5, 1.5, 3.0], rtol=1e-6)
    larger = growth.of(P)[6:, 6:]
    np.testing.assert_allclose(np.diag(larger), np.diag(TIED) * np.square(growth.factors[6:]))
    left = np.diag(after_star_fix(larger, 1e-6))
    np.testing.assert_array_less(0.99e-6 * np.array([2.25, 2.25, 9.0, 2.25, 2.25, 9.0]), left)
    wrong = P[6:, 6:] * np.outer(growth.factors[6:], growth.factors[6:])
    assert np.diag(after_star_fix(wrong, 1e-6))[0] < 1e-3 * 1e-6


def test_a_star_fix_tells_a_scale_factor_from_the_angle_that_it_has_made_alone():
    """A spin has turned an error of 5 ppm into 0.1 mrad; the attitude is found wrong three times as far.

    Then the fix says of the scale factor as much as before, per angle, and less of it for certain.
    """
    turned = 20.0  # rad
    J = np.array([[1.0, turned], [0.0, 1.0]])
    P = J @ np.diag([1e-5**2, 5e-6**2]) @ J.T
    larger = Grown(np.array([3.0, 1.0])).of(P)
    angle, scale = larger[:, 0] / larger[0, 0]
    assert angle == 1.0 and scale == pytest.approx(P[1, 0] / P[0, 0] / 9.0)
    assert larger[0, 1] / larger[1, 1] == pytest.approx(turned)  # what a scale factor has made of an angle
    assert larger[1, 1] - larger[1, 0] ** 2 / larger[0, 0] > 0.88 * P[1, 1]
    assert P[1, 1] - P[1, 0] ** 2 / P[0, 0] < 0.01 * P[1, 1]


@pytest.mark.parametrize("seed", range(20))
def test_what_has_grown_is_a_covariance_and_no_smaller(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((9, 4))
    P, growth = A @ A.T, Grown(rng.uniform(1.0, 8.0, 9))
    larger = growth.of(P)
    np.testing.assert_allclose(np.diag(larger), np.diag(P) * np.square(growth.factors))
    assert np.linalg.eigvalsh(larger - P).min() > -1e-12 * np.trace(larger)


def test_angles_that_are_hardly_known_do_not_grow():
    P = np.diag(np.r_[np.ones(6), 0.01, 1.0, 4.0])
    assert grown(P, 8.0, np.full(9, np.inf)).factors.tolist() == [8.0] * 7 + [1.0, 1.0]


def test_what_has_no_ties_does_not_grow():
    """A mounting before the first star, and a block that is tied to a velocity."""
    P = 0.01 * np.eye(13)
    P[4, 9] = P[9, 4] = 0.001
    assert grown(P, 3.0, np.full(13, np.inf)).factors.tolist() == [3.0] * 10 + [1.0] * 3


def test_an_error_grows_to_the_largest_that_it_may_be():
    """Sigmas of 0.1, tied, of at most 0.25, 0.1 and 0.01; nothing shrinks, and a zero stays one."""
    P = 0.01 * (np.eye(13) + 0.1)
    P[12] = P[:, 12] = 0.0
    most = np.r_[np.full(9, np.inf), 0.25, 0.1, 0.01, 1.0]
    factors = grown(P, 3.0, most).factors
    np.testing.assert_allclose(factors, [3.0] * 9 + [0.25 / np.sqrt(0.011), 1.0, 1.0, 1.0])


def test_stars_end_a_dispute_only_where_their_angle_explains_the_step():
    """A step of 2 m/s after 100 m/s of thrust: 1 mrad does not explain it, 20 mrad do."""
    nav, _ = flown(0.0, 1)
    watch, z = nav.watch, np.array([2.0, 0.0, 0.0])
    watch.far = True
    for pushed, angle, over in ((100.0, 1e-3, False), (100.0, 2e-2, True), (np.inf, 2e-2, False)):
        watch.accept_velocity("gps_velocity", z, pushed)
        watch.attitude_was_wrong(angle)
        assert (not watch.step) == over
        watch.step.forget()


def position(z):
    """Evidence of a GPS position that is off by z."""
    fix = GpsFix(0.0, 0.0, True, np.zeros(3), np.zeros(3), np.eye(3), 0.01 * np.eye(3), 8, 1.0, "")
    return integrity.GpsEvidence(fix, np.array(z), 1e4 * np.eye(3))


@pytest.mark.parametrize("z, fate", [([28.0, 3.0, 1.0], Fate.REJECTED), ([2.0, -3.0, 1.0], Fate.USED)])
def test_a_position_refused_before_is_no_better_in_a_wider_gate(z, fate):
    rule = Release(rejections=30, duration=29.0)
    refused = HEALTHY._replace(used=5, rejected=2, t_first_s=1.0, in_a_row=2)
    refused = refused._replace(evidence=position([30.0, 0.0, 0.0]), first=position([31.0, 0.0, 0.0]))
    trial = Trial(rule, position(z), lambda *_: True, lambda *_: True, integrity.offset_remains)
    found, health = integrity.judge(refused, trial, 0.0, 21.1, 3.0)
    assert found == fate
    assert health.rejected == (3 if fate == Fate.REJECTED else 0)


def test_a_velocity_that_says_the_same_again_is_told_from_one_that_wanders():
    first = position([2.0, 0.0, 0.0])
    assert integrity.same_velocity_offset(first, position([1.7, 0.4, -0.3]))
    assert not integrity.same_velocity_offset(first, position([3.5, -0.5, 0.0]))  # as noise that adds up
    assert not integrity.same_velocity_offset(None, first)
