"""What the rate of the IMU does to the velocity that is expected of the antenna: by many noisy samples."""

import numpy as np
import pytest
from navigation_flight import DT, EARTH, PARAMS, STATES, alignment, fly
from scipy.stats import chi2

from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation import fusion, measurements, momentary
from shefex_nav.onboard.navigation.state import POS, VEL, X_Q
from shefex_nav.onboard.navigation.strapdown import BEFORE

ARM = np.array([0.4, -1.2, 1.5])
WALK, QUANTUM, SWING = 1.5e-4, 1.2e-5, 8e-6  # rad/sqrt(s), rad, rad rms
BLOCKS, _ = fly(0.2)
T_S, N = BLOCKS[-2].t_valid_s, 4000  # the next tick is there


def filter_of(t_s=T_S, **of_imu):
    """A filter at the end of BLOCKS that was told no noise of the gyros but this, and its Moment of t_s."""
    told = {"gyro_random_walk": 0.0, "gyro_cross": 0.0, "gyro_g_sensitivity": 0.0} | of_imu
    params = PARAMS._replace(imu=PARAMS.imu._replace(**told), l_ba_b=ARM)
    nav = fusion.start(params, alignment(STATES[0]), EARTH)
    for block in BLOCKS:
        fusion.advance(nav, block)
    history = nav.history
    return nav, history.moment(history.within(t_s), 0.0, t_s)


def antenna(nav, now):
    args = nav.layout, now.x, now.t_s, EARTH, ARM, now.sensed_packed, now.vibration, now.drive
    return measurements.antenna(*args)


def around(nav, now):
    """Readings of the gyros in the last sample of a tick and in the first of the next, views of (3,)."""
    places = now.place, (now.place + 1) % len(nav.history.numbers)
    return nav.history.increments[places[0], BEFORE + 3, :3], nav.history.increments[places[1], BEFORE, :3]


def velocities(nav, now, readings):
    """Velocity of the antenna, (N, 3), with each of the readings (N, 2, 3) in the place of `around`."""
    kept, found = around(nav, now), []
    for reading in readings:
        kept[0][:], kept[1][:] = reading
        found.append(antenna(nav, now).v_e)
    return np.array(found)


def noisy(nav, now, walk=0.0, quantum=0.0, swing=0.0):
    """Readings (N, 2, 3) rad, in place of `around`, of rates that differ by less than a quantum; what is left
    of a quantum is carried on."""
    rng = np.random.default_rng(31)
    true = np.array(around(nav, now))
    angle = true + walk * np.sqrt(DT) * rng.standard_normal((N, 2, 3))
    angle += swing * np.diff(rng.standard_normal((N, 3, 3)), axis=1)
    if quantum:
        more = quantum * rng.uniform(size=(N, 2, 3))
        turned = rng.uniform(size=(N, 1, 3)) + np.cumsum((angle + more) / quantum, axis=1)
        angle = quantum * np.diff(np.floor(turned), axis=1, prepend=0.0) - more
    return angle


def is_of(samples, W):
    """Whether samples (N, 3) have the covariance W of rank 2, what is along the arm being none."""
    values, axes = np.linalg.eigh(W)
    assert values[0] < 1e-9 * values[2]
    along = (samples - samples.mean(axis=0)) @ axes
    assert np.abs(along[:, 0]).max() < 1e-6 * along[:, 2].std()
    found = (along[:, 1:] ** 2).sum(axis=0) / values[1:]
    assert np.all(chi2.ppf(0.0005, N) < found) and np.all(found < chi2.ppf(0.9995, N))
    assert abs(np.mean(along[:, 1] * along[:, 2])) < 4.0 * np.sqrt(values[1] * values[2] / N)


@pytest.mark.parametrize("t_s", [T_S, T_S - 0.5 * DT], ids=["two samples", "one sample"])
@pytest.mark.parametrize(
    "noise",
    [{"walk": WALK}, {"walk": 0.5 * WALK, "quantum": QUANTUM}, {"swing": SWING}],
    ids=["random walk", "quantum", "vibration"],
)
def test_noise_of_the_rate_is_that_of_the_antenna(noise, t_s):
    names = {"walk": "gyro_random_walk", "quantum": "gyro_quantum", "swing": "gyro_vibration"}
    nav, now = filter_of(t_s, **{names[name]: value for name, value in noise.items()})
    now.vibration = 1.0 if "swing" in noise else 0.0
    H = antenna(nav, now).J_v
    is_of(velocities(nav, now, noisy(nav, now, **noise)), measurements.arm_in_velocity(nav, now, H))


def test_the_rate_is_that_of_the_instant():
    """Under a constant angular acceleration, wherever the instant lies: exactly, and from the last sample
    half a sample late, which is charged."""
    alpha, begin = np.array([3.0, -20.0, 35.0]), BLOCKS[-1].t_valid_s - 8 * DT
    for past in (0.5, 2.2, 3.5, 3.8, 4.0, 4.4, 6.0, 8.0):
        nav, now = filter_of(begin + past * DT)
        numbers, increments = nav.history.numbers, nav.history.increments
        for tick in range(2):
            place = (nav.history.newest - 1 + tick) % len(numbers)
            middles = np.arange(-BEFORE, 4)[:, None] + 0.5 + 4 * tick
            increments[place, :, :3] = DT * (0.1 + alpha * middles * DT)
        late = now.sensed[0] - (0.1 + alpha * past * DT)
        W = measurements.arm_in_velocity(nav, now, np.eye(3, nav.layout.n, VEL.start))
        if past < 8.0:
            assert np.abs(late).max() < 1e-9 and not W.any()
            continue
        np.testing.assert_allclose(late, -0.5 * alpha * DT, rtol=1e-9)
        missed = rotation.dcm_from_quat(now.x[X_Q]) @ np.cross(late, ARM)
        np.testing.assert_allclose(W, np.outer(missed, missed), rtol=1e-6, atol=1e-12)


def test_an_error_that_is_no_state_counts_in_full():
    """Scale factors and misalignments that are not estimated: s of the rate across the roll axis."""
    nav, now = filter_of(gyro_cross=1e-3)
    omega_b, C_ib = now.sensed[0], rotation.dcm_from_quat(now.x[X_Q])
    arm = C_ib @ rotation.skew(ARM)
    expected = (1e-3 * np.linalg.norm(omega_b[1:])) ** 2 * arm @ arm.T
    C_ei = frames.dcm_ie(EARTH, T_S).T
    found = measurements.arm_in_velocity(nav, now, antenna(nav, now).J_v)
    np.testing.assert_allclose(found, C_ei @ expected @ C_ei.T, rtol=1e-6, atol=1e-12)


def test_a_gyro_that_is_not_read_leaves_the_antenna_unknown():
    """An axis that is stuck has any rate, one at the end of its range what it may miss."""
    nav, now = filter_of()
    rules = nav.watch.params.imu._replace(
        range=np.array([10.0, 500.0]), wrong=np.array([2.0, 9.0]), missed=np.array([7.0, 9.0])
    )
    nav.watch.params = nav.watch.params._replace(imu=rules)
    nav.history.extra[now.place, 0] = 0.0, 0.1, 0.1
    nav.history.increments[now.place, BEFORE + 1, 2] = -10.0 * DT
    C_eb = frames.dcm_ie(EARTH, T_S).T @ rotation.dcm_from_quat(now.x[X_Q])
    spread = C_eb @ np.cross(np.diag([0.0, 2.0, 7.0]), ARM).T
    found = measurements.arm_in_velocity(nav, now, antenna(nav, now).J_v)
    np.testing.assert_allclose(found, spread @ spread.T, rtol=1e-6, atol=1e-9)


def test_vibration_swings_the_velocity_of_the_sensors():
    nav, now = filter_of(accel_vibration=0.3)
    now.vibration = 0.5
    found = measurements.arm_in_velocity(nav, now, antenna(nav, now).J_v)
    np.testing.assert_allclose(found, 0.15**2 * np.eye(3), rtol=1e-9, atol=1e-9)


def test_vibration_without_a_motor_swings_them_too():
    """As told of pad and coast: the velocity of the sensors, and the rate at the end of the arm."""
    angle, velocity = 2e-5, 0.02
    nav, now = filter_of()
    now.vibration = 0.0
    params = nav.params._replace(swing_at_rest=np.array([angle, velocity]))
    nav = nav._replace(constants=nav.constants._replace(momentary=momentary.of(params)))
    arm = rotation.dcm_from_quat(now.x[X_Q]) @ rotation.skew(ARM)
    rate2 = 2.0 * (angle / (2.0 * DT)) ** 2  # of the mean of two samples
    found = measurements.arm_in_velocity(nav, now, np.eye(3, nav.layout.n, VEL.start))
    np.testing.assert_allclose(found, velocity**2 * np.eye(3) + rate2 * arm @ arm.T, rtol=1e-6, atol=1e-9)
    now.vibration = 1.0  # a motor's takes its place
    assert np.abs(measurements.arm_in_velocity(nav, now, np.eye(3, nav.layout.n, VEL.start))).max() < 1e-9


def test_a_sample_beside_that_was_not_read_is_left_out():
    """Before the instant and after it: what the rate may be off by is charged, from the other side."""
    for ticks, past in ((-1, 0.1), (1, 3.9)):
        nav, now = filter_of(T_S - 4 * DT + past * DT)
        history = nav.history
        history.increments[now.place, BEFORE - 1 : BEFORE + 4, :3] = DT * np.arange(5.0)[:, None]
        history.extra[(history.number(now.k) + ticks) % len(history.numbers), 0] = 0.1
        about = now.about()
        own = history.increments[now.place, BEFORE + (0 if ticks < 0 else 3)]
        assert about.share == 0.0 and np.array_equal(about.increments, own)
        np.testing.assert_allclose(about.missed[:3], ticks * 0.4 * DT)


def test_the_next_tick_may_have_longer_samples():
    nav, now = filter_of()
    place = (now.place + 1) % len(nav.history.numbers)
    nav.history.numbers[place, 1] *= 2.0
    nav.history.increments[place, BEFORE, :3] = 2.0 * DT * 0.5
    nav.history.increments[now.place, BEFORE + 3, :3] = DT * 0.3
    np.testing.assert_allclose(now.about().increments[:3], DT * 0.4)


def test_all_rows_see_the_same_antenna():
    """Rows of single satellites: what they share is the antenna's velocity along each line of sight."""
    nav, now = filter_of(gyro_random_walk=WALK)
    J, u = antenna(nav, now).J_v, np.random.default_rng(3).standard_normal((6, 3))
    found = measurements.arm_in_velocity(nav, now, u @ J)
    np.testing.assert_allclose(
        found, u @ measurements.arm_in_velocity(nav, now, J) @ u.T, rtol=1e-9, atol=1e-18
    )
    assert np.linalg.matrix_rank(found, tol=1e-12) == 2


def test_a_known_attitude_says_where_the_antenna_is():
    nav, now = filter_of(gyro_random_walk=WALK)
    assert not measurements.arm_in_position(nav, now, antenna(nav, now).J_r).any()
    now.P[8, 8] = 1.0  # rad^2, of the heading
    J = antenna(nav, now)
    assert np.linalg.eigvalsh(measurements.arm_in_position(nav, now, J.J_r))[0] > 0.0
    assert np.allclose(J.J_r[:, POS], J.J_v[:, VEL])
