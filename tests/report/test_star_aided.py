"""Errors after two star fixes leave out those of the start, which are its alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.records import Reason
from shefex_nav.report import error_figures
from shefex_nav.report.navigation_errors import NavErrors
from shefex_nav.report.table import _navigation_rows


def fix(t_s, reason=Reason.NONE):
    return SimpleNamespace(reason=reason, t_available_s=t_s)


def made(fixes):
    """Attitude errors of 10, 8, 0.3, 0.4 deg at T+0, 1, 2, 3 s."""
    size = np.radians([10.0, 8.0, 0.3, 0.4])
    ones = np.ones((4, 3))
    found = NavErrors(np.arange(4.0), ones, 2.0 * ones, np.outer(size, [0.6, 0.0, 0.8]))
    return error_figures.star_aided(SimpleNamespace(star_fixes=fixes), found)


def test_from_the_second_fix_on():
    found = made([fix(0.0, Reason.NO_MATCH), fix(0.5), fix(1.0, Reason.SATURATED), fix(1.2), fix(3.0)])
    assert found["from_s"] == 1.2
    rms = np.sqrt(0.5 * (0.3**2 + 0.4**2))
    assert found["attitude_deg"] == pytest.approx({"rms": rms, "max": 0.4})
    assert found["position_m"] == pytest.approx({"rms": np.sqrt(3.0), "max": np.sqrt(3.0)})
    assert found["velocity_m_s"]["max"] == pytest.approx(2.0 * np.sqrt(3.0))


def test_none_without_stars():
    assert made([]) is None and made([fix(0.5)]) is None
    assert made([fix(1.0), fix(9.0)]) is None  # after the last error


def test_rows_of_the_table():
    both = {"rms": 1.0, "max": 2.0}
    pointing = dict.fromkeys(("position_m", "velocity_m_s", "attitude_deg"), both)
    navigation = {
        "position_error_m": both, "velocity_error_m_s": both, "attitude_error_deg": both, "at_entry": None,
        "star_aided": {"from_s": 33.2, "attitude_deg": {"rms": 0.001, "max": 0.004}}, "integrity": None,
        "while_pointing": pointing | {"from_s": 30.0, "to_s": 90.0}, "nees": {"mean": None},
    }  # fmt: skip
    found = dict(_navigation_rows(navigation))
    assert found["after two star fixes"] == "0.001 deg rms, 0.004 deg max, T+33.2 s to the end"
    assert found["while pointing"].endswith("T+30 to +90 s, star fixes since T+33.2 s")
    navigation["while_pointing"]["from_s"] = 40.0
    assert dict(_navigation_rows(navigation))["while pointing"].endswith("T+40 to +90 s")
