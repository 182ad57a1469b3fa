"""What the flight was: apogee, range, speed, events; of the truth, or without one of the solution."""

import math

import numpy as np

from shefex_nav.geometry import wgs84
from shefex_nav.report.pairing import is_partly_true
from shefex_nav.report.track import earth_fixed, ground_distance

ROSE_M = 100.0  # [E] above the start, less of which is no flight
MOVES = 1.0  # [E] m/s, beyond the errors of the solution
KNOWN = 3.0  # [E] m/s, 3 sigma of a velocity that says whether a vehicle lies still
LYING_S = 2.0  # [E] without motion, after a landing
STANDING = 1e-3  # m/s; what never moves faster stands on the ground


def of(data, track, entry):
    """Figures of a RunData: of its truth where that is of the whole flight, else of its solution.

    track : of the truth;  entry : index of its sample, or None
    """
    if len(data.truth.t_s) and not is_partly_true(data):
        return of_truth(data, track, entry)
    return of_solution(data)


def of_truth(data, track, entry):
    """Figures of a RunData with truth: dict. track : of the truth;  entry : index of its sample, or None"""
    impact = next((event for event in data.events if event.name == "impact"), None)
    mission = data.mission
    range_km, k = None, None
    if impact and len(track.height):
        k = int(np.argmin(np.abs(data.truth.t_s - impact.t_s)))
        range_km = _range_km(mission, track.latitude[k], track.longitude[k])
    return {
        "of": "truth",
        **_rise(data, data.truth, track, *np.zeros((2, len(data.truth.t_s)))),
        "range_km": range_km,
        "at_entry": None if entry is None else _place(data.truth.t_s, track, entry),
        "at_impact": None if k is None else _place(data.truth.t_s, track, k),
        "events": _events(data),
    }


def _range_km(mission, latitude, longitude):
    """From the start to a place [rad] along the ellipsoid; None where that is the other side of the Earth."""
    try:
        length = ground_distance(mission.launch_latitude, mission.launch_longitude, latitude, longitude)
    except ValueError:  # of points that are nearly antipodal
        return None
    return length / 1e3


def of_solution(data):
    """The same of a run without truth, or without that of a part of it, as the solution has it.

    What is less than its errors is no motion.
    Each sample counts with its own errors: a vehicle that loses its attitude late has flown all the same.
    """
    nav = data.nav
    track = earth_fixed(data.mission.earth, nav)
    errors = (3.0 * np.linalg.norm(sigma, axis=1) for sigma in (nav.sigma_r_e, nav.sigma_v_e))
    true_s = data.truth.t_s[[0, -1]].tolist() if len(data.truth.t_s) else None
    return {
        "of": "solution",
        "truth_s": true_s,
        **_rise(data, nav, track, *errors),
        "range_km": None,
        "at_entry": None,
        "at_impact": None,
        "events": _events(data),
    }


def seen(data):
    """(name of an event, t_s) of lift-off, apogee and landing, as the solution without truth has them.

    Of a vehicle that rises. One that moves at the beginning has no lift-off; one that moves at the end, or of
    whose motion little is known there, has no landing.
    """
    nav = data.nav
    if not len(nav.t_s) or (len(data.truth.t_s) and not is_partly_true(data)):
        return []
    track, rise = earth_fixed(data.mission.earth, nav), of_solution(data)
    if rise["at_apogee"] is None or track.height.max() - track.height[0] < ROSE_M:
        return []
    found = [("apogee", rise["at_apogee"]["t_s"])]
    noise = 3.0 * np.linalg.norm(nav.sigma_v_e, axis=1)
    moving = np.flatnonzero(np.linalg.norm(track.v_e, axis=1) > MOVES + noise)
    if len(moving) and moving[0] > 0:
        found.insert(0, ("lift_off", float(nav.t_s[moving[0] - 1])))
    known = len(moving) and noise[moving[-1] :].max() < KNOWN
    if known and nav.t_s[-1] - nav.t_s[moving[-1]] > LYING_S:
        found.append(("landing", float(nav.t_s[moving[-1] + 1])))
    return found


def _events(data):
    return [
        {"name": event.name, "t_s": event.t_s, "altitude_km": event.altitude_m / 1e3} for event in data.events
    ]


def _rise(data, states, track, of_height, of_speed):
    """Apogee, height where the data end while it still climbs, heights between which it flew, highest speed.

    states : of the track, t_s, r_i, v_i;  of_height, of_speed : (N,) m, m/s, so much is no difference
    """
    speed = np.linalg.norm(track.v_e, axis=1)
    fastest = int(np.argmax(speed - of_speed)) if len(speed) else 0
    moved = bool(len(speed)) and float(speed[fastest]) > max(STANDING, float(of_speed[fastest]))
    top = int(np.argmax(track.height)) if moved else 0
    climbs = moved and track.height[-1] >= track.height[top] - max(
        of_height[top], of_height[-1]
    )  # at the end
    rose = moved and not climbs and _seen_to_apogee(data)
    if moved and in_orbit(states.r_i[top], states.v_i[top]):
        turns = _turns(states.r_i, states.v_i)
        rose, climbs = bool(len(turns)), False
        top = int(turns[np.argmax(np.linalg.norm(states.r_i[turns], axis=1))]) if rose else top
    elif rose and not track.height[top] - track.height[0] > max(of_height[top], of_height[0]):
        rose = False  # it came from where it was highest
    height_km = track.height / 1e3
    return {
        "height_km": {"min": float(height_km.min()), "max": float(height_km.max())} if moved else None,
        "apogee_km": float(track.height[top]) / 1e3 if rose else None,
        "climbs_at_km": float(track.height[-1]) / 1e3 if climbs else None,
        "max_speed_m_s": float(speed[fastest]) if moved else None,
        "at_apogee": _place(states.t_s, track, top) if rose else None,
    }


def in_orbit(r_i, v_i):
    """Whether the perigee of a state (3,) m, (3,) m/s is above the ground, by the two-body problem."""
    distance, energy = np.linalg.norm(r_i), 0.5 * v_i @ v_i
    momentum = np.cross(r_i, v_i)
    eccentricity = np.cross(v_i, momentum) / wgs84.GM - r_i / distance
    perigee = momentum @ momentum / wgs84.GM / (1.0 + np.linalg.norm(eccentricity))
    return bool(perigee > wgs84.A and energy < wgs84.GM / distance)


def _turns(r_i, v_i):
    """Samples (k,) at which what has receded from the Earth begins to come nearer. (N, 3), (N, 3)"""
    away = np.einsum("ij,ij->i", r_i, v_i) > 0.0
    return np.flatnonzero(away[:-1] & ~away[1:])


def _seen_to_apogee(data):
    """Whether the greatest height is the mission's: that of a part of it only if the apogee is there."""
    is_part = data.ended_early or data.until_s is not None
    return not is_part or any(event.name == "apogee" for event in data.events)


def _place(t_s, track, k):
    """Where the vehicle is at sample k."""
    return {
        "t_s": float(t_s[k]),
        "latitude_deg": math.degrees(track.latitude[k]),
        "longitude_deg": math.degrees(track.longitude[k]),
        "altitude_km": float(track.height[k]) / 1e3,
    }
