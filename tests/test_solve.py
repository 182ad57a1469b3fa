"""Attitude from a list of centroids, as a user calls it."""

import numpy as np
import pytest

import shefex_nav
from shefex_nav.environment.stars import at_epoch, load_catalogue
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.centroids import METHODS, solve_centroids
from shefex_nav.solve.image import solve_image

EPOCH = 2012.47
CAMERA = Camera(659, 493, 25.0e-3 / 9.9e-6)
WRONG = np.radians(0.5)
ZERO_FLUX = 50.0  # of a star of magnitude 0
STARS = at_epoch(load_catalogue(5.5), EPOCH)


def field(rng, camera=CAMERA, n_false=5, noise_px=0.15, least=5, depth=5.5):
    """xy_px, flux, q_ci, hip of a random frame with at least `least` stars; hip 0 for false ones."""
    while True:
        q_ci = rng.standard_normal(4)
        q_ci /= np.linalg.norm(q_ci)
        u_c = STARS.u_i @ dcm_from_quat(q_ci).T
        x, y = u_c[:, 0] / u_c[:, 2], u_c[:, 1] / u_c[:, 2]
        if camera.distortion is not None:
            k1, k2, p1, p2, k3 = camera.distortion
            r2 = x * x + y * y
            radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
            x, y = (
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            )
        xy = camera.focal_length_px * np.column_stack([x, y]) + camera.principal_point_px
        size = np.array([camera.width_px, camera.height_px])
        inside = (u_c[:, 2] > 0.9) & (xy >= -0.5).all(axis=1) & (xy <= size - 0.5).all(axis=1)
        rows = np.flatnonzero(inside & (STARS.vmag <= depth))
        if len(rows) >= least:
            break
    places = np.vstack([xy[rows], rng.uniform([0.0, 0.0], size, (n_false, 2))])
    mag = np.concatenate([STARS.vmag[rows], rng.choice(STARS.vmag, n_false)])
    mix = rng.permutation(len(mag))
    noise = rng.normal(0.0, noise_px, places.shape)
    flux = ZERO_FLUX * 10.0 ** (-0.4 * (mag + rng.normal(0.0, 0.1, len(mag))))
    hip = np.concatenate([STARS.hip[rows], np.zeros(n_false, dtype=np.int64)])
    return (places + noise)[mix], flux[mix], q_ci, hip[mix]


def error(found, q_ci):
    return np.linalg.norm(rotvec_between(found.q_ci, q_ci))


def test_is_exported():
    assert shefex_nav.solve_centroids is solve_centroids
    assert shefex_nav.Camera is Camera
    with pytest.raises(AttributeError):
        shefex_nav.telepathy  # noqa: B018


@pytest.mark.parametrize("with_flux", [True, False])
def test_attitude_stars_and_their_order(with_flux):
    rng = np.random.default_rng(1)
    named = agreed = 0
    for _ in range(60):
        xy, flux, q_ci, hip = field(rng)
        found = solve_centroids(xy, flux if with_flux else None, camera=CAMERA, epoch=EPOCH)
        assert found.status == "ok" and found.reason == ""
        assert error(found, q_ci) < WRONG
        assert found.false_probability < 1e-7
        known = found.hip > 0
        assert known.sum() >= 4
        named += known.sum()
        agreed += (found.hip[known] == hip[known]).sum()
    assert agreed >= 0.97 * named  # doubles share one entry of the catalogue


def test_covariance_is_that_of_the_errors():
    """Normalised squared errors of 200 frames: mean of 3 within 3 sigma of its scatter, camera axes."""
    rng = np.random.default_rng(2)
    values = []
    for _ in range(200):
        xy, flux, q_ci, _ = field(rng, least=7)
        found = solve_centroids(xy, flux, camera=CAMERA, epoch=EPOCH)
        d = rotvec_between(np.array([1.0, -1, -1, -1]) * found.q_ci, np.array([1.0, -1, -1, -1]) * q_ci)
        values.append(d @ np.linalg.solve(found.covariance, d))
    assert abs(np.mean(values) - 3.0) < 1.0


def test_distorted_camera_with_its_axis_off_the_middle():
    camera = Camera(659, 493, 2500.0, (340.0, 230.0), (-0.25, 0.1, 1e-3, -1e-3, 0.0))
    rng = np.random.default_rng(3)
    for _ in range(30):
        xy, flux, q_ci, _ = field(rng, camera=camera)
        found = solve_centroids(xy, flux, camera=camera, epoch=EPOCH)
        assert found.status == "ok" and error(found, q_ci) < np.radians(0.1)


@pytest.mark.parametrize("least", [3, 6])
def test_prediction(least):
    """Three stars are enough with a good prediction; a bad one does no harm."""
    rng = np.random.default_rng(4)
    for _ in range(40):
        xy, flux, q_ci, _ = field(rng, least=least)
        off = rng.standard_normal(3)
        off *= np.radians(0.05) / np.linalg.norm(off)
        prediction = (quat_multiply(quat_from_rotvec(off), q_ci), np.eye(3) * np.radians(0.05) ** 2)
        found = solve_centroids(xy, flux, camera=CAMERA, epoch=EPOCH, prediction=prediction)
        assert found.status == "ok" and error(found, q_ci) < WRONG
        prediction = (quat_multiply(quat_from_rotvec(200.0 * off), q_ci), prediction[1])
        found = solve_centroids(xy, flux, camera=CAMERA, epoch=EPOCH, prediction=prediction)
        assert found.status == "failed" or error(found, q_ci) < WRONG
        assert found.status == "ok" or least == 3


def test_three_stars_alone_are_named_by_a_prediction():
    """Twenty of thirty, for three or more that are missing speak against them; by a turned prediction one."""
    rng, named = np.random.default_rng(7), 0
    for _ in range(30):
        xy, flux, q_ci, hip = field(rng, n_false=0, least=6)
        three = np.argsort(-flux)[:3]
        frame = {"camera": CAMERA, "epoch": EPOCH, "band": "V"}  # in which the fields are drawn
        P = np.eye(3) * np.radians(0.05) ** 2
        found = solve_centroids(xy[three], flux[three], prediction=(q_ci, P), **frame)
        named += found.status == "ok"
        assert found.status == "failed" or (found.hip == hip[three]).all()
        assert solve_centroids(xy[three], flux[three], **frame).status == "failed"
    assert named >= 15


@pytest.mark.parametrize("method", METHODS)
def test_another_method_of_the_package(method):
    rng = np.random.default_rng(5)
    xy, flux, q_ci, _ = field(rng, n_false=0, least=8)
    zero_flux = ZERO_FLUX if method == "multipole" else None
    found = solve_centroids(xy, flux, camera=CAMERA, epoch=EPOCH, method=method, zero_flux=zero_flux)
    assert found.status == "ok" and error(found, q_ci) < WRONG


def test_multipole_says_what_it_needs():
    xy, flux, _, _ = field(np.random.default_rng(5), n_false=0, least=8)
    for given in ({"flux": flux}, {"flux": flux, "zero_flux": -1.0}, {"flux": None, "zero_flux": 1e3}):
        with pytest.raises(ValueError, match="zero_flux"):
            solve_centroids(xy, camera=CAMERA, epoch=EPOCH, method="multipole", **given)


def test_failure_is_a_value():
    for xy, reason in (
        (np.zeros((0, 2)), "too_few_stars"),
        ([[10.0, 10.0]], "too_few_stars"),
        (np.random.default_rng(6).uniform(0.0, 490.0, (8, 2)), "no_match"),
        (np.full((6, 2), 200.0), "no_match"),
    ):
        found = solve_centroids(xy, None, camera=CAMERA, epoch=EPOCH)
        assert (found.status, found.reason) == ("failed", reason)
        assert np.isnan(found.q_ci).all() and np.isnan(found.covariance).all()
        assert found.hip.shape == (len(xy),) and not found.hip.any()
        assert found.false_probability == 1.0


GOOD = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [70.0, 80.0]])


@pytest.mark.parametrize(
    "xy, flux, options, says",
    [
        (np.zeros((4, 3)), None, {}, "xy_px: expected shape"),
        ([1.0, 2.0], None, {}, "xy_px: expected shape"),
        ([[np.nan, 1.0]], None, {}, "xy_px: contains NaN"),
        ([["a", "b"]], None, {}, "xy_px: expected numbers"),
        (GOOD, [1.0, 2.0], {}, "flux: expected shape"),
        (GOOD, [1.0, 2.0, np.inf, 1.0], {}, "flux: expected finite positive"),
        (GOOD, [1.0, 2.0, -3.0, 1.0], {}, "flux: expected finite positive"),
        (GOOD, None, {"camera": (659, 493)}, "camera: expected a Camera"),
        (None, None, {}, "xy_px: expected"),
        (GOOD + 1j, None, {}, "xy_px: expected real numbers"),
        (np.ma.masked_less(GOOD, 1.0), None, {}, "xy_px: expected real numbers"),
        (GOOD, None, {"epoch": np.nan}, "epoch: expected a Julian year"),
        (GOOD, None, {"epoch": "2012"}, "epoch: expected a"),
        (GOOD, None, {"epoch": np.array([2012.0])}, "epoch: expected a number"),
        (GOOD, None, {"max_magnitude": None}, "max_magnitude: expected a number"),
        (GOOD, None, {"max_magnitude": -1.4}, "holds no two of the"),
        (GOOD, None, {"camera": Camera(1, 1, 1000.0)}, "holds no two of the"),
        (GOOD, None, {"max_magnitude": 20.0}, "max_magnitude: expected"),
        (GOOD, None, {"centroid_sigma_px": 0.0}, "centroid_sigma_px: expected a number"),
        (GOOD, None, {"magnitude_sigma": -1.0}, "magnitude_sigma: expected a number"),
        (GOOD, None, {"band": "R"}, "band: expected V, Hp, silicon, got 'R'"),
        (GOOD, None, {"band": 5.5}, "band: expected V"),
        (GOOD, None, {"false_limit": 0.0}, "false_limit: expected a probability"),
        (GOOD, None, {"method": "telepathy"}, "choose from: default"),
        (GOOD, None, {"prediction": np.eye(3)}, "prediction: expected"),
        (GOOD, None, {"method": "pyramid", "prediction": np.eye(3)}, "cannot use one"),
        (GOOD, None, {"prediction": (np.ones(4), np.eye(3))}, "unit quaternion"),
        (GOOD, None, {"prediction": ([1.0, 0, 0, 0], np.zeros((3, 3)))}, "positive definite"),
    ],
)
def test_wrong_input_is_named(xy, flux, options, says):
    with pytest.raises(ValueError, match=says):
        solve_centroids(xy, flux, **{"camera": CAMERA, "epoch": EPOCH, **options})


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e160, -1e300])
@pytest.mark.parametrize("n_false", [0, 70])  # few are sorted by insertion, many are not
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"flux": None},
        {"camera": Camera(659, 493, 2500.0, (340.0, 230.0), (-0.25, 0.1, 1e-3, -1e-3, 0.0))},
        {"prediction": ([1.0, 0.0, 0.0, 0.0], 1e-6 * np.eye(3))},
        {"centroid_covariance_px": 0.02 * np.eye(2)},
        {"method": "pyramid"},
        {"method": "multipole", "zero_flux": ZERO_FLUX},
    ],
    ids=lambda options: next(iter(options), "default"),
)
def test_a_centroid_without_a_place_is_refused(options, n_false, value):
    """One coordinate that is no number, or whose square is none: no attitude, not even from the others."""
    xy, flux, _, _ = field(np.random.default_rng(15), n_false=n_false, least=8)
    given = {"flux": flux, "camera": CAMERA, "epoch": EPOCH, **options}
    if "centroid_covariance_px" in given:
        given["centroid_covariance_px"] = np.tile(given["centroid_covariance_px"], (len(xy), 1, 1))
    for row, column in ((0, 0), (len(xy) - 1, 1)):
        spoilt = xy.copy()
        spoilt[row, column] = value
        with pytest.raises(
            ValueError, match=r"^xy_px: contains NaN or values beyond 1e\+09; expected pixels$"
        ):
            solve_centroids(spoilt, **given)


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0])
@pytest.mark.parametrize("method", ["default", "pyramid"])
def test_a_centroid_without_light_is_refused(method, value):
    xy, flux, _, _ = field(np.random.default_rng(15), n_false=0, least=8)
    for row in (0, len(flux) - 1):
        spoilt = flux.copy()
        spoilt[row] = value
        with pytest.raises(ValueError, match=r"^flux: expected finite positive values$"):
            solve_centroids(xy, spoilt, camera=CAMERA, epoch=EPOCH, method=method)


@pytest.mark.parametrize(
    "arguments, says",
    [
        ((0, 493, 2500.0), "width_px"),
        (("659", 493, 2500.0), "width_px"),
        ((659, 493, float("nan")), "focal_length_px"),
        ((659, 493, 2500.0, (1.0,)), "principal_point_px"),
        ((659, 493, 2500.0, None, (0.1, 0.2)), "distortion"),
    ],
)
def test_wrong_camera_is_named(arguments, says):
    with pytest.raises(ValueError, match=says):
        Camera(*arguments)


def test_a_lens_that_folds_the_picture_over_is_refused():
    """Its corners are the image of no direction: the iterations ended up somewhere, 19 px off."""
    camera = Camera(1024, 1024, 1207.0, None, (-0.47, 0.0, 0.0, 0.0, 0.0))
    centroids = np.array([[100.0, 200.0], [300.0, 40.0], [700.0, 800.0], [500.0, 512.0]])
    with pytest.raises(ValueError, match=r"^Camera.distortion: .* folds the picture over"):
        solve_centroids(centroids, None, camera=camera, epoch=EPOCH)
    with pytest.raises(ValueError, match=r"^Camera.distortion: .* folds the picture over"):
        solve_image(np.zeros((1024, 1024), dtype=np.uint8), camera=camera, epoch=EPOCH)


def test_a_wide_field_uses_the_stars_that_it_needs():
    """60 x 47 deg hold 200 stars to V = 5.5, more than the search takes."""
    rng, camera, solved = np.random.default_rng(12), Camera(659, 493, 570.0), 0
    for _ in range(30):
        xy, flux, q_ci, _ = field(rng, camera=camera, n_false=10)
        found = solve_centroids(xy, flux, camera=camera, epoch=EPOCH)
        if found.status == "ok":
            assert error(found, q_ci) < WRONG
            solved += 1
    assert solved >= 29


def test_epoch_as_an_array_of_one():
    xy, flux, q_ci, _ = field(np.random.default_rng(13), least=8)
    found = solve_centroids(xy, flux, camera=CAMERA, epoch=np.array(EPOCH))
    assert error(found, q_ci) < WRONG


@pytest.mark.parametrize("depth", [4.5, 4.0, 3.5])
def test_a_camera_that_sees_less_than_the_catalogue(depth):
    """24 deg, stars to V = 5.5 in the catalogue, of which only the brightest are seen."""
    rng, camera, solved = np.random.default_rng(14), Camera(1024, 1024, 2400.0), 0
    for _ in range(20):
        xy, flux, q_ci, _ = field(rng, camera=camera, n_false=0, least=5, depth=depth)
        found = solve_centroids(xy, flux, camera=camera, epoch=EPOCH)
        if found.status == "ok":
            assert error(found, q_ci) < WRONG
            solved += 1
    assert solved >= 18


def laid_out(xy, flux):
    """The same centroids as other arrays: columns first, every other one, byte order, held, lists."""
    yield np.asfortranarray(xy), np.repeat(flux, 2)[::2]
    yield np.repeat(xy, 3, axis=0)[::3], flux.astype(">f8")
    held = xy.copy(), flux.copy()
    for one in held:
        one.setflags(write=False)
    yield held
    yield xy.tolist(), flux.tolist()


def test_centroids_may_lie_in_memory_anyhow():
    """And are not written to."""
    xy, flux, q_ci, _ = field(np.random.default_rng(15), least=8)
    before = xy.copy(), flux.copy()
    wanted = solve_centroids(xy, flux, camera=CAMERA, epoch=EPOCH)
    assert error(wanted, q_ci) < WRONG
    assert np.array_equal(xy, before[0]) and np.array_equal(flux, before[1])
    for one in laid_out(xy, flux):
        found = solve_centroids(*one, camera=CAMERA, epoch=EPOCH)
        assert np.array_equal(found.q_ci, wanted.q_ci) and np.array_equal(found.hip, wanted.hip)
