"""Flights in real time: when a tick begins, which answers are late, and that nothing else differs."""

import json

import numpy as np
import pytest

from shefex_nav import prepare, simulate
from shefex_nav.clock import TICK_HZ
from shefex_nav.pacing import Pace
from shefex_nav.records import ComputeTime
from shefex_nav.report import table
from shefex_nav.scenario.load import load
from tests.software.own_flights import same

TICK_S = 1.0 / TICK_HZ


class FakeClock:
    """A clock that goes on only when somebody sleeps or works."""

    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s

    def pass_s(self, duration_s):
        self.now_s += duration_s


class Working:
    """Software whose tick n takes `advance_s[n]` and `update_s[n]` of the clock."""

    def __init__(self, clock, advance_s, update_s):
        self._clock, self._advance_s, self._update_s = clock, advance_s, update_s
        self.begun_s, self.last = [], []

    def advance(self, blocks, first, last):
        self.begun_s.append(self._clock.now_s)
        self.last.append(last)
        self._clock.pass_s(self._advance_s[len(self.begun_s) - 1])
        return 1, []

    def update(self, arrived):
        self._clock.pass_s(self._update_s[len(self.begun_s) - 1])
        return []

    def close(self):
        pass


def paced(pace, advance_s, update_s, drawing_s=0.0):
    """RealTime of a flight whose ticks take so long, and when they began."""
    clock = FakeClock()
    kept, work = Pace(pace, clock, clock.pass_s), Working(clock, advance_s, update_s)
    software = kept.around(work)
    for k in range(len(advance_s)):
        software.advance(None, k, len(advance_s))
        clock.pass_s(drawing_s)
        software.update([])
    assert work.last == list(range(1, len(advance_s) + 1))  # never more than one tick at once
    return kept.real_time(), np.array(work.begun_s)


@pytest.mark.parametrize("pace", [0.5, 1.0, 4.0])
def test_ticks_begin_at_the_pace(pace):
    n = 50
    kept, begun_s = paced(pace, [0.0005] * n, [0.0005] * n)
    assert np.allclose(begun_s, np.arange(n) * TICK_S / pace, atol=1e-9)
    assert kept.late_answers == 0
    assert kept.ticks == n and kept.mission_s == pytest.approx(n * TICK_S)
    assert kept.elapsed_s == pytest.approx(n * TICK_S / pace)
    assert kept.begin_late_s["max"] == pytest.approx(0.0, abs=1e-9)
    assert kept.answer_s["median"] == pytest.approx(0.001)


def test_a_slow_answer_is_counted_and_the_ticks_after_it_catch_up():
    update_s = [0.001] * 20
    update_s[5] = 0.034  # until T+0.084 s: ticks 6, 7 and 8 begin late, 9 does not
    kept, begun_s = paced(1.0, [0.0] * 20, update_s)
    assert kept.late_answers == 1
    assert kept.answer_s["max"] == pytest.approx(0.034)
    late_s = begun_s - np.arange(20) * TICK_S
    assert np.flatnonzero(late_s > 1e-9).tolist() == [6, 7, 8]
    assert late_s[[6, 7, 8]] == pytest.approx([0.024, 0.015, 0.006])
    assert kept.begin_late_s["max"] == pytest.approx(0.024)


def test_an_answer_is_advance_and_update_without_what_is_drawn_between():
    kept, _ = paced(1.0, [0.004] * 10, [0.007] * 10)
    assert kept.late_answers == 10
    kept, _ = paced(1.0, [0.004] * 10, [0.005] * 10, drawing_s=0.003)
    assert kept.late_answers == 0 and kept.answer_s["max"] == pytest.approx(0.009)
    assert kept.begin_late_s["max"] > 0.015  # ten times two milliseconds


def test_a_flight_at_a_pace_has_the_records_of_any_other(default_scenario):
    scenario = prepare.settled(load(default_scenario.with_name("night_sky.yaml")))
    pace, found = Pace(30.0), []
    for clock in (None, pace):
        world = prepare.build_world(scenario, 1)
        records = simulate.route(world, scenario, 1, until_s=3.0, pace=clock)
        found.append([one for one in records if not isinstance(one, ComputeTime)])
    assert same(*found)
    assert pace.real_time().ticks == 300


def test_run_at_a_pace(command, tmp_path):
    log = tmp_path / "paced.mcap"
    done = command("run", "night_sky", "--until", "1.5s", "--pace", "20", "--out", log, "--json")
    assert done.code == 0
    kept = json.loads(done.out)["real_time"]
    assert kept["pace"] == 20.0 and kept["ticks"] == 150 and kept["elapsed_s"] >= 1.5 / 20.0 - 1e-6


@pytest.mark.parametrize("pace", ["1e-300", "0", "-1", "nan", "inf"])
def test_a_pace_that_is_none(command, tmp_path, pace):
    done = command("run", "night_sky", "--pace", pace, "--out", tmp_path / "none.mcap")
    assert done.code == 2 and "from 0.001 on; 1 is real time" in done.err.replace("\n", " ").replace("│", "")
    assert not list(tmp_path.iterdir())


def test_long_durations_are_told_in_seconds():
    spread = {"median": 0.00014, "p99": 0.9996, "max": 25.04892}
    kept = {"pace": 1.0, "ticks": 2000, "mission_s": 20.0, "elapsed_s": 28.72, "late_answers": 26}
    rows = dict(table._real_time_rows(kept | {"begin_late_s": spread, "answer_s": spread}))
    assert rows["answer to a tick"] == "0.14 ms median, 99 % below 999.60 ms, 25.05 s at most"
    assert str(rows["late answers"]) == "26 of 2000, longer than a tick"
    kept |= {"late_answers": 1001, "begin_late_s": spread, "answer_s": spread}
    assert str(dict(table._real_time_rows(kept))["late answers"]).endswith(": the software does not keep up")
