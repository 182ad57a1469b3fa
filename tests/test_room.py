"""What a flight keeps: so much for each tick, and the truth of a long one in files beside its log."""

import errno
import gc
import mmap
import os
import tracemalloc
import weakref
from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare, runs, simulate
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.steady import Reached
from shefex_nav.log.topics import LogError
from shefex_nav.runs import flying
from shefex_nav.runs.room import Room, RoomError
from shefex_nav.scenario.load import load
from shefex_nav.world.flight.record import Memory

ORBIT = Path(__file__).parent.parent / "scenarios" / "orbit.yaml"


def orbit(seconds):
    """The orbit for so long, its camera off, its attitude left alone."""
    still = "programme.slew=null", "programme.pointing=null", "star_tracker.enabled=false"
    short = f"mission.time_limit={seconds:g} s", "star_tracker.on=1 s", f"star_tracker.off={seconds:g} s"
    return load(ORBIT, [*still, *short])


def bytes_of(function):
    """(what it returns, bytes that are left of it, bytes at most on the way)."""
    gc.collect()
    tracemalloc.start()
    try:
        found = function()
        gc.collect()
        return found, *tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()


def kept(seconds):
    """(3,) bytes: of a flight at most, of its world before the first tick, of the run after the last one."""
    scenario = orbit(seconds)
    flight, _, most = bytes_of(lambda: prepare.fly_vehicle(scenario, 1))
    world, sensed, _ = bytes_of(lambda: prepare.build_world(scenario, 1, flight=flight))
    steady, builder = simulate.steady_columns(world, 10), RunDataBuilder(None)

    def fly():
        for record in simulate.route(world, scenario, 1, columns=steady):
            if type(record) is not Reached:
                builder.add(record)
        return builder.build(steady.read())

    _, left, _ = bytes_of(fly)
    return np.array([most, sensed, left])


def test_the_arrays_of_a_flight_go_with_it():
    """They wait for no search of cycles, which is seldom: a study of a thousand flights held gigabytes."""
    gc.collect()
    gc.disable()
    try:
        r_i = prepare.fly_vehicle(orbit(20.0), 1).trajectory.r_i
        kept = weakref.ref(r_i if r_i.base is None else r_i.base)
        del r_i
        assert kept() is None
    finally:
        gc.enable()


def test_bytes_that_a_tick_of_a_flight_takes():
    kept(2.0)  # what a process keeps once
    flight, sensed, run = (kept(30.0) - kept(10.0)) / 2000.0
    assert 4 * 226 <= flight < 4 * 250  # four samples: fourteen columns, and the height on the way
    assert 4 * 49 <= sensed < 4 * 49 + 100  # IMU; a second of GPS
    assert 100.0 < run < 300.0  # at 10 Hz the numbers of solution and covariance, twice; gates


def test_a_flight_whose_truth_lies_in_files_is_the_same(tmp_path, monkeypatch):
    places, scenario = [], orbit(20.0)

    class InFiles(Room):
        def empty(self, shape):
            found = super().empty(shape)
            places.append(len(self._maps))
            return found

    plain = runs.fly(scenario, 3, log=tmp_path / "plain.mcap")
    monkeypatch.setattr(flying, "Room", lambda folder: InFiles(folder, least=1))
    filed = runs.fly(scenario, 3, log=tmp_path / "filed.mcap")
    assert places == [1, 2, 3, 4, 5, 6, 7, 8]  # a file for each column of the record
    assert sorted(path.name for path in tmp_path.iterdir()) == ["filed.mcap", "plain.mcap"]
    for name in ("truth", "imu", "nav", "covariance"):
        ours, others = getattr(plain.data, name), getattr(filed.data, name)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(ours, others, strict=True)), name
    assert len(plain.data.gps) == len(filed.data.gps) > 15


def test_a_log_without_a_folder_is_refused_before_there_is_a_room(tmp_path, monkeypatch):
    monkeypatch.setattr(flying, "Room", lambda folder: pytest.fail("a room was made"))
    with pytest.raises(LogError, match=r"a\.mcap: cannot be written: no folder"):
        runs.fly(orbit(20.0), 3, log=tmp_path / "none" / "a.mcap")


def test_small_arrays_are_in_memory_and_large_ones_are_not_lost_when_they_leave_it(tmp_path):
    room = Room(tmp_path, least=1 << 20)
    small, large = room.empty((1000, 3)), room.empty((1 << 17, 3))
    assert small.base is None and isinstance(large.base.base, memoryview | mmap.mmap | np.ndarray)
    large[:] = np.arange(large.size).reshape(large.shape)
    room.release()
    assert np.array_equal(large.ravel(), np.arange(large.size)) and large.flags.c_contiguous
    assert not list(tmp_path.iterdir())


def test_the_first_rows_hold_no_room_of_the_rest_and_files_are_not_written_twice(tmp_path):
    """In memory they are a copy; of a file the other pages take no memory, and a copy would take as much."""
    small, large = Room(tmp_path, least=1), Room(tmp_path, least=1 << 30)
    for room, held in ((Memory(), False), (large, False), (small, True)):
        whole = room.empty((1000, 3))
        whole[:] = 1.5
        part = room.part(whole[:10])
        np.testing.assert_array_equal(part, np.full((10, 3), 1.5))
        assert np.shares_memory(part, whole) == held


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="the disk is not asked beforehand")
def test_a_full_disk_is_said_before_anything_flies(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(RoomError, match=r"no room for the truth .* 3\.2 GB .*: No space left on device"):
        Room(tmp_path, least=1).empty((400_000_000,))
