"""Events of a flight along a file: an impact is on the ground, an apogee where the heights have their top."""

import numpy as np
import pytest
from given_flight import ALONG, ORIGIN, flown, in_orbit, scenario
from made import csv, satellite, write_ccsds

from shefex_nav.records import Phase
from shefex_nav.report import programme

G = 9.8  # m/s^2
COLUMNS = {
    "format": "csv", "origin": ORIGIN, "attitude": ALONG, "time": "t", "position": ["e", "n", "u"],
    "position_frame": "launch_enu", "velocity": ["ve", "vn", "vu"], "velocity_frame": "launch_enu",
}  # fmt: skip


def stone(path, height, climb, until_s, drift=0.0):
    """Section of a stone above the origin. height : m; climb, drift : m/s, up at the begin and to the east"""
    t_s = np.arange(round(until_s / 0.1) + 1) * 0.1
    none = np.zeros(len(t_s))
    up = height + climb * t_s - 0.5 * G * t_s**2
    columns = (t_s, drift * t_s, none, up, none + drift, none, climb - G * t_s)
    csv(path, ("t", "e", "n", "u", "ve", "vn", "vu"), columns)
    return {"file": path, "pad": "0 s"} | COLUMNS


def vertical(*stones):
    """Trajectory and {event: s} of a `stone`."""
    flight, _ = flown(stone(*stones), "mission.start=0 s")
    return flight.trajectory, {event.name: event.t_s for event in flight.events}


def test_a_satellite_that_sinks_has_no_impact(tmp_path):
    orbit = satellite()
    files = tmp_path / "s.oem", tmp_path / "s.aem"
    write_ccsds(*files, orbit)
    flight, _ = in_orbit({"file": files[0], "format": "oem", "attitude": {"aem": str(files[1])}})
    r = np.linalg.norm(flight.trajectory.r_i, axis=1)
    assert r[-1] < r[-2] and r[-1] < r[0]  # towards the perigee, 568 km up
    assert flight.events == () and set(flight.trajectory.phase) == {Phase.ORBIT}


@pytest.mark.parametrize("climb", [0.0, -100.0])
def test_a_file_that_ends_in_the_air_has_no_impact(tmp_path, climb):
    """From 30 km, let go or already on its way down, to 22 km or more."""
    _, events = vertical(tmp_path / "drop.csv", 30e3, climb, 30.0)
    assert "impact" not in events


def test_from_the_air_to_the_ground(tmp_path):
    _, events = vertical(tmp_path / "drop.csv", 3e3, -100.0, 16.5)
    assert events["impact"] == pytest.approx(16.5)


def test_what_lies_still_at_the_end_has_no_impact_there(tmp_path):
    """Down at 40.8 s, where the curve through the rows rings, then on a ground that sinks by 1 mm/s."""
    section = stone(tmp_path / "up.csv", 0.0, 200.0, 70.0, 30.0)
    lines = section["file"].read_text().splitlines()
    rows = np.array([line.split(",") for line in lines[1:]], dtype=float)
    down = rows[:, 0] > 2.0 * 200.0 / G
    since = rows[down, 0] - 2.0 * 200.0 / G
    rows[down, 1:] = 0.0
    rows[down, 1], rows[down, 3], rows[down, 6] = 30.0 * 2.0 * 200.0 / G, -1e-3 * since, -1e-3
    csv(section["file"], lines[0].split(","), rows.T)
    flight, _ = flown(section, "mission.start=0 s")
    events = {event.name: event.t_s for event in flight.events}
    assert "impact" not in events and not any("ignition" in name for name in events)
    assert events["apogee"] == pytest.approx(200.0 / G, abs=0.02)


def test_apogee_of_what_moves_when_the_file_begins(tmp_path):
    """Up with 200 m/s: the top is v/g later, from there on it descends, and it is down after twice that."""
    trajectory, events = vertical(tmp_path / "up.csv", 0.0, 200.0, 40.8)
    assert events["apogee"] == pytest.approx(200.0 / G, abs=0.02)
    assert events["impact"] == pytest.approx(40.8)
    down = trajectory.t_s > events["apogee"] + 0.01
    assert set(trajectory.phase[down]) == {Phase.DESCENT} and set(trajectory.phase[:8000]) == {Phase.COAST}


@pytest.mark.parametrize("drift, turned", [(0.0, True), (20.0, False)])
def test_forward_that_turns_round_is_warned_of(tmp_path, drift, turned):
    """Up and down again: along a velocity of 20 m/s to the east it turns in seconds, without it at once."""
    section = stone(tmp_path / "up.csv", 0.0, 200.0, 40.0, drift)
    found = [one.text for one in programme.of_trajectory(scenario(section, "mission.start=0 s"))]
    assert [words for words in found if "turns by 180 deg in 0.1 s at T+20." in words] == found
    assert bool(found) == turned
