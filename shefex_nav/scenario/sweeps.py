"""Settings and the values to try of them, KEY=A,B,C, and all their combinations."""

from contextlib import contextmanager
from itertools import product
from typing import NamedTuple

from shefex_nav.errors import UserError
from shefex_nav.scenario import instruments
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.overriding import Option
from shefex_nav.scenario.sensors import USE


class SweepError(UserError):
    """Values that cannot be tried; the message says why."""


class Axis(NamedTuple):
    """A setting and its values, as `--set` takes them."""

    key: str
    values: tuple


def axis(text):
    """Axis of KEY=A,B,C; SweepError. `imu=stim300,adis16505_1` means instruments: imu.use."""
    key, equals, given = text.partition("=")
    values = tuple(value.strip() for value in parts(given))
    if not equals or not key.strip() or not all(values):
        raise SweepError(f"--sweep {text}: expected KEY=A,B,C, such as imu=stim300,adis16505_1")
    twice = [value for value in values if values.count(value) > 1]
    if twice or len(values) < 2:
        what = f"{twice[0]} stands there twice" if twice else "there is one value"
        raise SweepError(f"--sweep {text}: {what}; expected two or more that differ")
    return Axis(key_of(key.strip()), values)


def key_of(text):
    """The whole key of one that is given: imu.use of `imu`, whose values are instruments."""
    return f"{text}.{USE}" if tuple(text.split(".")) in instruments.SECTIONS else text


def parts(text):
    """A text at its commas, but for those in brackets: list."""
    found, depth = [""], 0
    for letter in text:
        depth += (letter in "[{(") - (letter in ")}]")
        if letter == "," and depth == 0:
            found.append("")
        else:
            found[-1] += letter
    return found


def combinations(axes, most):
    """list of {key: value}, those of the last Axis one after the other; SweepError of more than `most`."""
    keys = [one.key for one in axes]
    if twice := [key for key in keys if keys.count(key) > 1]:
        raise SweepError(f"--sweep {twice[0]}: is given twice; give all its values at once")
    found = [dict(zip(keys, values, strict=True)) for values in product(*(one.values for one in axes))]
    if len(found) > most:
        raise SweepError(f"--sweep: {len(found)} combinations; expected {most} at most")
    return found


def overrides(settings):
    """Tuple of what `load` takes for a combination, {key: value}; complaints about a value name --sweep."""
    return tuple(Option(f"{key}={value}", f"--sweep {key}={value}") for key, value in settings.items())


def named(settings):
    """A combination, {key: value}, in words."""
    return f"--sweep {', '.join(f'{key}={value}' for key, value in settings.items())}"


@contextmanager
def about(settings):
    """What is wrong with a combination, {key: value}, is told with it."""
    words = f" (with {named(settings)})"
    try:
        yield
    except ScenarioError as error:
        begun = f"{named(settings)}: "  # of a line that names it already
        raise ScenarioError(
            one if one.startswith(begun) else f"{one}{words}" for one in error.messages
        ) from None
    except UserError as error:
        raise SweepError(f"{error}{words}") from None
