"""Aerodynamic coefficients in a file, over the Mach number and the angle of attack."""

import numpy as np
import pytest
from broken import TEXT, the_message

from shefex_nav.scenario import params
from shefex_nav.scenario.load import load

AERO = """mach, alpha_deg, axial, normal_slope, pressure_station_m, drag
0, 0, 0.4, 2.0, 1.0, 0
0, 20, 0.41, 2.1, 1.1, 0
5, 0, 0.2, 1.0, 1.2, 0.01
5, 20, 0.21, 1.1, 1.3, 0.01
2, 0, 0.6, 3.0, 1.4, 0.02
2, 20, 0.61, 3.1, 1.5, 0.02
"""


def coefficients(folder, text, rest="pitch_damping: [-9, -9, -9], roll_damping: [-1, -1, -1]"):
    """The default scenario with coefficients from a file."""
    (folder / "aero.csv").write_text(text, encoding="utf-8")
    begin, end = TEXT.index("      aerodynamics: # both"), TEXT.index("    S44:")
    section = f"      aerodynamics: {{area: 1 m2, diameter: 1 m, file: aero.csv, {rest}}}\n"
    path = folder / "aero.yaml"
    path.write_text(TEXT[:begin] + section + TEXT[end:], encoding="utf-8")
    return path


def test_coefficients_over_the_angle_of_attack(tmp_path):
    """Rows in any order; over (Mach, angle) in the end."""
    aero = params.flight_params(load(coefficients(tmp_path, AERO))).stages[0].aerodynamics
    np.testing.assert_allclose(aero.mach, [0, 2, 5])
    np.testing.assert_allclose(aero.alpha, np.radians([0, 20]))
    np.testing.assert_allclose(aero.axial, [[0.4, 0.41], [0.6, 0.61], [0.2, 0.21]])
    np.testing.assert_allclose(aero.normal_slope, [[2.0, 2.1], [3.0, 3.1], [1.0, 1.1]])
    np.testing.assert_allclose(aero.pressure_station_m, [[1.0, 1.1], [1.4, 1.5], [1.2, 1.3]])
    np.testing.assert_allclose(aero.drag, [[0, 0], [0.02, 0.02], [0.01, 0.01]])
    np.testing.assert_allclose(aero.pitch_damping, [-9, -9, -9])


def test_coefficients_over_the_mach_number_alone(tmp_path):
    text = "mach,axial,normal_slope,pressure_station_m\n0,0.4,2,1\n3,0.2,1,2\n"
    rest = "damping_mach: [0, 1, 3], pitch_damping: [-9, -6, -9], roll_damping: [-1, -1, -1]"
    aero = params.flight_params(load(coefficients(tmp_path, text, rest))).stages[0].aerodynamics
    np.testing.assert_allclose(aero.mach, [0, 1, 3])  # of both
    np.testing.assert_allclose(aero.alpha, [0.0])
    np.testing.assert_allclose(aero.axial[:, 0], [0.4, 0.4 - 0.2 / 3.0, 0.2])
    np.testing.assert_allclose(aero.pitch_damping, [-9, -6, -9])
    np.testing.assert_array_equal(aero.roll_by_cant, np.zeros(3))


BAD_COEFFICIENTS = {
    "row missing": (
        AERO.replace("2, 20, 0.61, 3.1, 1.5, 0.02\n", ""),
        "6:1: mach: there is no row for Mach 2 at 20 deg",
    ),
    "row twice": (AERO + "0, 20, 0.4, 2, 1, 0\n", "8:1: mach: Mach 0 at 20 deg stands in line 3 already"),
    "pushed tail first": (
        AERO.replace("2, 20, 0.61,", "2, 180, 0.61,").replace(", 20, ", ", 180, "),
        "3:9: vehicle.stages.S40M.aerodynamics.axial.1.0: 0.41 at Mach 0 and 180 deg makes a drag "
        "coefficient of -0.41",
    ),
    "angles from 5": (
        AERO.replace(", 0, 0.", ", 5, 0."),
        "2:4: vehicle.stages.S40M.aerodynamics.angle_of_attack.0: the angles must start at 0 deg, not at",
    ),
    "negative Mach": (
        AERO.replace("\n5, ", "\n-5, "),
        "4:1: vehicle.stages.S40M.aerodynamics.mach.0: must not be negative",
    ),
    "negative drag": (
        AERO.replace("1.5, 0.02", "1.5, -1"),
        "7:24: vehicle.stages.S40M.aerodynamics.drag.1.1: must not be negative, got -1.0",
    ),
}


@pytest.mark.parametrize("kind", BAD_COEFFICIENTS)
def test_bad_coefficients(tmp_path, kind):
    text, words = BAD_COEFFICIENTS[kind]
    said = the_message(coefficients(tmp_path, text))
    assert said.startswith(f"{tmp_path / 'aero.csv'}:{words}"), said


def test_damping_must_fit_the_table(tmp_path):
    said = the_message(coefficients(tmp_path, AERO, "pitch_damping: [-9, -9, -9], roll_damping: [-1, -1]"))
    assert "aerodynamics.roll_damping: 2 values for 3 Mach numbers; give one for each" in said


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("0.2, 1.0, 1.2e9, 0.01", "pressure_station.0.2: must be at most 1 km, got '1.2e9 m'"),
        ("1e8, 1.0, 1.2, 0.01", "axial.0.2: must be at most 10000.0, got 100000000.0"),
        ("0.2, -1e8, 1.2, 0.01", "normal_slope.0.2: must be at least -10000.0, got -100000000.0"),
        ("0.2, 1.0, 1.2, 1e8", "drag.0.2: must be at most 10000.0, got 100000000.0"),
    ],
)
def test_coefficients_that_cannot_be_are_named_with_their_line(tmp_path, value, words):
    said = the_message(coefficients(tmp_path, AERO.replace("5, 0, 0.2, 1.0, 1.2, 0.01", f"5, 0, {value}")))
    assert said.startswith(f"{tmp_path / 'aero.csv'}:4:") and words in said
