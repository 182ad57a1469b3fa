"""The command: what it writes, what it prints, what it refuses."""

import json

import numpy as np
import pytest
from flown_log import Options, write
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.log import reader
from shefex_nav.records import TruthSample
from shefex_nav.replay import rerun
from shefex_nav.report import metrics
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.report.viewer import recording

RUNNER = CliRunner()


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write(tmp_path_factory.mktemp("command") / "run.mcap")


@pytest.fixture(scope="module")
def smoothed(log):
    """The result of `smooth LOG --json`."""
    done = RUNNER.invoke(app, ["smooth", str(log), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_writes_a_log_beside_the_log_that_report_reads(log, smoothed):
    assert smoothed["smoothed"] == str(log.with_name("run.smoothed.mcap"))
    data, flown = reader.read(smoothed["smoothed"]), reader.read(log)
    assert data.mission.scenario == "short_flight (smoothed)" and not data.ended_early
    assert np.array_equal(data.truth.r_i, flown.truth.r_i)
    assert np.array_equal(data.nav.t_s, flown.nav.t_s)
    assert len(data.gps) == len(flown.gps) and len(data.star_fixes) == len(flown.star_fixes)
    assert [event.name for event in data.events] == [event.name for event in flown.events]
    before, after = metrics.summarise(flown), metrics.summarise(data)
    assert (
        after["navigation"]["velocity_error_m_s"]["rms"] < before["navigation"]["velocity_error_m_s"]["rms"]
    )
    assert after["star_tracker"] == before["star_tracker"] and after["flight"] == before["flight"]
    boost = smoothed["parts"][0]
    errors = navigation_errors(data)
    by_hand = np.linalg.norm(errors.velocity_i[errors.t_s <= 20.0 + 1e-6], axis=1)
    assert np.isclose(boost["smoothed"]["velocity_m_s"], np.sqrt(np.mean(by_hand**2)), rtol=1e-9)


def test_report_and_view_take_it(smoothed, tmp_path):
    done = RUNNER.invoke(app, ["report", smoothed["smoothed"]])
    assert done.exit_code == 0 and "short_flight (smoothed)" in done.stdout
    recording.build([smoothed["smoothed"]], tmp_path / "view.rrd")
    assert (tmp_path / "view.rrd").stat().st_size > 10_000


def test_its_report_says_what_is_not_of_the_smoother(log, smoothed, command):
    """Protection levels and what was used are those of the filter on board."""
    logs = smoothed["smoothed"], str(log)
    assert ["as the filter said" in command("report", path).out for path in logs] == [True, False]
    nav = [reader.read(path).nav for path in logs]
    np.testing.assert_array_equal(*(one.protection_position for one in nav))
    assert not np.array_equal(*(one.sigma_r_e for one in nav))


def test_the_table_names_the_parts(log, tmp_path):
    done = RUNNER.invoke(app, ["smooth", str(log), "--out", str(tmp_path / "best.mcap")])
    assert done.exit_code == 0, done.output
    for text in ("boost", "middle of the stars", "->", "best.mcap", "x real time"):
        assert text in done.stdout


def test_another_configuration(log, smoothed, tmp_path):
    out = tmp_path / "other.mcap"
    change = "navigation.star_fix_floor=60 arcsec"
    done = RUNNER.invoke(app, ["smooth", str(log), "--set", change, "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    stars = [
        next(row for row in result["parts"] if row["part"] == "stars")["filtered"]["attitude_deg"]
        for result in (smoothed, json.loads(done.stdout))
    ]
    assert stars[0] != stars[1]
    assert "60 arcsec" in reader.read(out).mission.scenario_text


def test_nothing_is_overwritten(log, smoothed):
    for arguments, words in (
        ([log], "exists already"),
        ([log, "--out", log, "--force"], "is the log itself"),
        ([log, "--out", "/nowhere/x.mcap"], "there is no folder /nowhere"),
    ):
        done = RUNNER.invoke(app, ["smooth", *map(str, arguments)])
        said = " ".join(done.output.replace("│", " ").split())  # without the frame and its line breaks
        assert done.exit_code == 2 and words in said
    assert reader.read(log).mission.scenario == "short_flight"


def test_what_cannot_be_smoothed_is_refused_before_anything_is_written(tmp_path, smoothed):
    thin = write(tmp_path / "thin.mcap", Options(rate_hz=10.0))
    for path, words in ((thin, "10 IMU blocks a second"), (smoothed["smoothed"], "no IMU samples")):
        out = tmp_path / "never.mcap"
        done = RUNNER.invoke(app, ["smooth", str(path), "--out", str(out)])
        assert done.exit_code == 2 and words in " ".join(done.stderr.split())
        assert not out.exists()


def test_a_log_without_truth_is_smoothed_too(log, tmp_path):
    """As after a real flight: there is nothing to compare with."""
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.writer import LogWriter

    path = tmp_path / "real.mcap"
    recording = rerun.open_log(log)
    with LogWriter(path, recording.data.mission, FramePolicy(0, "none", 4.0)) as writer:
        for record in rerun.records(recording):
            if type(record) is not TruthSample:
                writer.write(record)
    done = RUNNER.invoke(app, ["smooth", str(path), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["parts"] is None
    assert len(reader.read(path.with_suffix(".smoothed.mcap")).nav.t_s) == 3000
    done = RUNNER.invoke(app, ["smooth", str(path), "--force"])
    assert done.exit_code == 0 and "no truth" in done.stdout


def test_a_log_that_was_cut_off_is_smoothed_to_its_end(log, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(log.read_bytes()[: log.stat().st_size * 3 // 4])
    done = RUNNER.invoke(app, ["smooth", str(path)])
    assert done.exit_code == 0 and "the run ended early" in done.stderr
    assert 10.0 < reader.read(path.with_suffix(".smoothed.mcap")).nav.t_s[-1] < 29.0
