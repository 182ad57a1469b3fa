"""The mean rate of an exposure, against the motion that the sensors were given and against the filter."""

import numpy as np
import pytest
from navigation_flight import C_BC, DEG, DT, EARTH, PARAMS, alignment, fly, motion
from scipy.stats import chi2
from unpacked import correct

from shefex_nav.geometry import rotation
from shefex_nav.geometry.unsteady import mean_rotation
from shefex_nav.onboard.navigation import fusion, mean_rate, solution
from shefex_nav.onboard.navigation.calibration import NO_DRIVE
from shefex_nav.onboard.navigation.state import BG, layout, pack

BLOCKS, STATES = fly(1.5)
LAYOUT = layout()
ROLL, MOUNT, N_ERROR = LAYOUT.places["gyro_roll_column"], LAYOUT.places["mounting"], LAYOUT.n
T_S = 1.5
BEGIN_S, END_S = 1.2034, 1.2871  # neither on a tick nor on a sample


def filter_after(blocks=BLOCKS, params=PARAMS):
    nav = fusion.start(params, alignment(STATES[0]), EARTH)
    for block in blocks:
        fusion.advance(nav, block)
    return nav


def camera_rate(nav, tick, C_bc, begin_s, end_s):
    history, imu = nav.history, tick.imu
    of_imu = (0.0, NO_DRIVE) if imu is None else (imu.vibration, imu.drive)
    estimates = mean_rate.Estimates(tick.x, tick.P, *of_imu)
    ticks, interval_s = (history.oldest, history.newest), (begin_s, end_s, 0.5 * (begin_s + end_s))
    known, *of_rate, turned, variance = mean_rate.camera_rate(
        nav.constants, history.arrays, ticks, estimates, C_bc, interval_s
    )
    return (*of_rate, turned, variance) if known else (None,) * 4


def true_mean(begin_s, end_s):
    nodes, weights = np.polynomial.legendre.leggauss(20)
    half = 0.5 * (end_s - begin_s)
    return 0.5 * sum(w * motion(begin_s + half * (1.0 + x))[0] for x, w in zip(nodes, weights, strict=True))


@pytest.mark.parametrize("begin_s, end_s", [(BEGIN_S, END_S), (1.2, 1.25), (1.2011, 1.2012), (0.95, 1.5)])
def test_the_mean_of_the_motion_in_camera_axes(begin_s, end_s):
    nav = filter_after()
    mounting = np.array([0.01, -0.02, 0.03])
    C_bc = rotation.dcm_from_rotvec(mounting) @ C_BC
    omega_c, P, *_ = camera_rate(nav, nav.history[-1], C_bc, begin_s, end_s)
    np.testing.assert_allclose(C_bc @ omega_c, true_mean(begin_s, end_s), atol=3e-6)
    assert np.all(np.linalg.eigvalsh(P) > 0.0)


def test_how_the_motion_differs_from_its_mean_rate():
    """The true angle since the middle, less that of the mean rate, by quadrature; in camera axes."""
    nav = filter_after()
    omega_c, _, turned, variance = camera_rate(nav, nav.history[-1], C_BC, BEGIN_S, END_S)
    middle_s = 0.5 * (BEGIN_S + END_S)
    assert turned[0, 0] == pytest.approx(BEGIN_S - middle_s) and turned[-1, 0] == pytest.approx(
        END_S - middle_s
    )
    for at_s, *vector in turned:
        angle = at_s * true_mean(middle_s, middle_s + at_s) if at_s else np.zeros(3)
        np.testing.assert_allclose(C_BC @ vector, angle - at_s * (C_BC @ omega_c), atol=2e-7)
    assert np.abs(turned[:, 1:]).max() > 5e-6
    N, quantum = PARAMS.imu.gyro_random_walk, PARAMS.imu.gyro_quantum
    assert variance == pytest.approx(N**2 * (END_S - BEGIN_S) / 12.0 + quantum**2 / 12.0)


def test_estimated_gyro_errors_are_taken_out():
    """measured = (I + k e_x^T) omega + b, written out."""
    k, bias = np.array([2e-3, -1e-3, 3e-3]), np.array([1e-3, -2e-3, 5e-4])
    blocks = [
        block._replace(dtheta_b=block.dtheta_b + block.dtheta_b[:, :1] * k + bias * DT) for block in BLOCKS
    ]
    nav = filter_after(blocks)
    tick = nav.history[-1]
    tick = tick._replace(x=pack(tick.state._replace(gyro_bias=bias, gyro_roll_column=k)))
    omega_c, *_ = camera_rate(nav, tick, C_BC, BEGIN_S, END_S)
    np.testing.assert_allclose(C_BC @ omega_c, true_mean(BEGIN_S, END_S), atol=3e-6)


@pytest.mark.parametrize(
    "error", [*range(BG.start, BG.stop), *range(ROLL.start, ROLL.stop), *range(18, 21), 7]
)
def test_covariance_is_that_of_errors_put_into_the_state(error):
    """One error state at a time; truth = estimate (+) error. An attitude error moves no rate."""
    assert range(18, 21) == range(MOUNT.start, MOUNT.stop)
    nav, size = filter_after(), 1e-5
    tick, dx = nav.history[-1], np.zeros(N_ERROR)
    dx[error] = size

    def rate(of):
        C_bc = rotation.dcm_from_rotvec(of.mounting) @ C_BC
        return camera_rate(nav, tick._replace(x=pack(of)), C_bc, BEGIN_S, END_S)

    nothing = np.zeros((N_ERROR, N_ERROR))
    quiet = camera_rate(nav, tick._replace(P=nothing), C_BC, BEGIN_S, END_S)[1]
    P = camera_rate(nav, tick._replace(P=np.outer(dx, dx)), C_BC, BEGIN_S, END_S)[1] - quiet
    change = rate(correct(LAYOUT, tick.state, dx))[0] - rate(tick.state)[0]
    np.testing.assert_allclose(P, np.outer(change, change), atol=2e-4 * size**2 + 1e-16)


def test_over_one_sample_it_is_as_sure_as_the_solution():
    """sigma_omega of the last sample, where the mounting is known and the body turns about its roll axis."""
    model = PARAMS.imu._replace(gyro_quantum=1e-6, gyro_cross=0.0, gyro_g_sensitivity=0.0)
    nav = filter_after(params=PARAMS._replace(imu=model))
    tick = nav.history[-1]
    P = tick.P.copy()
    P[MOUNT], P[:, MOUNT] = 0.0, 0.0
    _, P_c, *_ = camera_rate(nav, tick._replace(P=P), C_BC, T_S - DT, T_S)
    sigma = np.sqrt(np.diag(C_BC @ P_c @ C_BC.T))
    np.testing.assert_allclose(sigma, solution.solution(nav).sigma_omega_b, rtol=1e-6)
    _, longer, *_ = camera_rate(nav, tick._replace(P=P), C_BC, T_S - 16 * DT, T_S)
    # over sixteen times the time white noise falls to 1/16, what the two ends are rounded by to 1/256
    white, ends = model.gyro_random_walk**2 / DT, model.gyro_quantum**2 / 6.0 / DT**2
    quieter = 3.0 * (white * (1.0 - 1.0 / 16.0) + ends * (1.0 - 1.0 / 256.0))
    assert np.trace(P_c) - np.trace(longer) == pytest.approx(quieter, rel=1e-6)


def test_errors_are_as_large_as_their_covariance_says():
    """Bias, roll column, mounting and noise drawn from what the filter assumes: 400 draws of chi-square."""
    rng, nees, means = np.random.default_rng(8), [], []
    density = PARAMS.imu.gyro_random_walk
    nav = filter_after()
    tick = nav.history[-1]
    sigma = np.sqrt(np.diag(tick.P))
    true_c = C_BC.T @ true_mean(BEGIN_S, END_S)
    imu = [nav.history.imu(k) for k in range(len(nav.history))]
    for _ in range(400):
        dx = np.where(np.arange(N_ERROR) >= BG.start, sigma, 0.0) * rng.standard_normal(N_ERROR)
        for k, window in enumerate(imu):
            noise = density * np.sqrt(DT) * rng.standard_normal((4, 3))
            felt = window.dtheta_b + window.dtheta_b[:, :1] * dx[ROLL] + dx[BG] * DT + noise
            nav.history.increments[nav.history.place(k), 2:, :3] = felt
        C_bc = rotation.dcm_from_rotvec(-dx[MOUNT]) @ C_BC  # the estimate; the true one is C_BC
        P = np.zeros((N_ERROR, N_ERROR))
        P[BG.start :, BG.start :] = np.diag(sigma[BG.start :] ** 2)
        omega_c, P_c, turned, variance = camera_rate(nav, tick._replace(P=P), C_bc, BEGIN_S, END_S)
        error = true_c - omega_c
        nees.append(error @ np.linalg.solve(P_c, error))
        means.append(mean_rotation(turned, turned[0, 0], turned[-1, 0]))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * 400) / 400
    # the scale factors across the roll axis and the g-sensitivity, which nothing here makes, are in P_c too
    assert 0.9 * low < np.mean(nees) < high
    # the mean of a random walk over an interval, less its value in the middle and a linear part: N^2 T / 12;
    # 1200 draws, 5 sigma of their variance; the quantum, which nothing here makes, is in it too
    white = variance - PARAMS.imu.gyro_quantum**2 / 12.0
    assert np.var(means, axis=0).mean() == pytest.approx(white, rel=5.0 * np.sqrt(2.0 / 1200.0))


def test_no_rate_without_samples():
    nav = filter_after()
    tick = nav.history[-1]
    for begin_s, end_s in ((0.5, 0.6), (1.4, 1.51), (1.3, 1.3)):
        assert camera_rate(nav, tick, C_BC, begin_s, end_s) == (None,) * 4
    started = fusion.start(PARAMS, alignment(STATES[0]), EARTH)
    assert camera_rate(started, started.history[0], C_BC, -0.05, 0.0) == (None,) * 4


def test_a_gyro_at_its_range_knows_no_rate():
    blocks = [*BLOCKS[:-20], *(block._replace(saturated=True) for block in BLOCKS[-20:])]
    nav = filter_after(blocks)
    _, before, *_ = camera_rate(nav, nav.history[-1], C_BC, 1.20, 1.25)
    _, during, turned, variance = camera_rate(nav, nav.history[-1], C_BC, 1.29, 1.34)
    assert np.sqrt(np.trace(before)) < 0.2 * DEG
    assert np.sqrt(np.diag(during)).min() > 0.99 * PARAMS.imu.saturated_rate
    assert turned.shape == (0, 4) and np.isnan(variance)
