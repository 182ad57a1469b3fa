"""The recording and what the real viewer says about it."""

import os
import shutil
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import synthetic_run
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import McapReader, RrdReader

from shefex_nav import records as rec
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.writer import LogWriter
from shefex_nav.report import metrics, viewer
from shefex_nav.report.viewer import ViewerError, layout, legend, program, recording
from shefex_nav.report.viewer.sender import GREEN, NAMELESS, ORANGE, Sender

OPTIONS = synthetic_run.Options(start_s=231.0, end_s=241.0)
NO_VULKAN = pytest.mark.skipif(
    sys.platform == "linux" and not any(Path("/usr/share/vulkan/icd.d").glob("*.json")),
    reason="no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1 libgl1-mesa-dri",
)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "run.mcap"
    with LogWriter(path, synthetic_run.mission(), FramePolicy(10, "thresholded", 4.0)) as log:
        for record in (*synthetic_run.simulate(OPTIONS), synthetic_run.summary(OPTIONS)):
            log.write(record)
    return path


def chunks(recording):
    return [chunk for chunk in RrdReader(recording).stream() if not chunk.is_static]


def test_recording_has_a_layout_and_everything_on_mission_time(log, tmp_path):
    saved = tmp_path / "run.rrd"
    data = viewer.view(log, save=saved)[0]
    assert not data.ended_early
    assert len(RrdReader(saved).blueprints()) == 1
    found = chunks(saved)
    entities = {str(chunk.entity_path) for chunk in found}
    assert {"/star_tracker/image", "/star_tracker/image_full", "/stars/identified", "/tf", "/log"} <= entities
    assert {"/plots/errors/position_x/error", "/plots/errors/attitude_z/plus"} <= entities
    assert {"/states/phase", "/states/star_tracker", "/states/gps"} <= entities
    assert {"/plots/pointing/x", "/plots/pointing/z", "/plots/gas"} <= entities
    for chunk in found:
        if not str(chunk.entity_path).startswith("/__"):
            assert "mission_time" in chunk.timeline_names, chunk.entity_path


def test_error_curves_are_truth_minus_estimate(log, tmp_path):
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    points = {}
    for chunk in chunks(saved):
        if str(chunk.entity_path) == "/plots/errors/position_y/error":
            batch = chunk.to_record_batch()
            times = batch.column("mission_time").cast("int64").to_numpy() / 1e9
            name = next(n for n in batch.schema.names if "scalars" in n)
            points.update(zip(np.round(times, 2), batch.column(name).to_pylist(), strict=True))
    truths, estimates = {}, {}
    for record in synthetic_run.simulate(OPTIONS):
        if type(record).__name__ == "TruthSample":
            truths[round(record.t_s, 2)] = record.r_i
        elif type(record).__name__ == "NavSolution":
            estimates[round(record.t_s, 2)] = record.r_i
    assert len(points) == 101
    for t_s, value in points.items():
        assert value[0] == pytest.approx(truths[t_s][1] - estimates[t_s][1], abs=1e-9)


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


def test_a_time_outside_the_log_is_a_clear_error(log, tmp_path):
    with pytest.raises(ViewerError, match="covers 231 s to 241 s, not 300 s"):
        viewer.view(log, screenshot=tmp_path / "picture.png", at_s=300.0)


def test_no_screen_is_a_clear_error(log, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform != "linux":
        pytest.skip("screens are found by other means")
    with pytest.raises(ViewerError, match="could not open a window"):
        viewer.view(log)


def test_no_graphics_is_a_clear_error(log, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "none.json"))
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    with pytest.raises(ViewerError, match="apt-get install mesa-vulkan-drivers"):
        program.take_picture(saved, tmp_path / "picture.png", 235.0)


def test_a_missing_viewer_is_a_clear_error(log, tmp_path, monkeypatch):
    monkeypatch.setattr(program.sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setattr(program.sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ViewerError, match="not installed"):
        viewer.view(log, screenshot=tmp_path / "picture.png")


@NO_VULKAN
@pytest.mark.parametrize("policy", [FramePolicy(10, "thresholded", 4.0), FramePolicy(0, "none", 4.0)])
def test_no_view_reports_an_error(policy, tmp_path):
    path, picture = tmp_path / "run.mcap", tmp_path / "picture.png"
    with LogWriter(path, synthetic_run.mission(), policy) as log:
        for record in synthetic_run.simulate(OPTIONS._replace(end_s=236.0)):
            log.write(record)
    saved = tmp_path / "run.rrd"
    recording.build([path], saved)
    names = set()
    for page in layout.PAGES:
        recording.build([path], saved, page=page)
        # 236.5 is after the last frame, when the pictures are gone
        for at_s in (235.0, 236.5) if page == layout.OVERVIEW else (235.0,):
            reports = program.take_picture(saved, picture, at_s)
            assert len(reports) >= 5, page
            assert not any(texts for _, texts in reports), reports
            assert picture.stat().st_size > 20_000
            names |= {name for name, _ in reports if "amera" in name or "etections" in name}
    if policy.otherwise == "none":
        assert any(name.startswith("Detections, no pictures") for name in names)
    else:
        assert any(name.startswith("Star camera: green identified") for name in names)


def test_other_logs_are_drawn_over_the_first(log, tmp_path):
    """Two runs of one name: both curves are in one plot, each with its own sigmas."""
    other = tmp_path / "other.mcap"
    options = OPTIONS._replace(seed=2)
    with LogWriter(other, synthetic_run.mission(seed=2), FramePolicy(0, "none", 4.0)) as writer:
        for record in synthetic_run.simulate(options):
            writer.write(record)
    saved = tmp_path / "both.rrd"
    viewer.view([log, other], save=saved)
    entities = {str(chunk.entity_path) for chunk in chunks(saved)}
    assert {"/plots/errors/velocity_x/error", "/plots/errors/velocity_x/made_up-2/error"} <= entities
    assert "/plots/nees/made_up-2" in entities
    everything = {str(chunk.entity_path) for chunk in RrdReader(saved).stream()}
    assert "/world/overlay/made_up-2" in everything
    for logs, told in (([log, other], "Laid over made_up-1"), ([log], None)):
        recording.build(logs, saved)
        texts = [
            chunk.to_record_batch().column("TextDocument:text")[0].as_py()[0]
            for chunk in RrdReader(saved).stream()
            if str(chunk.entity_path).startswith("/legend/")
        ]
        assert len(texts) == len(layout.PAGES)
        assert all((told is not None) == text.startswith("**Logs.** Laid over made_up-1") for text in texts)
        assert all(("orange made_up-2" in text) == (told is not None) for text in texts)


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


def test_pictures_leave_the_environment_as_it_was(log, tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("RUST_LOG", "warn")
    with program._without_screen():
        assert Path(os.environ["XDG_RUNTIME_DIR"]).is_dir() and os.environ["RUST_LOG"] == "warn"
    assert "XDG_RUNTIME_DIR" not in os.environ and os.environ["RUST_LOG"] == "warn"


def test_rerun_reads_the_same_messages_as_the_official_library(log):
    """Two implementations of MCAP and protobuf: topics and messages by the index, rows by decoding."""
    counts, rows = Counter(), Counter()
    with log.open("rb") as file:
        for _, channel, _, message in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            counts[channel.topic] += 1
            rows[channel.topic] += len(message.transforms) if channel.topic == "/tf" else 1
    reader, others = McapReader(log), Counter()
    assert {channel.topic: channel.message_count for channel in reader.info().channels} == counts
    for chunk in chunks_of(reader):
        others[str(chunk.entity_path)] += chunk.num_rows
    assert len(counts) > 15
    assert {topic: others[topic] for topic in counts} == rows


def chunks_of(reader):
    return [chunk for chunk in reader.stream() if not chunk.is_static]


def test_curves_are_on_both_timelines(log, tmp_path):
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    for chunk in chunks(saved):
        if str(chunk.entity_path) in ("/plots/height", "/star_tracker/image", "/tf"):
            assert {"mission_time", "utc"} <= set(chunk.timeline_names)
            batch = chunk.to_record_batch()
            seconds = batch.column("mission_time").cast("int64").to_numpy() / 1e9
            utc = batch.column("utc").cast("int64").to_numpy() / 1e9
            assert utc - seconds == pytest.approx(1340392680.0, abs=1e-3)  # 2012-06-22T19:18:00Z


def wide(record):
    """A frame with 12 bits: sky of 400 with a noise of 6, and a star."""
    if type(record).__name__ != "Frame":
        return record
    rows, columns = record.image_dn.shape
    image = np.random.default_rng(record.number).normal(400.0, 6.0, (rows, columns)).astype(np.uint16)
    image[10, 20] = 2000
    return record._replace(image_dn=image, bits=12)


@NO_VULKAN
def test_all_marks_of_a_long_lens_are_over_its_picture(tmp_path):
    """35 mm behind 1024 pixels of 5.5 um: squares of both kinds are seen, the picture does not hide them."""
    from matplotlib.image import imread

    path, saved, picture = (tmp_path / name for name in ("run.mcap", "run.rrd", "picture.png"))
    mission = synthetic_run.mission()._replace(camera=pinhole(1024, 1024, 35.0 / 0.0055))
    sky = np.random.default_rng(1).normal(12.0, 2.0, (1024, 1024)).clip(0.0).astype(np.uint8)
    with LogWriter(path, mission, FramePolicy(10, "thresholded", 4.0)) as log:
        for record in synthetic_run.simulate(OPTIONS._replace(end_s=232.0, frame_pixels=False)):
            log.write(record._replace(image_dn=sky) if type(record).__name__ == "Frame" else record)
    recording.build([path], saved, page=layout.STARS)
    program.take_picture(saved, picture, 231.5)
    shown = np.rint(255.0 * imread(picture)[90:760, 10:1060, :3])  # where the page has its star camera
    for colour, count in ((GREEN, 22), (ORANGE, 8)):
        seen = np.all(np.abs(shown - colour) < 40.0, axis=2)
        assert seen.sum() > 50 * count, colour  # a square has more than 50 points, where no other covers it


def shown_pictures(saved, entity):
    """Pictures of a recording by mission time: {s: (rows, columns) array}."""
    found = {}
    for chunk in chunks(saved):
        if str(chunk.entity_path) != entity:
            continue
        batch = chunk.to_record_batch()
        if "Image:buffer" not in batch.schema.names:
            continue
        times = batch.column("mission_time").cast("int64").to_numpy() / 1e9
        for t_s, data, form in zip(
            times,
            batch.column("Image:buffer").to_pylist(),
            batch.column("Image:format").to_pylist(),
            strict=True,
        ):
            if data:
                assert form[0]["channel_datatype"] == 6  # 8 bits
                shape = form[0]["height"], form[0]["width"]
                found[round(t_s, 3)] = np.array(data[0], dtype=np.uint8).reshape(shape)
    return found


@pytest.mark.parametrize("full_every", [10, 0])
def test_twelve_bits_are_not_black(full_every, tmp_path):
    """Sky is dark grey, a star white; without a frame as read out the whole range of the camera is shown."""
    path, saved = tmp_path / "run.mcap", tmp_path / "run.rrd"
    policy = FramePolicy(full_every, "thresholded", 4.0)
    with LogWriter(path, synthetic_run.mission(), policy) as log:
        for record in synthetic_run.simulate(OPTIONS._replace(end_s=233.0)):
            log.write(wide(record))
    recording.build([path], saved)
    thresholded = shown_pictures(saved, "/star_tracker/image")
    full = shown_pictures(saved, "/star_tracker/image_full")
    assert len(thresholded) >= 15
    for image in thresholded.values():
        assert image[10, 20] == (255 if full_every else round(255 * 2000 / 4095))
        assert np.mean(image == 0) > 0.99
    assert (len(full) >= 1) == bool(full_every)
    for image in full.values():
        assert image[10, 20] == 255
        # three sigma above black, of 23 to white
        assert np.median(image) == pytest.approx(255 * 3 / 23, abs=6)
        assert 7.0 < image[:8].std() < 15.0  # a sigma is 11


def test_all_frames_are_there_from_the_first_instant_on(tmp_path):
    """The viewer opens at the first instant of the recording: a scene without a frame is an error there."""
    path, saved = tmp_path / "run.mcap", tmp_path / "run.rrd"
    mission = synthetic_run.mission(start_s=OPTIONS.start_s - 0.01)  # the first tick is not the start
    with LogWriter(path, mission, synthetic_run.NO_PIXELS) as writer:
        for record in synthetic_run.simulate(OPTIONS._replace(end_s=233.0)):
            writer.write(record)
    recording.build([path], saved)
    first = {}
    for chunk in chunks(saved):
        batch = chunk.to_record_batch()
        time = batch.column("mission_time").cast("int64").to_numpy().min()
        first[str(chunk.entity_path)] = min(time, first.get(str(chunk.entity_path), time))
    del first["/log"]  # of the made-up mission, whose events begin before it
    assert first["/tf"] == first["/world/level"] == min(first.values()) == 230_990_000_000


def test_every_page_has_a_text_about_it(log, tmp_path):
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    entities = {str(chunk.entity_path) for chunk in RrdReader(saved).stream()}
    assert set(legend.TEXTS) == set(layout.PAGES)
    assert {f"/{legend.entity(page)}" for page in layout.PAGES} <= entities


def values_of(saved, entity, component):
    """(mission times s, first values) of a component of an entity."""
    times, values = [], []
    for chunk in chunks(saved):
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if component in name]
        if str(chunk.entity_path) == entity and names:
            times += (batch.column("mission_time").cast("int64").to_numpy() / 1e9).tolist()
            values += [value[0] for value in batch.column(names[0]).to_pylist()]
    return times, values


def test_what_was_no_measurement_is_no_mark_among_the_innovations(tmp_path):
    """Two position fixes that are refused: one by its NIS, one because there was none."""
    path, saved = tmp_path / "run.mcap", tmp_path / "run.rrd"
    nan, three = float("nan"), np.zeros(3)
    gate = rec.GateResult(233.0, 232.8, "gps_position", 3, 40.0, 20.0, False, "too far off", three)
    none = gate._replace(t_s=234.0, dof=0, nis=nan, limit=nan, note="no fix: pdop 12", innovation=three[:0])
    with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS) as writer:
        for record in (*synthetic_run.simulate(OPTIONS._replace(end_s=235.0)), gate, none):
            writer.write(record)
    recording.build([path], saved)
    times, shares = values_of(saved, "/plots/nis/gps_position/refused", "scalars")
    assert times == [pytest.approx(233.0)] and shares == [pytest.approx(2.0)]


def test_errors_beyond_the_scale_are_told(log):
    """The title names the largest error if its plot cuts it off, and only then."""
    data = recording.read(log)
    errors = metrics.navigation_errors(data)
    largest = np.abs(np.hstack([errors.position_i, errors.velocity_i, np.degrees(errors.attitude_b)])).max(
        axis=0
    )
    for (limit, words), most in zip(layout._error_limits(data), largest, strict=True):
        assert words == (f"; peak {most:.2g} is cut off" if most > limit else "")
    spike = data.nav.r_i.copy()
    spike[5] += 1e4
    (_, words), *_ = layout._error_limits(data._replace(nav=data.nav._replace(r_i=spike)))
    assert words == "; peak 1e+04 is cut off"


def test_names_of_states_are_whole_or_not_there(tmp_path):
    """A state of two seconds in a flight of 500 has no room for its name, one of 100 has."""
    import rerun as rr

    stream = rr.RecordingStream("shefex_nav", recording_id="lanes")
    stream.save(tmp_path / "lanes.rrd")
    lane = Sender(stream, "2012-06-22T19:18:00Z").lane
    lane(
        "states/x",
        [0.0, 100.0, 102.0],
        ["fix", "no fix", "fix"],
        {"fix": GREEN, "no fix": GREEN},
        (0.0, 500.0),
    )
    stream.flush()
    stream.disconnect()
    times, states = values_of(tmp_path / "lanes.rrd", "/states/x", "state")
    assert times == [0.0, 100.0, 102.0]
    assert states == ["fix", f"no fix{NAMELESS}", "fix"]


@pytest.mark.parametrize(("value", "limit"), [(0.7, 1.2), (1.3, 2.4), (2.5, 6.0), (7.0, 12.0), (0.0, 1.2e-6)])
def test_scales_contain_their_values(value, limit):
    assert layout._largest(np.array([-value, np.nan, 0.5 * value])) == pytest.approx(limit)


@pytest.mark.parametrize(("option", "name"), [("--screenshot", "picture.jpg"), ("--save", "run.png")])
def test_a_file_of_another_kind_is_refused_in_one_line(log, tmp_path, command, option, name):
    result = command("view", log, option, tmp_path / name)
    assert result.code == 2 and len(result.err.splitlines()) == 1
    assert option in result.err and name in result.err and ("PNG" in result.err) == (option == "--screenshot")
    assert not (tmp_path / name).exists()


def test_a_cut_log_is_told_once_and_by_us(log, tmp_path, command):
    cut, saved = tmp_path / "cut.mcap", tmp_path / "cut.rrd"
    cut.write_bytes(log.read_bytes()[: int(0.6 * log.stat().st_size)])
    result = command("view", cut, "--save", saved)
    told, wrote = result.err.splitlines()
    assert result.code == 0 and wrote == f"wrote {saved}"
    assert told.startswith(f"{cut}: the run ended early, at T+")
    first = saved.read_bytes()
    again = command("view", cut, "--save", saved, "--force")
    assert again.code == 0 and saved.stat().st_size == pytest.approx(len(first), rel=0.01)


class SlowViewer:
    """Shows more and more, then always the same."""

    def __init__(self, shown):
        self.shown, self.taken = list(shown), 0

    def save_screenshot(self, path):
        self.taken += 1
        Path(path).write_text(self.shown.pop(0) if len(self.shown) > 1 else self.shown[0])


@pytest.mark.parametrize(
    ("shown", "taken"), [(["all"], 2), (["half", "more", "all"], 4), ([str(k) for k in range(100)], 20)]
)
def test_a_picture_is_taken_when_nothing_more_comes_in(shown, taken, tmp_path, monkeypatch):
    monkeypatch.setattr(program, "SETTLE_S", 0.0)
    viewer_, picture = SlowViewer(shown), tmp_path / "picture.png"
    program._save_settled(viewer_, picture)
    assert viewer_.taken == taken
    assert picture.read_text() == (shown[-1] if taken < program.MOST_PICTURES else shown[taken - 1])
