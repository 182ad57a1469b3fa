"""Trajectories that tests and the example fly along, made here: a point mass in our gravity, and its files.

`python tests/trajectory/made.py` writes the committed ones anew: scenarios/data/given_trajectory.csv, and
an OEM and an AEM of a satellite beside this file.
"""

from pathlib import Path
from typing import NamedTuple

import erfa
import numpy as np
from scipy.integrate import solve_ivp

from shefex_nav.environment import ephemeris, gravity
from shefex_nav.geometry import frames, rotation, wgs84

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
EXAMPLE = ROOT / "scenarios" / "data" / "given_trajectory.csv"
OEM, AEM = HERE / "satellite.oem", HERE / "satellite.aem"
EPOCH = "2012-06-22T19:18:00"
EARTH = ephemeris.earth_rotation(EPOCH, -0.58479, np.radians(0.0787 / 3600.0), np.radians(0.4084 / 3600.0))
SITE = np.radians(69.2942), np.radians(16.0190), 10.0
J2 = gravity.load("j2")
ROLL = np.radians(20.0)  # rad/s
THRUST, BURN_S, RAMP_S = 70.0, 9.0, 0.4  # m/s^2, s
AREA_MASS = 0.05 / 300.0  # m^2/kg, with the drag coefficient


class Path3(NamedTuple):
    """A flight in east, north, up at the site, relative to the Earth."""

    t_s: np.ndarray  # (N,)
    r_l: np.ndarray  # (N, 3) m
    v_l: np.ndarray  # (N, 3) m/s
    a_l: np.ndarray  # (N, 3) m/s^2
    q_lb: np.ndarray  # (N, 4) scalar first
    C_el: np.ndarray
    r_0: np.ndarray


def thrust(t_s):
    """m/s^2 along the nose; it rises and falls in RAMP_S."""
    return THRUST * np.clip(min(t_s / RAMP_S, (BURN_S - t_s) / RAMP_S), 0.0, 1.0)


def rocket(until_s=70.0, step_s=0.1):
    """A point mass that is held in its direction for a while, then flies along its velocity. -> Path3"""
    C_el, r_0 = wgs84.dcm_el(*SITE[:2]), wgs84.ecef_from_geodetic(*SITE)
    elevation, azimuth = np.radians(82.0), np.radians(352.0)
    nose = np.array(
        [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    omega_e = EARTH.C_re.T @ [0.0, 0.0, EARTH.rate]

    def acceleration(t_s, r_l, v_l):
        r_e, v_e = r_0 + C_el @ r_l, C_el @ v_l
        fall = gravity.gravity_e(J2, r_e) - 2.0 * np.cross(omega_e, v_e)
        fall -= np.cross(omega_e, np.cross(omega_e, r_e))
        speed = np.linalg.norm(v_l)
        along = v_l / speed if speed > 20.0 else nose
        drag = 0.5 * 1.2 * np.exp(-r_l[2] / 7500.0) * speed * AREA_MASS
        free = C_el.T @ fall + thrust(t_s) * along - drag * v_l
        if t_s < 0.2 and nose @ free < 0.0:
            return np.zeros(3)  # it stands on its rail
        return nose * (nose @ free) if speed <= 20.0 and t_s < 5.0 else free

    def rate(t_s, x):
        return np.concatenate([x[3:], acceleration(t_s, x[:3], x[3:])])

    t_s = np.arange(round(until_s / step_s) + 1) * step_s
    told = solve_ivp(rate, (0.0, until_s), np.zeros(6), t_eval=t_s, rtol=1e-10, atol=1e-9, max_step=0.02)
    r_l, v_l = told.y[:3].T, told.y[3:].T
    a_l = np.array([acceleration(*one) for one in zip(t_s, r_l, v_l, strict=True)])
    speed = np.linalg.norm(v_l, axis=1)
    forward = np.where((speed > 20.0)[:, None], v_l / np.maximum(speed, 1.0)[:, None], nose)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1)[:, None]
    C_lb = np.stack([forward, right, np.cross(forward, right)], axis=2)
    roll = ROLL * (t_s - 2.0 * (1.0 - np.exp(-t_s / 2.0)))  # it begins smoothly
    q_lb = [
        rotation.quat_multiply(rotation.quat_from_dcm(np.ascontiguousarray(C)), rolled(angle))
        for C, angle in zip(C_lb, roll, strict=True)
    ]
    return Path3(t_s, r_l, v_l, a_l, np.array(q_lb), C_el, r_0)


def rolled(angle):
    """Quaternion of a turn about x."""
    return np.array([np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0, 0.0])


def csv(path, names, columns, digits=6, head=""):
    """Write columns under their names."""
    rows = "\n".join(",".join(f"{one:.{digits}f}" for one in row) for row in np.column_stack(columns))
    Path(path).write_text(f"{head}{','.join(names)}\n{rows}\n", encoding="utf-8")


def write_example():
    """The file of the shipped scenario."""
    flown = rocket()
    names = ("t_s", "east_m", "north_m", "up_m", "ve_m_s", "vn_m_s", "vu_m_s", "qw", "qx", "qy", "qz")
    head = "# A point mass made for this example: tests/trajectory/made.py\n"
    csv(EXAMPLE, names, (flown.t_s, flown.r_l, flown.v_l, flown.q_lb), 6, head)


class Orbit(NamedTuple):
    """A satellite in GCRS, and its attitude."""

    t_s: np.ndarray
    r_i: np.ndarray
    v_i: np.ndarray
    q_ib: np.ndarray


def satellite(until_s=300.0, step_s=10.0):
    """A satellite that falls in the gravity of EGM96, forward along its velocity, rolling slowly. -> Orbit"""
    model = gravity.load("egm96", 12)

    def rate(t_s, x):
        C_ie = frames.dcm_ie(EARTH, t_s)
        return np.concatenate([x[3:], C_ie @ gravity.gravity_e(model, C_ie.T @ x[:3])])

    t_s = np.arange(round(until_s / step_s) + 1) * step_s
    begin = np.array([5.2e6, -3.1e6, 3.4e6, 2.5e3, 6.7e3, 2.3e3])
    told = solve_ivp(rate, (0.0, until_s), begin, t_eval=t_s, rtol=1e-12, atol=1e-6, method="DOP853")
    r_i, v_i = told.y[:3].T, told.y[3:].T
    q_ib = []
    for t, r, v in zip(t_s, r_i, v_i, strict=True):
        x = v / np.linalg.norm(v)
        y = np.cross(x, r)
        y /= np.linalg.norm(y)
        C_ib = np.column_stack([x, y, np.cross(x, y)])
        q_ib.append(rotation.quat_multiply(rotation.quat_from_dcm(C_ib), rolled(0.01 * t)))
    return Orbit(t_s, r_i, v_i, np.array(q_ib))


def epoch_text(t_s):
    """UTC of a mission time within the hour of EPOCH."""
    minutes, seconds = divmod(18 * 60.0 + t_s, 60.0)
    return f"2012-06-22T19:{int(minutes):02d}:{seconds:09.6f}"


def write_ccsds(oem, aem, orbit, to_frame=None, frame="EME2000"):
    """OEM and AEM of an Orbit; to_frame : GCRS to the axes of the frame (3, 3); None: to EME2000."""
    C = erfa.bp00(erfa.DJ00, 0.0)[0] if to_frame is None else to_frame
    meta = (
        "OBJECT_NAME = MADE UP\nOBJECT_ID = 2012-000A\nTIME_SYSTEM = UTC\n"
        f"START_TIME = {epoch_text(orbit.t_s[0])}\nSTOP_TIME = {epoch_text(orbit.t_s[-1])}\n"
    )
    lines = [
        f"{epoch_text(t)} " + " ".join(f"{one:.9f}" for one in (*(C @ r / 1e3), *(C @ v / 1e3)))
        for t, r, v in zip(orbit.t_s, orbit.r_i, orbit.v_i, strict=True)
    ]
    begin = "CREATION_DATE = 2026-01-01T00:00:00\nORIGINATOR = TEST\n\nMETA_START\n"
    oem_meta = f"{meta}CENTER_NAME = EARTH\nREF_FRAME = {frame}\nMETA_STOP\n\n"
    Path(oem).write_text(f"CCSDS_OEM_VERS = 2.0\n{begin}{oem_meta}" + "\n".join(lines) + "\n")
    q_fb = [rotation.quat_multiply(rotation.quat_from_dcm(np.ascontiguousarray(C)), q) for q in orbit.q_ib]
    lines = [
        f"{epoch_text(t)} " + " ".join(f"{one:.12f}" for one in (*q[1:], q[0]))
        for t, q in zip(orbit.t_s, q_fb, strict=True)
    ]
    aem_meta = (
        f"{meta}REF_FRAME_A = {frame}\nREF_FRAME_B = SC_BODY_1\nATTITUDE_DIR = A2B\n"
        "ATTITUDE_TYPE = QUATERNION\nQUATERNION_TYPE = LAST\nMETA_STOP\n\nDATA_START\n"
    )
    text = f"CCSDS_AEM_VERS = 1.0\n{begin}{aem_meta}" + "\n".join(lines) + "\nDATA_STOP\n"
    Path(aem).write_text(text)


if __name__ == "__main__":
    write_example()
    write_ccsds(OEM, AEM, satellite())
