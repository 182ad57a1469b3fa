"""Runs of a characterisation: corners, failures, killed workers, kept records, the command's messages."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from kept_runs import flown
from typer.testing import CliRunner

from shefex_nav.campaign.characterise import running
from shefex_nav.campaign.characterise.fit import FitError
from shefex_nav.campaign.characterise.records import Flown, Records, RecordsError
from shefex_nav.campaign.running import prepared
from shefex_nav.commands.app import app
from shefex_nav.scenario import laws
from shefex_nav.scenario.load import Pattern, load
from shefex_nav.scenario.star_statistics import settings

CAMPAIGN = Path(__file__).parents[2] / "scenarios" / "shefex2_dispersed.yaml"
RENDERED = ["star_tracker.frames=rendered", "star_tracker.model=null"]


@pytest.fixture(scope="module")
def planned():
    return prepared(load(CAMPAIGN, RENDERED), 12, 5)


@pytest.mark.parametrize("held", [1, 2, 5, 8, 25, 1000])
def test_the_number_to_ask_for_is_the_smallest_of_which_so_many_judge(held):
    """The table named the judging runs: 8 that would decide, of which fourteen runs had been flown."""

    def judges(runs):
        flown = [SimpleNamespace(run=run) for run in range(runs)]
        return len(running.split(flown, running.corners(runs))[1])

    runs = running.to_judge(held)
    assert judges(runs) >= held and (runs <= 4 or judges(runs - 1) < held)
    assert running.to_judge(8) == 20


def test_corner_runs_fly_both_ends_of_every_setting_of_camera_and_star_tracker(planned):
    """Two corner runs span what all but one run in a million draws; fifty of them are looked at."""
    plan, sampler = planned
    jobs = running.corner_jobs(plan, sampler)
    assert [job.run for job in jobs] == [0, 1] and running.corners(24) == 4 and running.corners(6) == 2
    assert running.corners(13) == 4 and running.corners(60) == 10
    pattern = Pattern(plan.source, plan.name)
    spans = running.spans([settings(pattern.with_draws(job.draws)) for job in jobs])
    paths = {".".join(one.path) for one in sampler.dispersed if one.path[0] == "star_camera"}
    assert set(spans) == paths and len(paths) == 7
    for name in spans:
        assert jobs[0].draws[name] != jobs[1].draws[name]
    for job, other in zip(jobs, (sampler.job(0), sampler.job(1)), strict=True):
        assert job.seed == other.seed
        same = {name for name, value in other.draws.items() if job.draws[name] == value}
        assert {name for name in other.draws if not name.startswith("star_camera")} <= same
    for run in range(100, 150):
        found = settings(pattern.with_draws(sampler.draws(run)))
        assert all(low <= found[path] <= high for path, (low, high) in spans.items())
    assert running.corner_jobs(plan, sampler) == jobs


def test_ends_of_listed_values_are_the_smallest_and_the_largest_and_words_have_none():
    for law in (laws.ChoiceLaw((250, 100, 500), (0.3, 0.6, 1.0)), laws.TableLaw((250, 100, 500, 300))):
        one = SimpleNamespace(name="x", group=None, law=law)
        assert [running._end(one, u, 0) for u in (running.RARE, 1.0 - running.RARE)] == [100, 500]
    words = SimpleNamespace(name="star_tracker.x", group=None, law=laws.ChoiceLaw(("a", "b"), (0.5, 1.0)))
    with pytest.raises(FitError, match=r"star_tracker\.x is dispersed over a, b"):
        running._end(words, running.RARE, 0)


def test_corner_runs_are_fitted_and_half_of_the_others_judges():
    flown = [Flown(run, None, {}, "") for run in range(12) if run != 6]  # one failed
    fitted, held = running.split(flown, 2)
    assert [one.run for one in held] == [3, 5, 7, 9, 11]
    assert [one.run for one in fitted] == [0, 1, 2, 4, 8, 10]
    with pytest.raises(FitError, match=r"3 runs to fit and 0 to judge"):
        running.split(flown[:3], 2)


# ---- kept records ------------------------------------------------------------------------------------------


IMPOSSIBLE = {
    ("frames", "t_s"): (lambda a: a[::-1], "frames.t_s: expected times that increase"),
    ("frames", "rate"): (lambda a: -a, "frames.rate: got -.*, expected none below 0"),
    ("frames", "reason"): (lambda a: a + 9, "frames.reason: got .*, expected 0 to 8"),
    ("frames", "stars"): (lambda a: a * 1.0, "frames.stars: got float64, expected whole numbers"),
    ("frames", "sigma"): (lambda a: a[:, :2], "frames.sigma: got an array of 4 x 2, expected 4 x 3"),
    ("frames", "level_dn"): (lambda a: a * np.nan, "frames.level_dn: got nan, expected numbers below"),
    ("sources", "frame"): (lambda a: a + 4, "sources.frame: got .*, expected a row of 4 frames"),
    ("sources", "q"): (lambda a: a * 1e300, "sources.q: got .*, expected numbers below"),
    ("sources", "found"): (lambda a: a * 1, "sources.found: got int64, expected flags"),
    ("searches", "error"): (lambda a: a[:3], "searches.error: got an array of 3 x 3, expected 4 x 3"),
    ("searches", "good"): (lambda a: a[0], "searches.good: got an array of a single number, expected 4"),
}


@pytest.mark.parametrize("part, name", IMPOSSIBLE)
def test_a_run_that_cannot_be_is_told_with_its_file_and_array(planned, tmp_path, part, name):
    folder, one = Records(tmp_path / "runs", planned[0]), flown()
    change, words = IMPOSSIBLE[part, name]
    columns = getattr(one.collected, part)
    spoilt = columns._replace(**{name: change(getattr(columns, name))})
    folder.keep(one._replace(collected=one.collected._replace(**{part: spoilt})))
    with pytest.raises(RecordsError, match=rf"000003\.npz: {words}.*; take the file away, and the run is"):
        folder.read(3)


def test_records_are_read_as_they_were_written(planned, tmp_path):
    plan, _ = planned
    folder, one = Records(tmp_path / "runs", plan), flown()
    folder.keep(one)
    again = Records(tmp_path / "runs", plan).read(3)
    assert (again.run, again.settings, again.code) == (3, one.settings, one.code)
    for part, other in zip(one.collected, again.collected, strict=True):
        for a, b in zip(part, other, strict=True):
            np.testing.assert_array_equal(a, b)
    assert folder.read(4) is None
    whole = (tmp_path / "runs" / "000003.npz").read_bytes()
    for broken in (whole[: len(whole) // 2], b"", b"nonsense"):  # of a power failure: flown again
        (tmp_path / "runs" / "000003.npz").write_bytes(broken)
        assert folder.read(3) is None


def test_records_of_something_else_are_refused(planned, tmp_path):
    plan, _ = planned
    Records(tmp_path / "runs", plan)
    for other, words in (
        (plan._replace(seed=6), "of another seed: 5, now 6"),
        (plan._replace(runs=13), "of another number of runs: 12, now 13"),
        (plan._replace(source=plan.source + "\n"), "of another scenario"),
        (
            plan._replace(versions=plan.versions | {"numpy": "1.0"}),
            "of another version of numpy: .*, now 1.0",
        ),
    ):
        with pytest.raises(RecordsError, match=words):
            Records(tmp_path / "runs", other)
    Records(tmp_path / "runs", plan._replace(versions=plan.versions | {"code": "other"}))  # fits may change
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("keep me")
    with pytest.raises(RecordsError, match="has something else in it"):
        Records(tmp_path / "mine", plan)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["letter.txt"]
    (tmp_path / "runs" / "characterise.json").write_text("[1]")
    with pytest.raises(RecordsError, match="cannot be read"):
        Records(tmp_path / "runs", plan)


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("shefex2_dispersed", ["--runs", "5"], "must be at least 6"),
        (
            "shefex2_dispersed",
            ["--runs", "6", "--set", "star_tracker.enabled=false"],
            "star_tracker.enabled is false",
        ),
        ("shefex2_dispersed", ["--runs", "6", "--records", "nowhere/runs"], "there is no folder nowhere"),
        ("shefex2_aps_rolling", ["--runs", "6"], "are of a global shutter"),
    ],
)
def test_what_cannot_be_characterised_is_said_before_anything_is_flown(tmp_path, name, arguments, words):
    out, scenario = tmp_path / "model.json", str(CAMPAIGN.with_name(f"{name}.yaml"))
    done = CliRunner().invoke(app, ["characterise", scenario, "--out", str(out), *arguments])
    assert done.exit_code == 2 and not out.exists()
    assert words in " ".join(done.output.replace("│", " ").split()), done.output


def test_a_file_that_is_there_stays(tmp_path):
    out = tmp_path / "model.json"
    out.write_text(json.dumps({"mine": 1}))
    done = CliRunner().invoke(app, ["characterise", str(CAMPAIGN), "--out", str(out), "--runs", "6"])
    assert done.exit_code == 2 and json.loads(out.read_text()) == {"mine": 1}
