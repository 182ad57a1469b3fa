"""Positions in the Earth: warned of, where a file may mean them, and refused, where none can."""

import pytest
from given_flight import ALONG, scenario
from made import csv, rocket
from refusals import COLUMNS, refused

from shefex_nav.report import programme


def downwards(path, deepest_m=None):
    """Section of a file of positions alone whose heights count downwards, to a depth at most [m]."""
    flown = rocket(60.0)
    down = flown.r_l[:, 2] * (1.0 if deepest_m is None else deepest_m / flown.r_l[:, 2].max())
    csv(path, ("t_s", "east_m", "north_m", "down_m"), (flown.t_s, flown.r_l[:, 0], flown.r_l[:, 1], -down))
    section = {name: value for name, value in COLUMNS.items() if not name.startswith("velocity")}
    return section | {"file": path, "position": ["east_m", "north_m", "down_m"], "attitude": ALONG}


def test_heights_that_count_downwards_are_warned_of(tmp_path):
    """Of positions alone nothing else tells: 8.7 km down instead of up."""
    (words,) = (one.text for one in programme.of_trajectory(scenario(downwards(tmp_path / "down.csv"))))
    assert "down.csv:" in words and "m below the ellipsoid; are heights positive upwards" in words


@pytest.mark.parametrize("latitude", ["0 deg", "90 deg"])
def test_a_position_far_in_the_earth_is_refused(tmp_path, latitude):
    """25 km deep, at the equator, where the surface is 21 km farther from the centre, as at the pole."""
    more = {"origin": {"latitude": latitude, "longitude": "0 deg"}}
    words = refused(downwards(tmp_path / "deep.csv", 25e3) | more)
    assert "km from the centre of the Earth; check position_frame" in words
