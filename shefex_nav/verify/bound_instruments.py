"""Readings of instruments in the bound: what each says of the errors of navigation and of its own.

An instrument declares what a reading is as a function of the true motion and of what the world draws for it
(`instrument.Equation`). Its rows are differences of that function at the true flight, with no errors drawn.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import sample_s
from shefex_nav.geometry import rotation
from shefex_nav.instruments.instrument import Place
from shefex_nav.verify.bound_model import N_NAV, POS, PSI, VEL, Source

STEPS = np.repeat([10.0, 0.1, 1e-5], 3)  # m, m/s, rad, to either side
OF_SIGMA = 1e-3  # step of an error that is drawn


class Readings(NamedTuple):
    """N readings of an instrument that measure anything."""

    name: str
    sources: tuple[Source, ...]  # named <instrument>.<error>
    k: np.ndarray  # (N,) sample of the trajectory
    t_available_s: np.ndarray  # (N,)
    H: np.ndarray  # (N, m, 9 + s) of position, velocity and attitude in inertial axes, and of the sources
    R: np.ndarray  # (m, m)


def readings_of(name, equation, readings, trajectory):
    """Heard of the readings of an instrument. str, instrument.Equation, list, Trajectory"""
    t_s, used = trajectory.t_s, [one for one in readings if equation.holds is None or equation.holds(one)]
    dt_s = sample_s(t_s)
    k = np.array([round((one.t_valid_s - t_s[0]) / dt_s) for one in used], dtype=np.int64)
    sources = tuple(
        Source(f"{name}.{one.name}", len(one.sigma), np.asarray(one.sigma), one.tau_s, one.length)
        for one in equation.errors
    )
    rows = [_rows(equation, trajectory, one) for one in k.tolist()]
    n = N_NAV + sum(source.size for source in sources)
    H = np.array(rows).reshape(len(rows), len(equation.R), n)
    return Readings(name, sources, k, np.array([one.t_available_s for one in used]), H, equation.R)


def _rows(equation, trajectory, k):
    """H of a reading at sample k, by differences: (m, 9 + s)."""
    none = {one.name: np.zeros(len(one.sigma)) for one in equation.errors}
    true = Place(
        k,
        float(trajectory.t_s[k]),
        trajectory.r_i[k],
        trajectory.v_i[k],
        rotation.dcm_from_quat(trajectory.q_ib[k]),
    )
    columns = []
    for c, step in enumerate(STEPS):
        e = np.zeros(N_NAV)
        e[c] = step
        more, less = (equation.read(_moved(true, side), none) for side in (e, -e))
        columns.append((more - less) / (2.0 * step))
    healthy = equation.read(true, none)
    for one in equation.errors:
        for j, sigma in enumerate(one.sigma):
            size = OF_SIGMA * sigma
            if size == 0.0:
                columns.append(np.zeros(len(healthy)))
                continue
            e = np.zeros(len(one.sigma))
            e[j] = size
            columns.append((equation.read(true, {**none, one.name: e}) - healthy) / size)
    return np.column_stack(columns)


def _moved(place, e):
    """Place with errors (9,) of position, velocity and attitude, the last about inertial axes."""
    return place._replace(
        r_i=place.r_i + e[POS],
        v_i=place.v_i + e[VEL],
        C_ib=rotation.dcm_from_rotvec(e[PSI]) @ place.C_ib,
    )
