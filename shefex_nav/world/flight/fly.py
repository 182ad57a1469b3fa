"""Fly the mission: from the parameters of vehicle, site and programme to the truth at the IMU rate.

In: `FlightParams`, `EarthRotation`. Out: `Trajectory` and the events.

Sections: on the pad (at rest on the Earth), on the rail, free flight of the full stack until separation,
the attitude programme around the second burn and the star camera's window, free flight to the ground.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.gravity import gravity_e, load_egm96
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Event, Phase, Trajectory
from shefex_nav.world.flight import attitude_program as attitude
from shefex_nav.world.flight import dynamics, surroundings, vehicle
from shefex_nav.world.flight.attitude_program import Program
from shefex_nav.world.flight.vehicle import Aerodynamics, Part, Stage


class FlightError(Exception):
    """The vehicle cannot do what its programme asks; the message says what happened."""


class LaunchSite(NamedTuple):
    """Where the IMU waits on the pad, and the rail."""

    latitude: float  # rad, geodetic
    longitude: float  # rad
    height_m: float  # above the ellipsoid
    azimuth: float  # rad from north over east, of the rail
    elevation: float  # rad above the horizontal
    roll: float  # rad about the roll axis; 0: body y horizontal, to the right when looking along the azimuth
    rail_length_m: float


class FlightParams(NamedTuple):
    """Everything that decides the flight."""

    t_start_s: float  # at most 0; lift-off is at 0
    sample_rate_hz: float  # of the IMU, and of the integration
    time_limit_s: float  # the vehicle must be on the ground by then
    gravity_degree: int  # of EGM96, 0 ... 36
    site: LaunchSite
    payload: Part
    stage_1: Stage
    stage_2: Stage
    imu_b: np.ndarray  # (3,) m, IMU from the nose tip, body axes
    aerodynamics_stack: Aerodynamics  # until separation
    aerodynamics_upper: Aerodynamics  # second stage and payload
    program: Program
    C_bc: np.ndarray  # (3, 3) nominal mounting of the star camera


def fly(params, earth):
    """Fly the mission once. FlightParams, EarthRotation -> (Trajectory, tuple of Event in order of time)."""
    stack, upper = _configurations(params)
    _check(params, stack, upper)
    dt = 1.0 / params.sample_rate_hz
    n_samples = int(np.floor((params.time_limit_s - params.t_start_s) / dt)) + 1
    rows = np.zeros((n_samples, dynamics.ROW))
    world, q_eb = _surroundings(params, earth)
    x, k = _stand_on_pad(params, world, q_eb, dt, rows)
    p = params.program

    def section(t_s, t_end, mode, law, configuration):
        nonlocal k
        t_s, k, by_event = dynamics.integrate(
            x, float(t_s), float(t_end), k, float(params.t_start_s), dt, mode, law, configuration, world, rows
        )
        return t_s, by_event

    free = attitude.hold(0.0, 1.0, 0.0)  # stands where a rate law is due and none rules
    t_rail, left_rail = section(0.0, p.separation_s, dynamics.ON_RAIL, free, stack)
    if not left_rail:
        raise FlightError(f"the vehicle is still on the rail {p.separation_s} s after ignition")
    t_s, landed = section(t_rail, p.separation_s, dynamics.FREE, free, stack)
    if landed:
        raise FlightError(f"the vehicle hits the ground {t_s:.1f} s after ignition, before the separation")
    for law in attitude_laws(params, world, x, upper):
        section(law.t_0, law.t_1, dynamics.PROGRAMMED, law, upper)
        x[10:13] = attitude.body_rate(law, law.t_1)[:3]
        if height_above_ground(world, law.t_1, x) < 0.0:
            raise FlightError(
                f"the vehicle hits the ground between T+{law.t_0:.1f} s and T+{law.t_1:.1f} s, before its "
                "programme ends"
            )
    t_impact, landed = section(p.spin_up_end_s, params.time_limit_s, dynamics.FREE, free, upper)
    if not landed:
        raise FlightError(f"the vehicle is still in the air at the time limit, {params.time_limit_s} s")
    trajectory = _trajectory(params, rows[:k], _phases(p, stack, upper))
    instants = {**_planned(p, stack, upper), "rail_exit": t_rail, "impact": t_impact}
    return trajectory, _events(trajectory, rows[:k, -1], earth, instants)


def height_above_ground(world, t_s, x):
    """Height [m] of the state x at t_s above the ellipsoid."""
    return surroundings.height(frames.dcm_ie(world.earth, t_s).T @ x[:3])


def attitude_laws(params, world, x, upper):
    """Yield the rate laws from separation to the end of the spin-up.

    Each is made from the state x when its turn comes: integrate one before asking for the next.
    """
    p, earth = params.program, world.earth
    _, _, i_roll, i_pitch, _ = vehicle.mass_properties(upper, upper.grain_mass)
    yield attitude.damp(p.separation_s, p.precession_start_s, x[10:13], (i_roll / i_pitch - 1.0) * x[10])
    spin = x[10]
    r_i, _ = _predict(world, p.precession_start_s, x, p.ignition_2_s)
    burn_i = attitude.direction_i(earth, p.ignition_2_s, r_i, p.burn_azimuth, p.burn_elevation)
    yield attitude.turn_roll_axis(p.precession_start_s, p.precession_end_s, spin, x[6:10], burn_i)
    yield attitude.hold(p.precession_end_s, p.despin_start_s, spin)
    yield attitude.ramp_spin(p.despin_start_s, p.despin_end_s, spin, 0.0)
    r_i, _ = _predict(world, p.despin_end_s, x, p.pointing_start_s)
    boresight_i = attitude.direction_i(
        earth, p.pointing_start_s, r_i, p.boresight_azimuth, p.boresight_elevation
    )
    roll_axis_i = rotation.quat_rotate(x[6:10], np.array([1.0, 0.0, 0.0]))
    target = attitude.camera_attitude(boresight_i, roll_axis_i, p.boresight_roll, params.C_bc)
    yield attitude.turn_to(p.despin_end_s, p.pointing_start_s, x[6:10], target)
    yield attitude.dwell(p, params.C_bc)
    r_i, v_i = _predict(world, p.pointing_end_s, x, p.entry_aim_s)
    v_air_i = v_i - np.cross(frames.omega_ie_i(earth), r_i)
    v_air_i = v_air_i / np.sqrt(v_air_i @ v_air_i)
    yield attitude.turn_roll_axis(p.pointing_end_s, p.entry_slew_end_s, 0.0, x[6:10], v_air_i)
    yield attitude.ramp_spin(p.entry_slew_end_s, p.spin_up_end_s, 0.0, p.entry_spin)


def _predict(world, t_s, x, t_end):
    """Free fall of the vehicle in state x at t_s to t_end: (r_i, v_i)."""
    return surroundings.free_fall(world, float(t_s), x[0:3], x[3:6], float(t_end))


def _check(params, stack, upper):
    """Refuse a programme whose instants are out of order."""
    p = params.program
    order = [
        ("lift-off", 0.0),
        ("burn-out of the first stage", stack.corners[3]),
        ("separation_s", p.separation_s),
        ("precession_start_s", p.precession_start_s),
        ("precession_end_s", p.precession_end_s),
        ("ignition_2_s", p.ignition_2_s),
        ("burn-out of the second stage", upper.corners[3]),
        ("despin_start_s", p.despin_start_s),
        ("despin_end_s", p.despin_end_s),
        ("pointing_start_s", p.pointing_start_s),
        ("pointing_end_s", p.pointing_end_s),
        ("entry_slew_end_s", p.entry_slew_end_s),
        ("spin_up_end_s", p.spin_up_end_s),
        ("time_limit_s", params.time_limit_s),
    ]
    for (before, t_0), (after, t_1) in pairwise(order):
        if not t_0 < t_1:
            raise ValueError(f"{after} ({t_1} s) has to be later than {before} ({t_0} s)")
    if params.t_start_s > 0.0:
        raise ValueError(f"t_start_s ({params.t_start_s} s) is after lift-off")
    if not 0.0 < 2.0 * p.residual_ramp_s <= p.pointing_end_s - p.pointing_start_s:
        raise ValueError(f"residual_ramp_s ({p.residual_ramp_s} s) does not fit twice into the pointing")


def _surroundings(params, earth):
    """World of the flight, and q_eb of the vehicle on the pad."""
    site = params.site
    C_el = wgs84.dcm_el(site.latitude, site.longitude)
    ca, sa = np.cos(site.azimuth), np.sin(site.azimuth)
    ce, se = np.cos(site.elevation), np.sin(site.elevation)
    nose_l = np.array([sa * ce, ca * ce, se])
    right_l = np.array([ca, -sa, 0.0])
    C_lb = np.stack([nose_l, right_l, np.cross(nose_l, right_l)], axis=1)
    C_eb = C_el @ C_lb @ rotation.dcm_from_rotvec(np.array([site.roll, 0.0, 0.0]))
    r_e = wgs84.ecef_from_geodetic(site.latitude, site.longitude, site.height_m)
    # own copies: read-only or strided arrays would compile every kernel a second time
    turning = [np.array(m, dtype=float, order="C") for m in (earth.C_iq, earth.C_re)]
    earth = frames.EarthRotation(*turning, float(earth.angle_0), float(earth.rate))
    rail = surroundings.Rail(r_e, np.ascontiguousarray(C_eb[:, 0]), float(site.rail_length_m))
    return surroundings.World(load_egm96(params.gravity_degree), earth, rail), rotation.quat_from_dcm(C_eb)


def _stand_on_pad(params, world, q_eb, dt, rows):
    """Fill the rows before lift-off, at rest on the Earth; state at lift-off and the next sample.

    Rate and specific force are constant in body axes, hence so are the increments.
    """
    earth, r_e = world.earth, world.rail.r_e
    C_eb = rotation.dcm_from_quat(q_eb)
    omega_e = earth.C_re.T @ np.array([0.0, 0.0, earth.rate])
    f_e = np.cross(omega_e, np.cross(omega_e, r_e)) - gravity_e(world.gravity, r_e)
    omega_b, f_b = C_eb.T @ omega_e, C_eb.T @ f_e
    mass = sum(part.mass_kg for part in (params.payload, params.stage_1.dry, params.stage_2.dry))
    mass += params.stage_1.propellant_mass_kg + params.stage_2.propellant_mass_kg
    aux = np.concatenate([f_b, [mass, 0.0, 0.0, 0.0, params.site.height_m]])
    t_s = params.t_start_s + dt * np.arange(len(rows))
    k = int(np.searchsorted(t_s, -dynamics.TIME_EPS))  # of the first sample that is not before lift-off
    t_s = np.append(t_s[:k], 0.0)
    since_s = np.diff(t_s, prepend=t_s[0])
    states = np.empty((k + 1, dynamics.STATE))
    surroundings.rest_on_earth(earth, r_e, q_eb, t_s, states)
    states[:, 10:13] = omega_b
    states[:, 13:16], states[:, 16:19] = np.outer(since_s, omega_b), np.outer(since_s, f_b)
    rows[:k, : dynamics.STATE], rows[:k, dynamics.STATE :] = states[:k], aux
    return states[k].copy(), k


def _configurations(params):
    """The full stack, first stage burning from 0, and the upper part, second stage burning when it is due."""
    one, two = params.stage_1, params.stage_2
    carried = [params.payload, two.dry, vehicle.grain(two, two.propellant_mass_kg), one.dry]
    stack = vehicle.configure(carried, one, 0.0, params.imu_b, params.aerodynamics_stack)
    upper = vehicle.configure(
        [params.payload, two.dry], two, params.program.ignition_2_s, params.imu_b, params.aerodynamics_upper
    )
    return stack, upper


def _phases(program, stack, upper):
    """(start s, Phase) in order of time."""
    p = program
    return [
        (0.0, Phase.BOOST_1),
        (stack.corners[3], Phase.COAST_1),
        (p.separation_s, Phase.PRECESSION),
        (p.ignition_2_s, Phase.BOOST_2),
        (upper.corners[3], Phase.DESPIN),
        (p.despin_end_s, Phase.SLEW),
        (p.pointing_start_s, Phase.POINTING),
        (p.pointing_end_s, Phase.ENTRY_SLEW),
        (p.entry_slew_end_s, Phase.SPIN_UP),
        (p.spin_up_end_s, Phase.ENTRY),
    ]


def _planned(program, stack, upper):
    """{name of event: s} of everything that happens at a set time."""
    p = program
    return {
        "lift_off": 0.0,
        "burn_out_1": stack.corners[3],
        "separation": p.separation_s,
        "ignition_2": p.ignition_2_s,
        "burn_out_2": upper.corners[3],
        "despin_complete": p.despin_end_s,
        "pointing_start": p.pointing_start_s,
        "pointing_end": p.pointing_end_s,
        "spin_up_start": p.entry_slew_end_s,
        "spin_up_complete": p.spin_up_end_s,
    }


def _trajectory(params, rows, marks):
    """Split the rows of the integration into the record."""
    t_s = params.t_start_s + np.arange(len(rows)) / params.sample_rate_hz
    starts = np.array([start for start, _ in marks])
    names = np.array([Phase.PAD, *(phase for _, phase in marks)], dtype=np.int8)
    phase = names[np.searchsorted(starts, t_s + dynamics.TIME_EPS)]
    state = [slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)]
    measured = [slice(19, 22), slice(13, 16), slice(16, 19)]  # f_b and the increments
    columns = [*state, *measured, 22, 23, 24, 25]  # mass, Mach number, dynamic pressure, thrust
    return Trajectory(t_s, phase, *(np.ascontiguousarray(rows[:, c]) for c in columns))


def _crossing(t_s, values, level, after, rising):
    """First time later than `after` at which the sampled values pass the level; None if they never do."""
    above = values >= level
    change = (~above[:-1] & above[1:]) if rising else (above[:-1] & ~above[1:])
    where = np.flatnonzero(change & (t_s[:-1] > after))
    if len(where) == 0:
        return None
    k = where[0]
    return t_s[k] + (level - values[k]) / (values[k + 1] - values[k]) * (t_s[k + 1] - t_s[k])


def _events(trajectory, height, earth, instants):
    """Events of the programme and those found in the flight, in order of time."""
    t_s = trajectory.t_s
    k = int(np.argmax(height))
    instants = dict(instants)
    # vertical speed from the heights either side of the top sample, zero in between
    d0, d1 = height[k] - height[k - 1], height[k + 1] - height[k]
    instants["apogee"] = 0.5 * (t_s[k - 1] + t_s[k]) + (t_s[k + 1] - t_s[k]) * d0 / (d0 - d1)
    for name, level in (("entry", 100e3), ("altitude_60km", 60e3), ("altitude_20km", 20e3)):
        passed = _crossing(t_s, height, level, instants["apogee"], rising=False)
        if passed is not None:
            instants[name] = passed
    instants["max_dynamic_pressure"] = t_s[int(np.argmax(trajectory.dynamic_pressure_pa))]
    events = []
    for name, t in sorted(instants.items(), key=lambda item: item[1]):
        j = min(int(np.searchsorted(t_s, t)), len(t_s) - 1)
        _, v_e = frames.ecef_from_inertial(earth, t_s[j], trajectory.r_i[j], trajectory.v_i[j])
        detail = f"{np.sqrt(v_e @ v_e):.0f} m/s, Mach {trajectory.mach[j]:.1f}"
        if name == "max_dynamic_pressure":
            detail += f", {1e-3 * trajectory.dynamic_pressure_pa[j]:.0f} kPa"
        events.append(Event(float(t), name, float(np.interp(t, t_s, height)), detail))
    return tuple(events)
