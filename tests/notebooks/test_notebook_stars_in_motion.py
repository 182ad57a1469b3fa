"""Notebook 4."""

import numpy as np
from cells import execute


def test_stars_in_motion(monkeypatch):
    found = execute("04_stars_in_motion", monkeypatch)
    assert np.all(np.abs(found["error"]) < 5.0 * found["sigma"])
    assert found["verified"] is None
