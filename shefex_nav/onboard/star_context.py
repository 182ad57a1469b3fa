"""What the built-in navigation tells the star tracker about a frame."""

from math import acos, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import mean_rate, strapdown
from shefex_nav.onboard.navigation.state import ATT, MOUNTING, X_MOUNTING, X_Q, X_R, X_V
from shefex_nav.onboard.startracker.tracker import Context

PREDICTION_FLOOR = np.radians(40.0 / 3600.0)  # rad; aberration, which the predicted places do not have


class Sky(NamedTuple):
    """What is known of the sky beforehand, constant within the mission."""

    sun_i: np.ndarray  # (3,) unit vector to the Sun
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre


def full_context(nav, frame, sky):
    """Context of a frame with prediction and rate.

    Place and geometry are those of the tick nearest to its instant: within 5 ms they do not change. The
    attitude is carried on to the instant itself, and the rate is the mean from the opening of the first row
    to the closing of the last.

    fusion.Filter, Frame, Sky -> tracker.Context
    """
    history, C_bc = nav.history, nav.params.C_bc
    ticks = history.oldest, history.newest, history.place(history.nearest(frame.t_valid_s))
    shot = frame.t_valid_s, frame.t_start_s, frame.exposure_s, frame.line_s, frame.image_dn.shape[0]
    context, known = _full_context(nav.constants, history.arrays, ticks, C_bc, shot, sky)
    return context if known else context._replace(omega_c=None, P_omega_c=None, unsteady_c=None)


def brief_context(nav, frame, sky):
    """`full_context` without prediction and rate, for a chain that does not search by them."""
    history, t_valid_s = nav.history, frame.t_valid_s
    place = history.place(history.nearest(t_valid_s))
    v_i, _, _, *angles = _sight(history.arrays, place, nav.params.C_bc, t_valid_s, nav.earth, sky.sun_i)
    return Context(v_i + sky.earth_velocity_i, *angles)


@kernel
def _full_context(constants, memory, ticks, C_bc_nominal, shot, sky):
    """`full_context`, and whether the memory covers the exposure.

    constants, memory : prediction.Constants, prediction.Memory
    ticks : numbers of its oldest and newest tick, place of the one that ends nearest to the frame's instant
    shot : mission times of the frame's instant and of the opening of its first row, exposure [s], from one
        row to the next [s], number of rows
    sky : Sky
    """
    oldest, newest, place = ticks
    t_valid_s, t_start_s, exposure_s, line_s, n_rows = shot
    v_i, C_bc, C_ic, rate, sun_angle, limb_angle = _sight(
        memory, place, C_bc_nominal, t_valid_s, constants.earth, sky.sun_i
    )
    near = mean_rate.Estimates(
        memory.xs[place], memory.Ps[place], memory.numbers[place, 3], memory.drives[place]
    )
    exposed_s = t_start_s, t_start_s + (exposure_s + (n_rows - 1) * line_s), t_valid_s
    known, omega_c, P_omega_c, unsteady_c, variance = mean_rate.camera_rate(
        constants, memory, (oldest, newest), near, C_bc, exposed_s
    )
    P_c = camera_covariance(constants.at, near.P, C_bc_nominal)
    for i in range(3):
        P_c[i, i] += PREDICTION_FLOOR**2
    v_i += sky.earth_velocity_i
    q_ic = rotation.quat_from_dcm(C_ic)
    return Context(
        v_i, rate, sun_angle, limb_angle, q_ic, P_c, omega_c, P_omega_c, unsteady_c, variance
    ), known


@kernel
def _sight(memory, place, C_bc_nominal, t_valid_s, earth, sun_i):
    """Velocity, mounting, attitude at t_valid_s; rate, angles of the boresight to Sun and limb.

    memory : prediction.Memory;  place : in it, of the tick that ends nearest to t_valid_s
    """
    x, t_s, dt_s = memory.xs[place], memory.numbers[place, 0], memory.numbers[place, 1]
    n, vibration = int(memory.numbers[place, 2]), memory.numbers[place, 3]
    drive = memory.drives[place]
    omega_b = strapdown.sensed_packed(x, memory.increments[place], n, dt_s, vibration, drive, n * dt_s)[:3]
    C_bc = rotation.dcm_from_rotvec(x[X_MOUNTING]) @ C_bc_nominal
    turned = rotation.dcm_from_rotvec(omega_b * (t_valid_s - t_s))
    C_ic = rotation.dcm_from_quat(x[X_Q]) @ turned @ C_bc
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, t_s).T)
    boresight_i = np.ascontiguousarray(C_ic[:, 2])
    sun_angle = acos(min(1.0, max(-1.0, boresight_i @ sun_i)))
    limb_angle = wgs84.limb_angle(C_ei @ x[X_R], C_ei @ boresight_i)
    return x[X_V].copy(), C_bc, C_ic, sqrt(omega_b @ omega_b), sun_angle, limb_angle


@inner
def camera_covariance(at, P, C_bc):
    """Covariance of the camera's attitude error in camera axes: attitude and mounting add up.

    at : of Layout;  P : (n, n) of the filter;  C_bc : (3, 3) nominal mounting -> (3, 3) rad^2
    """
    P_b, first = P[ATT, ATT].copy(), at[MOUNTING]
    if first >= 0:
        mounting = slice(first, first + 3)
        P_b += P[ATT, mounting]
        P_b += P[mounting, ATT]
        P_b += P[mounting, mounting]
    return C_bc.T @ P_b @ C_bc
