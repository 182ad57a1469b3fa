"""Scenarios along files of a test, and a strapdown integration of what an IMU felt on the way."""

import json

import numpy as np
from made import ROOT

from shefex_nav import prepare
from shefex_nav.environment.gravity import gravity_e
from shefex_nav.geometry import frames, rotation
from shefex_nav.scenario import load, surroundings

EXAMPLE = ROOT / "scenarios" / "given_trajectory.yaml"
ORIGIN = {"latitude": "69.2942 deg", "longitude": "16.0190 deg", "height": "10 m"}
ALONG = {"along": "velocity"}


def scenario(trajectory, *overrides):
    """Scenario of the example along another file. trajectory : the section, as a dict"""
    given = json.dumps({"pad": "10 s"} | trajectory, default=str)
    return load.load(EXAMPLE, [f"trajectory={given}", *overrides])


def flown(trajectory, *overrides):
    """Flight, and the EarthRotation under it."""
    one = scenario(trajectory, *overrides)
    return prepare.fly_vehicle(one, 1), prepare.earth_rotation(one)


def in_orbit(trajectory, *overrides):
    """The same of a file that begins in orbit, in the gravity of EGM96."""
    more = ("mission.start=0 s", "earth.gravity=egm96", "earth.gravity_degree=12", "imu.vibration.boost=[]")
    return flown({"pad": "0 s"} | trajectory, *more, "gps.outages=[]", *overrides)


def at(trajectory, t_s):
    """Numbers of the samples at times (n,)."""
    return np.searchsorted(trajectory.t_s, np.asarray(t_s) - 1e-6)


def dead_reckoning(trajectory, t_s, increments, earth, model):
    """Positions (N, 3) of a strapdown integration from the first sample on, and the last attitude.

    increments : of angle and of velocity (N, 3), the first of which are zero
    """
    r, v, q = trajectory.r_i[0].copy(), trajectory.v_i[0].copy(), trajectory.q_ib[0].copy()
    turn_0, gain_0, found = np.zeros(3), np.zeros(3), [r.copy()]

    def gravity_i(t, r):
        C_ie = frames.dcm_ie(earth, t)
        return C_ie @ gravity_e(model, C_ie.T @ r)

    g_0 = gravity_i(t_s[0], r)
    for before, t, turn, gain in zip(t_s[:-1], t_s[1:], *(one[1:] for one in increments), strict=True):
        dt = t - before
        sculling = (np.cross(turn_0, gain) + np.cross(gain_0, turn)) / 12.0
        felt = rotation.quat_rotate(q, gain + 0.5 * np.cross(turn, gain) + sculling)
        g_1 = gravity_i(t, r + dt * v)
        v_1 = v + felt + 0.5 * dt * (g_0 + g_1)
        r, v, g_0 = r + 0.5 * dt * (v + v_1), v_1, g_1
        angle = turn + np.cross(turn_0, turn) / 12.0
        q = rotation.quat_normalise(rotation.quat_multiply(q, rotation.quat_from_rotvec(angle)))
        turn_0, gain_0 = turn, gain
        found.append(r)
    return np.array(found), q


def reckoned(one):
    """Largest distance [m] of dead reckoning by an IMU without errors from the flight of a Scenario."""
    earth, flight = prepare.earth_rotation(one), prepare.fly_vehicle(one, 1)
    t = flight.trajectory
    felt = t.dtheta_b, t.dv_b
    r_i, q_ib = dead_reckoning(t, t.t_s, felt, earth, surroundings.gravity(one))
    tilt = np.linalg.norm(rotation.rotvec_between(q_ib, t.q_ib[-1]))
    return float(np.linalg.norm(r_i - t.r_i, axis=1).max()), float(tilt)
