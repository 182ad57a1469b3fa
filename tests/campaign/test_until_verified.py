"""Campaigns that fly until each requirement passes or fails, and what is said of those that do not."""

import json
import subprocess
import sys
import time

import keeping
import numpy as np
import pytest
from short_campaign import HereLane, Show, fly, request, write
from synthetic_campaign import write as write_synthetic
from typer.testing import CliRunner

import shefex_nav
from shefex_nav.campaign import (
    engine,
    looks,
    page,
    results,
    running,
    store,
    summary,
    tolerance,
    until,
    verdicts,
)
from shefex_nav.campaign import head as heads
from shefex_nav.commands.app import app
from shefex_nav.scenario import load

EASY = ["requirements.probability=60 %", "requirements.confidence=60 %"]
STATED = 0.6, 0.6
PATIENCE_S = 300.0  # on a machine with much else to do
REQUIRED = "requirements: {misleading: 0 %, usable_at_entry: true}\n"  # at rest: met, and never


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """The short mission, with something to verify."""
    return load.load(write(tmp_path_factory.mktemp("scenario"), REQUIRED), EASY)


def verified(scenario, folder, runs=None, stopped=lambda: False, before=lambda job: None, say=lambda t: None):
    """The campaign in this process. -> until.Flown"""
    wanted = until.checked(request(scenario, runs))
    with store.Store(folder) as kept:
        return until.fly(wanted, kept, Show(say), stopped, lambda plan, count: [HereLane(plan, before)])


def test_it_flies_to_the_look_that_decides(scenario, tmp_path):
    said, flown = [], []
    found = verified(scenario, tmp_path, before=lambda job: flown.append(job.run), say=said.append)
    decided = {one.name: one for one in found.verdicts}
    passes = next(look for look in looks.each(*STATED) if look.passes is not None)
    fails = next(look for look in looks.each(*STATED) if look.fails is not None and look.fails <= look.runs)
    assert decided["misleading"][1:2] == ("pass",) and decided["misleading"].runs == passes.runs
    assert decided["usable_at_entry"].verdict == "fail" and decided["usable_at_entry"].runs == fails.runs
    assert sorted(flown) == list(range(max(passes.runs, fails.runs)))
    assert found.next_look is None and not found.all_pass
    assert said[-1] == f"{found.asked} runs: 1 pass, 1 fail"
    again = verified(scenario, tmp_path, before=lambda job: pytest.fail("nothing is flown again"))
    assert again.verdicts == found.verdicts and again.ended.digest == found.ended.digest


def breaking(folder, fail, runs):
    """The short mission, of which certain runs break before they begin: these meet nothing."""
    steps = [0.06 if run in fail else 0.02 for run in range(runs)]  # the second is longer than the longest
    (folder / "step.csv").write_text("\n".join(["step_s", *map(str, steps)]) + "\n")
    table = "  star_tracker.exposure.start: {table: {file: step.csv, column: step_s, unit: s}}\n"
    met = "requirements: {misleading: 0 %}\n"
    return load.load(write(folder, table + met), [*EASY, "star_tracker.exposure.shortest=10 ms"])


def test_runs_that_break_count_and_the_first_look_that_decides_does(tmp_path):
    """1 of 4 and 2 of 6 runs miss, which decides nothing; 2 of 9 pass, though 3 of 15 are known."""
    assert [look[:2] for look in looks.until(*STATED, 9)] == [(4, 0), (6, 1), (9, 2)]
    scenario = breaking(tmp_path, fail=(1, 4, 9), runs=15)
    fly(scenario, tmp_path / "kept", 5)
    found = verified(scenario, tmp_path / "kept")
    (one,) = found.verdicts
    assert (one.verdict, one.runs, one.missed, one.looks) == ("pass", 9, 2, 3)
    assert found.all_pass and found.asked == found.ended.done == 9
    fly(scenario, tmp_path / "kept", 15)
    assert results.open_campaign(tmp_path / "kept").verdicts == [one]


@pytest.mark.parametrize("last", [3, 4, 8])
def test_a_session_that_dies_changes_no_verdict(last, tmp_path):
    """Killed in any leg, at its end too, then the same command: what is flown and decided is the same."""
    scenario = breaking(tmp_path, fail=(1, 4), runs=15)

    def die(job):
        if job.run == last:
            raise SystemError("killed")

    with pytest.raises(SystemError):
        verified(scenario, tmp_path / "killed", before=die)
    assert heads.read_head(tmp_path / "killed")["until_verified"] is True
    found = verified(scenario, tmp_path / "killed")
    (one,) = found.verdicts
    assert (one.verdict, one.runs, one.missed, one.looks) == ("pass", 9, 2, 3)
    assert found.ended.done == 9


def test_a_maximum_leaves_it_undecided_and_a_larger_one_goes_on(tmp_path):
    """The maximum is no part of the rule: what is decided later is what would have been."""
    scenario = breaking(tmp_path, fail=(1, 4, 7), runs=16)
    first = verified(scenario, tmp_path / "kept", runs=8)
    assert (first.verdicts[0].verdict, first.asked, first.next_look) == ("more runs needed", 6, 9)
    assert first.verdicts[0].more == 3 and not first.all_pass
    second = verified(scenario, tmp_path / "kept", runs=14)
    assert (second.asked, second.next_look) == (9, 15)
    at_rate = next(look.runs for look in looks.until(*STATED, 500)[3:] if round(look.runs / 3) <= look.passes)
    assert (second.verdicts[0].more, second.verdicts[0].more_at_rate) == (6, at_rate - 9)  # 3 of 9
    third = verified(scenario, tmp_path / "kept")  # as many as the table has
    assert (third.verdicts[0].verdict, third.asked, third.next_look) == ("pass", 15, None)
    with pytest.raises(store.StoreError, match="asked for 15 runs, --runs 9 would take some away"):
        verified(scenario, tmp_path / "kept", runs=9)


@pytest.mark.slow  # `test_campaign_processes` kills a campaign each time
def test_the_command_killed_and_given_again(tmp_path):
    """kill -9 in the middle of it: the same command comes to the verdict of the whole."""
    scenario = breaking(tmp_path, fail=(1, 4), runs=15)
    sets = [word for text in [*EASY, "star_tracker.exposure.shortest=10 ms"] for word in ("--set", text)]
    fixed = ("campaign", tmp_path / "short.yaml", *sets, "--until-verified", "--workers", 1, "--json")
    command = [str(word) for word in (sys.executable, "-m", "shefex_nav", *fixed, "--out", tmp_path / "kept")]
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + PATIENCE_S
    while keeping.done(tmp_path / "kept") < 5:  # in the second leg
        assert first.poll() is None and time.monotonic() < end
        time.sleep(0.02)
    first.kill()
    first.wait()
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    (one,) = told["requirements"]
    assert (told["runs"], told["asked"], told["failed"]) == (9, 9, 2)
    kept = one["verification"]
    assert (kept["verdict"], kept["runs"], kept["missed"], kept["looks"]) == ("pass", 9, 2, 3)
    assert told["results_digest"] == verified(scenario, tmp_path / "whole").ended.digest


def test_interrupted_it_goes_on(scenario, tmp_path):
    answers = iter([False, True])
    first = verified(scenario, tmp_path / "one", stopped=lambda: next(answers, True))
    assert first.ended.interrupted
    whole = verified(scenario, tmp_path / "two")
    assert verified(scenario, tmp_path / "one").verdicts == whole.verdicts


def test_a_look_waits_for_a_run_that_was_lost(scenario, tmp_path):
    """Its worker is killed: the run is no sample, and the look is not taken without it."""

    class Deadly(HereLane):
        def submit(self, job):
            future = super().submit(job)
            if job.run == 0:
                future = type(future)()
                future.set_exception(engine.BrokenExecutor("gone"))
            return future

    wanted = until.checked(request(scenario, None))
    with store.Store(tmp_path) as kept:
        flown = until.fly(wanted, kept, Show(str), crew=lambda plan, n: [Deadly(plan)])
    assert [one.run for one in flown.ended.lost] == [0]
    assert {one.verdict for one in flown.verdicts} == {"more runs needed"}
    assert {(one.runs, one.looks) for one in flown.verdicts} == {(0, 0)}
    assert verified(scenario, tmp_path).verdicts == verified(scenario, tmp_path / "whole").verdicts


def test_runs_that_gave_no_answer_do_not_meet_a_requirement(tmp_path):
    """Failed runs count; lost ones do not. The same of a synthetic campaign, by hand."""
    folder = write_synthetic(tmp_path / "made", 60, breaks=True, with_series=False)
    campaign = results.open_campaign(folder)
    failed = int((~campaign.succeeded).sum())
    assert failed > 0
    for one, success in zip(campaign.verdicts, results_successes(campaign), strict=True):
        assert one.runs == 60 and one.missed == 60 - success.passed >= failed
        assert (one.least, one.most) == tolerance.bounds(one.missed, 60, 0.9)
    told = summary.summary_object(campaign)["requirements"][0]["verification"]
    assert told["verdict"] == "fail" and (told["probability"], told["confidence"]) == (0.99865, 0.9)
    assert json.loads(json.dumps(told)) == told


def results_successes(campaign):
    from shefex_nav.campaign import statistics

    return statistics.successes(campaign)


def table_of(campaign):
    """{requirement: row} and the lines of the table of verdicts."""
    part = verdicts.part(campaign)
    assert part.title == "Is each requirement met in 99.865 % of the flights, at 90 % confidence?"
    return {row[0]: row[1:] for row in part.rows}, part.lines


def test_a_table_that_says_how_many_runs_more(tmp_path):
    folder = write_synthetic(tmp_path / "made", 60, with_series=False)
    rows, lines = table_of(results.open_campaign(folder))
    assert rows["misleading"] == ("1,645 more runs needed", "60", "0", "96.235 %", "100.000 %", "1,645")
    assert any(line.startswith("More runs needed: until it passes") for line in lines)
    assert "1,645 more runs needed" in str(page.content(verdicts.part(results.open_campaign(folder))))
    folder = write_synthetic(tmp_path / "at looks", 60, with_series=False, until_verified=True)
    rows, lines = table_of(results.open_campaign(folder))
    assert rows["misleading"][0] == f"{2218 - 60:,} more runs needed"
    assert any(line.startswith("Looks were after 35, the next is after 70 runs") for line in lines)


def test_a_campaign_that_was_flown_on_says_so(tmp_path):
    """Only if its verdict was possible before."""
    easy = {"until_verified": False}
    folder = write_synthetic(tmp_path / "made", 60, with_series=False, **easy)
    head = json.loads((folder / "campaign.json").read_text())

    def told(before):
        (folder / "campaign.json").write_text(json.dumps(head | {"asked_before": before}))
        campaign = results.open_campaign(folder)
        found = [one._replace(verdict=verdicts.PASS) for one in campaign.verdicts]
        return verdicts.looked_at_before(campaign, found)

    assert told([300]) == [] and told([300, 1705]) == [1705] and told([]) == []


def test_smaller_numbers_of_runs_are_remembered(scenario, tmp_path):
    for runs in (2, 3, 3, 4):
        fly(scenario, tmp_path, runs)
    head = heads.read_head(tmp_path)
    assert head["asked_before"] == [2, 3] and head["until_verified"] is False


def test_a_campaign_of_a_settled_number_can_go_on_look_by_look(scenario, tmp_path):
    """It stays one that is judged at looks, whoever flies more of it."""
    whole = verified(scenario, tmp_path / "whole")
    fly(scenario, tmp_path / "other", 2)
    assert verified(scenario, tmp_path / "other").verdicts == whole.verdicts
    fly(scenario, tmp_path / "other", whole.asked + 1)
    assert tuple(results.open_campaign(tmp_path / "other").verdicts) == whole.verdicts
    assert heads.read_head(tmp_path / "other")["asked_before"] == [2]
    assert heads.read_head(tmp_path / "whole")["asked_before"] == []
    lines = verdicts.part(results.open_campaign(tmp_path / "other")).lines
    assert any(line.startswith("The campaign was flown on from 2 runs") for line in lines)  # 2 could fail


@pytest.mark.parametrize(
    ("overrides", "runs", "words"),
    [
        (["requirements=null"], None, "the scenario requires nothing that could be verified"),
        (
            ["requirements.probability=99 %"],
            100,
            "100 runs: the first look that can show 99 % at 60 %",
        ),
        (
            ["campaign.sampling=latin_hypercube"],
            None,
            "latin_hypercube settles the number of runs before",
        ),
        ([], 0, "runs: 0; expected a whole number, 1 or more"),
    ],
)
def test_what_cannot_be_verified_is_refused(overrides, runs, words, tmp_path):
    scenario = load.load(write(tmp_path, REQUIRED), [*EASY, *overrides])
    with pytest.raises(running.BadCampaign, match=words):
        until.checked(request(scenario, runs))


def test_the_command(scenario, tmp_path, monkeypatch):
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    path, out = write(tmp_path, REQUIRED), tmp_path / "out"
    sets = [word for text in EASY for word in ("--set", text)]
    fixed = ["campaign", str(path), *sets, "--until-verified", "--workers", "1", "--out", str(out), "--json"]
    done = CliRunner().invoke(app, fixed)
    assert done.exit_code == 1, done.output  # usable_at_entry is not met
    told = {one["name"]: one["verification"] for one in json.loads(done.stdout)["requirements"]}
    assert told["misleading"]["verdict"] == "pass" and told["usable_at_entry"]["verdict"] == "fail"
    fixed[fixed.index(str(out))] = str(tmp_path / "another")
    fixed += ["--keep", "worst:1"]
    met = CliRunner().invoke(app, [*fixed, "--set", "requirements.usable_at_entry=false"])
    assert met.exit_code == 0, met.output
    assert len(list((tmp_path / "another" / "logs").glob("*.mcap"))) == 1
    for more, words in (
        (["--sweep", "gps.rate=1 Hz,2 Hz"], "--until-verified: does not go with --sweep"),
        (["--dry-run"], "--runs: is missing"),
    ):
        refused = CliRunner().invoke(app, [*fixed[:-2], *more])
        assert refused.exit_code == 2 and words in refused.stderr, refused.output


def test_from_python(scenario, tmp_path, monkeypatch):
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    loaded = shefex_nav.Scenario.load(write(tmp_path, REQUIRED), EASY)
    known = {"folder": tmp_path / "kept", "workers": 1, "say": str}
    campaign = shefex_nav.fly_campaign(loaded, until_verified=True, **known)
    assert [one.verdict for one in campaign.verdicts] == ["fail", "pass"]
    with pytest.raises(running.BadCampaign, match="runs: None; expected a whole number"):
        shefex_nav.fly_campaign(loaded, **known)
    assert np.isfinite(campaign.verdicts[0].most)
