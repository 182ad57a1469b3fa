"""Notebook 3, with two pictures a second, and flights that end after the entry."""

import numpy as np
import pytest
from cells import execute

from shefex_nav.report import star_metrics


@pytest.mark.slow
def test_what_the_star_tracker_buys(monkeypatch):
    changes = {"star_tracker.rate": "2 Hz", "log.rate": "10 Hz"}
    found = execute("03_what_the_star_tracker_buys", monkeypatch, UNTIL_S=399.0, CHANGES=changes)
    worst = {}
    for name, run in found["runs"].items():
        entry = run.errors().at(run.event("entry").t_s)
        worst[name] = np.degrees(np.abs(entry.attitude_b)).max()
        assert np.linalg.norm(entry.position_i) < 2.0
    assert worst["with"] < 0.02 and worst["blinded"] < 0.02 < worst["without"]
    angle, accepted = found["angle"], found["accepted"]
    wrong = int((angle > star_metrics.WRONG_ANGLE).sum())
    assert len(found["wrong_at"]) == wrong > 10 and len(found["used_at"]) == accepted.sum() > 100
    assert found["wrong_and_used"] == 0
    assert wrong <= (~accepted).sum() <= wrong + 3  # right and refused: before the gate is up, two must agree
