"""Campaigns in one process: what is kept, resumed, refused, counted. Missions of two seconds at rest."""

import csv
import json
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import keeping
import numpy as np
import pyarrow.parquet
import pytest
from short_campaign import BREAKS, HereLane, fly, write
from typer.testing import CliRunner

from shefex_nav.campaign import (
    draws,
    engine,
    flight,
    repeating,
    results,
    running,
    sensitivity,
    store,
    summary,
    table,
)
from shefex_nav.campaign import head as heads
from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.flight import Pilot
from shefex_nav.clock import TICK_HZ
from shefex_nav.commands.app import app
from shefex_nav.log import reader, thinning
from shefex_nav.report import metrics
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.scenario import load

RUNS = 4


def test_every_run_is_a_row_with_its_draws(whole, scenario):
    folder, ended = whole
    rows = keeping.rows(folder)
    assert [row["run"] for row in rows] == list(range(RUNS))
    assert {row["status"] for row in rows} == {"succeeded"}
    assert not ended.interrupted and ended.digest == table.digest(rows)
    _, sampler = running.prepared(scenario, RUNS, 1)
    for run, row in enumerate(rows):
        job = sampler.job(run)
        assert row["seed"] == job.seed
        assert {name: row[f"draw.{name}"] for name in job.draws} == job.draws
    errors = [row["summary.navigation.position_error_m.rms"] for row in rows]
    assert len(set(errors)) == RUNS and max(errors) < 100.0


def test_series_of_a_run_are_its_errors(whole, scenario):
    """Against the same mission flown with a log: errors, sigmas, NEES and NIS at every half second."""
    folder, _ = whole
    found = keeping.series(folder, 2)
    log = folder / "two.mcap"
    assert repeating.repeat(folder, 2, log, lane=HereLane).same
    data = reader.read(log)
    log.unlink()
    errors = navigation_errors(data)
    assert found["t_s"] == pytest.approx([0.5, 1.0, 1.5, 2.0])
    k = np.searchsorted(errors.t_s, found["t_s"] - 1e-6)
    assert found["position_error_i"] == pytest.approx(errors.position_i[k], abs=1e-9)
    assert found["attitude_error_b"] == pytest.approx(errors.attitude_b[k], abs=1e-12)
    j = np.searchsorted(data.covariance.t_s, found["t_s"] - 1e-6)
    P = data.covariance.P[j]
    for column, place, name in (
        (0, 6, "attitude_error_b"),
        (1, 3, "velocity_error_i"),
        (2, 0, "position_error_i"),
    ):
        block = slice(place, place + 3)
        expected = [e @ np.linalg.solve(M, e) for e, M in zip(found[name], P[:, block, block], strict=True)]
        assert found["nees"][:, column] == pytest.approx(expected, rel=1e-6)
    gates = [gate for gate in data.gates if gate.sensor == "gps_position" and gate.dof > 0]
    assert found["nis_sum.gps_position"].sum() == pytest.approx(sum(gate.nis for gate in gates))
    assert found["nis_dof.gps_position"].sum() == sum(gate.dof for gate in gates) == 3 * len(gates) > 0
    assert len(keeping.content(folder, 2)) < 20_000


def test_true_biases_stand_in_the_series(whole, scenario):
    """Error plus estimate is the bias that was drawn: constant but for what changes in the run."""
    folder, _ = whole
    found = keeping.series(folder, 0)
    assert np.abs(found["gyro_bias_error"]).max() < 5.0 * found["gyro_bias_sigma"].max()
    assert 0.0 < np.abs(found["accel_bias_error"]).max() < 5.0 * found["accel_bias_sigma"].max()


class Backwards(HereLane):
    """Takes all runs and returns them in the reverse order."""

    capacity = RUNS


def test_order_of_completion_and_number_of_lanes_do_not_matter(whole, scenario, tmp_path):
    plan, sampler = running.prepared(scenario, RUNS, 1)
    jobs = [sampler.job(run) for run in reversed(range(RUNS))]
    with store.Store(tmp_path) as folder:
        folder.begin(plan, {})
        engine.fly(jobs, [HereLane(plan), Backwards(plan)], folder.keep)
        assert folder.tabulate().digest == whole[1].digest


def test_an_interrupted_campaign_goes_on_to_the_same_result(whole, scenario, tmp_path):
    looks = iter([False, False, True])
    first = fly(scenario, tmp_path, RUNS, stopped=lambda: next(looks))
    assert first.interrupted and 0 < first.done < RUNS
    assert {row["run"] for row in keeping.rows(tmp_path)} == store.Store(tmp_path).runs.done()
    flown = []
    second = fly(scenario, tmp_path, RUNS, before=lambda job: flown.append(job.run))
    assert len(flown) == RUNS - first.done
    assert second.digest == whole[1].digest
    assert second.wall_s > first.wall_s


def test_a_killed_session_leaves_what_it_took(scenario, tmp_path, monkeypatch):
    """Time and runs are entered as they come, so that a report divides the ones by the others."""
    monkeypatch.setattr(running, "BOOK_S", 0.0)

    def die(job):
        if job.run == 2:
            raise SystemError("killed")

    with pytest.raises(SystemError):
        fly(scenario, tmp_path, 3, before=die)
    head = heads.read_head(tmp_path)
    assert head["timed"]["runs"] == 2 and 0.0 < head["timed"]["wall_s"] < head["wall_s"]  # getting ready
    ended = fly(scenario, tmp_path, 3, keep=(running.Keep("worst", 1),))
    head = heads.read_head(tmp_path)
    assert head["timed"]["runs"] == 3 and head["timed"]["wall_s"] < head["wall_s"] == ended.wall_s  # a log


def test_half_a_run_counts_for_nothing(whole, scenario, tmp_path):
    """Killed between the record and the end of its transaction, with a table half written."""
    fly(scenario, tmp_path, RUNS)
    keeping.forget(tmp_path, 1)
    (tmp_path / "results.parquet.part").write_bytes(b"half")
    half = (
        "import os; from pathlib import Path; from shefex_nav.campaign import flight, store\n"
        f"runs = store.Store(Path({str(tmp_path)!r})).__enter__().runs\n"
        "one = (flight.Flown({'run': 1, 'status': 'succeeded'}, b'series'), None)\n"
        "runs.keep(one if k == 0 else os._exit(9) for k in range(2))\n"
    )
    assert subprocess.run([sys.executable, "-c", half], check=False).returncode == 9
    assert keeping.done(tmp_path) == RUNS - 1
    flown = []
    again = fly(scenario, tmp_path, RUNS, before=lambda job: flown.append(job.run))
    assert flown == [1]
    assert again.digest == whole[1].digest
    assert {path.name for path in tmp_path.iterdir()} == {
        ".lock", "campaign.json", "results.parquet", "runs.sqlite",
    }  # fmt: skip


def test_more_runs_add_to_what_is_there(whole, scenario, tmp_path):
    fly(scenario, tmp_path, 2)
    assert fly(scenario, tmp_path, RUNS).digest == whole[1].digest
    with pytest.raises(store.StoreError, match="asked for 4 runs, --runs 3 would take some away"):
        fly(scenario, tmp_path, 3)
    assert results.open_campaign(tmp_path).digest == whole[1].digest


def test_another_scenario_is_refused_with_the_difference(whole, scenario, tmp_path):
    folder, _ = whole
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    changed = load.load(write(tmp_path), ["imu.gyro.bias=3 deg/h", "gps.max_pdop=6"])
    with pytest.raises(store.StoreError) as refused:
        fly(changed, folder, RUNS)
    lines = str(refused.value).splitlines()
    assert lines[0].startswith(f"{folder}: the scenario is not the one that was flown here")
    assert lines[0].endswith("2 values differ (flown here -> now):")
    assert lines[1:] == [
        "--set imu.gyro.bias: imu.gyro.bias: 0.5 deg/h -> 3 deg/h",
        "--set gps.max_pdop: gps.max_pdop: 10 -> 6",
    ]
    with pytest.raises(store.StoreError, match="was flown with --seed 1, not 2"):
        fly(scenario, folder, RUNS, seed=2)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_latin_hypercube_is_refused_with_another_number(tmp_path):
    latin = load.load(write(tmp_path), ["campaign.sampling=latin_hypercube"])
    fly(latin, tmp_path / "campaign", 2)
    with pytest.raises(store.StoreError, match="a Latin hypercube of 2 runs, of which each draw depends on"):
        fly(latin, tmp_path / "campaign", 3)


def test_two_campaigns_do_not_share_a_folder(scenario, tmp_path):
    with store.Store(tmp_path), pytest.raises(store.StoreError, match="another campaign is at work"):
        fly(scenario, tmp_path, 1)


def test_a_campaign_that_cannot_begin_leaves_nothing_behind(scenario, tmp_path):
    """Folders that it made go; a folder that was there stays with what was in it."""
    plan, _ = running.prepared(scenario, 1, 1)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "notes.txt").write_text("mine")
    for folder in (tmp_path / "campaigns" / "new", mine):
        with pytest.raises(engine.EngineError), store.Store(folder) as kept:
            kept.begin(plan, {})
            kept.flight(lambda: b"flown")
            raise engine.EngineError("no workers")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert [path.name for path in mine.iterdir()] == ["notes.txt"]


def test_what_was_there_before_stays_when_a_campaign_cannot_go_on(scenario, tmp_path):
    plan, _ = running.prepared(scenario, 1, 1)
    with store.Store(tmp_path) as kept:
        kept.begin(plan, {})
    before = (tmp_path / "campaign.json").read_bytes()
    with pytest.raises(engine.EngineError), store.Store(tmp_path) as kept:
        kept.begin(plan, {})
        raise engine.EngineError("no workers")
    assert (tmp_path / "campaign.json").read_bytes() == before
    with pytest.raises(engine.EngineError), store.Store(tmp_path / "new") as kept:
        kept.begin(plan, {})
        kept.runs.lose(engine.Lost(0, "its worker was killed", True))
        raise engine.EngineError("no workers")
    assert set(kept.runs.lost()) == {0} and kept.head() is not None


def test_every_fifth_run_fails_and_says_why(tmp_path):
    """An exposure longer than the longest contradicts another field: an error of the run that draws it."""
    steps = "\n".join("0.06" if run % 5 == 4 else "0.02" for run in range(10))
    (tmp_path / "step.csv").write_text(f"step_s\n{steps}\n")
    more = "  star_tracker.exposure.start: {table: {file: step.csv, column: step_s, unit: s}}\n"
    scenario = load.load(write(tmp_path, more), ["star_tracker.exposure.shortest=10 ms"])
    ended = fly(scenario, tmp_path / "campaign", 10, keep=(running.Keep("failed"),))
    rows = keeping.rows(tmp_path / "campaign")
    failed = [row for row in rows if row["status"] == "failed"]
    assert [row["run"] for row in failed] == [4, 9] and (ended.done, ended.failed) == (10, 2)
    for row in failed:
        assert row["reason"].startswith("ScenarioError: drawn: star_tracker.exposure.start:")
        assert 'File "shefex_nav/' in row["traceback"] and "60 ms" in row["reason"]
        assert row["draw.star_tracker.exposure.start"] == 0.06
    assert all(row["summary.navigation.position_error_m.rms"] < 100.0 for row in rows if row not in failed)
    result = summary.summary_object(results.open_campaign(tmp_path / "campaign"))
    assert (result["runs"], result["succeeded"], result["failed"]) == (10, 8, 2)
    assert json.loads(json.dumps(result, allow_nan=False))["results_digest"] == ended.digest


def test_the_command_tells_the_cause_of_every_fifth_failure(tmp_path, monkeypatch):
    """Exit code 1, 80 % of the rows good, and a summary that names the dispersion that broke the others.

    Of ten runs two that fail have one of seven draws in common by chance in 15 %: p is 1 in 45 for each.
    """
    monkeypatch.setattr(running, "_lanes_here", lambda request, plan, runs: [HereLane(plan)])
    rows = "\n".join("0.06" if run % 5 == 4 else "0.02" for run in range(15))
    (tmp_path / "step.csv").write_text(f"step_s\n{rows}\n")
    more = "  star_tracker.exposure.start: {table: {file: step.csv, column: step_s, unit: s}}\n"
    arguments = ["campaign", str(write(tmp_path, more)), "--runs", "15", "--out", str(tmp_path / "c")]
    arguments += ["--set", "star_tracker.exposure.shortest=10 ms"]
    ended = CliRunner().invoke(app, arguments)
    assert ended.exit_code == 1, ended.output
    assert "12, 80.0 %" in ended.stdout
    assert "3 runs (4, 9, 14): ScenarioError: drawn: star_tracker.exposure.start: " in ended.stdout
    words = "Failed runs drew star_tracker.exposure.start from 0.06 to 0.06, the others from 0.02 to 0.02 (p "
    assert words in ended.stdout
    printed = CliRunner().invoke(app, [*arguments, "--json"])
    found = json.loads(printed.stdout)
    assert printed.exit_code == 1 and (found["succeeded"], found["failed"]) == (12, 3)


def test_a_table_must_be_long_enough(tmp_path):
    (tmp_path / "mass.csv").write_text("mass_kg\n487\n488\n")
    scenario = load.load(write(tmp_path, BREAKS))
    with pytest.raises(running.BadCampaign) as refused:
        running.prepared(scenario, 3, 1)
    path = tmp_path / "short.yaml"
    line = 1 + path.read_text().splitlines().index(BREAKS.rstrip("\n").partition("\n")[0])
    words = "dispersions.vehicle.payload.mass.table: 2 values for 3 runs; one for each"
    assert str(refused.value) == f"{path}:{line}:33: {words}"


ARMS = ("1 m", "0 m", "0 m"), ("1 m", "0 m", "5 mm")
LISTS = """  vehicle.imu: {choice: [[1 m, 0 m, 0 m], [1 m, 0 m, 5 mm]]}
  wind: {choice: [none, {height: [0 m, 1 km], speed: [1 m/s, 2 m/s], from: [0 deg, 9 deg]}]}
"""


@pytest.fixture(scope="module")
def listed(tmp_path_factory):
    """(scenario file, folder, Ended) of a campaign that draws lists of texts, and a section or a word."""
    path = write(tmp_path_factory.mktemp("lists"), LISTS)
    folder = path.parent / "campaign"
    return path, folder, fly(load.load(path), folder, 8)


def test_lists_that_were_drawn_are_in_table_and_digest(listed):
    _, folder, ended = listed
    rows = keeping.rows(folder)
    assert {row["status"] for row in rows} == {"succeeded"} and table.digest(rows) == ended.digest
    column = f"{results.DRAW}vehicle.imu"
    for row in rows:
        drawn = keeping.record(folder, row["run"])["draws"]
        assert json.loads(row[column]) == drawn["vehicle.imu"]
        if drawn["wind"] == "none":
            assert row["draw.wind"] == "none" and row["draw.wind.from"] is None
        else:
            assert row["draw.wind"] is None and json.loads(row["draw.wind.from"]) == drawn["wind"]["from"]
    assert {tuple(json.loads(row[column])) for row in rows} == set(ARMS)
    other = [row | {column: json.dumps(ARMS[row[column] == json.dumps(ARMS[0])])} for row in rows]
    assert table.digest(other) != ended.digest
    campaign = results.open_campaign(folder)
    assert campaign.draws["vehicle.imu"].tolist() == [row[column] for row in rows]
    named = [one.name for one in sensitivity.features(campaign.draws) if one.name.startswith("vehicle.imu")]
    assert named in [[f"vehicle.imu = {json.dumps(arm)}"] for arm in ARMS]  # a category, as words are


def test_a_dry_run_prints_the_columns_of_the_table(listed):
    path, folder, _ = listed
    printed = CliRunner().invoke(app, ["campaign", str(path), "--runs", "8", "--dry-run"])
    assert printed.exit_code == 0, printed.output
    found = {name.partition(" [")[0]: name for name in printed.stdout.splitlines()[0].split(",")}
    rows = list(csv.DictReader(printed.stdout.splitlines()))
    kept = results.open_campaign(folder).draws
    assert found.keys() == {"run", "seed", *kept}
    for name, values in kept.items():
        said = [row[found[name]] for row in rows]
        assert said == ["" if value is None else str(value) for value in values.tolist()], name


def test_a_dry_run_prints_its_draws_as_one_json_object(listed):
    """Those that the campaign has flown, and what a number of them counts in."""
    path, folder, _ = listed
    printed = CliRunner().invoke(app, ["campaign", str(path), "--runs", "8", "--dry-run", "--json"])
    assert printed.exit_code == 0, printed.output
    found = json.loads(printed.stdout)
    kept = results.open_campaign(folder)
    assert (found["scenario"], found["seed"]) == (kept.head["scenario"], kept.head["seed"])
    assert found["units"]["imu.gyro.bias"] == "times" and "wind" not in found["units"]
    drawn = [keeping.record(folder, one["run"]) for one in found["runs"]]
    assert [one["run"] for one in found["runs"]] == list(range(8))
    assert [one["draws"] for one in found["runs"]] == [one["draws"] for one in drawn]


def test_units_of_draws_are_kept(listed):
    _, folder, _ = listed
    campaign = results.open_campaign(folder)
    units = {"ground.latitude": "deg", "imu.gyro.bias": "times", "imu.accelerometer.bias": "%"}
    assert campaign.units == units | {"vehicle.imu": "", "wind": ""}
    schema = pyarrow.parquet.read_schema(folder / "results.parquet")
    said = {one.name: one.metadata[b"unit"].decode() for one in schema if one.metadata}
    assert said == {f"draw.{name}": unit for name, unit in units.items()}


def at_ten_hertz(data):
    """RunData with as much of truth and solution as a campaign takes its figures from."""

    def few(columns):
        ticks = np.round((columns.t_s - data.mission.start_s) * TICK_HZ)
        return columns._make(column[ticks % thinning.ticks(thinning.LOWEST_HZ) == 0] for column in columns)

    truth = few(data.truth)
    return data._replace(truth=truth, nav=few(data.nav), last_t_s=float(truth.t_s[-1]))


def test_the_worst_run_gets_a_log(whole, scenario, tmp_path):
    """Flown again exactly: the log, which has more, gives the summary that the record has."""
    ended = fly(scenario, tmp_path, RUNS, keep=(running.Keep("worst", 1),))
    worst = max(keeping.rows(tmp_path), key=lambda row: row["summary.navigation.attitude_error_deg.rms"])
    (log,) = (tmp_path / "logs").iterdir()
    assert log.name == f"{worst['run']:06d}.mcap"
    found = metrics.summarise(at_ten_hertz(reader.read(log)))
    kept = keeping.record(tmp_path, worst["run"])["summary"]
    timed = ("log", "wall_s", "setup_s", "real_time_factor", "star_tracker")
    assert {k: v for k, v in found.items() if k not in timed} == {
        k: v for k, v in kept.items() if k not in timed
    }
    assert ended.digest == whole[1].digest


def test_a_shared_flight_is_flown_once(tmp_path):
    """Sensors differ, truth does not: the same file for all runs, also when the campaign goes on."""
    path = write(tmp_path)
    path.write_text(path.read_text().replace("  ground.latitude: {uniform: [-1 deg, 1 deg]}\n", ""))
    shared = load.load(path, ["campaign.flight=shared"])
    fly(shared, tmp_path / "campaign", 1)
    flown = (tmp_path / "campaign" / "flight.npz").read_bytes()
    fly(shared, tmp_path / "campaign", 3)
    assert (tmp_path / "campaign" / "flight.npz").read_bytes() == flown
    assert (
        len({row["summary.navigation.position_error_m.rms"] for row in keeping.rows(tmp_path / "campaign")})
        == 3
    )
    assert repeating.repeat(tmp_path / "campaign", 2, lane=HereLane).same


def test_a_fault_of_the_program_is_no_failed_run(scenario):
    plan, sampler = running.prepared(scenario, 1, 1)

    def broken(job):
        raise TypeError("a slip")

    with pytest.raises(TypeError, match="a slip"):
        engine.fly([sampler.job(0)], [HereLane(plan, broken)], lambda flown: None)


def test_the_scenario_of_a_run_is_that_of_its_draws(scenario):
    plan, sampler = running.prepared(scenario, 5, 1)
    job = sampler.job(4)
    flown = Pilot(plan).scenario(job)
    assert flown.imu.gyro.bias == pytest.approx(
        scenario.imu.gyro.bias * job.draws["imu.gyro.bias"], rel=1e-12
    )
    degrees = np.degrees(flown.ground.latitude - scenario.ground.latitude)
    assert degrees == pytest.approx(job.draws["ground.latitude"], abs=1e-9)
    assert draws.sensor_seed(1, 4) == job.seed != draws.sensor_seed(2, 4)


def test_a_traceback_does_not_say_where_things_are_installed():
    """It is in the table, and the table is to be the same on every machine."""
    try:
        np.linalg.cholesky(-np.eye(2))
    except np.linalg.LinAlgError as error:
        text = flight._traceback(error)
    assert 'File "numpy/linalg/_linalg.py"' in text
    assert text.endswith("LinAlgError: Matrix is not positive definite\n")


def test_a_worker_that_does_not_fit_is_refused(scenario, monkeypatch):
    plan, sampler = running.prepared(scenario, 1, 1)
    monkeypatch.setattr(flight, "_pilots", {})
    for name in flight.ONE_THREAD:
        monkeypatch.setenv(name, "1")
    other = plan._replace(versions=plan.versions | {"numpy": "1.0"})
    bad = {
        "flies 2 runs at a time; start each with --nthreads 1": (plan, 2),
        "not 1.0: all need the same": (other, 1),
    }
    for words, (asked, runs_at_a_time) in bad.items():
        flight.prepare_worker(asked, runs_at_a_time)
        with pytest.raises(flight.WorkerError) as refused:
            flight.fly(sampler.job(0)._replace(plan=asked.digest))
        assert words in str(refused.value)
    for given, words in (("4", "it is 4"), ("", "it is empty"), (None, "it is not set")):
        name = flight.ONE_THREAD[0]
        monkeypatch.delenv(name) if given is None else monkeypatch.setenv(name, given)
        flight.prepare_worker(plan, 1)
        with pytest.raises(flight.WorkerError, match=f"start the worker with {name}=1, {words}$"):
            flight.fly(sampler.job(0))
    with pytest.raises(flight.WorkerError, match="was not told what to fly"):
        flight.fly(sampler.job(0)._replace(plan="another"))


@pytest.mark.parametrize(
    ("name", "differs"),
    [
        ("hipparcos_v8.csv.gz", {"data"}),
        ("egm96_36x36.csv", {"data"}),
        ("us76_upper.f8", {"data"}),
        ("land_110m.json", set()),
    ],
)
def test_another_catalogue_or_field_is_another_program(name, differs, tmp_path, monkeypatch):
    """Results depend on the package's data as on its code; the coast lines are of pictures alone."""
    now = planning.versions()
    shutil.copytree(planning.PACKAGE / "data", tmp_path / "data")
    for source in planning.PACKAGE.rglob("*.py"):
        copy = tmp_path / source.relative_to(planning.PACKAGE)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
    monkeypatch.setattr(planning, "PACKAGE", tmp_path)
    path = tmp_path / "data" / name
    path.write_bytes(path.read_bytes()[:-1] + b"#")
    then = planning.versions()
    assert {key for key in now if now[key] != then[key]} == differs


@pytest.mark.parametrize(
    "setting", ["OPENBLAS_CORETYPE=Other", "NUMBA_CPU_NAME=other", "NUMBA_DISABLE_JIT=1"]
)
def test_a_machine_that_ends_in_other_digits_is_refused(setting, scenario, tmp_path, monkeypatch):
    """A folder that moves there, or a worker of a cluster, would mix results that no machine repeats."""
    fly(scenario, tmp_path, 1)
    then, (plan, _) = planning.versions(), running.prepared(scenario, 1, 1)
    monkeypatch.setenv(*setting.split("="))
    now = planning.versions()
    assert {name for name in now if now[name] != then[name]} == {"target"}
    assert setting.split("=")[1] in now["target"] or "kernels Python" in now["target"]
    with pytest.raises(store.StoreError, match=r"mixed, .*: the processor that is compiled for"):
        fly(scenario, tmp_path, 2)
    with pytest.raises(flight.WorkerError, match=f"target {re.escape(now['target'])}, not "):
        flight._check_versions(plan.versions)


def test_getting_ready_is_no_time_of_the_runs(scenario, tmp_path, monkeypatch):
    """A report tells runs an hour; compiling took minutes of it."""
    clock, made = [0.0], running.with_flight

    def slow(*given):
        clock[0] += 3600.0
        return made(*given)

    monkeypatch.setattr(running, "with_flight", slow)
    monkeypatch.setattr(running, "time", SimpleNamespace(perf_counter=lambda: clock[0]))

    def flown(job):
        clock[0] += 2.0

    fly(scenario, tmp_path, 3, before=flown)
    head = heads.read_head(tmp_path)
    assert (head["timed"], head["wall_s"]) == ({"runs": 3, "wall_s": 6.0}, 3606.0)


def test_files_of_others_are_left_alone(scenario, tmp_path):
    """Also those that end as half-written ones of a campaign do."""
    theirs = [tmp_path / "film.mkv.part", tmp_path / "mine" / "notes.part", tmp_path / "deep" / "000001.part"]
    for path in theirs:
        path.parent.mkdir(exist_ok=True)
        path.write_text("mine")
    (tmp_path / "mine" / "notes.part").rename(tmp_path / "notes.part")
    fly(scenario, tmp_path, 1)
    assert (
        (tmp_path / "film.mkv.part").read_text() == (tmp_path / "deep" / "000001.part").read_text() == "mine"
    )
    assert (tmp_path / "notes.part").exists()
