"""A body on a turntable that stands on the Earth: the truth and what ideal sensors say, in closed form.

Heading grows at a constant rate about the vertical, roll and pitch are constant, the place is fixed.
Increments are integrals by Simpson's rule over twenty parts of a sample.
"""

from itertools import pairwise
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
    """Rate and specific force in body axes at one instant, under the gravity that the filter knows."""
    C_nb, C_en = table.C_nb(t_s), wgs84.dcm_en(LATITUDE, LONGITUDE)
    r_e, omega_e = place_e(), np.array([0.0, 0.0, earth_rate])
    g_n = C_en.T @ (gravity.gravity_j2_e(r_e) - np.cross(omega_e, np.cross(omega_e, r_e)))
    omega_n = C_en.T @ omega_e + np.array([0.0, 0.0, table.rate])
    return C_nb.T @ omega_n, -C_nb.T @ g_n


def increments(table, t_s, earth_rate):
    """Angles and velocities between the times, (N - 1, 3) each."""
    weights = np.ones(PARTS + 1)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    turn, gain = [], []
    for begin, end in pairwise(t_s):
        values = [felt(table, t, earth_rate) for t in np.linspace(begin, end, PARTS + 1)]
        scale = (end - begin) / PARTS / 3.0
        turn.append(scale * weights @ np.array([value[0] for value in values]))
        gain.append(scale * weights @ np.array([value[1] for value in values]))
    return np.array(turn), np.array(gain)
