"""Notebook 3, with two pictures a second, and flights that end after the entry."""

import numpy as np
from cells import execute


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
    assert (angle > np.radians(0.5)).sum() > 10  # wrong ones there were
    assert (~accepted).sum() >= (angle > np.radians(0.5)).sum() - 3  # before the gate is up, two must agree
