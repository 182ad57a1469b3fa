"""Coast lines lie where there are coasts."""

import numpy as np
import pytest

from shefex_nav.report import coast


def _nearest_km(longitude, latitude, fine=False):
    """Distance from a place to the nearest point of a coast line, flat about the place."""
    points = np.vstack(coast.lines(fine))
    east = (points[:, 0] - longitude) * np.cos(np.radians(latitude))
    return 111.2 * float(np.hypot(east, points[:, 1] - latitude).min())


def test_coasts_are_near_harbours_and_far_from_deserts():
    for name, longitude, latitude in (
        ("Cape Town", 18.42, -33.92), ("Lisbon", -9.14, 38.72), ("Honolulu", -157.86, 21.31),
        ("Longyearbyen", 15.63, 78.22), ("Cape Horn", -67.29, -55.98),
    ):  # fmt: skip
        assert _nearest_km(longitude, latitude) < 120.0, name
    for name, longitude, latitude in (
        ("Sahara", 8.0, 23.0),
        ("Omsk", 73.4, 55.0),
        ("Pacific", -130.0, -45.0),
    ):
        assert _nearest_km(longitude, latitude) > 600.0, name


def test_the_fine_coast_has_the_islands_of_launch_sites():
    """Within 5 km of a coast: Andenes on Andoya, Santa Maria of the Azores, Wallops; Esrange is inland."""
    for name, longitude, latitude, low, high in (
        ("Andoya", 16.02, 69.294, 0.0, 5.0), ("Santa Maria", -25.17, 36.98, 0.0, 5.0),
        ("Wallops", -75.47, 37.85, 0.0, 5.0), ("Esrange", 21.1, 67.89, 90.0, 250.0),
    ):  # fmt: skip
        assert low <= _nearest_km(longitude, latitude, fine=True) < high, name


@pytest.mark.parametrize("fine", [False, True])
def test_lines_are_of_degrees_without_the_seam_of_the_map(fine):
    lines = coast.lines(fine)
    points = np.vstack(lines)
    assert len(points) > 4000
    assert np.abs(points[:, 0]).max() <= 180.0 and np.abs(points[:, 1]).max() < 86.0
    for line in lines:
        along_seam = (np.abs(line[1:, 0]) > 179.99) & (np.abs(line[:-1, 0]) > 179.99)
        assert not along_seam.any()
        assert np.abs(np.diff(line[:, 0])).max() < 60.0  # no line runs around the Earth
