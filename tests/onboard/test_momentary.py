"""Errors of the moment: what is left of a count, and what vibration swings, with a motor and without."""

import numpy as np
import pytest
from navigation_flight import C_BC, DT, EARTH, P_STAR_C, PARAMS, STATES, alignment, fly
from unpacked import QUIET, noise_of, window

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import (
    covariance,
    error_model,
    fusion,
    measurements,
    momentary,
    prediction,
    process_noise,
    sensors,
    solution,
)
from shefex_nav.onboard.navigation.state import ATT, VEL, layout
from shefex_nav.records import ImuBlock, Reason, StarFix, StarVectors
from shefex_nav.world import imu

QUANTUM, COUNT = 2.4e-5, 6e-4  # rad, m/s
COAST = np.array([3e-6, 2e-4])  # rad, m/s rms
TRIALS, SAMPLES = 300, 4000  # 10 s
SPIN = np.array([12.0, 0.0, 0.0])
TUMBLE = np.array([3.0, 9.0, -6.0])
NOTHING = PARAMS.imu._replace(**dict.fromkeys(PARAMS.imu._fields, 0.0))


def quiet(**of_imu):
    """A filter after 0.2 s in which no motor counts as burning."""
    model = PARAMS.imu._replace(thrust_threshold=np.inf, **of_imu)
    nav = fusion.start(PARAMS._replace(imu=model, swing_at_rest=COAST), alignment(STATES[0]), EARTH)
    for block in fly(0.2)[0]:
        fusion.advance(nav, block)
    return nav


@kernel
def _densities(record, sample_s, dtheta, dv):
    sensed = np.hypot(dtheta[1], dtheta[2]) / 0.01, np.hypot(dv[1], dv[2]) / 0.01
    along, across, _ = process_noise.densities(record[0], 0.0, 1.0, sample_s, 0.01, dtheta, dv, sensed)
    return np.array(along + across)


def grown(rate, force=(0.0, 0.0, 0.0), sample_s=DT, **of_imu):
    """Densities of a turning body: of attitude and velocity along the roll axis, of both across it."""
    record = error_model.record(PARAMS._replace(imu=NOTHING._replace(**of_imu)))
    return _densities(record, sample_s, tuple(0.01 * np.array(rate)), tuple(0.01 * np.array(force)))


def rounding_errors(rate, noise):
    """Of the sum of what triads count in 10 s of a steady turn, in axes of its end, without random walk.

    noise : rad, of a sample -> (TRIALS, 3) rad
    """
    rng, turn, found = np.random.default_rng(8), np.array(rate) * DT, np.empty((TRIALS, 3))
    turned = np.array([rotation.dcm_from_rotvec(k * turn) for k in range(SAMPLES)])
    C = np.swapaxes(turned[-1].T @ turned, 1, 2)  # transposed: rows times this
    for k in range(TRIALS):
        true = turn + noise * rng.standard_normal((SAMPLES, 3))
        true[0] += QUANTUM * rng.uniform(size=3)
        counted = true.copy()
        imu.quantise(counted, QUANTUM)
        found[k] = ((counted - true)[:, None] @ C).sum(axis=(0, 1))
    return found


@pytest.mark.parametrize("rate", [SPIN, TUMBLE], ids=["spin", "tumble"])
def test_rounding_errors_of_noisy_counts_are_reported_and_grow(rate):
    """Noise of a quantum in each sample: the remainder is a new one each time. 300 triads, 4 sigma."""
    found = (rounding_errors(rate, QUANTUM) ** 2).mean(axis=0)
    of = momentary.of(PARAMS._replace(imu=NOTHING._replace(gyro_quantum=QUANTUM)))
    now = momentary.variances(of, 0.0)[1]
    assert now == pytest.approx(QUANTUM**2 / 12.0)
    along, _, across, _ = grown(rate, gyro_quantum=QUANTUM) * SAMPLES * DT
    assert found[0] == pytest.approx(now + along, rel=4.0 * np.sqrt(2.0 / TRIALS))
    assert found[1:].mean() == pytest.approx(now + across, rel=4.0 * np.sqrt(1.0 / TRIALS))
    assert across > 1.5 * now


@pytest.mark.parametrize("share", [0.1, 0.03, 0.01])
def test_remainders_that_stay_for_many_samples_grow_by_the_noise_that_mixes_them(share):
    """Noise of a sample far below a quantum: never less than there is, and at most 2.2 times as much."""
    noise = share * QUANTUM
    found = (rounding_errors(SPIN, noise)[:, 1:] ** 2).mean()
    walk = noise / np.sqrt(DT)
    _, _, across, _ = grown(SPIN, gyro_quantum=QUANTUM, gyro_random_walk=walk)
    told = (across - walk**2) * SAMPLES * DT + QUANTUM**2 / 12.0
    fresh = grown(SPIN, gyro_quantum=QUANTUM)[2] * SAMPLES * DT + QUANTUM**2 / 12.0
    assert 0.75 * found < told < 2.2 * found
    assert found > 2.0 * fresh


def test_a_rate_on_the_other_axes_mixes_remainders_sooner():
    """Spin with some quanta a sample across: no more than if each sample had a new one."""
    rate, noise = SPIN + np.array([0.0, 0.05, -0.04]), 0.03 * QUANTUM
    found = (rounding_errors(rate, noise)[:, 1:] ** 2).mean()
    told = grown(rate, gyro_quantum=QUANTUM, gyro_random_walk=noise / np.sqrt(DT))[2] - noise**2 / DT
    assert 0.8 * found < told * SAMPLES * DT + QUANTUM**2 / 12.0 < 3.5 * found


def test_the_sample_counts_and_not_the_piece_that_is_passed_through():
    """Remainders that are new each time: as many as there are samples."""
    once, twice = (grown(TUMBLE, sample_s=T, gyro_quantum=QUANTUM) for T in (DT, 2.0 * DT))
    np.testing.assert_allclose(twice, 2.0 * once)
    nav = quiet(gyro_quantum=QUANTUM, gyro_random_walk=0.0, gyro_cross=0.0, gyro_g_sensitivity=0.0)
    still = quiet(gyro_random_walk=0.0, gyro_cross=0.0, gyro_g_sensitivity=0.0)
    blocks = fly(0.2)[0]
    rates = np.array([block.dtheta_b.sum(axis=0) / (4.0 * DT) for block in blocks])
    across2 = rates[:, 0] ** 2 + 0.5 * (rates[:, 1:] ** 2).sum(axis=1)
    wanted = QUANTUM**2 / 12.0 * DT * 4.0 * DT * across2.sum()
    P = np.diag(nav.history.P - still.history.P)[ATT]
    assert P[1:].mean() == pytest.approx(wanted, rel=0.02)


def test_the_same_of_accelerometers():
    """The remainder of a velocity turns with the body as that of an angle."""
    of_gyro = grown(TUMBLE, gyro_quantum=1e-3)
    of_accel = grown(TUMBLE, accel_quantum=1e-3)
    assert of_gyro[0] > 0.0
    np.testing.assert_allclose(of_accel[[1, 3]], of_gyro[[0, 2]])
    assert not of_accel[[0, 2]].any()
    walk = {"accel_quantum": 1e-3, "accel_random_walk": 1e-4}
    at_rest, pushed = grown(SPIN, **walk), grown(SPIN, (0.0, 3.0, 4.0), **walk)
    assert pushed[3] - 1e-8 < 0.2 * (at_rest[3] - 1e-8)


def test_vibration_of_a_motor_takes_the_place_of_that_of_pad_and_coast():
    model = PARAMS.imu._replace(gyro_quantum=QUANTUM, gyro_vibration=1e-5, accel_vibration=0.3)
    of = momentary.of(PARAMS._replace(imu=model, swing_at_rest=COAST))
    rounding = QUANTUM**2 / 12.0
    assert momentary.variances(of, 0.0) == pytest.approx((COAST[1] ** 2, COAST[0] ** 2 + rounding))
    assert momentary.variances(of, 0.5) == pytest.approx((0.15**2, 25e-12 + rounding))


def test_what_is_reported_contains_them():
    """Covariance, sigmas and protection levels; the filter's own covariance does not."""
    nav = quiet(gyro_quantum=QUANTUM, accel_quantum=COUNT)
    added = COUNT**2 / 12.0 + COAST[1] ** 2, QUANTUM**2 / 12.0 + COAST[0] ** 2
    P, of = nav.history.P, solution.solution(nav)
    for told in (covariance.reported(nav), covariance.covariance(nav).P):
        for block, variance in ((VEL, added[0]), (ATT, added[1])):
            np.testing.assert_allclose(np.diag(told)[block] - np.diag(P)[block], variance, rtol=1e-9)
    np.testing.assert_allclose(of.sigma_theta_b**2, np.diag(P)[ATT] + added[1], rtol=1e-9)
    # nothing is known to the levels but the sigmas of the moment, so a level is so many of these
    nothing = nav._replace(constants=nav.constants._replace(momentary=momentary.NONE))
    without = solution.solution(nothing)
    for name, block, variance in (("attitude", ATT, added[1]), ("velocity", VEL, added[0])):
        level, least = getattr(of, f"protection_{name}"), getattr(without, f"protection_{name}")
        if name == "attitude":
            wider = np.sqrt(1.0 + variance / np.diag(P)[block])
            np.testing.assert_allclose(level / least, wider, rtol=1e-6)
        else:  # of worst directions, among which the variance on each axis is the same
            squares = (level**2 - least**2) / variance
            np.testing.assert_allclose(squares, (level**2 - least**2).mean() / variance, rtol=0.3)
            assert np.all(squares > 9.0)  # of some sigma


def test_the_rate_has_the_errors_of_both_ends_of_a_sample():
    """While a motor shakes: white noise, and twice the variance of the moment."""
    model = PARAMS.imu._replace(gyro_quantum=QUANTUM, gyro_vibration=1e-4)
    told = {}
    for name, imu_model in (("all", model), ("none", model._replace(gyro_quantum=0.0, gyro_vibration=0.0))):
        nav = fusion.start(PARAMS._replace(imu=imu_model), alignment(STATES[0]), EARTH)
        for block in fly(0.2)[0]:
            fusion.advance(nav, block)
        assert nav.history[-1].imu.vibration == 1.0
        told[name] = solution.solution(nav).sigma_omega_b ** 2
    wanted = 2.0 * (QUANTUM**2 / 12.0 + 1e-8) / DT**2
    np.testing.assert_allclose(told["all"] - told["none"], wanted, rtol=1e-3)


def now_of(nav):
    t_s = nav.history[-1].state.t_s
    return nav.history.moment(nav.history.within(t_s), 0.0, t_s)


def test_they_are_noise_of_a_star_fix():
    """Of the attitude, and of all stars together where each is taken by itself."""
    nav = quiet(gyro_quantum=QUANTUM)
    nav = nav._replace(params=nav.params._replace(star_fix_floor=1e-5))
    now, shared = now_of(nav), 1e-10 + QUANTUM**2 / 12.0 + COAST[0] ** 2
    stars = StarVectors(
        np.array([1, 2]), np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 0.995]]),
        np.tile(1e-12 * np.eye(2), (2, 1, 1)), np.eye(3)[:2], np.zeros(2), np.zeros((3, 3)), 0.0,
    )  # fmt: skip
    fix = StarFix._make([None] * len(StarFix._fields))._replace(
        t_valid_s=now.t_s, q_ic=STATES[20].q_ib, P_c=P_STAR_C, reason=Reason.NONE, stars=stars
    )
    _, _, R = sensors.SENSORS["star_tracker"].linearise(nav, now, fix)
    np.testing.assert_allclose(R, C_BC @ P_STAR_C @ C_BC.T + shared * np.eye(3), rtol=1e-9, atol=1e-20)
    _, _, R = sensors.SENSORS["star_vectors"].linearise(nav, now, fix)
    assert R[0, 0] == pytest.approx(1e-12 + shared, rel=1e-6)  # a star on the axis, across it
    assert abs(R[0, 2]) > 0.9 * shared * 0.99 or abs(R[0, 3]) > 0.9 * shared * 0.99


def test_they_are_noise_of_a_gps_velocity():
    nav = quiet(accel_quantum=COUNT, gyro_random_walk=0.0, gyro_cross=0.0, gyro_g_sensitivity=0.0)
    nav = nav._replace(params=nav.params._replace(l_ba_b=np.zeros(3)))
    R = measurements.arm_in_velocity(nav, now_of(nav), np.eye(3, nav.layout.n, VEL.start))
    np.testing.assert_allclose(R, (COUNT**2 / 12.0 + COAST[1] ** 2) * np.eye(3), rtol=1e-9, atol=1e-15)


def test_what_sensors_read_mixes_remainders_also_if_it_is_an_error_of_theirs():
    """A bias across the spin, estimated and taken out, of several quanta a sample."""
    bias, model = np.array([0.0, 0.05, 0.0]), QUIET._replace(gyro_quantum=QUANTUM, gyro_random_walk=1e-5)
    constants, Q = prediction.constants(layout(), noise_of(model), EARTH), {}
    for name, read in (("clean", np.zeros(3)), ("biased", bias)):
        increments = np.tile((SPIN + read) * DT, (4, 1))
        imu = window(ImuBlock(0.01, 0.01, DT, increments, np.zeros((4, 3)), False))
        state = STATES[0]._replace(gyro_bias=read)
        Q[name] = np.diag(prediction.growth(constants, layout(), state, imu, 0.0, 0.01).Q)[ATT]
    fresh = (12.0 * QUANTUM) ** 2 / 12.0 * DT + model.gyro_random_walk**2
    assert Q["biased"][1:].mean() == pytest.approx(0.01 * fresh, rel=1e-3)
    assert Q["clean"][1:].mean() > 1.5 * Q["biased"][1:].mean()
