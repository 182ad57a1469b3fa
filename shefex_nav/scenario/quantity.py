"""Quantities as engineers write them: text with a unit in a scenario file -> float in SI and radians.

In comes `25 mm`, `2 deg/s`, `0.1 deg/sqrt(h)`, `1 mgee`, `7 ppm`; out goes a float in the unit that the field
names. A number without a unit, a wrong dimension, NaN and infinity are refused with what would be right.
Units that are not in `unit_factors`, and those that a message is about, are read with `astropy.units`.
`gee`, `mgee` and `ugee` are standard gravity, 9.80665 m/s^2 (ISO 80000-3), because `g` is the gram.
"""

import math
import re
import warnings
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Annotated, Any

from pydantic_core import PydanticCustomError, core_schema

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.numerals import NUMBER
from shefex_nav.scenario import decimal_comma
from shefex_nav.scenario.unit_factors import FACTORS, OF_TURNS

LARGEST = 1e15  # [E] of a value in SI of another unit than these; what is computed with it is a number yet
LARGEST_OF = {  # [E] nothing in a mission is as large
    "rad": 1e4, "rad/s": 1e4, "rad/sqrt(s)": 1e2, "rad/s2": 1e6, "rad s/m": 10.0, "rad s3/m2": 1.0,
    "m": 1e12, "m/s": 1e5, "m/s2": 1e6, "m/s(3/2)": 1e3, "s2/m": 1.0, "s": 1e13,
    "K": 1e5, "T": 1e2, "mag": 1e2, "dB": 1e3, "": 1e9,
}  # fmt: skip
SMALLEST = 1e-40  # [E] of a value but zero, for the same reason
MOST_COUNT = 1_000_000_000  # of a whole number: kernels count in 32 or 64 bits

_NUMBER = re.compile(rf"\s*({NUMBER.pattern}|[+-]?\.?(?:inf|nan)\b)\s*(.*?)\s*", re.I)
MOST_WRITTEN = 9  # [E] digits of a number that somebody has typed
_LOOSE_NUMBER = re.compile(r"(?<![\w^*/(+-])[\d.]")  # a second number that astropy would multiply in
_COMPASS = re.compile(r"(?:deg|°)?\s*([NSEW])")  # of a latitude or longitude
_PLAIN_UNIT = re.compile(r"(?!rad)[A-Za-z]+(/s2?)?")
_DIMENSIONS = {  # astropy's names that an engineer would not use
    "angular frequency/angular speed/angular velocity": "angular rate",
    "speed/velocity": "velocity",
    "energy/torque/work": "torque or energy",
    "energy density/pressure/stress": "pressure",
}
_WORD = re.compile(r"[^\W\d]+")
_FUNCTIONS = ("sqrt", "mag", "dB", "dex")  # of units, as astropy reads them
_LEVELS = {"dB": "a level in dB", "mag": "a magnitude"}  # astropy would convert one into the other


@cache
def _own_units():
    """Units that astropy does not read by itself: gee, ppm, turns, feet and pounds."""
    import astropy.units as u

    names = {}
    prefixes = [(["m"], ["milli"], 1e-3), (["u", "µ"], ["micro"], 1e-6)]
    u.def_unit(["gee"], STANDARD_GRAVITY * u.m / u.s**2, prefixes=prefixes, namespace=names)
    more = {
        "ppm": 1e-6 * u.dimensionless_unscaled, "rev": 2 * math.pi * u.rad,
        "rpm": 2 * math.pi * u.rad / u.min, "sec": u.s, "px": u.pix, "e-": u.electron,
        "ft": 0.3048 * u.m, "inch": 0.0254 * u.m,
        "mi": 1609.344 * u.m, "kn": 1852.0 / 3600.0 * u.m / u.s, "lb": 0.45359237 * u.kg,
        "lbf": 0.45359237 * STANDARD_GRAVITY * u.N,
        "psi": 0.45359237 * STANDARD_GRAVITY / 0.0254**2 * u.Pa,
    }  # fmt: skip
    for name, unit in more.items():
        u.def_unit([name], unit, namespace=names)
    return list(names.values())


@cache
def _unit(text):
    """The astropy unit written as `text`; ValueError if there is none."""
    import astropy.units as u

    with u.add_enabled_units(_own_units()), warnings.catch_warnings():
        warnings.simplefilter("ignore", u.UnitsWarning)  # about several slashes: deg/h/gee is common use
        unit = u.Unit(text)
    if not isinstance(unit, u.UnitBase | u.function.FunctionUnitBase):  # 'm, s' is two units
        raise ValueError(f"{text!r} is more than one unit")
    return unit


@cache
def _known_words():
    """Words that are units: {first letter, small: list of them}."""
    import astropy.units as u

    found = {}
    with u.add_enabled_units(_own_units()):
        enabled = u.get_current_unit_registry()
        for word in (*enabled.registry, *enabled.aliases, *_FUNCTIONS):
            found.setdefault(word[:1].lower(), []).append(word)
    return found


def _unknown_word(text):
    """`; did you mean Hz?`, or nothing, about the first word that is no unit; None if all are.

    Compared are units of the same first letter: astropy takes milliseconds a word to compare all of them.
    """
    from astropy.utils.misc import did_you_mean

    for word in _WORD.findall(text):
        alike = _known_words().get(word[:1].lower(), [])
        if word not in alike and f"{word}-" not in alike:  # e-
            return _similar_unit(did_you_mean(word, alike))
    return None


@lru_cache(1024)
def _unit_or_hint(text):
    """The astropy unit written as `text`, or None; and `; did you mean Hz?`, or nothing."""
    if (hint := _unknown_word(text)) is not None:
        return None, hint
    try:
        return _unit(text), ""
    except (ValueError, TypeError) as error:
        return None, _similar_unit(error)


def _dimension(unit):
    """What a unit measures, in words."""
    name = str(unit.physical_type)
    if str(unit) in _LEVELS:
        return _LEVELS[str(unit)]
    if name == "unknown":
        return f"a quantity in {unit}"
    name = _DIMENSIONS.get(name, name.split("/")[0])
    if name == "dimensionless":
        return "a plain ratio"
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def check_size(number, value, unit="", power=1):
    """A refusal of what is larger than anything in a mission, or so small that dividing by it makes it so.

    power : 2 of a product of two numbers, as in a covariance
    """
    largest, smallest = LARGEST_OF.get(unit, LARGEST) ** power, SMALLEST**power
    name = f" {unit}" if unit else ""
    if abs(number) > largest:
        raise refuse(f"must be at most {largest:g}{name} in size, got {quoted(value)}")
    if 0.0 < abs(number) < smallest:
        raise refuse(f"must be 0 or more than {smallest:g}{name} in size, got {quoted(value)}")


def refuse(message):
    """The error with which a field refuses its value."""
    return PydanticCustomError("scenario", message)


def quoted(value):
    """A value as the user wrote it, cut off if it is very long."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _similar_unit(error):
    """`; did you mean Hz?` out of astropy's complaint, or nothing."""
    found = re.search(r"Did you mean ([^?]*)\?", str(error))
    return f"; did you mean {found[1]}?" if found else ""


class Reader:
    """How a field reads what is written: by its method `read`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any):
        return core_schema.no_info_plain_validator_function(self.read)


class _Bounded(Reader):
    """Of a number, which may have bounds: positive, non_negative, at_least, at_most."""

    def _broken_limit(self, si):
        """Words about the bound that a value in `self.unit` does not keep; empty if it keeps all."""
        if self.positive and not si > 0.0:
            return "be greater than zero"
        if self.non_negative and si < 0.0:
            return "not be negative"
        if self.at_least is not None and si < self.convert(self.at_least):
            return f"be at least {self.at_least}"
        if self.at_most is not None and si > self.convert(self.at_most):
            return f"be at most {self.at_most}"
        return ""

    def _check_limits(self, si, value):
        """Refuse a value, which is si, that does not keep a bound."""
        if limit := self._broken_limit(si):
            raise refuse(f"must {limit}, got {quoted(value)}")


@dataclass(frozen=True)
class QuantitySpec(_Bounded):
    """How one field reads its text; the bounds are inclusive unless `positive`."""

    unit: str  # SI unit of the float that comes out, as astropy writes it
    example: str
    description: str = ""
    positive: bool = False
    non_negative: bool = False
    at_least: str | None = None
    at_most: str | None = None
    turns: bool = False  # also take Hz for turns per second
    words: tuple[tuple[str, float], ...] = ()  # words allowed in place of a quantity, with their values

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any):
        texts = [self.description] if self.description else []
        texts.append(f"quantity with unit, for example {self.example}")
        texts += [f"or '{word}'" for word, _ in self.words]
        examples = [self.example, *(word for word, _ in self.words)]
        return {"type": "string", "description": "; ".join(texts), "examples": examples}

    def read(self, value):
        """Float in `self.unit` out of the text `value`."""
        for word, meaning in self.words:
            if value == word:
                return meaning
        si = self.convert(value)
        self._check_limits(si, value)
        check_size(si, value, self.unit)
        return si

    def write(self, si):
        """Text of a value in `self.unit`, in the unit in which the example is: '25 mm' of 0.025."""
        word = next((word for word, meaning in self.words if si == meaning), None)
        if word is not None:
            return word
        unit = split(self.example)[1]
        if not unit:
            return f"{si:.6g}"
        taken = self._measured_in(_unit(unit))
        return f"{float(_unit(self.unit).to(taken, si)):.6g} {unit}"

    def _with_units(self, number):
        """The user's own number with the units that may be meant: list of texts that the field takes.

        number : text;  the unit of the example comes first, then the one in SI, where people write it. A
        share of at most one is meant as that, not as so many per cent; a number of more digits than people
        write is a computer's, in SI
        """
        percent = 100.0 * float(number)
        if split(self.example)[1] == "%" and 0.0 < percent <= 100.0 and self._takes(percent, "%"):
            return [f"{percent:.6g} %"]
        if sum(letter.isdigit() for letter in number.partition("e")[0].lstrip("-+0.")) > MOST_WRITTEN:
            return [f"{number} {self.unit}"]
        units = [split(self.example)[1]]
        if _PLAIN_UNIT.fullmatch(self.unit) and self.unit not in units:
            units.append(self.unit)
        taken = [unit for unit in units if self._takes(float(number), unit)]
        return [f"{number} {unit}" for unit in taken] or [self.example]

    def _takes(self, number, unit_text):
        """Whether a number in a unit is of the right dimension and within the bounds."""
        unit = self._measured_in(_unit(unit_text)) if unit_text else None
        return unit is not None and not self._broken_limit(float(unit.to(_unit(self.unit), number)))

    def convert(self, value):
        """Float in `self.unit`, whatever the bounds of the field are."""
        expected = f"expected a quantity such as '{self.example}'" + "".join(
            f" or '{word}'" for word, _ in self.words
        )
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise refuse(f"{expected}, got {describe(value)}")
        found = _NUMBER.fullmatch(str(value))
        if found is None:
            raise refuse(f"cannot read {quoted(value)}: {expected}{decimal_comma.in_text(str(value))}")
        number, unit_text = float(re.sub(r"\.(?=[in])", "", found[1].lower())), found[2]
        if not math.isfinite(number):
            raise refuse(f"must be a finite number, got {quoted(value)}")
        if _LOOSE_NUMBER.search(re.sub(r"^1\s*/", "", unit_text)):
            raise refuse(f"cannot read {quoted(value)}: {expected}{decimal_comma.in_text(str(value))}")
        if not unit_text:
            meant = " or ".join(f"'{text}'" for text in self._with_units(found[1]))
            raise refuse(f"{quoted(value)} has no unit; write it with one, for example {meant}")
        return self._to_si(number, unit_text, value)

    def _to_si(self, number, unit_text, value):
        factor = FACTORS.get(self.unit + OF_TURNS * self.turns, {}).get(unit_text)
        si = self._by_astropy(number, unit_text, value) if factor is None else factor * number
        if not math.isfinite(si):
            raise refuse(f"must be a finite number, got {quoted(value)}")
        return si

    def _by_astropy(self, number, unit_text, value):
        """Float in `self.unit`; a refusal where the unit is none, or of something else."""
        if self.unit == "rad" and (side := _COMPASS.fullmatch(unit_text)):
            degrees = -abs(number) if side[1] in "SW" else number
            raise refuse(f"{quoted(value)}: write {degrees:g} deg; south and west are negative")
        unit, hint = _unit_or_hint(unit_text)
        if unit is None:
            raise refuse(f"{quoted(unit_text)} is not a unit; expected one as in '{self.example}'{hint}")
        target, taken = _unit(self.unit), self._measured_in(unit)
        if taken is None:
            raise refuse(self._wrong_dimension(unit, target, value))
        return float(taken.to(target, number))

    def _measured_in(self, unit):
        """The astropy unit in which a value with `unit` is converted; None of the wrong dimension."""
        import astropy.units as u

        target = _unit(self.unit)
        if self.turns and unit.is_equivalent(u.Hz):
            unit = unit * _unit("rev")
        fits = unit.is_equivalent(target) and (unit == target or self.unit not in _LEVELS)
        return unit if fits else None

    def _wrong_dimension(self, unit, target, value):
        hint = ""
        gram = _unit("g")
        if unit.is_equivalent(gram) and target.is_equivalent(_unit("gee")):
            hint = "; g is the gram, standard gravity is written gee"
        if unit == _unit("pix") and target.is_equivalent(_unit("m")):
            hint = "; a number of pixels times the pixel size is a length"
        expected = f"{_dimension(target)} such as '{self.example}'"  # its number is of something else
        return f"{quoted(value)} is {_dimension(unit)}, expected {expected}{hint}"


def split(text):
    """(number, unit as written) of a quantity that has been found good."""
    found = _NUMBER.fullmatch(text)
    return float(found[1]), found[2]


def describe(value):
    """A value of the wrong kind, in words."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a section"
    if isinstance(value, list):
        return "a list"
    return quoted(value).lower() if isinstance(value, bool) else quoted(value)


@dataclass(frozen=True)
class NumberSpec(_Bounded):
    """A plain number: a count, a ratio written as 0.35, a coefficient."""

    example: str
    description: str = ""
    whole: bool = False
    positive: bool = False
    non_negative: bool = False
    at_least: float | None = None
    at_most: float | None = None
    power: int = 1  # 2: a product of two numbers, as in a covariance

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any):
        entry = {"type": "integer" if self.whole else "number", "examples": [float(self.example)]}
        return entry | ({"description": self.description} if self.description else {})

    def convert(self, value):
        """The number, whatever the bounds of the field are."""
        kind = "a whole number" if self.whole else "a number"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise refuse(f"expected {kind} without unit such as {self.example}, got {describe(value)}")
        if not abs(value) < math.inf:
            raise refuse(f"must be a finite number, got {quoted(value)}")
        return value

    def read(self, value):
        """The number, checked."""
        if self.whole and not isinstance(value, int):
            raise refuse(
                f"expected a whole number without unit such as {self.example}, got {describe(value)}"
            )
        value = self.convert(value)
        if self.whole and abs(value) > MOST_COUNT:
            bound = f"be at most {MOST_COUNT}" if value > 0 else f"not be below {-MOST_COUNT}"
            raise refuse(f"must {bound}, got {quoted(value)}")
        check_size(value, value, power=self.power)
        self._check_limits(value, value)
        return int(value) if self.whole else float(value)


def Quantity(unit: str, example: str, description: str = "", **limits):
    """Type of a field that is text with a unit; its value is a float in `unit` (see `QuantitySpec`)."""
    return Annotated[float, QuantitySpec(unit, example, description, **limits)]


def Time(example: str, description: str = "", **limits):
    """Type of a field that is a mission time, from lift-off."""
    return Quantity("s", example, description, **limits)


def Vector(unit: str, example: str, description: str = "", **limits):
    """Type of a field that is a list of three quantities."""
    component = Quantity(unit, example, description, **limits)
    return tuple[component, component, component]


def Number(example: str, description: str = "", **limits):
    """Type of a field that is a plain number."""
    return Annotated[float, NumberSpec(example, description, **limits)]


def Count(example: str, description: str = "", **limits):
    """Type of a field that is a whole number."""
    return Annotated[int, NumberSpec(example, description, whole=True, **limits)]
