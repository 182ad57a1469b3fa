"""Covariances of one scenario at entry and at the end of its flight, by the linear model of the bound.

What several scenarios have in common is made once: the flight by all that share the vehicle, GPS fixes by all
that share the receiver, star fixes by all that share camera and star tracker (`Shared`).
"""

from typing import NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.clock import SAME_S, sample_s
from shefex_nav.errors import UserError
from shefex_nav.log import thinning
from shefex_nav.records import QUANTITIES
from shefex_nav.report import metrics, programme, sensor_limits, track
from shefex_nav.scenario import star_statistics, surroundings, wanted_states
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.dispersions import OF_FLIGHT
from shefex_nav.scenario.document import dotted
from shefex_nav.scenario.of_settings import settings
from shefex_nav.verify import bound, bound_model, over_bound
from shefex_nav.verify.trade import pointing, stars
from shefex_nav.verify.trade.growth import Growth
from shefex_nav.world.flight.record import truth_of

GPS_S = 1.0  # fixes that come more often are taken together
ENTRY, END, STARS, POINTING = "entry", "end", "stars", "pointing"
LARGE = np.radians(5.0)  # [E] of an attitude about an axis, 1 sigma: beyond it errors are not linear
LOOK_S = 1.0  # between two looks at that, as fixes come: thrust tells in seconds what spin has made unknown
MOST = {"flight": 2, "planned": 2, "moved": 2, "growth": 4}  # that are kept, of what is large
MOST_OTHERS = 64
ALONE = (  # sections that GPS fixes and readings of instruments do not depend on, but for the flight's part
    "imu", "star_camera", "star_tracker", "navigation", "requirements", "log", "campaign", "dispersions",
)  # fmt: skip
OF_STARS = "star_camera", "star_tracker"


def cost_rank(section):
    """0, 1 or 2: another setting of a section of a scenario takes another flight, other fixes, or neither."""
    if section not in ALONE:
        return int(section == "gps")
    return 1 if section in OF_STARS else 2


class NoPredictionError(UserError):
    """A scenario of which the linear model says nothing; the message says why."""


class Errors(NamedTuple):
    """Predicted errors at one time of a flight: covariances."""

    what: str  # ENTRY, END; STARS, POINTING: each the largest between star fixes, while pointing
    t_s: float  # of the attitude
    position_i: np.ndarray  # (3, 3) m^2
    velocity_i: np.ndarray  # (3, 3) m^2/s^2
    attitude_b: np.ndarray  # (3, 3) rad^2


class Prediction(NamedTuple):
    """What the linear model says of a scenario."""

    errors: tuple  # of Errors, in order of time
    gps_fixes: int
    star_frames: int  # that the star tracker takes
    star_fixes: int  # of these with an attitude
    star_sigma: float  # rad, median over the fixes, of one across the boresight; NaN without any
    warnings: tuple  # of texts, as `check` gives them
    doubtful: bool  # before the first of the errors the IMU is at its range, or the attitude beyond LARGE
    taken_over: tuple  # settings of camera and star tracker to which its statistics were not fitted
    largest: tuple = ()  # of Errors: STARS if there are two star fixes, POINTING if that is required
    while_pointing: pointing.Largest | None = None  # None: nothing is required of it, or it never points
    second_star_s: float | None = None  # time of the second star fix; None: there are no two

    def at(self, what):
        """Errors of ENTRY, END, STARS or POINTING; None where the flight has none."""
        return next((one for one in (*self.errors, *self.largest) if one.what == what), None)

    def before_stars(self, what):
        """Whether the attitude of Errors is from before the second star fix, or just before it."""
        errors, since_s = self.at(what), self.second_star_s
        return errors is not None and since_s is not None and errors.t_s <= since_s + SAME_S


class Shared:
    """What scenarios have in common. model : StarStatistics or None;  seed : of flight and GPS receiver"""

    def __init__(self, model, seed):
        self.model, self.seed, self._kept = model, seed, {}

    def of(self, what, key, make):
        """The thing of a kind and a key, made when it is asked for first."""
        kept = self._kept.setdefault(what, {})
        if key not in kept:
            while len(kept) >= MOST.get(what, MOST_OTHERS):
                kept.pop(next(iter(kept)))
            kept[key] = make()
        return kept[key]


def predict(scenario, shared, *, star_s=stars.EVERY_S, gps_s=GPS_S):
    """Prediction of a scenario; NoPredictionError, and what its flight and its sensors raise.

    star_s, gps_s : one star fix stands for those of so long, one GPS fix likewise
    """
    scenario = _with_model(scenario, shared.model)
    refuse(scenario)
    key = flight_key(scenario)
    flight = shared.of("flight", key, lambda: prepare.fly_vehicle(scenario, shared.seed))
    scenario = _settled(scenario, shared, key, flight)
    given = key, _others(scenario)
    heard = shared.of("heard", given, lambda: _with_readings(scenario, shared.seed, flight, gps_s))
    seen = stars.NONE
    if scenario.star_tracker.enabled:
        given = key, _of_stars(scenario)
        seen = shared.of("stars", given, lambda: _stars(scenario, shared.seed, flight, star_s))
    along = heard._replace(
        imu=settings(scenario.imu), camera=settings(scenario.star_camera), star_fixes=list(seen.fixes)
    )
    field = surroundings.gravity(scenario)
    process = shared.of("gravity", key, lambda: bound.gravity_process(field, flight.trajectory, along.earth))
    growth = shared.of("growth", (key, repr(along.imu.vibration)), lambda: Growth(along))
    flown = shared.of("flown", key, lambda: programme.of_flight(flight))
    wanted = shared.of("wanted", key, lambda: _wanted(flight.trajectory, along.earth))
    is_pointing = any(getattr(scenario.requirements, name).while_pointing for name in QUANTITIES)
    points = pointing.samples(flight.trajectory) if is_pointing else []
    errors, largest, widest, while_pointing = _errors(
        along, growth, process, wanted, set(points), shared.seed
    )
    return Prediction(
        errors,
        len(along.gps_fixes),
        seen.frames,
        seen.solved,
        seen.sigma,
        tuple(f"{dotted(one.field)}: {one.text}" for one in programme.foreseen(scenario, flown)),
        at_range(scenario.imu, flown.motion, errors[0].t_s) or bool(widest > LARGE),
        _taken_over(scenario),
        largest,
        while_pointing,
        seen.second_s,
    )


def _settled(scenario, shared, key, flight):
    """The Scenario with the states that its filter has. key, flight : of it, with the seed of `shared`"""
    if scenario.navigation.states != AUTOMATIC:
        return scenario
    if shared.seed != prepare.PLANNED:
        flight = shared.of("planned", key, lambda: prepare.fly_vehicle(scenario, prepare.PLANNED))
    moved = shared.of("moved", key, lambda: wanted_states.motion(flight.trajectory))
    return prepare.settled(scenario, flight, moved)


def at_range(imu, motion, until_s):
    """Whether a flight exceeds a range of the IMU up to a time. Its section, sensor_limits.Motion, s"""
    before = motion.t_s <= until_s
    return any(True for _ in sensor_limits.beyond(imu, motion._make(column[before] for column in motion)))


def refuse(scenario):
    """NoPredictionError if the linear model or the statistics of the star tracker do not know a scenario."""
    left_out = over_bound.left_out(scenario)
    found = [f"the linear model does not know {left_out}"] if left_out else []
    if scenario.star_tracker.enabled:
        found += [f"{'.'.join(path)}: {words}" for path, words in star_statistics.fitness(scenario)]
        if scenario.star_tracker.model is None:
            found.append("star_tracker.model names no statistics; `shefex-nav characterise` makes them")
    if found:
        raise NoPredictionError("; ".join(found))


def _with_model(scenario, model):
    """The Scenario with statistics, whatever its frames are; those of its own first."""
    tracker = scenario.star_tracker
    if not tracker.enabled or tracker.model is not None or model is None:
        return scenario
    return scenario.with_sections(star_tracker=tracker.model_copy(update={"model": model}))


def _taken_over(scenario):
    """Settings that are not those which the statistics of the star tracker were fitted to: tuple of paths."""
    if not scenario.star_tracker.enabled:
        return ()
    tracker = scenario.star_tracker.model_copy(update={"frames": "statistical"})
    others = scenario.with_sections(star_tracker=tracker)
    return tuple(".".join(map(str, path)) for path, _ in star_statistics.contradictions(others))


def flight_key(scenario):
    """What decides on a flight, as a text: two scenarios with the same one fly it together."""
    dump, found = scenario.model_dump(include={path[0] for path in OF_FLIGHT}), []
    dump["mission"] = {k: v for k, v in dump["mission"].items() if k not in ("name", "description")}
    for path in OF_FLIGHT:
        value = dump
        for key in path:
            value = value[key]
        found.append((path, value))
    return repr(found)


def _others(scenario):
    """What decides on GPS fixes and readings of instruments, as a text."""
    dump = scenario.model_dump(exclude=set(ALONE))
    return repr(dump)


def _of_stars(scenario):
    """What decides on star fixes beside the flight, as a text: camera, star tracker, what that is told."""
    dump = scenario.model_dump(include=set(OF_STARS), exclude={"star_tracker": {"model"}})
    return repr((dump, scenario.navigation.told))


def _with_readings(scenario, seed, flight, gps_s):
    """bound.Flight with what GPS receiver and instruments say, still without star fixes."""
    world = prepare.with_faults(scenario, prepare.measure(scenario, seed, flight))
    fixes = together([fix for fix in world.gps_fixes if fix.valid], gps_s)
    return over_bound.flight_of(scenario, world._replace(gps_fixes=fixes), [])


def together(fixes, every_s):
    """GPS fixes about the same multiple of a time as one, that nearest to it, with the covariance of a mean.

    list of GpsFix, s -> list
    """
    groups = {}
    for fix in fixes:
        groups.setdefault(round(fix.t_valid_s / every_s), []).append(fix)
    return [_mean(group, n * every_s) for n, group in groups.items()]


def _mean(group, t_s):
    """The GpsFix of a group that is nearest to a time, with the covariance of their mean."""
    nearest = min(group, key=lambda fix: abs(fix.t_valid_s - t_s))
    R_r_e, R_v_e = (
        np.mean([getattr(fix, name) for fix in group], axis=0) / len(group) for name in ("R_r_e", "R_v_e")
    )
    return nearest._replace(R_r_e=R_r_e, R_v_e=R_v_e)


def _stars(scenario, seed, flight, every_s):
    """stars.StarFixes of a scenario."""
    return stars.star_fixes(scenario, prepare.unmeasured(scenario, seed, flight), seed, every_s)


def _wanted(trajectory, earth):
    """Samples of ENTRY, if there is one, and of END: {index: ENTRY or END}."""
    truth = truth_of(trajectory, thinning.ticks(thinning.LOWEST_HZ))
    entry = metrics.entry_index(track.earth_fixed(earth, truth).height)
    whats = [END] if entry is None else [ENTRY, END]
    times = [truth.t_s[-1]] if entry is None else [truth.t_s[entry], truth.t_s[-1]]
    at = np.searchsorted(trajectory.t_s, np.array(times) - SAME_S)
    return dict(zip(at[::-1].tolist(), whats[::-1], strict=True))  # an entry at the end is an entry


def _errors(along, growth, process, wanted, points, seed):
    """Errors at entry, if there is one, and at the end; largest ones; largest sigma of the attitude before.

    along : bound.Flight;  growth : Growth;  process : sigma and tau of gravity;  wanted : of `_wanted`
    points : set of samples of `pointing`;  seed : of histories at these
    -> tuple of Errors, tuple of those of STARS and POINTING, rad, pointing.Largest or None
    """
    trajectory, more = along.trajectory, [source for one in along.heard for source in one.sources]
    layout = bound_model.sources(along.imu, along.camera, *process, more)
    look, first = round(LOOK_S / sample_s(trajectory.t_s)), min(wanted)
    looks, starred = {*wanted, *range(look, first, look)}, set(_at_stars(along).tolist())
    levels, found, in_stars, in_points, widest, largest = bound.momentary_levels(along), [], [], [], 0.0, 0.0
    rng = np.random.default_rng(seed)
    histories = pointing.histories(trajectory.t_s[sorted(points)], rng)
    at = np.array(sorted(looks | starred | points))
    for k, output in bound.outputs_at(along, layout, at, growth.of(along, layout), **histories):
        t_s, errors = float(trajectory.t_s[k]), bound.reported(along, levels, k, output.P)
        if k in points:
            in_points.append(Errors(POINTING, t_s, *errors))
            momentary = bound.momentary_at(along, levels, k)
            drawn = pointing.sizes(trajectory.q_ib[k], momentary, output.errors, rng)
            largest = np.maximum(largest, drawn)
        if k in starred:
            in_stars.append(Errors(STARS, t_s, *errors))
        if k in wanted:
            found.append(Errors(wanted[k], t_s, *errors))
        if k in looks and k <= first:
            widest = max(widest, float(np.sqrt(errors[2].diagonal().max())))
    more = [one for one in (_largest(in_stars), _largest(in_points)) if one is not None]
    return tuple(found), tuple(more), widest, pointing.Largest(len(points), *largest) if points else None


def _at_stars(along):
    """Samples of the star fixes that come when one is known already: errors are largest just before a fix.

    bound.Flight -> (n,) int
    """
    begin_s, dt_s, fixes = along.trajectory.t_s[0], sample_s(along.trajectory.t_s), along.star_fixes
    known_s = fixes[0].t_available_s if fixes else 0.0
    later = [round((fix.t_valid_s - begin_s) / dt_s) for fix in fixes if fix.t_valid_s > known_s]
    return np.array(later, dtype=int)


def _largest(found):
    """Errors of which each covariance is that with the largest trace; None of none. list of Errors"""
    if not found:
        return None
    position, velocity, attitude = (
        max(found, key=lambda one, field=field: getattr(one, field).trace())
        for field in ("position_i", "velocity_i", "attitude_b")
    )
    return attitude._replace(position_i=position.position_i, velocity_i=velocity.velocity_i)
