"""Section of a scenario about what goes wrong with the sensors, and when. Without it nothing does.

Each fault says what it is (`fault`), `from` when and `until` when; times count from lift-off. The sections of
the sensors describe healthy ones.
"""

from functools import partial
from typing import ClassVar

from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.partial import of_each
from shefex_nav.world import fault_settings


class Faults(section(fault_settings.Faults)):
    """What goes wrong; `aboard.complete` adds a list for each instrument."""

    NAME: ClassVar[str] = "Faults"


def contradictions(scenario):
    """(path of the field, text for people) of faults that make no sense."""
    limit = scenario.mission.time_limit
    for device in type(scenario.faults).model_fields:
        several = getattr(scenario.faults, device, ())  # one that is no list is complained about already
        yield from of_each(several, partial(_of_fault, device, limit))


def _of_fault(device, limit, k, fault):
    """What is wrong with fault k of a device. limit : of the mission, s"""
    path = ("faults", device, k)
    if fault.start > limit:
        yield (*path, "from"), f"{fault.start:g} s is after mission.time_limit, {limit:g} s"
    if fault.end <= fault.start:
        yield (*path, "until"), f"{fault.end:g} s must be later than from, {fault.start:g} s"
    if fault.fault == "wrong_fixes" and fault.largest < fault.smallest:
        yield (*path, "smallest"), "must not exceed largest"
