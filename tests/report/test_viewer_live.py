"""A log that grows in the viewer: what is sent in slices is what the whole log would have shown."""

import subprocess
import sys
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
import synthetic_run
from recorded import NO_VULKAN, OPTIONS, chunks

from shefex_nav.commands import run, view
from shefex_nav.log import reader
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.run_data import together
from shefex_nav.log.writer import LogWriter
from shefex_nav.records import NavCovariance, NavSolution
from shefex_nav.report.viewer import layout, live, pages, program, recording


def grow(content, path, steps, pause_s):
    """Write a file piece by piece."""
    ends = np.linspace(0, len(content), steps + 1).astype(int)
    for begin, end in pairwise(ends):
        with path.open("ab") as file:
            file.write(content[begin:end])
        time.sleep(pause_s)


def followed(log, grown, stream, steps=12, pause_s=0.05):
    """Send a log to a stream while it grows."""
    writer = threading.Thread(target=grow, args=(log.read_bytes(), grown, steps, pause_s))
    writer.start()
    live.follow(grown, stream)
    writer.join()


def scalars(saved, entity):
    """Points of a curve: {mission time to 1 ms: value}."""
    found = {}
    for chunk in chunks(saved):
        if str(chunk.entity_path) == entity:
            batch = chunk.to_record_batch()
            name = next(n for n in batch.schema.names if "scalars" in n)
            times = batch.column("mission_time").cast("int64").to_numpy() / 1e9
            values = [value[0] for value in batch.column(name).to_pylist()]
            found.update(zip(np.round(times, 3).tolist(), values, strict=True))
    return found


@pytest.fixture(scope="module")
def both(log, tmp_path_factory):
    """Recordings of the whole log, and of the one that grew."""
    folder = tmp_path_factory.mktemp("live")
    whole, grown = folder / "whole.rrd", folder / "grown.rrd"
    recording.build([log], whole)
    stream = rr.RecordingStream("shefex_nav")
    stream.save(grown)
    followed(log, folder / "grown.mcap", stream)
    stream.disconnect()
    return whole, grown


@pytest.mark.parametrize("entity", ["/plots/errors/position_y/error", "/plots/nees/run", "/plots/residual"])
def test_curves_are_those_of_the_whole(both, entity):
    whole, grown = (scalars(saved, entity) for saved in both)
    common = whole.keys() & grown.keys()
    # slices thin their points anew, from their own first sample on
    assert len(common) > 20 and len(grown) >= 0.9 * len(whole)
    for t_s in common:
        assert grown[t_s] == pytest.approx(whole[t_s], nan_ok=True), t_s


def test_pictures_and_marks_come_once(both):
    def times(saved, entity):
        found = []
        for chunk in chunks(saved):
            if str(chunk.entity_path) == entity and "mission_time" in chunk.timeline_names:
                found += chunk.to_record_batch().column("mission_time").cast("int64").to_pylist()
        return sorted(found)

    for entity in ("/star_tracker/image", "/stars/identified", "/log", "/sky/field"):
        assert times(both[1], entity) == times(both[0], entity), entity


def test_states_change_as_in_the_whole(both):
    def states(saved, entity):
        found = []
        for chunk in chunks(saved):
            if str(chunk.entity_path) == entity:
                batch = chunk.to_record_batch()
                name = next(n for n in batch.schema.names if "state" in n.lower())
                times = batch.column("mission_time").cast("int64").to_pylist()
                said = [value[0].removesuffix(" (short)") for value in batch.column(name).to_pylist()]
                found += zip(times, said, strict=True)
        return sorted(found)

    for entity in ("/states/phase", "/states/star_tracker", "/states/gps", "/states/solution/attitude"):
        assert states(both[1], entity) == states(both[0], entity), entity


def test_curves_of_a_growing_log_keep_the_last_minute(log):
    data = recording.read(log)
    seen, has = layout.scene(np.zeros((2, 3))), layout.content(data, [])
    views = list(pages._views(pages.following(pages.blueprint(data, seen, has)).root_container))
    plots = [view for view in views if isinstance(view, rrb.TimeSeriesView)]
    assert len(plots) > 10
    for plot in plots:
        assert "ScalarAxis" not in plot.properties and "cut off" not in plot.name


def test_a_viewer_that_is_closed_ends_it(log, tmp_path):
    stream, begun_s = rr.RecordingStream("shefex_nav"), time.monotonic()
    stream.save(tmp_path / "run.rrd")
    live.follow(tmp_path / "never.mcap", stream, is_wanted=lambda: time.monotonic() < begun_s + 0.3)


@NO_VULKAN
def test_a_window_that_cannot_be_opened_is_told(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(program.ViewerError, match="could not open a window"), program.Window() as window:
        window.wait()


@pytest.mark.parametrize("more", [("--save", "a.rrd"), ("--screenshot", "a.png"), ("other.mcap",)])
def test_following_shows_one_log_in_a_window(command, tmp_path, more):
    done = command("view", tmp_path / "run.mcap", "--follow", *more)
    assert done.code == 2 and "--follow" in done.err


@pytest.mark.parametrize("is_old", [False, True])
def test_the_reader_of_a_log_is_told_its_path(tmp_path, monkeypatch, is_old):
    """Bytes of any path arrive as they are, and of which age an old log is; what has ended is no error."""
    log, old_ns = tmp_path / "Flug \n ü.mcap", 0
    if is_old:
        log.write_bytes(b"")
        old_ns = log.stat().st_mtime_ns
    reader = subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.stdout.buffer.write(sys.stdin.buffer.read())"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    run._show(reader, log)
    with open(tmp_path / "told", "wb") as told:
        told.write(reader.stdout.read())
    reader.stdout.close()
    reader.wait()
    with open(tmp_path / "told") as told:
        monkeypatch.setattr(sys, "stdin", told)
        assert view._named_by_the_input() == (log, old_ns)
    gone = subprocess.Popen([sys.executable, "-c", ""], stdin=subprocess.PIPE)
    gone.wait()
    run._show(gone, log)


def test_a_scenario_that_is_refused_opens_no_window(command, monkeypatch):
    readers, begin = [], run._viewer

    def viewer():
        readers.append(begin())
        return readers[-1]

    def no_window(*_):
        raise AssertionError("it was told to show something")

    monkeypatch.setattr(run, "_viewer", viewer)
    monkeypatch.setattr(run, "_show", no_window)
    done = command("run", "shefex2_andoya", "--live", "--set", "gps.latency=nan s")
    assert done.code == 2 and "gps.latency" in done.err
    readers[0].stdin.close()  # as the end of the process of `run` would
    assert readers[0].wait(60.0) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the script may be all that there is")
def test_the_viewer_is_started_without_a_script_around_it(monkeypatch):
    """Which would leave it open when it is ended itself."""
    monkeypatch.delenv("RERUN_CLI_PATH", raising=False)
    with program.path().open("rb") as file:
        assert file.read(4) == b"\x7fELF"
    monkeypatch.setenv("RERUN_CLI_PATH", "/elsewhere")  # which the script knows
    with program.path().open("rb") as file:
        assert file.read(2) == b"#!"


def test_a_flight_without_solutions_is_shown_too(tmp_path):
    path, grown, saved = tmp_path / "silent.mcap", tmp_path / "grown.mcap", tmp_path / "grown.rrd"
    with LogWriter(path, synthetic_run.mission(), FramePolicy(10, "thresholded", 4.0)) as log:
        for record in synthetic_run.simulate(OPTIONS):
            if not isinstance(record, NavSolution | NavCovariance):
                log.write(record)
    stream = rr.RecordingStream("shefex_nav")
    stream.save(saved)
    followed(path, grown, stream)
    stream.disconnect()
    entities = {str(chunk.entity_path) for chunk in chunks(saved)}
    assert {"/star_tracker/image", "/stars/identified", "/plots/height", "/states/star_tracker"} <= entities


def test_nothing_of_a_slice_without_truth_is_lost(log, tmp_path):
    data = reader.read(log)
    n = len(data.truth.t_s) // 2
    first = data._replace(
        star_fixes=data.star_fixes[:7], gps=data.gps[:1], truth=data.truth._make(c[:n] for c in data.truth)
    )
    second = data._replace(
        star_fixes=data.star_fixes[7:], gps=data.gps[1:], truth=data.truth._make(c[n:] for c in data.truth)
    )
    both = together(first, second)
    assert np.array_equal(both.truth.r_i, data.truth.r_i)
    assert [one.number for one in both.star_fixes] == [one.number for one in data.star_fixes]
    assert len(both.gps) == len(data.gps) and len(both.nav.t_s) == 2 * len(data.nav.t_s)
    assert all(
        len(one.t_valid_s) == 2 * len(data.readings[name].t_valid_s) for name, one in both.readings.items()
    )
