"""Pictures in a recording, and pictures that the real viewer takes of one."""

import os
import time
from pathlib import Path

import numpy as np
import pytest
import synthetic_run
from recorded import NO_VULKAN, OPTIONS, chunks

from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.writer import LogWriter
from shefex_nav.report.viewer import ViewerError, layout, program, recording
from shefex_nav.report.viewer.sender import GREEN, ORANGE


@NO_VULKAN
@pytest.mark.parametrize(
    "policy, pages",
    [
        pytest.param(FramePolicy(10, "thresholded", 4.0), layout.PAGES, marks=pytest.mark.slow),
        pytest.param(  # the other pages show no frames
            FramePolicy(0, "none", 4.0), (layout.OVERVIEW, layout.STARS), marks=pytest.mark.slow
        ),
    ],
)
def test_no_view_reports_an_error(policy, pages, tmp_path):
    path, picture = tmp_path / "run.mcap", tmp_path / "picture.png"
    with LogWriter(path, synthetic_run.mission(), policy) as log:
        for record in synthetic_run.simulate(OPTIONS._replace(end_s=236.0)):
            log.write(record)
    saved = tmp_path / "run.rrd"
    recording.build([path], saved)
    names = set()
    for page in pages:
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


@NO_VULKAN
@pytest.mark.slow
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
    shown = np.rint(255.0 * imread(picture)[90:760, 10:760, :3])  # where the page has its star camera
    for colour, count in ((GREEN, 22), (ORANGE, 8)):
        seen = np.all(np.abs(shown - colour) < 40.0, axis=2)
        assert seen.sum() > 50 * count, colour  # a square has more than 50 points, where no other covers it


def wide(record):
    """A frame with 12 bits: sky of 400 with a noise of 6, and a star."""
    if type(record).__name__ != "Frame":
        return record
    rows, columns = record.image_dn.shape
    image = np.random.default_rng(record.number).normal(400.0, 6.0, (rows, columns)).astype(np.uint16)
    image[10, 20] = 2000
    return record._replace(image_dn=image, bits=12)


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


class SlowViewer:
    """Shows more and more, then always the same."""

    def __init__(self, shown):
        self.shown, self.taken = list(shown), 0

    def save_screenshot(self, path):
        self.taken += 1
        Path(path).write_text(self.shown.pop(0) if len(self.shown) > 1 else self.shown[0])


@pytest.mark.parametrize(
    ("shown", "taken"), [(["all"], 4), (["half", "more", "all"], 6), ([str(k) for k in range(100)], 60)]
)
def test_a_picture_is_taken_when_nothing_more_comes_in(shown, taken, tmp_path, monkeypatch):
    """The last that was new, and three more that are the same."""
    monkeypatch.setattr(program, "SETTLE_S", 0.0)
    monkeypatch.setattr(program, "PAUSE_S", 0.0)
    viewer_, picture = SlowViewer(shown), tmp_path / "picture.png"
    program._save_settled(viewer_, picture)
    assert viewer_.taken == taken
    assert picture.read_text() == (shown[-1] if taken < program.MOST_PICTURES else shown[taken - 1])


def test_a_picture_must_not_change_for_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(program, "PAUSE_S", 0.01)
    monkeypatch.setattr(program, "SETTLE_S", 0.2)
    begin_s = time.monotonic()
    program._save_settled(SlowViewer(["all"]), tmp_path / "picture.png")
    assert time.monotonic() - begin_s >= 0.2


def test_no_graphics_is_a_clear_error(log, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "none.json"))
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "none.json"))
    monkeypatch.setenv("WGPU_BACKEND", "vulkan")
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    with pytest.raises(ViewerError, match="apt-get install mesa-vulkan-drivers"):
        program.take_picture(saved, tmp_path / "picture.png", 235.0)


def test_pictures_leave_the_environment_as_it_was(log, tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("RUST_LOG", "warn")
    with program._without_screen():
        assert Path(os.environ["XDG_RUNTIME_DIR"]).is_dir() and os.environ["RUST_LOG"] == "warn"
    assert "XDG_RUNTIME_DIR" not in os.environ and os.environ["RUST_LOG"] == "warn"
