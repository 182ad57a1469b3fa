"""How errors grow: transition matrix and process noise of one interval of strapdown.

In: what the strapdown passed through (`strapdown.Pieces`). Out: Phi, Qd in the order of `state`.

The attitude error is carried in inertial axes, psi = C_ib dtheta_b, in which it moves only by the errors
of the gyros, and turned back into body axes at the end. Over a piece of duration T with increments
dtheta, dv (Groves, 2nd ed., section 14.2.4; Sola, arXiv:1711.02508, section 5 for the body-axes form)::

    psi <- psi + C_ib J d dtheta,       d dtheta = -M (T db_g + dtheta_x dk),   M = (I + k e_x^T)^-1
    dv  <- dv - (C_ib s) x psi + C_ib (D d dtheta - T J db_a)
    dr  <- dr + T dv - (C_ib s_r) x psi + ...,                plus the gradient of a central gravity field

with s, s_r of `strapdown`; J, D in `_derivatives`.
"""

import numpy as np
from numba import njit

from shefex_nav.geometry import rotation, wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.onboard.navigation import strapdown
from shefex_nav.onboard.navigation.state import ATT, BA, BG, N_ERROR, POS, ROLL, VEL, NavState
from shefex_nav.onboard.navigation.strapdown import ImuWindow

FIELD_TIME_S = 300.0  # [E] correlation time of gravity anomalies along the flight: some 500 km at 2 km/s


@njit(cache=True, forceinline=True)
def _product(A, B):
    """A @ B for (3, 3) matrices; the library call costs several times as much."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
    return out


@njit(cache=True, forceinline=True)
def _turned(C, u):
    """C @ u. (3, 3), (3,) -> (3,)."""
    out = np.empty(3)
    for i in range(3):
        out[i] = C[i, 0] * u[0] + C[i, 1] * u[1] + C[i, 2] * u[2]
    return out


@njit(cache=True, forceinline=True)
def _minus_cross(u, B):
    """-skew(u) @ B. (3,), (3, 3) -> (3, 3)."""
    out = np.empty((3, 3))
    for j in range(3):
        out[0, j] = u[2] * B[1, j] - u[1] * B[2, j]
        out[1, j] = u[0] * B[2, j] - u[2] * B[0, j]
        out[2, j] = u[1] * B[0, j] - u[0] * B[1, j]
    return out


@njit(cache=True, forceinline=True)
def _derivatives(T, dtheta, dv, B, b):
    """What phi and s of one piece do when its increments change, body axes at its start.

    J = d(phi)/d(dtheta) = d(s)/d(dv), to the third order in dtheta, coning and sculling included;
    D = d(s)/d(dtheta); D_r = d(s_r)/d(dtheta); J_r = d(s_r)/d(dv). (3, 3) each.
    """
    t2 = dtheta[0] ** 2 + dtheta[1] ** 2 + dtheta[2] ** 2
    along = dtheta[0] * dv[0] + dtheta[1] * dv[1] + dtheta[2] * dv[2]
    turn = rotation.cross(dtheta, dv)
    J = rotation.skew((0.5 - t2 / 24.0) * dtheta - (T * T / 12.0) * B)
    D = rotation.skew((t2 / 24.0 - 0.5) * dv - turn / 6.0 - (T * T / 12.0) * b)
    D_r = rotation.skew((-T / 6.0) * dv)
    J_r = rotation.skew((T / 6.0) * dtheta)
    for i in range(3):
        J[i, i] += 1.0 - (1.0 / 6.0 - t2 / 120.0) * t2
        D[i, i] += along / 6.0
        J_r[i, i] += 0.5 * T
        for j in range(3):  # skew(a) skew(b) = b a^T - (a . b) I
            J[i, j] += (1.0 / 6.0 - t2 / 120.0) * dtheta[i] * dtheta[j]
            D[i, j] -= (dv[i] / 6.0 + turn[i] / 12.0) * dtheta[j]
    return J, D, D_r, J_r


@njit(cache=True, forceinline=True)
def _carry(r, v, psi, T, u, u_r, w, CJ, CD, CD_r):
    """Carry the columns of a gyro error over a piece, in place; w: minus d(dtheta) by that error."""
    for j in range(3):
        x, y, z = psi[0, j], psi[1, j], psi[2, j]
        r[0, j] += T * v[0, j] + u_r[2] * y - u_r[1] * z - w * CD_r[0, j]
        r[1, j] += T * v[1, j] + u_r[0] * z - u_r[2] * x - w * CD_r[1, j]
        r[2, j] += T * v[2, j] + u_r[1] * x - u_r[0] * y - w * CD_r[2, j]
        v[0, j] += u[2] * y - u[1] * z - w * CD[0, j]
        v[1, j] += u[0] * z - u[2] * x - w * CD[1, j]
        v[2, j] += u[1] * x - u[0] * y - w * CD[2, j]
        for i in range(3):
            psi[i, j] -= w * CJ[i, j]


@njit(cache=True)
def transition(pieces, r_i, q_ib, gyro_roll_column):
    """Transition matrix of the errors over an interval.

    Parameters
    ----------
    pieces : strapdown.Pieces
    r_i : (3,) m, at the start, for the gravity gradient
    q_ib : (4,) at the end
    gyro_roll_column : (3,) estimate used by the strapdown

    Returns
    -------
    Phi : (21, 21)
    """
    # u: of psi at the start (-skew(u) psi); g, k, a: of gyro bias, roll column, accelerometer bias
    v_u, r_u, columns = np.zeros(3), np.zeros(3), np.zeros((8, 3, 3))
    psi_g, v_g, r_g = columns[0], columns[1], columns[2]
    psi_k, v_k, r_k = columns[3], columns[4], columns[5]
    v_a, r_a = columns[6], columns[7]
    total_s = 0.0
    for n in range(pieces.n):
        T, C, dtheta = pieces.dt_s[n], pieces.C_ib[n], pieces.dtheta_b[n]
        total_s += T
        J, D, D_r, J_r = _derivatives(T, dtheta, pieces.dv_b[n], pieces.B_b[n], pieces.b_b[n])
        CJ, CD, CD_r, CJ_r = _product(C, J), _product(C, D), _product(C, D_r), _product(C, J_r)
        u, u_r = _turned(C, pieces.s_b[n]), _turned(C, pieces.s_r_b[n])
        _carry(r_g, v_g, psi_g, T, u, u_r, T, CJ, CD, CD_r)
        _carry(r_k, v_k, psi_k, T, u, u_r, dtheta[0], CJ, CD, CD_r)
        for i in range(3):
            r_u[i] += T * v_u[i] + u_r[i]
            v_u[i] += u[i]
            for j in range(3):
                r_a[i, j] += T * (v_a[i, j] - CJ_r[i, j])
                v_a[i, j] -= T * CJ[i, j]

    M = np.eye(3)
    for i in range(3):
        M[i, 0] -= gyro_roll_column[i] / (1.0 + gyro_roll_column[0])
    C_bi = rotation.dcm_from_quat(rotation.quat_conjugate(q_ib))
    C_start = pieces.C_ib[0]
    d2 = r_i[0] ** 2 + r_i[1] ** 2 + r_i[2] ** 2
    pull = wgs84.GM / (d2 * np.sqrt(d2))

    Phi = np.zeros((N_ERROR, N_ERROR))
    for i in range(N_ERROR):
        Phi[i, i] = 1.0
    for i in range(3):
        Phi[POS.start + i, VEL.start + i] = total_s
        for j in range(3):
            gradient = pull * (3.0 / d2 * r_i[i] * r_i[j] - (1.0 if i == j else 0.0))
            Phi[POS.start + i, POS.start + j] += 0.5 * total_s**2 * gradient
            Phi[VEL.start + i, POS.start + j] = total_s * gradient
            Phi[VEL.start + i, VEL.start + j] += 0.5 * total_s**2 * gradient
    Phi[POS, ATT] = _minus_cross(r_u, C_start)
    Phi[POS, BG], Phi[POS, ROLL], Phi[POS, BA] = _product(r_g, M), _product(r_k, M), r_a
    Phi[VEL, ATT] = _minus_cross(v_u, C_start)
    Phi[VEL, BG], Phi[VEL, ROLL], Phi[VEL, BA] = _product(v_g, M), _product(v_k, M), v_a
    Phi[ATT, ATT] = _product(C_bi, C_start)
    Phi[ATT, BG] = _product(C_bi, _product(psi_g, M))
    Phi[ATT, ROLL] = _product(C_bi, _product(psi_k, M))
    return Phi


def vibration_level(params, block):
    """Vibration in an ImuBlock relative to that of the strongest motor: 0 unless a motor pushes the vehicle.

    NavParams, ImuBlock -> float
    """
    thrust = sum(block.dv_b[:, 0].tolist()) / (strapdown.SAMPLES * block.dt_s)
    if thrust <= params.imu.thrust_threshold:
        return 0.0
    level = 0.0
    for t_s, relative in params.motors.tolist():
        if t_s <= block.t_valid_s:
            level = relative
    return level


@njit(cache=True)
def noise_densities(model, imu, pieces):
    """White noise that stands for everything which is not a state.

    An error of sigma s that keeps its sign for a time tau (Gauss-Markov) has the density
    2 s^2 tau/(1 + (w tau)^2) at the angular frequency w. An error fixed to a body axis across the roll axis
    is turned by the spin, so its slow effect has the density at the roll rate: spin averages it away. An
    error along the roll axis keeps its direction and has the density at zero.

    Returns
    -------
    along, across : (2,) each: rad^2/s of attitude, m^2/s^3 of velocity, for the roll axis and for the others
    bias_walk : m^2/s^5 of the accelerometer bias
    """
    duration_s, dtheta, dv, across_angle = 0.0, np.zeros(3), np.zeros(3), 0.0
    for n in range(pieces.n):
        duration_s += pieces.dt_s[n]
        dtheta += pieces.dtheta_b[n]
        dv += pieces.dv_b[n]
        across_angle += np.sqrt(pieces.dtheta_b[n, 1] ** 2 + pieces.dtheta_b[n, 2] ** 2)
    f2 = (dv**2).sum() / duration_s**2
    roll_rate, across_rate = dtheta[0] / duration_s, across_angle / duration_s
    tau = model.thrust_time_s
    slow, spun = 2.0 * tau, 2.0 * tau / (1.0 + (roll_rate * tau) ** 2)

    # fixed to the body: errors in proportion to specific force; vibration rectified, by its power
    gyro = model.gyro_g_sensitivity**2 * f2
    accel = model.accel_cross**2 * f2
    gyro += (model.gyro_rectification * imu.vibration**2) ** 2
    accel += (model.accel_rectification * imu.vibration**2) ** 2
    # turning the roll axis by an angle a leaves an attitude error s a: sigma^2 grows to (s a)^2 at any rate
    gyro_white = model.gyro_random_walk**2 + model.gyro_cross**2 * model.manoeuvre_angle * across_rate
    # what the gravity model leaves out is slow in inertial axes: while the attitude is held it is taken for
    # accelerometer bias, which walks with the field and with the attitude; while the body turns it is noise
    rate = np.sqrt((dtheta**2).sum()) / duration_s
    held = 1.0 / (1.0 + (rate * model.gravity_time_s) ** 2)
    accel_white = model.accel_random_walk**2 + 2.0 * (1.0 - held) * model.gravity**2 * model.gravity_time_s
    bias_walk = model.accel_bias_walk**2 + model.gravity**2 * (2.0 / FIELD_TIME_S + held * rate)
    if imu.saturated:  # an error of unknown sign in every interval at the range
        gyro_white += model.saturated_rate**2 * duration_s
        accel_white += model.saturated_acceleration**2 * duration_s
    along = np.array([gyro_white + slow * gyro, accel_white + slow * accel])
    across = np.array([gyro_white + spun * gyro, accel_white + spun * accel])
    return along, across, bias_walk


@njit(cache=True)
def process_noise(model, imu, pieces, Phi):
    """Qd of an interval, trapezoidal rule: Qd = T/2 (Phi W Phi^T + W), W the densities of the noise.

    ImuModel, ImuWindow, Pieces, (21, 21) -> (21, 21)
    """
    along, across, bias_walk = noise_densities(model, imu, pieces)
    total_s = 0.0
    for n in range(pieces.n):
        total_s += pieces.dt_s[n]
    nose = pieces.C_ib[0][:, 0]
    W_v = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            W_v[i, j] = (along[1] - across[1]) * nose[i] * nose[j] + (across[1] if i == j else 0.0)
    w_t = np.array([along[0], across[0], across[0]])
    half = 0.5 * total_s

    Q = np.zeros((N_ERROR, N_ERROR))
    top = Phi[: ATT.stop, ATT] * np.sqrt(w_t)  # (9, 3) what noise of the attitude does to r, v, attitude
    for i in range(ATT.stop):
        for j in range(ATT.stop):
            Q[i, j] = half * (top[i, 0] * top[j, 0] + top[i, 1] * top[j, 1] + top[i, 2] * top[j, 2])
    Q[POS, POS] += (half * total_s**2) * W_v  # Phi of velocity: T in position, 1 in velocity
    Q[POS, VEL] += (half * total_s) * W_v
    Q[VEL, POS] += (half * total_s) * W_v
    Q[VEL, VEL] += total_s * W_v
    for i in range(3):
        Q[ATT.start + i, ATT.start + i] += half * w_t[i]
        Q[BG.start + i, BG.start + i] = model.gyro_bias_walk**2 * total_s
        Q[BA.start + i, BA.start + i] = bias_walk * total_s
    return Q


def record(model):
    """ImuModel as an array of one record, which a kernel takes seven times as fast as a tuple of numbers."""
    return np.array([tuple(model)], dtype=[(name, float) for name in model._fields])


def step(model, state, imu, begin_s, end_s, earth):
    """Strapdown and error model of the part begin_s ... end_s of a tick, in one call.

    `record` of an ImuModel, NavState at begin_s, ImuWindow, s, s, EarthRotation
    -> r_i, v_i, q_ib at end_s, Phi (21, 21), Qd (21, 21)
    """
    # tuples are taken apart here and results are views of two arrays: a third of the cost of the call
    moved, matrices = _step(model, *state, *imu, *earth, begin_s, end_s)
    return moved[:3], moved[3:6], moved[6:], matrices[0], matrices[1]


@njit(cache=True)
def _step(
    model, t_s, r_i, v_i, q_ib, gyro_bias, accel_bias, gyro_roll_column, mounting,  # NavState
    t_end_s, dt_s, dtheta_b, dv_b, dtheta_before_b, dv_before_b, saturated, vibration,  # ImuWindow
    C_iq, C_re, angle_0, rate,  # EarthRotation
    begin_s, end_s,
):  # fmt: skip
    """`step` with the fields of its tuples. -> (10,) r_i, v_i, q_ib; (2, 21, 21) Phi, Qd"""
    state = NavState(t_s, r_i, v_i, q_ib, gyro_bias, accel_bias, gyro_roll_column, mounting)
    imu = ImuWindow(t_end_s, dt_s, dtheta_b, dv_b, dtheta_before_b, dv_before_b, saturated, vibration)
    moved, matrices = np.empty(10), np.empty((2, N_ERROR, N_ERROR))
    earth = EarthRotation(C_iq, C_re, angle_0, rate)
    moved[:3], moved[3:6], moved[6:], pieces = strapdown.propagate(state, imu, begin_s, end_s, earth)
    matrices[0] = transition(pieces, r_i, moved[6:], gyro_roll_column)
    matrices[1] = process_noise(model[0], imu, pieces, matrices[0])
    return moved, matrices
