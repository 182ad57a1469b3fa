"""What the closing table says of the requirements of a scenario."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.log import reader
from shefex_nav.report import table
from shefex_nav.report.requirements import Judged, objects

JUDGED = [
    Judged("attitude_at_entry", 0.17, 0.0052, "deg", True),
    Judged("wrong_star_fixes", 0, 3, "", False),
    Judged("position_at_entry", 100.0, None, "m", False),
    Judged("star_fixes", 95.0, 100.0, "%", True, "of 81 frames"),
]


@pytest.mark.parametrize(("is_part", "last"), [(False, "not met"), (True, "not reached")])
def test_each_requirement_is_a_line(is_part, last):
    so_far = " so far" if is_part else ""
    lines = {name: str(value) for name, value in table._requirement_rows(JUDGED, is_part)}
    assert lines == {
        "attitude at entry": "0.0052 deg, wanted at most 0.17 deg: met",
        "wrong star fixes": "3, wanted at most 0: not met",
        "position at entry": f"not measured, wanted at most 100 m: {last}",
        "star fixes": f"100 % of 81 frames, wanted at least 95 %: met{so_far}",
    }


@pytest.mark.parametrize(("is_part", "last"), [(False, "not met"), (True, "not reached")])
def test_each_requirement_is_an_object_with_the_verdict_of_its_line(is_part, last):
    """Not measured and not judged are neither met nor missed; the rest of a mission may undo a share."""
    no_levels = Judged("misleading", 0.0, None, "%", False, "the software gives no protection level", False)
    found = {one.pop("name"): one for one in objects([*JUDGED, no_levels], is_part)}
    assert found["attitude_at_entry"] == {
        **{"bound": "at most", "required": 0.17, "value": 0.0052, "unit": "deg", "met": True},
        **{"verdict": "met", "note": ""},
    }
    assert (found["wrong_star_fixes"]["met"], found["wrong_star_fixes"]["value"]) == (False, 3)
    assert found["position_at_entry"] | {"met": None, "value": None} == found["position_at_entry"]
    assert found["position_at_entry"]["verdict"] == last
    share = found["star_fixes"]
    assert (share["bound"], share["note"], share["met"]) == ("at least", "of 81 frames", True)
    assert share["verdict"] == ("met so far" if is_part else "met")
    assert found["misleading"]["met"] is None and found["misleading"]["verdict"] == "not judged"


def test_run_and_report_say_whether_requirements_are_met(tmp_path):
    """Twelve seconds of stars on the ground, which fixes every frame but has no entry."""
    log = tmp_path / "sky.mcap"
    wanted = "requirements={star_fixes: 90 %, attitude: {limit: 0.17 deg, at_entry: true}}"
    ends = ["--set", "mission.time_limit=12 s", "--set", "star_tracker.off=12 s"]
    settings = [*ends, "--set", wanted]
    flown = CliRunner().invoke(app, ["run", "scenarios/night_sky.yaml", "--out", str(log), *settings])
    read = CliRunner().invoke(app, ["report", str(log)])
    as_json = CliRunner().invoke(app, ["report", str(log), "--json"])
    entry, share = json.loads(as_json.stdout)["requirements"]
    assert (entry["name"], entry["met"], entry["verdict"]) == ("attitude_at_entry", None, "not met")
    assert (share["name"], share["met"], share["value"], share["required"]) == (
        "star_fixes",
        True,
        100.0,
        90.0,
    )
    for result in (flown, read):
        assert result.exit_code == 0, result.output
        said = " ".join(result.stdout.replace("│", " ").split())
        assert "star fixes" in said and "wanted at least 90 %: met" in said
        assert "not measured: it did not come down through 100 km, wanted at most 0.17 deg: not met" in said


def test_a_run_until_a_time_is_a_part_of_the_mission(tmp_path):
    """Two seconds of the night sky: the same records as those of the whole run up to then, and said so."""
    logs = [tmp_path / "whole.mcap", tmp_path / "part.mcap"]
    settings = ["--set", "mission.time_limit=4 s", "--set", "star_tracker.off=4 s"]
    settings += ["--set", "requirements={star_fixes: 90 %, attitude: {limit: 0.17 deg, at_entry: true}}"]
    runner = CliRunner()
    for log, until in zip(logs, ([], ["--until", "2 s"]), strict=True):
        arguments = ["run", "scenarios/night_sky.yaml", "--out", str(log), *settings, *until]
        flown = runner.invoke(app, arguments)
        assert flown.exit_code == 0, flown.output
    whole, part = (reader.read(log) for log in logs)
    n = len(part.nav.t_s)
    assert part.nav.t_s[-1] == pytest.approx(2.0) and whole.nav.t_s[-1] == pytest.approx(4.0)
    assert np.array_equal(part.nav.q_ib, whole.nav.q_ib[:n])
    assert np.array_equal(part.truth.r_i, whole.truth.r_i[:n])
    read = runner.invoke(app, ["report", str(logs[1])])
    assert "the mission was looked at until T+2.00 s" in " ".join(read.stderr.split())
    replayed = tmp_path / "replayed.mcap"
    again = runner.invoke(app, ["replay", str(logs[1]), "--log", str(replayed)])
    assert again.exit_code == 0, again.output
    assert reader.read(replayed).until_s == part.until_s == 2.0
    for told in (flown.stdout, read.stdout, again.stdout):
        said = " ".join(told.replace("│", " ").split())
        assert "looked at until T+2.0 s; everything above is up to then" in said
    for told in (flown.stdout, read.stdout):
        said = " ".join(told.replace("│", " ").split())
        assert "wanted at least 90 %: met so far" in said
        assert (
            "not measured: it did not come down through 100 km, wanted at most 0.17 deg: not reached" in said
        )


@pytest.mark.parametrize(
    ("until", "words"),
    [
        ("2", "unit"),
        ("2 m", "2 m"),
        ("0 s", "0 s is not after the start of the mission, T+0 s"),
        ("50 ms", "from 0.1 s on"),
    ],
)
def test_a_time_that_is_none_of_the_mission_is_refused(tmp_path, until, words):
    out = tmp_path / "run.mcap"
    result = CliRunner().invoke(app, ["run", "scenarios/night_sky.yaml", "--until", until, "--out", str(out)])
    assert result.exit_code == 2 and not out.exists()
    assert "--until" in result.output and words in " ".join(result.output.replace("│", " ").split())


def test_a_mission_that_is_over_before_is_no_part(tmp_path):
    log = tmp_path / "sky.mcap"
    ends = ["--set", "mission.time_limit=2 s", "--set", "star_tracker.off=2 s", "--until", "1 min"]
    flown = CliRunner().invoke(app, ["run", "scenarios/night_sky.yaml", "--out", str(log), *ends])
    assert flown.exit_code == 0 and reader.read(log).until_s is None
    assert "--until 1 min: the mission was over before, at T+2.00 s" in flown.stderr
