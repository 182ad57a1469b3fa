"""What the navigation starts from: where the vehicle is said to be, with the errors of a survey.

On the ground the launch crew says it, in orbit whatever determined orbit and attitude before.
"""

from math import erf

import numpy as np

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Alignment, Phase
from shefex_nav.world.absent import of_alignment

UNKNOWN = np.pi / np.sqrt(3.0)  # rad, sigma of an angle of which nothing is known


def align(settings, trajectory, earth, rng, absent=()):
    """Alignment at the first sample of the trajectory.

    truth = estimate (+) error, q_ib(true) = q_ib(estimate) * exp(error_b): the attitude error is drawn
    about north, east and down, and its covariance is reported in body axes. On the ground the estimated
    velocity is that of a point which stands on the Earth at the estimated position, but for its error; in
    orbit errors of position and velocity have nothing to do with each other.

    Parameters
    ----------
    settings : settings.PadAlignment
    trajectory : Trajectory
    earth : EarthRotation
    rng : Generator
    absent : of `absent.NAMES`, errors that are reported and do not happen

    Returns
    -------
    Alignment
    """
    t_s = float(trajectory.t_s[0])
    r_e, v_e = frames.ecef_from_inertial(earth, t_s, trajectory.r_i[0], trajectory.v_i[0])
    error_r, error_v, error_n = rng.standard_normal((3, 3))
    of_place, of_angles = of_alignment(absent)
    error_r, error_v = of_place * settings.position * error_r, of_place * settings.velocity * error_v
    omega_i = frames.omega_ie_i(earth)  # of what the velocity is known against
    if trajectory.phase[0] == Phase.ORBIT:
        C_ie, omega_i = frames.dcm_ie(earth, t_s), np.zeros(3)
        r_i, v_i = trajectory.r_i[0] - C_ie @ error_r, trajectory.v_i[0] - C_ie @ error_v
    else:
        r_i, v_i = frames.inertial_from_ecef(earth, t_s, r_e - error_r, v_e - error_v)

    C_in = frames.dcm_ie(earth, t_s) @ wgs84.level_axes(r_e)
    sigma_n = np.array([settings.level, settings.level, settings.azimuth])
    if np.isinf(settings.azimuth):  # anything within half a turn, from the same draw
        sigma_n[2], error_n[2] = UNKNOWN, np.sqrt(3.0) * erf(error_n[2] / np.sqrt(2.0))
    q_ib_true = trajectory.q_ib[0]
    error_b = rotation.dcm_from_quat(q_ib_true).T @ C_in @ (of_angles * sigma_n * error_n)
    q_ib = rotation.quat_multiply(q_ib_true, rotation.quat_from_rotvec(-error_b))

    C_bn = rotation.dcm_from_quat(q_ib).T @ C_in
    P_theta_b = C_bn @ np.diag(sigma_n**2) @ C_bn.T
    sigmas = settings.position, settings.velocity
    return Alignment(t_s, r_i, v_i, q_ib, *sigmas, P_theta_b, omega_i=omega_i)
