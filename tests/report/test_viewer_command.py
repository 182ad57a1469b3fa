"""Viewing as users meet it: what is refused, what is kept beside a log, what is told."""

import os
import shutil
import sys
import threading

import pytest
import synthetic_run
from recorded import chunks
from rerun.chunk import RrdReader

from shefex_nav.log.writer import LogWriter
from shefex_nav.report import viewer
from shefex_nav.report.viewer import ViewerError, program, recording


def test_a_killed_log_can_be_viewed(log, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: int(0.6 * log.stat().st_size)])
    data = viewer.view(cut, save=tmp_path / "cut.rrd")[0]
    assert data.ended_early
    assert any(str(c.entity_path) == "/star_tracker/image" for c in chunks(tmp_path / "cut.rrd"))


def test_a_log_without_a_flight_is_a_clear_error(tmp_path):
    path = tmp_path / "empty.mcap"
    with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS):
        pass
    with pytest.raises(ViewerError, match="nothing to show"):
        viewer.view(path, save=tmp_path / "empty.rrd")


def test_a_disk_without_space_is_a_clear_error(log, tmp_path, monkeypatch):
    """rerun would wait for ever."""
    usage = shutil.disk_usage(tmp_path)._replace(free=log.stat().st_size // 2)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(OSError, match="No space left on device"):
        recording.build([log], tmp_path / "view.rrd")
    assert not (tmp_path / "view.rrd").exists()


def test_a_time_outside_the_log_is_a_clear_error(log, tmp_path):
    with pytest.raises(ViewerError, match="covers 231 s to 241 s, not 300 s"):
        viewer.view(log, screenshot=tmp_path / "picture.png", at_s=300.0)


def test_no_screen_is_a_clear_error(log, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform != "linux":
        pytest.skip("screens are found by other means")
    with pytest.raises(ViewerError, match="could not open a window: this machine has no screen") as caught:
        viewer.view(log)
    said = str(caught.value)  # of their own libraries' sources nothing
    assert "\n" not in said and ".rs" not in said and all(f"--{way}" in said for way in ("save", "web"))


def test_no_screen_for_a_flight_that_goes_on_names_what_can_follow_it(log, monkeypatch):
    """`run --live` named --save and --web, which `run` has not, and then waited for `own software`."""
    for name in program.SCREENS:
        monkeypatch.delenv(name, raising=False)
    if sys.platform != "linux":
        pytest.skip("screens are found by other means")
    with pytest.raises(ViewerError, match=r"no screen.*`shefex-nav view LOG --follow --web`"):
        viewer.follow(lambda: (log, 0))
    assert viewer.follow(lambda: None) is None
    assert not [one.name for one in threading.enumerate() if "_import_what_shows" in one.name]


def test_what_the_viewer_says_has_no_places_in_its_source():
    said = (
        "warning\nError: winit EventLoopError: os error at /usr/local/cargo/registry/x/mod.rs:765: no display"
    )
    assert program._reason(said, 1) == "Error: winit EventLoopError: no display"
    assert program._reason("", 9) == "exit code 9"


def test_a_missing_viewer_is_a_clear_error(log, tmp_path, monkeypatch):
    monkeypatch.setattr(program, "find_spec", lambda name: None)
    monkeypatch.setattr(program.sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setattr(program.sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ViewerError, match="not installed"):
        viewer.view(log, screenshot=tmp_path / "picture.png")


def test_the_recording_beside_a_log_is_made_again_when_the_log_is_newer(log, tmp_path):
    mine = tmp_path / "run.mcap"
    shutil.copy(log, mine)
    path = recording.kept(mine)
    assert path == tmp_path / "run.view.rrd" and len(RrdReader(path).blueprints()) == 1
    first = path.stat().st_mtime_ns
    assert recording.kept(mine) == path and path.stat().st_mtime_ns == first
    os.utime(mine, ns=(1, 1))
    recording.kept(mine)
    assert path.stat().st_mtime_ns > first


def test_the_recording_beside_a_log_is_made_again_when_the_program_is_another(log, tmp_path, monkeypatch):
    mine = tmp_path / "run.mcap"
    shutil.copy(log, mine)
    first = recording.kept(mine).stat().st_mtime_ns
    monkeypatch.setattr(recording, "_program", lambda: "another")
    assert recording.kept(mine).stat().st_mtime_ns > first


def test_a_recording_of_somebody_else_is_left_alone(log, tmp_path):
    mine, saved = tmp_path / "run.mcap", tmp_path / "run.view.rrd"
    shutil.copy(log, mine)
    saved.write_text("mine")
    assert recording.kept(mine) is None
    assert saved.read_text() == "mine"


@pytest.mark.parametrize(("option", "name"), [("--screenshot", "picture.jpg"), ("--save", "run.png")])
def test_a_file_of_another_kind_is_refused_in_one_line(log, tmp_path, command, option, name):
    result = command("view", log, option, tmp_path / name)
    assert result.code == 2 and len(result.err.splitlines()) == 1
    assert option in result.err and name in result.err and ("PNG" in result.err) == (option == "--screenshot")
    assert not (tmp_path / name).exists()


def test_a_cut_log_is_told_once_and_by_us(log, tmp_path, process):
    cut, saved = tmp_path / "cut.mcap", tmp_path / "cut.rrd"
    cut.write_bytes(log.read_bytes()[: int(0.6 * log.stat().st_size)])
    result = process("view", cut, "--save", saved)
    told, wrote = result.err.splitlines()
    assert result.code == 0 and wrote == f"wrote {saved}"
    assert told.startswith(f"{cut}: the run ended early, at T+")
    first = saved.read_bytes()
    again = process("view", cut, "--save", saved, "--force")
    assert again.code == 0 and saved.stat().st_size == pytest.approx(len(first), rel=0.01)
