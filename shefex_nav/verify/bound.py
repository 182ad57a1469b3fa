"""The posterior Cramer-Rao bound of a flight: how well any estimator can know it.

For errors that are linear along the true flight and Gaussian, the recursion of the posterior information
matrix (Tichavsky, Muravchik, Nehorai, IEEE Trans. Signal Processing 46 (1998), eq. 21) is the covariance
recursion of a Kalman filter whose matrices are evaluated at the truth and whose states are all that is
unknown (Taylor, IEEE Trans. Automatic Control 24 (1979)). `bound_model` has the states. Rate and specific
force are inputs that are measured, nothing is assumed of the flight itself.

What is no state, and why:

- Random walk of the sensors is white noise, as the world makes it.
- The counts of the sensors carry their remainder on, so the sum of increments is off by a rounding alone:
  an error of the moment, variance q^2/12, added to what is reported and to what is measured. Spin turns what
  is carried on: at least (w dt)^2 q^2/12 of white noise per sample.
- Vibration above 20 Hz swings the sensors to and fro. Nothing of it stays: its spectrum is zero at the spin
  rate, too. It is an error of the moment like the one above, at instants so far apart that it is independent
  (correlation time 8 ms).
- The gravity model on board has J2 alone. Whoever has the right field has no such error, so the lowest
  bound is that of a known field; for software that may not know it the difference is a process with the
  variance and the correlation time which it has along the flight (`gravity_process`). Both are offered.
"""

from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import sample_s
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Phase
from shefex_nav.verify import bound_model, linear
from shefex_nav.verify.bound_model import N_NAV, POS, PSI, VEL
from shefex_nav.verify.field import beyond
from shefex_nav.world import imu as world_imu
from shefex_nav.world import vibration

OUTPUT_S = 0.5  # between the times at which the bound is given
KEPT = 256  # steps that are at hand
SWING_LENGTH = 4000  # samples of the response of the vibration's filter


class Flight(NamedTuple):
    """What the bound needs of one run."""

    trajectory: object  # Trajectory
    earth: object  # EarthRotation
    alignment: object  # Alignment
    gps_fixes: list
    star_fixes: list  # of StarFix that were used
    imu: object  # world.settings.Imu
    camera: object  # world.camera_settings.StarCamera
    l_ba_b: np.ndarray  # (3,) m
    heard: tuple = ()  # of bound_instruments.Heard


class Bound(NamedTuple):
    """The bound at m times: covariances of the errors of what is reported."""

    t_s: np.ndarray  # (m,)
    position_i: np.ndarray  # (m, 3, 3) m^2
    velocity_i: np.ndarray  # (m, 3, 3) m^2/s^2
    attitude_b: np.ndarray  # (m, 3, 3) rad^2


def gravity_process(field, trajectory, earth):
    """What a field has beyond the on-board model along a flight, as a process.

    Parameters
    ----------
    field : environment.gravity.GravityModel of the world
    trajectory : Trajectory
    earth : EarthRotation

    Returns
    -------
    sigma : m/s^2, root mean square per axis from lift-off on
    tau_s : of the Gauss-Markov process that changes as much: 1 - D/(2 sigma^2) is its correlation, D the mean
        squared difference over a lag; the lag of 1/e, or if half of the flight is too short for that, the
        time that the change within half of the flight implies
    """
    t_s, difference = beyond(field, trajectory, earth, int(np.searchsorted(trajectory.t_s, 0.0)))
    sigma = float(np.sqrt((difference**2).mean()))
    if sigma == 0.0:
        return 0.0, np.inf
    last = len(difference) // 2
    for k in range(1, last + 1):
        change = difference[k:] - difference[:-k]
        correlation = 1.0 - 0.5 * (change**2).mean() / sigma**2
        if correlation < 1.0 / np.e:
            return sigma, float(t_s[k] - t_s[0])
    return sigma, float((t_s[0] - t_s[last]) / np.log(correlation))


def swing(params, rms, dt_s):
    """Standard deviation of what vibration of a level leaves in the sum of increments, each axis.

    The world's own filter (`world.imu`), summed over its response. settings.Imu, level of what the increments
    integrate (m/s^2 or rad/s rms), s -> m/s or rad
    """
    m = vibration.pieces(params.vibration, dt_s)
    response = np.zeros((SWING_LENGTH, m))
    level = np.full(SWING_LENGTH, float(rms))

    class One:
        """Draws a single pulse, of each piece of a sample in a column of its own."""

        @staticmethod
        def standard_normal(shape):
            pulse = np.zeros(shape)
            pulse[m : 2 * m] = np.eye(m)
            return pulse

        @classmethod
        def spawn(cls, _):
            return [cls]

    world_imu.add_vibration(response, params, level, dt_s, One)
    return float(np.sqrt((np.cumsum(response, axis=0) ** 2).sum()))


def follow(flight, layout, *, every_s=OUTPUT_S):
    """The bound along one flight.

    Parameters
    ----------
    flight : Flight
    layout : bound_model.Layout
    every_s : between outputs, a multiple of the sampling interval

    Returns
    -------
    Bound
    """
    levels, at, covariances = momentary_levels(flight), [], []
    for k, output in outputs(flight, layout, every_s=every_s):
        at.append(k)
        covariances.append(reported(flight, levels, k, output.P))
    return Bound(flight.trajectory.t_s[at], *(np.array(column) for column in zip(*covariances, strict=True)))


def momentary_levels(flight):
    """Errors of the moment: {level of the vibration, m/s^2 rms: sigma of velocity, of attitude}."""
    trajectory, params = flight.trajectory, flight.imu
    dt_s, rms = sample_s(trajectory.t_s), world_imu.vibration_rms(params, trajectory.burning)
    return {level: momentary(params, level, dt_s) for level in np.unique(rms).tolist()}


def momentary(params, rms, dt_s):
    """Errors of the moment under vibration of a level, 1 sigma of each axis: of velocity, of attitude.

    Of vibration, and of the rounding of counts. Arguments as of `swing` -> m/s, rad
    """
    levels = rms, params.vibration.angular * rms
    quanta = params.accelerometer.quantum, params.gyro.quantum
    swung = [swing(params, level, dt_s) if level > 0.0 else 0.0 for level in levels]
    return tuple(float(np.hypot(*pair)) for pair in zip(swung, np.array(quanta) / np.sqrt(12.0), strict=True))


def reported(flight, levels, k, P):
    """Covariances of what is reported at sample k, of those of all states: fields of Bound but its time.

    levels : of `momentary_levels`;  P : (n, n)
    """
    C_ib = rotation.dcm_from_quat(flight.trajectory.q_ib[k])
    velocity, angle = momentary_at(flight, levels, k)
    return (
        P[POS, POS],
        P[VEL, VEL] + velocity**2 * np.eye(3),
        C_ib.T @ P[PSI, PSI] @ C_ib + angle**2 * np.eye(3),
    )


def momentary_at(flight, levels, k):
    """Errors of the moment at sample k, 1 sigma of each axis. levels : of `momentary_levels`"""
    return levels[_level(flight, k)]


def _level(flight, k):
    """Vibration at sample k, m/s^2 rms."""
    return float(world_imu.vibration_rms(flight.imu, flight.trajectory.burning[k : k + 1])[0])


def outputs(flight, layout, *, every_s=OUTPUT_S):
    """The bound of all states along one flight, but for the swing of the moment.

    flight, layout, every_s : as of `follow`. Yields index of the sample, linear.Output.
    """
    stride = round(every_s / sample_s(flight.trajectory.t_s))
    yield from outputs_at(flight, layout, np.arange(stride, len(flight.trajectory.t_s), stride))


def outputs_at(flight, layout, at, growth=None, **histories):
    """The same at some samples. at : (m,) indices, ascending;  growth : as of `problem`

    histories : of `linear.outputs`, for errors that are drawn
    """
    trajectory = flight.trajectory
    steps = problem(flight, layout, sample_s(trajectory.t_s), at, growth)
    C_ib = rotation.dcm_from_quat(trajectory.q_ib[0])
    P_psi = C_ib @ flight.alignment.P_theta_b @ C_ib.T
    alignment, turn = flight.alignment, frames.omega_ie_i(flight.earth)
    if trajectory.phase[0] == Phase.ORBIT:  # errors of position and velocity are drawn each by itself
        turn = np.zeros(3)
    P = bound_model.start(layout, alignment.sigma_r, alignment.sigma_v, P_psi, turn)
    yield from zip(at.tolist(), linear.outputs(P, steps, trajectory.t_s[at], **histories), strict=True)


def problem(flight, layout, dt_s, at, growth=None):
    """The steps of `linear` along a flight.

    Parameters
    ----------
    flight : Flight
    layout : bound_model.Layout
    dt_s : s, of one sample
    at : (m,) indices of samples at which an interval has to end
    growth : trade.growth.OneOf, which keeps steps for other problems; None: each is made anew

    Returns
    -------
    Steps
    """
    begin_s = float(flight.trajectory.t_s[0])
    updates = {}
    fixes = [(_gps, fix) for fix in flight.gps_fixes if fix.valid]
    for make, fix in (*fixes, *((_stars, fix) for fix in flight.star_fixes)):
        k = round((fix.t_valid_s - begin_s) / dt_s)
        step = partial(make, flight, layout, dt_s, k, fix)
        if growth is not None:
            step = partial(growth.update, make, k, fix)
        updates.setdefault(k, []).append(step)
    for one in flight.heard:
        for row, k in enumerate(one.k.tolist()):
            updates.setdefault(k, []).append(partial(_reading, flight, layout, one, row))
    last = len(flight.trajectory.t_s) - 1
    ends = sorted({k for k in (*at.tolist(), *updates) if 0 < k <= last})
    make = partial(_interval, flight, layout, dt_s) if growth is None else growth.interval
    makers, before = [], 0
    for end in ends:
        makers += [partial(make, before, end), *updates.get(end, ())]
        before = end
    return Steps(makers)


class Steps:
    """Sequence of linear.DrivenInterval and linear.Update, each made when it is asked for.

    Those of a flight with ten readings a second would fill the memory.
    """

    def __init__(self, makers):
        self._makers = makers
        self._made = lru_cache(KEPT)(lambda k: makers[k]())

    def __len__(self):
        return len(self._makers)

    def __getitem__(self, k):
        return self._made(k)


def _interval(flight, layout, dt_s, before, end):
    """linear.DrivenInterval over the samples after `before` up to `end`."""
    sensed = samples(flight, layout, dt_s, before, end)
    params, carried = flight.imu, remainders(flight.trajectory, before, end)
    walks = np.column_stack(
        [
            params.gyro.random_walk**2 * dt_s + carried * params.gyro.quantum**2,
            params.accelerometer.random_walk**2 * dt_s + carried * params.accelerometer.quantum**2,
        ]
    )
    t_s, path = float(flight.trajectory.t_s[end]), path_over_earth(flight, before, end)
    return bound_model.interval(layout, sensed._replace(walks=walks), t_s, dt_s, path)


def remainders(trajectory, before, end):
    """Variance that turned remainders of the counts add in each sample, in squares of a count: (N,)."""
    return (trajectory.dtheta_b[before + 1 : end + 1] ** 2).sum(axis=1) / 12.0


def samples(flight, layout, dt_s, before, end):
    """bound_model.Samples after `before` up to `end`, without white noise."""
    trajectory = flight.trajectory
    rows, earlier = slice(before + 1, end + 1), slice(before, end)
    dtheta_b, dv_b = trajectory.dtheta_b[rows], trajectory.dv_b[rows]
    rms = world_imu.vibration_rms(flight.imu, trajectory.burning[rows])
    gyro, accel = bound_model.imu_columns(layout, dtheta_b, dv_b, rms**2, dt_s)
    q = trajectory.q_ib[earlier] + trajectory.q_ib[rows] * _sign(trajectory, earlier, rows)
    q /= np.linalg.norm(q, axis=1)[:, None]
    r_i = 0.5 * (trajectory.r_i[earlier] + trajectory.r_i[rows])
    walks = np.zeros((len(dv_b), 2))
    C_ib = rotation.dcms_from_quats(q)
    return bound_model.Samples(C_ib, np.ascontiguousarray(dv_b), r_i, gyro, accel, walks)


def path_over_earth(flight, before, end):
    """Distance over the Earth between two samples, m."""
    return float(np.linalg.norm(_over_earth(flight, end) - _over_earth(flight, before)))


def _over_earth(flight, k):
    """Place at sample k, frame e: (3,) m."""
    trajectory = flight.trajectory
    return frames.dcm_ie(flight.earth, trajectory.t_s[k]).T @ trajectory.r_i[k]


def _sign(trajectory, earlier, rows):
    """+1 or -1: quaternions of one half of the sphere. (N, 1)"""
    along = np.einsum("ki,ki->k", trajectory.q_ib[earlier], trajectory.q_ib[rows])
    return np.where(along < 0.0, -1.0, 1.0)[:, None]


def _reading(flight, layout, one, row):
    """linear.Update of a reading of an instrument. one : bound_instruments.Heard"""
    H, begin = np.zeros((len(one.R), layout.n)), N_NAV
    H[:, :begin] = one.H[row, :, :begin]
    for source in one.sources:
        H[:, layout.places[source.name]] = one.H[row, :, begin : begin + source.size]
        begin += source.size
    t_s = float(flight.trajectory.t_s[one.k[row]])
    return linear.Update(t_s, float(one.t_available_s[row]), one.name, H, one.R)


def _stars(flight, layout, dt_s, k, fix):
    """linear.Update of a StarFix at sample k."""
    trajectory, camera, named = flight.trajectory, flight.camera, fix.hip > 0
    C_ib = rotation.dcm_from_quat(trajectory.q_ib[k])
    centre = np.array([0.5 * (camera.detector.columns - 1), 0.5 * (camera.detector.rows - 1)])
    focal_px = camera.optics.focal_length / camera.detector.pixel_size
    H = bound_model.star_rows(
        layout, C_ib, camera.mounting.C_bc, focal_px, fix.detections.xy_px[named] - centre
    )
    _, angle = momentary(flight.imu, _level(flight, k), dt_s)
    R = fix.P_c + angle**2 * np.eye(3)
    return linear.Update(float(trajectory.t_s[k]), fix.t_available_s, "star_tracker", H, R)


def _gps(flight, layout, dt_s, k, fix):
    """linear.Update of a GpsFix at sample k, of what it says: position, or along north and east; velocity."""
    trajectory = flight.trajectory
    t_s = float(trajectory.t_s[k])
    C_ib = rotation.dcm_from_quat(trajectory.q_ib[k])
    rms, row = _level(flight, k), slice(k, k + 1)
    gyro, _ = bound_model.imu_columns(
        layout, trajectory.dtheta_b[row], trajectory.dv_b[row], np.array([rms**2]), dt_s
    )
    C_ei = frames.dcm_ie(flight.earth, t_s).T
    H = bound_model.gps_rows(
        layout,
        C_ei,
        C_ib,
        flight.l_ba_b,
        trajectory.omega_ib_b[k],
        frames.omega_ie_i(flight.earth),
        gyro[0] / dt_s,
    )
    axes = wgs84.level_axes(fix.r_ea_e)[:, :2].T if fix.horizontal else np.eye(3)
    m = len(axes)
    said = 0 if np.isnan(fix.R_v_e[0, 0]) else 3  # of the velocity
    R = np.zeros((m + said, m + said))
    R[:m, :m] = axes @ fix.R_r_e @ axes.T
    if said:
        R[m:, m:] = fix.R_v_e + _antenna_noise(flight, rms, dt_s) * np.eye(3)
    rows = np.vstack([axes @ H[:3], H[3 : 3 + said]])
    return linear.Update(t_s, fix.t_available_s, "gps", rows, R)


def _antenna_noise(flight, rms, dt_s):
    """Variance between strapdown and antenna, m^2/s^2, each axis.

    The velocity's of the moment, and the mean rate of two samples (dt each) times the arm: by vibration,
    variance S/(4 dt) of a flat density S and the share of its band, and by the counts at both of its ends.
    """
    params = flight.imu
    density = (params.vibration.angular * rms) ** 2 / vibration.bandwidth(params.vibration)
    of_band = vibration.share(params.vibration, 2.0 * dt_s)
    rate2 = 0.25 * density / dt_s * of_band + params.gyro.quantum**2 / 24.0 / dt_s**2
    return momentary(params, rms, dt_s)[0] ** 2 + rate2 * float(flight.l_ba_b @ flight.l_ba_b) * 2.0 / 3.0


def sigmas(bound):
    """Root of the trace of each covariance: (m,) m, m/s, rad."""
    return tuple(map(root_of_trace, (bound.position_i, bound.velocity_i, bound.attitude_b)))


def root_of_trace(P):
    """(m, 3, 3) -> (m,)"""
    return np.sqrt(np.einsum("kii->k", P))
