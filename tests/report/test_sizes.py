"""Figures for people."""

from shefex_nav.report import page_summary
from shefex_nav.report.sizes import number, percent
from shefex_nav.report.table_rows import _nees_words


def test_a_figure_has_no_dozens_of_digits():
    assert number(1234567.891, 1, "m") == "1 234 567.9 m" and number(-0.5, 2) == "-0.50"
    assert number(1.234e27, 1, "m") == "1.23e+27 m" and number(-1e12, 3) == "-1e+12"
    assert number(None, 1, "m") == "-"
    assert str(_nees_words({"mean": 3.3e40, "dof": 9, "samples": 5})).startswith("3.3e+40 for 9 degrees")


def test_a_hundred_per_cent_is_all_and_none_is_nothing():
    assert [percent(one) for one in (0.0, 0.5, 1.0)] == ["0.0 %", "50.0 %", "100.0 %"]
    assert percent(8086 / 8088) == "99.98 %" and percent(1.0 - 1e-5) == "99.999 %"
    assert percent(2 / 22000, 2) == "0.01 %" and percent(1e-6, 2) == "0.0001 %"
    assert percent(0.9994) == "99.9 %"


def test_errors_that_were_short_beyond_their_level_are_not_called_harmless():
    one = {"misleading_share": 0.0, "over_level": 5.42, "usable_share": 0.695}
    assert page_summary._usable_tile("velocity", one) == (
        "velocity usable", "69.5 %", "never misleading for more than 1 s, error at most 5.42 of its level",
    )  # fmt: skip
    assert page_summary._usable_tile("velocity", one | {"over_level": 0.5})[2].startswith("never misleading,")
