"""The distortion of a lens: the formula written out, its derivatives, and back again."""

import numpy as np
import pytest

from shefex_nav.geometry import distortion
from shefex_nav.geometry.pinhole import Pinhole

HOLE = Pinhole(659, 493, 2520.2, 333.1, 240.7)
LENSES = [
    (-0.376, 0.0, 0.0, 0.0, 0.0),  # a barrel of 1 % in the corner
    (0.5, -1.0, 0.0, 0.0, 3.0),
    (-0.7, 2.0, 1.5e-3, -0.8e-3, 0.0),
]


def formula(k, x, y):
    """Distorted x, y as the textbook writes it (Brown 1966; k1, k2, p1, p2, k3)."""
    k1, k2, p1, p2, k3 = k
    r = (x**2 + y**2) ** 0.5
    grown = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6
    return x * grown + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2), y * grown + p1 * (
        r**2 + 2 * y**2
    ) + 2 * p2 * x * y


def ideal_px(n=200):
    return np.random.default_rng(3).uniform([-10.0, -10.0], [669.0, 503.0], (n, 2))


@pytest.mark.parametrize("k", LENSES)
def test_distorted_pixels_are_those_of_the_formula(k):
    places = ideal_px()
    for (x_px, y_px), found in zip(places, distortion.distort(HOLE, k, places), strict=True):
        x, y = formula(
            k, (x_px - HOLE.cx_px) / HOLE.focal_length_px, (y_px - HOLE.cy_px) / HOLE.focal_length_px
        )
        np.testing.assert_allclose(
            found, [HOLE.cx_px + HOLE.focal_length_px * x, HOLE.cy_px + HOLE.focal_length_px * y], atol=1e-9
        )


@pytest.mark.parametrize("k", LENSES)
def test_back_again_and_slopes(k):
    places = ideal_px()
    seen = distortion.distort(HOLE, k, places)
    np.testing.assert_allclose(distortion.undistort(HOLE, np.array(k), seen), places, atol=1e-6)
    J, h = distortion.slopes_at(HOLE, k, places), 1e-3
    for axis in range(2):
        step = h * np.eye(2)[axis]
        difference = distortion.distort(HOLE, k, places + step) - distortion.distort(HOLE, k, places - step)
        np.testing.assert_allclose(J[:, :, axis], difference / (2 * h), atol=1e-7)


def test_shapes_and_nan_stay():
    places = np.array([[[10.0, 20.0], [np.nan, np.nan]], [[300.0, 400.0], [5.0, 6.0]]])
    found = distortion.distort(HOLE, LENSES[2], places)
    assert found.shape == (2, 2, 2)
    assert np.isnan(found[0, 1]).all()
    assert np.isfinite(np.delete(found.reshape(4, 2), 1, axis=0)).all()


@pytest.mark.parametrize("k", [(), *LENSES])
def test_border_is_what_the_outermost_points_see(k):
    """Each direction of the border, distorted again, lies on the outline of the detector."""
    seen = distortion.border(HOLE, k)
    x, y = formula(k, *seen.T) if k else seen.T
    x_px, y_px = HOLE.cx_px + HOLE.focal_length_px * x, HOLE.cy_px + HOLE.focal_length_px * y
    off = np.minimum(
        np.minimum(abs(x_px + 0.5), abs(x_px - 658.5)), np.minimum(abs(y_px + 0.5), abs(y_px - 492.5))
    )
    assert off.max() < 1e-6
    np.testing.assert_array_equal(seen[0], seen[-1])
    assert (x_px.min(), x_px.max()) == pytest.approx((-0.5, 658.5), abs=1e-6)
    assert (y_px.min(), y_px.max()) == pytest.approx((-0.5, 492.5), abs=1e-6)
