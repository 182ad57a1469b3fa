"""Pixels of frames read back from a log."""

import numpy as np
import pytest
import synthetic_run

from shefex_nav.log import pixels, topics
from shefex_nav.log.drawings import FramePolicy, thresholded
from shefex_nav.log.writer import LogWriter
from shefex_nav.records import Frame

POLICY = FramePolicy(full_every=4, otherwise="thresholded", threshold_sigma=4.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Two seconds of the made-up mission: path, its frames, their log times."""
    path, frames = tmp_path_factory.mktemp("pixels") / "run.mcap", []
    mission = synthetic_run.mission(start_s=236.0)
    options = synthetic_run.Options(start_s=236.0, end_s=238.0)
    with LogWriter(path, mission, POLICY) as writer:
        for record in synthetic_run.simulate(options):
            writer.write(record)
            frames += [record] if type(record) is Frame else []
    epoch = topics.epoch_ns(mission.epoch_utc)
    ns = topics.log_time_ns(epoch, np.array([frame.t_valid_s for frame in frames]))
    return path, frames, ns.tolist()


def test_every_frame_comes_back_as_it_was_kept(log):
    path, frames, times = log
    assert len(frames) > 12
    for frame, ns in zip(frames, times, strict=True):
        found = pixels.at(path, ns)
        is_full = frame.number % POLICY.full_every == 0
        kept = frame.image_dn if is_full else thresholded(frame.image_dn, POLICY.threshold_sigma)
        assert found.is_full == is_full and found.ns == ns
        assert found.image_dn.dtype == np.uint8
        assert np.array_equal(found.image_dn, kept)


def test_there_is_none_between_two_frames(log):
    path, _, times = log
    assert pixels.at(path, times[0] + 1) is None


def test_all_of_them(log):
    path, frames, times = log
    n_full = sum(frame.number % POLICY.full_every == 0 for frame in frames)
    found = list(pixels.between(path))
    assert len(found) == len(frames) + n_full
    assert sorted({one.ns for one in found}) == times
    some = list(pixels.between(path, times[3], times[6]))
    assert sorted({one.ns for one in some}) == times[3:6]


@pytest.mark.parametrize("share", [0.4, 0.7, 0.999])
def test_a_cut_log_gives_the_frames_that_it_has(log, share, tmp_path):
    path, _, times = log
    whole = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(share * len(whole))])
    found = {one.ns for one in pixels.between(cut)}
    assert found <= set(times)
    assert (len(found) == 0) == (share < 0.1)
    last = max(found)
    assert pixels.at(cut, last) is not None
    assert np.array_equal(pixels.at(cut, last).image_dn, pixels.at(path, last).image_dn)


def test_sixteen_bits_come_back_as_measured(tmp_path):
    mission = synthetic_run.mission()
    image = (np.arange(24, dtype=np.uint16) * 150).reshape(4, 6)
    path = tmp_path / "wide.mcap"
    frame = Frame(0, 0.0, 0.0, 0.1, 0.05, 0.0, image, bits=12)
    with LogWriter(path, mission, FramePolicy(1, "none", 4.0)) as writer:
        writer.write(frame)
    found = pixels.at(path, topics.epoch_ns(mission.epoch_utc))
    assert found.is_full and found.image_dn.dtype == np.uint16
    assert np.array_equal(found.image_dn, image)
