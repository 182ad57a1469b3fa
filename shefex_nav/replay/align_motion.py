"""Alignment of a vehicle that moves, by the velocity of GNSS: heading by the course, level by the force felt.

A wheeled vehicle, or an aircraft without wind, points where it goes, but for its sideslip. With the heading,
roll and pitch are those which turn the mean specific force between two fixes into the acceleration between
them, less gravity.
"""

from itertools import pairwise

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment import gravity
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.replay import align_ties
from shefex_nav.scenario.data_table import DataError

LONGEST_S = 2.5  # [E] between the two fixes that are compared
SLOW = 0.2  # [E] rad, sigma of the course beyond which noise of the velocity is not small against it


def course(scenario, data, earth, alignment_of):
    """Alignment at the first fix after mission.start that is fast enough.

    alignment_of : `align.alignment`
    """
    settings = scenario.alignment
    start_s = data.imu.t_s[0] + scenario.mission.start
    fixes = [fix for fix in data.fixes if fix.valid and fix.t_valid_s >= start_s]
    if fixes and not np.isfinite(fixes[0].v_ea_e).all():
        raise DataError("alignment: a course needs the velocity of GNSS, which these data do not have")
    fastest = 0.0
    for earlier, later in pairwise(fixes):
        _, speed, sigma = over_ground(later)
        fastest = max(fastest, speed)
        if later.t_valid_s - earlier.t_valid_s > LONGEST_S:
            continue
        if speed < settings.speed or sigma > SLOW:
            continue
        if later.t_valid_s > data.imu.t_s[-1]:
            break
        return _at(scenario, data.imu, earth, earlier, later, alignment_of)
    words = (
        f"the fastest fix along the ground has {fastest:.2g} m/s, alignment.speed wants {settings.speed:g}"
    )
    raise DataError(f"alignment: no course from {scenario.mission.start:g} s on: {words} m/s")


def over_ground(fix):
    """Velocity of a fix north, east, down (3,) m/s, its speed along the ground [m/s], and 1 sigma of its
    course [rad]."""
    C_en = wgs84.level_axes(fix.r_ea_e)
    v_n, R_n = C_en.T @ fix.v_ea_e, C_en.T @ fix.R_v_e @ C_en
    speed = float(np.hypot(v_n[0], v_n[1]))
    across = np.array([-v_n[1], v_n[0], 0.0]) / max(speed, 1e-9)
    return v_n, speed, float(np.sqrt(across @ R_n @ across) / max(speed, 1e-9))


def _at(scenario, imu, earth, earlier, later, alignment_of):
    """Alignment at the first sample of the IMU that ends with the later fix or after it.

    Never before it: what the alignment is made of would come once more, as a measurement.
    """
    settings = scenario.alignment
    begin = int(np.argmin(np.abs(imu.t_s - earlier.t_valid_s)))
    end = int(np.searchsorted(imu.t_s, later.t_valid_s - SAME_S))
    t_s, span_s = float(imu.t_s[end]), float(imu.t_s[end] - imu.t_s[begin])
    f_b, turned = _mean_force(imu, begin, end)
    C_en = wgs84.level_axes(later.r_ea_e)
    g_n = C_en.T @ gravity.normal_gravity_e(later.r_ea_e)
    dv_n = C_en.T @ (later.v_ea_e - earlier.v_ea_e)
    coriolis_n = C_en.T @ (2.0 * np.cross([0.0, 0.0, wgs84.OMEGA], later.v_ea_e))
    f_n = dv_n / span_s + coriolis_n - g_n
    omega_b = imu.dtheta_b[end] / (imu.t_s[end] - imu.t_s[end - 1])
    swing_b = np.cross(omega_b, np.array(scenario.gnss.lever_arm))
    v_n, C_nb = C_en.T @ later.v_ea_e, np.eye(3)
    for _ in range(3):  # the antenna swings about the IMU, by the attitude that is looked for
        moved = v_n - C_nb @ swing_b
        heading = float(np.arctan2(moved[1], moved[0]))
        C_nb = _roll_pitch(f_b, f_n, heading)
    r_e = later.r_ea_e - C_en @ C_nb @ np.array(scenario.gnss.lever_arm)
    r_e = r_e + C_en @ moved * (t_s - later.t_valid_s)
    r_i, v_i = frames.inertial_from_ecef(earth, t_s, r_e, C_en @ moved)
    q_ib = rotation.quat_from_dcm(frames.dcm_ie(earth, t_s) @ C_en @ C_nb)
    level = _level_sigma(scenario, earlier, later, span_s, turned)
    roll = align_ties.roll(C_nb, level)
    P_n = align_ties.spread(C_nb, np.hypot(settings.sideslip, over_ground(later)[2]), level, roll)
    sigma_r, sigma_v = (float(np.sqrt(np.linalg.eigvalsh(R)[-1])) for R in (later.R_r_e, later.R_v_e))
    found = alignment_of(t_s, r_i, v_i, q_ib, earth, sigma_r, sigma_v, P_n)
    g = float(np.linalg.norm(g_n))
    of_accel = align_ties.of_accelerometers(C_nb, align_ties.of_tilt(C_nb, 1.0, roll / level), g)
    return align_ties.tied(found, scenario.imu, of_accel, np.zeros((3, 3)))


def _mean_force(imu, begin, end):
    """Mean specific force between two samples in the body axes of the later one, (3,) m/s^2, and the turn
    between them [rad]."""
    C, total = np.eye(3), np.zeros(3)
    for k in range(end, begin, -1):
        half = rotation.dcm_from_rotvec(0.5 * imu.dtheta_b[k])
        total += C @ half.T @ imu.dv_b[k]
        C = C @ half.T @ half.T
    span_s = imu.t_s[end] - imu.t_s[begin]
    return total / span_s, float(np.linalg.norm(imu.dtheta_b[begin + 1 : end + 1].sum(axis=0)))


def _roll_pitch(f_b, f_n, heading):
    """C_nb with this heading that turns a specific force in the body into one in the level.

    In axes of the heading, f_h = C_y(pitch) C_x(roll) f_b: its part to the right has the roll alone,
    cos(roll) f_y - sin(roll) f_z; what is left in the plane gives the pitch.
    """
    c, s = np.cos(heading), np.sin(heading)
    f_h = np.array([c * f_n[0] + s * f_n[1], -s * f_n[0] + c * f_n[1], f_n[2]])
    across = np.hypot(f_b[1], f_b[2])
    roll = np.arctan2(-f_b[1], -f_b[2]) + np.arcsin(np.clip(f_h[1] / max(across, 1e-9), -1.0, 1.0))
    down = np.sin(roll) * f_b[1] + np.cos(roll) * f_b[2]
    pitch = np.arctan2(f_b[0], -down) - np.arctan2(f_h[0], -f_h[2])
    return euler.dcm_from_euler(roll, pitch, heading)


def _level_sigma(scenario, earlier, later, span_s, turned):
    """1 sigma of roll and pitch [rad]: biases of the accelerometers and what gyros with a bias turn in the
    time, noise of the velocities, and the sideslip, which takes a share of a force along the ground."""
    gyro, accelerometer = scenario.imu.gyro, scenario.imu.accelerometer
    g = float(np.linalg.norm(gravity.normal_gravity_e(later.r_ea_e)))
    noise = max(np.linalg.eigvalsh(fix.R_v_e)[-1] for fix in (earlier, later))
    acceleration = align_ties.of_mean_force(accelerometer, span_s)
    acceleration = np.hypot(acceleration, np.sqrt(2.0 * noise) / span_s)
    along = float(np.linalg.norm(later.v_ea_e - earlier.v_ea_e)) / span_s
    acceleration = np.hypot(acceleration, along * (scenario.alignment.sideslip + 0.5 * turned))
    return float(np.hypot(acceleration / g, 0.5 * span_s * np.hypot(gyro.bias, gyro.in_run_bias)))
