"""A column of a trajectory's file is one quantity."""

import pytest
from given_flight import ORIGIN, flown
from made import EXAMPLE as FILE

from shefex_nav.errors import UserError

COLUMNS = {
    "file": FILE, "format": "csv", "origin": ORIGIN, "time": "t_s", "position": ["east_m", "north_m", "up_m"],
    "position_frame": "launch_enu", "velocity": ["ve_m_s", "vn_m_s", "vu_m_s"],
    "velocity_frame": "launch_enu",
    "attitude": {"quaternion": ["qw", "qx", "qy", "qz"], "sense": "body_to_frame", "frame": "launch_enu"},
}  # fmt: skip


def refused(trajectory, *overrides, fly=flown):
    """The message about a trajectory."""
    with pytest.raises(UserError) as caught:
        fly(trajectory, *overrides)
    return str(caught.value)


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
