"""The errors of runs over their posterior Cramer-Rao bound: as a curve and per phase of the mission."""

from math import degrees
from typing import NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.clock import SAME_S
from shefex_nav.report import columns
from shefex_nav.scenario import aboard, surroundings
from shefex_nav.scenario.of_settings import settings
from shefex_nav.verify import bound, bound_instruments, bound_model, flown
from shefex_nav.verify.flown import ATT, PHASES, POS, VEL
from shefex_nav.world import gps

SETTLED_S = 10.0  # a phase's first seconds are left out of its ratio: the filter converges
QUANTITIES = (POS, VEL, ATT)
SHOWN = ("position, m", "velocity, m/s", "attitude, deg")


class Curves(NamedTuple):
    """Over m epochs: position [m], velocity [m/s], attitude [rad], lengths of vectors, rms over the runs."""

    t_s: np.ndarray  # (m,)
    phase: np.ndarray  # (m,) of the first run
    error: np.ndarray  # (m, 3)
    sigma: np.ndarray  # (m, 3) as reported
    bound: np.ndarray  # (m, 3) for a field of gravity that is not known beyond J2
    bound_known: np.ndarray  # (m, 3) for one that is known


def left_out(scenario):
    """What a scenario has that is no state of the bound, in words; '' if there is nothing."""
    errors, faults = scenario.gps.errors, scenario.faults
    found = []
    if scenario.navigation.gps == "tight":
        found.append("navigation.gps: tight (it takes fixes, not ranges)")
    if scenario.navigation.stars == "vectors":
        found.append("navigation.stars: vectors (it takes attitudes)")
    found += [f"gps.errors.{name}" for name in type(errors).model_fields if getattr(errors, name)]
    if _late(scenario):
        found.append("gps.clock_offset (it takes the stamps of fixes for right)")
    found += [
        f"{one.name} (it has no equation of its readings)"
        for one, _, _ in aboard.used(scenario)
        if one.equation is None
    ]
    found += [f"without: {', '.join(scenario.without)}"] if scenario.without else []
    found += [f"faults.{name}" for name in type(faults).model_fields if getattr(faults, name)]
    return ", ".join(found)


def _late(scenario):
    """Whether the stamps of GPS fixes are off by something that the computer is not told."""
    told = scenario.navigation.told.gps
    if told is not None and told.latency is not None:  # it does not look at the stamps
        return False
    known = 0.0 if told is None or told.clock_offset is None else told.clock_offset
    return scenario.gps.clock_offset != known


def bounds(scenario, world, fixes):
    """Bound of a run: for a field of gravity that is a random process beyond J2, and for a known one.

    Scenario, prepare.World, list of StarFix -> (Bound, Bound). ValueError if the scenario has errors that
    are not in it (`left_out`).
    """
    if left_out(scenario):
        raise ValueError(f"the bound does not know {left_out(scenario)}")
    flight = flight_of(scenario, world, fixes)
    field = surroundings.gravity(scenario)
    process = bound.gravity_process(field, flight.trajectory, world.earth)
    more = [source for one in flight.heard for source in one.sources]
    processes = (process, (0.0, np.inf))
    layouts = [bound_model.sources(flight.imu, flight.camera, *one, more) for one in processes]
    return tuple(bound.follow(flight, layout) for layout in layouts)


def flight_of(scenario, world, fixes):
    """What the bound needs of a run. Scenario, prepare.World, list of StarFix -> bound.Flight"""
    trajectory = world.flight.trajectory
    truth = prepare.truth(scenario, trajectory, world.earth)
    heard = [
        bound_instruments.readings_of(
            one.name, one.equation(given, truth), world.measured[one.name].readings, trajectory
        )
        for one, given, _ in aboard.used(scenario)
    ]
    return bound.Flight(
        trajectory,
        world.earth,
        world.alignment,
        gps.stamped(world.gps_fixes, -scenario.gps.clock_offset),  # by the instants that they measure
        fixes,
        settings(scenario.imu),
        settings(scenario.star_camera),
        np.array(scenario.gps.antenna.lever_arm),
        tuple(heard),
    )


def flights(scenario, seeds, note=lambda words: None):
    """Runs and bounds of some seeds, flown one after the other. `note` is called with words about each.

    -> list of flown.Run, list of `bounds`
    """
    runs, pairs = [], []
    for seed in seeds:
        note(f"seed {seed}")
        world = prepare.build_world(scenario, seed)
        fixes = flown.fly(scenario, seed)
        runs.append(flown.filter_run(scenario, seed, fixes, world=world))
        pairs.append(bounds(scenario, world, fixes))
    return runs, pairs


def curves(runs, pairs):
    """Curves of some runs.

    runs : list of flown.Run;  pairs : list of `bounds`, at the same epochs -> Curves
    """
    m = min(len(run.t_s) for run in runs)
    t_s = runs[0].t_s[:m]
    for pair in pairs:
        if not np.allclose(pair[0].t_s[:m], t_s, atol=SAME_S):
            raise ValueError("the bound is given at other epochs than the errors")

    def rms(values):
        return np.sqrt(np.mean(np.square(values), axis=0))

    error = [
        np.stack([np.sqrt((run.errors[:m, q] ** 2).sum(axis=1)) for q in QUANTITIES], axis=1) for run in runs
    ]
    sigma = [np.stack([bound.root_of_trace(run.P[:m, q, q]) for q in QUANTITIES], axis=1) for run in runs]
    both = [rms([np.stack(bound.sigmas(pair[k]), axis=1)[:m] for pair in pairs]) for k in range(2)]
    return Curves(t_s, runs[0].phase[:m], rms(error), rms(sigma), *both)


def ratios(found):
    """Error over bound in each phase, rms over its epochs but the first of each stretch.

    Curves -> dict phase -> dict of (3,): error, sigma, bound, ratio, ratio_known (gravity)
    """
    result = {}
    for p, name in enumerate(PHASES):
        chosen = (found.phase == p) & settled(found.t_s, found.phase, p)
        if not chosen.any():
            continue
        error, sigma, unknown, known = (np.sqrt((column[chosen] ** 2).mean(axis=0)) for column in found[2:])
        result[name] = {
            "error": error,
            "sigma": sigma,
            "bound": unknown,
            "ratio": error / unknown,
            "ratio_known": error / known,
        }
    return result


def settled(t_s, phase, p):
    """Epochs later than `SETTLED_S` in their stretch of a phase. (m,), (m,), int -> (m,) bool"""
    inside = phase == p
    begins = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    since = np.full(len(t_s), np.inf)
    for k in begins:
        since[k:] = t_s[k:] - t_s[k]
    return since >= SETTLED_S


def as_numbers(scenario, first, seeds, ratios):
    """Plain dict for JSON. Scenario, seed of the first run, number of runs, `ratios`"""
    phases = {name: {key: column.tolist() for key, column in one.items()} for name, one in ratios.items()}
    return {
        "scenario": scenario.mission.name,
        "first_seed": first,
        "seeds": seeds,
        "order": ["position_m", "velocity_m_s", "attitude_rad"],
        "phases": phases,
    }


def table(ratios, seeds):
    """rich Table of `ratios` of so many runs."""
    title = f"rms error of {seeds} runs and the posterior Cramer-Rao bound, 3D"
    heads = ("phase", "", ">error", ">reported sigma", ">bound", ">error/bound", ">gravity known")
    found = columns.table(title, heads, no_wrap=True)
    for phase, values in ratios.items():
        for q, quantity in enumerate(SHOWN):
            sizes = [float(values[key][q]) for key in ("error", "sigma", "bound")]
            sizes = [degrees(size) for size in sizes] if q == 2 else sizes
            shares = [f"{values[key][q]:.2f}" for key in ("ratio", "ratio_known")]
            found.add_row(phase if q == 0 else "", quantity, *(f"{size:.3g}" for size in sizes), *shares)
        found.add_section()
    return found
