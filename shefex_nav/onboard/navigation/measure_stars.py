"""What single stars say about the errors: two rows a star, across the direction in which the camera sees it.

z = H dx + noise, noise ~ N(0, R), dx in the order of a `state.Layout`, as in `measurements`. A star that the
moving vehicle sees in the direction u_i is seen by the camera in

    u_c = C_cb exp(-skew(mounting)) C_bi u_i,     C_cb the nominal mounting,

and with E (2, 3) the axes across the MEASURED direction, `pinhole.cross_axes`, which do not move with the
estimate,

    z = E (u_c measured - u_c) = -E u_c,     |z| the sine of the angle between the two.

One star says nothing about turns around itself, two at different places say all there is to say about the
attitude. What the stars of a frame share is in R: the error of the rate that carried places to one instant
(rolling shutter), that of the focal length, which moves all stars outwards, and the floor of
`measurements.star_attitude`, a small turn of the camera. So many stars say together what the attitude says
that is made of them. The camera's mounting is a state, if it is one.

Unit vectors as measurements: Markley and Crassidis, Fundamentals of Spacecraft Attitude Determination and
Control, section 6.2.2.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import cross_axes
from shefex_nav.onboard.navigation.state import ATT, right_jacobian


def star_vectors(layout, state, fix, C_bc, sigma_floor):
    """Directions of the m stars of a frame.

    Parameters
    ----------
    layout : Layout
    state : NavState at the instant of the frame
    fix : StarFix, of which `stars` is used
    C_bc : (3, 3) nominal mounting
    sigma_floor : rad, each axis, of a turn of the camera that all stars of the frame share

    Returns
    -------
    z : (2 m,) rad, star by star along its cross axes
    H : (2 m, n)
    R : (2 m, 2 m) rad^2
    """
    mounting = layout.places["mounting"]
    first = -1 if mounting is None else mounting.start
    stars = fix.stars._replace(u_c=np.ascontiguousarray(fix.stars.u_c))
    turns = state.q_ib, np.array(state.mounting), C_bc
    return _star_vectors(*turns, stars, sigma_floor, layout.n, first)


def rotated_back(stars, turn_c, P):
    """StarVectors as a camera sees them that is turned back by a small angle.

    turn_c : (3,) rad, camera axes;  P : (3, 3) rad^2, its covariance, which counts for each star by itself
    """
    u_c = stars.u_c - np.cross(stars.u_c, turn_c)
    u_c = u_c / np.sqrt(np.sum(u_c**2, axis=1))[:, None]
    moved = [E @ rotation.skew(u) for E, u in zip(cross_axes(u_c), u_c, strict=True)]
    return stars._replace(u_c=u_c, P_u=stars.P_u + np.array([A @ P @ A.T for A in moved]))


@kernel
def _star_vectors(q_ib, mounting, C_bc, stars, sigma_floor, n, first):
    """`star_vectors` of its parts; n : errors;  first : error of the mounting, -1 if it is none."""
    u_c, m = stars.u_c, stars.u_c.shape[0]
    H, R = np.zeros((2 * m, n)), np.zeros((2 * m, 2 * m))
    C_bi = np.ascontiguousarray(rotation.dcm_from_quat(q_ib).T)
    C_cb = np.ascontiguousarray(C_bc.T)
    C_m = np.ascontiguousarray(rotation.dcm_from_rotvec(mounting).T)
    J_m = right_jacobian(mounting)
    E = cross_axes(u_c)
    z, A, F = np.empty(2 * m), np.empty((2 * m, 3)), np.empty((2 * m, 1))
    for k in range(m):
        two = slice(2 * k, 2 * k + 2)
        u_b = C_bi @ np.ascontiguousarray(stars.u_i[k])
        w_b = C_m @ u_b
        EC = E[k] @ C_cb
        z[two] = -(EC @ w_b)
        # u_b turns against the body: u_b(true) = u_b + u_b x dtheta; likewise behind the mounting
        H[two, ATT] = EC @ C_m @ rotation.skew(u_b)
        if first >= 0:
            H[two, first : first + 3] = EC @ rotation.skew(w_b) @ J_m
        A[two] = E[k] @ rotation.skew(u_c[k])
        F[two, 0] = -u_c[k, 2] * E[k, :, 2]  # u = n/|n|: n outwards is all of n but the boresight
        R[two, two] = stars.P_u[k]
    T = np.empty((2 * m, 3))
    for i in range(2 * m):
        T[i] = stars.t_seen_s[i // 2] * A[i]
    R += T @ stars.P_omega_c @ T.T + sigma_floor**2 * (A @ A.T) + stars.sigma_focal**2 * (F @ F.T)
    return z, H, R
