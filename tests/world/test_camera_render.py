"""Starlight on the detector against plain integration and superposition."""

import numpy as np
import pytest
from camera_bench import DEG, PARAMS, T_S, turning
from scipy import integrate
from scipy.special import ndtr

from shefex_nav.geometry import pinhole, rotation
from shefex_nav.geometry.shutter import row_times
from shefex_nav.world.camera import moon, motion, render

CAMERA = pinhole.pinhole(80, 60, 2520.0)
SIGMA = 0.8
PSF = render.gaussian_psf(SIGMA)
STILL = motion.at_rest(np.eye(3))
FINE = 0.02  # electrons, a hundredth of what frames leave out


def picture(light):
    return light.electrons.reshape(CAMERA.height_px, CAMERA.width_px)


def static(xy_px, electrons):
    """Spots that do not move, all pixels, from the normal distribution function."""
    columns, rows = np.arange(CAMERA.width_px), np.arange(CAMERA.height_px)
    image = np.zeros((CAMERA.height_px, CAMERA.width_px))
    for (x, y), n in zip(xy_px, electrons, strict=True):
        along_x = ndtr((columns + 0.5 - x) / SIGMA) - ndtr((columns - 0.5 - x) / SIGMA)
        along_y = ndtr((rows + 0.5 - y) / SIGMA) - ndtr((rows - 0.5 - y) / SIGMA)
        image += n * np.outer(along_y, along_x)
    return image


def test_reference_spot_is_the_integral_of_a_gaussian_over_the_pixel():
    def density(y, x):
        return np.exp(-((x - 40.3) ** 2 + (y - 20.8) ** 2) / (2 * SIGMA**2)) / (2 * np.pi * SIGMA**2)

    image = static([(40.3, 20.8)], [1.0])
    for row, column in ((21, 40), (20, 41), (23, 38)):
        pixel, _ = integrate.dblquad(density, column - 0.5, column + 0.5, row - 0.5, row + 0.5)
        assert image[row, column] == pytest.approx(pixel, rel=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_still_stars_against_the_reference(seed):
    """Also across the edges of the frame; what is left out is less than the limits that the file states."""
    rng = np.random.default_rng(seed)
    xy_px = rng.uniform([-3, -3], [82, 62], (30, 2))
    electrons = 10.0 ** rng.uniform(1.0, 4.0, 30)
    light = render.darkness(CAMERA.width_px * CAMERA.height_px)
    u_c = pinhole.unit_vectors(CAMERA, xy_px)
    render.add_points(light, CAMERA, PSF, STILL, u_c, electrons, FINE)
    left_out = static(xy_px, electrons) - picture(light)
    assert np.abs(left_out).max() < 0.05  # electrons; the read noise is 16
    inside = ((xy_px > 5) & (xy_px < [74, 54])).all(axis=1)
    assert abs(left_out.sum()) < 2.0 * len(electrons)
    total = render.darkness(CAMERA.width_px * CAMERA.height_px)
    render.add_points(total, CAMERA, PSF, STILL, u_c[inside], electrons[inside], FINE)
    assert total.electrons.sum() == pytest.approx(electrons[inside].sum(), rel=2e-3)


@pytest.mark.parametrize("electrons", [60.0, 1e3, 1e5])
def test_what_the_wings_of_a_still_source_lose(electrons):
    """No pixel loses more than `least`, and the source 2 pi sigma^2 least, evenly all round."""
    least = 0.8
    light = render.darkness(CAMERA.width_px * CAMERA.height_px)
    u_c = pinhole.unit_vectors(CAMERA, np.array([[40.0, 30.0]]))
    render.add_points(light, CAMERA, PSF, STILL, u_c, np.array([electrons]), least)
    expected = static([(40.0, 30.0)], [electrons])
    left_out = expected - picture(light)
    assert np.abs(left_out).max() < least
    lit = picture(light) > 0.0
    np.testing.assert_array_equal(lit, expected > least)
    assert left_out.sum() == pytest.approx(2 * np.pi * SIGMA**2 * least, rel=0.5)
    np.testing.assert_array_equal(lit, np.roll(lit[::-1, ::-1], 1, (0, 1)))  # about pixel (40, 30)


@pytest.mark.parametrize("omega_c", [(0.2, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 8.0), (0.1, 0.1, 2.0)])
def test_what_the_wings_of_a_streak_lose(omega_c):
    """Whether a star is quick or near the axis about which the picture turns: no pixel loses 2 least."""
    least, electrons, times = 0.8, 2000.0, row_times(0.05, 0.0, CAMERA.height_px)
    light, all_of_it = (render.darkness(CAMERA.width_px * CAMERA.height_px) for _ in range(2))
    path = motion.turning(CAMERA, np.eye(3), np.array(omega_c), times, PSF.step_px)
    u_c = pinhole.unit_vectors(CAMERA, np.array([[40.3, 30.1]]))
    render.add_points(light, CAMERA, PSF, path, u_c, np.array([electrons]), least)
    render.add_points(all_of_it, CAMERA, PSF, path, u_c, np.array([electrons]), 0.0)
    assert (picture(all_of_it) - picture(light)).max() < 2.0 * least
    assert len(render.lit_pixels(light)) < 0.8 * len(render.lit_pixels(all_of_it))


def test_lit_pixels_are_listed_once_and_darken_clears_them():
    light = render.darkness(CAMERA.width_px * CAMERA.height_px)
    u_c = pinhole.unit_vectors(CAMERA, np.array([[10.0, 10.0], [12.0, 11.0], [-0.4, 59.4]]))
    render.add_points(light, CAMERA, PSF, STILL, u_c, np.array([500.0, 500.0, 3e4]), FINE)
    lit = render.lit_pixels(light)
    assert len(np.unique(lit)) == len(lit)
    np.testing.assert_array_equal(np.sort(lit), np.flatnonzero(light.electrons))
    render.darken(light)
    assert not light.electrons.any()
    assert len(render.lit_pixels(light)) == 0


@pytest.mark.parametrize(
    "omega_c",
    [
        np.array([2.0, 0.0, 0.0]) * DEG,
        np.array([3.0, -5.0, 0.0]) * DEG,
        np.array([0.0, 0.0, 300.0]) * DEG,
        np.array([100.0, 20.0, 500.0]) * DEG,
    ],
)
def test_streak_is_the_superposition_of_still_pictures(omega_c):
    exposure_s, electrons = 0.02, 4000.0
    fine_s = exposure_s * ((np.arange(4000) + 0.5) / 4000 - 0.5)
    u_mid_c = pinhole.unit_vectors(CAMERA, np.array([[45.0, 22.0]]))[0]
    xy_px = []
    for t in fine_s:  # camera axes turn by omega t, so the star turns the other way
        u_c = rotation.dcm_from_rotvec(omega_c * t).T @ u_mid_c
        xy_px.append([CAMERA.cx_px + 2520 * u_c[0] / u_c[2], CAMERA.cy_px + 2520 * u_c[1] / u_c[2]])
    xy_px = np.array(xy_px)
    expected = static(xy_px, np.full(4000, electrons / 4000))

    path = motion.turning(
        CAMERA, np.eye(3), omega_c, row_times(exposure_s, 0.0, CAMERA.height_px), PSF.step_px
    )
    light = render.darkness(CAMERA.width_px * CAMERA.height_px)
    render.add_points(light, CAMERA, PSF, path, u_mid_c[None], np.array([electrons]), 1e-4)
    assert np.abs(picture(light) - expected).max() < 2e-3 * expected.max()


def test_star_behind_the_camera_is_not_drawn():
    light = render.darkness(CAMERA.width_px * CAMERA.height_px)
    behind = np.array([[0.0, 0.0, -1.0]])
    render.add_points(light, CAMERA, PSF, STILL, behind, np.array([1e5]), FINE)
    assert not light.electrons.any()


def test_attitudes_between_samples():
    """540 deg/s about one axis and 20 about another: the constant-rate motion, exactly."""
    omega_c = np.array([540.0, 20.0, -30.0]) * DEG
    trajectory = turning(110.0, 50.0, omega_c)
    q_bc = rotation.quat_from_dcm(PARAMS.mounting.C_bc)
    times_s = T_S + np.array([0.0, 0.00113, 0.0491, 0.3337, 0.5])
    C_ci = np.empty((5, 3, 3))
    motion.attitudes_at(trajectory.q_ib, q_bc, (times_s - T_S) * 400.0, C_ci)
    C_ic_start = rotation.dcm_from_quat(rotation.quat_multiply(trajectory.q_ib[0], q_bc))
    for t_s, C in zip(times_s, C_ci, strict=True):
        np.testing.assert_allclose(
            C.T, C_ic_start @ rotation.dcm_from_rotvec(omega_c * (t_s - T_S)), atol=1e-10
        )


def moonlight(sun_c, distance_px=0.0):
    light = render.darkness(CAMERA.width_px * CAMERA.height_px)
    toward_c = pinhole.unit_vectors(CAMERA, np.array([[40.2 + distance_px, 30.1]]))[0]
    moon.add_moon(light, CAMERA, STILL, toward_c, 0.26 * DEG, np.array(sun_c, dtype=float), 1e6)
    return picture(light)


def test_moon_has_the_size_of_its_disc_and_the_lit_half_of_a_sphere():
    full = moonlight([0.0, 0.0, -1.0])
    assert full.sum() == pytest.approx(1e6, rel=0.01)
    radius_px = 2520.0 * np.tan(0.26 * DEG)
    assert np.count_nonzero(full) == pytest.approx(np.pi * radius_px**2, rel=0.02)
    half = moonlight([1.0, 0.0, 0.0])
    assert np.flatnonzero(half.any(axis=0)).min() >= 40  # the side towards the Sun
    assert moonlight([0.0, 0.0, 1.0]).sum() == 0.0
    assert 0.3e6 < moonlight([0.0, 0.0, -1.0], -40.0).sum() < 0.7e6  # half of it off the detector
    # along the equator of light as on a matt sphere: cos of the angle from the side of the Sun
    row = half[30] / half[30].max()
    across = (np.arange(len(row)) - 40.2) / radius_px
    inside = (across > 0.2) & (across < 0.8)
    np.testing.assert_allclose(
        row[inside] / row[inside].max(), across[inside] / across[inside].max(), rtol=0.02
    )


# share of the light of a full Moon; 10^(-0.4 (0.026 a + 4e-9 a^4)), Allen, Astrophysical Quantities (1976)
PHASES = [(0.0, 1.0), (30.0, 0.486), (60.0, 0.2266), (90.0, 0.0910), (120.0, 0.0263), (140.0, 0.00852)]


@pytest.mark.parametrize(("degrees", "share"), PHASES)
def test_moon_is_as_bright_as_the_real_one_at_its_phase(degrees, share):
    light = moonlight([np.sin(degrees * DEG), 0.0, -np.cos(degrees * DEG)]).sum()
    # the crescent at 140 deg is 2.6 px wide, and taken at the middles of the pixels
    assert light == pytest.approx(1e6 * share, rel=0.03 if degrees < 130.0 else 0.08)


def test_dimming_of_the_moon_stays_between_none_and_that_of_a_sphere():
    """At half Moon 0.286 of the sphere's 1/pi; a new Moon is not brighter than it."""
    assert moon.dimming(0.5 * np.pi) == pytest.approx(0.0910 * np.pi, rel=1e-3)
    factors = np.array([moon.dimming(angle) for angle in np.linspace(0.0, np.pi, 1001)])
    assert factors[0] == factors[-1] == 1.0 and np.all((factors > 0.2) & (factors <= 1.0))
    assert np.abs(np.diff(factors)).max() < 0.05
