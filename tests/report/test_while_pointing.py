"""Errors while the vehicle points: those of its phases POINTING alone."""

import numpy as np
import pytest

from shefex_nav.records import Phase
from shefex_nav.report import while_pointing
from shefex_nav.report.metrics import NavErrors


class Truth:
    """What is asked of a truth."""

    def __init__(self, phases):
        self.t_s, self.phase = np.arange(float(len(phases))), np.array(phases, dtype=np.int8)


def made(phases):
    n = len(phases)
    attitude_b = np.radians(np.outer(np.arange(n), [0.01, -0.02, 0.0]))
    position_i, velocity_i = np.outer(np.arange(n), [3.0, 4.0, 0.0]), np.outer(np.ones(n), [0.0, 0.0, 0.5])
    return while_pointing.errors(
        Truth(phases), NavErrors(np.arange(float(n)), position_i, velocity_i, attitude_b)
    )


def test_they_are_of_the_phases_pointing_alone():
    found = made([Phase.BOOST, Phase.POINTING, Phase.POINTING, Phase.DESCENT])
    assert (found["from_s"], found["to_s"]) == (1.0, 2.0)
    assert found["position_m"] == pytest.approx({"rms": np.sqrt((5**2 + 10**2) / 2), "max": 10.0})
    assert found["velocity_m_s"] == pytest.approx({"rms": 0.5, "max": 0.5})
    sizes = np.hypot(0.01, 0.02) * np.array([1.0, 2.0])
    assert found["attitude_deg"] == pytest.approx({"rms": np.sqrt(np.mean(sizes**2)), "max": 0.04})


def test_one_that_never_points_has_none():
    assert made([Phase.PAD, Phase.COAST]) is None
