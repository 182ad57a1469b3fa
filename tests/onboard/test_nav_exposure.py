"""What an exposure during which the rate changes does to the attitude that stars show."""

from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import PARAMS
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation
from unpacked import FALLING

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import fusion, momentary, sensors
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.state import X_Q, layout
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.records import NO_STARS, StarFix, StarVectors

DT, SAMPLES, TICKS = 0.0025, 4, 20
T = 0.05  # s, exposure
A = np.radians([2.0, -3.0, 5.0])  # rad/s^2
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def moment(rate_b, t_s=0.1):
    """The Moment at t_s of a vehicle with the body rate rate_b(t), attitude and state in the middle: none."""
    x = np.zeros_like(FALLING)
    x[X_Q.start] = 1.0
    history = History(Tick(0.0, x, np.eye(15), None))
    for k in range(1, TICKS + 1):
        place, end_s = history.make_room(SAMPLES), k * SAMPLES * DT
        history.numbers[place, :3] = end_s, DT, SAMPLES
        for m in range(SAMPLES):
            begin_s = end_s - (SAMPLES - m) * DT
            history.increments[place, BEFORE + m, :3] = quad_vec(rate_b, begin_s, begin_s + DT)[0]
        history.extend([end_s])
    return history.moment(history.within(t_s), 0.0, t_s)


@pytest.mark.parametrize("t_s", [0.1, 0.1 + 0.3 * DT, 0.0931])
def test_constant_acceleration(t_s):
    """a T^2/24; the rate within a sample is taken as constant: at most 2 (h/T)^2 of it."""
    bend = moment(lambda t: 0.3 + A * t, t_s).bend(T)
    np.testing.assert_allclose(bend, A * T**2 / 24.0, rtol=6e-3)


def test_a_steady_rate_shows_the_middle():
    assert np.abs(moment(lambda t: np.array([9.0, 0.1, -0.2])).bend(T)).max() < 1e-15


def test_what_is_not_remembered_is_taken_as_steady():
    assert not moment(lambda t: A * t, 0.1).bend(0.3).any()  # it begins before the memory does
    assert not moment(lambda t: A * t, 0.19).bend(T).any()  # it ends after it


def turned(t_s, rate_b, middle_s=0.1):
    """Rotation vector since the middle, turns about one axis at a time are small: the integral."""
    return quad_vec(rate_b, middle_s, t_s)[0]


def tumbling(t):
    return np.radians([0.1, 2.0 * np.sin(9.0 * t), 1.5 * np.cos(9.0 * t)])


def mean_turn():
    return quad_vec(lambda t: turned(t, tumbling), 0.1 - T / 2, 0.1 + T / 2)[0] / T


TOLD = PARAMS._replace(C_bc=C_BC, imu=PARAMS.imu._replace(gyro_random_walk=8e-6, gyro_quantum=5e-7))
NAV = SimpleNamespace(layout=layout(()), params=TOLD, constants=SimpleNamespace(momentary=momentary.of(TOLD)))


def fix(exposure_s, stars=NO_STARS):
    """StarFix of a camera that shows the mean attitude of the exposure."""
    q_ib = rotation.quat_from_rotvec(mean_turn())
    q_ic = rotation.quat_multiply(q_ib, rotation.quat_from_dcm(C_BC))
    P_c = 1e-12 * np.eye(3)
    return StarFix(0, 0.1, 0.2, 0, q_ic, P_c, None, None, 0.0, 0.0, exposure_s, False, False, stars=stars)


def seen(now, one, arrival="star_tracker"):
    """The fix as the filter takes it."""
    return sensors.straightened(SimpleNamespace(**NAV.__dict__, history=now.history), arrival, now.k, one)


def test_attitudes_are_those_of_the_middle():
    now, off = moment(tumbling), np.abs(mean_turn()).max()
    z, _, R = sensors._star_attitude(NAV, now, seen(now, fix(T)))
    assert off > 8e-6 and np.abs(z).max() < 0.01 * off  # 2"
    assert 0.1 * off < np.sqrt(R[1, 1]) < 0.3 * off
    z, _, _ = sensors._star_attitude(NAV, now, seen(now, fix(0.0)))  # nothing is known of the exposure
    assert np.abs(z).max() == pytest.approx(off, rel=1e-3)


def test_single_stars_are_where_they_were_in_the_middle():
    now = moment(tumbling)
    u_c = np.array([[0.05, -0.03, 1.0], [-0.08, 0.02, 1.0]])
    u_c /= np.linalg.norm(u_c, axis=1)[:, None]
    C_ic = Rotation.from_rotvec(mean_turn()).as_matrix() @ C_BC
    P_u = np.tile(1e-12 * np.eye(2), (2, 1, 1))
    stars = StarVectors(np.array([1, 2]), u_c, P_u, u_c @ C_ic.T, np.zeros(2), np.zeros((3, 3)), 0.0)
    z, _, R = sensors._star_vectors(NAV, now, seen(now, fix(T, stars), "star_vectors"))
    raw, _, _ = sensors._star_vectors(NAV, now, seen(now, fix(0.0, stars), "star_vectors"))
    assert np.abs(raw).max() > 5e-6 and np.abs(z).max() < 0.01 * np.abs(raw).max()
    assert np.all(np.linalg.eigvalsh(R) > 1e-12)


def test_noise_of_the_gyros_is_not_taken_for_a_turn():
    """At a steady rate the fix is what it was, but for one in a thousand."""
    rng, changed, one = np.random.default_rng(4), 0, fix(T)
    now = moment(lambda t: np.array([0.3, 0.1, -0.2]))
    read, steady = now.history.increments[:, :, :3], now.history.increments[:, :, :3].copy()
    for _ in range(400):
        read[:] = steady + NAV.params.imu.gyro_random_walk * np.sqrt(DT) * rng.standard_normal(steady.shape)
        changed += seen(now, one) is not one
    assert changed <= 4  # 0.4 are to be expected; 5 in one of 16 000 tests


def test_a_turn_is_seen_above_the_noise():
    """Below what noise makes nothing happens; above it the fix is straightened."""
    noise = np.sqrt(NAV.params.imu.gyro_random_walk**2 * T / 12.0 + NAV.params.imu.gyro_quantum**2 / 12.0)
    for size, is_seen in ((3.0, False), (6.0, True)):
        rate = np.array([0.0, 0.0, size * noise * 24.0 / T**2])
        one = fix(T)
        assert (seen(moment(lambda t, rate=rate: rate * t), one) is not one) == is_seen


def test_a_fix_of_its_instant_stays_as_it_is():
    """The star tracker has taken the turn out itself: twice would be as wrong as not at all."""
    now = moment(tumbling)
    nav = SimpleNamespace(**NAV.__dict__, history=now.history, sensors=sensors.SENSORS)
    for straight in (True, False):
        one = fix(T)._replace(straight=straight)
        _, taken = fusion._worth_trying(nav, "star_tracker", one, now.k, [])
        assert (taken is one) == straight
