"""Fate of fixes, what own software does not say, errors far beyond their sigmas: figures, table, page."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav import runs
from shefex_nav.records import GateResult, Reason
from shefex_nav.report import error_figures, metrics, page, sensor_use, table, table_rows
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.scenario.load import load

OWN = (("navigation", "own.py:Mine", ""),)


@pytest.fixture(scope="module")
def flown():
    """RunData of a flight with GPS and stars, as if software of a user's own had flown it."""
    return runs.fly(load("night_sky"), until_s=6.0).data


def own(data, **changes):
    return data._replace(mission=data.mission._replace(software=OWN), **changes)


def refused(data):
    """The same with every star fix refused."""
    none = np.zeros(len(data.nav.t_s), dtype=bool)
    gates = [one._replace(accepted=one.accepted and one.sensor != "star_tracker") for one in data.gates]
    return data._replace(gates=gates, nav=data.nav._replace(star_aided=none))


def rows_of(data):
    found = metrics.summarise(data)
    return {name: str(value) for name, value in dict(table.rows(found))["navigation"]}


def words_of(data):
    """Text of the summary of the page."""
    text = page.page(data)
    return text[text.index("What went wrong") : text.index("</section>")]


def test_used_and_refused_are_counted_by_sensor(flown):
    found = sensor_use.measurements(own(flown))
    stars = [one for one in flown.gates if one.sensor == "star_tracker"]
    good = sum(fix.reason == Reason.NONE for fix in flown.star_fixes)
    assert found["star_tracker"] == {
        "delivered": good,
        "used": sum(one.accepted for one in stars),
        "refused": sum(not one.accepted for one in stars),
    }
    assert found["gps_position"]["delivered"] == sum(fix.valid for fix in flown.gps) > 0
    assert metrics.summarise(flown)["navigation"]["measurements"] == found  # of the built-in filter


def test_rows_of_single_stars_are_no_fixes():
    gates = [GateResult(1.0, 1.0, "star_vectors", 2, 1.0, 9.0, k > 2, "", np.zeros(2)) for k in range(8)]
    fix = SimpleNamespace(reason=Reason.NONE)
    data = SimpleNamespace(gates=gates, star_fixes=[fix] * 3, gps=[], nav=SimpleNamespace(t_s=[]))
    assert sensor_use.measurements(data) == {"star_vectors": {"delivered": None, "used": 5, "refused": 3}}


def test_measurements_that_met_no_gate_are_counted(flown):
    """The first GPS fix is of the instant at which the filter begins."""
    one = sensor_use.measurements(flown)["gps_position"]
    assert one["delivered"] == one["used"] + one["refused"] + 1
    assert rows_of(flown)["GPS position"].endswith(f"{one['used']} used, 1 {sensor_use.PASSED_OVER}")


def test_star_fixes_that_were_all_refused(flown):
    data = own(refused(flown))
    rows, n = rows_of(data), len(sensor_use.good_fixes(data))
    assert rows["star fixes"] == f"{n} delivered, none used, {n} refused"
    assert "after two star fixes" not in rows and "not known" not in rows
    assert "no star fix was used" in rows["NEES"] and "from the start of the run" in rows["NEES"]
    assert f"star fixes: {n} delivered, none used" in words_of(data)


def test_of_the_built_in_filter_the_table_says_why_there_is_no_nees(flown):
    rows, nees = rows_of(refused(flown)), metrics.summarise(refused(flown))["navigation"]["nees"]
    assert nees["mean"] is None and nees["samples"] == 0
    assert rows["NEES"] == "none: no star fix was used, from the first of which it counts"


def test_without_gates_the_flag_says_whether_stars_were_used(flown):
    data = own(flown, gates=[])
    rows, n = rows_of(data), len(sensor_use.good_fixes(data))
    assert rows["star fixes"] == f"{n} delivered, how many of them were used is not known"
    assert "after two star fixes" in rows and rows["not known"] == sensor_use.NO_GATES
    none = np.zeros(len(data.nav.t_s), dtype=bool)
    rows = rows_of(data._replace(nav=data.nav._replace(star_aided=none)))
    assert rows["star fixes"] == f"{n} delivered, none used (star_aided was never set)"
    assert "after two star fixes" not in rows


def test_the_page_does_not_say_nothing_of_what_it_does_not_know(flown):
    told = words_of(own(flown, gates=[], health=[]))
    assert sensor_use.NO_GATES in told and "no sensor was lost or refused" not in told
    unknown = flown.covariance._replace(P=np.full_like(flown.covariance.P, np.nan))
    assert sensor_use.NO_COVARIANCE in words_of(own(flown, gates=[], covariance=unknown))
    assert "Not known" not in words_of(flown)


def test_errors_far_beyond_their_sigmas_are_told_with_their_time(flown):
    errors = navigation_errors(flown)
    assert error_figures.beyond_sigma(flown, errors) == []
    late = flown.nav.t_s > 3.0
    data = flown._replace(nav=flown.nav._replace(r_i=flown.nav.r_i + np.outer(late, [300.0, 0.0, 0.0])))
    (one,) = error_figures.beyond_sigma(data, navigation_errors(data))
    assert one.quantity == "position" and one.from_s == pytest.approx(3.0, abs=0.11) and one.until_s is None
    k = int(np.argmax(flown.covariance.t_s > 4.0))
    assert one.times > 0.3 * 300.0 / np.sqrt(np.trace(flown.covariance.P[k, :3, :3]))
    assert table_rows.beyond_words(one) in words_of(data)


def test_the_nees_names_what_is_too_sure_and_by_how_much(flown):
    known = metrics.summarise(flown)["navigation"]["nees"]
    P = flown.covariance.P.copy()
    P[:, 6:, :] /= 10.0
    P[:, :, 6:] /= 10.0
    nees = metrics.summarise(flown._replace(covariance=flown.covariance._replace(P=P)))["navigation"]["nees"]
    for name, factor in (("position", 1.0), ("velocity", 1.0), ("attitude", 10.0)):
        assert nees["times_sigma"][name] == pytest.approx(factor * known["times_sigma"][name])
    row = str(dict(table_rows.consistency_rows({"nees": nees}))["NEES"])
    said = table_rows.times(nees["times_sigma"]["attitude"])
    assert "errors are larger than the filter's sigmas say: position" in row and f"attitude {said}" in row


def test_the_table_says_since_when_errors_are_far_beyond_their_sigmas():
    """The first stretch of each quantity, the earliest first; how many follow."""
    stretches = [
        {"quantity": "position", "from_s": 154.0, "until_s": None, "times": 31.26},
        {"quantity": "attitude", "from_s": 70.3, "until_s": 90.0, "times": 7.71},
        {"quantity": "attitude", "from_s": 120.0, "until_s": 130.0, "times": 9.0},
    ]
    row = dict(table_rows.consistency_rows({"nees": {"mean": None}, "beyond_sigma": stretches}))[
        "beyond sigma"
    ]
    assert str(row) == (
        "errors above 5 times their sigma: attitude from T+70.3 s to T+90.0 s, up to 7.7 times; "
        "position from T+154.0 s to the end, up to 31 times; 1 more stretch later"
    )
    assert dict(table_rows.consistency_rows({"nees": {"mean": None}, "beyond_sigma": []})) == {}
