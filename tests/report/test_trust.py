"""Figures of trust, counted by hand."""

from types import SimpleNamespace

import numpy as np

from shefex_nav.records import Doubt, NavHealth
from shefex_nav.report import trust


def run(protection_deg, error_deg, doubt):
    """Ten ticks with the same protection level on all axes, an error about y and a Doubt each."""
    t_s = np.arange(10.0)
    doubt = np.array([int(value) for value in doubt])
    level = np.radians(np.repeat(np.array(protection_deg)[:, None], 3, axis=1))
    nav = SimpleNamespace(t_s=t_s, protection_b=level, do_not_use=doubt != 0, doubt=doubt)
    attitude_b = np.zeros((10, 3))
    attitude_b[:, 1] = np.radians(error_deg)
    data = SimpleNamespace(nav=nav, health=[])
    return trust.trust(data, SimpleNamespace(t_s=t_s, attitude_b=attitude_b), 7.0)


def test_shares_and_entry():
    doubt = [Doubt.ATTITUDE] * 3 + [Doubt.IMU] + [Doubt.NONE] * 6
    error = [9.0, 9.0, 0.0, 9.0, 0.2, -0.05, 0.05, 0.05, 0.05, 0.05]
    found = run([0.1] * 7 + [0.15] * 3, error, doubt)
    assert found["usable_share"] == 0.6
    assert found["doubts"] == {"attitude": 0.3, "imu": 0.1}
    assert found["misleading_share"] == 0.1  # the error of 0.2 deg; those of 9 deg were not to be used
    assert found["at_entry"]["usable"] and found["at_entry"]["doubt"] == "none"
    assert np.allclose(found["at_entry"]["protection_deg"], 0.15)


def test_an_older_log_has_none():
    assert run([np.nan] * 10, [0.0] * 10, [Doubt.NONE] * 10) is None


def test_what_was_noticed_and_for_how_long():
    said = [
        NavHealth(1.0, "gps", False, "frozen: position of T+0.0 s"),
        NavHealth(2.0, "gyro y", False, "stuck"),
        NavHealth(3.0, "gps", False, "no fix: outage"),
        NavHealth(4.0, "gps", True, ""),
    ]
    found = [(e["source"], e["from_s"], e["until_s"], e["reason"].split(":")[0]) for e in trust.noticed(said)]
    assert found == [
        ("gps", 1.0, 3.0, "frozen"),
        ("gyro y", 2.0, None, "stuck"),
        ("gps", 3.0, 4.0, "no fix"),
    ]
