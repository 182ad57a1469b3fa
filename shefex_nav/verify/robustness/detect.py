"""From which instant on a fault could be noticed.

A flight and its twin, in which nothing happens, have the same seed and so the same noise. As long as the
filter treats both alike, their innovations differ by what the fault does to them and by nothing else: D. A
fault can be noticed once the sum of D^T S^-1 D over all innovations since its begin has reached `ENOUGH`.

Once the filter treats a measurement otherwise (refuses it, resets, names a sensor), the two estimates rest on
different measurements, and the difference of their innovations has noise in it. So the innovation on which it
reacts still counts in full; of every later one counts what exceeds `CHANCE`, the chi-square that the noise of
two healthy filters does not exceed in 0.1 %.

What readings tell by themselves (`shows`) can be noticed at once, whatever the innovations say: readings at
the end of a range, samples that are missing, samples or fixes that repeat themselves to the last digit.

The filter's records say of an innovation how large it is by its own covariance, not that covariance itself.
Every linearisation passes through the filter's table of sensors, so that is where it is looked at
(`watched`); the filter does what it did before.
"""

from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from shefex_nav.clock import IMU_HZ
from shefex_nav.verify.robustness import happenings
from shefex_nav.world import vibration as spectrum

ENOUGH = 100.0
CHANCE = {dof: float(chi2.ppf(0.999, dof)) for dof in range(1, 80)}
SLACK_S = 1e-6


class Flown(NamedTuple):
    """Of a flight, what it takes to compare it with its twin."""

    seen: dict  # of `watched`
    gates: list  # GateResult
    health: list  # NavHealth


class Detectable(NamedTuple):
    """When a fault can be noticed first, and by what."""

    t_s: float | None  # None: never
    by: str
    total: float  # sum of D^T S^-1 D over the flight, or up to t_s


def instant(faulty, clean, start_s):
    """Detectable by innovations. Flown, Flown, begin of the fault"""
    there, others = _by_key(clean.gates)
    _, own = _by_key(faulty.gates)
    statement_s = first_statement(faulty.health, clean.health, start_s)
    total, reacted = 0.0, False
    for gate in faulty.gates:
        other = there.get(_key(gate)) or _same_place(gate, own, others)
        now, before = faulty.seen.get(_key(gate)), other and clean.seen.get(_key(other))
        if gate.t_s < start_s - SLACK_S or None in (other, now, before) or now.z.shape != before.z.shape:
            continue
        reacted |= gate.t_s > statement_s + SLACK_S
        D = now.z - before.z
        part = float(D @ np.linalg.solve(before.S, D))
        total += max(0.0, part - CHANCE[len(D)]) if reacted else part
        if total >= ENOUGH:
            return Detectable(gate.t_s, happenings.INNOVATIONS, total)
        reacted |= (gate.accepted, gate.note) != (other.accepted, other.note)
    return Detectable(None, "", total)


def first_statement(health, others, start_s):
    """When the first thing is said that the twin does not say: s, inf if never. lists of NavHealth"""
    known = {(one.source, one.healthy, round(one.t_s, 3)) for one in others}
    new = [one.t_s for one in health if (one.source, one.healthy, round(one.t_s, 3)) not in known]
    return min((t_s for t_s in new if t_s >= start_s - SLACK_S), default=np.inf)


def of_readings(happening, window, scenario, fixes):
    """Detectable by the readings alone; never, where they say nothing.

    happening : Happening;  window : Window;  scenario : Scenario of the world
    fixes : list of GpsFix, as the computer gets them
    """
    if happening.shows == happenings.AT_ONCE:
        return Detectable(window.start_s, happening.shows, np.inf)
    if happening.shows == happenings.REPEATS:
        t_s = window.start_s + _repeats_s(scenario, happening)
        return Detectable(t_s if t_s <= window.end_s else None, happening.shows, np.inf)
    if happening.shows == happenings.REPEATED_FIX:
        return Detectable(_repeated_s(fixes, window), happening.shows, np.inf)
    if happening.shows == happenings.SPREAD:
        return Detectable(window.start_s + _spread_s(scenario, happening.shakes), happening.shows, np.inf)
    return Detectable(None, "", 0.0)


def earliest(*found):
    """The earliest of several Detectable; of none that ever is, the one with the largest sum."""
    certain = [one for one in found if one.t_s is not None]
    return min(certain, key=lambda one: one.t_s) if certain else max(found, key=lambda one: one.total)


def _spread_s(scenario, factor):
    """How long accelerometer readings take to show that vibration is `factor` times the told, at rest: s.

    Variance of an increment: random walk, rounding, and vibration of flat density S, S dt/2
    and the share of its band (`world.vibration`).
    """
    triad, vibration, dt_s = scenario.imu.accelerometer, scenario.imu.vibration, 1.0 / IMU_HZ
    density = vibration.coast**2 / spectrum.bandwidth(vibration)
    shaken = 0.5 * density * dt_s * spectrum.share(vibration, dt_s)
    still = triad.random_walk**2 * dt_s + triad.quantum**2 / 6.0
    ratio = (still + factor**2 * shaken) / (still + shaken)
    return dt_s * ENOUGH / (3.0 * max(ratio - 1.0 - np.log(ratio), 1e-12))  # of three axes


def _repeats_s(scenario, happening):
    """For how long a healthy axis can repeat a reading: s."""
    from shefex_nav.onboard.navigation import integrity_readings

    triad = scenario.imu.gyro if "gyro" in happening.words else scenario.imu.accelerometer
    return integrity_readings.repeats(triad.random_walk / np.sqrt(IMU_HZ), triad.quantum) / IMU_HZ


def _repeated_s(fixes, window):
    """When the first fix arrives that repeats the one before it: s, None if none does."""
    valid = [fix for fix in fixes if fix.valid]
    for before, fix in pairwise(valid):
        if fix.t_available_s >= window.start_s and np.array_equal(fix.r_ea_e, before.r_ea_e):
            return fix.t_available_s
    return None


def _by_key(gates):
    """Gates that met the gate: dict, key -> the first; and of each sensor in the order of their instants."""
    met = [gate for gate in gates if gate.dof]
    ordered = {}
    for gate in sorted(met, key=lambda one: one.t_valid_s):
        ordered.setdefault(gate.sensor, []).append(_key(gate))
    return {_key(gate): gate for gate in reversed(met)}, (ordered, {_key(gate): gate for gate in met})


def _same_place(gate, own, others):
    """The gate of the twin that a fix with a wrong time belongs to: that of the same number, or None."""
    mine, theirs = own[0].get(gate.sensor, []), others[0].get(gate.sensor, [])
    if len(mine) != len(theirs) or _key(gate) not in mine:
        return None
    return others[1][theirs[mine.index(_key(gate))]]


def _key(gate):
    return gate.sensor, gate.t_valid_s


class Innovation(NamedTuple):
    """One innovation, when it met the gate."""

    z: np.ndarray  # (m,)
    S: np.ndarray  # (m, m)


@contextmanager
def watched(seen):
    """While a filter flies in this process, `seen` is filled: dict, (sensor, t_valid_s) -> Innovation."""
    from shefex_nav.onboard.navigation import fusion

    table = fusion.table

    def noting(params):
        return {
            name: sensor._replace(linearise=partial(_noted, name, sensor.linearise, seen))
            for name, sensor in table(params).items()
        }

    fusion.table = noting
    try:
        yield
    finally:
        fusion.table = table


def _noted(name, linearise, seen, nav, now, fix):
    z, H, R = linearise(nav, now, fix)
    if (name, fix.t_valid_s) not in seen:
        seen[name, fix.t_valid_s] = Innovation(z.copy(), H @ now.P @ H.T + R)
    return z, H, R
