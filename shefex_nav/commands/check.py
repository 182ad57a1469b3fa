"""`shefex-nav check`: is a scenario file good, and does it fit its flight?"""

import re
from pathlib import Path
from typing import NamedTuple

from shefex_nav.commands.flights import about, warn
from shefex_nav.commands.options import Json, Overrides, Scenario, option
from shefex_nav.commands.printing import print_json, say, say_result, stdout
from shefex_nav.errors import UserError

PLACED = re.compile(
    r"(?P<file>.+?):(?P<line>\d+):(?P<column>\d+): (?:(?P<field>[\w.-]+): )?(?P<text>.*)", re.DOTALL
)
OVERRIDDEN = re.compile(r"--set (?P<field>[^\s=]+)(?:=.*?)?: (?P<text>.*)", re.DOTALL)


class Checked(NamedTuple):
    """What is to be said of a scenario."""

    loaded: object  # Scenario, its states settled
    warnings: list  # of report.programme.Warned
    told: list  # lines about what the computer is told otherwise than it is
    effects: object  # of states that were chosen, for their table
    differences: list  # lines
    lens: list  # lines about its distortion and what is told of it
    notes: list  # lines about what the star camera sees


def check(
    scenario: Scenario,
    overrides: Overrides = None,
    against: option(
        Path | None, "List each value that differs from a scenario, a log or the folder of a campaign."
    ) = None,
    json: Json = False,
):
    """Check a scenario file and show all its errors at once, with line and column.

    The vehicle is flown without its sensors; of an orbit the first 900 s.
    Warnings name times that do not fit the flight, and IMU errors that last but are noise to the filter.
    """
    try:
        found = checked(scenario, overrides or (), against)
    except UserError as error:
        if json:
            lines = getattr(error, "messages", (str(error),))
            print_json(_object(scenario, errors=[_of_line(one) for one in lines]))
        raise
    warn(found.loaded, found.warnings)
    if json:
        print_json(_of_good(scenario, found))
    else:
        _print(scenario, found)


def checked(scenario, overrides, against):
    """Checked of the scenario with this name."""
    from shefex_nav.scenario import aboard, lens, load, software, surroundings, told
    from shefex_nav.scenario.document import dotted

    loaded, differences = load.load(scenario, overrides), []
    for section, error in software.changed(loaded):  # of what names its content, which `load` leaves alone
        raise type(error)(loaded.line_about((section, software.SOFTWARE), str(error)))
    if against is not None:
        from shefex_nav.campaign import head

        differences = head.differing(loaded, against)
    from shefex_nav import prepare
    from shefex_nav.report import programme, star_light

    with about(scenario, loaded):
        aboard.check_own_blocks(loaded)
        surroundings.check(loaded)
        loaded, effects = prepare.settled_with_effects(loaded)
        found = programme.foreseen(loaded)
    seen = [lens.displaces(loaded.star_camera)]
    if left := lens.words(loaded.star_camera, told.as_told(loaded).star_camera):
        seen.append(f"{dotted(left[0])}: {left[1]}")
    seen = [line for line in seen if line is not None]
    told_lines, notes = list(told.lines(loaded)), star_light.notes(loaded)
    return Checked(loaded, list(found), told_lines, effects, list(differences), seen, notes)


def _print(scenario, found):
    """For people; the warnings are printed already."""
    from shefex_nav.scenario import starlight

    n = len(found.warnings)
    count = f", with {n} warning{'s' if n > 1 else ''}" if n else ""
    for line in found.told:
        say(f"told otherwise: {line}")
    for line in (*found.lens, *found.notes):
        say(line)
    if light := starlight.of_section(found.loaded.star_camera):
        say(f"star_camera.optics.zero_magnitude_flux: {light.words()}")
    until, whole_s = _flown_until(found.loaded), found.loaded.mission.time_limit
    part = "" if until is None else f"; flown until T{until:+g} s of {whole_s:g} s"
    say_result(f"{scenario}: good{count}{part}")
    if found.effects:
        from shefex_nav.report import lasting

        stdout(130).print(lasting.states_table(found.effects))
    for line in found.differences:
        say_result(line)


def _flown_until(scenario):
    """Mission time until which the vehicle of a Scenario was flown, s; None: to its end, or it never is."""
    from shefex_nav import prepare

    if scenario.orbit is None:
        return None
    until_s = prepare.begin_until(scenario)
    return until_s if until_s < scenario.mission.time_limit else None


def _of_good(scenario, found):
    """JSON object of a scenario without errors."""
    warnings = [
        {**_of_line(found.loaded.line_about(one.field, one.text)), "field": ".".join(map(str, one.field))}
        for one in found.warnings
    ]
    told = [_of_line(one) for one in found.told]
    until_s = _flown_until(found.loaded)
    more = {"lens": found.lens, "notes": found.notes, "flown_until_s": until_s}
    return _object(scenario, warnings, told, found.differences, more=more)


def _object(scenario, warnings=(), told_otherwise=(), differences=(), *, errors=(), more=None):
    """JSON object. more : of a scenario without errors, lens, notes, flown_until_s"""
    return {
        "scenario": str(scenario),
        "good": not errors,
        "errors": list(errors),
        "warnings": list(warnings),
        "told_otherwise": list(told_otherwise),
        "differences": list(differences),
        **({"lens": [], "notes": [], "flown_until_s": None} if more is None else more),
    }


def _of_line(line):
    """File, line, column, field and text of a line for people; null where it names none."""
    found = PLACED.fullmatch(line) or OVERRIDDEN.fullmatch(line)
    said = {"file": None, "line": None, "column": None, "field": None, "text": line}
    said |= found.groupdict() if found else {}
    return said | {name: said[name] and int(said[name]) for name in ("line", "column")}
