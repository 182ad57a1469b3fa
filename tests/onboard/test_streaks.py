"""Rate-aided detection on rendered frames: bound, covariance, the instant, and what is no star."""

import numpy as np
import pytest
from streak_fields import (
    DEG,
    IMPA,
    SHEFEX,
    add_star,
    dark,
    detect_params,
    digitise,
    frame,
    grid_places,
    match,
    motion_of,
)

from shefex_nav.geometry.streak import place_at, rate_lever, velocity
from shefex_nav.onboard.startracker.streaks import detect_near, detect_streaks

REACH_PX = 12.0


def measured(bench, params, seed, frames, electrons, rate, rolling=False, sigma=0.0, boresight=0.5, **known):
    """Errors along and across (n, 2), normalised squared errors (n,), and how many of how many were found.

    known : what the detection knows of the camera, where it is not so
    """
    rng, camera = np.random.default_rng(seed), bench.model._replace(**known)
    errors, nees, n = [], [], 0
    for _ in range(frames):
        direction = rng.normal(size=3) * [1.0, 1.0, boresight]
        omega_c = rate * DEG * direction / np.linalg.norm(direction)
        motion = motion_of(bench, omega_c, rolling, sigma)
        places = grid_places(bench, rng, 128 if bench is IMPA else 64)
        image = frame(bench, motion, places, electrons, rng)
        told = motion._replace(omega_c=omega_c + sigma * rng.normal(size=3))
        found, _ = detect_streaks(params, camera, image, told)
        k = match(found.xy_px, places, REACH_PX)
        n += len(places)
        for place, row in zip(places[k >= 0], k[k >= 0], strict=True):
            error = found.xy_px[row] - place
            along = np.array(velocity(bench.camera, omega_c, *place)) if rate > 0.0 else np.array([1.0, 0.0])
            along /= np.linalg.norm(along)
            errors.append([error @ along, error @ [-along[1], along[0]]])
            S = rate_lever(bench.camera, motion.times, omega_c, *place)
            P_px = found.P_px[row] + (sigma**2 * S @ S.T if sigma > 0.0 else 0.0)
            nees.append(0.5 * error @ np.linalg.solve(P_px, error))
    return np.array(errors), np.array(nees), len(errors), n


def bound(bench, omega_c, electrons, place):
    """Cramer-Rao bound along and across, (2,) px, from the renderer itself by differences."""
    motion = motion_of(bench, omega_c)

    def light(x, y, scale):
        image = dark(bench)
        add_star(image, bench, motion.times, motion.omega_c, x, y, scale * electrons, step_px=0.05)
        return image

    x, y = place
    mean = light(x, y, 1.0)
    d = 0.05
    slopes = [
        (light(x + d, y, 1.0) - light(x - d, y, 1.0)) / (2.0 * d),
        (light(x, y + d, 1.0) - light(x, y - d, 1.0)) / (2.0 * d),
        mean,
    ]
    variance = mean + (bench.noise_dn * bench.electrons_per_dn) ** 2
    F = np.array([[(a * b / variance).sum() for a in slopes] for b in slopes])
    P = np.linalg.inv(F)[:2, :2]
    along = np.array(velocity(bench.camera, motion.omega_c, x, y))
    along /= np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    return np.sqrt([along @ P @ along, across @ P @ across])


@pytest.mark.parametrize(
    "bench, rate, electrons", [(IMPA, 5.0, 24e3), (IMPA, 2.0, 15e3), (SHEFEX, 5.0, 2000.0)]
)
def test_the_fit_is_at_the_bound_and_knows_it(bench, rate, electrons):
    """Matched signal-to-noise ratios of 17, 16 and 18."""
    params = detect_params(bench, most_objects=300)
    error, nees, found, n = measured(bench, params, 1, 3, electrons, rate, boresight=0.0)
    assert found >= 0.985 * n
    omega_c = rate * DEG * np.array([0.6, 0.8, 0.0])
    limit = bound(
        bench, omega_c, electrons, (0.4 * bench.camera.width_px + 0.3, 0.6 * bench.camera.height_px)
    )
    ratio = np.sqrt((error**2).mean(axis=0)) / limit
    assert (ratio > 0.8).all()
    assert (ratio < 1.3).all()
    assert 0.8 < nees.mean() < 1.3


@pytest.mark.parametrize("sigma_factor", [0.9, 1.1])
def test_a_wrong_width_does_not_spoil_the_covariance(sigma_factor):
    params = detect_params(IMPA, most_objects=300)
    for electrons in (14e3, 400e3):
        _, nees, found, n = measured(
            IMPA, params, 2, 2, electrons, 5.0, psf_sigma=sigma_factor * IMPA.sigma_px
        )
        assert found >= 0.985 * n
        assert 0.7 < nees.mean() < 1.4


def test_an_error_of_the_rate_moves_places_by_its_lever():
    """Rolling shutter: a star in the first row is seen 0.1 s before the instant; 20 independent rates."""
    params = detect_params(SHEFEX, most_objects=300)
    _, nees, found, n = measured(SHEFEX, params, 3, 20, 20e3, 5.0, rolling=True, sigma=0.1 * DEG)
    assert found >= 0.985 * n
    assert 0.5 < nees.mean() < 1.6  # three common errors a frame: 60 in all


@pytest.mark.parametrize("rolling", [False, True])
def test_places_are_those_of_the_instant(rolling):
    """Bright stars: the middle of the light is up to 25 px away with a rolling shutter."""
    params = detect_params(IMPA)
    error, _, found, n = measured(IMPA, params, 4, 2, 1e6, 5.0, rolling)
    assert found == n
    assert np.abs(error.mean(axis=0)).max() < 0.01
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.04


def test_at_rest_and_about_the_boresight():
    """Spots; and streaks whose length and direction change over the frame, with spots in the middle."""
    params = detect_params(IMPA, most_objects=300)
    _, nees, found, n = measured(IMPA, params, 5, 2, 30e3, 0.0)
    assert found == n
    assert 0.75 < nees.mean() < 1.3
    rng = np.random.default_rng(6)
    motion = motion_of(IMPA, [0.0, 0.0, 8.0 * DEG])
    places = grid_places(IMPA, rng)
    image = frame(IMPA, motion, places, 40e3, rng)
    found, _ = detect_streaks(params, IMPA.model, image, motion)
    k = match(found.xy_px, places, 6.0)
    assert (k >= 0).all()
    error = found.xy_px[k] - places
    nees = [0.5 * e @ np.linalg.solve(P, e) for e, P in zip(error, found.P_px[k], strict=True)]
    assert 0.7 < np.mean(nees) < 1.4


def test_covariances_are_positive_definite_at_the_border_too():
    rng = np.random.default_rng(7)
    params = detect_params(SHEFEX, most_objects=300)
    for k in range(6):
        motion = motion_of(SHEFEX, rng.normal(size=3) * 4.0 * DEG, rolling=k % 2 == 1)
        places = rng.uniform([-10.0, -10.0], [669.0, 503.0], (150, 2))
        image = frame(SHEFEX, motion, places, 10.0 ** rng.uniform(2.8, 5.0, 150), rng)
        found, _ = detect_streaks(params, SHEFEX.model, image, motion)
        assert len(found.flux_dn) > 40
        assert (np.linalg.eigvalsh(found.P_px) > 0.0).all()
        assert (np.diff(found.flux_dn) <= 0.0).all()


def test_a_streak_cut_by_the_border_knows_it():
    """Half of the streak is seen: the errors of the others' size or the covariance says so."""
    rng = np.random.default_rng(8)
    motion = motion_of(IMPA, [0.0, 5.0 * DEG, 0.0])  # along x
    nees = []
    for _ in range(3):
        places = np.column_stack([np.full(25, 5.0), np.arange(25) * 40.0 + 30.0]) + rng.uniform(
            -4, 4, (25, 2)
        )
        image = frame(IMPA, motion, places, 60e3, rng)
        found, _ = detect_streaks(detect_params(IMPA), IMPA.model, image, motion)
        k = match(found.xy_px, places, REACH_PX)
        for e, P in zip(found.xy_px[k[k >= 0]] - places[k >= 0], found.P_px[k[k >= 0]], strict=True):
            nees.append(0.5 * e @ np.linalg.solve(P, e))
    assert len(nees) >= 50
    assert np.mean(nees) < 1.4


def hits(light, places, electrons, n):
    """Light in n pixels at each place."""
    for x, y in np.rint(places).astype(int):
        for dy, dx in [(0, 0), (0, 1), (1, 0), (1, 1)][:n]:
            light[y + dy, x + dx] += electrons / n


def turned(omega_c, degrees):
    c, s = np.cos(degrees * DEG), np.sin(degrees * DEG)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ omega_c


OMEGA = 5.0 * DEG * np.array([0.62, 0.78, 0.1])


@pytest.mark.parametrize(
    "kind, most",
    [
        ("hot pixel", 0.05),
        ("hit of 2", 0.05),
        ("hit of 4", 0.05),
        ("spot", 0.06),
        ("turned 10", 0.05),
        ("turned 90", 0.08),
        ("half as long", 0.03),
        ("0.7 as long", 0.05),
        ("1.3 as long", 0.05),
        ("1.5 as long", 0.05),
    ],
)
def test_what_does_not_move_as_a_star_is_refused(kind, most):
    """64 objects as bright per length as a star of ratio 40; a stray candidate of noise may lie near one."""
    rng = np.random.default_rng(9)
    light, electrons, motion = dark(IMPA), 51e3, motion_of(IMPA, OMEGA)
    places = grid_places(IMPA, rng)
    factor = {"half as long": 0.5, "0.7 as long": 0.7, "1.3 as long": 1.3, "1.5 as long": 1.5}.get(kind, 1.0)
    if kind.startswith("h") and "long" not in kind:
        hits(light, places, 3.0 * electrons, {"hot pixel": 1, "hit of 2": 2, "hit of 4": 4}[kind])
    else:
        omega_c = {"spot": 0.0 * OMEGA, "turned 10": turned(OMEGA, 10), "turned 90": turned(OMEGA, 90)}
        for x, y in places:
            add_star(light, IMPA, motion.times, omega_c.get(kind, factor * OMEGA), x, y, factor * electrons)
    found, _ = detect_streaks(detect_params(IMPA), IMPA.model, digitise(IMPA, light, rng), motion)
    passed = (match(found.xy_px, places, 30.0) >= 0).sum()
    assert passed <= most * len(places)


def test_true_stars_are_kept():
    """None of the questions costs more than 1.5 per cent of the stars of ratio 8 to 500."""
    params = detect_params(IMPA, most_objects=300)
    found, n = 0, 0
    for seed, electrons in enumerate([11e3, 25e3, 100e3, 1e6]):
        _, _, now, of = measured(IMPA, params, 20 + seed, 2, electrons, 5.0, rolling=True)
        found, n = found + now, n + of
    assert found >= 0.985 * n


def test_a_hit_on_a_streak_does_not_cost_the_star():
    rng = np.random.default_rng(10)
    light, motion, places = dark(IMPA), motion_of(IMPA, OMEGA), grid_places(IMPA, rng)
    for x, y in places:
        add_star(light, IMPA, motion.times, OMEGA, x, y, 60e3)
    vx, vy = velocity(IMPA.camera, OMEGA, 511.0, 511.0)
    hits(light, places + 0.04 * np.array([vx, vy]), 15e3, 1)
    found, _ = detect_streaks(detect_params(IMPA), IMPA.model, digitise(IMPA, light, rng), motion)
    k = match(found.xy_px, places, 3.0)
    assert (k >= 0).mean() > 0.95
    error = found.xy_px[k[k >= 0]] - places[k >= 0]
    nees = [0.5 * e @ np.linalg.solve(P, e) for e, P in zip(error, found.P_px[k[k >= 0]], strict=True)]
    assert np.mean(nees) < 1.5


def test_two_streaks_that_overlap_are_both_found():
    rng = np.random.default_rng(11)
    motion = motion_of(IMPA, [5.0 * DEG, 0.0, 0.0])  # along y
    first = grid_places(IMPA, rng, 200)
    second = first + np.array([7.0, 15.0])
    electrons = np.repeat([200e3, 50e3], len(first))
    image = frame(IMPA, motion, np.vstack([first, second]), electrons, rng)
    found, _ = detect_streaks(detect_params(IMPA), IMPA.model, image, motion)
    places = np.vstack([first, second])
    k = match(found.xy_px, places, 3.0)
    assert (k >= 0).all()
    assert len(set(k)) == len(places)
    error = found.xy_px[k] - places
    assert np.sqrt((error**2).mean()) < 0.4


def test_near_predictions_it_finds_the_same():
    rng = np.random.default_rng(12)
    motion = motion_of(IMPA, OMEGA, rolling=True)
    places = grid_places(IMPA, rng)
    image = frame(IMPA, motion, places[:-8], 40e3, rng)  # nothing at the last eight
    params = detect_params(IMPA)
    whole, statistics = detect_streaks(params, IMPA.model, image, motion)
    predicted = places + rng.normal(size=places.shape)
    near, strips = detect_near(
        params, IMPA.model, image, motion, predicted, np.tile(np.eye(2), (len(places), 1, 1))
    )
    k, j = match(near.xy_px, places, 6.0), match(whole.xy_px, places, 6.0)
    assert (k[:-8] >= 0).all()
    assert (k[-8:] < 0).all()
    np.testing.assert_allclose(near.xy_px[k[:-8]], whole.xy_px[j[:-8]], atol=0.5)
    assert np.sqrt(((near.xy_px[k[:-8]] - whole.xy_px[j[:-8]]) ** 2).mean()) < 0.08
    error = near.xy_px[k[:-8]] - places[:-8]
    nees = [0.5 * e @ np.linalg.solve(P, e) for e, P in zip(error, near.P_px[k[:-8]], strict=True)]
    assert 0.6 < np.mean(nees) < 1.5
    assert strips.background_dn == pytest.approx(statistics.background_dn, abs=1.0)
    assert strips.noise_dn == pytest.approx(statistics.noise_dn, rel=0.1)


def test_without_predictions_nothing_is_found():
    image = digitise(SHEFEX, dark(SHEFEX), np.random.default_rng(13))
    motion = motion_of(SHEFEX, OMEGA)
    found, _ = detect_near(
        detect_params(SHEFEX), SHEFEX.model, image, motion, np.zeros((0, 2)), np.zeros((0, 2, 2))
    )
    assert found.xy_px.shape == (0, 2)
    assert found.P_px.shape == (0, 2, 2)


def test_saturated_and_bad_pixels_have_no_weight():
    rng = np.random.default_rng(14)
    motion, places = motion_of(SHEFEX, OMEGA), grid_places(SHEFEX, rng, 80)
    image = frame(SHEFEX, motion, places, 60e3, rng)
    assert (image == 255).sum() > 4 * len(places)
    bad = rng.integers([0, 0], image.shape, (3000, 2))
    image[bad[:, 0], bad[:, 1]] = 255
    found, _ = detect_streaks(detect_params(SHEFEX), SHEFEX.model._replace(bad_pixels=bad), image, motion)
    k = match(found.xy_px, places, 1.0)
    assert (k >= 0).mean() > 0.95
    assert np.sqrt(((found.xy_px[k[k >= 0]] - places[k >= 0]) ** 2).mean()) < 0.05
    assert (found.n_saturated[k[k >= 0]] > 0).all()


def test_what_cannot_be_is_refused():
    motion = motion_of(SHEFEX, OMEGA)
    image = np.zeros((493, 659), dtype=np.uint8)
    params = detect_params(SHEFEX)
    with pytest.raises(ValueError, match="expected uint8 or uint16"):
        detect_streaks(params, SHEFEX.model, image.astype(float), motion)
    with pytest.raises(ValueError, match="of shape"):
        detect_streaks(params, SHEFEX.model, image[:-1], motion)
    with pytest.raises(ValueError, match="not finite"):
        detect_streaks(params, SHEFEX.model, image, motion._replace(omega_c=np.array([np.nan, 0.0, 0.0])))
    with pytest.raises(ValueError, match="predictions"):
        detect_near(params, SHEFEX.model, image, motion, np.zeros((3, 2)), np.zeros((2, 2, 2)))


def test_the_renderer_of_these_tests_draws_the_path():
    """Its light has its middle where the path says, and all of it."""
    motion = motion_of(IMPA, OMEGA)
    light = dark(IMPA)
    add_star(light, IMPA, motion.times, OMEGA, 400.3, 300.8, 1000.0)
    yy, xx = np.mgrid[: light.shape[0], : light.shape[1]]
    assert light.sum() == pytest.approx(1000.0, rel=1e-6)
    times = (np.arange(400) + 0.5) / 400 * IMPA.exposure_s - 0.5 * IMPA.exposure_s
    path = np.array([place_at(IMPA.camera, OMEGA, 400.3, 300.8, t) for t in times])
    middle = [(light * xx).sum() / light.sum(), (light * yy).sum() / light.sum()]
    np.testing.assert_allclose(middle, path.mean(axis=0), atol=1e-3)


@pytest.mark.parametrize("black_dn", [-1.0, 0.0, 1.0])  # -0.5, 0 and 0.5 sigma of a pixel
def test_the_noise_of_a_sky_that_is_cut_off_at_grey_value_zero(black_dn):
    """By quantiles alone a third to two thirds of it: 26 objects a frame that were noise with 0."""
    bench, rng = SHEFEX._replace(black_dn=black_dn, background_electrons=0.0), np.random.default_rng(2)
    settings, motion = detect_params(bench), motion_of(bench, 2.0 * DEG * np.array([0.6, 0.8, 0.0]))
    squares, n_false = {"whole": [], "near": []}, 0
    for _ in range(6):
        places = grid_places(bench, rng, 90)
        image = frame(bench, motion, places, 2500.0, rng)
        near = places + rng.normal(0.0, 1.0, places.shape), np.tile(np.eye(2), (len(places), 1, 1))
        found = {
            "whole": detect_streaks(settings, bench.model, image, motion),
            "near": detect_near(settings, bench.model, image, motion, *near),
        }
        for way, (seen, statistics) in found.items():
            assert statistics.noise_dn == pytest.approx(bench.noise_dn, rel=0.15)
            nearest = match(seen.xy_px, places, 2.0)
            assert (nearest >= 0).mean() > 0.95
            d, P_px = (
                seen.xy_px[nearest[nearest >= 0]] - places[nearest >= 0],
                seen.P_px[nearest[nearest >= 0]],
            )
            squares[way] += np.einsum("ni,nij,nj->n", d, np.linalg.inv(P_px), d).tolist()
        n_false += len(found["whole"][0].xy_px) - (match(found["whole"][0].xy_px, places, 2.0) >= 0).sum()
    assert n_false <= 30
    for values in squares.values():
        assert 0.7 < np.mean(values) / 2.0 < 1.2
