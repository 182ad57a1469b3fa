"""What happens when: stages, tasks and devices put in order of time, and checked against each other.

In: `FlightParams`. Out: the moments at which a section of the flight ends, and which stage burns when. A
FlightError is of what the vehicle cannot do, with the key of the scenario that asks for it.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_EVENT_S
from shefex_nav.errors import UserError
from shefex_nav.world.flight import params as p
from shefex_nav.world.flight import settings, tasks

LOOP = 0.5  # bandwidth times period up to which a sampled double pole is well damped


class Kind(IntEnum):
    """Kinds of moments; those of the same instant come in this order."""

    END = 0  # of a task
    SEPARATION = 1
    IGNITION = 2
    YO_YO = 3
    SPIN_MOTORS = 4
    PARACHUTE = 5  # at a set time
    BEGIN = 6  # of a task


class Moment(NamedTuple):
    """Something that happens at a set time."""

    t_s: float
    kind: Kind
    number: int  # of the stage from 1, or of the task from 0; else 0
    name: str  # of the event


class Burn(NamedTuple):
    """From ignition to burn-out of a stage."""

    t_0: float
    t_1: float
    number: int  # of the stage, from 1


def burns(params):
    """The burns in order of time: tuple of `Burn`."""
    return tuple(
        Burn(float(s.t_ignition_s), float(s.t_ignition_s + s.motor.t_s[-1]), n)
        for n, s in enumerate(params.stages, 1)
    )


def moments(params):
    """Every `Moment` of the flight until the time limit, in order of time."""
    return [moment for moment in _planned(params) if moment.t_s <= params.time_limit_s]


def _planned(params):
    """Every `Moment` that is planned, in order of time.

    The first ignition of a launch is left out: it belongs to the time on the rail.
    """
    launch = isinstance(params.start, settings.Launch)
    found = [
        Moment(burn.t_0, Kind.IGNITION, burn.number, f"ignition_{burn.number}")
        for burn in burns(params)[1 if launch else 0 :]
    ]
    for n, stage in enumerate(params.stages, 1):
        if stage.separation is not None:
            found.append(Moment(stage.separation.at, Kind.SEPARATION, n, f"separation_{n}"))
    for n, (name, task) in enumerate(params.programme):
        found.append(Moment(task.start, Kind.BEGIN, n, f"{name}_start"))
        found.append(Moment(task.end, Kind.END, n, f"{name}_end"))
    if params.yo_yo is not None:
        found.append(Moment(params.yo_yo.at, Kind.YO_YO, 0, "yo_yo_release"))
    if params.spin_motors is not None:
        found.append(Moment(params.spin_motors.at, Kind.SPIN_MOTORS, 0, "spin_motors"))
    if params.parachute is not None and params.parachute.at is not None:
        found.append(Moment(params.parachute.at, Kind.PARACHUTE, 0, "parachute"))
    return sorted(found, key=lambda moment: (moment.t_s, moment.kind))


def prescribed(params):
    """(first s, last s) between which the attitude is prescribed; (inf, -inf) where it never is."""
    if params.attitude != p.PRESCRIBED or not params.programme:
        return np.inf, -np.inf
    return params.programme[0][1].start, params.programme[-1][1].end


def check(params):
    """Refuse parameters that contradict each other: ValueError."""
    launch, ground = isinstance(params.start, settings.Launch), isinstance(params.start, settings.Ground)
    if not params.t_start_s < params.time_limit_s:
        raise ValueError(
            f"time_limit_s, {params.time_limit_s} s, is not after t_start_s, {params.t_start_s} s"
        )
    if launch and params.t_start_s > 0.0:
        raise ValueError(f"t_start_s ({params.t_start_s} s) is after lift-off")
    if launch and not params.stages:
        raise ValueError("a launch needs a stage: nothing burns")
    devices = (params.stages, params.programme, params.spin_motors, params.yo_yo, params.parachute)
    if ground and any(devices):
        raise ValueError("a vehicle that stands on the ground burns, steers and releases nothing")
    _check_stages(params, 0.0 if launch else params.t_start_s)
    _check_programme(params, 0.0 if launch else params.t_start_s)
    late = [moment for moment in _planned(params) if moment.t_s > params.time_limit_s]
    if launch and late:
        raise ValueError(f"{late[0].name} at {late[0].t_s} s is after time_limit_s, {params.time_limit_s} s")
    for name, t_s in (
        ("yo_yo", params.yo_yo and params.yo_yo.at),
        ("spin_motors", params.spin_motors and params.spin_motors.at),
        ("parachute", params.parachute and params.parachute.at),
    ):
        if t_s is not None and t_s < (0.0 if launch else params.t_start_s):
            raise ValueError(f"{name} ({t_s} s) is before the start of the flight")


def _check_stages(params, earliest):
    """Stages burn one after the other, each when those below it are gone."""
    gone, below = earliest, "the start of the flight"
    for n, burn in enumerate(burns(params)):
        stage = params.stages[n]
        if np.any(np.diff(stage.motor.t_s) <= 0.0) or stage.motor.t_s[0] != 0.0:
            raise ValueError(f"{stage.name}: the times of its thrust have to increase from 0")
        if burn.t_0 < gone:
            raise ValueError(f"{stage.name}: ignition at {burn.t_0} s is before {below} at {gone} s")
        if stage.drops_at < burn.t_1 - SAME_EVENT_S:
            raise ValueError(
                f"{stage.name}: separation at {stage.drops_at} s is before its burn-out at {burn.t_1} s"
            )
        gone, below = stage.drops_at, f"the separation of {stage.name}"
    alone = not params.stages or params.stages[-1].separation is not None
    if alone and params.payload_aerodynamics is None and not isinstance(params.start, settings.Ground):
        raise ValueError("the payload flies alone and has no aerodynamic coefficients")


def _check_programme(params, earliest):
    """Tasks follow each other and can be flown."""
    programme = params.programme
    if programme and params.attitude == p.FLOWN and params.cold_gas is None:
        raise ValueError("the programme is to be flown, and there is no cold gas")
    if params.cold_gas is not None and params.cold_gas.bandwidth * params.cold_gas.period > LOOP:
        raise ValueError(
            f"the valves work every {params.cold_gas.period} s: too slow for a bandwidth of "
            f"{params.cold_gas.bandwidth} rad/s, whose product must not exceed {LOOP}"
        )
    before, free_at = "", earliest
    for name, task in programme:
        if task.start < free_at:
            other = f"{before} ends at {free_at} s" if before else "the flight"
            raise ValueError(f"{name} starts at {task.start} s, before {other}")
        if not task.start < task.end:
            raise ValueError(f"{name} ends at {task.end} s, not after its start at {task.start} s")
        if isinstance(task, tasks.Dwell) and task.moves:
            _check_rates(name, task)
        if isinstance(task, tasks.TurnWithOrbit):
            if not isinstance(params.start, settings.Orbit):
                raise ValueError(f"{name} turns with the orbit, and the vehicle does not start in one")
            _check_fades(name, task)
        before, free_at = name, task.end


def _check_rates(name, task):
    """Rates of a dwell can fade in and out."""
    if task.ramp is None:
        raise ValueError(f"{name}: rates that are asked for need a ramp in which they fade in")
    _check_fades(name, task)
    if task.cross_rate != 0.0 and task.cross_period is None:
        raise ValueError(f"{name}: cross_rate needs a cross_period")


def _check_fades(name, task):
    """The ramp fits twice into a task."""
    if 2.0 * task.ramp > task.end - task.start:
        raise ValueError(f"{name}: ramp ({task.ramp} s) does not fit twice into the task")


_DEVICES = {Kind.YO_YO: "yo_yo", Kind.SPIN_MOTORS: "spin_motors", Kind.PARACHUTE: "parachute"}


class FlightError(UserError):
    """The vehicle cannot do what its programme asks; the message says what happened."""

    def __init__(self, words, field=()):
        """field : path in the scenario of what asks for it; (): no single key"""
        self.field = field
        super().__init__(words)


def key_of(params, moment):
    """Path in the scenario of the time of a timeline.Moment, () of None. params : FlightParams"""
    if moment is None:
        return ()
    match moment.kind:
        case Kind.BEGIN | Kind.END:
            name, _ = params.programme[moment.number]
            return "programme", name, "from" if moment.kind == Kind.BEGIN else "until"
        case Kind.IGNITION:
            return "vehicle", "stages", params.stages[moment.number - 1].name, "ignition"
        case Kind.SEPARATION:
            return "vehicle", "stages", params.stages[moment.number - 1].name, "separation", "at"
    return "vehicle", _DEVICES[moment.kind], "at"
