"""`shefex-nav verify consistency`: refusals, what is kept, and a short study against the runs themselves."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.scenario import load
from shefex_nav.verify import consistency, flown, linear, study
from shefex_nav.verify.flown import N_CORE, Run
from shefex_nav.verify.nees import Verdict

SCENARIOS = Path(__file__).parents[2] / "scenarios"
NIGHT = SCENARIOS / "night_sky.yaml"  # on the ground
BRIEFLY = "mission.time_limit=20 s", "star_tracker.off=20 s", "star_tracker.enabled=false"
SHORT = (NIGHT, *(word for one in BRIEFLY for word in ("--set", one)))


def command(*arguments):
    return CliRunner().invoke(app, ["verify", "consistency", *map(str, arguments)])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--seeds", 1), "seeds"),
        (("--histories", 10), "histories"),
        (("--out", "no/such.png"), "no folder no"),
        (("--out", "nees.pdf"), "has to end in .png or .svg"),
        (("--set", "navigation.stars=vectors"), "navigation.stars has to be 'attitude'"),
        (("--set", "navigation.stat=[]"), "navigation.stat"),
    ],
)
def test_bad_input_is_refused_before_anything_flies(arguments, words):
    done = command(SCENARIOS / "shefex2_andoya.yaml", *arguments)
    assert done.exit_code == 2
    assert words in done.output
    assert "Traceback" not in done.output


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "kept").write_text("")
    done = command(*SHORT, "--keep", tmp_path / "kept")
    assert done.exit_code == 2
    assert "kept is a file; give the name of a folder" in done.output


def test_a_short_study_is_that_of_its_runs(tmp_path):
    """Two seeds through a worker process, with what is kept, and by hand."""
    asked = "--seeds", 2, "--first", 5, "--histories", 100, "--workers", 1, "--keep", tmp_path, "--json"
    done = command(*SHORT, *asked)
    found = json.loads(done.stdout)
    assert done.exit_code == (0 if found["ok"] else 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fixes-0005.npz", "fixes-0006.npz"]
    assert done.stderr.count("of 3 done") == 3 and "first flight on a machine" not in done.stderr
    assert found["star_fixes_by"].startswith("scenario night_sky (")
    loaded = load.load(NIGHT, BRIEFLY)
    runs = [flown.filter_run(loaded, seed, []) for seed in (5, 6)]
    by_hand = {one.what: one for one in consistency.judge_nis(runs) + consistency.judge_containment(runs)}
    assert set(by_hand) < {one["what"] for one in found["statistics"]}
    for one in found["statistics"]:
        assert one["inside"] == (one["low"] <= one["value"] <= one["high"]) and one["samples"] >= 2
        if one["what"] in by_hand:
            assert one == by_hand[one["what"]]._asdict() | {"inside": by_hand[one["what"]].good}
    nees = {one["what"]: one for one in found["statistics"] if one["what"].startswith("NEES")}
    means = np.mean([consistency.averages(run)["velocity", 1] for run in runs]) / 3.0
    assert nees["NEES velocity, coast without stars, one field"]["value"] == pytest.approx(means)
    assert len(nees) == 5 and 0.0 < found["histories_apart"] < 0.05


def test_fixes_of_another_scenario_of_the_same_name_are_refused(tmp_path):
    """What is in the file counts, not how it is called."""
    one, other = (
        study.of_scenario(load.load(NIGHT, (*BRIEFLY, f"gps.range_noise={error} m")), str(tmp_path))
        for error in (1.5, 1.6)
    )
    assert study.fixes_of(one, 3) == [] and one.path(3).exists()
    assert study.fixes_of(one, 3) == []
    with pytest.raises(
        flown.FlownError, match=r"fixes-0003\.npz: its star fixes are those of scenario night"
    ):
        study.fixes_of(other, 3)


def made_up(factor):
    """Runs of known statistics whose covariance is wrong by a factor, and their histories."""
    rng, times_s, steps = np.random.default_rng(3), 0.5 * np.arange(1, 61), []
    for t_s in times_s:
        steps.append(linear.Interval(t_s, 0.99 * np.eye(N_CORE), 0.02 * np.eye(N_CORE)))
    outputs = list(linear.outputs(np.eye(N_CORE), steps, times_s, rng=rng, number=20))
    P, errors = np.array([one.P for one in outputs]), np.array([one.errors for one in outputs])
    phase, extra = np.zeros(60, dtype=int), consistency.Extra(np.zeros(60), np.zeros(60), 0.0)
    nis, dof = rng.chisquare(3, (20, 40)), {"gps": np.full(40, 3)}
    runs = [
        Run(k, times_s, phase, errors[:, :, k], factor * P, {"gps": nis[k]}, dof, {"gps": 1})
        for k in range(20)
    ]
    return runs, consistency.simulate(np.eye(N_CORE), steps, times_s, phase, extra, number=300, rng=rng)


@pytest.mark.parametrize(("factor", "code"), [(1.0, 0), (0.1, 1)])
def test_a_filter_that_says_too_little_ends_with_one(monkeypatch, tmp_path, factor, code):
    """Errors three times as large as they are said to be: named, marked, and drawn."""
    runs, histories = made_up(factor)
    verdicts = consistency.judge(runs, histories, np.random.default_rng(0))
    monkeypatch.setattr(study, "run", lambda *asked, **how: study.Found(runs, verdicts, 0.01))
    done = command(*SHORT, "--out", tmp_path / "nees.svg")
    assert done.exit_code == code
    assert done.stdout.count("too large") == (5 if code else 0)
    assert ("outside: NEES attitude, boost" in done.stderr) == bool(code)
    assert "gps: 20 of 800 refused by the gate" in done.stdout
    assert (tmp_path / "nees.svg").stat().st_size > 10000
    assert command(*SHORT, "--json").exit_code == code


def test_containment_is_shown_by_phases_and_where_it_fails():
    inside = [Verdict(f"3 sigma velocity {a}, end of boost", 1.0, 0.9, 1.0, 50) for a in "xy"]
    outside = Verdict("3 sigma velocity z, end of boost", 0.8, 0.9, 1.0, 50)
    nees = Verdict("NEES velocity, boost, one field", 1.0, 0.9, 1.1, 50)
    shown = study.rows([nees, *inside, outside])
    assert [words for words, _ in shown] == [
        "NEES velocity, boost", outside.what, "least share inside 3 sigma of 3 errors, end of boost",
    ]  # fmt: skip
    assert shown[2][1] is outside


@pytest.mark.parametrize(
    ("keep", "words"), [(False, "--keep FOLDER would"), (True, "of 1 of 3 seeds are kept")]
)
def test_an_interruption_says_what_is_kept(monkeypatch, tmp_path, keep, words):
    def stopped(asked, *_, **how):
        study.fixes_of(asked, 4)
        raise KeyboardInterrupt

    monkeypatch.setattr(study, "run", stopped)
    done = command(*SHORT, "--seeds", 3, "--first", 3, *(("--keep", tmp_path) if keep else ()))
    assert done.exit_code == 130
    assert words in done.stderr


def test_results_of_workers_come_in_the_order_of_the_calls():
    told = []
    found = study.in_workers({k: (str.upper, k) for k in "cab"}, 2, told.append)
    assert list(found.items()) == [("c", "C"), ("a", "A"), ("b", "B")]
    assert sorted(told) == ["a", "b", "c"]
    with pytest.raises(flown.FlownError, match="a worker process was killed"):
        study.in_workers({"one": (os._exit, 3)}, 1)
