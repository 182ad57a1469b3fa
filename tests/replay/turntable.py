"""A body on a turntable that stands on the Earth: the truth and what ideal sensors say, in closed form.

Heading grows at a constant rate about the vertical, roll and pitch are constant, the place is fixed.
Increments are integrals by Simpson's rule over twenty parts of a sample.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.geometry import euler, wgs84

LATITUDE, LONGITUDE, HEIGHT = np.radians(48.0), np.radians(11.0), 520.0
PARTS = 20


class Turntable(NamedTuple):
    """How it stands and turns."""

    roll: float = np.radians(5.0)
    pitch: float = np.radians(-8.0)
    heading: float = np.radians(130.0)
    rate: float = np.radians(12.0)  # rad/s, of the heading

    def C_nb(self, t_s):
        """Attitude at a time."""
        return euler.dcm_from_euler(self.roll, self.pitch, self.heading + self.rate * t_s)

    def angles(self, t_s):
        """(N, 3) rad: roll, pitch, heading within half a turn of zero."""
        heading = (self.heading + self.rate * t_s + np.pi) % (2.0 * np.pi) - np.pi
        return np.column_stack([np.full_like(t_s, self.roll), np.full_like(t_s, self.pitch), heading])


def place_e():
    """(3,) m, frame e."""
    return wgs84.ecef_from_geodetic(LATITUDE, LONGITUDE, HEIGHT)


def felt(table, t_s, earth_rate):
    """Rates and specific forces in body axes at times of any shape; gravity is what the filter knows."""
    C_en, r_e, omega_e = wgs84.dcm_en(LATITUDE, LONGITUDE), place_e(), np.array([0.0, 0.0, earth_rate])
    g_n = C_en.T @ (gravity.gravity_j2_e(r_e) - np.cross(omega_e, np.cross(omega_e, r_e)))
    omega_n = C_en.T @ omega_e + np.array([0.0, 0.0, table.rate])
    cos, sin = np.cos(table.rate * t_s), np.sin(table.rate * t_s)  # since the start, about the vertical

    def in_body(v_n):
        turned = np.stack([cos * v_n[0] + sin * v_n[1], cos * v_n[1] - sin * v_n[0], v_n[2] + 0.0 * cos], -1)
        return turned @ table.C_nb(0.0)

    return in_body(omega_n), -in_body(g_n)


def increments(table, t_s, earth_rate):
    """Angles and velocities between the times, (N - 1, 3) each."""
    weights = np.ones(PARTS + 1)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    values = felt(table, np.linspace(t_s[:-1], t_s[1:], PARTS + 1), earth_rate)
    scale = np.diff(t_s)[:, None] / PARTS / 3.0
    return tuple(scale * np.einsum("k,knj->nj", weights, value) for value in values)
