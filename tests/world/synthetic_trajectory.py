"""A flight that needs no simulator: pad, vertical boost with spin-up, coast, all in closed form."""

import numpy as np

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Event, Phase, Trajectory

RATE_HZ = 400
SPIN = 2.0 * np.pi * 1.5  # rad/s at burn-out
BURN_S = 20.0
EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 1.0, wgs84.OMEGA)
SITE = np.deg2rad(69.2942), np.deg2rad(16.019)
EVENTS = (Event(0.0, "lift_off", 10.0, ""), Event(BURN_S, "burn_out_1", 10e3, ""))


def fly(start_s=-10.0, end_s=50.0, start_height=10.0, acceleration=50.0):
    """Trajectory straight up from the launch site, leaning by 20 degrees, and its Earth."""
    t_s = start_s + np.arange(round((end_s - start_s) * RATE_HZ) + 1) / RATE_HZ
    burn = np.clip(t_s, 0.0, BURN_S)
    speed = acceleration * burn
    height = start_height + 0.5 * acceleration * burn**2 + speed * np.maximum(0.0, t_s - BURN_S)
    roll_rate = SPIN * burn / BURN_S
    roll = 0.5 * SPIN * burn**2 / BURN_S + SPIN * np.maximum(0.0, t_s - BURN_S)

    n = len(t_s)
    C_el = wgs84.dcm_el(*SITE)
    up_e = np.ascontiguousarray(C_el[:, 2])
    lean = np.deg2rad(20.0)
    nose_l = np.array([0.0, np.sin(lean), np.cos(lean)])
    C_lb = np.column_stack([nose_l, [1.0, 0.0, 0.0], np.cross(nose_l, [1.0, 0.0, 0.0])])
    omega_ie_i = frames.omega_ie_i(EARTH)
    r_i, v_i, q_ib, omega_ib_b, f_b = (np.empty((n, k)) for k in (3, 3, 4, 3, 3))
    for k in range(n):
        r_e = wgs84.ecef_from_geodetic(*SITE, 0.0) + height[k] * up_e
        r_i[k], v_i[k] = frames.inertial_from_ecef(EARTH, t_s[k], r_e, speed[k] * up_e)
        C_ib = (
            frames.dcm_ie(EARTH, t_s[k]) @ C_el @ C_lb @ rotation.dcm_from_rotvec(np.array([roll[k], 0, 0]))
        )
        q_ib[k] = rotation.quat_from_dcm(C_ib)
        omega_ib_b[k] = C_ib.T @ omega_ie_i + np.array([roll_rate[k], 0.0, 0.0])
        thrust = 9.8 + acceleration if 0.0 < t_s[k] <= BURN_S else (9.8 if t_s[k] <= 0.0 else 0.0)
        f_b[k] = np.array([thrust, 0.0, 0.0])
    phase = np.full(n, Phase.COAST, dtype=np.int8)
    phase[t_s <= 0.0] = Phase.PAD
    phase[(t_s > 0.0) & (t_s <= BURN_S)] = Phase.BOOST
    burning = (phase == Phase.BOOST).astype(np.int8)
    dtheta_b, dv_b = omega_ib_b / RATE_HZ, f_b / RATE_HZ
    dtheta_b[0] = dv_b[0] = 0.0
    ones, zero = np.ones(n), np.zeros(n)
    return Trajectory(
        t_s, phase, r_i, v_i, q_ib, omega_ib_b, f_b, dtheta_b, dv_b, ones, ones, ones, ones * burning,
        burning, zero,
    )  # fmt: skip


def orbit(end_s=10.0, height=400e3, inclination_deg=51.6):
    """Circular orbit about a point mass from t = 0 on, body x along the velocity, z down; at RATE_HZ."""
    t_s = np.arange(round(end_s * RATE_HZ) + 1) / RATE_HZ
    n, radius = len(t_s), wgs84.A + height
    rate, inclination = np.sqrt(wgs84.GM / radius**3), np.deg2rad(inclination_deg)
    u = 0.4 + rate * t_s
    node, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, -np.sin(inclination), np.cos(inclination)])
    across = np.cross(normal, node)
    up = np.cos(u)[:, None] * node + np.sin(u)[:, None] * across
    ahead = -np.sin(u)[:, None] * node + np.cos(u)[:, None] * across
    q_ib = np.array(
        [
            rotation.quat_from_dcm(np.column_stack([a, np.cross(-w, a), -w]))
            for a, w in zip(ahead, up, strict=True)
        ]
    )
    omega_ib_b = np.tile([0.0, -rate, 0.0], (n, 1))
    zero, ones = np.zeros((n, 3)), np.ones(n)
    dtheta_b = omega_ib_b / RATE_HZ
    dtheta_b[0] = 0.0
    return Trajectory(
        t_s, np.full(n, Phase.ORBIT, np.int8), radius * up, radius * rate * ahead, q_ib, omega_ib_b, zero,
        dtheta_b, zero, ones, 0.0 * ones, 0.0 * ones, 0.0 * ones, np.zeros(n, np.int8), 0.0 * ones,
    )  # fmt: skip


def still(n, burning=0):
    """n samples without any motion, for noise alone."""
    zero = np.zeros((n, 3))
    t_s = np.arange(n) / RATE_HZ
    ones = np.ones(n)
    return Trajectory(
        t_s, np.full(n, Phase.COAST, np.int8), zero, zero, np.tile([1.0, 0, 0, 0], (n, 1)), zero, zero, zero,
        zero, ones, ones, ones, ones, np.full(n, burning, np.int8), 0.0 * ones,
    )  # fmt: skip
