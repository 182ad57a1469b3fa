"""The choice of sources for a frame against plain array expressions."""

import numpy as np
import pytest
from camera_bench import DEG, PARAMS, T_S, build
from camera_bench import sky as everything

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.camera import sky

AXES = [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0, 0.8), (-0.3, 0.5, -0.81), (0.05, -0.05, 0.9975)]


def test_sky_keeps_every_source_with_its_own_light():
    u_i = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
    ordered = sky.ordered(
        u_i, np.array([1.0, 2.0, 3.0]), np.array([10, 20, 30]), np.array([True, False, True])
    )
    np.testing.assert_array_equal(ordered.u_i, u_i[[2, 1, 0]])
    assert list(ordered.flux) == [3.0, 2.0, 1.0]
    assert list(ordered.hip) == [30, 20, 10]
    assert list(ordered.is_listed) == [True, False, True]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(
    ("cone_deg", "spin_deg_s"), [(10.0, 0.0), (25.0, 300.0), (95.0, 540.0), (180.0, 5.0)]
)
def test_visible_sources_against_array_expressions(axis, cone_deg, spin_deg_s):
    device = build(PARAMS)
    boresight_i = np.array(axis) / np.linalg.norm(axis)
    _, bodies, earth = everything()
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, T_S).T)
    r_i = 6.55e6 * np.array([0.3, -0.2, np.sqrt(1.0 - 0.13)])
    v_i, omega_i = bodies.earth_v_i + np.array([1e3, 2e3, -1e3]), spin_deg_s * DEG * np.array([0.0, 0.6, 0.8])
    view = sky.View(boresight_i, cone_deg * DEG, r_i, v_i, omega_i, C_ei)
    film = sky.DrawingLimit(0.05, 2520.0, 2.0, 0.8)
    hip, u_i, electrons = sky.visible(device.sky, device.planets, view, film)

    near = np.flatnonzero(device.sky.u_i @ boresight_i > np.cos(cone_deg * DEG))
    toward_i = bodies.planet_r_i - r_i
    planets_i = toward_i / np.linalg.norm(toward_i, axis=1, keepdims=True)
    seen_i = aberrate(np.concatenate([device.sky.u_i[near], planets_i]), v_i)
    light = 0.05 * np.concatenate([device.sky.flux[near], device.planets.flux])
    number = np.concatenate([np.where(device.sky.is_listed, device.sky.hip, 0)[near], np.zeros(5, dtype=int)])
    length_px = 2520.0 * 0.05 * np.linalg.norm(np.cross(omega_i, seen_i), axis=1)
    drawn = light >= 0.8 * 2.0 * np.maximum(2.0, length_px)
    kept = (drawn | (number > 0)) & ~sky.behind_earth(seen_i, r_i, C_ei)
    np.testing.assert_array_equal(hip, number[kept])
    np.testing.assert_allclose(u_i, seen_i[kept], atol=1e-15)
    np.testing.assert_allclose(electrons, np.where(drawn, light, 0.0)[kept], rtol=1e-14)


@pytest.mark.parametrize("height", [2.0, 177e3, 400e3, 2e7])
def test_the_earth_hides_the_rays_that_enter_it(height):
    """|r + s u| = 1 in axes in which the Earth is a unit sphere, solved for s ray by ray."""
    rng = np.random.default_rng(5)
    stretch = np.array([wgs84.A, wgs84.A, wgs84.B])
    hidden_before = 0
    for latitude in (0.0, 0.9, -1.5):
        C_ei = rotation.dcm_from_rotvec(rng.standard_normal(3))
        r_e = wgs84.ecef_from_geodetic(latitude, 2.0, height)
        u_i = rng.standard_normal((500, 3))
        u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
        hidden = sky.behind_earth(u_i, C_ei.T @ r_e, C_ei)
        r = r_e / stretch
        for u, found in zip(u_i @ C_ei.T / stretch, hidden, strict=True):
            s = np.roots([u @ u, 2.0 * r @ u, r @ r - 1.0])
            assert found == bool(np.isreal(s).all() and s.real.max() > 0.0)
        hidden_before += hidden.sum()
    assert 0 < hidden_before < 1500
