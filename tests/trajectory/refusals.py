"""A trajectory by its columns, and what is said of one that is refused."""

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
