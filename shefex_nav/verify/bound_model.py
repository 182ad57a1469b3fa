"""How every error of the simulated sensors grows into errors of navigation, along the true flight.

In: true trajectory, parameters of the world's sensors. Out: `linear.DrivenInterval` and `linear.Update` of
one state vector: errors of position, velocity and attitude in inertial axes, and behind them each error
source of the world as a state of its own. It shares no code with the on-board error model, whose states are
fewer and whose noise stands for the rest. Per sample of the IMU, with C = C_ib in its middle::

    psi <- psi - C d(dtheta),   dv <- dv - (C dv_b) x psi - C d(dv) + (G dr + dg) T,   dr <- dr + T dv

d(dtheta), d(dv): what the error states put into the increments (`world.imu` has the equation). Groves, 2nd
ed., section 14.2; states of inertial sensors as in its section 14.2.6.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.verify import linear

POS, VEL, PSI = slice(0, 3), slice(3, 6), slice(6, 9)  # m, m/s, rad, all in inertial axes
N_NAV = 9


class Source(NamedTuple):
    """An error source: states that start with one sigma and may wander, stationary Gauss-Markov."""

    name: str
    size: int
    sigma: np.ndarray  # (size,)
    tau_s: float  # correlation time; inf: constant in a run
    length: float = np.inf  # m, correlation length along the path over the Earth


class Layout(NamedTuple):
    """The sources and where their states stand, counted from the start of the whole vector."""

    sources: tuple[Source, ...]
    places: dict  # name -> slice
    n: int  # length of the state vector


class Samples(NamedTuple):
    """N samples of a flight as errors grow over them."""

    C_ib: np.ndarray  # (N, 3, 3) in the middle of each sample
    dv_b: np.ndarray  # (N, 3) m/s, true increments
    r_i: np.ndarray  # (N, 3) m, likewise in the middle
    gyro: np.ndarray  # (N, 3, p) rad, of `imu_columns`
    accel: np.ndarray  # (N, 3, p) m/s, likewise
    walks: np.ndarray  # (N, 2) variance of white noise of attitude [rad^2], velocity [m^2/s^2], each axis


def layout(sources):
    """Layout of the sources in their order."""
    places, begin = {}, N_NAV
    for source in sources:
        places[source.name] = slice(begin, begin + source.size)
        begin += source.size
    return Layout(tuple(sources), places, begin)


def sources(imu, camera, gravity_sigma, gravity_tau_s, more=()):
    """Every error source of a world.

    Parameters
    ----------
    imu : world.settings.Imu
    camera : world.camera_settings.StarCamera
    gravity_sigma, gravity_tau_s : m/s^2, s: what a gravity model leaves out; 0: the field is known
    more : sequence of Source, those of instruments

    Returns
    -------
    Layout
    """

    def same(name, size, sigma, tau_s=np.inf):
        return Source(name, size, np.full(size, float(sigma)), tau_s)

    scale = np.array([imu.gyro.scale_factor_roll, imu.gyro.scale_factor, imu.gyro.scale_factor])
    return layout(
        [
            same("gyro_bias", 3, imu.gyro.bias),
            same("gyro_in_run_bias", 3, imu.gyro.in_run_bias, imu.gyro.in_run_bias_time),
            Source("gyro_scale_factor", 3, scale, np.inf),
            same("gyro_misalignment", 6, imu.gyro.misalignment),
            same("gyro_g_sensitivity", 9, imu.gyro.g_sensitivity),
            same("gyro_rectification", 3, imu.gyro.vibration_rectification),
            same("accel_bias", 3, imu.accelerometer.bias),
            same("accel_in_run_bias", 3, imu.accelerometer.in_run_bias, imu.accelerometer.in_run_bias_time),
            same("accel_scale_factor", 3, imu.accelerometer.scale_factor),
            same("accel_misalignment", 6, imu.accelerometer.misalignment),
            same("accel_rectification", 3, imu.accelerometer.vibration_rectification),
            same("gravity", 3, gravity_sigma, gravity_tau_s),
            same("mounting", 3, camera.mounting.error),
            same("principal_point", 2, camera.optics.principal_point_error),
            same("focal_length", 1, camera.optics.focal_length_error),
            *more,
        ]
    )


OFF_DIAGONAL = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))  # misalignments: axis, and what it sees


def imu_columns(layout, dtheta_b, dv_b, rms2, dt_s):
    """What unit error states put into the increments of each sample.

    Parameters
    ----------
    layout : Layout of `sources`
    dtheta_b, dv_b : (N, 3) true increments
    rms2 : (N,) square of the level of vibration, m^2/s^4
    dt_s : duration of a sample

    Returns
    -------
    gyro, accel : (N, 3, n - 9) rad, m/s per unit of each error state
    """
    N = len(dtheta_b)
    gyro, accel = np.zeros((2, N, 3, layout.n - N_NAV))

    def at(name, k=0):
        return layout.places[name].start - N_NAV + k

    for k in range(3):
        for name in ("gyro_bias", "gyro_in_run_bias"):
            gyro[:, k, at(name, k)] = dt_s
        for name in ("accel_bias", "accel_in_run_bias"):
            accel[:, k, at(name, k)] = dt_s
        gyro[:, k, at("gyro_scale_factor", k)] = dtheta_b[:, k]
        accel[:, k, at("accel_scale_factor", k)] = dv_b[:, k]
        gyro[:, k, at("gyro_rectification", k)] = rms2 * dt_s
        accel[:, k, at("accel_rectification", k)] = rms2 * dt_s
        for j in range(3):
            gyro[:, k, at("gyro_g_sensitivity", 3 * k + j)] = dv_b[:, j]
    for m, (i, j) in enumerate(OFF_DIAGONAL):
        gyro[:, i, at("gyro_misalignment", m)] = dtheta_b[:, j]
        accel[:, i, at("accel_misalignment", m)] = dv_b[:, j]
    return gyro, accel


@kernel
def spread_kernel(samples, gravity, dt_s, X, Q):
    """Carry columns of errors and the covariances of white noise over samples, in place.

    samples : Samples;  gravity : index of the first of three states of gravity;  dt_s : of one sample
    X : (9, 9 + p), written: begins as [I | 0]
    Q : (2, 9, 9), written: begins as 0; of the noise of attitude, of that of velocity
    """
    C_ib, dv_b, r_i, gyro, accel, walks = samples
    G, drive = np.empty((3, 3)), np.empty((9, gyro.shape[2]))
    for k in range(C_ib.shape[0]):
        f = C_ib[k] @ dv_b[k]
        _gradient(r_i[k], dt_s, G)
        _drive(C_ib[k], f, gyro[k], accel[k], gravity, dt_s, drive)
        _carry(G, f, dt_s, X)
        for i in range(9):
            for c in range(drive.shape[1]):
                X[i, 9 + c] += drive[i, c]
        for kind in range(2):
            _carry(G, f, dt_s, Q[kind])  # F Q, and then (F (F Q)^T)^T
            _transpose(Q[kind])
            _carry(G, f, dt_s, Q[kind])
            _transpose(Q[kind])
            for i in range(3):
                place = 6 + i if kind == 0 else 3 + i
                Q[kind, place, place] += walks[k, kind]


@inner
def _transpose(Q):
    """Transpose a square matrix in place."""
    for i in range(Q.shape[0]):
        for j in range(i):
            Q[i, j], Q[j, i] = Q[j, i], Q[i, j]


@inner
def _gradient(r, dt_s, G):
    """Write what gravity over one sample does to the velocity for an error of position to G (3, 3), 1/s.

    r : (3,) m
    """
    d2 = r[0] ** 2 + r[1] ** 2 + r[2] ** 2
    pull = wgs84.GM / (d2 * np.sqrt(d2)) * dt_s
    for i in range(3):
        for j in range(3):
            G[i, j] = pull * (3.0 * r[i] * r[j] / d2 - (1.0 if i == j else 0.0))


@inner
def _carry(G, f, dt_s, X):
    """Carry errors of position, velocity and attitude over one sample, in place: columns of X (9, m).

    G : of `_gradient`;  f : (3,) m/s, velocity gained by specific force, inertial axes
    """
    for c in range(X.shape[1]):
        x, y, z = X[6, c], X[7, c], X[8, c]
        gain_0 = G[0, 0] * X[0, c] + G[0, 1] * X[1, c] + G[0, 2] * X[2, c] + f[2] * y - f[1] * z
        gain_1 = G[1, 0] * X[0, c] + G[1, 1] * X[1, c] + G[1, 2] * X[2, c] - f[2] * x + f[0] * z
        gain_2 = G[2, 0] * X[0, c] + G[2, 1] * X[1, c] + G[2, 2] * X[2, c] + f[1] * x - f[0] * y
        X[0, c] += dt_s * (X[3, c] + 0.5 * gain_0)  # the mean of velocity before and after
        X[1, c] += dt_s * (X[4, c] + 0.5 * gain_1)
        X[2, c] += dt_s * (X[5, c] + 0.5 * gain_2)
        X[3, c] += gain_0
        X[4, c] += gain_1
        X[5, c] += gain_2


@inner
def _drive(C, f, gyro, accel, gravity, dt_s, drive):
    """Write what unit error states put into position, velocity and attitude in one sample to drive (9, p).

    C : C_ib;  f : as in `_carry`;  gyro, accel : (3, p) of the sample;  gravity : as in `spread_kernel`
    """
    t, v = np.empty(3), np.empty(3)
    for c in range(gyro.shape[1]):
        for i in range(3):
            t[i], v[i] = 0.0, dt_s if c == gravity + i else 0.0
            for j in range(3):
                t[i] -= C[i, j] * gyro[j, c]
                v[i] -= C[i, j] * accel[j, c]
        # half of the turn acts within the sample already
        v[0] -= 0.5 * (f[1] * t[2] - f[2] * t[1])
        v[1] -= 0.5 * (f[2] * t[0] - f[0] * t[2])
        v[2] -= 0.5 * (f[0] * t[1] - f[1] * t[0])
        for i in range(3):
            drive[i, c], drive[3 + i, c], drive[6 + i, c] = 0.5 * dt_s * v[i], v[i], t[i]


def interval(layout, samples, t_s, dt_s, path=0.0):
    """linear.DrivenInterval of the whole state vector over some samples.

    Parameters
    ----------
    layout : Layout
    samples : Samples
    t_s : end of the last sample
    dt_s : of one sample
    path : m, over the Earth
    """
    X, Q = spread(layout, samples, dt_s)
    faded = fading(layout).over(dt_s * len(samples.C_ib), path)
    return linear.DrivenInterval(t_s, X, Q.sum(axis=0), *faded)


def spread(layout, samples, dt_s):
    """What errors at the start and constant sources become over some samples, and white noise.

    -> X (9, 9 + p), Q (2, 9, 9) of the noise of attitude, of that of velocity
    """
    X, Q = np.eye(N_NAV, N_NAV + samples.gyro.shape[2]), np.zeros((2, N_NAV, N_NAV))
    spread_kernel(samples, layout.places["gravity"].start - N_NAV, dt_s, X, Q)
    return X, Q


class Fading(NamedTuple):
    """How the p states of all sources wander, each by itself."""

    variance: np.ndarray  # (p,)
    per_s: np.ndarray  # (p,) 1/tau
    per_m: np.ndarray  # (p,) 1/length

    def over(self, duration_s, path):
        """(p,) correlations over a time and a path of so many metres, (p,) variances that are added."""
        keeps = np.exp(-duration_s * self.per_s - path * self.per_m)
        return keeps, self.variance * (1.0 - keeps**2)


def fading(layout):
    """Fading of the sources of a Layout."""
    sizes = [source.size for source in layout.sources]
    return Fading(
        np.concatenate([source.sigma for source in layout.sources]) ** 2,
        np.repeat([1.0 / source.tau_s for source in layout.sources], sizes),
        np.repeat([1.0 / source.length for source in layout.sources], sizes),
    )


def start(layout, sigma_r, sigma_v, P_psi, omega_ie_i):
    """Covariance at the alignment: the velocity is that of a point on the Earth at the surveyed place.

    Layout, m, m/s, (3, 3) rad^2 in inertial axes, (3,) rad/s -> (n, n); omega_ie_i zero: they are not tied
    """
    P = np.zeros((layout.n, layout.n))
    turn = rotation.skew(omega_ie_i)
    P[POS, POS] = sigma_r**2 * np.eye(3)
    P[VEL, POS] = sigma_r**2 * turn
    P[POS, VEL] = P[VEL, POS].T
    P[VEL, VEL] = sigma_v**2 * np.eye(3) + sigma_r**2 * turn @ turn.T
    P[PSI, PSI] = P_psi
    for source in layout.sources:
        P[layout.places[source.name], layout.places[source.name]] = np.diag(source.sigma**2)
    return P


def gps_rows(layout, C_ei, C_ib, l_ba_b, omega_ib_b, omega_ie_i, gyro_rate):
    """H of position and velocity of the antenna in frame e: (6, n).

    gyro_rate : (3, n - 9) what unit error states put into the measured rate, rad/s: the velocity of the
    antenna is told from that of the IMU with it
    """
    arm_i, swing_i = C_ib @ l_ba_b, C_ib @ rotation.cross(omega_ib_b, l_ba_b)
    H = np.zeros((6, layout.n))
    earth = rotation.skew(omega_ie_i)
    H[:3, POS] = np.eye(3)
    H[:3, PSI] = -rotation.skew(arm_i)
    H[3:, POS] = -earth
    H[3:, VEL] = np.eye(3)
    H[3:, PSI] = -rotation.skew(swing_i) + earth @ rotation.skew(arm_i)
    H[3:, N_NAV:] = C_ib @ rotation.skew(l_ba_b) @ gyro_rate
    H[:3] = C_ei @ H[:3]
    H[3:] = C_ei @ H[3:]
    return H


def star_rows(layout, C_ib, C_bc, focal_px, xy_px):
    """H of an attitude fix, its rotation-vector error in camera axes: (3, n).

    Parameters
    ----------
    C_ib : (3, 3) truth;  C_bc : (3, 3) nominal mounting
    focal_px : focal length;  xy_px : (m, 2) of the stars in the fix, from the principal point
    """
    C_cb = C_bc.T
    H = np.zeros((3, layout.n))
    H[:, PSI] = C_cb @ C_ib.T
    H[:, layout.places["mounting"]] = C_cb
    H[:, layout.places["principal_point"]] = -fit_of_shift(focal_px, xy_px, np.eye(2))
    H[:, layout.places["focal_length"]] = -fit_of_shift(focal_px, xy_px, xy_px[:, :, None])
    return H


def fit_of_shift(focal_px, xy_px, shift_px):
    """Error of the attitude that fits best when the stars of a picture are shifted on the detector.

    sum (I - u u^T) dtheta = sum u x du over the stars, each counted alike, du what the shift does to their
    directions; q_ic(true) = q_ic(fix) exp(dtheta).

    focal_px : float;  xy_px : (m, 2) from the principal point;  shift_px : (2, k) or (m, 2, k) -> (3, k) rad
    """
    shift = np.broadcast_to(shift_px, (len(xy_px), *shift_px.shape[-2:]))
    rays = np.column_stack([xy_px / focal_px, np.ones(len(xy_px))])
    length = np.linalg.norm(rays, axis=1)
    u = rays / length[:, None]
    d = np.concatenate([shift / focal_px, np.zeros_like(shift[:, :1])], axis=1) / length[:, None, None]
    d = d - u[:, :, None] * np.einsum("mi,mik->mk", u, d)[:, None]
    A = np.einsum("mij->ij", np.eye(3) - u[:, :, None] * u[:, None, :])
    b = np.einsum("mik->ik", np.cross(u[:, :, None], d, axis=1))
    return np.linalg.solve(A, b)
