"""What an instrument is: one object with its two halves, and what the rest of the program asks of it.

The world's half, `measure`, sees the truth of a flight; the half on board, `aid`, makes of the settings what
the filter knows of the instrument, and sees nothing but where the filter believes to be. Section of the
scenario, random numbers, log, export, plots and columns of external data follow from the object.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.fields import Column as Column  # for descriptions of instruments
from shefex_nav.onboard.navigation.settings import Release as Release  # of those that are believed after all
from shefex_nav.settings import Settings, quantity, switch
from shefex_nav.world.fault_settings import Fault as Fault  # base of the settings of a fault of its own


class Truth(NamedTuple):
    """What an instrument in the world may look at."""

    trajectory: Any  # records.Trajectory
    earth: Any  # frames.EarthRotation
    year: float  # decimal, of the mission
    sun_i: np.ndarray  # (3,) unit vector to where the Sun is seen, with the aberration of the Earth
    air: np.ndarray  # (n, 4) air over the height as `environment.msis.table`; n = 0: US76


class Known(NamedTuple):
    """What the computer on board knows of the mission beforehand."""

    year: float  # decimal
    sun_i: np.ndarray  # (3,) unit vector to where the Sun is seen, with the aberration of the Earth


class Measured(NamedTuple):
    """Readings of a flight, and what is wrong with them."""

    readings: list  # records of the instrument, in order of time
    errors: Any = None  # what was drawn for the run
    sensed: list = []  # noqa: RUF012 a default is not changed; the same before range and quanta; empty: none


class Drawn(NamedTuple):
    """An error that the world draws for a run; each element by itself, normally distributed."""

    name: str
    sigma: np.ndarray  # (size,)
    tau_s: float = np.inf  # correlation time, stationary first-order Gauss-Markov; inf: constant in a run
    length: float = np.inf  # m, likewise, along the path over the Earth


class Place(NamedTuple):
    """Where a reading is taken: a motion near the true one at a sample of the trajectory."""

    k: int  # sample, for what the motion does not say
    t_s: float
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s
    C_ib: np.ndarray  # (3, 3)


class Equation(NamedTuple):
    """What a reading is in the world, for the lowest bound of the errors of navigation."""

    errors: tuple[Drawn, ...]
    read: Callable  # Place, {name of an error: (size,)} -> (m,) as sensed, without white noise
    R: np.ndarray  # (m, m) of the white noise, and of the counts
    holds: Callable | None = None  # reading -> whether it measures anything; None: it always does


class FaultKind(NamedTuple):
    """Something that may go wrong with the instrument, besides what may with any (`instruments.faults`)."""

    settings: type[Fault]  # with a field `fault: Literal["its_name"] = choice()`
    # fault, reading, the last one before the fault that holds anything or None -> reading; None: none
    change: Callable
    sensed: bool = False  # it acts before range and quanta


class DataColumn(NamedTuple):
    """A column of external data, or three, that hold a field of the record."""

    key: str  # in the section `data`; its unit is <key>_unit
    field: str  # of the record
    unit: str  # that the file has unless it says otherwise
    si: str  # in which the record holds it
    help: str
    vector: bool = False  # three columns along the axes of the file, turned to body axes
    convert: Callable | None = None  # of the SI values (N,), what the record holds
    is_valid: Callable | None = None  # of the values (N,) -> (N,) bool
    wanted: str = ""  # words about values that are not valid: 'a static pressure is greater than zero'


class Plot(NamedTuple):
    """A curve, or three along x, y and z, of the readings, for the figures and the viewer."""

    name: str
    title: str
    unit: str
    values: Callable  # record of arrays over N -> (N,) or (N, 3), NaN where there is nothing


class StateBlock(NamedTuple):
    """Errors of an instrument that the filter may estimate."""

    name: str
    size: int
    unit: str  # for people
    why: str  # the program switches it on
    needed: bool = True  # a filter that uses the instrument has it


class Sampled(Settings):
    """Settings that every instrument has; those of one extend them."""

    rate: float = quantity(
        "Hz", "10 Hz", "readings a second; must divide 100 Hz", positive=True, at_most="100 Hz"
    )
    latency: float = quantity(
        "s", "10 ms", "from the instant measured to the reading on board", "0 s", non_negative=True,
        at_most="1 s",
    )  # fmt: skip


class Instrument(NamedTuple):
    """One instrument."""

    name: str  # of its section, topic and stream of random numbers, and in the filter's gates
    settings: type[Sampled]
    record: type  # NamedTuple of a reading: t_valid_s, t_available_s, and fields with a Column
    measure: Callable[[Any, Truth, np.random.Generator], Measured]  # of settings, Truth, random numbers
    aid: Callable | None = None  # settings, settings of `use`, Known -> aid.Aid; None: it is logged alone
    use: type[Settings] | None = None  # section navigation.<name>, with `used`
    states: tuple[StateBlock, ...] = ()
    check: Callable | None = None  # settings, use, decimal year -> iterator of (path in the scenario, words)
    equation: Callable | None = None  # settings, Truth -> Equation; None: there is no bound with it
    limited: Callable | None = None  # settings, reading as sensed -> as sent: whole quanta, within the range
    faults: tuple[FaultKind, ...] = ()  # of its own
    told: tuple[str, ...] = ()  # keys that `navigation.told` may say otherwise
    stream: int | None = None  # key of its random numbers; None: by its name
    data: tuple[DataColumn, ...] = ()  # columns of external data
    at_limit: Callable | None = None  # settings, values of the data -> (N,) bool
    plots: tuple[Plot, ...] = ()
    figure: str | None = None  # 'module.function' of report.figures in the place of one made of the plots
    caption: str = ""  # of the figure
    errors_last: bool = False  # one reading is judged with the variance of errors that it shares with others
    plugin: Any = None  # plugins.Plugin that brought it; None: it comes with the program


class Use(Settings):
    """Whether the filter uses the instrument."""

    used: bool = switch("false: the filter does without it", default=True)


def samples(rate, trajectory):
    """Samples of a trajectory at which readings are taken, `rate` a second: (n,) int."""
    every = round(IMU_HZ / rate)
    return np.arange(every, len(trajectory.t_s), every)


def counted(values, quantum):
    """Values in whole quanta; 0: there are none."""
    return np.round(values / quantum) * quantum if quantum else values


def sent(limited, settings, sensed, errors):
    """Measured of readings as they are sensed. limited : as `Instrument.limited`"""
    return Measured([limited(settings, reading) for reading in sensed], errors, sensed)


def readings(record, settings, t_s, *columns):
    """Records of readings valid at t_s (n,), each field a column over n; latency and times are added."""
    lists = [column.tolist() if column.ndim == 1 else column for column in columns]
    return [
        record(t_valid_s, t_valid_s + settings.latency, *values)
        for t_valid_s, *values in zip(t_s.tolist(), *lists, strict=True)
    ]
