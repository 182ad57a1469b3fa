"""Where the navigation of external data starts from: the truth, sensors of a vehicle that stands still, on a
rail or not, or the course of one that moves.

The nose of a rocket on its rail points to the rail's azimuth and elevation; the roll about it is seen by
gravity. At rest the accelerometers sense gravity across the nose, f_y = -sin(roll) cos(elevation) g and f_z =
-cos(roll) cos(elevation) g, so a bias b turns the roll by b/(g cos(elevation)): on a rail that is nearly
vertical, little or nothing is known of it. The mean rate at rest, less that of the Earth, is the gyros' bias.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment import gravity
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.onboard.navigation.hypotheses import UNKNOWN, wide_angles
from shefex_nav.records import Alignment
from shefex_nav.replay import align_motion, align_ties, imu_axes, reference
from shefex_nav.scenario.data_table import DataError

DISAGREE = 5.0  # [E] sigma by which accelerometers and rail may disagree about the elevation
MOST_HEADING_SIGMA = np.radians(20.0)  # beyond it a linear filter cannot start
STILL_SPEED = 0.5  # m/s, mean velocity of GNSS, above its noise
FEWEST_SAMPLES = 20
LEVEL, NOTHING = np.diag([1.0, 1.0, 0.0]), np.zeros((3, 3))


def align(scenario, data, earth):
    """Alignment of a ReplayScenario and its Dataset; DataError where the data do not allow it.

    It is valid at the sample of the IMU that begins the navigation.
    """
    found = METHODS[scenario.alignment.method](scenario, data, earth)
    if wide_angles(found) > 1:
        sigmas = ", ".join(f"{one:.1f}" for one in np.degrees(np.sqrt(np.linalg.eigvalsh(found.P_theta_b))))
        raise DataError(
            f"{scenario.alignment.method} alignment: the attitude would be known to {sigmas} deg (1 sigma); "
            "the navigation needs two of the three within 20 deg: check the errors in alignment, "
            "imu.accelerometer.bias and alignment.duration"
        )
    return found


def first_sample(imu, start_s):
    """Row of the Increments that ends at start_s, or of the next one."""
    return min(int(np.searchsorted(imu.t_s, start_s - SAME_S)), len(imu.t_s) - 1)


def from_reference(scenario, data, earth):
    """Alignment at the truth of mission.start, as well known as the scenario says."""
    settings = scenario.alignment
    t_s = data.imu.t_s[[first_sample(data.imu, scenario.mission.start)]]
    state = reference.at(data.truth, earth, t_s)
    if not len(state.t_s):
        covers = f"covers {data.truth.t_s[0]:g} s to {data.truth.t_s[-1]:g} s"
        words = f"{covers}, not the start of the navigation at {t_s[0]:g} s; set mission.start"
        raise DataError(f"{data.truth.table.file}: {words}")
    sigmas = (settings.position, settings.velocity)
    P_n = np.diag([settings.level, settings.level, settings.azimuth]) ** 2
    return alignment(float(t_s[0]), state.r_i[0], state.v_i[0], state.q_ib[0], earth, *sigmas, P_n)


def static(scenario, data, earth):
    """Alignment of a vehicle that stands still for a time, at the end of that time.

    Position from GNSS; level from the specific force, which is minus gravity; heading from the rate of the
    Earth (Groves, 2nd ed., section 5.6), unless it is given. A bias b of an accelerometer tilts the level by
    b/g, one of the gyros turns the heading by b/(omega_ie cos(latitude)); so does the rate of the Earth about
    the vertical, of which a tilt about north lets the share omega_ie sin(latitude) into the east axis.
    """
    rest, settings = _rest(scenario, data), scenario.alignment
    f_b, omega_b = rest.f_b, rest.omega_b
    if f_b[2] > 0.5 * rest.g:
        words = "the specific force points down where the vehicle stands on the ground"
        raise DataError(f"static alignment: {words}; check the signs in data.axes")
    roll, pitch = np.arctan2(-f_b[1], -f_b[2]), np.arctan2(f_b[0], np.hypot(f_b[1], f_b[2]))
    heading = settings.heading
    if heading is None:
        omega_level = euler.dcm_from_euler(roll, pitch, 0.0) @ omega_b
        heading = float(np.arctan2(-omega_level[1], omega_level[0]))
    C_nb = euler.dcm_from_euler(roll, pitch, 0.0 if np.isinf(heading) else heading)
    known, at_rest = _covariance(scenario, rest, C_nb), settings.gyro_bias == "at_rest"
    return _at_rest(scenario, rest, earth, C_nb, known, at_rest)


def rail(scenario, data, earth):
    """Alignment of a rocket that stands on its rail for a time, at the end of that time."""
    rest = _rest(scenario, data)
    C_nb, P_n, of_tau = rail_attitude(scenario, rest.f_b, rest.span_s, rest.g)
    return _at_rest(scenario, rest, earth, C_nb, (P_n, of_tau, NOTHING), True)


class Rest(NamedTuple):
    """What the sensors say in a time in which the vehicle stands still."""

    t_s: float  # its end
    span_s: float
    r_a_e: np.ndarray  # (3,) m, antenna
    sigma_r: float  # m, each axis
    latitude: float  # rad
    C_en: np.ndarray  # (3, 3)
    f_b: np.ndarray  # (3,) m/s^2, mean specific force
    omega_b: np.ndarray  # (3,) rad/s, mean rate
    g: float  # m/s^2


def _rest(scenario, data):
    """Rest of the time that the scenario says; DataError if the data say something else."""
    settings, imu = scenario.alignment, data.imu
    begin = first_sample(imu, scenario.mission.start)
    end = first_sample(imu, scenario.mission.start + settings.duration)
    span_s = float(imu.t_s[end] - imu.t_s[begin])
    if end - begin < FEWEST_SAMPLES or span_s < 0.9 * settings.duration:
        raise DataError(f"alignment.duration: the data end {span_s:g} s after mission.start")
    r_a_e, sigma_r = _place(scenario, data.fixes, imu.t_s[begin], imu.t_s[end])
    if data.fixes[0].horizontal:
        sigma_r = max(sigma_r, scenario.data.gnss.height_error)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_a_e)
    f_b = imu.dv_b[begin + 1 : end + 1].sum(axis=0) / span_s
    omega_b = imu.dtheta_b[begin + 1 : end + 1].sum(axis=0) / span_s
    g = float(np.linalg.norm(gravity.normal_gravity_e(r_a_e)))
    _check_still(scenario, f_b, omega_b, g)
    C_en = wgs84.dcm_en(latitude, longitude)
    return Rest(float(imu.t_s[end]), span_s, r_a_e, sigma_r, latitude, C_en, f_b, omega_b, g)


def _at_rest(scenario, rest, earth, C_nb, known, with_bias):
    """Alignment at the end of a Rest.

    known : as of `_covariance`;  with_bias : whether the mean rate says what the gyros' bias is
    """
    P_n, of_tau, of_rate = known
    r_e = rest.r_a_e - rest.C_en @ C_nb @ np.array(scenario.gnss.lever_arm)
    r_i, v_i = frames.inertial_from_ecef(earth, rest.t_s, r_e, np.zeros(3))
    q_ib = rotation.quat_from_dcm(frames.dcm_ie(earth, rest.t_s) @ rest.C_en @ C_nb)
    sigmas = rest.sigma_r, scenario.alignment.velocity
    found = alignment(rest.t_s, r_i, v_i, q_ib, earth, *sigmas, P_n)
    of_accel = align_ties.of_accelerometers(C_nb, of_tau, rest.g)
    found = align_ties.tied(found, scenario.imu, of_accel, C_nb.T @ of_rate @ C_nb)
    if not with_bias:
        return found
    omega_b = C_nb.T @ rest.C_en.T @ [0.0, 0.0, wgs84.OMEGA]
    sigma = sigma_gyro_bias(scenario, rest.span_s, P_n)
    return found._replace(
        gyro_bias=rest.omega_b - omega_b,
        sigma_gyro_bias=sigma,
        P_with_biases=align_ties.joint_at_rest(found.P_with_biases, omega_b, sigma),
    )


def course(scenario, data, earth):
    """Alignment of a vehicle that moves, by the course of its velocity."""
    return align_motion.course(scenario, data, earth, alignment)


def alignment(t_s, r_i, v_i, q_ib, earth, sigma_r, sigma_v, P_n):
    """Alignment with the covariance of the attitude given about north, east and down, (3, 3) rad^2."""
    C_ie = frames.dcm_ie(earth, t_s)
    C_bn = rotation.dcm_from_quat(q_ib).T @ C_ie @ wgs84.level_axes(C_ie.T @ r_i)
    omega_i = frames.omega_ie_i(earth)  # all velocities of data are against the Earth
    return Alignment(t_s, r_i, v_i, q_ib, sigma_r, sigma_v, C_bn @ P_n @ C_bn.T, omega_i=omega_i)


def _place(scenario, fixes, begin_s, end_s):
    """Mean position of the fixes of a time, (3,) m, frame e, and its 1 sigma.

    Errors of fixes that follow on each other are taken as one error: the mean is no better than a fix.
    """
    used = [fix for fix in fixes if fix.valid and begin_s <= fix.t_valid_s <= end_s]
    if not used:
        raise _without_fix(scenario, [fix.t_valid_s for fix in fixes if fix.valid], begin_s, end_s)
    moving = [fix for fix in used if np.isfinite(fix.v_ea_e).all()]
    if moving:
        speed = np.linalg.norm(np.mean([fix.v_ea_e for fix in moving], axis=0))
        noise = np.sqrt(np.mean([np.trace(fix.R_v_e) for fix in moving]))
        if speed > STILL_SPEED + 3.0 * noise:
            words = f"from {begin_s:g} s to {end_s:g} s GNSS says {speed:.2f} m/s"
            raise DataError(f"static alignment: {words}; set alignment.duration to the time it stands still")
    variance = np.mean([np.max(np.linalg.eigvalsh(fix.R_r_e)) for fix in used])
    return np.mean([fix.r_ea_e for fix in used], axis=0), float(np.sqrt(variance))


def _without_fix(scenario, valid_s, begin_s, end_s):
    """DataError about a time without a fix. valid_s : times of all fixes that are taken"""
    file = getattr(scenario.data.gnss, "file", scenario.data.gnss)
    there = f"its fixes are from {min(valid_s):g} s to {max(valid_s):g} s" if valid_s else "it has no fix"
    words = f"{scenario.alignment.method} alignment needs a GNSS fix from {begin_s:g} s to {end_s:g} s"
    return DataError(
        f"{file}: {words} after the first IMU sample; there is none, {there}; "
        "see mission.start, alignment.duration and gnss.first"
    )


def _check_still(scenario, f_b, omega_b, g):
    """Refuse sensors that say that the vehicle moves, or that are not in the units or axes said."""
    gyro, accelerometer = scenario.imu.gyro, scenario.imu.accelerometer
    excess = abs(np.linalg.norm(f_b) - g)
    if excess > 5.0 * np.sqrt(3.0) * np.hypot(accelerometer.bias, accelerometer.scale_factor * g) + 0.05:
        words = f"the mean specific force is {np.linalg.norm(f_b):.4g} m/s2, gravity {g:.4g} m/s2"
        raise DataError(_moves(scenario, words, "accelerometer"))
    rate = np.linalg.norm(omega_b)
    if rate > wgs84.OMEGA + 5.0 * np.sqrt(3.0) * gyro.bias + 1e-4:
        words = f"the mean rate is {np.degrees(rate):.4g} deg/s"
        raise DataError(_moves(scenario, words, "gyro"))


def _moves(scenario, words, sensor):
    """About a sensor that does not stand still, and the fields that may be wrong: str."""
    unit = (
        f"data.imu.{sensor}_unit" if hasattr(scenario.data.imu, f"{sensor}_unit") else "the units of data.imu"
    )
    fields = f"{unit}, imu.{sensor}.bias and alignment.duration"
    return f"{scenario.alignment.method} alignment: {words}; check {fields}"


def _covariance(scenario, rest, C_nb):
    """Covariance of a static alignment at a Rest; DataError if the sensors cannot find north.

    The heading is the one at which the Earth's rate has no part along east. With small rotations (n, e, d) of
    the attitude and an error w of the rate there, that is d cos(latitude) + n sin(latitude) = w/omega_ie. A
    heading that is given is that of the nose: gravity turns the vehicle about it, on a nose that points up
    nearly about down.

    -> (3, 3) rad^2 about north, east and down, and in these axes what of it is a tilt by the accelerometers,
    as `align_ties.of_tilt`, and what of it is of a rate of the gyros, (3, 3) s
    """
    settings, gyro, accelerometer = scenario.alignment, scenario.imu.gyro, scenario.imu.accelerometer
    acceleration = align_ties.of_mean_force(accelerometer, rest.span_s)
    level = float(np.hypot(acceleration / rest.g, settings.disturbance))
    if settings.heading is not None and np.isinf(settings.heading):
        return np.diag([level, level, UNKNOWN]) ** 2, LEVEL, NOTHING
    if settings.azimuth is not None:
        roll = align_ties.roll(C_nb, level)
        P_n = align_ties.spread(C_nb, settings.azimuth, level, roll)
        return P_n, align_ties.of_tilt(C_nb, 1.0, roll / level), NOTHING
    rate = np.hypot(np.hypot(gyro.bias, gyro.in_run_bias), gyro.random_walk / np.sqrt(rest.span_s))
    of_level, of_rate = np.eye(3), np.zeros((3, 3))
    of_level[2, 0] = -np.tan(rest.latitude)
    of_rate[2, 1] = 1.0 / (wgs84.OMEGA * np.cos(rest.latitude))
    P_n = of_level @ np.diag([level, level, rate * of_rate[2, 1]]) ** 2 @ of_level.T
    azimuth = np.sqrt(P_n[2, 2])
    if not azimuth <= MOST_HEADING_SIGMA:
        words = f"these sensors find north to {np.degrees(min(azimuth, np.pi)):.0f} deg only (1 sigma)"
        raise DataError(
            f"static alignment: {words}; give alignment.heading and alignment.azimuth, "
            "or 'heading: unknown', which finds it from the motion"
        )
    return P_n, of_level @ LEVEL, of_rate


METHODS = {"reference": from_reference, "static": static, "rail": rail, "course": course}


def rail_attitude(scenario, f_b, span_s, g):
    """C_nb of the mean specific force at rest, its covariance about north, east and down, (3, 3) rad^2, and
    what of it is a tilt by the accelerometers, as `align_ties.of_tilt` says."""
    settings, accelerometer = scenario.alignment, scenario.imu.accelerometer
    acceleration = align_ties.of_mean_force(accelerometer, span_s)
    level = float(np.hypot(acceleration / g, settings.disturbance))
    sensed = float(np.arctan2(f_b[0], np.hypot(f_b[1], f_b[2])))
    sigma = float(np.hypot(level, settings.elevation_error))
    if abs(sensed - settings.elevation) > DISAGREE * sigma:
        words = f"the accelerometers sense {np.degrees(sensed):.1f} deg, alignment.elevation says"
        up = imu_axes.of_file(f_b / np.linalg.norm(f_b), scenario.data.axes)
        raise DataError(
            f"alignment: {words} {np.degrees(settings.elevation):.1f} deg; check elevation, its error, "
            f"imu.accelerometer.bias and data.axes: the first is the nose, axis {up} of the file points up"
        )
    weight = settings.elevation_error**2 / sigma**2
    elevation = settings.elevation + weight * (sensed - settings.elevation)
    elevation_sigma = level * settings.elevation_error / sigma
    C_nb = euler.dcm_from_euler(np.arctan2(-f_b[1], -f_b[2]), elevation, settings.azimuth)
    roll_sigma = align_ties.roll(C_nb, level)
    return (
        C_nb,
        align_ties.spread(C_nb, settings.azimuth_error, elevation_sigma, roll_sigma),
        align_ties.of_tilt(C_nb, weight, roll_sigma / level),
    )


def sigma_gyro_bias(scenario, span_s, P_n):
    """1 sigma of the gyros' bias by their mean rate at rest, rad/s.

    The rate of the Earth is taken out as far as the attitude is known; what is not known of it, with the
    angular random walk, the bias that changes, a quantum and the swaying, is the sigma.
    """
    gyro = scenario.imu.gyro
    turned = wgs84.OMEGA * min(float(np.sqrt(np.linalg.eigvalsh(P_n)[-1])), align_ties.MOST_TURN)
    sway = np.sqrt(2.0) * scenario.alignment.disturbance / span_s
    parts = (gyro.random_walk / np.sqrt(span_s), gyro.in_run_bias, sway, gyro.quantum / span_s, turned)
    return float(np.linalg.norm(parts))
