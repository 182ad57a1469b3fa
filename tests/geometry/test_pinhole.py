"""Pixel convention and the round trip pixel -> direction -> pixel."""

import numpy as np
from numpy.testing import assert_allclose

from shefex_nav.geometry import pinhole

CAMERA = pinhole.pinhole(659, 493, 2520.0)


def test_convention():
    axis, right, below = pinhole.unit_vectors(
        CAMERA, np.array([[329.0, 246.0], [400.0, 246.0], [329.0, 300.0]])
    )
    assert_allclose(axis, [0, 0, 1], atol=1e-15)
    assert right[0] > 0 and right[1] == 0
    assert below[1] > 0 and below[0] == 0


def test_there_and_back():
    xy_px = np.random.default_rng(0).uniform(0, 493, (40, 2))
    u_c = pinhole.unit_vectors(CAMERA, xy_px)
    assert_allclose(np.linalg.norm(u_c, axis=1), 1.0, atol=1e-15)
    assert_allclose(pinhole.pixels(CAMERA, u_c), xy_px, atol=1e-10)


def test_behind_the_camera_is_not_a_pixel():
    assert np.isnan(pinhole.pixels(CAMERA, np.array([[0.0, 0.1, -1.0], [1.0, 0.0, 0.0]]))).all()


def test_field_of_view_of_the_shefex_camera():
    """659 x 493 pixels of 9.9 um behind 25 mm: 14.87 deg x 11.15 deg (SHEFEX 2 star tracker paper, 2.1)."""
    camera = pinhole.pinhole(659, 493, 25e-3 / 9.9e-6)
    edges = np.array([[-0.5, 246.0], [658.5, 246.0], [329.0, -0.5], [329.0, 492.5]])
    u = pinhole.unit_vectors(camera, edges)
    assert_allclose(np.degrees(np.arccos(u[0] @ u[1])), 14.87, atol=0.005)
    assert_allclose(np.degrees(np.arccos(u[2] @ u[3])), 11.15, atol=0.005)
