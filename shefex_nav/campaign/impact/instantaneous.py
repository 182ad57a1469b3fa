"""The instantaneous impact point: where the vehicle would land if its motor stopped now.

Two of them: in a vacuum, and with the drag of the vehicle as it is now, nose first, in the air and wind of
the scenario. Neither knows a parachute, nor how a vehicle tumbles.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.campaign.impact.landing import landing_of
from shefex_nav.clock import SAME_S
from shefex_nav.geometry import rotation
from shefex_nav.scenario import params
from shefex_nav.world.flight import ballistic, fly
from shefex_nav.world.flight import params as p

STEP_S = -0.2  # fixed steps: a few mm on the ground in place of a tenth of the time
BURNING_S, COASTING_S = 1.0, 10.0  # s from one point to the next


class Points(NamedTuple):
    """Impact points over m instants; NaN where the vehicle is not above the ground."""

    t_s: np.ndarray  # (m,)
    vacuum: np.ndarray  # (m, 2) rad, geodetic latitude and longitude
    drag: np.ndarray  # (m, 2) rad


def points(scenario, landed, ground):
    """Points of a flight from the end of the rail to the landing, or to the parachute."""
    given = params.flight_params(scenario)
    configurations = fly.configurations(given)
    drops = [one.t_s for one in landed.flight.dropped]
    times, found = _times(landed.flight), []
    for t_s in times:
        k = sum(t_s >= drop - SAME_S for drop in drops)
        state, mass = _centre(landed.flight.trajectory, configurations[k], t_s)
        bodies = ballistic.Body(mass, None), ballistic.Body(mass, _nose_first(configurations[k].aero))
        found.append([_point(landed.world, body, t_s, state, ground) for body in bodies])
    found = np.array(found).reshape(-1, 2, 2)
    return Points(np.array(times), found[:, 0], found[:, 1])


def _times(flight):
    """Times of samples: close while a motor burns, and at separations."""
    at = {}
    for event in flight.events:
        at.setdefault(event.name, event.t_s)
    end = min(at.get("parachute", np.inf), at["impact"])
    burnt_out = [t for name, t in at.items() if name.startswith("burn_out")]
    last_burn = max(burnt_out, default=end)  # none before it hits the ground burning
    close = np.arange(at["rail_exit"], min(last_burn, end), BURNING_S)
    times = np.concatenate(
        [close, np.arange(last_burn, end, COASTING_S), [one.t_s for one in flight.dropped]]
    )
    rows = np.searchsorted(flight.trajectory.t_s, times[times < end] - SAME_S)
    return flight.trajectory.t_s[np.unique(rows)].tolist()


def _centre(trajectory, configuration, t_s):
    """State of the centre of mass, (3,) m and (3,) m/s, frame i, and mass, kg, at the sample of t_s."""
    k = int(np.searchsorted(trajectory.t_s, t_s))
    C_ib, lever = rotation.dcm_from_quat(trajectory.q_ib[k]), fly.lever(configuration, t_s)
    r_i = trajectory.r_i[k] + C_ib @ lever
    v_i = trajectory.v_i[k] + C_ib @ np.cross(trajectory.omega_ib_b[k], lever)
    return (r_i, v_i), float(trajectory.mass_kg[k])


def _nose_first(aero):
    """Spent of AeroTables at no angle of attack."""
    return p.Spent(aero.area, aero.mach, aero.axial[:, 0] + aero.drag[:, 0])


def _point(world, body, t_s, state, ground):
    fall = ballistic.fall(world, body, t_s, *state, ground=ground, tolerance=STEP_S)
    if fall is None:
        return np.nan, np.nan
    one = landing_of("", world.earth, *fall.landing)
    return one.latitude, one.longitude
