"""`report DIR`: the object for programs, the tables for people, the pictures."""

import json
import re

import keeping
import numpy as np
import pytest
import synthetic_campaign
from typer.testing import CliRunner

from shefex_nav.campaign import figures, over_time, parts, statistics, summary, verdicts
from shefex_nav.campaign.engine import Lost
from shefex_nav.campaign.results import open_campaign
from shefex_nav.campaign.store import Store
from shefex_nav.commands.app import app
from shefex_nav.report import requirements
from shefex_nav.scenario import load

N = 60
KEYS = {"runs", "asked", "lost", "succeeded", "failed", "requirements", "wall_s", "results_digest"}
KEYS |= {"integrity", "version", "scenario", "seed"}
REQUIREMENT_KEYS = {"name", "limit", "unit", "passed", "of", "ci95", "verification"}
VERIFICATION_KEYS = {"verdict", "probability", "confidence", "runs", "missed", "least", "most", "more"}
VERIFICATION_KEYS |= {"more_at_rate", "looks", "finished", "flown_on_from"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return synthetic_campaign.write(tmp_path_factory.mktemp("campaign") / "one", N, seed=3, breaks=True)


@pytest.fixture(scope="module")
def said(folder):
    return CliRunner().invoke(app, ["report", str(folder)])


def test_the_object_has_exactly_its_keys(folder):
    result = CliRunner().invoke(app, ["report", str(folder), "--json"])
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    campaign = open_campaign(folder)
    assert found.keys() == KEYS
    assert (found["runs"], found["wall_s"]) == (N, 123.0)
    assert found["failed"] == len(campaign.failures()) > 0
    assert found["succeeded"] + found["failed"] == N
    assert found["results_digest"] == campaign.digest and len(found["results_digest"]) == 64
    assert [one["name"] for one in found["requirements"]] == list(campaign.limits)
    for one in found["requirements"]:
        assert one.keys() == REQUIREMENT_KEYS and one["verification"].keys() == VERIFICATION_KEYS
        assert 0 <= one["passed"] <= one["of"] == found["succeeded"]
        assert one["ci95"][0] <= one["passed"] / one["of"] <= one["ci95"][1]
    assert found["requirements"][0]["unit"] == "deg"
    assert [one["quantity"] for one in found["integrity"]] == ["position", "velocity", "attitude"]


def test_the_tables_name_the_cause_of_failures_and_how_to_look_at_them(folder, said):
    assert said.exit_code == 0, said.output
    campaign = open_campaign(folder)
    (cause,) = campaign.causes()
    assert f"{len(cause.runs)} runs ({cause.runs[0]}, " in said.stdout
    assert "kg is more than the thrust can lift" in said.stdout
    assert f"shefex-nav repeat {folder} {cause.runs[0]} --log run{cause.runs[0]}.mcap\n" in said.stdout
    assert "Failed runs drew vehicle.payload.mass from 49" in said.stdout


def test_the_tables_have_every_part(said):
    for part in (
        "flew to their end", "attitude at entry", "at most 0.17 deg", "95 % interval", "frames of the window",
        "95 % ellipse at apogee", "inside 3 sigma", "NEES of attitude", "The worst runs",
        "rank correlation",
    ):  # fmt: skip
        assert part in said.stdout, part


@pytest.mark.slow
def test_warnings_of_the_programme_are_counted_over_the_runs(tmp_path):
    """Like but for their numbers, each run once; a campaign without any says nothing."""
    folder = synthetic_campaign.write(tmp_path / "warned", 12, seed=3)
    title = "The scenario does not fit the flight"
    assert title not in CliRunner().invoke(app, ["report", str(folder)]).stdout
    late, gas = "until", "propellant"
    for run in (2, 5, 9):
        text = f"384 s is {run}.1 s after the entry at T+38{run}.9 s: cold gas steers against the air"
        warnings = [{"field": "programme.entry_slew.until", "text": text}] * 2
        warnings.append(warnings[0] | {"text": text.replace("384 s", "385 s")})  # of another number
        if run == 5:
            warnings.append({"field": "vehicle.cold_gas.propellant", "text": "used up"})
        keeping.change(folder, run, lambda record, said=warnings: record["summary"].update(warnings=said))
    campaign = open_campaign(folder)
    found = {cause.words.partition(":")[0].rpartition(".")[2]: cause.runs for cause in campaign.warnings()}
    assert found == {late: (2, 5, 9), gas: (5,)}
    assert campaign.warnings()[0].words.startswith("programme.entry_slew.until: 384 s is 2.1 s after")
    page = tmp_path / "page.html"
    said = CliRunner().invoke(app, ["report", str(folder), "--html", str(page)]).stdout
    assert title in said and "3 of 12 runs (2, 5, 9), with the numbers of run 2: programme.entry" in said
    assert "1 of 12 runs (5): vehicle.cold_gas.propellant: used up" in said
    assert title in page.read_text() and "3 of 12 runs (2, 5, 9)" in page.read_text()


def test_an_unfinished_campaign_says_so(tmp_path):
    folder = synthetic_campaign.write(tmp_path / "c", 4)
    head = json.loads((folder / "campaign.json").read_text())
    (folder / "campaign.json").write_text(json.dumps(head | {"runs": 9}))
    result = CliRunner().invoke(app, ["report", str(folder)])
    assert result.exit_code == 0 and "4 of 9, the campaign is not finished" in result.stdout
    with Store(folder) as store:
        store.runs.lose(Lost(7, "its worker was killed", deadly=True))
    result = CliRunner().invoke(app, ["report", str(folder)])
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert "run 7 was lost its worker was killed" in lines


def test_a_campaign_of_failures_alone_is_told(tmp_path):
    folder = synthetic_campaign.write(tmp_path / "c", 2, with_series=False)
    failed = {"status": "failed", "reason": "FlightError: no", "summary": {}}
    for run in range(2):
        keeping.change(folder, run, lambda record: record.update(failed))
    result = CliRunner().invoke(app, ["report", str(folder)])
    assert result.exit_code == 0 and "FlightError: no" in result.stdout
    result = CliRunner().invoke(app, ["report", str(folder), "--json"])
    assert {one["ci95"] for one in json.loads(result.stdout)["requirements"]} == {None}


@pytest.mark.parametrize("kind", ["empty", "no folder above"])
def test_bad_input_is_one_message(tmp_path, folder, kind):
    arguments = ["report", str(tmp_path)]
    if kind != "empty":
        (tmp_path / "file").write_text("")
        arguments = ["report", str(folder), "--figures", str(tmp_path / "file" / "x")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2 and "Traceback" not in result.output
    assert (
        "campaign.json" if kind == "empty" else "is a file; give the name of a folder"
    ) in result.output.replace("\n", "")


@pytest.mark.slow
def test_pictures_are_drawn_of_all_that_there_is(folder, tmp_path):
    result = CliRunner().invoke(app, ["report", str(folder), "--json", "--figures", str(tmp_path / "f")])
    assert result.exit_code == 0, result.output
    written = {path.name for path in (tmp_path / "f").iterdir()}
    expected = {"errors", "nees", "containment", "ellipses", "convergence", "sensitivity"}
    assert written == {f"{name}.png" for name in expected}
    assert all(path.stat().st_size > 10_000 for path in (tmp_path / "f").iterdir())


@pytest.fixture
def errors_alone(monkeypatch):
    """One picture, errors.png, is drawn in place of all."""
    monkeypatch.setattr(figures, "OF_SERIES", {"errors": figures.draw_errors})
    monkeypatch.setattr(figures, "OF_RESULTS", {})


def test_the_worst_runs_are_those_that_miss_most(folder):
    campaign = open_campaign(folder)
    worst = summary.worst_runs(campaign, 5)
    assert len(worst) == 5 and [one.severity for one in worst] == sorted(
        (w.severity for w in worst), reverse=True
    )
    missed = (~campaign.judgements.passed).sum(axis=1)
    runs = campaign.runs[campaign.succeeded].tolist()
    assert missed[runs.index(worst[0].run)] == missed.max()
    judged = campaign.judged([worst[0].run])[worst[0].run]
    assert requirements.severity(judged) == worst[0].severity
    for one in worst:
        is_met = campaign.judgements.passed[runs.index(one.run)].all()
        assert one.words.startswith("meets all requirements; nearest" if is_met else "misses ")
        assert ", wanted at " in one.words


def test_without_requirements_the_worst_runs_have_the_largest_errors(tmp_path):
    source = load.load(synthetic_campaign.SCENARIO, ["requirements=null"]).source
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "c", 8, source=source))
    rms_deg = {"summary.navigation.attitude_error_deg.rms": np.array([3.0, 1, 4, 1, 5, 9, 2, 6])}
    campaign.columns = dict(campaign.columns) | rms_deg
    assert [one.run for one in summary.worst_runs(campaign, 3)] == [5, 7, 4]
    (first,) = summary.worst_runs(campaign, 1)
    assert first.words == "attitude error 9 deg rms; the scenario requires nothing"


def test_a_wrong_covariance_is_in_the_tables(tmp_path):
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "c", 60, truth_over_sigma=1.4))
    found = parts.covariance(campaign, over_time.read(campaign))
    words = [str(cell) for row in found.rows for cell in row]
    assert "covariance too small" in words and "covariance too large" not in words
    assert {"  NEES of attitude, end of coast", "  NIS of gps, mean of the runs"} <= set(words)


def test_the_mean_nees_stands_beside_its_interval_and_what_it_should_be(folder):
    campaign = open_campaign(folder)
    rows = [row for row in parts.covariance(campaign, over_time.read(campaign)).rows if "all times" in row[0]]
    assert rows
    for _, found, expected, _, verdict in rows:
        value, low, high = map(float, re.fullmatch(r"([\d.]+) \(([\d.]+) to ([\d.]+)\)", found).groups())
        assert low <= value <= high and expected == "1"
        assert (verdict == "as chance would have it") == (low <= 1.0 <= high)


def test_places_south_and_west_have_no_signs(folder, monkeypatch):
    campaign = open_campaign(folder)
    (one, *_) = statistics.ellipses(campaign)
    there = one._replace(latitude_deg=-2.317, longitude_deg=-44.368)
    monkeypatch.setattr(statistics, "ellipses", lambda campaign: [there])
    (words,) = (row[1] for row in parts.flights(campaign).rows if "ellipse" in row[0])
    assert "about 2.317 S, 44.368 W;" in words


def test_the_page_has_everything_and_loads_nothing(folder, tmp_path):
    path = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["report", str(folder), "--json", "--html", str(path)])
    assert result.exit_code == 0, result.output
    page = path.read_text()
    for words in (
        "Campaign synthetic, seed 3", "attitude at entry", "more than the thrust can lift", "The worst runs",
        open_campaign(folder).digest, "figure-errors", "figure-sensitivity", "imu:",
    ):  # fmt: skip
        assert words in page, words
    assert "://" not in page and "<script" not in page
    again = CliRunner().invoke(app, ["report", str(folder), "--html", str(path)])
    assert again.exit_code == 2 and "exists already" in " ".join(again.output.split())


def test_rates_are_told_of_the_runs_that_flew_and_of_all(folder, said, tmp_path):
    """A requirement that every run met which flew to its end was not met by those that failed."""
    campaign = open_campaign(folder)
    n, failed = len(campaign), len(campaign.failures())
    part = parts.requirements(campaign)
    assert part.heads[-1] == f">of all {n} runs" and f"the {failed} that failed" in part.lines[0]
    for row in part.rows:
        passed, of = int(row[2].split()[0]), int(row[3])
        assert of == n - failed and row[-1] == f"{100.0 * passed / n:.1f} %"
    assert f"of all {n} runs" in said.stdout
    good = open_campaign(synthetic_campaign.write(tmp_path / "good", 5, with_series=False))
    assert "of all" not in " ".join(parts.requirements(good).heads)


def test_percentiles_say_of_how_many_runs_they_are(folder, tmp_path):
    """Runs that failed have no error: those of the others are not those of all."""
    campaign = open_campaign(folder)
    part, good = parts.errors(campaign), str(int(campaign.succeeded.sum()))
    assert part.heads[2] == ">runs" and {row[2] for row in part.rows} == {good} != {str(N)}
    assert part.lines[1] == f"Of all errors there are fewer than {N} runs: the others failed, or have none."
    whole = parts.errors(open_campaign(synthetic_campaign.write(tmp_path / "c", 5, with_series=False)))
    assert {row[2] for row in whole.rows} == {"5"} and len(whole.lines) == 1


def test_what_cannot_be_judged_is_not_drawn_as_missed(folder):
    campaign = open_campaign(folder)
    titles = [axis.get_title(loc="left") for axis in figures.draw_convergence(campaign).axes]
    found = campaign.judgements
    unjudged = found.judgeable & (np.array(found.names) != "misleading")
    campaign.__dict__["judgements"] = found._replace(judgeable=unjudged)
    fewer = [axis.get_title(loc="left") for axis in figures.draw_convergence(campaign).axes]
    assert set(titles) - set(fewer) == {"misleading: share of runs"}


def test_verdicts_of_one_flight_say_so(folder):
    campaign = open_campaign(folder)
    words = "All runs have one and the same flight: what is shown is shown of this flight alone."
    assert words not in verdicts.part(campaign).lines
    campaign.head["flight"] = "shared"
    assert words in verdicts.part(campaign).lines


def test_pictures_are_not_overwritten_unless_that_is_asked_for(folder, tmp_path, errors_alone):
    mine = tmp_path / "errors.png"
    mine.write_bytes(b"mine")
    arguments = ["report", str(folder), "--json", "--figures", str(tmp_path)]
    refused = CliRunner().invoke(app, arguments)
    words = " ".join(refused.output.replace("│", " ").split())
    assert refused.exit_code == 2 and "exists already; choose another folder or add --force" in words
    assert mine.read_bytes() == b"mine"
    assert CliRunner().invoke(app, [*arguments, "--force"]).exit_code == 0
    assert mine.stat().st_size > 10_000


def test_pictures_of_another_campaign_are_not_left_among_those_of_this(folder, tmp_path, errors_alone):
    for name in ("errors", "sensitivity"):
        (tmp_path / f"{name}.png").write_bytes(b"of another")
    arguments = ["report", str(folder), "--json", "--figures", str(tmp_path), "--force"]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["errors.png"]


def test_other_files_in_the_folder_of_pictures_are_in_nobodys_way(folder, tmp_path, errors_alone):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "trajectory.png").write_bytes(b"of a run, not of a campaign")
    result = CliRunner().invoke(app, ["report", str(folder), "--json", "--figures", str(tmp_path)])
    assert result.exit_code == 0 and (tmp_path / "errors.png").exists(), result.output
    assert (tmp_path / "trajectory.png").read_bytes() == b"of a run, not of a campaign"


@pytest.mark.parametrize("what", ["a folder without a campaign", "a log that is not there"])
def test_no_folder_is_made_for_pictures_of_nothing(tmp_path, what):
    of = tmp_path if what == "a folder without a campaign" else tmp_path / "none.mcap"
    result = CliRunner().invoke(app, ["report", str(of), "--figures", str(tmp_path / "a" / "b")])
    assert result.exit_code != 0 and not (tmp_path / "a").exists(), result.output


def test_nothing_certain_is_not_said_to_be_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(parts.sensitivity, "SIGNIFICANT", 0.0)
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "few", 9, with_series=False))
    (line,) = parts.explained(campaign).lines
    assert line.startswith("None is certain: ") and "9 runs" in line
