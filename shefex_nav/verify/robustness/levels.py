"""How wrong each quantity is, how wrong it may be, and whether it may be used: read in one place."""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import QUANTITIES, protected
from shefex_nav.report import pairing
from shefex_nav.report.navigation_errors import nees


class Quantity(NamedTuple):
    """Over the instants of a flight, along the axes of its protection level."""

    error: np.ndarray  # (n, axes) sizes
    level: np.ndarray  # (n, axes)
    usable: np.ndarray  # (n,) bool
    doubt: np.ndarray  # (n,) Doubt of it

    @property
    def beyond(self):
        """(n,) bool: the error along an axis exceeds its level, or its level is no number."""
        return ~(self.error <= self.level).all(axis=1)

    @property
    def ratio(self):
        """(n,) the largest error over its level while it may be used, 0 elsewhere."""
        return np.where(self.usable, (self.error / self.level).max(axis=1), 0.0)


class Flown(NamedTuple):
    """Errors of a flight."""

    t_s: np.ndarray  # (n,)
    quantities: dict  # name -> Quantity
    nees: np.ndarray  # (n,) of position, velocity and attitude, 9 degrees of freedom


def read(kept):
    """Flown of a flight.Kept."""
    truth, solution = kept.truth, kept.solution
    n = min(len(truth.t_s), len(solution.t_s), len(kept.covariance.t_s))
    t_s = solution.t_s[:n]
    if not (np.allclose(truth.t_s[:n], t_s) and np.allclose(kept.covariance.t_s[:n], t_s)):
        raise ValueError("truth, solution and covariance are of different instants")
    attitude = rotation.rotvec_between(solution.q_ib[:n], truth.q_ib[:n])
    error = np.hstack([truth.r_i[:n] - solution.r_i[:n], truth.v_i[:n] - solution.v_i[:n], attitude])
    along = {"position": np.empty((n, 2)), "velocity": np.empty((n, 2)), "attitude": np.abs(attitude)}
    true = truth.t_s[:n], truth.r_i, truth.v_i
    _along_axes(kept.earth, *true, solution.r_e, solution.v_e, along["position"], along["velocity"])
    quantities = {}
    for name in QUANTITIES:
        said = protected(solution, name)
        quantities[name] = Quantity(along[name], said.level[:n], ~said.do_not_use[:n], said.doubt[:n])
    return Flown(t_s, quantities, nees(error, kept.covariance.P[:n]))


@kernel
def _along_axes(earth, t_s, r_i, v_i, said_r_e, said_v_e, position, velocity):
    """Errors of position and velocity against the Earth, horizontal and vertical where the vehicle truly is.

    t_s, r_i, v_i : (n,), (n, 3) the truth;  said_r_e, said_v_e : (n, 3) the solution
    position, velocity : (n, 2) m, m/s, sizes, are written
    """
    for k in range(len(t_s)):
        r_e, v_e = frames.ecef_from_inertial(earth, t_s[k], r_i[k], v_i[k])
        latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
        C_ne = wgs84.dcm_en(latitude, longitude).T
        for row, of_earth in ((position[k], r_e - said_r_e[k]), (velocity[k], v_e - said_v_e[k])):
            north, east, down = C_ne @ of_earth
            row[0], row[1] = np.hypot(north, east), abs(down)


def stretches(flags):
    """Begin and end of each run of True: list of (first, last) indices."""
    return [(first, end - 1) for first, end in pairing.stretches(flags)]
