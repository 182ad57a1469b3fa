"""Exposure control: the flow chart of the SHEFEX-2 paper, figure 2."""

import numpy as np
import pytest
from star_fields import EXPOSURE

from shefex_nav.onboard.startracker.tracker import flags, next_exposure
from shefex_nav.records import Detections


def detections(n_saturated):
    n = len(n_saturated)
    saturated = np.array(n_saturated, dtype=np.int64)
    return Detections(np.zeros((n, 2)), np.ones(n), np.full(n, 9), saturated, np.zeros((n, 2, 2)))


@pytest.mark.parametrize(
    "mean_dn, n_saturated, expected",
    [
        (20.0, [0, 0, 0, 0], (False, False)),
        (20.0, [0, 0, 0], (False, True)),
        (20.0, [], (False, True)),
        (20.0, [300, 0, 0, 0, 0], (False, False)),  # a planet alone
        (20.0, [300, 5, 2, 1, 0], (False, False)),  # one saturated pixel is not more than one
        (20.0, [2, 2, 2, 2, 0], (True, False)),
        (100.5, [0, 0, 0, 0], (True, False)),
        (255.0, [], (True, True)),
    ],
)
def test_flags(mean_dn, n_saturated, expected):
    assert flags(EXPOSURE, mean_dn, detections(n_saturated)) == expected


def test_steps_of_2_ms_between_the_limits():
    assert next_exposure(EXPOSURE, 0.040, False, False) == 0.040
    assert next_exposure(EXPOSURE, 0.040, False, True) == pytest.approx(0.042)
    assert next_exposure(EXPOSURE, 0.040, True, False) == pytest.approx(0.038)
    assert next_exposure(EXPOSURE, 0.0495, False, True) == 0.050
    assert next_exposure(EXPOSURE, 0.0355, True, False) == 0.035


def test_bright_frame_without_stars_is_not_exposed_longer():
    flag_saturated, flag_no_stars = flags(EXPOSURE, 240.0, detections([]))
    assert flag_no_stars
    assert next_exposure(EXPOSURE, 0.040, flag_saturated, flag_no_stars) < 0.040
