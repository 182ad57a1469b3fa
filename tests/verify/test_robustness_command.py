"""`shefex-nav verify robustness`: refusals, a matrix flown end to end, going on after a kill."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.verify.robustness import design, page, require, running, show, store

ROOT = Path(__file__).parents[2]
BRIEF = "rexus_like", "--flights", 1, "--jobs", 1, "--seed", 3


def command(*arguments):
    return CliRunner().invoke(app, ["verify", "robustness", *map(str, arguments)])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rexus_like", "--cells", "3-1"), "expected cells from 0 to 399"),
        (("rexus_like", "--cells", "400"), "expected cells from 0 to 399"),
        (("rexus_like", "--cells", "x"), "no range of cells"),
        (("rexus_like", "--resume"), "needs --out FOLDER"),
        (("rexus_like", "--flights", 0), "flights"),
        (("rexus_like", "--random-faults", 3, "--cells", "0"), "no cells of the design"),
        (("rexus_like", "--random-faults", 3, "--flights", 25), "--flights: random faults have no cells"),
        (("no_such_scenario",), "no_such_scenario"),
        (("tight",), "navigation.gps has to be 'loose'"),
        (
            ("night_sky",),
            "night_sky: the matrix flies star trackers by their statistics",
        ),
        (("night_sky",), "star_camera.optics.zero_magnitude_flux: is 1.75e+06 electron/s, the statistics of"),
        (("rexus_like", "--cells", "1"), "none of the cells"),  # is one of rexus_spinning
        (("rexus_like", "rexus_like.yaml"), "rexus_like"),
    ],
)
def test_bad_input_is_refused_before_anything_flies(arguments, words):
    done = command(*arguments)
    assert done.exit_code == 2 or (done.exit_code == 1 and done.exception is not None)
    assert words in done.output + str(done.exception)
    assert "Traceback" not in done.output


def own_cells(count, **levels):
    """Numbers of the first cells of rexus_like with some levels."""
    found = [cell for cell in design.cells() if cell.rocket == "rexus_like"]
    for name, level in levels.items():
        found = [cell for cell in found if getattr(cell, name) == level]
    return [cell.number for cell in found[:count]]


@pytest.mark.slow
def test_a_small_matrix_is_flown_end_to_end_and_goes_on(tmp_path):
    """Two cells; a line is torn as by a kill; the same flights come out of it, and a page."""
    numbers = ",".join(map(str, own_cells(2)))
    out = tmp_path / "study"
    done = command(*BRIEF, "--cells", numbers, "--out", out, "--json")
    found = json.loads(done.stdout)
    assert done.exit_code == (0 if found["ok"] else 1)
    assert found["flown"] == 2 and found["totals"]["failed"] == 0
    assert [one["cell"] for one in found["cells"]] == own_cells(2)
    for one in found["flights"]:
        for fault in one["detectable"] or ():
            assert fault["t_s"] is None or fault["t_s"] >= fault["start_s"]
    page = (out / store.PAGE).read_text()
    assert page.count("<img") == 4 and "rexus_like" in page
    lines = (out / store.FLIGHTS).read_text().splitlines(keepends=True)
    (out / store.FLIGHTS).write_text(lines[0] + lines[1][:40])
    refused = command(*BRIEF, "--cells", numbers, "--out", out)
    assert "--resume" in refused.output + str(refused.exception)
    again = command(*BRIEF, "--cells", numbers, "--out", out, "--json", "--resume")
    same = json.loads(again.stdout)
    for one, other in zip(found["cells"], same["cells"], strict=True):
        assert one == other
    table = command(*BRIEF, "--cells", numbers, "--out", out, "--resume")
    assert "worst cells" in table.output and table.exit_code == done.exit_code
    other = command(*BRIEF, "--cells", numbers, "--out", out, "--resume", "--set", "gps.rate=2 Hz")
    assert "is of another study: set was" in other.output + str(other.exception)


@pytest.mark.slow
def test_what_a_kill_leaves_is_gone_on_with(tmp_path):
    out, numbers = tmp_path / "study", ",".join(map(str, own_cells(2)))
    words = [sys.executable, "-m", "shefex_nav", "verify", "robustness", *map(str, BRIEF), "--cells", numbers]
    killed = subprocess.Popen([*words, "--out", out], cwd=ROOT, stderr=subprocess.DEVNULL)
    flights, end = out / store.FLIGHTS, time.monotonic() + 300.0
    while time.monotonic() < end and not (flights.exists() and flights.stat().st_size):
        time.sleep(0.1)
    os.kill(killed.pid, signal.SIGKILL)
    killed.wait()
    before = flights.read_text().splitlines()
    assert before
    done = command(*BRIEF, "--cells", numbers, "--out", out, "--resume", "--json")
    assert json.loads(done.stdout)["flown"] == 2
    assert flights.read_text().splitlines()[: len(before) - 1] == before[:-1]


@pytest.mark.slow
def test_random_faults_fly(tmp_path):
    done = command("rexus_like", "--random-faults", 2, "--jobs", 1, "--json")
    found = json.loads(done.stdout)
    assert found["of"] == "random faults" and found["flown"] == 2 and found["totals"]["failed"] == 0
    assert all(one["detectable"] for one in found["flights"])


def test_a_scenario_of_its_own_flies_all_cells_that_it_can():
    def asked(has_stars):
        given = (("mine.yaml", "mine", has_stars),)
        return running.jobs(running.Request(given, (), 2, None, 0, 0))

    assert len(asked(True)) == 800
    without = {job.cell.number for job in asked(False)}
    assert without == {cell.number for cell in design.cells() if not design.needs_stars(cell)}
    assert len({job.seed for job in asked(True)}) == 800


@pytest.mark.parametrize(("flights", "faults"), [(10**10, 0), (25, 10**10)])
def test_more_flights_than_can_be_known_are_refused(flights, faults):
    given = (("mine.yaml", "mine", True),)
    with pytest.raises(running.RobustnessError, match=r"flights; expected 1000000 at most"):
        running.jobs(running.Request(given, (), flights, None, 0, faults))


def record(**changes):
    """Flight of the design in which nothing happens."""
    quantity = {
        "usable_s": 100.0, "misleading_s": 0.0, "misleading_times": 0, "misleading_from_s": None,
        "largest_ratio": 0.5,
    }  # fmt: skip
    return {
        "cell": 1, "flight": 0, "seed": 1, "rocket": "r", "grade": "g", "told": "right", "happens": "nothing",
        "phase": "pad", "told_kind": "right", "noise_told": 1.0, "risk": 1e-5, "alarms": [], "sigma_deg": 0.1,
        "nees_end": 9.0, "nees_usable": 9.0, "end_s": 100.0, "twin": None, "fault": None, "cpu_s": 1.0,
        "quantities": {"attitude": quantity | changes.pop("quantity", {})},
    } | changes  # fmt: skip


def verdicts(*records):
    return {one.name: one.good for one in require.judge(records)}


def test_of_few_flights_the_mean_is_held_to_what_chance_does():
    """Chi-square with 9 degrees of freedom, 99.9 %: 0.97 and 29.7 of one flight, 4.86 and 14.8 of eight."""
    for value, good in ((0.95, False), (1.0, True), (29.6, True), (29.7, False)):
        assert verdicts(record(nees_end=value))["NEES told rightly"] is good
    assert verdicts(*[record(nees_end=15.1)] * 8)["NEES told rightly"] is False
    assert verdicts(record(nees_usable=15.1))["NEES noises"] is False  # a mean over time: always 15


def test_a_nees_that_is_no_number_is_not_left_out_of_the_mean():
    """A filter that has lost its numbers is no survivor, whose others may still look right."""
    assert verdicts(*[record()] * 9, record(nees_end=None))["NEES told rightly"] is False
    assert verdicts(record(nees_end=None, sigma_deg=None))["NEES told rightly"] is False


def test_an_error_without_a_level_is_not_drawn_as_none():
    """A ratio that is no number is written as null; the map of the largest had the colour of zero there."""
    names = ("happens", "told")
    found = page._values([record(quantity={"largest_ratio": None}), record()], "largest_ratio", names)
    assert found == {("nothing", "right"): np.inf}
    never = record(quantity={"largest_ratio": None, "usable_s": 0.0})
    assert page._values([never], "largest_ratio", names) == {("nothing", "right"): 0.0}
    other = record(happens="gyro_stuck", quantity={"largest_ratio": None})
    drawn = dict(page.draw([record(), other]))["ratio"]
    grid = np.asarray(drawn.axes[0].images[0].get_array())
    assert np.nanmax(grid) == pytest.approx(2.0) and np.nanmin(grid) == pytest.approx(0.5)


def test_the_scale_of_seconds_without_any_is_one_of_seconds():
    """It went to 1e-9 s where nothing misled."""
    drawn = dict(page.draw([record(), record(happens="gyro_stuck")]))["misleading"]
    assert drawn.axes[0].images[0].get_clim() == (0.0, 1.0)


def test_requirements_are_met_and_not():
    assert verdicts(record()) == {
        "flown": True, "alarm": None, "reason": None, "misleading attitude": True, "constants attitude": None,
        "NEES told rightly": True, "NEES noises": True,
    }  # fmt: skip
    nine = lambda **changes: verdicts(*[record(**changes)] * 9)  # noqa: E731
    assert nine(nees_end=15.1)["NEES told rightly"] is False
    assert nine(nees_end=4.9)["NEES told rightly"] is False
    assert nine(nees_end=1.0, sigma_deg=40.0)["NEES told rightly"] is True
    assert nine(nees_usable=15.1)["NEES noises"] is False
    assert nine(nees_usable=15.1, told_kind="x", noise_told=0.2)["NEES noises"] is None
    assert verdicts({**record(), "failed": "ValueError: no"})["flown"] is False
    misled = {"misleading_s": 2.0, "misleading_times": 2}
    assert verdicts(record(quantity=misled))["misleading attitude"] is False
    constant = {"told_kind": "constant up to two"}
    assert verdicts(record(quantity=misled, **constant))["constants attitude"] is False
    assert verdicts(record(quantity=misled | {"usable_s": 2001.0}, **constant))["constants attitude"] is True


def test_what_was_not_flown_is_not_called_met():
    one = require.judge([record()])
    said = "4 of 7 requirements are met, 3 were not flown"
    assert require.in_short(one) == said and next(show.tables([record()])).title == said
    head = {"scenarios": ["r"]}
    made = page.page(head, [record()])
    assert f"1 flight; {said}" in made
    assert made.count("<td>met</td>") == 4 and made.count("<td>not flown</td>") == 3
    failed = require.judge([{**record(), "failed": "ValueError: no"}])
    assert require.in_short(failed).startswith("1 of 5 requirements is not met, 4 were not flown")
    assert require.in_short([row._replace(good=True) for row in one]) == "all 7 requirements are met"
    assert not any("1 flights" in row.found for row in one)


def test_a_fault_that_comes_late_is_named_in_plain_words():
    late = {"beyond_s": 5.0, "late_s": 3.0, "undetected_s": 0.0, "wrong_words": 0, "after_s": 4.0}
    fault = {"alarm": {"attitude": late}, "detectable": [{"what": "x", "t_s": 1.0}], "usable_again_s": None}
    judged = {one.name: one for one in require.judge([record(fault=fault, twin=record())])}
    assert judged["alarm"].good is False and judged["reason"].good is True
    assert (
        "1 of 1 flight with a fault failed" in judged["alarm"].found and "cell 1: 1" in judged["alarm"].found
    )
    unseen = late | {"late_s": 0.0, "undetected_s": 2.5}
    rows = require.undetectable([record(fault=fault | {"alarm": {"attitude": unseen}}, twin=record())])
    assert rows[0]["what"] == "x" and rows[0]["seconds"] == 2.5 and rows[0]["flights"] == 1
