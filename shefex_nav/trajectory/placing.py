"""Frames of files -> inertial axes of this program (GCRS).

Positions and velocities come as (N, 3) with the name of their frame; what is relative to the Earth becomes
inertial by the orientation of the Earth that the scenario has.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import euler, frames, wgs84
from shefex_nav.geometry.rotation import quat_from_dcm


class Place(NamedTuple):
    """The Earth at the instants of the rows, and where launch_enu has its origin."""

    earth: object  # EarthRotation
    C_ie: np.ndarray  # (N, 3, 3)
    origin: tuple | None  # latitude rad, longitude rad, height m

    @property
    def C_el(self):
        """East, north, up at the origin to frame e: (3, 3)."""
        return wgs84.dcm_el(*self.origin[:2])


def place(earth, t_s, origin=None):
    """Place of rows at mission times (N,) s. origin : scenario.trajectory.Origin"""
    at = None if origin is None else (origin.latitude, origin.longitude, origin.height)
    return Place(earth, frames.dcms_ie(earth, t_s), at)


def rotated(C, vectors):
    """Vectors (N, 3) by matrices (N, 3, 3)."""
    return np.einsum("kij,kj->ki", C, vectors)


def ecef(here, values, frame):
    """Positions (N, 3) m relative to the Earth. values : rad, rad, m if they are geodetic"""
    if frame == "geodetic":
        return np.array([wgs84.ecef_from_geodetic(*one) for one in values])
    if frame == "launch_enu":
        return wgs84.ecef_from_geodetic(*here.origin) + values @ here.C_el.T
    return rotated(here.C_ie.transpose(0, 2, 1), values) if frame == "inertial" else values


def axes(here, r_e, frame):
    """C_e of a frame at the rows, (N, 3, 3): its components to components in e."""
    n = len(here.C_ie)
    if frame == "launch_enu":
        return np.broadcast_to(here.C_el, (n, 3, 3))
    if frame == "inertial":
        return here.C_ie.transpose(0, 2, 1)
    if frame == "ecef":
        return np.broadcast_to(np.eye(3), (n, 3, 3))
    C_en = np.array([wgs84.level_axes(one) for one in r_e])
    if frame == "enu":
        return np.stack([C_en[:, :, 1], C_en[:, :, 0], -C_en[:, :, 2]], axis=2)
    return C_en


def velocities(here, r_i, values, frame):
    """Inertial velocities (N, 3) m/s; all frames but 'inertial' move with the Earth.

    r_i : (N, 3) m
    """
    if frame == "inertial":
        return values
    r_e = rotated(here.C_ie.transpose(0, 2, 1), r_i)
    v_e = rotated(axes(here, r_e, frame), values)
    return rotated(here.C_ie, v_e) + np.cross(frames.omega_ie_i(here.earth), r_i)


def accelerations(here, r_i, v_i, values, frame):
    """Inertial accelerations (N, 3) m/s^2 of those that a frame has: ecef, launch_enu or inertial."""
    if frame == "inertial":
        return values
    omega_i = frames.omega_ie_i(here.earth)
    a_i = rotated(here.C_ie, rotated(axes(here, r_i, frame), values))
    return a_i + 2.0 * np.cross(omega_i, v_i) - np.cross(omega_i, np.cross(omega_i, r_i))


def attitudes(here, r_e, C_fb, frame):
    """q_ib (N, 4) of attitudes C_fb (N, 3, 3), body to a frame."""
    C_ib = here.C_ie @ axes(here, r_e, frame) @ C_fb
    return np.array([quat_from_dcm(np.ascontiguousarray(one)) for one in C_ib])


def body_axes(C_ff, sides):
    """C_fb (N, 3, 3) of C_ff, of the axes of a file's body, of which `sides` are forward, right, down."""
    columns = [C_ff[:, :, "xyz".index(side[-1])] * (-1.0 if side[0] == "-" else 1.0) for side in sides]
    return np.stack(columns, axis=2)


def of_quaternions(q, sense="body_to_frame"):
    """C_fb (N, 3, 3) of quaternions (N, 4), scalar first, that take the body's components to a frame's."""
    w, x, y, z = q.T if sense == "body_to_frame" else (q * [1.0, -1.0, -1.0, -1.0]).T
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return np.array(rows).transpose(2, 0, 1)


def of_angles(angles):
    """C_nb (N, 3, 3) of roll, pitch and heading (N, 3) rad."""
    return np.array([euler.dcm_from_euler(*one) for one in angles])
