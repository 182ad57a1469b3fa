"""Faults of instruments: kinds that any instrument may have, whatever its readings are, and what they do.

A fault says by how much a field of the record is wrong under the name of the field, `{fault: bias, pressure:
500 Pa}`, in its unit; an array has a value for each element. Bias, drift and scale factor change what the
sensor senses, before range and quanta where the instrument says what these are (`Instrument.limited`).
Silence, repeated and late readings are of what it sends. A fault draws no random numbers.
"""

from functools import cache
from typing import Literal, get_args, get_type_hints

import numpy as np

from shefex_nav.instruments.instrument import Column, Fault, FaultKind
from shefex_nav.settings import choice, declared, quantity
from shefex_nav.world.fault_settings import in_turn, with_fault

RESERVED = frozenset(("fault", "from", "until", "start", "end", "words", "name"))  # keys of every fault


class StuckReading(Fault):
    """The values of the last reading before it are repeated; times go on."""

    fault: Literal["stuck"] = choice()


class SilentInstrument(Fault):
    """There are no readings."""

    fault: Literal["silent"] = choice()


class LateReading(Fault):
    """Readings are available later than usual."""

    fault: Literal["late"] = choice()
    by: float = quantity("s", "0.5 s", "on top of the latency", positive=True, at_most="60 s")

    @property
    def words(self):
        """Of the event."""
        return f"{self.by:g} s"


class WrongFields(Fault):
    """Base of faults that have a value for fields of a record; classes are made for each instrument."""

    @property
    def given(self):
        """{field: value as an array or a number} of the fields that are wrong."""
        values = {name: getattr(self, name) for name in fields_of(type(self))}
        return {name: _number(value) for name, value in values.items() if value is not None}

    @property
    def words(self):
        """Of the event."""
        units = {name: setting.unit for name, (_, setting) in declared(type(self)).items()}
        each = (
            f"{name} {', '.join(f'{one:g}' for one in np.atleast_1d(value))} {units[name]}".rstrip()
            for name, value in self.given.items()
        )
        return "; ".join(each)


def _number(value):
    return np.array(value) if isinstance(value, tuple) else value


def stuck(fault, reading, last):
    """As `FaultKind.change`."""
    return reading if last is None else last._replace(**_times(reading))


def silent(fault, reading, last):
    """As `FaultKind.change`."""
    return None


def late(fault, reading, last):
    """As `FaultKind.change`."""
    return reading._replace(t_available_s=reading.t_available_s + fault.by)


def bias(fault, reading, last):
    """As `FaultKind.change`."""
    return reading._replace(**{name: getattr(reading, name) + value for name, value in fault.given.items()})


def drift(fault, reading, last):
    """As `FaultKind.change`."""
    since_s = reading.t_valid_s - fault.start
    more = {name: getattr(reading, name) + since_s * value for name, value in fault.given.items()}
    return reading._replace(**more)


def scale(fault, reading, last):
    """As `FaultKind.change`."""
    more = {name: getattr(reading, name) * (1.0 + value) for name, value in fault.given.items()}
    return reading._replace(**more)


def _times(reading):
    return {"t_valid_s": reading.t_valid_s, "t_available_s": reading.t_available_s}


SENT = (
    FaultKind(StuckReading, stuck),
    FaultKind(SilentInstrument, silent),
    FaultKind(LateReading, late),
)
FELT = {  # name -> docstring of its settings, what a value of it is, what it does
    "bias": ("A constant is added to what is sensed.", "that is added", bias),
    "drift": ("What is added to what is sensed grows with time, from zero.", "that is added", drift),
    "scale": ("What is sensed is larger by a part of itself.", "by which it is larger", scale),
}
GENERAL = ("stuck", "silent", "late", *FELT)


@cache
def kinds(one):
    """Kinds of faults that an Instrument may have: tuple of FaultKind."""
    fields = _fields(one)
    sensed = [
        FaultKind(_settings(one.name, fields, name, *words), change, sensed=True)
        for name, (*words, change) in FELT.items()
    ]
    return (*SENT, *(sensed if fields else ()), *one.faults)


def name_of(settings):
    """Name of a kind of fault, from the class of its settings."""
    return get_args(declared(settings)["fault"][0])[0]


def fields_of(settings):
    """Fields of the record that a kind of fault may have a value for: tuple, empty of other kinds."""
    is_one = issubclass(settings, WrongFields)
    return tuple(key for key in declared(settings) if key not in RESERVED) if is_one else ()


def _fields(one):
    """{field of the record: Column, unit as people write it} of those that hold numbers in an SI unit."""
    written = {column.field: column.unit for column in one.data if column.convert is None}
    found = {}
    for name, hint in get_type_hints(one.record, include_extras=True).items():
        column = next((each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Column)), None)
        if column is None or hint.__origin__ not in (float, np.ndarray) or len(column.shape) > 1:
            continue
        if name not in RESERVED and _is_si(column.unit):
            found[name] = column, written.get(name, column.unit)
    return found


def _is_si(unit):
    try:
        quantity(unit, "", "")
    except ValueError:
        return False
    return True


def _settings(instrument, fields, kind, text, words):
    """Class of settings of a kind of fault that has a value for each field. fields : of `_fields`"""
    annotations, values = {"fault": Literal[kind]}, {"fault": choice()}
    alone = {} if len(fields) == 1 else {"default": None}
    for name, (column, written) in fields.items():
        one = tuple[(float,) * column.shape[0]] if column.shape else float
        annotations[name] = one | None if alone else one
        values[name] = quantity(*_units(kind, column.unit, written), f"{words}; {column.help}", **alone)
    name = "".join(part.capitalize() for part in (*instrument.split("_"), kind))
    about = {"__doc__": text, "__module__": __name__, "__qualname__": name, "__annotations__": annotations}
    return type(name, (WrongFields,), {**about, **values})


def _units(kind, unit, written):
    """Unit of a value of a kind of fault, and an example. unit, written : of the field, SI and as written"""
    if kind == "scale" or (kind == "bias" and not unit):
        return "", "1 %"
    if kind == "bias":
        return unit, f"1 {written}"
    return (f"{unit}/s", f"1 {written}/s") if unit else ("1/s", "0.01 1/s")


def __getattr__(name):
    """A class of settings by its name, as pickle asks for it in another process."""
    from shefex_nav.instruments import BUILT_IN

    for one in BUILT_IN.values() if not name.startswith("_") else ():
        for kind in kinds(one):
            if kind.settings.__name__ == name:
                return kind.settings
    raise AttributeError(name)


def applied(one, settings, faults, measured):
    """What an instrument says when it is faulty: Measured.

    Faults of what it senses come first, in their order, then range and quanta, then those of what it sends,
    as they begin.

    Parameters
    ----------
    one : Instrument
    settings : of the instrument
    faults : tuple of settings of its kinds
    measured : Measured of the healthy one
    """
    if not faults:
        return measured
    of = {kind.settings: kind for kind in kinds(one)}
    sensed = list(measured.sensed or measured.readings)
    before, readings = list(sensed), list(measured.readings)
    for fault in faults:
        if of[type(fault)].sensed:
            sensed = _changed(of[type(fault)].change, fault, sensed)
    for k, (was, now) in enumerate(zip(before, sensed, strict=True)):
        if now is not was:
            readings[k] = now if one.limited is None else one.limited(settings, now)
    for fault in in_turn(faults):
        if not of[type(fault)].sensed:
            readings = _changed(of[type(fault)].change, fault, readings)
    return measured._replace(readings=readings)


def _changed(change, fault, readings):
    """Readings with one fault: list.

    What it may repeat is from before it by its stamp: another fault may have changed that, and the order.
    """

    def may_be_repeated(reading):
        return reading.t_valid_s < fault.start and _measures(reading)

    found = with_fault(fault, readings, change, may_be_repeated)
    return [reading for reading in found if reading is not None]


def _measures(reading):
    """Whether a reading holds anything beside its times: what has no echo, no light is NaN."""
    values = [value for value in reading[2:] if isinstance(value, float | np.ndarray)]
    return not values or any(np.isfinite(value).any() for value in values)
