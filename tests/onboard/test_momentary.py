"""Errors of the moment: what is left of a count, and what vibration swings, with a motor and without."""

import numpy as np
import pytest
from navigation_flight import C_BC, DT, EARTH, P_STAR_C, PARAMS, STATES, alignment, fly

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import covariance, error_model, fusion, momentary, sensors, solution
from shefex_nav.onboard.navigation.state import ATT, VEL
from shefex_nav.records import Reason, StarFix
from shefex_nav.world import imu

QUANTUM, COUNT = 2.4e-5, 6e-4  # rad, m/s
REST = np.array([3e-6, 2e-4])  # rad, m/s rms
TRIALS, SAMPLES, RATE = 400, 4000, np.array([12.0, 1.5, -2.0])  # 10 s in rad/s


def quiet(**of_imu):
    """A filter after 0.2 s in which no motor counts as burning."""
    model = PARAMS.imu._replace(thrust_threshold=np.inf, **of_imu)
    params = PARAMS._replace(imu=model, swing_at_rest=REST)
    nav = fusion.start(params, alignment(STATES[0]), EARTH)
    for block in fly(0.2)[0]:
        fusion.advance(nav, block)
    return nav


@kernel
def _densities(record, sample_s, dtheta):
    zero = (0.0, 0.0, 0.0)
    along, across, _ = error_model.noise_densities(record[0], 0.0, 1.0, sample_s, 0.01, dtheta, zero)
    return np.array(along + across)


def test_counts_of_a_spinning_triad_leave_what_is_reported_and_what_grows():
    """Many triads count the same turn: error of the sum, turned as the body turns, in axes of the end."""
    rng, turn = np.random.default_rng(8), RATE * DT
    attitudes = [np.eye(3)]
    for _ in range(SAMPLES - 1):
        attitudes.append(attitudes[-1] @ rotation.dcm_from_rotvec(turn))
    C = np.swapaxes(attitudes[-1].T @ np.array(attitudes), 1, 2)  # transposed: rows times this
    off = np.empty((TRIALS, 3))
    for k in range(TRIALS):
        true = turn + QUANTUM * rng.standard_normal((SAMPLES, 3))
        true[0] += QUANTUM * rng.uniform(size=3)
        counted = true.copy()
        imu.quantise(counted, QUANTUM)
        off[k] = ((counted - true)[:, None] @ C).sum(axis=(0, 1))
    model = PARAMS.imu._replace(**dict.fromkeys(PARAMS.imu._fields, 0.0))._replace(gyro_quantum=QUANTUM)
    record = error_model.record(PARAMS._replace(imu=model))
    grown = _densities(record, DT, tuple(0.01 * RATE))[[0, 2, 2]] * SAMPLES * DT
    left = momentary.variances(momentary.of(PARAMS._replace(imu=model)), 0.0)[1]
    assert left == pytest.approx(QUANTUM**2 / 12.0)
    found = (off**2).mean(axis=0)
    assert found[0] == pytest.approx(left + grown[0], rel=0.28)  # 4 sigma
    assert found[1:].mean() == pytest.approx(left + grown[1], rel=0.2)
    assert grown[1] > 2.5 * left


def test_the_same_of_accelerometers():
    """What is left of a velocity turns with the body as what is left of an angle."""
    model = PARAMS.imu._replace(**dict.fromkeys(PARAMS.imu._fields, 0.0))
    of_gyro, of_accel = (
        _densities(
            error_model.record(PARAMS._replace(imu=model._replace(**{name: 1e-3}))), DT, tuple(0.01 * RATE)
        )
        for name in ("gyro_quantum", "accel_quantum")
    )
    assert of_gyro[0] > 0.0
    np.testing.assert_allclose(of_accel[[1, 3]], of_gyro[[0, 2]])
    assert not of_accel[[0, 2]].any()


def test_vibration_of_a_motor_takes_the_place_of_that_at_rest():
    model = PARAMS.imu._replace(gyro_quantum=QUANTUM, gyro_vibration=1e-5, accel_vibration=0.3)
    of = momentary.of(PARAMS._replace(imu=model, swing_at_rest=REST))
    left = QUANTUM**2 / 12.0
    assert momentary.variances(of, 0.0) == pytest.approx((REST[1] ** 2, REST[0] ** 2 + left))
    assert momentary.variances(of, 0.5) == pytest.approx((0.15**2, 25e-12 + left))


def test_what_is_reported_contains_them_at_rest():
    """Covariance, sigmas and protection levels; the filter's own covariance does not."""
    own = quiet()
    nav = quiet(gyro_quantum=QUANTUM, accel_quantum=COUNT)
    added = COUNT**2 / 12.0 + REST[1] ** 2, QUANTUM**2 / 12.0 + REST[0] ** 2
    P = nav.history.P
    for told in (covariance.reported(nav), covariance.covariance(nav).P):
        for block, variance in ((VEL, added[0]), (ATT, added[1])):
            np.testing.assert_allclose(np.diag(told)[block] - np.diag(P)[block], variance, rtol=1e-9)
    of = solution.solution(nav)
    np.testing.assert_allclose(of.sigma_theta_b**2, np.diag(P)[ATT] + added[1], rtol=1e-9)
    without = solution.solution(own)
    assert (of.protection_velocity > without.protection_velocity).all()
    assert (of.protection_attitude > without.protection_attitude).all()


def test_they_are_noise_of_a_star_fix():
    nav = quiet(gyro_quantum=QUANTUM)
    nav = nav._replace(params=nav.params._replace(star_fix_floor=1e-5))
    t_s = nav.history[-1].state.t_s
    now = nav.history.moment(nav.history.within(t_s), 0.0, t_s)
    fix = StarFix._make([None] * len(StarFix._fields))._replace(
        t_valid_s=t_s, q_ic=STATES[20].q_ib, P_c=P_STAR_C, reason=Reason.NONE
    )
    _, _, R = sensors.SENSORS["star_tracker"].linearise(nav, now, fix)
    shared = 1e-10 + QUANTUM**2 / 12.0 + REST[0] ** 2
    np.testing.assert_allclose(R, C_BC @ P_STAR_C @ C_BC.T + shared * np.eye(3), rtol=1e-9, atol=1e-20)
