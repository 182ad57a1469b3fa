"""Tolerances and look-ups that the methods on angles share."""

from itertools import combinations

import numpy as np
import pytest
from slow_identify import Sky, angle
from star_fields import CAMERA, centroid_list, random_attitude, ready_tracker

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.papers import angles


def test_limits_hold_the_angle():
    rng = np.random.default_rng(7)
    u_c = unit_vectors(CAMERA, rng.uniform([0.0, 0.0], [658.0, 492.0], (6, 2)))
    sides = angles.new_sides(u_c, 1e-3, 0.0)
    for i, j in combinations(range(6), 2):
        true = angle(u_c[i], u_c[j])
        assert np.arccos(sides.low[i, j]) - true == pytest.approx(1e-3, abs=1e-8)
        assert true - np.arccos(sides.high[i, j]) == pytest.approx(1e-3, abs=1e-8)
    np.testing.assert_array_equal(sides.low, sides.low.T)


def test_limits_of_detections_closer_than_the_tolerance():
    """The least angle is none, and a cosine that rounding has made larger than one is one."""
    low, high = angles.cosine_limits(np.cos(4e-4), 1e-3, 0.0)
    assert high == 1.0 and np.arccos(low) == pytest.approx(1.4e-3, abs=1e-9)
    low, high = angles.cosine_limits(1.0 + 2e-16, 1e-3, 0.0)
    assert high == 1.0 and np.arccos(low) == pytest.approx(1e-3, abs=1e-9)


def test_constant_error_of_the_cosine():
    assert angles.cosine_limits(0.95, 1e-3, 5e-5) == pytest.approx((0.94995, 0.95005))
    assert angles.cosine_limits(0.99999, 1e-3, 5e-5) == pytest.approx((0.99994, 1.0))


def test_look_up_against_all_pairs():
    rng, pairs = np.random.default_rng(3), ready_tracker().pairs
    sky, table = Sky(pairs), angles.table(pairs)
    u_c, _, _ = centroid_list(rng, pairs.stars, random_attitude(rng), 3)
    sides = angles.new_sides(u_c, 3e-4, 0.0)
    for i, j in combinations(range(len(u_c)), 2):
        begin, end = angles.look_up(table, sides, i, j)
        rows = np.arange(begin, end)
        found = set(zip(pairs.first[rows].tolist(), pairs.second[rows].tolist(), strict=True))
        assert found | {(b, a) for a, b in found} == sky.ways(angle(u_c[i], u_c[j]), 3e-4)
        assert angles.look_up(table, sides, j, i) == (begin, end)


def test_two_detections_on_one_star_are_neither():
    rng, pairs = np.random.default_rng(5), ready_tracker().pairs
    while True:
        u_c, _, star = centroid_list(rng, pairs.stars, random_attitude(rng), 0, noise_px=0.01)
        if len(star) >= 6:
            break
    twice = np.vstack([u_c, u_c[4:5]])
    sides, row = angles.new_sides(twice, 1e-4, 0.0), np.empty(len(twice), dtype=np.int64)
    confirmed = angles.extend(angles.table(pairs), sides, (0, 1, 2), tuple(star[:3].tolist()), row)
    assert row[4] == row[-1] == -1
    np.testing.assert_array_equal(row[:4], star[:4])
    assert confirmed == (row >= 0).sum() - 3
