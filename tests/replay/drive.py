"""A car that speeds up and turns on level ground, and what sensors with drawn errors say of it."""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.records import GpsFix
from shefex_nav.replay import dataset

LATITUDE, LONGITUDE, HEIGHT = np.radians(48.0), np.radians(11.0), 520.0
RATE, LEVER = 100.0, np.array([1.0, 0.2, -1.2])  # Hz; m
SIGMA_R, SIGMA_V = 2.0, 0.1
GYRO_BIAS, ACCEL_BIAS = np.radians(0.1), 0.05  # rad/s, m/s^2
GYRO_WALK, ACCEL_WALK = np.radians(0.3) / 60.0, 0.1 / 60.0  # rad/sqrt(s), m/s/sqrt(s)
IMU = """
imu:
  gyro: {bias: 0.1 deg/s, in_run_bias: 0 deg/h, in_run_bias_time: 100 s, random_walk: 0.3 deg/sqrt(h)}
  accelerometer: {bias: 0.05 m/s2, in_run_bias: 0 ugee, in_run_bias_time: 100 s, random_walk: 0.1 m/s/sqrt(h)}
"""


class Drive(NamedTuple):
    """Truth at the times of the samples, without errors."""

    t_s: np.ndarray  # (N,)
    r_e: np.ndarray  # (N, 3) m
    v_e: np.ndarray  # (N, 3) m/s
    C_en: np.ndarray  # (N, 3, 3)
    C_nb: np.ndarray  # (N, 3, 3)
    q_ib: np.ndarray  # (N, 4)
    dtheta_b: np.ndarray  # (N, 3) rad
    dv_b: np.ndarray  # (N, 3) m/s


def drive(earth, length_s=60.0, heading=0.7, speed=9.0):
    """Drive of a car that points where it goes."""
    t_s = np.arange(round(length_s * RATE) + 1) / RATE
    psi = heading + 0.8 * np.sin(0.35 * t_s) + 0.3 * np.sin(0.9 * t_s)
    v = speed * (1.0 + 0.5 * np.sin(0.5 * t_s)) if speed else np.zeros_like(t_s)
    v_n = np.column_stack([v * np.cos(psi), v * np.sin(psi), np.zeros_like(v)])
    place = LATITUDE, LONGITUDE
    r_e, v_e, C_en, C_nb, q_ib = ([] for _ in range(5))
    for k, at_s in enumerate(t_s):
        if k:
            place = _moved(place, 0.5 * (v_n[k] + v_n[k - 1]) / RATE)
        C_en.append(wgs84.dcm_en(*place))
        C_nb.append(euler.dcm_from_euler(0.0, 0.0, psi[k]))
        r_e.append(wgs84.ecef_from_geodetic(*place, HEIGHT))
        v_e.append(C_en[-1] @ v_n[k])
        q_ib.append(rotation.quat_from_dcm(frames.dcm_ie(earth, at_s) @ C_en[-1] @ C_nb[-1]))
    arrays = [np.array(one) for one in (r_e, v_e, C_en, C_nb, q_ib)]
    return Drive(t_s, *arrays, *_increments(earth, t_s, *arrays))


def _moved(place, way_n):
    latitude, longitude = place
    s2 = 1.0 - wgs84.E2 * np.sin(latitude) ** 2
    meridian, prime = wgs84.A * (1.0 - wgs84.E2) / s2**1.5, wgs84.A / np.sqrt(s2)
    east = way_n[1] / ((prime + HEIGHT) * np.cos(latitude))
    return latitude + way_n[0] / (meridian + HEIGHT), longitude + east


def _increments(earth, t_s, r_e, v_e, C_en, C_nb, q_ib):
    dtheta_b, dv_b = np.zeros_like(r_e), np.zeros_like(r_e)
    before = frames.inertial_from_ecef(earth, t_s[0], r_e[0], v_e[0])
    for k in range(1, len(t_s)):
        now = frames.inertial_from_ecef(earth, t_s[k], r_e[k], v_e[k])
        turned = rotation.quat_multiply(rotation.quat_conjugate(q_ib[k - 1]), q_ib[k])
        dtheta_b[k] = rotation.rotvec_from_quat(turned)
        half = rotation.quat_multiply(q_ib[k - 1], rotation.quat_from_rotvec(0.5 * dtheta_b[k]))
        middle_s = 0.5 * (t_s[k] + t_s[k - 1])
        C_ie = frames.dcm_ie(earth, middle_s)
        g_i = C_ie @ gravity.gravity_j2_e(0.5 * (r_e[k] + r_e[k - 1]))
        gained = now[1] - before[1] - g_i * (t_s[k] - t_s[k - 1])
        dv_b[k] = rotation.dcm_from_quat(half).T @ gained
        before = now
    return dtheta_b, dv_b


def sensed(truth, rng, every_s=1.0):
    """Dataset with errors drawn; fixes are of the antenna."""
    n, dt_s = len(truth.t_s), 1.0 / RATE
    bias_g, bias_a = GYRO_BIAS * rng.standard_normal(3), ACCEL_BIAS * rng.standard_normal(3)
    turn = truth.dtheta_b + bias_g * dt_s + GYRO_WALK * np.sqrt(dt_s) * rng.standard_normal((n, 3))
    gain = truth.dv_b + bias_a * dt_s + ACCEL_WALK * np.sqrt(dt_s) * rng.standard_normal((n, 3))
    turn[0] = gain[0] = 0.0
    imu = dataset.Increments(truth.t_s, turn, gain, np.zeros(n, dtype=bool))
    fixes = []
    for k in range(round(0.5 * RATE), n, round(every_s * RATE)):
        C = truth.C_en[k] @ truth.C_nb[k]
        omega_b = truth.dtheta_b[k] * RATE - (C.T @ [0.0, 0.0, wgs84.OMEGA])
        r_e = truth.r_e[k] + C @ LEVER + SIGMA_R * rng.standard_normal(3)
        v_e = truth.v_e[k] + C @ np.cross(omega_b, LEVER) + SIGMA_V * rng.standard_normal(3)
        noise = SIGMA_R**2 * np.eye(3), SIGMA_V**2 * np.eye(3)
        at_s = float(truth.t_s[k])
        fixes.append(GpsFix(at_s, at_s, True, r_e, v_e, *noise, 8, 1.0, ""))
    return dataset.Dataset(imu, fixes, None)


def scenario_text(
    alignment, gnss="{lever_arm: [1 m, 0.2 m, -1.2 m]}", mission="{name: drive, epoch: 2020-06-01T12:00:00Z}"
):
    """YAML of a replay; its files are never read."""
    return f"""
mission: {mission}
data: {{format: navego, imu: imu.mat, gnss: gnss.mat}}
gnss: {gnss}
alignment: {alignment}
{IMU}
"""
