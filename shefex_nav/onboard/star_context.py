"""What the built-in navigation tells the star tracker about a frame."""

from math import acos, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import frames, rotation, shutter, wgs84
from shefex_nav.onboard.navigation import mean_rate, strapdown
from shefex_nav.onboard.navigation.state import ATT, X_MOUNTING, X_Q, X_R, X_V
from shefex_nav.onboard.startracker.tracker import Context

PREDICTION_FLOOR = np.radians(40.0 / 3600.0)  # rad; aberration, which the predicted places do not have


class Sky(NamedTuple):
    """What is known of the sky beforehand, constant within the mission."""

    sun_i: np.ndarray  # (3,) unit vector to the Sun
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre


def whole(nav, frame, sky):
    """Context of a frame with prediction and rate.

    Place and geometry are those of the tick nearest to its instant: within 5 ms they do not change. The
    attitude is carried on to the instant itself, and the rate is the mean from the opening of the first row
    to the closing of the last.

    fusion.Filter, Frame, Sky -> tracker.Context
    """
    index = nav.history.nearest(frame.t_valid_s)
    C_bc, C_ic, surroundings = _surroundings(nav, index, frame.t_valid_s, sky)
    near = nav.history[index]
    times = shutter.row_times(frame.exposure_s, frame.line_s, frame.image_dn.shape[0])
    end_s = frame.t_start_s + shutter.duration_s(times)
    omega_c, P_omega_c = mean_rate.camera_rate(nav, near, C_bc, frame.t_start_s, end_s)
    return surroundings._replace(
        q_ic=rotation.quat_from_dcm(C_ic),
        P_c=camera_covariance(nav.layout, near.P, nav.params.C_bc) + PREDICTION_FLOOR**2 * np.eye(3),
        omega_c=omega_c,
        P_omega_c=P_omega_c,
    )


def brief(nav, frame, sky):
    """`whole` without prediction and rate, for a chain that does not search by them."""
    return _surroundings(nav, nav.history.nearest(frame.t_valid_s), frame.t_valid_s, sky)[2]


def _surroundings(nav, index, t_valid_s, sky):
    """Mounting and attitude of the camera at an instant, and the Context without the prediction.

    Filter, index of the tick nearest to it, time, Sky -> C_bc, C_ic, Context
    """
    history = nav.history
    v_i, C_bc, C_ic, *angles = _sight(
        history.arrays, history.place(index), nav.params.C_bc, t_valid_s, nav.earth, sky.sun_i
    )
    return C_bc, C_ic, Context(v_i + sky.earth_velocity_i, *angles)


@kernel
def _sight(memory, place, C_bc_nominal, t_valid_s, earth, sun_i):
    """Velocity, mounting, attitude at t_valid_s; rate, angles of the boresight to Sun and limb.

    memory : prediction.Memory;  place : in it, of the tick that ends nearest to t_valid_s
    """
    x, t_s, dt_s = memory.xs[place], memory.numbers[place, 0], memory.numbers[place, 1]
    n, vibration = int(memory.numbers[place, 2]), memory.numbers[place, 3]
    drive = memory.drives[place]
    omega_b = strapdown.felt_packed(x, memory.increments[place], n, dt_s, vibration, drive, n * dt_s)[:3]
    C_bc = rotation.dcm_from_rotvec(x[X_MOUNTING]) @ C_bc_nominal
    turned = rotation.dcm_from_rotvec(omega_b * (t_valid_s - t_s))
    C_ic = rotation.dcm_from_quat(x[X_Q]) @ turned @ C_bc
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, t_s).T)
    boresight_i = np.ascontiguousarray(C_ic[:, 2])
    sun_angle = acos(min(1.0, max(-1.0, boresight_i @ sun_i)))
    limb_angle = wgs84.limb_angle(C_ei @ x[X_R], C_ei @ boresight_i)
    return x[X_V].copy(), C_bc, C_ic, sqrt(omega_b @ omega_b), sun_angle, limb_angle


def camera_covariance(layout, P, C_bc):
    """Covariance of the camera's attitude error in camera axes: attitude and mounting add up.

    Layout; P : (n, n) of the filter; C_bc : (3, 3) nominal mounting -> (3, 3) rad^2
    """
    P_b = P[ATT, ATT]
    if mounting := layout.places["mounting"]:
        P_b = P_b + P[ATT, mounting] + P[mounting, ATT] + P[mounting, mounting]
    return C_bc.T @ P_b @ C_bc
