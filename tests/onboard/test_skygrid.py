"""Lists of stars by direction: none may be missing."""

import numpy as np
import pytest
from star_fields import ready_tracker

from shefex_nav.onboard.startracker import tables

RADIUS = np.radians(9.0)


def test_every_star_within_the_radius_is_in_the_list():
    stars = ready_tracker().pairs.stars
    grid = tables.by_direction(stars.u_i, stars.vmag, RADIUS)
    rng = np.random.default_rng(1)
    corners = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    for direction in np.vstack([rng.standard_normal((500, 3)), corners]):
        direction /= np.linalg.norm(direction)
        cell = tables.cell_of(*direction)
        listed = grid.row[grid.start[cell] : grid.start[cell + 1]]
        near = np.flatnonzero(stars.u_i @ direction > np.cos(RADIUS))
        assert set(near) <= set(listed)
        assert (np.diff(listed.astype(int)) > 0).all()  # brightest first, each once
        assert (stars.u_i[listed] @ direction > np.cos(RADIUS + np.radians(8.0))).all()


@pytest.mark.parametrize("radius", [RADIUS, np.radians(2.0), np.radians(100.0)])
def test_lists_are_those_of_a_search_among_all_stars(radius):
    """Blocks of cells only save time. The middle of a cell is seen from each of its corners."""
    u_i = ready_tracker().pairs.stars.u_i
    grid = tables.by_direction(u_i, np.linspace(1.0, 5.0, len(u_i)), radius)
    edges = np.linspace(-1.0, 1.0, tables.CELLS + 1)
    rng = np.random.default_rng(3)
    for face, i, j in zip(*(rng.integers(n, size=300) for n in (6, tables.CELLS, tables.CELLS)), strict=True):
        axis, sign = face // 2, 1.0 if face % 2 == 0 else -1.0
        middle, *corners = (
            np.insert([a, b], axis, sign) / np.sqrt(1.0 + a * a + b * b)
            for a, b in (
                (edges[i : i + 2].mean(), edges[j : j + 2].mean()),
                *((a, b) for a in edges[i : i + 2] for b in edges[j : j + 2]),
            )
        )
        limit = min(max(np.arccos(middle @ one) for one in corners) + radius, np.pi)
        angle = np.arccos(np.clip(u_i @ middle, -1.0, 1.0))
        cell = (face * tables.CELLS + i) * tables.CELLS + j
        listed = grid.row[grid.start[cell] : grid.start[cell + 1]]
        assert set(np.flatnonzero(angle < limit - 1e-6)) <= set(listed)
        assert (angle[listed] < limit + 1e-6).all()


def test_density_of_magnitudes_is_a_density():
    vmag = np.sort(np.random.default_rng(2).uniform(1.0, 5.0, 3000))
    u_i = np.tile([0.0, 0.0, 1.0], (3000, 1))
    grid = tables.by_direction(u_i, vmag, RADIUS)
    assert np.exp(grid.log_density).mean() == pytest.approx(0.25, rel=0.05)
    assert np.abs(np.exp(grid.log_density) - 0.25).max() < 0.06
