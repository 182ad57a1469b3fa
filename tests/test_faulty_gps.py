"""GPS that is lost, frozen, jumps and drifts, over the default mission: what the scenarios promise."""

import numpy as np
import pytest
from faulty_flight import REQUIRED, fly

from shefex_nav.records import Doubt

SEED = 1


def largest_ratio(flown, columns, begin_s=-np.inf, end_s=np.inf):
    rows = flown.during(begin_s, end_s)
    return (np.abs(flown.error[rows, columns]) / flown.sigma[rows, columns]).max()


@pytest.mark.slow
def test_gps_lost_for_300_s():
    """T+100 s to T+400 s: position inside 3 sigma throughout, the attitude meets its requirement at entry."""
    flown = fly("gps_outage", seed=SEED)
    assert not flown.used("gps_position", 100.0, 400.0) and not flown.used("gps_velocity", 100.0, 400.0)
    lost = flown.during(100.0, 400.0)
    assert np.linalg.norm(flown.sigma[lost, :3], axis=1).max() > 100.0  # it does say that it knows little
    assert largest_ratio(flown, slice(0, 3)) < 3.0
    entry = flown.at(flown.entry_s)
    assert np.abs(flown.error[entry, 6:]).max() < REQUIRED
    assert np.all(flown.protection_b[entry] < REQUIRED) and flown.doubt[entry] == Doubt.NONE
    assert flown.used("gps_position", 400.0)[0] == pytest.approx(400.0)
    assert np.linalg.norm(flown.error[flown.at(402.0), :3]) < 10.0
    assert (100.2, "no fix: outage") in [(round(t, 6), why) for t, why in flown.noticed("gps")]


def test_a_frozen_receiver_through_the_boost():
    """It repeats the fix of T+2 s until T+60 s."""
    flown = fly("frozen_gps", seed=SEED)
    assert not flown.used("gps_position", 2.5, 60.0) and not flown.used("gps_velocity", 2.5, 60.0)
    notes = {gate.note for gate in flown.gates if 3.0 <= gate.t_valid_s < 60.0 and "gps" in gate.sensor}
    assert notes == {"frozen: position of T+2.0 s"}
    assert flown.used("gps_position", 60.0)[0] <= 62.0
    assert largest_ratio(flown, slice(0, 3), 0.0, 100.0) < 3.0
    assert [reason.split(":")[0] for _, reason in flown.noticed("gps")][:2] == ["frozen", ""]


def test_a_jump_without_velocity_is_the_receivers_fault():
    """300 m for 20 s: nothing of it is used, and the solution is not doubted for it."""
    flown = fly("frozen_gps", seed=SEED)
    assert not flown.used("gps_position", 100.0, 120.0)
    assert len(flown.used("gps_velocity", 100.0, 120.0)) == 20
    assert flown.used("gps_position", 120.0)[0] <= 121.0
    assert "moves without its velocity" in [reason for _, reason in flown.noticed("gps_position")]
    assert not (flown.doubt == Doubt.CONTRADICTED).any()
    assert np.linalg.norm(flown.error[flown.during(100.0, 140.0), :3], axis=1).max() < 10.0


def test_a_drift_without_velocity_is_noticed():
    """2 m/s for 60 s: 120 m in the end. Used are the first metres of it at most."""
    flown = fly("frozen_gps", seed=SEED)
    used = flown.used("gps_position", 280.0, 340.0)
    assert max(used) < 295.0
    assert flown.used("gps_position", 340.0)[0] <= 342.0
    drifting = flown.during(280.0, 360.0)
    assert np.linalg.norm(flown.error[drifting, :3], axis=1).max() < 20.0
    assert largest_ratio(flown, slice(0, 3), 280.0, 360.0) < 4.0


@pytest.mark.slow
def test_the_clean_flight_is_left_alone():
    """Nothing is doubted, or called stuck, drifting or frozen; the first star fix alone is held.

    One in 10 000 good measurements is rejected, of more than 2000: five are there once in 50 000 flights.
    """
    flown = fly("shefex2_andoya", seed=SEED)
    odd = [gate for gate in flown.gates if not gate.accepted and gate.dof]
    notes = [gate.note.split(":")[0] for gate in odd]
    assert notes.count("held") == 1 and set(notes) <= {"held", "rejected"} and len(notes) <= 5
    assert {record.source for record in flown.health} == {"gps"}  # losses after its events
    assert all(record.reason.startswith("no fix") for record in flown.health if not record.healthy)
    after_stars = flown.during(260.0, 420.0)
    assert not flown.doubt[after_stars].any()
    assert not (np.abs(flown.error[:, 6:]) > flown.protection_b).any()
