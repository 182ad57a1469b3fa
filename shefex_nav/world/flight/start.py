"""Where the flight begins: at rest on the Earth or in orbit; and the world around it.

In: `FlightParams`, `EarthRotation`. Out: the `surroundings.World`, and the state from which the integration
goes on, with the samples of the time before it.
"""

import numpy as np

from shefex_nav.environment.gravity import gravity_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.flight import settings, surroundings
from shefex_nav.world.flight.dynamics import AUX, STATE

NOWHERE = surroundings.Rail(np.array([wgs84.A, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), 0.0)


def surround(params, earth):
    """(World, q_eb on the ground); the attitude is None for a vehicle in orbit."""
    rail, q_eb = (NOWHERE, None) if isinstance(params.start, settings.Orbit) else _rail(params.start)
    wind = params.wind, params.wind_times
    return surroundings.surround(params.gravity, earth, rail, params.air, *wind), q_eb


def _rail(site):
    """Rail and q_eb of what stands on a Launch site or on the Ground, where it has no length."""
    C_el = wgs84.dcm_el(site.latitude, site.longitude)
    ca, sa = np.cos(site.azimuth), np.sin(site.azimuth)
    ce, se = np.cos(site.elevation), np.sin(site.elevation)
    nose_l, right_l = np.array([sa * ce, ca * ce, se]), np.array([ca, -sa, 0.0])
    C_lb = np.stack([nose_l, right_l, np.cross(nose_l, right_l)], axis=1)
    C_eb = C_el @ C_lb @ rotation.dcm_from_rotvec(np.array([site.roll, 0.0, 0.0]))
    r_e = wgs84.ecef_from_geodetic(site.latitude, site.longitude, site.height)
    length = float(site.rail_length) if isinstance(site, settings.Launch) else 0.0
    return surroundings.Rail(r_e, np.ascontiguousarray(C_eb[:, 0]), length), rotation.quat_from_dcm(C_eb)


def stand(params, world, q_eb, mass, record, until_s):
    """Stand on the Earth: fill the record.Record before until_s; (state then, number of the next sample).

    Rate and specific force are constant in body axes, hence so are the increments.
    """
    earth, r_e, dt = world.earth, world.rail.r_e, 1.0 / params.sample_rate_hz
    C_eb = rotation.dcm_from_quat(q_eb)
    omega_e = earth.C_re.T @ np.array([0.0, 0.0, earth.rate])
    f_e = np.cross(omega_e, np.cross(omega_e, r_e)) - gravity_e(world.gravity, r_e)
    omega_b, f_b = C_eb.T @ omega_e, C_eb.T @ f_e
    aux = np.zeros(AUX)
    aux[:4], aux[7] = (*f_b, mass), params.start.height
    n = int(np.ceil((until_s - params.t_start_s) / dt - 1e-6))  # samples before until_s
    t_s = np.append(params.t_start_s + dt * np.arange(min(n, len(record))), until_s)
    since_s = np.diff(t_s, prepend=t_s[0])
    k = len(t_s) - 1

    def stood(rows, of):
        surroundings.rest_on_earth(earth, r_e, q_eb, t_s[of], rows)
        rows[:, 10:13], rows[:, STATE:] = omega_b, aux
        rows[:, 13:16], rows[:, 16:19] = np.outer(since_s[of], omega_b), np.outer(since_s[of], f_b)
        return rows

    rows = record.samples.rows
    for first in range(0, k, len(rows)):
        end = min(first + len(rows), k)
        record.take(first, stood(rows[: end - first], slice(first, end)))
    return stood(rows[:1], slice(k, k + 1))[0, :STATE].copy(), k


def orbit(params, lever_b):
    """(19,) state of the IMU in orbit at t_start_s; lever_b (3,) m from it to the centre of mass.

    The roll axis lies along the velocity, body z as near to the direction down as it gets then; at rest in
    inertial space. Elements: Montenbruck & Gill, Satellite Orbits, section 2.2.
    """
    o = params.start
    perigee, apogee = wgs84.A + o.perigee_height, wgs84.A + o.apogee_height
    eccentricity, p_m = (apogee - perigee) / (apogee + perigee), 2.0 * apogee * perigee / (apogee + perigee)
    C_ip = (
        rotation.dcm_from_rotvec(np.array([0.0, 0.0, o.node]))
        @ rotation.dcm_from_rotvec(np.array([o.inclination, 0.0, 0.0]))
        @ rotation.dcm_from_rotvec(np.array([0.0, 0.0, o.perigee]))
    )
    c, s = np.cos(o.anomaly), np.sin(o.anomaly)
    r_i = C_ip @ np.array([c, s, 0.0]) * (p_m / (1.0 + eccentricity * c))
    v_i = C_ip @ np.array([-s, eccentricity + c, 0.0]) * np.sqrt(params.gravity.gm / p_m)
    forward = v_i / np.sqrt(v_i @ v_i)
    across = np.cross(v_i, r_i)
    across /= np.sqrt(across @ across)
    C_ib = np.stack([forward, across, np.cross(forward, across)], axis=1)
    x = np.zeros(STATE)
    x[0:3], x[3:6], x[6:10] = r_i - C_ib @ lever_b, v_i, rotation.quat_from_dcm(C_ib)
    return x


def height(world, t_s, r_i):
    """Height [m] of an inertial position (3,) above the ellipsoid at t_s."""
    return surroundings.height(world.shape, frames.dcm_ie(world.earth, t_s).T @ r_i)
