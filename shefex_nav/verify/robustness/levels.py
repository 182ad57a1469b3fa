"""How wrong each quantity is, how wrong it may be, and whether it may be used: read in one place."""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import rotation


class Quantity(NamedTuple):
    """Over the instants of a flight."""

    error: np.ndarray  # (n, 3)
    level: np.ndarray  # (n, 3) protection level
    usable: np.ndarray  # (n,) bool
    doubt: np.ndarray  # (n,) Doubt of it

    @property
    def beyond(self):
        """(n,) bool: the error of an axis exceeds its level, or its level is no number."""
        return ~(np.abs(self.error) <= self.level).all(axis=1)

    @property
    def ratio(self):
        """(n,) the largest error over its level while it may be used, 0 elsewhere."""
        share = (np.abs(self.error) / self.level).max(axis=1)
        return np.where(self.usable, share, 0.0)


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
    # a line for each quantity that has a protection level of its own
    quantities = {
        "attitude": Quantity(
            attitude, solution.protection_b[:n], ~solution.do_not_use[:n], solution.doubt[:n]
        ),
    }
    return Flown(t_s, quantities, nees(kept.covariance.P[:n], error))


def nees(P, error):
    """Normalised errors squared: (n, 9, 9), (n, 9) -> (n,)."""
    sigma = np.sqrt(np.einsum("kii->ki", P))
    scaled = P / (sigma[:, :, None] * sigma[:, None, :])  # metres and radians in one matrix
    z = error / sigma
    return np.einsum("ki,ki->k", z, np.linalg.solve(scaled, z[:, :, None])[:, :, 0])


def stretches(flags, t_s):
    """Begin and end of each run of True: list of (first, last) indices; t_s : (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, dtype=int), [0]])))
    return [(int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]
