"""Arguments and options that several commands have, and how a time among them is read."""

from pathlib import Path
from typing import Annotated

import typer


def option(kind, help, *names, **more):
    """Type of an option of a command. kind : of its value;  names, more : of typer.Option"""
    return Annotated[kind, typer.Option(*names, help=help, **more)]


def argument(kind, help, **more):
    """The same of an argument."""
    return Annotated[kind, typer.Argument(help=help, **more)]


def bad(option, words):
    """The refusal of an option, '--out', or of an argument, 'LOG', in words that begin with its value."""
    return typer.BadParameter(words, param_hint=option)


Scenario = argument(str, "Scenario: a YAML file, or the name of a shipped one, e.g. shefex2_andoya.")
DispersedScenario = argument(
    str, "Scenario: a YAML file, or the name of a shipped one, e.g. shefex2_dispersed."
)
Log = argument(Path, "Log of a run (MCAP), of a killed run too.")


def seed_of_log(given):
    """A seed of a flight, whose log says it; BadParameter of one that no reader of logs takes."""
    if given is None or given.bit_length() < 64:
        return given  # so that most commands need not load what follows
    from shefex_nav.log.checked import MOST_DIGITS

    if given >= 10**MOST_DIGITS:
        raise typer.BadParameter(f"expected a whole number of {MOST_DIGITS} digits at most")
    return given


Seed = option(int, "Seed of all random draws.", min=0, callback=seed_of_log)
RootSeed = option(int, "Seed from which those of all runs follow.", min=0)
MOST_SEEDS = 100_000  # of a study that keeps all of its flights in memory
FirstSeed = option(int, "Seed of the first; the others follow.", min=0)


def _each_once(given):
    """The values of --set, of which no two are of one key: the last would be taken without a word."""
    seen = {}
    for text in given or ():
        key = text.partition("=")[0].strip()
        if key in seen:
            raise typer.BadParameter(f"{key} is given twice: '{seen[key]}' and '{text}'; leave one out")
        seen[key] = text
    return given


def overrides(help):
    """Type of the option --set, with its help."""
    return option(list[str] | None, help, "--set", metavar="KEY=VALUE", callback=_each_once)


Overrides = overrides("Override one value, e.g. --set star_tracker.rate='5 Hz'.")
StudyOverrides = overrides("Override one value.")
Until = option(str | None, "Stop at this mission time, e.g. 60s. The log ends there.", metavar="TIME")
Workers = option(int | None, "Processes on this machine. Default: one for each core.", min=1, max=1024)
Json = option(bool, "Print one JSON object on stdout.", "--json")
OverwriteFigure = option(bool, "Overwrite the file given with --figure.", "--force")
OverwriteOut = option(bool, "Overwrite the file given with --out.", "--force")


def number(text):
    """float of a text; ValueError also of 1_0 and of digits of other alphabets, which Python reads."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text!r} is no number")
    return float(text)


def mission_time(text, option, example):
    """Seconds from a time with its unit that an option gives, such as 240s or '4 min'.

    example : a time as one may write it, for the message about one that cannot be read
    """
    return quantity(text, "s", option, example)


def quantity(text, unit, option, example, *, positive=False):
    """A value in SI units from one with its unit that an option gives.

    unit : SI;  example : as one may write it, for the message about one that cannot be read
    """
    from pydantic_core import PydanticCustomError

    from shefex_nav.scenario.quantity import QuantitySpec

    try:
        return QuantitySpec(unit, example, positive=positive).read(text)
    except PydanticCustomError as error:
        raise bad(option, error.message()) from None
