"""A flight along a trajectory that is given: truth at the IMU rate, and what it shows of phases and events.

In: a `track.Given`, gravity and air of the scenario. Out: a `fly.Flight`, as of a vehicle that was flown.

The specific force is the acceleration of the track less gravity. Increments are Simpson's integrals over a
sample; those of velocity are put right by what the velocity has really gained, so that they add up to the
track whatever happens between two samples.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from shefex_nav.clock import SAME_EVENT_S
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import gravity_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.geometry.elementary import arctan2, exp
from shefex_nav.records import Phase, Trajectory
from shefex_nav.world.flight import events
from shefex_nav.world.flight.fly import Flight

AT_ONCE = 100_000  # samples
GRAVITY_S = 0.1  # between two instants at which gravity is asked for; it changes in minutes
AIR_M = 25.0  # between two heights at which US76 is asked for
PUSHED = 2.0  # m/s^2 along the air velocity from which on a motor burns; drag is negative
SHORTEST_BURN, SHORTEST_PAUSE = 0.2, 0.5  # s
MOVES = 0.5  # m/s relative to the Earth: it has lifted off
SPACE = 100e3  # m, above which a vehicle that is there at the start is in orbit
GROUND = 100.0  # m above the ground: a vehicle that comes down ends there by an impact
HIGHEST_GROUND = 9e3  # m above the ellipsoid; who stands higher hangs, and the ellipsoid counts as ground


class KnownPhases(NamedTuple):
    """What a file says of the flight itself, as a log of ours does."""

    t_s: np.ndarray  # (N,)
    phase: np.ndarray  # (N,) from then on
    instants: dict  # event -> s


class GivenParams(NamedTuple):
    """What else decides the flight."""

    t_start_s: float
    t_end_s: float
    sample_rate_hz: float
    gravity: tuple  # environment.gravity.GravityModel
    air: object  # params.Air
    motors: int  # whose vibration is told; 0: none
    separations: tuple  # s, from each on the next motor may burn
    known: KnownPhases | None = None  # None: it is looked for


def fly(given, params, earth):
    """Flight along a trajectory. track.Given, GivenParams, EarthRotation -> fly.Flight."""
    dt = 1.0 / params.sample_rate_hz
    n = int(np.floor((params.t_end_s - params.t_start_s) * params.sample_rate_hz + 1e-6)) + 1
    t_s = params.t_start_s + dt * np.arange(n)
    columns = _sampled(given, t_s, params.gravity, earth)
    v_e, height = _over_the_earth(earth, t_s, columns["r_i"], columns["v_i"])
    mach, pressure = _in_the_air(params.air, height, np.linalg.norm(v_e, axis=1))
    push, attack = _along_the_air(earth, t_s, columns, v_e)
    starts = _start(height[0], v_e[0])
    seen = _by_motion(params, t_s, (v_e, height, push, pressure), starts)
    number, instants = seen if params.known is None else _by_file(params, t_s)
    phase = (
        _phases(t_s, number, instants, starts) if params.known is None else _phases_of_file(params.known, t_s)
    )
    none = np.full(n, np.nan)  # nobody knows
    trajectory = Trajectory(
        t_s=t_s, phase=phase, **columns, mass_kg=none, mach=mach, dynamic_pressure_pa=pressure, thrust_n=none,
        burning=np.minimum(number, params.motors).astype(np.int8), angle_of_attack=attack,
    )  # fmt: skip
    return Flight(trajectory, events.describe(trajectory, height, earth, instants), None)


def _sampled(given, t_s, model, earth):
    """Columns of the Trajectory about the motion: dict."""
    parts = []
    for first in range(0, len(t_s), AT_ONCE):
        last = min(first + AT_ONCE, len(t_s))
        begin = max(first - 1, 0)
        part = _part(given, t_s[begin:last], model, earth)
        parts.append({name: column[first - begin :] for name, column in part.items()})
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    q = columns["q_ib"]
    turns = np.where(np.einsum("ki,ki->k", q[1:], q[:-1]) < 0.0, -1.0, 1.0)
    q *= np.cumprod(np.append(-1.0 if q[0, 0] < 0.0 else 1.0, turns))[:, None]  # no jumps of sign
    return {name: np.ascontiguousarray(column) for name, column in columns.items()}


def _part(given, t_s, model, earth):
    """The same of some samples, of which the first has no increments."""
    fine_s = np.empty(2 * len(t_s) - 1)
    fine_s[::2], fine_s[1::2] = t_s, 0.5 * (t_s[1:] + t_s[:-1])
    motion = given.at(fine_s)
    C_ib, dt_s = motion.attitude.as_matrix(), np.diff(t_s)[:, None]
    gravity_i = _gravity(model, earth, fine_s, motion.r_i)
    f_b = np.einsum("kji,kj->ki", C_ib, motion.a_i - gravity_i)
    missing_i = np.diff(motion.v_i[::2], axis=0) - _simpson(motion.a_i, dt_s)
    dtheta_b, dv_b = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
    dtheta_b[1:] = _simpson(motion.omega_ib_b, dt_s)
    dv_b[1:] = _simpson(f_b, dt_s) + np.einsum("kji,kj->ki", C_ib[1::2], missing_i)
    return {
        "r_i": motion.r_i[::2],
        "v_i": motion.v_i[::2],
        "q_ib": rotation.wxyz(motion.attitude.as_quat()[::2]),
        "omega_ib_b": motion.omega_ib_b[::2],
        "f_b": f_b[::2],
        "dtheta_b": dtheta_b,
        "dv_b": dv_b,
    }


def _simpson(values, dt_s):
    """Integrals (n - 1, 3) from sample to sample of values (2 n - 1, 3) at samples and between them."""
    return dt_s / 6.0 * (values[:-1:2] + 4.0 * values[1::2] + values[2::2])


def _gravity(model, earth, t_s, r_i):
    """Gravitation (n, 3) m/s^2, frame i, at positions along a track."""
    step = max(1, round(GRAVITY_S * (len(t_s) - 1) / max(t_s[-1] - t_s[0], 1e-9))) if len(t_s) > 1 else 1
    rows = np.unique(np.append(np.arange(0, len(t_s), step), len(t_s) - 1))
    C_ie = frames.dcms_ie(earth, t_s[rows])
    r_e = np.einsum("kji,kj->ki", C_ie, r_i[rows])
    g_i = np.einsum("kij,kj->ki", C_ie, np.array([gravity_e(model, one) for one in r_e]))
    if len(rows) < 4:
        return np.column_stack([np.interp(t_s, t_s[rows], column) for column in g_i.T])
    return CubicSpline(t_s[rows], g_i)(t_s)


def _over_the_earth(earth, t_s, r_i, v_i):
    """Velocity relative to the Earth (N, 3) m/s, frame e; height (N,) m."""
    C_ie = frames.dcms_ie(earth, t_s)
    r_e = np.einsum("kji,kj->ki", C_ie, r_i)
    v_e = np.einsum("kji,kj->ki", C_ie, v_i - np.cross(frames.omega_ie_i(earth), r_i))
    return v_e, np.array([wgs84.geodetic_from_ecef(one)[2] for one in r_e])


def _in_the_air(air, height, speed):
    """Mach number and dynamic pressure (N,) Pa in air at rest."""
    if len(air.table):
        rows = [np.interp(height, air.table[:, 0], column) for column in air.table[:, 1:].T]
        vacuum = height > air.table[-1, 0]  # as in `surroundings.air`
        density, sound = np.where(vacuum, 0.0, exp(rows[0])), rows[2]
    else:
        grid = np.arange(height.min() - AIR_M, height.max() + 2.0 * AIR_M, AIR_M)
        standard = np.array([us76(float(one)) for one in grid])
        density, sound = (np.interp(height, grid, standard[:, k]) for k in (0, 3))
    return speed / sound, 0.5 * air.density_factor * density * speed**2


def _along_the_air(earth, t_s, columns, v_e):
    """Specific force along the air velocity (N,) m/s^2, and the total angle of attack (N,) rad; 0 at rest."""
    speed = np.linalg.norm(v_e, axis=1)
    v_i = np.einsum("kij,kj->ki", frames.dcms_ie(earth, t_s), v_e)
    w, q = columns["q_ib"][:, :1], -columns["q_ib"][:, 1:]
    v_b = v_i + 2.0 * np.cross(q, w * v_i + np.cross(q, v_i))
    moves = speed > MOVES
    push = np.where(moves, np.einsum("ki,ki->k", columns["f_b"], v_b) / np.maximum(speed, MOVES), 0.0)
    return push, np.where(moves, arctan2(np.linalg.norm(v_b[:, 1:], axis=1), v_b[:, 0]), 0.0)


def _start(height, v_e):
    """How it starts: Phase.PAD at rest, Phase.ORBIT above the air, else Phase.COAST."""
    if np.linalg.norm(v_e) < MOVES:
        return Phase.PAD
    return Phase.ORBIT if height > SPACE else Phase.COAST


def _by_motion(params, t_s, shown, starts):
    """What the motion shows: the burning motor (N,), from 1; 0: none, and {event: s}.

    shown : velocity relative to the Earth, height, push, dynamic pressure
    """
    v_e, height, push, pressure = shown
    instants = {f"separation_{k}": at for k, at in enumerate(params.separations, 1)}
    moving = np.linalg.norm(v_e, axis=1) > MOVES
    if not moving.any():
        return np.zeros(len(t_s), dtype=int), {}
    if starts == Phase.PAD:
        instants["lift_off"] = float(t_s[np.argmax(moving)])
    landed = bool(moving[-1]) and _lands(height, starts)  # what lies still came down before
    rises = starts != Phase.ORBIT and np.argmax(moving) < np.argmax(height) < len(height) - 1
    instants |= events.found(rises, t_s, height, pressure, landed)
    if landed:
        instants["impact"] = float(t_s[-1])
    number = np.zeros(len(t_s), dtype=int)
    for k, (first, last) in enumerate(_burns(t_s, push, instants.get("apogee", np.inf)), 1):
        number[first : last + 1] = 1 + sum(at <= t_s[first] for at in params.separations)
        if k > 1 or starts != Phase.PAD:
            instants[f"ignition_{k}"] = float(t_s[first])
        instants[f"burn_out_{k}"] = float(t_s[last])
    return number, {name: at for name, at in instants.items() if t_s[0] <= at <= t_s[-1]}


def _lands(height, starts):
    """Whether it ends by an impact. Who stands on the ground shows its height, who starts in the air not.

    height : (N,) m
    """
    stands = starts == Phase.PAD and height[0] < HIGHEST_GROUND
    ground = max(0.0, height[0]) if stands else 0.0
    return bool(height[-1] < height[-2] and height[-1] < ground + GROUND)


def _burns(t_s, push, until_s):
    """(first, last) sample of each burn."""
    rows = np.flatnonzero((push > PUSHED) & (t_s < until_s))
    parts = np.split(rows, np.flatnonzero(np.diff(t_s[rows]) > SHORTEST_PAUSE) + 1)
    return [(one[0], one[-1]) for one in parts if len(one) and t_s[one[-1]] - t_s[one[0]] >= SHORTEST_BURN]


def _phases(t_s, number, instants, starts):
    """(N,) int8 Phase."""
    out = np.full(len(t_s), Phase.ORBIT if starts == Phase.ORBIT else Phase.COAST, dtype=np.int8)
    if starts == Phase.PAD:
        out[events.between(t_s, -np.inf, instants.get("lift_off", np.inf))] = Phase.PAD
    down = "entry" if starts == Phase.ORBIT else "apogee"
    out[events.between(t_s, instants.get(down, np.inf), np.inf)] = Phase.DESCENT
    out[number > 0] = Phase.BOOST
    return out


def _by_file(params, t_s):
    """The burning motor and the events of a flight whose file says so; as `_by_motion`."""
    boost = _phases_of_file(params.known, t_s) == Phase.BOOST
    number = 1 + np.searchsorted(np.array(params.separations, dtype=float), t_s, side="right")
    begin_s, end_s = t_s[0] - SAME_EVENT_S, params.t_end_s + SAME_EVENT_S  # an impact is between two samples
    instants = {name: at for name, at in params.known.instants.items() if begin_s <= at <= end_s}
    return np.where(boost, number, 0), instants


def _phases_of_file(known, t_s):
    """(N,) int8 Phase, of each row of a file until the next one."""
    rows = np.clip(np.searchsorted(known.t_s, t_s + 1e-9, side="right") - 1, 0, len(known.t_s) - 1)
    return known.phase[rows].astype(np.int8)
