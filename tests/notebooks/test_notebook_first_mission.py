"""Notebook 1, with flights that end soon after the star tracker's first attitudes."""

import numpy as np
import pytest
from cells import execute


@pytest.mark.slow
def test_first_mission(monkeypatch):
    changes = {"star_tracker.rate": "2 Hz", "log.rate": "10 Hz"}
    found = execute("01_first_mission", monkeypatch, UNTIL_S=254.0, AT_S=253.0, CHANGES=changes)
    run, own, long = found["run"], found["own"], found["long"]
    assert run.data.last_t_s == own.data.last_t_s == 254.0
    assert np.degrees(np.linalg.norm(run.errors().at(253.0).attitude_b)) < 0.1
    highest = [np.linalg.norm(one.truth.r_i, axis=1).max() for one in (run, own)]
    assert highest[1] < highest[0] - 20e3
    assert run.summary()["flight"]["apogee_km"] is None  # it is at T+262 s
    assert (own.frames[253.0].fix.hip > 0).sum() > (run.frames[253.0].fix.hip > 0).sum()
    assert long.summary()["star_tracker"]["solved"] == long.summary()["star_tracker"]["wrong"] == 0
