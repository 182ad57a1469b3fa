"""Rows of the table: readings of instruments that met the gate and were used; frames that were refused."""

import numpy as np

from shefex_nav.log import reader
from shefex_nav.records import GateResult
from shefex_nav.report import metrics
from shefex_nav.report.instrument_use import instrument_use
from shefex_nav.report.table import _flight_rows, _navigation_rows, _star_rows

NONE = np.empty(0)


def gate(sensor, accepted, dof=1):
    return GateResult(1.0, 1.0, sensor, dof, 1.0, 16.0, accepted, "", NONE)


def test_what_never_met_the_gate_does_not_count():
    """Readings beyond a height or too late have no degrees of freedom; GPS and stars have other rows."""
    used = [gate("barometer", True)] * 10 + [gate("barometer", False)] * 2
    unfit = [gate("barometer", False, dof=0)] * 90
    others = [gate(name, True, 3) for name in ("gps_position", "star_tracker", "gps_range", "star_vectors")]
    assert instrument_use([*used, *unfit, *others]) == {"barometer": {"readings": 12, "used": 10}}
    assert instrument_use(others) == {}


def test_the_table_names_each_and_marks_one_that_is_mostly_refused(log):
    navigation = metrics.summarise(reader.read(log))["navigation"]
    assert navigation["instruments"] == {}
    navigation["instruments"] = {
        "radar_altimeter": {"readings": 825, "used": 0}, "barometer": {"readings": 12, "used": 10},
    }  # fmt: skip
    rows = dict(_navigation_rows(navigation))
    assert str(rows["radar altimeter"]) == "0 of 825 readings used" and rows["radar altimeter"].style
    assert str(rows["barometer"]) == "10 of 12 readings used" and not rows["barometer"].style


def test_errors_without_a_truth_have_no_rows(log):
    """Three lines of dashes at the top of a table say nothing; those that are known stay."""
    navigation = metrics.summarise(reader.read(log))["navigation"]
    names = ("position error", "velocity error", "attitude error")
    assert set(names) <= set(dict(_navigation_rows(navigation)))
    none = {"rms": None, "max": None}
    rows = dict(_navigation_rows(navigation | {"position_error_m": none, "attitude_error_deg": none}))
    assert [name in rows for name in names] == [False, True, False]


def test_heights_say_above_what(log):
    flight = metrics.summarise(reader.read(log))["flight"]
    rows = dict(_flight_rows(flight | {"apogee_km": 5.58, "climbs_at_km": None, "events": []}, stood=True))
    assert rows["apogee"] == "5.6 km above the ellipsoid"
    rows = dict(_flight_rows(flight | {"apogee_km": None, "climbs_at_km": 3.5}, stood=True))
    assert rows["height at the end"] == "3.5 km above the ellipsoid, no apogee before it"


def test_frames_refused_for_their_residuals_are_explained(log):
    star = metrics.summarise(reader.read(log))["star_tracker"] | {"frames": 100, "no_fix": {"residuals": 21}}
    assert "centroid_floor" in str(dict(_star_rows(star))["residuals"])
    assert "residuals" not in dict(_star_rows(star | {"no_fix": {"residuals": 19}}))
