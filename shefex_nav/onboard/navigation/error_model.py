"""How errors grow: transition matrix and process noise of one interval of strapdown.

In: what the strapdown passed through (`strapdown.Pieces`). Out: Phi, Qd in the order of a `state.Layout`.

The attitude error is carried in inertial axes, psi = C_ib dtheta_b, in which it moves only by the errors
of the gyros, and turned back into body axes at the end. Over a piece of duration T with increments
dtheta, dv (Groves, 2nd ed., section 14.2.4; Sola, arXiv:1711.02508, section 5 for the body-axes form)::

    psi <- psi + C_ib J d dtheta
    dv  <- dv - (C_ib s) x psi + C_ib (D d dtheta + J d dv)
    dr  <- dr + T dv - (C_ib s_r) x psi + ...,                plus the gradient of a central gravity field

with s, s_r of `strapdown`; J, D in `_derivatives`. What an error of calibration does to the increments
(`calibration`) is a fixed direction times a weight: the duration for a bias, an angle for scale factor and
misalignment of the gyros, a gain of velocity for those of the accelerometers and for the g-sensitivity::

    d dtheta = -(T, dtheta_x, dtheta_y, dtheta_z, dv_x, dv_y, dv_z) e,    d dv = -(T, dv_x, dv_y, dv_z) e

So one response (to every direction e) is accumulated for each weight that is needed, and every column of Phi
is a response times a direction.
"""

import numpy as np
from numba import njit

from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard.navigation.calibration import (
    OFF_DIAGONAL,
    accel_inverse,
    g_sensitivity,
    gyro_inverse,
)
from shefex_nav.onboard.navigation.state import (
    A_MISALIGN,
    A_SCALE,
    ATT,
    BA,
    BG,
    CLOCK,
    G_MISALIGN,
    G_SCALE,
    G_SENSE,
    OPTIONAL,
    POS,
    RANGE_BIAS,
    ROLL_COLUMN,
    VEL,
    X_R,
)

FIELD_TIME_S = 300.0  # [E] correlation time of gravity anomalies along the flight: some 500 km at 2 km/s
DURATION, ANGLE, SPEED = 0, 1, 4  # first of the weights of each kind
WEIGHTS = 7
N_RANGE = OPTIONAL["range_bias"]


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
def _carry(response, T, u, u_r, w, CJ, CD, CD_r):
    """Carry the response (3, 3, 3) of r, v, psi to d dtheta = -w e over a piece, in place."""
    r, v, psi = response[0], response[1], response[2]
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


@njit(cache=True, forceinline=True)
def _carry_force(response, T, w, CJ, CJ_r):
    """Carry the response (2, 3, 3) of r, v to d dv = -w e over a piece, in place."""
    r, v = response[0], response[1]
    for i in range(3):
        for j in range(3):
            r[i, j] += T * v[i, j] - w * CJ_r[i, j]
            v[i, j] -= w * CJ[i, j]


@njit(cache=True)
def _needed(at, G):
    """Which weights have a column: (7,) of the gyros, (7,) of the accelerometers, bool."""
    gyro, accel = np.zeros(WEIGHTS, np.bool_), np.zeros(WEIGHTS, np.bool_)
    gyro[DURATION] = accel[DURATION] = True
    gyro[ANGLE] = at[ROLL_COLUMN] >= 0
    if at[G_SCALE] >= 0 or at[G_MISALIGN] >= 0:
        gyro[ANGLE:SPEED] = True
    if at[A_SCALE] >= 0 or at[A_MISALIGN] >= 0:
        accel[SPEED:] = True
        for i in range(3):
            for j in range(3):
                if G[i, j] != 0.0:  # the gyros feel the corrected specific force
                    gyro[SPEED:] = True
    if at[G_SENSE] >= 0:
        gyro[SPEED:] = True
    return gyro, accel


@njit(cache=True)
def _responses(pieces, at, G):
    """What attitude, gyros and accelerometers do to r, v, psi over the pieces, in inertial axes.

    Returns
    -------
    u : (2, 3) position and velocity: -skew(u) psi for psi at the start
    gyro : (7, 3, 3, 3) for each weight: of r, v, psi, to e in d dtheta = -w e
    accel : (7, 2, 3, 3) for each weight: of r, v, to e in d dv = -w e
    """
    u_sum, gyro, accel = np.zeros((2, 3)), np.zeros((WEIGHTS, 3, 3, 3)), np.zeros((WEIGHTS, 2, 3, 3))
    by_gyro, by_accel = _needed(at, G)
    weights = np.empty(WEIGHTS)
    for n in range(pieces.n):
        T, C, dtheta, dv = pieces.dt_s[n], pieces.C_ib[n], pieces.dtheta_b[n], pieces.dv_b[n]
        J, D, D_r, J_r = _derivatives(T, dtheta, dv, pieces.B_b[n], pieces.b_b[n])
        CJ, CD, CD_r, CJ_r = _product(C, J), _product(C, D), _product(C, D_r), _product(C, J_r)
        u, u_r = _turned(C, pieces.s_b[n]), _turned(C, pieces.s_r_b[n])
        weights[DURATION], weights[ANGLE:SPEED], weights[SPEED:] = T, dtheta, dv
        for k in range(WEIGHTS):
            if by_gyro[k]:
                _carry(gyro[k], T, u, u_r, weights[k], CJ, CD, CD_r)
            if by_accel[k]:
                _carry_force(accel[k], T, weights[k], CJ, CJ_r)
        for i in range(3):
            u_sum[0, i] += T * u_sum[1, i] + u_r[i]
            u_sum[1, i] += u[i]
    return u_sum, gyro, accel


@njit(cache=True, forceinline=True)
def _put(Phi, column, response, direction):
    """Add a response times a direction (3,) to the first rows of a column."""
    for block in range(response.shape[0]):
        for i in range(3):
            row = response[block, i]
            Phi[3 * block + i, column] += (
                row[0] * direction[0] + row[1] * direction[1] + row[2] * direction[2]
            )


@njit(cache=True)
def _put_calibration(Phi, at, gyro, accel, M, A, MGA):
    """The columns of all errors of the IMU. M, A: inverses of its triads; MGA: of specific force on rate."""
    for i in range(3):
        _put(Phi, BG.start + i, gyro[DURATION], M[:, i])
        _put(Phi, BA.start + i, accel[DURATION], A[:, i])
        _put(Phi, BA.start + i, gyro[DURATION], -MGA[:, i])
        if at[ROLL_COLUMN] >= 0:
            _put(Phi, at[ROLL_COLUMN] + i, gyro[ANGLE], M[:, i])
        if at[G_SCALE] >= 0:
            _put(Phi, at[G_SCALE] + i, gyro[ANGLE + i], M[:, i])
        if at[A_SCALE] >= 0:
            _put(Phi, at[A_SCALE] + i, accel[SPEED + i], A[:, i])
            _put(Phi, at[A_SCALE] + i, gyro[SPEED + i], -MGA[:, i])
        if at[G_SENSE] >= 0:
            for j in range(3):
                _put(Phi, at[G_SENSE] + 3 * i + j, gyro[SPEED + j], M[:, i])
    for k, (i, j) in enumerate(OFF_DIAGONAL):
        if at[G_MISALIGN] >= 0:
            _put(Phi, at[G_MISALIGN] + k, gyro[ANGLE + j], M[:, i])
        if at[A_MISALIGN] >= 0:
            _put(Phi, at[A_MISALIGN] + k, accel[SPEED + j], A[:, i])
            _put(Phi, at[A_MISALIGN] + k, gyro[SPEED + j], -MGA[:, i])


@njit(cache=True)
def transition(model, pieces, x, q_ib, at, n):
    """Transition matrix of the errors over an interval.

    Parameters
    ----------
    model : `record`
    pieces : strapdown.Pieces
    x : (87,) packed nominal state at the start
    q_ib : (4,) at the end
    at, n : of the Layout

    Returns
    -------
    Phi : (n, n)
    """
    M, A, G = gyro_inverse(x), accel_inverse(x), g_sensitivity(x)
    u_sum, gyro, accel = _responses(pieces, at, G)
    total_s = 0.0
    for k in range(pieces.n):
        total_s += pieces.dt_s[k]
    C_bi = rotation.dcm_from_quat(rotation.quat_conjugate(q_ib))
    C_start = pieces.C_ib[0]
    for k in range(WEIGHTS):
        gyro[k, 2] = _product(C_bi, gyro[k, 2])

    r_i = x[X_R]
    d2 = r_i[0] ** 2 + r_i[1] ** 2 + r_i[2] ** 2
    pull = wgs84.GM / (d2 * np.sqrt(d2))
    Phi = np.zeros((n, n))
    for i in range(n):
        Phi[i, i] = 1.0
    for i in range(3):
        Phi[POS.start + i, VEL.start + i] = total_s
        for j in range(3):
            gradient = pull * (3.0 / d2 * r_i[i] * r_i[j] - (1.0 if i == j else 0.0))
            Phi[POS.start + i, POS.start + j] += 0.5 * total_s**2 * gradient
            Phi[VEL.start + i, POS.start + j] = total_s * gradient
            Phi[VEL.start + i, VEL.start + j] += 0.5 * total_s**2 * gradient
    Phi[POS, ATT] = _minus_cross(u_sum[0], C_start)
    Phi[VEL, ATT] = _minus_cross(u_sum[1], C_start)
    Phi[ATT, ATT] = _product(C_bi, C_start)
    _put_calibration(Phi, at, gyro, accel, M, A, _product(M, _product(G, A)))
    if at[CLOCK] >= 0:
        Phi[at[CLOCK], at[CLOCK] + 1] = total_s
    if at[RANGE_BIAS] >= 0:
        for i in range(at[RANGE_BIAS], at[RANGE_BIAS] + N_RANGE):
            Phi[i, i] = np.exp(-total_s / model[0].range_bias_time_s)
    return Phi


def vibration_level(params, block):
    """Vibration in an ImuBlock relative to that of the strongest motor: 0 unless a motor pushes the vehicle.

    NavParams, ImuBlock -> float
    """
    thrust = sum(block.dv_b[:, 0].tolist()) / (len(block.dv_b) * block.dt_s)
    if thrust <= params.imu.thrust_threshold:
        return 0.0
    level = 0.0
    for t_s, relative in params.motors.tolist():
        if t_s <= block.t_valid_s:
            level = relative
    return level


@njit(cache=True)
def noise_densities(model, saturated, vibration, pieces):
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
    gyro += (model.gyro_rectification * vibration**2) ** 2
    accel += (model.accel_rectification * vibration**2) ** 2
    # turning the roll axis by an angle a leaves an attitude error s a: sigma^2 grows to (s a)^2 at any rate
    gyro_white = model.gyro_random_walk**2 + model.gyro_cross**2 * model.manoeuvre_angle * across_rate
    # what the gravity model leaves out is slow in inertial axes: while the attitude is held it is taken for
    # accelerometer bias, which walks with the field and with the attitude; while the body turns it is noise
    rate = np.sqrt((dtheta**2).sum()) / duration_s
    held = 1.0 / (1.0 + (rate * model.gravity_time_s) ** 2)
    accel_white = model.accel_random_walk**2 + 2.0 * (1.0 - held) * model.gravity**2 * model.gravity_time_s
    bias_walk = model.accel_bias_walk**2 + model.gravity**2 * (2.0 / FIELD_TIME_S + held * rate)
    along = np.array([gyro_white + slow * gyro, accel_white + slow * accel])
    across = np.array([gyro_white + spun * gyro, accel_white + spun * accel])
    return along, across, bias_walk


@njit(cache=True)
def process_noise(model, saturated, vibration, extra, pieces, Phi, at):
    """Qd of an interval, trapezoidal rule: Qd = T/2 (Phi W Phi^T + W), W the densities of the noise.

    The clock of the receiver: white frequency noise of density a^2 and a random walk of frequency of
    density b^2 give its bias a^2 T + b^2 T^3/3, its drift b^2 T, the two together b^2 T^2/2 (Brown & Hwang,
    Introduction to Random Signals and Applied Kalman Filtering, 4th ed., section 9.3).

    Row of a `record`, bool, float, (2, 3), Pieces, (n, n), Layout.at -> (n, n)

    extra : white noise of more, per body axis: rad^2/s of the attitude, m^2/s^3 of the velocity
    """
    along, across, bias_walk = noise_densities(model, saturated, vibration, pieces)
    total_s = 0.0
    for k in range(pieces.n):
        total_s += pieces.dt_s[k]
    C = pieces.C_ib[0]
    nose = C[:, 0]
    W_v = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            W_v[i, j] = (along[1] - across[1]) * nose[i] * nose[j] + (across[1] if i == j else 0.0)
            for k in range(3):
                W_v[i, j] += extra[1, k] * C[i, k] * C[j, k]
    w_t = np.array([along[0] + extra[0, 0], across[0] + extra[0, 1], across[0] + extra[0, 2]])
    half = 0.5 * total_s

    Q = np.zeros(Phi.shape)
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
    if at[CLOCK] >= 0:
        c, walk = at[CLOCK], model.clock_walk**2
        Q[c, c] = model.clock_white**2 * total_s + walk * total_s**3 / 3.0
        Q[c, c + 1] = Q[c + 1, c] = walk * total_s**2 / 2.0
        Q[c + 1, c + 1] = walk * total_s
    if at[RANGE_BIAS] >= 0:
        left = np.exp(-2.0 * total_s / model.range_bias_time_s)
        for i in range(at[RANGE_BIAS], at[RANGE_BIAS] + N_RANGE):
            Q[i, i] = model.range_bias_sigma**2 * (1.0 - left)
    return Q


def record(params):
    """Noise of NavParams for kernels: one record, which they take seven times as fast as a tuple."""
    others = ("clock_white", "clock_walk", "range_bias_sigma", "range_bias_time_s")
    values = params.imu._asdict() | {name: getattr(params, name) for name in others}
    return np.array([tuple(values.values())], dtype=[(name, float) for name in values])
