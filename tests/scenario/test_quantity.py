"""Text with units in, SI out; what is refused, and in which words."""

import math
import random
import re

import pytest
from pydantic_core import PydanticCustomError

from shefex_nav.scenario.quantity import NumberSpec, QuantitySpec
from shefex_nav.scenario.unit_factors import FACTORS, OF_TURNS

G = 9.80665  # m/s^2
DEG = math.pi / 180.0

READ = [
    # unit of the result, text, expected: converted by hand
    ("m", "25 mm", 0.025),
    ("m", "25mm", 0.025),
    ("m", "  -3e-1  km ", -300.0),
    ("m", ".5 m", 0.5),
    ("m", "5 µm", 5e-6),
    ("m", "9.9 um", 9.9e-6),
    ("s", "50 ms", 0.05),
    ("s", "3 min", 180.0),
    ("s", "2 sec", 2.0),
    ("Hz", "2 kHz", 2000.0),
    ("rad", "180 deg", math.pi),
    ("rad", "5°", 5.0 * DEG),
    ("rad", "0.0787 arcsec", 0.0787 / 3600.0 * DEG),
    ("rad", "0.1 mrad", 1e-4),
    ("rad/s", "2 deg/s", 2.0 * DEG),
    ("rad/s", "0.5 deg/h", 0.5 / 3600.0 * DEG),
    ("rad/s", "90 rpm", 3.0 * math.pi),
    ("rad/s", "1.5 rev/s", 3.0 * math.pi),
    ("rad/sqrt(s)", "0.1 deg/sqrt(h)", 0.1 * DEG / 60.0),
    ("rad/sqrt(s)", "1 deg/h/sqrt(Hz)", DEG / 3600.0),
    ("m/s(3/2)", "0.03 m/s/sqrt(h)", 0.03 / 60.0),
    ("m/s2", "1 gee", G),
    ("m/s2", "1 mgee", 1e-3 * G),
    ("m/s2", "20 ugee", 2e-5 * G),
    ("m/s2", "9.81 m/s^2", 9.81),
    ("m/s2", "9.81 m/s**2", 9.81),
    ("m/s2", "3 Gal", 0.03),
    ("rad s/m", "0.5 deg/h/gee", 0.5 / 3600.0 * DEG / G),
    ("rad s3/m2", "0.02 deg/h/gee2", 0.02 / 3600.0 * DEG / G**2),
    ("s2/m", "20 ugee/gee2", 20e-6 / G),
    ("kg", "4.24 t", 4240.0),
    ("kg m2", "420 kg m2", 420.0),
    ("kg m2", "420 kg*m**2", 420.0),
    ("m2", "0.45 m^2", 0.45),
    ("1/rad", "2 1/deg", 2.0 / DEG),
    ("", "7 ppm", 7e-6),
    ("", "0.1 %", 1e-3),
    ("dB", "24 dB", 24.0),
    ("mag", "-1.5 mag", -1.5),
    ("pix", "0.8 pix", 0.8),
    ("pix", "0.8 px", 0.8),
    ("electron", "30 electron", 30.0),
    ("electron", "30 e-", 30.0),
    ("electron/s", "2.5e6 electron/s", 2.5e6),
    ("electron/DN", "118 electron/DN", 118.0),
    ("m", "10000 ft", 3048.0),
    ("m", "2 inch", 0.0508),
    ("m/s", "60 mi/h", 26.8224),
    ("m/s", "3600 kn", 1852.0),
    ("kg", "100 lb", 45.359237),
    ("N", "1 lbf", 4.4482216152605),
    ("Pa", "14.69594877551345 psi", 101325.0),
]


@pytest.mark.parametrize(("unit", "text", "expected"), READ)
def test_reads(unit, text, expected):
    assert QuantitySpec(unit, "1 m").read(text) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("value", "meant"), [(0.5, "50 %"), ("1", "100 %"), (1.5, "1.5 %"), (60, "60 %")])
def test_a_share_without_a_unit_is_not_taken_for_per_cent(value, meant):
    with pytest.raises(PydanticCustomError, match=f"for example '{meant}'$"):
        QuantitySpec("", "60 %").read(value)


REFUSED = [
    # unit, value, words of the complaint
    ("m", 25, "25 has no unit; write it with one, for example '25 mm' or '25 m'"),
    ("m", 2.5, "2.5 has no unit"),
    ("m", "25", "'25' has no unit"),
    ("m", "2 s", "'2 s' is a time, expected a length such as '25 mm'"),
    ("Hz", "2 rad/s", "'2 rad/s' is an angular rate, expected a frequency"),
    ("rad/s", "2 Hz", "is a frequency, expected an angular rate"),
    ("rad", "0.5", "has no unit"),
    ("m/s", "1 m/s/sqrt(h)", "is a quantity in m / (h(1/2) s), expected a velocity"),
    ("m/s2", "0.5 mg", "is a mass, expected an acceleration such as '25 mm'; g is the gram"),
    ("", "24 dB", "'24 dB' is a level in dB, expected a plain ratio"),
    ("mag", "6 dB", "'6 dB' is a level in dB, expected a magnitude"),
    ("dB", "6 mag", "'6 mag' is a magnitude, expected a level in dB"),
    ("", "0.1", "has no unit"),
    (
        "m",
        "3018 pix",
        "is a quantity in pix, expected a length such as '25 mm'; a number of pixels times the",
    ),
    ("Hz", "5 Hzz", "'Hzz' is not a unit; expected one as in '25 mm'; did you mean Hz?"),
    ("m", "fast", "cannot read 'fast': expected a quantity such as '25 mm'"),
    ("m", "1.2.3 m", "cannot read '1.2.3 m'"),
    ("m", "3 5 m", "cannot read '3 5 m'"),
    ("m", "1_000 m", "'_000 m' is not a unit"),
    ("rad", "31.885 S", "write -31.885 deg; south and west are negative"),
    ("rad", "131.5 deg E", "write 131.5 deg; south and west are negative"),
    ("rad", "31.885°W", "write -31.885 deg; south and west are negative"),
    ("m", "1,5 m", "cannot read '1,5 m'"),
    ("m", "5 m, s", "'m, s' is not a unit"),
    ("m", "nan m", "must be a finite number, got 'nan m'"),
    ("m", "-inf m", "must be a finite number"),
    ("m", "1e400 m", "must be a finite number"),
    ("m", "1e308 km", "must be a finite number"),
    ("m", "1e28 km", "must be at most 1e+12 m in size, got '1e28 km'"),
    ("m", "-1e-38 mm", "must be 0 or more than 1e-40 m in size, got '-1e-38 mm'"),
    ("m", math.nan, "must be a finite number, got nan"),
    ("m", True, "expected a quantity such as '25 mm', got true"),
    ("m", None, "got nothing"),
    ("m", [1], "got a list"),
    ("m", {"a": 1}, "got a section"),
    ("m", "{m}", "cannot read '{m}'"),
]


@pytest.mark.parametrize(
    ("unit", "text"), [(unit, text) for unit, factors in FACTORS.items() for text in factors]
)
def test_factors_are_those_of_astropy_to_the_last_bit(unit, text):
    spec = QuantitySpec(unit.removesuffix(OF_TURNS), f"1 {text}", turns=unit.endswith(OF_TURNS))
    rng = random.Random(1)
    for _ in range(300):
        number = rng.uniform(-1.0, 1.0) * 10.0 ** rng.randint(-12, 12)
        assert spec.convert(f"{number!r} {text}") == spec._by_astropy(number, text, number)


def complaint(spec, value):
    with pytest.raises(PydanticCustomError) as caught:
        spec.read(value)
    return str(caught.value)


@pytest.mark.parametrize(("unit", "value", "words"), REFUSED)
def test_refuses(unit, value, words):
    said = complaint(QuantitySpec(unit, "25 mm"), value)
    assert words in said
    assert "\n" not in said


def test_limits():
    assert "must be greater than zero, got '0 m'" in complaint(QuantitySpec("m", "1 m", positive=True), "0 m")
    assert "must not be negative, got '-1 m'" in complaint(
        QuantitySpec("m", "1 m", non_negative=True), "-1 m"
    )
    within = QuantitySpec("m", "1 m", at_least="2 cm", at_most="1 km")
    assert within.read("20 mm") == pytest.approx(0.02)
    assert "must be at least 2 cm, got '1 mm'" in complaint(within, "1 mm")
    assert "must be at most 1 km, got '2 km'" in complaint(within, "2 km")


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("s", "1e12 s"), ("m/s2", "20000 gee"), ("m", "384400 km"), ("rad/s", "40 rev/s"),
        ("rad/s", "1e-9 deg/h"), ("electron/s", "1e9 electron/s"),
    ],
)  # fmt: skip
def test_what_is_written_of_rockets_satellites_and_their_sensors_is_read(unit, text):
    """For ever, as a time constant; a shock accelerometer; the Moon; a fast spin; an optical gyro; a star."""
    assert QuantitySpec(unit, f"1 {unit}").read(text) > 0.0


def test_words_in_place_of_a_quantity():
    spec = QuantitySpec("rad/s", "1000 deg/s", words=(("unlimited", math.inf),))
    assert spec.read("unlimited") == math.inf
    assert "such as '1000 deg/s' or 'unlimited'" in complaint(spec, "unlimitd")
    assert "must be a finite number" in complaint(spec, "inf deg/s")


def test_turns_per_second_where_a_spin_is_meant():
    assert QuantitySpec("rad/s", "1.5 Hz", turns=True).read("1.5 Hz") == pytest.approx(3.0 * math.pi)
    assert QuantitySpec("rad/s", "1.5 Hz", turns=True).read("2 rad/s") == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("limits", "value", "words"),
    [
        ({}, "0.3", "expected a number without unit such as 0.5, got '0.3'"),
        ({}, True, "got true"),
        ({}, math.inf, "must be a finite number"),
        ({"whole": True}, 2.5, "expected a whole number without unit such as 0.5, got 2.5"),
        ({"whole": True}, 10**400, "must be at most 1000000000"),
        ({"whole": True}, 2**63, "must be at most 1000000000"),
        ({"whole": True}, -(2**63), "must not be below -1000000000"),
        ({"positive": True}, 0, "must be greater than zero"),
        ({"non_negative": True}, -1, "must not be negative"),
        ({"at_least": 4}, 3, "must be at least 4, got 3"),
        ({"at_most": 0.1}, 0.2, "must be at most 0.1, got 0.2"),
    ],
)
def test_plain_numbers(limits, value, words):
    said = complaint(NumberSpec("0.5", **limits), value)
    assert words in said
    assert len(said) < 200


def test_a_whole_number_where_a_number_is_due():
    number = NumberSpec("0.5").read(3)
    assert number == 3.0
    assert isinstance(number, float)


@pytest.mark.parametrize(
    ("spec", "value", "words"),
    [
        (QuantitySpec("rad", "88 deg", at_most="90 deg"), "80", "for example '80 deg'"),
        (
            QuantitySpec("rad", "88 deg", at_most="90 deg"),
            "100",
            "for example '88 deg'",
        ),  # 100 deg are refused
        (QuantitySpec("s", "40 ms", at_most="1 s"), "0.05", "for example '0.05 ms' or '0.05 s'"),
        (QuantitySpec("s", "40 ms", at_most="1 s"), "50", "for example '50 ms'"),  # 50 s are refused
        (QuantitySpec("kg", "480 kg", positive=True), "-4", "for example '480 kg'"),
        (QuantitySpec("rad/s", "1 Hz", turns=True), "2", "for example '2 Hz'"),
    ],
)
def test_examples_are_the_number_of_the_user_where_it_is_possible(spec, value, words):
    """Every example that a message gives is taken by the field that gave it."""
    with pytest.raises(PydanticCustomError) as refused:
        spec.read(value)
    assert refused.value.message().endswith(words)
    for text in re.findall(r"'([^']+)'", words):
        spec.read(text)
