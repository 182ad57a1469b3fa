"""Phases and events of a flight, from what was planned and from the truth as flown.

In: trajectory samples, moments of the timeline, what happened on the way. Out: the phase and the burning
stage at every sample, and the events in order of time.
"""

import numpy as np

from shefex_nav.clock import SAME_EVENT_S
from shefex_nav.geometry import frames
from shefex_nav.records import Event, Phase
from shefex_nav.world.flight import settings, tasks, timeline

LEVELS = (("entry", 100e3), ("altitude_60km", 60e3), ("altitude_20km", 20e3))  # m, on the way down
SOUND_TO = 120e3  # m; above it the air is too thin for sound


def burning(params, t_s):
    """(N,) int8: the stage that burns at t_s (N,), from 1; 0: none."""
    out = np.zeros(len(t_s), dtype=np.int8)
    for burn in timeline.burns(params):
        out[between(t_s, burn.t_0, burn.t_1)] = burn.number
    return out


def between(t_s, t_0, t_1):
    """Slice of the equally spaced times t_s (N,) with t_0 <= t < t_1."""
    return slice(*np.searchsorted(t_s, (t_0 - SAME_EVENT_S, t_1 - SAME_EVENT_S)))


def phases(params, t_s, stage, instants):
    """(N,) int8 `Phase` at t_s (N,). stage: (N,) as of `burning`; instants: {event: s}."""
    if isinstance(params.start, settings.Ground):
        return np.full(len(t_s), Phase.GROUND, dtype=np.int8)
    launch = isinstance(params.start, settings.Launch)
    out = np.full(len(t_s), Phase.COAST if launch else Phase.ORBIT, dtype=np.int8)
    if launch:
        out[between(t_s, -np.inf, instants["lift_off"])] = Phase.PAD
    down = instants.get("apogee" if launch else "entry", np.inf)
    last = params.programme[-1][1].end if params.programme else -np.inf
    out[between(t_s, max(down, last), np.inf)] = Phase.DESCENT
    for _, task in params.programme:
        still = isinstance(task, tasks.Dwell | tasks.TurnWithOrbit | tasks.Hold)
        out[between(t_s, task.start, task.end)] = Phase.POINTING if still else Phase.MANOEUVRE
    out[between(t_s, instants.get("parachute", np.inf), np.inf)] = Phase.PARACHUTE
    out[stage > 0] = Phase.BOOST
    return out


def found(launch, t_s, height, dynamic_pressure, landed):
    """{event: s} of what shows in the samples alone: apogee, heights on the way down, greatest pressure.

    launch : whether it is of a vehicle that starts on the ground; landed : whether it ends there
    """
    instants, after = {}, t_s[0]
    if launch:
        k = int(np.argmax(height))
        # vertical speed from the heights either side of the top sample, zero in between
        d0, d1 = height[k] - height[k - 1], height[k + 1] - height[k]
        after = 0.5 * (t_s[k - 1] + t_s[k]) + (t_s[k + 1] - t_s[k]) * d0 / (d0 - d1)
        instants["apogee"] = after
    for name, level in LEVELS:
        passed = _falls_below(t_s, height, level, after)
        if passed is not None:
            instants[name] = passed
    if launch or landed:
        instants["max_dynamic_pressure"] = t_s[int(np.argmax(dynamic_pressure))]
    return instants


def _falls_below(t_s, values, level, after):
    """First time after `after` at which the sampled values fall below the level; None if they never do."""
    above = values >= level
    where = np.flatnonzero(above[:-1] & ~above[1:] & (t_s[:-1] > after))
    if len(where) == 0:
        return None
    k = where[0]
    return t_s[k] + (level - values[k]) / (values[k + 1] - values[k]) * (t_s[k + 1] - t_s[k])


def describe(trajectory, height, earth, instants):
    """{event: s} -> tuple of `Event` in order of time. height: (N,) m of the samples."""
    t_s, events = trajectory.t_s, []
    for name, t in sorted(instants.items(), key=lambda item: item[1]):
        j = min(int(np.searchsorted(t_s, t)), len(t_s) - 1)
        _, v_e = frames.ecef_from_inertial(earth, t_s[j], trajectory.r_i[j], trajectory.v_i[j])
        detail = f"{np.sqrt(v_e @ v_e):.0f} m/s"
        if height[j] < SOUND_TO:
            detail += f", Mach {trajectory.mach[j]:.1f}"
        if name == "max_dynamic_pressure":
            detail += f", {1e-3 * trajectory.dynamic_pressure_pa[j]:.0f} kPa"
        near = slice(max(j - 1, 0), j + 1)
        events.append(Event(float(t), name, float(np.interp(t, t_s[near], height[near])), detail))
    return tuple(events)
