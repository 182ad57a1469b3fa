"""Notebook 2, with fewer pictures."""

import numpy as np
from cells import execute


def test_star_tracker_stages(monkeypatch):
    found = execute("02_star_tracker_stages", monkeypatch, MANY=8)
    assert (found["found"].star >= 0).sum() >= 6
    assert set(found["refused"]) >= {"NONE"} and found["refused"]["NONE"] == 0
    assert len(found["error"]) == 8
    scatter = found["error"].std(axis=0, ddof=1) / found["sigma"].mean(axis=0)
    assert np.all((scatter > 0.3) & (scatter < 2.0))  # of eight: 0.49 to 1.51 in 95 % of cases, each
    _, squared, variance = np.array(found["errors"]["fit"]).T
    assert 0.6 < np.mean(squared / variance) < 1.6
