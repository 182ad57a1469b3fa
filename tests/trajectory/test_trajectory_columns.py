"""A column of a trajectory's file is one quantity."""

import pytest
from refusals import COLUMNS, refused


@pytest.mark.parametrize(
    "change, words",
    [
        (
            {"position": ["east_m", "north_m", "north_m"]},
            "trajectory.position: east_m, north_m, north_m name the column 'north_m' 2 times; expected 3",
        ),
        (
            {"velocity": ["ve_m_s", "vn_m_s", "up_m"]},
            "trajectory.velocity: the column 'up_m' is that of trajectory.position; expected another one",
        ),
        (
            {"attitude": COLUMNS["attitude"] | {"quaternion": ["qw", "qx", "qy", "qy"]}},
            "trajectory.attitude.quaternion: qw, qx, qy, qy name the column 'qy' 2 times",
        ),
    ],
)
def test_a_column_is_one_quantity(change, words):
    assert words in refused(COLUMNS | change)
