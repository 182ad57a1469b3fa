"""NaveGo's drive with errors of IMU and GNSS that are drawn: the same road, other instruments each time.

Readings without errors follow from the truth that comes with the data: the turn from one row to the next, and
the change of velocity less gravity, in axes of the middle of the row. (Those of the file, less these, are a
bias and white noise of 1.00 to 1.16 times what the file says of them, and correlate with neither turns nor
forces.) Errors are what the scenario states: turn-on bias and white noise normal, in-run bias of first order
(Gauss-Markov); fixes with white noise of the sigmas in their file; a start that is off as its sigmas say.
"""

from functools import cache

import numpy as np
from missions import SCENARIOS
from scipy.spatial.transform import Rotation

from shefex_nav.environment import gravity
from shefex_nav.geometry import frames, rotation
from shefex_nav.replay import external, load, reference


def drawn(folder, seed):
    """external.Replay of the data in a folder, with the errors of a seed."""
    ready, rate, force = _without_errors(folder)
    rng, sensors, h_s = np.random.default_rng([seed, 3]), ready.scenario.imu, np.diff(ready.data.imu.t_s)
    gyro, accelerometer = (
        np.vstack([np.zeros(3), h_s[:, None] * (ideal + _errors(sensor, h_s, rng))])
        for ideal, sensor in ((rate, sensors.gyro), (force, sensors.accelerometer))
    )
    imu = ready.data.imu._replace(dtheta_b=gyro, dv_b=accelerometer)
    fixes = [_measured(fix, ready, rng) for fix in ready.data.fixes]
    begin, normal = ready.alignment, rng.standard_normal((3, 3))
    turn = np.linalg.cholesky(begin.P_theta_b) @ normal[2]
    begin = begin._replace(
        r_i=begin.r_i + begin.sigma_r * normal[0],
        v_i=begin.v_i + begin.sigma_v * normal[1],
        q_ib=rotation.quat_multiply(begin.q_ib, rotation.quat_from_rotvec(turn)),
    )
    samples = ready.scenario.navigation.samples_per_tick
    blocks = external.imu_blocks(imu, samples, begin.t_valid_s, ready.scenario.mission.end)
    return ready._replace(data=ready.data._replace(imu=imu, fixes=fixes), alignment=begin, blocks=blocks)


@cache
def _without_errors(folder):
    """external.Replay of the data as they are; mean rate and specific force of each sample without error.

    Both (N - 1, 3), rad/s and m/s^2, body axes. The strapdown alone, from the right start, is 4.8 m and
    0.02 m/s off after 437 s: its field of gravity is another one, by 5 micro gee.
    """
    ready = external.prepare(*load.load(SCENARIOS / "replay" / "navego.yaml", [], folder))
    t_s, earth = ready.data.imu.t_s, ready.earth
    at, h_s = reference.at(ready.data.truth, earth, t_s), np.diff(t_s)[:, None]
    turned, omega_i = Rotation.from_quat(rotation.xyzw(at.q_ib)), frames.omega_ie_i(earth)
    turn = (turned[:-1].inv() * turned[1:]).as_rotvec()
    middle = turned[:-1] * Rotation.from_rotvec(0.5 * turn)
    r_i, g_i = 0.5 * (at.r_i[:-1] + at.r_i[1:]), np.empty((len(t_s) - 1, 3))
    for k in range(len(g_i)):
        C_ie = frames.dcm_ie(earth, 0.5 * (t_s[k] + t_s[k + 1]))
        g_i[k] = C_ie @ gravity.normal_gravity_e(C_ie.T @ r_i[k])
    g_i += np.cross(omega_i, np.cross(omega_i, r_i))  # normal gravity has the centrifugal acceleration in it
    rate, force = turn / h_s, middle.inv().apply(np.diff(at.v_i, axis=0) / h_s - g_i)
    return ready, rate, force


def _errors(sensor, h_s, rng):
    """Errors of three axes over samples of durations h_s (N,): (N, 3), in the unit of the sensor."""
    white = rng.standard_normal((len(h_s), 3)) * (sensor.random_walk / np.sqrt(h_s))[:, None]
    left = np.exp(-h_s / sensor.in_run_bias_time)[:, None]
    driven = np.sqrt(1.0 - left**2) * rng.standard_normal((len(h_s), 3))
    in_run, now = np.empty((len(h_s), 3)), rng.standard_normal(3)
    for k in range(len(h_s)):
        now = in_run[k] = left[k] * now + driven[k]
    return sensor.bias * rng.standard_normal(3) + sensor.in_run_bias * in_run + white


def _measured(fix, ready, rng):
    """The fix with another noise about the truth."""
    truth = reference.at(ready.data.truth, ready.earth, np.array([fix.t_valid_s]))
    r_e, v_e = frames.ecef_from_inertial(ready.earth, fix.t_valid_s, truth.r_i[0], truth.v_i[0])
    noise_r, noise_v = (np.linalg.cholesky(R) @ rng.standard_normal(3) for R in (fix.R_r_e, fix.R_v_e))
    return fix._replace(r_ea_e=r_e + noise_r, v_ea_e=v_e + noise_v)
