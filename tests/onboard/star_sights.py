"""Stars as the camera of a vehicle sees them, anywhere in the picture: `StarVectors` for the filter."""

import numpy as np
from navigation_flight import C_BC
from scipy.spatial.transform import Rotation
from star_fields import CAMERA

from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import cross_covariance, unit_vectors
from shefex_nav.records import Reason, StarFix, StarVectors

SIGMA_PX = 0.2


def camera_attitude(state):
    """C_ic of a state, through scipy: mounting and attitude as rotations, one after the other."""
    turned = Rotation.from_quat(rotation.xyzw(state.q_ib)) * Rotation.from_rotvec(np.array(state.mounting))
    return (turned * Rotation.from_matrix(C_BC)).as_matrix()


def seen(truth, xy_px, rng=None, t_seen_s=None, P_omega_c=None, sigma_focal=0.0):
    """StarVectors of stars that the camera of `truth` sees at xy_px; with noise if there is a generator."""
    m = len(xy_px)
    u_i = unit_vectors(CAMERA, xy_px) @ camera_attitude(truth).T
    noisy = xy_px if rng is None else xy_px + SIGMA_PX * rng.standard_normal((m, 2))
    P_px = np.tile(SIGMA_PX**2 * np.eye(2), (m, 1, 1))
    return StarVectors(
        np.arange(1, m + 1),
        unit_vectors(CAMERA, noisy),
        cross_covariance(CAMERA, noisy, P_px),
        u_i,
        np.zeros(m) if t_seen_s is None else t_seen_s,
        np.zeros((3, 3)) if P_omega_c is None else P_omega_c,
        sigma_focal,
    )


def frame_of(t_s, stars, q_ic=None, P_c=None, latency_s=0.1):
    """StarFix with stars, and with an attitude if there is one."""
    reason = Reason.TOO_FEW_STARS if q_ic is None else Reason.NONE
    q_ic, P_c = np.full(4, np.nan) if q_ic is None else q_ic, np.full((3, 3), np.nan) if P_c is None else P_c
    return StarFix(
        0, t_s, t_s + latency_s, int(reason), q_ic, P_c, None, stars.hip, 0.3, 12.0, 0.05, False, False,
        stars=stars,
    )  # fmt: skip


def places(rng, m):
    """m places in the picture, (m, 2) px."""
    return rng.random((m, 2)) * [CAMERA.width_px - 1.0, CAMERA.height_px - 1.0]
