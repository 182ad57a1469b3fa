"""Notebook 5, with runs of two seconds on the ground, flown in this process."""

import pytest
from cells import FOLDER, execute
from short_campaign import HereLane

from shefex_nav.campaign import engine

SHORT = """
extends: {night_sky}
mission: {{name: short, time_limit: 2 s}}
star_tracker: {{off: 2 s}}
campaign: {{series: 2 Hz}}
"""


def test_campaign_statistics(monkeypatch, tmp_path):
    mission = tmp_path / "short.yaml"
    mission.write_text(SHORT.format(night_sky=FOLDER.parent / "scenarios" / "night_sky.yaml"))
    changes = {
        "requirements": {"wrong_star_fixes": 0, "star_fixes": "50 %"},
        "dispersions": {"imu.gyro.bias": {"log_normal": "40 %"}, "ground.latitude": {"normal": "1 deg"}},
        "star_tracker.rate": "2 Hz",
    }
    parameters = {"MISSION": str(mission), "CHANGES": changes, "RUNS": 16}
    parameters |= {"FOLDER": tmp_path / "campaign", "WORKERS": 1}
    monkeypatch.setattr(engine, "ProcessLane", HereLane)
    found = execute("05_campaign_statistics", monkeypatch, **parameters)
    campaign = found["campaign"]
    assert len(campaign) == 16 and campaign.succeeded.all()
    assert [one.name for one in found["statistics"].successes(campaign)] == ["wrong_star_fixes", "star_fixes"]
    with pytest.raises(AttributeError, match="no figure 'nothing'"):
        campaign.plot.nothing()
