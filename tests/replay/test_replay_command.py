"""The replay command as users meet it, on the example that comes with the project and on NaveGo's data."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "scenarios" / "replay" / "csv_example.yaml"
NAVEGO = ROOT / "scenarios" / "replay" / "navego.yaml"
NAVEGO_DATA = ROOT.parent / "shared" / "data" / "navego"
# rms of pyins 1.0.1 on the same data: position m, velocity m/s, attitude deg
PYINS = np.array([0.28, 0.50, 0.49, 0.043, 0.035, 0.017, 0.084, 0.107, 0.616])


def figures(summary):
    """The nine rms errors and the nine errors over sigma of a summary."""
    navigation = summary["navigation"]
    names = ("position_rms_ned_m", "velocity_rms_ned_m_s", "attitude_rms_rpy_deg")
    rms = np.concatenate([navigation[name] for name in names])
    over = navigation["error_over_sigma"]
    return rms, np.concatenate([over[name] for name in ("position_ned", "velocity_ned", "attitude_rpy")])


@pytest.fixture(scope="module")
def example(command, tmp_path_factory):
    """The example, replayed: (summary, log)."""
    log = tmp_path_factory.mktemp("example") / "replay.mcap"
    result = command("replay", EXAMPLE, "--from", "20s", "--json", "--log", log)
    assert result.code == 0, result.err
    return json.loads(result.out), log


def test_example_is_navigated_as_well_as_the_filter_says(example):
    """A rocket under thrust: errors of the velocity are those of GPS and of a heading found in flight."""
    summary, _ = example
    rms, over = figures(summary)
    assert summary["simulated_s"] == pytest.approx(23.0, abs=0.05)
    assert rms[:3].max() < 3.0 and rms[3:6].max() < 0.2 and rms[7] < 0.05
    assert over.max() < 2.5
    nis = summary["navigation"]["nis"]
    assert nis["gps_position"]["rejected"] == nis["gps_velocity"]["rejected"] == 0
    assert summary["filter_real_time_factor"] > 0.0


def test_heading_found_by_the_gyros_on_the_rail_is_within_its_sigma(example):
    from shefex_nav.log import reader
    from shefex_nav.report import local_level

    _, log = example
    _, error, _, ratio = local_level.errors(reader.read(log))
    assert np.degrees(abs(error[0, 8])) > 0.5  # gyros of 0.5 deg/h at 68 deg of latitude
    assert np.abs(ratio[0]).max() < 3.0


def test_report_gives_the_figures_of_the_replay(example, command):
    summary, log = example
    report = json.loads(command("report", log, "--json").out)
    for name in ("simulated_s", "flight"):
        assert report[name] == summary[name]
    whole, later = (np.array(one["navigation"]["velocity_rms_ned_m_s"]) for one in (report, summary))
    assert (whole[:2] > later[:2]).all()  # from the start on, where the heading is not known yet
    text = command("report", log).out
    assert "position N, E, D" in text and "NIS, GPS velocity" in text


def test_replay_of_its_log_is_the_same(example, command):
    """The log holds all that the filter saw, and how it was configured."""
    summary, log = example
    again = json.loads(command("replay", log, "--from", "20s", "--json").out)
    np.testing.assert_allclose(figures(again)[0], figures(summary)[0], rtol=1e-9)
    other = command("replay", log, "--from", "20s", "--json", "--set", "navigation.gravity_error=5 mgee")
    assert not np.allclose(figures(json.loads(other.out))[0], figures(summary)[0], rtol=1e-3)


def test_what_is_looked_at_until_a_time_is_the_same_so_far(example, command, tmp_path):
    """Nothing later is in the log or counts; a whole log that is cut gives what cut data give."""
    from shefex_nav.log import reader

    summary, log = example
    cut = tmp_path / "cut.mcap"
    told = json.loads(command("replay", EXAMPLE, "--until", "25s", "--json", "--log", cut).out)
    assert (told["until_s"], told["ended_early"]) == (25.0, False) and summary["until_s"] is None
    assert told["simulated_s"] == pytest.approx(13.0, abs=0.05)
    whole, part = reader.read(log), reader.read(cut)
    n = int(np.sum(whole.nav.t_s <= 25.0 + 1e-6))
    assert np.array_equal(part.nav.r_i, whole.nav.r_i[:n]) and n < len(whole.nav.t_s)
    assert part.truth.t_s[-1] == part.imu.t_valid_s[-1] == pytest.approx(25.0)
    assert max(fix.t_available_s for fix in part.gps) <= 25.0 + 1e-6
    again = json.loads(command("replay", log, "--until", "25s", "--json").out)
    assert again["until_s"] == 25.0
    np.testing.assert_allclose(figures(again)[0], figures(told)[0], rtol=1e-9)
    table = command("report", cut).out
    assert "looked at" in table and "until T+25.0 s" in table
    late = command("replay", cut, "--until", "30s", "--json")
    assert late.code == 0 and "--until 30s: the data are over before" in late.err
    assert json.loads(late.out)["until_s"] == 25.0  # as of the log


def test_a_flight_replayed_until_a_time_is_one_flown_until_then(command, tmp_path):
    whole, errors = tmp_path / "whole.mcap", []
    assert command("run", "night_sky", "--until", "4s", "--out", whole).code == 0
    for words in (("run", "night_sky", "--out", tmp_path / "part.mcap"), ("replay", whole)):
        told = json.loads(command(*words, "--until", "3s", "--json").out)
        assert told["until_s"] == 3.0
        errors.append(told["navigation"]["attitude_error_deg"])
        assert told["navigation"]["nis"]["star_tracker"]["samples"] > 5
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)


def test_without_truth_there_are_no_errors_but_everything_else(command, tmp_path):
    for file in (ROOT / "scenarios" / "replay" / "csv_example").glob("*.csv"):
        shutil.copy(file, tmp_path)
    log = tmp_path / "blind.mcap"
    result = command(
        "replay", EXAMPLE, "--data", tmp_path, "--set", "data.truth=null", "--json", "--log", log
    )
    summary = json.loads(result.out)
    assert summary["navigation"]["position_rms_ned_m"] is None
    assert summary["navigation"]["error_over_sigma"] is None
    assert summary["navigation"]["nis"]["gps_position"]["samples"] == 20
    assert summary["simulated_s"] == pytest.approx(23.0, abs=0.05)
    assert command("report", log).code == 0


WRONG = {
    "no file": (("nowhere.yaml",), "nowhere.yaml: there is no such file"),
    "no log": (("nowhere.mcap",), "nowhere.mcap: cannot be read"),
    "no folder": ((EXAMPLE, "--data", "nowhere"), "there is no folder nowhere"),
    "no data": ((NAVEGO, "--data", "docs"), "data.imu: there is no file docs"),
    "no time": ((EXAMPLE, "--from", "later"), "--from"),
    "nothing before": (
        (EXAMPLE, "--until", "3s"),
        "--until: 3 s is not after the start of the data, T+12 s: from 12.1 s on there is something to see",
    ),
    "nothing between": (
        (EXAMPLE, "--until", "25s", "--from", "26s"),
        "--from: 26 s is not before the end of what is looked at, T+25.0 s",
    ),
    "no end": ((EXAMPLE, "--until", "60"), "--until"),
    "a mission": ((ROOT / "scenarios" / "orbit.yaml",), "is a scenario of a flight; `shefex-nav run "),
    "a value": ((EXAMPLE, "--set", "gnss.latency=3"), "gnss.latency: 3 has no unit"),
    "a log that exists": ((EXAMPLE, "--log", "README.md"), "README.md exists already"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_bad_input_is_one_message_and_exit_code_2(kind, command):
    arguments, words = WRONG[kind]
    result = command("replay", *arguments)
    assert result.code == 2 and result.out == ""
    flat = " ".join(result.err.replace("│", " ").split())
    assert words in flat, result.err
    assert "Traceback" not in result.err


def test_a_bad_line_in_the_data_is_named(command, tmp_path):
    for file in (ROOT / "scenarios" / "replay" / "csv_example").glob("*.csv"):
        shutil.copy(file, tmp_path)
    lines = (tmp_path / "imu.csv").read_text(encoding="utf-8").splitlines()
    lines[99] = lines[99].replace(",", ",x", 1)
    (tmp_path / "imu.csv").write_text("\n".join(lines), encoding="utf-8")
    result = command("replay", EXAMPLE, "--data", tmp_path)
    assert result.code == 2
    assert "imu.csv:100: wx: expected a number such as 12.5, got 'x" in result.err


needs_navego = pytest.mark.skipif(
    not NAVEGO_DATA.is_dir(), reason="NaveGo's data are not here: ../shared/data/navego"
)


@pytest.fixture(scope="module")
def navego(command):
    """Summary of NaveGo's drive."""
    result = command("replay", NAVEGO, "--data", NAVEGO_DATA, "--from", "60s", "--json")
    assert result.code == 0, result.err
    return json.loads(result.out)


@needs_navego
def test_navego_is_navigated_as_well_as_by_pyins(navego):
    """Each rms within 5 % of pyins' or below it, and their mean ratio at most 1."""
    ratio = figures(navego)[0] / PYINS
    assert ratio.max() < 1.05
    assert ratio.mean() <= 1.0


@needs_navego
def test_navego_errors_are_what_the_filter_says(navego):
    over = figures(navego)[1]
    assert over.min() > 0.5 and over.max() < 1.9
    for sensor in ("gps_position", "gps_velocity"):
        nis = navego["navigation"]["nis"][sensor]
        assert nis["interval"][0] < nis["mean"] < nis["interval"][1]
        assert nis["rejected"] == 0 and nis["samples"] == 378


@pytest.mark.slow
@needs_navego
def test_navego_at_whole_seconds_has_the_errors_of_other_fixes(command):
    """pyins with the fixes of whole seconds: position 0.486, 0.393, 1.008 m, as here within 10 %."""
    arguments = ("--data", NAVEGO_DATA, "--from", "60s", "--json", "--set", "gnss.first=0 s")
    rms, over = figures(json.loads(command("replay", NAVEGO, *arguments).out))
    np.testing.assert_allclose(rms[:3], [0.486, 0.393, 1.008], rtol=0.1)
    assert over.min() > 0.5 and over.max() < 1.9


def test_nothing_of_a_replay_has_a_seed(example, command, tmp_path):
    """Nothing in recorded data was drawn."""
    _, log = example
    done = command("smooth", log, "--out", tmp_path / "best.mcap")
    assert done.code == 0 and "csv_example:" in done.out and "seed" not in done.out
    track = tmp_path / "track.geojson"
    assert command("export", log, "--geojson", track).code == 0
    assert "seed" not in json.loads(track.read_text())["features"][0]["properties"]


def test_a_start_from_a_fix_counts_in_the_smoother_as_in_the_filter(command, tmp_path):
    """At the end nothing comes later: both know as much, of a place that the first fix shares errors with."""
    from shefex_nav.log import reader

    logs = tmp_path / "filtered.mcap", tmp_path / "smoothed.mcap"
    known = [f"alignment.{one}" for one in ("heading=350 deg", "azimuth=1 deg")]
    changes = [part for one in ("gnss.lasting_share=75 %", *known) for part in ("--set", one)]
    assert command("replay", EXAMPLE, *changes, "--log", logs[0]).code == 0
    assert command("smooth", logs[0], "--out", logs[1]).code == 0
    filtered, smoothed = (np.sqrt(reader.read(log).covariance.P[-1].diagonal()) for log in logs)
    assert np.allclose(filtered[:6], smoothed[:6], rtol=2e-3)
