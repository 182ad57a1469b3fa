"""What the channels of a receiver measure of satellites, whose signals take a fourteenth of a second.

The satellite is where it was at transmission, in axes that have turned with the Earth since (Sagnac)::

    rho = |R3(omega tau) r_s(t - tau) - r_a(t)|,   tau = rho/c
    drho/dt = u . (v_s - v_a)/(1 + u . v_s/c),     v_s, v_a inertial

the denominator because the satellite moves less during transmission than the receiver's clock says (Groves,
2nd ed., sections 8.5.2, 8.5.3 and 9.3). Relativity of the satellite's clock is in what it broadcasts. Epochs
are whole seconds of the mission's time, as of a receiver whose time pulse is steered; its bias of time is
in the pseudoranges alone, without the metres that the vehicle moves in it.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gnss
from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import wgs84
from shefex_nav.records import GpsRanges

LIGHT_TIME_PASSES = (
    4  # each takes the error of the range down by a factor of 1e5 (satellite over light speed)
)


LASTING = "sigma_lasting", "sigma_shared"  # fields of GpsRanges


class Reception(NamedTuple):
    """Which of n satellites are received at m epochs."""

    t_s: np.ndarray  # (m,)
    prn: np.ndarray  # (n,) int
    tracked: np.ndarray  # (m, n) bool
    reasons: list  # (m,) str, why nothing is tracked


def geometry(constellation, t_s, r_ea_e, v_ea_e):
    """Ranges and range rates without any error, and where the signals came from.

    Parameters
    ----------
    constellation : gnss.Constellation
    t_s : (m,) s, of reception
    r_ea_e, v_ea_e : (m, 3) m, m/s, antenna, relative to the Earth

    Returns
    -------
    rho, rho_rate : (m, n) m, m/s
    r_es_e, v_es_e : (m, n, 3) m, m/s, satellites at transmission in the axes e of reception
    """
    tau = np.full((len(t_s), len(constellation.node)), 0.075)
    for _ in range(LIGHT_TIME_PASSES):
        r_e, v_e = gnss.states_e(constellation, t_s[:, None] - tau)
        r_es_e, v_es_e = _rotated_with_earth(r_e, tau), _rotated_with_earth(v_e, tau)
        tau = np.linalg.norm(r_es_e - r_ea_e[:, None, :], axis=-1) / SPEED_OF_LIGHT
    rho, rho_rate = between(r_es_e, v_es_e, r_ea_e, v_ea_e)
    return rho, rho_rate, r_es_e, v_es_e


def between(r_es_e, v_es_e, r_ea_e, v_ea_e):
    """Ranges and range rates of satellites at transmission: the formulas above.

    (..., n, 3), (..., n, 3), (..., 3), (..., 3) m, m/s, axes e of reception -> (..., n) m, (..., n) m/s
    """
    d = r_es_e - r_ea_e[..., None, :]
    rho = np.linalg.norm(d, axis=-1)
    u = d / rho[..., None]
    earth_rate = np.array([0.0, 0.0, wgs84.OMEGA])
    v_s = v_es_e + np.cross(earth_rate, r_es_e)
    v_a = (v_ea_e + np.cross(earth_rate, r_ea_e))[..., None, :]
    rho_rate = np.sum(u * (v_s - v_a), axis=-1) / (1.0 + np.sum(u * v_s, axis=-1) / SPEED_OF_LIGHT)
    return rho, rho_rate


def _rotated_with_earth(x_e, tau):
    """Components in the axes e of tau later: the Earth has turned. (m, n, 3), (m, n) s -> (m, n, 3)."""
    c, s = np.cos(wgs84.OMEGA * tau), np.sin(wgs84.OMEGA * tau)
    x, y, z = x_e[..., 0], x_e[..., 1], x_e[..., 2]
    return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)


def ranges(geometry, clock, errors, sigmas, reception, latency_s, lasting=None):
    """GpsRanges of every epoch.

    Parameters
    ----------
    geometry : rho, rho_rate, r_es_e, v_es_e of `geometry`
    clock : bias (m,) m, drift (m,) m/s
    errors : (2, m, n) m, m/s of range and range rate, everything but the clock
    sigmas : (2, m) m, m/s, noise of a channel as the receiver reports it
    reception : Reception
    latency_s : s
    lasting : (2, m, n) m, of `RangeErrors.sigmas`; None: there are none

    Returns
    -------
    list of GpsRanges
    """
    rho, rho_rate, r_es_e, v_es_e = geometry
    pseudorange = rho + clock[0][:, None] + errors[0]
    range_rate = rho_rate + clock[1][:, None] + errors[1]
    t_s, result = reception.t_s, []
    for k, seen in enumerate(reception.tracked):
        n = int(seen.sum())
        reason = "" if n else reception.reasons[k] or "0 satellites tracked"
        result.append(
            GpsRanges(
                t_valid_s=float(t_s[k]),
                t_available_s=float(t_s[k]) + latency_s,
                prn=reception.prn[seen],
                pseudorange=pseudorange[k, seen],
                range_rate=range_rate[k, seen],
                r_es_e=r_es_e[k, seen],
                v_es_e=v_es_e[k, seen],
                sigma_range=np.full(n, sigmas[0][k]),
                sigma_range_rate=np.full(n, sigmas[1][k]),
                reason=reason,
                **({} if lasting is None else dict(zip(LASTING, lasting[:, k, seen], strict=True))),
            )
        )
    return result
