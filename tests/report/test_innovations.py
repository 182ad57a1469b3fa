"""NIS of each sensor, in the table of a run as in that of a replay: known innovations, known places."""

import math

import numpy as np
import pytest

from shefex_nav import runs
from shefex_nav.records import GateResult
from shefex_nav.report import innovations, local_level, metrics, table
from shefex_nav.scenario.load import load


def gate(sensor, nis, dof=3, *, t_s=1.0, accepted=True):
    return GateResult(t_s, t_s, sensor, dof, nis, 21.0, accepted, "", np.zeros(dof))


@pytest.fixture(scope="module")
def flown():
    """RunData of a flight with GPS and stars."""
    return runs.fly(load("night_sky"), until_s=6.0).data


def test_right_sigmas_lie_within_what_is_expected_and_wrong_ones_do_not():
    """In 99 of 100 cases; sigmas that are a fifth too small are outside of 300 measurements."""
    rng, inside = np.random.default_rng(11), {1.0: 0, 1.2**2: 0}
    for scale in inside:
        for _ in range(200):
            squares = (scale * rng.chisquare(3, 300)).tolist()
            found = innovations.summarise([gate("gps_position", value) for value in squares])["gps_position"]
            low, high = found["interval"]
            inside[scale] += low <= found["mean"] <= high
            assert found["mean"] == pytest.approx(np.mean(squares))
    assert inside[1.0] >= 190 and inside[1.2**2] == 0


def test_what_met_no_gate_does_not_count_and_rows_of_several_sizes_do():
    gates = [
        gate("star_tracker", 3.0), gate("star_tracker", 9.0, accepted=False), gate("star_tracker", math.nan),
        gate("star_tracker", 8.0, t_s=-5.0), gate("star_tracker", math.nan, dof=0, accepted=False),
        gate("gps_range", 4.0, dof=4), gate("gps_range", 8.0, dof=8), gate("none", math.nan, dof=0),
    ]  # fmt: skip
    found = innovations.summarise(gates, 0.0)
    assert found["none"] is None
    stars, ranges = found["star_tracker"], found["gps_range"]
    assert (stars["samples"], stars["rejected"], stars["mean"], stars["per_dof"]) == (2, 1, 6.0, 2.0)
    assert (ranges["mean"], ranges["per_dof"]) == (6.0, 1.0)
    assert [name for name, _ in innovations.rows(found)] == ["NIS, GPS range", "NIS, star fixes"]


def test_of_errors_that_last_no_interval_is_told():
    (row,) = innovations.rows(innovations.summarise([gate("barometer", 0.2, dof=1)] * 9))
    assert row == (
        "NIS, barometer",
        "0.20, mean of 9; below 1 where its sigmas are right, for its errors last",
    )


@pytest.mark.parametrize("software", [(), (("navigation", "own.py:Mine", ""),)])
def test_a_run_has_the_rows_of_a_replay(flown, software):
    """Of the built-in filter and of another one: what was used, refused, and the NIS."""
    data = flown._replace(mission=flown.mission._replace(software=software))
    navigation = metrics.summarise(data)["navigation"]
    assert navigation["nis"] == local_level.summarise(data)["nis"]
    assert {"gps_position", "gps_velocity", "star_tracker"} <= set(navigation["nis"])
    rows = {name: str(value) for name, value in dict(table.rows(metrics.summarise(data)))["navigation"]}
    for name, words in innovations.rows(navigation["nis"]):
        assert rows[name] == words
    used = sum(one.accepted for one in data.gates if one.sensor == "star_tracker")
    assert f"{used} used" in rows["star fixes"] and "GPS position" in rows


def test_a_solution_beside_a_log_has_none(flown):
    other = type("Other", (), {"nav": flown.nav, "covariance": flown.covariance})
    assert metrics.summarise(flown.with_other("beside", other))["navigation"]["nis"] == {}


def test_fixes_whose_errors_last_may_have_a_small_nis():
    """Ten minutes of night_sky with these errors, loosely coupled: 1.11 of 3, and a NEES of 8.7 of 9."""
    errors = "gps.errors.satellite={range: 2 m, rate: 0.5 mm/s}"
    lasting, white = load("night_sky", (errors,)), load("night_sky")
    gates = [gate("gps_position", 1.1, t_s=0.1 * k) for k in range(600)]
    for scenario, words in ((lasting, "; up to 3.26 expected"), (white, "; 2.75 to 3.26 expected")):
        found = innovations.summarise(gates, text=scenario.source)
        assert found["gps_position"]["errors_last"] is (scenario is lasting)
        ((name, text),) = innovations.rows(found)
        assert name == "NIS, GPS position" and words in text
    assert innovations.fixes_last(load("cubesat").source) == ()  # tightly coupled: states of the ranges
    assert innovations.fixes_last("") == ()
    for share, last in (("75 %", innovations.FIXES), ("0 %", ()), ("0.0 %", ())):
        assert innovations.fixes_last(f"gnss: {{lasting_share: {share}}}") == last
