"""Pictures of the night sky with a known truth: solved when they can be, refused when they should be."""

import io

import night_sky
import numpy as np
import pytest
from PIL import Image, ImageDraw

import shefex_nav
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.solve import image as solving
from shefex_nav.solve import search
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.image import solve_image

YEAR = night_sky.YEAR


def solved(shot, image=None, **options):
    """The solution of a shot, compared with its truth: 0.02 deg and half a per cent are the targets."""
    image = night_sky.to_8_bit(shot.image) if image is None else image
    found = solve_image(image, epoch=YEAR, **options)
    assert (found.status, found.reason) == ("ok", "")
    right, down, forward = night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg)
    C_ci = dcm_from_quat(found.q_ci)
    assert np.degrees(np.linalg.norm(C_ci[2] - forward)) < 0.02
    for row, truth in zip(C_ci, (right, down, forward), strict=True):
        assert np.degrees(np.linalg.norm(row - truth)) < 0.1
    off = abs(found.fov_x_deg - shot.fov_deg)
    assert off < 0.005 * shot.fov_deg and off < max(0.002 * shot.fov_deg, 3.0 * found.fov_sigma_deg)
    where = dict(zip(shot.hip.tolist(), shot.xy_px, strict=True))
    scale = shot.image.shape[1] / image.shape[1]  # of a picture that was reduced
    places = [(m.hip, scale * (np.array([m.x_px, m.y_px]) + 0.5) - 0.5) for m in found.matched]
    misses = [np.hypot(*(where[hip] - place)) for hip, place in places if hip in where]
    assert len(misses) >= 0.97 * len(found.matched) >= 4  # a double may have the number of its other star
    assert np.percentile(misses, 90) < 3.0 * max(shot.image.shape[1] / 1000.0, 1.0)
    assert 0.0 < found.false_probability <= 1e-7
    return found


def separation(a, b):
    """Between angles in degrees."""
    return abs((a - b + 180.0) % 360.0 - 180.0)


def test_is_exported():
    assert shefex_nav.solve_image is solve_image


@pytest.mark.parametrize(
    "ra, dec, roll",
    [
        (230.67, 11.04, 27.72),
        (0.02, -35.0, 0.0),
        (359.9, 58.0, 90.0),
        (83.0, 0.0, 180.0),
        (120.0, 88.5, 271.0),
    ],
)
def test_orientation(ra, dec, roll):
    """Middle of the picture and position angle of up, from north through east, in every quarter."""
    shot = night_sky.shoot(np.random.default_rng(1), ra_deg=ra, dec_deg=dec, roll_deg=roll, fov_deg=15.0)
    found = solved(shot)
    assert separation(found.ra_deg, ra) * np.cos(np.radians(dec)) < 0.02 and abs(found.dec_deg - dec) < 0.02
    assert separation(found.roll_deg, roll) * np.cos(np.radians(dec)) < 0.1
    height = 2.0 * np.degrees(np.arctan(np.tan(np.radians(7.5)) * 768 / 1024))
    assert abs(found.fov_y_deg - height) < 0.03


def test_mirrored_is_refused():
    rng = np.random.default_rng(2)
    for fov in (9.0, 20.0):
        shot = night_sky.shoot(rng, fov_deg=fov, limit=7.0 if fov < 12 else 6.0)
        image = night_sky.to_8_bit(shot.image)
        for mirrored in (image[:, ::-1], image[::-1]):
            found = solve_image(np.ascontiguousarray(mirrored), epoch=YEAR)
            assert (found.status, found.reason) == ("failed", "mirrored")
            assert found.matched == [] and found.false_probability == 1.0 and np.isnan(found.ra_deg)


@pytest.mark.parametrize(
    "options",
    [
        {"fov_deg": 7.0, "limit": 7.5},
        {"fov_deg": 11.4, "limit": 7.0, "sigma_px": 0.5},
        {"fov_deg": 20.0, "limit": 6.0},
        {"fov_deg": 30.0, "limit": 5.5},
        {"fov_deg": 30.0, "limit": 4.5},
        {"fov_deg": 16.0, "limit": 6.0, "width": 640, "height": 480},
        {"fov_deg": 18.0, "limit": 6.5, "width": 1920, "height": 1080, "sigma_px": 1.5},
        {"fov_deg": 9.0, "limit": 6.5, "width": 720, "height": 1280},
        {"fov_deg": 14.0, "limit": 7.0, "width": 4000, "height": 3000, "sigma_px": 2.5},
        {"fov_deg": 20.0, "limit": 6.0, "k1_edge": 0.01},
        {"fov_deg": 25.0, "limit": 6.0, "k1_edge": -0.02},
        {"fov_deg": 15.0, "limit": 6.5, "trail_px": 7.0},
        {"fov_deg": 15.0, "limit": 6.5, "noise": 8.0, "background": 20.0},
    ],
    ids=str,
)
def test_fields_sizes_lenses(options):
    rng = np.random.default_rng(3)
    for _ in range(2):
        solved(night_sky.shoot(rng, **options))


def jpeg(image, quality):
    """Through the compression of a camera."""
    file = io.BytesIO()
    Image.fromarray(night_sky.to_8_bit(image)).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def reduced(image):
    """To half the size, as for a web page."""
    small = Image.fromarray(night_sky.to_8_bit(image)).resize((512, 384), Image.Resampling.LANCZOS)
    return np.asarray(small)


def coloured(image):
    """Warm light, RGB."""
    return np.stack([night_sky.to_8_bit(image * c) for c in (1.1, 0.9, 0.7)], axis=-1)


@pytest.mark.parametrize(
    "spoil",
    [
        night_sky.glow,
        night_sky.trees,
        night_sky.satellite,
        night_sky.hot_pixels,
        lambda image, rng: night_sky.moon(image, 700.0, 200.0, 30.0),
        lambda image, rng: jpeg(image, 60),
        lambda image, rng: reduced(image),
        lambda image, rng: coloured(image),
        lambda image, rng: night_sky.to_16_bit(image),
    ],
    ids=["glow", "trees", "satellite", "hot pixels", "moon", "jpeg", "reduced", "colour", "16 bits"],
)
def test_what_spoils_a_picture(spoil):
    rng = np.random.default_rng(6)
    for ra, dec in ((84.0, 5.0), (200.0, 50.0)):
        shot = night_sky.shoot(rng, fov_deg=14.0, limit=6.5, ra_deg=ra, dec_deg=dec)
        image = spoil(shot.image, rng)
        solved(shot, night_sky.to_8_bit(image) if image.dtype == float else image)


def test_field_of_view_may_be_given():
    shot = night_sky.shoot(np.random.default_rng(5), fov_deg=11.4)
    assert solved(shot, fov_deg=10.5).false_probability <= solved(shot).false_probability
    assert solve_image(night_sky.to_8_bit(shot.image), fov_deg=25.0, epoch=YEAR).status == "failed"


def test_camera_may_be_given():
    """Axis off the middle and strong distortion, both known: the answer is for the middle all the same."""
    shot = night_sky.shoot(np.random.default_rng(6), fov_deg=20.0, limit=6.0, k1_edge=-0.03)
    edge = np.tan(np.radians(10.0))
    f = 512.0 / (edge * 0.97)
    camera = Camera(1024, 768, 1.01 * f, None, (-0.03 / edge**2, 0.0, 0.0, 0.0, 0.0))
    assert abs(solved(shot, camera=camera).camera.focal_length_px / f - 1.0) < 1e-3
    rows, columns = slice(40, None), slice(100, None)  # a cut picture has its axis off the middle
    cut = np.ascontiguousarray(night_sky.to_8_bit(shot.image)[rows, columns])
    camera = Camera(924, 728, f, (411.5, 343.5), (-0.03 / edge**2, 0.0, 0.0, 0.0, 0.0))
    found = solve_image(cut, camera=camera, epoch=YEAR)
    forward = night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg)[2]
    assert found.status == "ok" and np.linalg.norm(dcm_from_quat(found.q_ci)[2] - forward) < 2e-4
    middle = night_sky.axes(found.ra_deg, found.dec_deg, 0.0)[2]
    assert abs(np.degrees(np.arccos(middle @ forward)) - np.degrees(np.hypot(50, 20) / f)) < 0.1


def daylight(rng):
    """Sky, hills and a house with windows."""
    y, x = np.mgrid[0:768, 0:1024]
    image = 200.0 - 0.05 * y
    image[y > 450 + 60 * np.sin(x / 130)] = 80.0
    image[400:650, 300:600] = 120.0
    for column in range(330, 580, 60):
        image[450:480, column : column + 25] = 30.0
    return image + rng.normal(0.0, 3.0, image.shape)


def text(rng):
    """A printed page, white on black: letters are small and bright."""
    image = Image.new("L", (1024, 768), 5)
    pen = ImageDraw.Draw(image)
    for row in range(40):
        letters = "".join(rng.choice(list("abcdefghij .,:"), 90))
        pen.text((30, 18 * row + 10), letters, fill=230)
    return np.asarray(image, dtype=float)


def lamps(rng):
    """A city at night: points of light in rows."""
    image = rng.normal(20.0, 2.0, (768, 1024))
    for k in range(12):
        for j in range(5):
            night_sky.star(image, 60.0 + 80.0 * k, 150.0 + 110.0 * j + 0.3 * k, 3000.0, 1.5)
    return image


@pytest.mark.parametrize(
    "picture, reason",
    [
        (lambda rng: np.full((480, 640), 17.0), "too_few_stars"),
        (lambda rng: rng.normal(60.0, 3.0, (768, 1024)), "too_few_stars"),
        (lambda rng: np.mgrid[0:480, 0:640][1] / 3.0 + rng.normal(0.0, 1.0, (480, 640)), "too_few_stars"),
        (daylight, None),
        (text, None),
        (lamps, None),
        (lambda rng: 255.0 * (np.indices((480, 640)).sum(axis=0) // 20 % 2), None),
        (lambda rng: rng.integers(0, 255, (480, 640)).astype(float), None),
    ],
    ids=["constant", "noise", "gradient", "daylight", "text", "lamps", "checkerboard", "static"],
)
def test_no_stars_no_solution(picture, reason):
    found = solve_image(night_sky.to_8_bit(picture(np.random.default_rng(7))), epoch=YEAR)
    assert found.status == "failed"
    assert found.reason in ((reason,) if reason else ("too_few_stars", "no_match"))
    assert found.false_probability == 1.0 and found.matched == [] and np.isnan(found.q_ci).all()


def random_fields(rng, n):
    """Points that are no stars: anywhere, in clusters, on lines, with the brightnesses of stars or not."""
    for k in range(n):
        m = int(rng.integers(5, 64))
        xy_px = rng.uniform([0.0, 0.0], [1023.0, 767.0], (m, 2))
        if k % 3 == 1:
            xy_px = np.clip(rng.uniform(200, 600, (1, 2)) + rng.normal(0.0, 80.0, (m, 2)), 0.0, 767.0)
        if k % 3 == 2:
            xy_px[:, 1] = 300.0 + 0.2 * xy_px[:, 0] + rng.normal(0.0, 5.0, m)
        flux = np.sort(10.0 ** (-0.4 * rng.uniform(0.0, rng.choice([0.5, 4.0]), m)))[::-1]
        yield xy_px, np.ascontiguousarray(flux)


def wrong_solutions(seed, n):
    """How many of n random fields are solved."""
    wanted = search.Search((1024, 768), solving._focal_range((1024, 768), None, None), YEAR, True)
    fields = random_fields(np.random.default_rng(seed), n)
    return sum(search.solve(*points, wanted, search.Clock())[0] is not None for points in fields)


@pytest.mark.slow
def test_random_points_are_no_stars():
    assert wrong_solutions(8, 20) == 0


@pytest.mark.slow
def test_thousands_of_random_points_are_no_stars():
    assert wrong_solutions(9, 3000) == 0


REFERENCE = {  # three independent solvers agree to 0.01 deg: RA, Dec, roll, field of view
    "Azi-135": (230.6677, 11.0357, 27.721, 11.421),
    "Azi-45": (172.3667, 57.6494, 56.574, 11.424),
    "Azi135": (296.7569, 11.3140, 335.109, 11.429),
    "Azi45": (355.2046, 58.1516, 306.692, 11.425),
}


@pytest.mark.parametrize("name", REFERENCE)
def test_real_frames(real_frames, name):
    """Without being told the field of view."""
    (path,) = real_frames.glob(f"*_{name}_*.tiff")
    found = solve_image(path, epoch=2019.57)
    ra, dec, roll, fov = REFERENCE[name]
    assert found.status == "ok" and found.false_probability < 1e-50
    a, b = night_sky.axes(found.ra_deg, found.dec_deg, 0.0)[2], night_sky.axes(ra, dec, 0.0)[2]
    assert np.degrees(np.linalg.norm(a - b)) < 0.01
    assert separation(found.roll_deg, roll) * np.cos(np.radians(dec)) < 0.02
    assert abs(found.fov_x_deg - fov) < 0.02
    assert len(found.matched) > 30
    mirrored = np.asarray(Image.open(path))[:, ::-1]
    assert solve_image(np.ascontiguousarray(mirrored), epoch=2019.57).reason == "mirrored"


@pytest.mark.parametrize(
    "image, options, says",
    [
        (np.zeros((100, 100, 7)), {}, "1 to 4 channels"),
        (np.zeros(100), {}, "expected numbers"),
        (np.zeros((10, 100)), {}, "10 pixels"),
        (np.full((100, 100), np.nan), {}, "NaN"),
        (np.zeros((100, 100), dtype=complex), {}, "expected numbers"),
        (None, {}, "image: expected an array .* or the path of a file, got NoneType"),
        ([[0, 1], [2, 3]], {}, "image: expected an array .* got list"),
        (np.zeros((100, 100)), {"fov_deg": 71.0}, "fov_deg: expected 2 to 70 degrees, got 71"),
        (np.zeros((100, 100)), {"fov_deg": 1.9}, "fov_deg: expected 2 to 70"),
        (np.zeros((100, 100)), {"fov_deg": "20"}, "fov_deg: expected a number, got '20'"),
        (np.zeros((100, 100)), {"fov_deg": float("nan")}, "fov_deg: expected"),
        (np.zeros((100, 100)), {"epoch": "x"}, "epoch: expected a number, got 'x'"),
        (np.zeros((100, 100)), {"epoch": 19.0}, "epoch: expected"),
        (np.zeros((100, 100)), {"camera": (1, 2)}, "camera: expected"),
        (np.zeros((100, 100)), {"camera": Camera(640, 480, 1000.0)}, "640 x 480"),
        (np.zeros((100, 100)), {"camera": Camera(100, 100, 500.0), "fov_deg": 11.0}, "not together"),
    ],
)
def test_wrong_input_is_named(image, options, says):
    with pytest.raises(ValueError, match=says):
        solve_image(image, **options)
