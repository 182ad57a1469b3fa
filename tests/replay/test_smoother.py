"""The smoother against least squares over all data at once, filterpy's RTS, and an attitude toy."""

import numpy as np
import pytest
import slow_smoother
from scipy.stats import chi2

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.state import right_jacobian
from shefex_nav.replay import relinear, smoother

N_STEPS, N = 25, 4
FORGOTTEN_AT, BLOCK = 11, slice(0, 2)  # the block is drawn anew there


def problem(rng):
    """A stable random chain: Phi, Q (singular), P0, and H, R, z of every second step."""
    Phi = [np.eye(N) + 0.2 * rng.standard_normal((N, N)) for _ in range(N_STEPS)]
    root = [np.vstack([rng.standard_normal((N - 1, N)), np.zeros((1, N))]).T for _ in range(N_STEPS)]
    Q = [0.1 * B @ B.T for B in root]
    P0 = np.diag([4.0, 1.0, 0.3, 2.0])
    measured = {
        k: (rng.standard_normal((2, N)), np.diag(rng.uniform(0.1, 2.0, 2))) for k in range(1, N_STEPS + 1, 2)
    }
    x = np.linalg.cholesky(P0) @ rng.standard_normal(N)
    z = {}
    for k in range(N_STEPS):
        x = Phi[k] @ x + np.linalg.cholesky(Q[k] + 1e-15 * np.eye(N)) @ rng.standard_normal(N)
        if k + 1 in measured:
            H, R = measured[k + 1]
            z[k + 1] = H @ x + np.sqrt(np.diag(R)) * rng.standard_normal(2)
    return Phi, Q, P0, measured, z


def with_forgetting(Phi, Q, at):
    """The transition after which a block is a new draw of sigma 3, as matrices of a step."""
    A = np.eye(N)
    A[BLOCK] = 0.0
    Q_new = np.zeros((N, N))
    Q_new[BLOCK, BLOCK] = 9.0 * np.eye(2)
    Phi, Q = list(Phi), list(Q)
    Phi[at], Q[at] = A @ Phi[at], A @ Q[at] @ A.T + Q_new
    return Phi, Q


def closed_loop(Phi, Q, P0, measured, z, forget_at=None):
    """Filter whose estimate is corrected at once, then the smoother. -> (N_STEPS + 1, N), (.., N, N)"""
    x, P = np.zeros(N), P0
    steps, filtered = [], [(x, P)]
    for k in range(N_STEPS):
        x, P = Phi[k] @ x, Phi[k] @ P @ Phi[k].T + Q[k]
        own = [("interval", Phi[k])]
        if forget_at == k:
            x, P = x.copy(), P.copy()
            x[BLOCK], P[BLOCK], P[:, BLOCK] = 0.0, 0.0, 0.0
            P[BLOCK, BLOCK] = 9.0 * np.eye(2)
            own.append(("forget", None))
        if k + 1 in measured:
            H, R = measured[k + 1]
            residual = z[k + 1] - H @ x
            own.append(("update", (P, residual, H, R)))
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x, P = x + K @ residual, (np.eye(N) - K @ H) @ P
        steps.append(own)
        filtered.append((x, P))
    adjoint, means, covariances = slow_smoother.at_the_end(N), [], []
    for (x, P), own in zip(filtered[::-1], [*steps[::-1], []], strict=True):
        e, P_s = slow_smoother.smoothed(adjoint, P)
        means.append(x + e)
        covariances.append(P_s)
        for kind, what in own[::-1]:
            if kind == "update":
                adjoint = slow_smoother.before_update(adjoint, *what)
            elif kind == "forget":
                adjoint = slow_smoother.before_forgetting(adjoint, BLOCK)
            else:
                adjoint = slow_smoother.before_interval(adjoint, what)
    return np.array(means[::-1]), np.array(covariances[::-1])


def least_squares(Phi, Q, P0, measured, z):
    """Conditional mean and covariance of the whole history, by the joint Gaussian of states and data."""
    size = (N_STEPS + 1) * N
    C = np.zeros((size, size))  # prior covariance of the stacked states
    C[:N, :N] = P0
    for k in range(N_STEPS):
        a, b = slice(k * N, (k + 1) * N), slice((k + 1) * N, (k + 2) * N)
        C[b, : b.start] = Phi[k] @ C[a, : b.start]
        C[: b.start, b] = C[b, : b.start].T
        C[b, b] = Phi[k] @ C[a, a] @ Phi[k].T + Q[k]
    H_all = np.zeros((2 * len(z), size))
    R_all = np.zeros((2 * len(z), 2 * len(z)))
    for row, k in enumerate(sorted(z)):
        rows = slice(2 * row, 2 * row + 2)
        H_all[rows, k * N : (k + 1) * N], R_all[rows, rows] = measured[k]
    K = np.linalg.solve(H_all @ C @ H_all.T + R_all, H_all @ C).T
    mean = K @ np.concatenate([z[k] for k in sorted(z)])
    P = C - K @ H_all @ C
    blocks = [P[k * N : (k + 1) * N, k * N : (k + 1) * N] for k in range(N_STEPS + 1)]
    return mean.reshape(-1, N), np.array(blocks)


@pytest.mark.parametrize("seed", range(4))
def test_equals_least_squares_over_all_data(seed):
    chain = problem(np.random.default_rng(seed))
    mean, P = closed_loop(*chain)
    mean_all, P_all = least_squares(*chain)
    sigma = np.sqrt(np.einsum("kii->ki", P_all))
    assert np.abs((mean - mean_all) / sigma).max() < 1e-8
    assert np.abs((P - P_all) / (sigma[:, :, None] * sigma[:, None, :])).max() < 1e-8


@pytest.mark.parametrize("seed", range(4))
def test_what_was_forgotten_learns_nothing_from_later(seed):
    """Forgetting is a transition that draws the block anew: least squares with that transition."""
    Phi, Q, P0, measured, z = problem(np.random.default_rng(seed))
    mean, P = closed_loop(Phi, Q, P0, measured, z, forget_at=FORGOTTEN_AT)
    mean_all, P_all = least_squares(*with_forgetting(Phi, Q, FORGOTTEN_AT), P0, measured, z)
    sigma = np.sqrt(np.einsum("kii->ki", P_all))
    assert np.abs((mean - mean_all) / sigma).max() < 1e-8
    assert np.abs((P - P_all) / (sigma[:, :, None] * sigma[:, None, :])).max() < 1e-8


def test_equals_rts_of_filterpy():
    from filterpy.kalman import KalmanFilter

    Phi, Q, P0, measured, z = problem(np.random.default_rng(9))
    Q = [q + 0.01 * np.eye(N) for q in Q]  # RTS inverts the predicted covariance
    kalman = KalmanFilter(dim_x=N, dim_z=2)
    kalman.x, kalman.P = np.zeros((N, 1)), P0.copy()
    xs, Ps = [kalman.x.copy()], [kalman.P.copy()]
    for k in range(N_STEPS):
        kalman.predict(F=Phi[k], Q=Q[k])
        if k + 1 in measured:
            H, R = measured[k + 1]
            kalman.update(z[k + 1].reshape(-1, 1), R=R, H=H)
        xs.append(kalman.x.copy())
        Ps.append(kalman.P.copy())
    # filterpy takes Fs[k + 1], Qs[k + 1] for the step from k to k + 1
    x_rts, P_rts, _, _ = kalman.rts_smoother(np.array(xs), np.array(Ps), [Phi[0], *Phi], [Q[0], *Q])
    mean, P = closed_loop(Phi, Q, P0, measured, z)
    assert np.allclose(mean, x_rts[:, :, 0], rtol=0.0, atol=1e-8)
    assert np.allclose(P, P_rts, rtol=0.0, atol=1e-8)


# an attitude and the bias of its gyro: closed loop on quaternions
DT, ARW, SIGMA_BIAS, SIGMA_STAR = 0.5, 2e-3, 2e-3, 4e-3
SIGMA_0, FAR = 0.05, 0.3  # rad, of the attitude at the start
TICKS, STARS = 120, range(60, 100, 5)


def attitude_flight(rng, sigma_0=SIGMA_0):
    """Truth, gyro increments, star residual quaternions by tick."""
    bias = SIGMA_BIAS * rng.standard_normal(3)
    q = rotation.quat_from_rotvec(rng.standard_normal(3))
    truth, increments = [q], []
    for k in range(TICKS):
        turn = DT * np.array([0.3, 0.1 * np.sin(0.1 * k), 0.05])
        q = rotation.quat_multiply(q, rotation.quat_from_rotvec(turn))
        truth.append(q)
        increments.append(turn + DT * bias + ARW * np.sqrt(DT) * rng.standard_normal(3))
    stars = {
        k: rotation.quat_multiply(truth[k], rotation.quat_from_rotvec(SIGMA_STAR * rng.standard_normal(3)))
        for k in STARS
    }
    start = rotation.quat_multiply(truth[0], rotation.quat_from_rotvec(sigma_0 * rng.standard_normal(3)))
    return truth, bias, increments, stars, start


def attitude_smoother(increments, stars, start, *, sigma_0=SIGMA_0, with_reset=True):
    """Filter and smoother. -> filtered, smoothed: lists of (q, bias, P) by tick; jumps across updates"""
    q, bias = start, np.zeros(3)
    P = np.diag([sigma_0**2] * 3 + [SIGMA_BIAS**2] * 3)
    H, R = np.hstack([np.eye(3), np.zeros((3, 3))]), SIGMA_STAR**2 * np.eye(3)
    filtered, before, steps = [(q, bias, P)], {}, []
    for k, increment in enumerate(increments, 1):
        turn = increment - DT * bias
        Phi = np.eye(6)
        Phi[:3, :3] = rotation.dcm_from_rotvec(turn).T
        Phi[:3, 3:] = -DT * right_jacobian(turn)
        Q = np.diag([ARW**2 * DT] * 3 + [0.0] * 3)
        q, P = rotation.quat_multiply(q, rotation.quat_from_rotvec(turn)), Phi @ P @ Phi.T + Q
        own = [("interval", Phi)]
        if k in stars:
            before[k] = (q, bias, P)
            z = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q), stars[k]))
            dx = P @ H.T @ np.linalg.solve(H @ P @ H.T + R, z)
            G = np.eye(6)
            if with_reset:
                G[:3, :3] = right_jacobian(dx[:3])
            own.append(("update", (P, z, H, R, G)))
            left = np.eye(6) - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H)
            P = G @ left @ P @ G.T
            q, bias = rotation.quat_multiply(q, rotation.quat_from_rotvec(dx[:3])), bias + dx[3:]
        steps.append(own)
        filtered.append((q, bias, P))

    def corrected(state, adjoint):
        e, P_s = slow_smoother.smoothed(adjoint, state[2])
        return rotation.quat_multiply(state[0], rotation.quat_from_rotvec(e[:3])), state[1] + e[3:], P_s

    adjoint, result, jumps = slow_smoother.at_the_end(6), [], []
    for k in range(TICKS, -1, -1):
        result.append(corrected(filtered[k], adjoint))
        for kind, what in steps[k - 1][::-1] if k else ():
            if kind == "update":
                adjoint = slow_smoother.before_update(adjoint, *what)
                jumps.append(rotation.rotvec_between(corrected(before[k], adjoint)[0], result[-1][0]))
            else:
                adjoint = slow_smoother.before_interval(adjoint, what)
    return filtered, result[::-1], np.array(jumps[::-1])


def nees(truth, bias, state):
    e = np.concatenate([rotation.rotvec_between(state[0], truth), bias - state[1]])
    return e @ np.linalg.solve(state[2], e)


def test_attitude_is_smoothed_and_its_covariance_right():
    """60 flights: NEES before, between and after the star fixes; errors fall as the covariances say."""
    runs, at = 60, (30, 80, 119)
    values, errors, variances = np.zeros((runs, len(at))), np.zeros((runs, 2)), np.zeros((runs, 2))
    for seed in range(runs):
        truth, bias, increments, stars, start = attitude_flight(np.random.default_rng(seed))
        filtered, result, _ = attitude_smoother(increments, stars, start)
        values[seed] = [nees(truth[k], bias, result[k]) for k in at]
        for column, states in enumerate((filtered, result)):
            q, _, P = states[80]
            errors[seed, column] = np.sum(rotation.rotvec_between(q, truth[80]) ** 2)
            variances[seed, column] = np.trace(P[:3, :3])
    low, high = chi2.ppf([5e-4, 0.9995], 6 * runs) / runs
    assert np.all((values.mean(axis=0) > low) & (values.mean(axis=0) < high)), values.mean(axis=0)
    error2, expected2 = (x[:, 1].mean() / x[:, 0].mean() for x in (errors, variances))
    assert expected2 < 0.8 and abs(error2 / expected2 - 1.0) < 0.4  # 180 squares: 3 sigma of their ratio


def test_the_smoothed_attitude_does_not_jump_at_an_update():
    """The first fix turns the estimate by 0.3 rad: only with G do both sides agree."""
    _, _, increments, stars, start = attitude_flight(np.random.default_rng(3), FAR)
    _, _, jumps = attitude_smoother(increments, stars, start, sigma_0=FAR)
    _, _, careless = attitude_smoother(increments, stars, start, sigma_0=FAR, with_reset=False)
    assert np.abs(jumps).max() < 1e-6 < 1e-5 < np.abs(careless).max()


def test_what_is_known_of_little_is_not_lost_in_what_is_known_of_much():
    """Position known to 100 km and then to 1 m: the compiled update against the algebra."""
    rng, n = np.random.default_rng(5), 12
    P = np.diag(np.array([1e5] * 3 + [1e2] * 3 + [1e-2] * 6) ** 2)
    H, R, z = np.eye(3, n), np.eye(3), rng.standard_normal(3)
    information = rng.standard_normal((n, n))
    vector, matrix = rng.standard_normal(n), information @ information.T * 1e8
    expected = slow_smoother.before_update(slow_smoother.Adjoint(vector, matrix), P, z, H, R)
    after = P.copy()
    K, S_inverse = relinear._update(np.zeros(n), after, z, H, R)
    smoother._before_update(vector, matrix, z, H, K, S_inverse, True)
    scale = np.sqrt(np.abs(np.diag(expected.matrix)))
    assert np.abs((matrix - expected.matrix) / np.outer(scale, scale)).max() < 1e-6
    assert np.allclose(vector, expected.vector, rtol=1e-6, atol=1e-6 * np.abs(expected.vector).max())
    assert np.linalg.eigvalsh(after)[0] > -1e-9 and np.all(np.diag(after)[:3] < 1.0 + 1e-6)
