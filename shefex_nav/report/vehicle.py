"""The vehicle in its flight: masses, stability, thrust and drag over time, and what to look at.

In: a scenario that is launched, and its flight by the trajectory simulator, without sensors. Out: `Profile`,
the figures of its parts and moments, and warnings. Stability is that at small angles of attack: derivatives
of the aerodynamic tables at zero, whatever the angle in flight.

The angle of attack xi = beta + i alpha of a spinning body, across axes that do not roll, obeys
    xi'' - i (I_x/I_t) p xi' + omega^2 xi = A exp(i p t),   omega^2 = q S C_Na (x_cp - x_cm) / I_t,
where A is what is not symmetric and turns with the body. It resonates at the spin
p = omega / sqrt(1 - I_x/I_t).
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.errors import UserError
from shefex_nav.report import odd_parts, sensor_limits
from shefex_nav.report.pairing import at_rows, stretches
from shefex_nav.report.programme import Warned, of_parts
from shefex_nav.report.track import earth_fixed
from shefex_nav.scenario import params, thrust
from shefex_nav.scenario.document import dotted
from shefex_nav.world.flight import fly

RATE = 20.0  # Hz, of what is looked at
FELT = 500.0  # Pa; below this dynamic pressure air neither steadies nor upsets a rocket within seconds
LEAST_MARGIN = 1.0  # calibres
WIND_SHARE = 4.0  # times the wind a rocket should be fast at the end of the rail: 14 deg angle of attack
NEAR = 0.1  # of the resonant spin counts as resonance
SEED = 1  # of the attitude control's reference: nothing else is drawn


class VehicleError(UserError):
    """A scenario has no rocket to be looked at."""


class Profile(NamedTuple):
    """The vehicle over n instants from lift-off on. NaN where something is not: no air, no slope."""

    t_s: np.ndarray  # (n,)
    phase: np.ndarray  # (n,) records.Phase
    height: np.ndarray  # (n,) m above the ellipsoid
    configuration: np.ndarray  # (n,) how many stages have been dropped
    mass: np.ndarray  # (n,) kg
    centre: np.ndarray  # (n,) m, station of the centre of mass
    pressure: np.ndarray  # (n,) m, station of the centre of pressure
    margin: np.ndarray  # (n,) calibres, centre of pressure behind centre of mass
    thrust: np.ndarray  # (n,) N
    drag: np.ndarray  # (n,) N, against the air velocity, parachute included
    dynamic_pressure: np.ndarray  # (n,) Pa
    mach: np.ndarray  # (n,)
    spin: np.ndarray  # (n,) rad/s
    resonant: np.ndarray  # (n,) rad/s, spin of the resonance


class Looked(NamedTuple):
    """A scenario's rocket and its flight."""

    scenario: object
    flight: fly.Flight
    configurations: tuple  # of vehicle.Configuration
    profile: Profile
    rail_exit_speed: float  # m/s, relative to the Earth
    wind_speed: float  # m/s, at the launcher at lift-off


def look(scenario, seed=SEED):
    """Fly a scenario that is launched and look at its vehicle: Looked. FlightError as of a run."""
    if scenario.launch is None:
        raise VehicleError(
            f"{scenario.mission.name} has no section launch: only a rocket that is launched is looked at"
        )
    given = params.flight_params(scenario)
    configurations = fly.configurations(given)
    flight = prepare.fly_vehicle(scenario, seed)
    profile = _profile(flight, configurations, prepare.earth_rotation(scenario))
    speed = rail_exit_speed(flight, prepare.earth_rotation(scenario))
    return Looked(scenario, flight, configurations, profile, speed, _wind(given))


def at(flight, name):
    """Time of the first event of a name, s; None: it did not happen."""
    return next((event.t_s for event in flight.events if event.name == name), None)


def rail_exit_speed(flight, earth):
    """m/s relative to the Earth, between the two samples around the end of the rail."""
    t_s, exit_s = flight.trajectory.t_s, at(flight, "rail_exit")
    k = int(np.searchsorted(t_s, exit_s))
    rows = at_rows(flight.trajectory, slice(k - 1, k + 1))
    speeds = np.linalg.norm(earth_fixed(earth, rows).v_e, axis=1)
    return float(np.interp(exit_s, rows.t_s, speeds))


def _wind(given):
    """Speed of the wind at the height of the launcher at lift-off, m/s."""
    if not len(given.wind):
        return 0.0
    heights, columns = given.wind[:, 0], given.wind[:, 1:]
    there = [np.interp(given.start.height, heights, column) for column in columns.T]
    return math.hypot(*(np.interp(0.0, given.wind_times, there[k::2]) for k in (0, 1)))


def _profile(flight, configurations, earth):
    """Profile of a flight."""
    every = flight.trajectory
    step = max(1, round(1.0 / (RATE * (every.t_s[1] - every.t_s[0]))))
    rows = at_rows(every, slice(int(np.searchsorted(every.t_s, 0.0)), None, step))
    dropped, found = _over(flight, configurations, rows)
    return Profile(
        t_s=rows.t_s, phase=rows.phase, height=earth_fixed(earth, rows).height, configuration=dropped,
        mass=rows.mass_kg, thrust=rows.thrust_n, dynamic_pressure=rows.dynamic_pressure_pa, mach=rows.mach,
        spin=rows.omega_ib_b[:, 0], **found,
    )  # fmt: skip


def _over(flight, configurations, rows):
    """At samples of a flight: how many stages have been dropped (n,), columns of Profile {name: (n,)}."""
    n = len(rows.t_s)
    dropped = np.zeros(n, dtype=int)
    for k in range(1, len(configurations)):
        drop_s = at(flight, f"separation_{k}")
        if drop_s is not None:
            dropped += rows.t_s >= drop_s
    found = {name: np.full(n, np.nan) for name in ("centre", "pressure", "margin", "drag", "resonant")}
    for k, one in enumerate(configurations):
        part = dropped == k
        if part.any():
            for name, values in _of_configuration(one, at_rows(rows, part)).items():
                found[name][part] = values
    found["drag"] += _parachute(flight, configurations[0].parachute, rows)
    return dropped, found


def _parachute(flight, row, rows):
    """Drag of the parachute, (n,) N."""
    open_s = at(flight, "parachute")
    if open_s is None:
        return 0.0
    _, inflation, area, *_ = row
    return rows.dynamic_pressure_pa * area * np.clip((rows.t_s - open_s) / inflation, 0.0, 1.0)


def _of_configuration(one, rows):
    """Columns of Profile of the samples in which a Configuration flies, {name: (n,)}."""
    table, aero = one.mass, one.aero
    left = np.interp(rows.mass_kg, table[:, 1], table[:, 0])  # propellant, kg
    centre, i_x, i_t = (np.interp(left, table[:, 0], table[:, k]) for k in (2, 3, 4))
    axial, normal, moment, drag = _coefficients(aero, rows.mach, rows.angle_of_attack)
    cosine, sine = np.cos(rows.angle_of_attack), np.sin(rows.angle_of_attack)
    by_angle = cosine * np.abs(cosine) if len(aero.alpha) == 1 else 1.0
    force = rows.dynamic_pressure_pa * aero.area
    against = force * (drag + axial * by_angle * cosine + normal * sine**2)
    _, normal, moment, drag = _coefficients(aero, rows.mach, np.zeros_like(rows.mach))
    slope = normal + drag
    with np.errstate(divide="ignore", invalid="ignore"):
        pressure = np.where(slope > 0.0, aero.moment_station - aero.diameter * moment / slope, np.nan)
        stiffness = force * slope * (pressure - centre) / i_t
        resonant = np.sqrt(stiffness / (1.0 - i_x / i_t))
    felt = rows.dynamic_pressure_pa >= FELT
    return {
        "centre": centre,
        "pressure": np.where(felt, pressure, np.nan),
        "margin": np.where(felt, (pressure - centre) / aero.diameter, np.nan),
        "drag": against,
        "resonant": np.where(felt, resonant, np.nan),
    }


def _coefficients(aero, mach, alpha):
    """C_A, C_N/sin(alpha), C_M/sin(alpha), C_D of AeroTables, constant beyond their ends: four (n,)."""
    grids = (aero.axial, aero.normal, aero.moment, aero.drag)
    if len(aero.alpha) == 1:
        return [np.interp(mach, aero.mach, grid[:, 0]) for grid in grids]
    from scipy.interpolate import RegularGridInterpolator

    inside = np.clip(mach, *aero.mach[[0, -1]]), np.clip(alpha, *aero.alpha[[0, -1]])
    axes, places = (aero.mach, aero.alpha), np.column_stack(inside)
    return [RegularGridInterpolator(axes, grid)(places) for grid in grids]


# ---- what is said of it ----------------------------------------------------------------------------------


def upwards(looked):
    """(n,) bool: samples from the end of the rail to the apogee, where air is felt."""
    profile, flight = looked.profile, looked.flight
    free = (profile.t_s > at(flight, "rail_exit")) & (profile.t_s <= _top(looked))
    return free & (profile.dynamic_pressure >= FELT)


def flying(looked, k):
    """Name of configuration k, for people."""
    stages = list(looked.scenario.vehicle.stages)
    return " + ".join(["payload", *reversed(stages[k:])])


def summary(looked):
    """What is printed as JSON: dict of plain values, SI and degrees by their names."""
    profile = looked.profile
    flown = [k for k in range(len(looked.configurations)) if (profile.configuration == k).any()]
    share = looked.rail_exit_speed / looked.wind_speed if looked.wind_speed > 0.0 else None
    apogee = next((event for event in looked.flight.events if event.name == "apogee"), None)
    return {
        "scenario": looked.scenario.mission.name,
        "apogee_km": None if apogee is None else apogee.altitude_m / 1e3,
        "apogee_s": None if apogee is None else apogee.t_s,
        "rail_exit_speed_m_s": looked.rail_exit_speed,
        "wind_at_launcher_m_s": looked.wind_speed,
        "rail_exit_speed_over_wind": share,
        **_largest(looked),
        "motors": [_of_motor(*stage) for stage in looked.scenario.vehicle.stages.items()],
        "configurations": [_of_one(looked, k) for k in flown],
        "resonances": [
            {"at_s": t, "spin_hz": hz, "within_10_percent_s": stays} for t, hz, stays in resonances(looked)
        ],
        "warnings": [{"field": dotted(one.field), "text": one.text} for one in warnings(looked)],
    }


def _largest(looked):
    """Loads by all samples of the flight: what lasts some hundredths of a second is missed by the Profile."""
    rows = at_rows(looked.flight.trajectory, looked.flight.trajectory.t_s >= 0.0)
    _, found = _over(looked.flight, looked.configurations, rows)
    return {
        "largest_thrust_n": float(rows.thrust_n.max()),
        "largest_drag_n": float(found["drag"].max()),
        "largest_dynamic_pressure_pa": float(rows.dynamic_pressure_pa[rows.t_s < _top(looked)].max()),
        "largest_spin_hz": float(np.abs(rows.omega_ib_b[:, 0]).max() / (2.0 * np.pi)),
    }


def _of_motor(name, stage):
    """What is printed of the motor of a stage; impulses are those in vacuum."""
    total, specific = odd_parts.impulse(stage)
    return {
        "stage": name,
        "ignition_s": stage.ignition,
        "burn_time_s": thrust.burn_time(stage.motor),
        "propellant_kg": stage.propellant.mass,
        "total_impulse_n_s": total,
        "specific_impulse_s": specific,
    }


def _of_one(looked, k):
    """What is printed of configuration k."""
    profile, part = looked.profile, looked.profile.configuration == k
    first, last = np.flatnonzero(part)[[0, -1]]
    return {
        "flies": flying(looked, k),
        "from_s": float(profile.t_s[first]),
        "until_s": float(profile.t_s[last]),
        "mass_kg": [float(profile.mass[first]), float(profile.mass[last])],
        "centre_of_mass_m": [float(profile.centre[first]), float(profile.centre[last])],
        "diameter_m": float(looked.configurations[k].aero.diameter),
        "least_margin_up": _least(profile, part & upwards(looked)),
        "least_margin_down": _least(profile, part & (profile.t_s > _top(looked))),
    }


def _top(looked):
    """Time of the apogee, or of the end, s."""
    return at(looked.flight, "apogee") or looked.profile.t_s[-1]


def _least(profile, part):
    """Smallest static margin of some samples: {calibres, at_s, mach}; None where there is none."""
    part = part & np.isfinite(profile.margin)
    if not part.any():
        return None
    k = np.flatnonzero(part)[np.argmin(profile.margin[part])]
    calibres, at_s, mach = (float(column[k]) for column in (profile.margin, profile.t_s, profile.mach))
    return {"calibres": calibres, "at_s": at_s, "mach": mach}


def resonances(looked):
    """Each time that the spin passes the resonant one on the way up: list of (s, spin Hz, s nearby).

    Where a stage is dropped the resonant spin jumps: to be on its other side then is to have passed nothing.
    """
    profile, rising = looked.profile, upwards(looked) & np.isfinite(looked.profile.resonant)
    above = np.abs(profile.spin) - np.where(rising, profile.resonant, np.nan)
    with np.errstate(invalid="ignore"):
        near = np.abs(above) <= NEAR * profile.resonant
    found = []
    same = profile.configuration[:-1] == profile.configuration[1:]
    for k in np.flatnonzero((above[:-1] * above[1:] < 0.0) & rising[:-1] & rising[1:] & same):
        part = above[k] / (above[k] - above[k + 1])
        t = float(profile.t_s[k] + part * (profile.t_s[k + 1] - profile.t_s[k]))
        stays = [profile.t_s[b - 1] - profile.t_s[a] for a, b in stretches(near) if a - 1 <= k < b + 1]
        found.append((t, float(abs(profile.spin[k]) / (2.0 * np.pi)), float(max(stays, default=0.0))))
    return found


def warnings(looked):
    """What an engineer should look at: tuple of programme.Warned, each with its field of the scenario."""
    scenario = looked.scenario
    found = [*of_parts(scenario), *_unstable(looked), *_rail(looked), *_beyond_tables(looked)]
    for t, hz, stays in resonances(looked):
        words = f"the spin passes the resonance with the pitch motion at T{t:+.1f} s, {hz:.2f} Hz"
        words += f", and stays within {100 * NEAR:.0f} % of it for {stays:.1f} s; angles of attack grow there"
        found.append(Warned(_spinning(looked, t), words))
    trajectory = looked.flight.trajectory
    moved = sensor_limits.motion(trajectory.t_s, trajectory.omega_ib_b, trajectory.f_b)
    for limits in (sensor_limits.beyond, sensor_limits.coarse):
        found += [Warned(path, text) for path, text in limits(scenario.imu, moved)]
    return tuple(found)


def _stage(looked, k):
    """Path of the aerodynamics of configuration k."""
    stages = list(looked.scenario.vehicle.stages)
    return ("vehicle", "stages", stages[k]) if k < len(stages) else ("vehicle", "payload")


def _spinning(looked, t_s):
    k = int(looked.profile.configuration[np.searchsorted(looked.profile.t_s, t_s)])
    return (*_stage(looked, k), "aerodynamics")


def _unstable(looked):
    """A Warned for each configuration whose margin is too small on the way up."""
    profile = looked.profile
    for k in range(len(looked.configurations)):
        least = _least(profile, upwards(looked) & (profile.configuration == k))
        if least is None or least["calibres"] >= LEAST_MARGIN:
            continue
        state = "unstable" if least["calibres"] < 0.0 else f"below {LEAST_MARGIN:g}"
        words = f"the static margin falls to {least['calibres']:.2f} calibres ({state}) on the way up, at "
        words += f"T{least['at_s']:+.1f} s, Mach {least['mach']:.2f}; 1 to 2 calibres are usual"
        yield Warned((*_stage(looked, k), "aerodynamics"), words)


def _beyond_tables(looked):
    """A Warned for each configuration that feels air at angles of attack beyond its table."""
    scenario, t = looked.scenario, looked.flight.trajectory
    stages = [stage.aerodynamics for stage in scenario.vehicle.stages.values()]
    drops = [one.t_s for one in looked.flight.dropped]
    number = np.searchsorted(drops, t.t_s, side="right")
    for k, aero in enumerate([*stages, scenario.vehicle.payload.aerodynamics]):
        if aero is None or aero.angle_of_attack is None:
            continue
        last = aero.angle_of_attack[-1]
        beyond = (number == k) & (t.dynamic_pressure_pa >= FELT) & (t.angle_of_attack > last + 1e-6)
        beyond &= t.t_s > at(looked.flight, "rail_exit")
        if beyond.any():
            largest = math.degrees(t.angle_of_attack[beyond].max())
            lasts = beyond.sum() * (t.t_s[1] - t.t_s[0])
            words = f"the air is felt for {lasts:.1f} s at angles of attack of up to {largest:.0f} deg, and "
            words += f"its table ends at {math.degrees(last):.0f} deg: forces and moments there are a guess"
            yield Warned((*_stage(looked, k), "aerodynamics"), words)


def _rail(looked):
    """A Warned where the wind is too strong for the speed at the end of the rail."""
    speed, wind = looked.rail_exit_speed, looked.wind_speed
    if wind > 0.0 and speed < WIND_SHARE * wind:
        angle = math.degrees(math.atan2(wind, speed))
        words = (
            f"the rocket leaves the rail with {speed:.1f} m/s in a wind of {wind:.1f} m/s, at an angle of "
        )
        words += f"attack of up to {angle:.0f} deg; {WIND_SHARE:g} times the wind is usual: a longer rail, "
        yield Warned(("launch", "rail_length"), words + "more thrust, or another day")
