"""What the sensors say about the errors: each function linearises one measurement about the nominal state.

z = H dx + noise, noise ~ N(0, R), dx in the order of a `state.Layout`. Frames and units with each function.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation import calibration, error_model, mean_rate, momentary, unknown_attitude
from shefex_nav.onboard.navigation.state import (
    ATT,
    GRAVITY,
    LATENCY,
    LEVER,
    MOUNTING,
    POS,
    VEL,
    X_GRAVITY,
    X_LATENCY,
    X_LEVER,
    X_MOUNTING,
    X_Q,
    X_R,
    X_V,
    right_jacobian,
)
from shefex_nav.onboard.navigation.strapdown import gravity_i
from shefex_nav.records import GpsFix, GpsRanges


class Antenna(NamedTuple):
    """Motion of the GPS antenna against the rotating Earth, frame e, and its Jacobians of the errors."""

    r_e: np.ndarray  # (3,) m
    v_e: np.ndarray  # (3,) m/s
    J_r: np.ndarray  # (3, n) d r_e / dx
    J_v: np.ndarray  # (3, n)


class Sensed(NamedTuple):
    """What the IMU senses in a tick."""

    sensed: np.ndarray  # (6,) omega_ib_b and f_b, rad/s, m/s^2, corrected
    vibration: float
    drive: np.ndarray  # (6, m)


def antenna(layout, x, t_s, earth, l_ba_b, sensed, vibration, drive=calibration.NO_DRIVE):
    """Where the GPS antenna is at the instant that a fix with the time of the state belongs to.

    r_ea_e = C_ei (r_i + C_ib l),   v_ea_e = C_ei (v_i + C_ib (omega_ib_b x l) - omega_ie_i x (r_i + C_ib l)),

    and, where a latency d is estimated, what they were d earlier: r - v d + a d^2/2 and v - a d of the IMU,
    in axes of the Earth, and l turned back by the rate of the body against the Earth, which is taken as
    constant within d: a spin of 4 Hz turns it by 14 deg in 10 ms. l is the nominal lever arm and its
    estimated error.

    Parameters
    ----------
    layout : Layout
    x : packed values of a NavState
    t_s : its time, s
    earth : EarthRotation
    l_ba_b : (3,) m, IMU to antenna, nominal
    sensed : (6,) omega_ib_b and f_b, rad/s, m/s^2, corrected for the estimated errors of the IMU
    vibration, drive : of the tick, with which they were corrected

    Returns
    -------
    Antenna

    References
    ----------
    Groves, 2nd ed., section 14.3.1.
    """
    motion, J = _antenna(layout.at, layout.n, x, t_s, earth, l_ba_b, Sensed(sensed, vibration, drive))
    return Antenna(motion[0], motion[1], J[0], J[1])


@kernel
def _antenna(at, n, x, t_s, earth, l_ba_b, now):
    """`antenna` with the fields of the Layout; now : Sensed. -> motion (2, 3), J (2, 3, n)"""
    motion, J, sensed = np.empty((2, 3)), np.empty((2, 3, n)), now.sensed
    J_omega, J_f = calibration.jacobians_packed(at, n, x, sensed[:3], sensed[3:], now.vibration, now.drive)
    zero, turn = (0.0, 0.0, 0.0), t3.vector(frames.omega_ie_i(earth), 0)
    C_ei = t3.transposed(t3.matrix(frames.dcm_ie(earth, t_s)))
    C = t3.dcm_from_quat(t3.quaternion(x, X_Q.start))
    omega, delay = t3.vector(sensed, 0), x[X_LATENCY]
    r_i, v_i, f = t3.vector(x, X_R.start), t3.vector(x, X_V.start), t3.vector(sensed, 3)
    g = t3.plus(
        gravity_i(r_i, earth.angle_0 + earth.rate * t_s, earth.C_iq, earth.C_re), 1.0, t3.vector(x, X_GRAVITY)
    )
    turn_b = t3.rotated(t3.transposed(C), turn)
    against = t3.plus(omega, -1.0, turn_b)  # the Earth
    now_b = t3.plus(t3.vector(l_ba_b, 0), 1.0, t3.vector(x, X_LEVER.start))
    back, J_back = _turned_back(against, delay)
    arm = t3.rotated(back, now_b)
    swing = t3.cross(omega, arm)
    r, v = t3.plus(r_i, 1.0, t3.rotated(C, arm)), t3.plus(v_i, 1.0, t3.rotated(C, swing))
    r, v, a = _seen(r, v, (r_i, v_i, t3.plus(t3.rotated(C, f), 1.0, g)), turn, delay)
    t3.put(motion[0], t3.rotated(C_ei, r))
    t3.put(motion[1], t3.rotated(C_ei, v))
    for j in range(n):
        dr_i, dv_i, dtheta = _unit(j - POS.start), _unit(j - VEL.start), _unit(j - ATT.start)
        dl = _unit(j - at[LEVER]) if at[LEVER] >= 0 else zero
        dg = _unit(j - at[GRAVITY]) if at[GRAVITY] >= 0 else zero
        dg = t3.plus(dg, 1.0, _gradient(r_i, dr_i))
        w, df = t3.column(J_omega, j), t3.column(J_f, j)
        more = t3.scaled(-delay, t3.rotated(J_back, t3.plus(w, 1.0, t3.cross(dtheta, turn_b))))
        dl = t3.rotated(back, t3.plus(dl, 1.0, t3.cross(more, now_b)))
        moved = t3.plus(t3.cross(dtheta, arm), 1.0, dl)
        swung = t3.plus(t3.cross(dtheta, swing), 1.0, t3.plus(t3.cross(w, arm), 1.0, t3.cross(omega, dl)))
        dr, dv = t3.plus(dr_i, 1.0, t3.rotated(C, moved)), t3.plus(dv_i, 1.0, t3.rotated(C, swung))
        da = t3.plus(dg, 1.0, t3.rotated(C, t3.plus(t3.cross(dtheta, f), 1.0, df)))
        dr, dv, _ = _seen(dr, dv, (dr_i, dv_i, da), turn, delay)
        if j == at[LATENCY]:
            dr, dv = t3.scaled(-1.0, v), t3.scaled(-1.0, a)
            dv = t3.plus(dv, -1.0, t3.rotated(C, t3.cross(against, t3.cross(against, arm))))
        dr, dv = t3.rotated(C_ei, dr), t3.rotated(C_ei, dv)
        for i in range(3):
            J[0, i, j], J[1, i, j] = dr[i], dv[i]
    return motion, J


@inner(forceinline=True)
def _turned_back(rate, delay):
    """Axes of a body that turns at a steady rate [rad/s], `delay` earlier, in those of now; Jr of that turn.

    -> nine numbers, nine numbers
    """
    back = t3.scaled(-delay, rate)
    return t3.dcm_from_quat(t3.quat_from_rotvec(back)), t3.matrix(right_jacobian(np.array(back)))


@inner(forceinline=True)
def _gradient(r, dr):
    """Change of the gravitation of a point mass with the place."""
    d2 = t3.dot(r, r)
    pull = wgs84.GM / (d2 * np.sqrt(d2))
    return t3.scaled(pull, t3.plus(t3.scaled(3.0 / d2 * t3.dot(r, dr), r), -1.0, dr))


@inner(forceinline=True)
def _unit(k):
    """Axis k, nothing if there is none."""
    return 1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2)


@inner(forceinline=True)
def _seen(r, v, own, turn, delay):
    """Position and velocity of the antenna against axes that turn, what they were `delay` earlier.

    r, v : with an arm that points already where it did then;  own : position, velocity, acceleration of the
    IMU, of which the last is returned, too
    """
    r_i, v_i, a = own
    a = t3.plus(a, -2.0, t3.cross(turn, v_i))
    a = t3.plus(a, 1.0, t3.cross(turn, t3.cross(turn, r_i)))
    u, v = t3.plus(v_i, -1.0, t3.cross(turn, r_i)), t3.plus(v, -1.0, t3.cross(turn, r))
    return t3.plus(t3.plus(r, -delay, u), 0.5 * delay * delay, a), t3.plus(v, -delay, a), a


def gps_position(fix, a):
    """Position fix of the antenna: z = r_ea_e(measured) - r_ea_e.

    fix : GpsFix;  a : Antenna at its instant -> z (3,) m, frame e;  H (3, n);  R (3, 3) m^2
    """
    return fix.r_ea_e - a.r_e, a.J_r, fix.R_r_e


def level_axes(fix):
    """Directions north and east at the place of a GpsFix: (3, 2), frame e."""
    latitude, longitude, _ = wgs84.geodetic_from_ecef(fix.r_ea_e)
    return wgs84.dcm_en(latitude, longitude)[:, :2]


def gps_horizontal(fix, a):
    """Latitude and longitude of the antenna: z = how far north and east of the antenna the fix lies.

    The fix is compared with the antenna at the height of the latter, whatever height is written in it.

    fix : GpsFix, horizontal;  a : Antenna at its instant -> z (2,) m;  H (2, n);  R (2, 2) m^2
    """
    latitude, longitude, _ = wgs84.geodetic_from_ecef(fix.r_ea_e)
    height, level = wgs84.geodetic_from_ecef(a.r_e)[2], level_axes(fix)
    z_e = wgs84.ecef_from_geodetic(latitude, longitude, height) - a.r_e
    return level.T @ z_e, level.T @ a.J_r, level.T @ fix.R_r_e @ level


def gps_velocity(fix, a):
    """Velocity fix of the antenna, relative to the rotating Earth: z = v_ea_e(measured) - v_ea_e.

    As `gps_position` -> z (3,) m/s, frame e;  H (3, n);  R (3, 3) m^2/s^2
    """
    return fix.v_ea_e - a.v_e, a.J_v, fix.R_v_e


def lasting_factor(share, time_s, gap_s):
    """By how much more a position fix is uncertain than it says, because it errs as the one before it did.

    A part of its variance is of errors that last, first-order Gauss-Markov: r = exp(-gap/time) of them is
    what the fix before had. Fixes at a steady rate tell as much about a position that stands still as fixes
    with independent errors of (1 + r)/(1 - r) times that part would; the first after a long gap counts in
    full.

    Parameters
    ----------
    share : of the variance that lasts, 0 to 1
    time_s : correlation time
    gap_s : since the fix before; inf: there was none

    Returns
    -------
    float, on the covariance of the fix
    """
    if not share or gap_s == np.inf:
        return 1.0
    r = math.exp(-gap_s / time_s)
    return float(1.0 - share + share * (1.0 + r) / max(1.0 - r, 1e-6))


def counted_noise(nav, name, fix, R):
    """The noise with which a measurement counts that passes the gate, after the last of its sensor.

    fusion.Filter, sensor, fix, (m, m) as linearised -> (m, m); R itself where errors do not last
    """
    counted = nav.sensors[name].counted
    if counted is None:
        return R
    return counted(nav, fix, R, fix.t_valid_s - nav.history.used_s.get(name, -np.inf))


def counted_covariance(nav, measurement, innovation):
    """S of an Innovation with the noise that its Measurement counts with; S itself if errors do not last."""
    R, S = innovation.R, innovation.S
    counted = counted_noise(nav, measurement.sensor, measurement.fix, R)
    return S if counted is R else S - R + counted


def star_attitude(layout, x, fix, C_bc, sigma_floor):
    """Attitude of the star camera: residual rotation in body axes.

    exp(z) = (q_ib exp(mounting))^-1 q_ic(measured) q_cb(nominal)

    Parameters
    ----------
    layout : Layout
    x : (X,) packed nominal values at the instant of the fix
    fix : StarFix with an attitude
    C_bc : (3, 3) nominal mounting
    sigma_floor : rad, each axis, added to the covariance of the fix

    Returns
    -------
    z : (3,) rad, body axes
    H : (3, n)
    R : (3, 3) rad^2

    References
    ----------
    Markley & Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, section 6.2.
    """
    return _star_attitude(x, fix.q_ic, fix.P_c, C_bc, sigma_floor, layout.n, layout.at[MOUNTING])


@kernel
def _star_attitude(x, q_ic, P_c, C_bc, sigma_floor, n, first):
    """`star_attitude` of its parts; n : errors;  first : error of the mounting, -1 if it is none."""
    H = np.zeros((3, n))
    mounting = x[X_MOUNTING]
    q_mounting = rotation.quat_from_rotvec(mounting)
    q_predicted = rotation.quat_multiply(x[X_Q], q_mounting)
    q_measured = rotation.quat_multiply(q_ic, rotation.quat_from_dcm(np.ascontiguousarray(C_bc.T)))
    z = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q_predicted), q_measured))
    H[:, ATT] = rotation.dcm_from_quat(q_mounting).T
    if first >= 0:
        H[:, first : first + 3] = right_jacobian(mounting)
    R = C_bc @ P_c @ C_bc.T
    for i in range(3):
        R[i, i] += sigma_floor**2
    return z, H, R


def understood(told, message):
    """A message of the GPS receiver as the filter takes it, by what it was told; what is of others passes.

    By default a message is taken as it says itself: its instant and its covariances. A computer that was told
    other noise scales the covariances; one that was told an offset of the receiver's clock takes it out; one
    that was told a latency does not look at the stamp but counts back from the arrival.

    GpsTold, record -> record
    """
    if not isinstance(message, GpsFix | GpsRanges):
        return message
    t_valid_s = message.t_valid_s - told.clock_offset_s
    if not math.isnan(told.latency_s):
        t_valid_s = message.t_available_s - told.latency_s
    near, fast = told.position_factor, told.velocity_factor
    if isinstance(message, GpsRanges):
        sigmas = {
            "sigma_range": near * message.sigma_range,
            "sigma_range_rate": fast * message.sigma_range_rate,
            "sigma_lasting": told.lasting_factor * message.sigma_lasting,
            "sigma_shared": told.lasting_factor * message.sigma_shared,
        }
        return message._replace(t_valid_s=t_valid_s, **sigmas)
    whole = near * told.fix_factor
    return message._replace(
        t_valid_s=t_valid_s, R_r_e=whole**2 * message.R_r_e, R_v_e=fast**2 * message.R_v_e
    )


# ----------------------------------------------------------------------------------------------------------
# What the lever arm of the GPS antenna adds to the noise of a measurement, and what vibration does.
#
# The strapdown knows the IMU; GPS sees the antenna, C_ib l away from it, whose velocity against the IMU is
# C_ib (omega_ib_b x l). That of the noise in the rate is noise of the predicted velocity,
#
#     C_ib [l x] Q [l x]^T C_ib^T,    Q the variances of the rate,
#
# which are those of `mean_rate.rate_noise` and what may be missed of a gyro that cannot be read. The rate
# is a mean over the time of one sample, centred on the instant of the fix. As a rule half of it comes from
# the sample before the instant and half from the one after it. Where that one has not been measured yet,
# the rate is that of the last sample, and half of its change counts as noise. The velocity of the sensors
# has its errors of the moment (`momentary`). All satellites of a set see the same antenna, so their range
# rates err together.
#
# What is not linear while the attitude is hardly known is in `unknown_attitude.of_arm`.


ALL_READ = np.zeros(3)


def arm_in_position(nav, now, H):
    """Noise of the rows H (m, n) that measure the position of the antenna: (m, m).

    nav : fusion.Filter;  now : Moment
    """
    return unknown_attitude.of_arm(now.P, nav.params.l_ba_b) * (H[:, POS] @ H[:, POS].T)


def arm_in_velocity(nav, now, H):
    """Likewise of the rows that measure its velocity."""
    arm, x, sensed, about = nav.params.l_ba_b, now.x, now.sensed_packed, now.about()
    more = _unread(now.imu, nav.watch.params.imu) if now.extra[0].any() else ALL_READ
    mean_s = about.dt_s / ((1.0 - about.share) ** 2 + about.share**2)  # over which white noise is as large
    velocity2, attitude2 = momentary.variances(nav.constants.momentary, now.vibration)
    tick = nav.history.ends_s[now.k], mean_s, now.vibration
    W = _swung(nav.constants.model, x, sensed, tick, more + 2.0 * attitude2 / mean_s**2, arm)
    W += velocity2 * np.eye(3)
    if about.missed.any():
        missed_i = rotation.quat_rotate(x[X_Q], rotation.cross(about.missed[:3] / about.dt_s, arm))
        W += np.outer(missed_i, missed_i)
    if not unknown_attitude.is_known(now.P):
        W += unknown_attitude.of_arm(now.P, rotation.cross(sensed[:3], arm)) * np.eye(3)
    return H[:, VEL] @ W @ H[:, VEL].T


def _unread(imu, rules):
    """Variances of the rate that gyros which cannot be read may have: (3,) rad^2/s^2; as `mean_rate.unread`.

    imu : ImuWindow;  rules : ImuRules
    """
    at_end = (np.abs(imu.dtheta_b) >= mean_rate.AT_END * rules.range[0] * imu.dt_s).any(axis=0)
    return np.where(imu.extra[0] > 0.0, np.where(at_end, rules.missed[0], rules.wrong[0]), 0.0) ** 2


@kernel
def _swung(model, x, sensed, tick, more, arm_b):
    """Covariance of the velocity of the antenna by what is not known of the motion of the IMU.

    model : `error_model.record`;  x : (X,) packed values;  sensed : (6,) corrected rate and specific force
    tick : its end, duration whose mean has the white noise of `sensed`, vibration
    more : (3,) rad^2/s^2, variances of the rate besides;  arm_b : (3,) m -> (3, 3) m^2/s^2, inertial axes
    """
    t_end_s, mean_s, vibration = tick
    row = model[error_model.valid(model, t_end_s)]
    rate2 = more + mean_rate.rate_noise(row, sensed[:3], sensed[3:], vibration, mean_s)
    arm_i = rotation.dcm_from_quat(x[X_Q]) @ rotation.skew(arm_b)
    return arm_i * rate2 @ arm_i.T
