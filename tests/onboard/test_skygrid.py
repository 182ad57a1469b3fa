"""Lists of stars by direction: none may be missing."""

import numpy as np
import pytest
from star_fields import ready_tracker

from shefex_nav.onboard.startracker import skygrid

RADIUS = np.radians(9.0)


def test_every_star_within_the_radius_is_in_the_list():
    stars = ready_tracker().pairs.stars
    grid = skygrid.build(stars.u_i, stars.vmag, RADIUS)
    rng = np.random.default_rng(1)
    corners = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    for direction in np.vstack([rng.standard_normal((500, 3)), corners]):
        direction /= np.linalg.norm(direction)
        cell = skygrid.cell_of(*direction)
        listed = grid.row[grid.start[cell] : grid.start[cell + 1]]
        near = np.flatnonzero(stars.u_i @ direction > np.cos(RADIUS))
        assert set(near) <= set(listed)
        assert (np.diff(listed.astype(int)) > 0).all()  # brightest first, each once
        assert (stars.u_i[listed] @ direction > np.cos(RADIUS + np.radians(8.0))).all()


def test_density_of_magnitudes_is_a_density():
    vmag = np.sort(np.random.default_rng(2).uniform(1.0, 5.0, 3000))
    u_i = np.tile([0.0, 0.0, 1.0], (3000, 1))
    grid = skygrid.build(u_i, vmag, RADIUS)
    assert np.exp(grid.log_density).mean() == pytest.approx(0.25, rel=0.05)
    assert np.abs(np.exp(grid.log_density) - 0.25).max() < 0.06
