"""Figures for people."""

from shefex_nav.report.consistency_rows import _nees_words
from shefex_nav.report.sizes import number


def test_a_figure_has_no_dozens_of_digits():
    assert number(1234567.891, 1, "m") == "1 234 567.9 m" and number(-0.5, 2) == "-0.50"
    assert number(1.234e27, 1, "m") == "1.23e+27 m" and number(-1e12, 3) == "-1e+12"
    assert number(None, 1, "m") == "-"
    assert str(_nees_words({"mean": 3.3e40, "dof": 9, "samples": 5})).startswith("3.3e+40 for 9 degrees")
