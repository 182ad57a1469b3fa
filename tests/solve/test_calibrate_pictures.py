"""Calibration from pictures: what it finds against the camera that made them, and when it refuses."""

import importlib
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from calibration_shots import (
    BLACK_DN,
    PER_DN,
    PSF_PX,
    READ_NOISE,
    SIZE_PX,
    YEAR,
    camera_of,
    shoot,
)
from PIL import Image
from scipy.stats import chi2
from typer.testing import CliRunner

from shefex_nav.commands import calibrate as commands
from shefex_nav.commands.app import app
from shefex_nav.frames import camera_file
from shefex_nav.geometry.rotation import quat_from_rotvec, quat_multiply
from shefex_nav.papers.stills import random_attitude
from shefex_nav.scenario import load
from shefex_nav.solve.calibration import calibrate, hot_pixels, lens_fit, noise, pictures, spots, table
from shefex_nav.solve.header import Taken

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
TOLD = pictures.Told(15.0, YEAR)
SKIES = 2.0, 20.0, 60.0, 120.0  # electrons a pixel
KNOWN = calibrate.Known(BLACK_DN, None)


def looked(seed, n=8, skies=SKIES, q_ic=None):
    """Camera, and Seen of n pictures of it."""
    rng = np.random.default_rng([8117, seed])
    camera = camera_of(rng)
    images = [shoot(rng, camera, background=skies[k % len(skies)], q_ic=q_ic) for k in range(n)]
    return camera, [pictures.look(f"{k}.png", image, Taken(YEAR), TOLD) for k, image in enumerate(images)]


@pytest.fixture(scope="module")
def sets():
    """(camera, Calibration) of drawn cameras."""
    return [(camera, calibrate.of_seen(seen, KNOWN)) for camera, seen in map(looked, range(10))]


def nees(found, true):
    """Squared error of the lens over its covariance, of all that the stars tell at 15 deg and more."""
    told = slice(0, 7)  # k3 keeps its prior in a field so narrow
    d = (found.lens.values - true)[told]
    return d @ np.linalg.solve(found.lens.covariance[told, told], d)


@pytest.mark.slow
def test_errors_of_the_lens_are_as_large_as_its_covariance_says(sets):
    low, high = chi2.ppf([0.0005, 0.9995], 7 * len(sets))
    assert low < sum(nees(found, camera.values) for camera, found in sets) < high


@pytest.mark.slow
def test_a_lens_of_other_pictures_is_found_as_well(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    theirs, squares, size_px = importlib.import_module("pictures"), [], (1024, 768)
    for number, width_deg in enumerate((20.0, 40.0, 20.0)):
        rng = np.random.default_rng([9001, number])
        lens, told = theirs.draw_lens(rng, "brown", size_px, width_deg), pictures.Told(width_deg, theirs.YEAR)
        shots = [theirs.shoot(rng, width_deg, "brown", size_px=size_px, lens=lens) for _ in range(8)]
        seen = [pictures.look("theirs", shot.image, Taken(theirs.YEAR), told) for shot in shots]
        found, (k1, k2, k3, p1, p2) = calibrate.of_seen(seen), lens.k
        true = np.array([lens.focal_px, 511.5, 383.5, k1, k2, p1, p2, k3])
        assert found.lens.values[0] == pytest.approx(lens.focal_px, rel=5e-4)
        assert len(found.hot.excess) == 0
        squares.append(nees(found, true))
    low, high = chi2.ppf([0.0005, 0.9995], 7 * len(squares))
    assert low < sum(squares) < high


def test_the_stars_tell_the_focal_length_to_a_ten_thousandth(sets):
    for camera, found in sets:
        assert found.lens.sigma[0] < 2e-4 * camera.values[0]
        assert found.lens.is_told[:4].all()
        assert not found.lens.is_told[7]  # k3 in a field of 15 deg


def test_detector_and_spots_are_those_that_made_the_pictures(sets):
    pulls = []
    for _, found in sets:
        gain, read_noise = found.noise.gain, found.noise.read_noise
        assert gain[0] == pytest.approx(PER_DN, rel=0.04)
        assert read_noise[0] == pytest.approx(READ_NOISE, rel=0.05)
        assert found.psf_sigma[0] == pytest.approx(PSF_PX, rel=0.03)
        pulls.append([(gain[0] - PER_DN) / gain[1], (read_noise[0] - READ_NOISE) / read_noise[1]])
    low, high = chi2.ppf([0.0005, 0.9995], len(pulls))
    for squares in (np.array(pulls) ** 2).sum(axis=0):
        assert low < squares < high


def test_hot_pixels_are_found_and_no_star_is_taken_for_one(sets):
    for camera, found in sets:
        true = {tuple(one) for one in camera.hot.tolist()}
        at = {tuple(one) for one in found.hot.row_column.tolist()}
        assert at <= true
        assert len(at) >= 0.95 * len(true)


def test_one_level_of_the_sky_tells_no_gain():
    _, seen = looked(50, n=4, skies=(20.0,))
    found = calibrate.of_seen(seen, calibrate.Known(BLACK_DN, PER_DN))
    assert found.noise.gain is None
    assert "too alike" in found.why["gain"]
    assert found.noise.read_noise[0] == pytest.approx(READ_NOISE, rel=0.03)  # with the gain told
    assert calibrate.of_seen(seen).noise.read_noise is None


def test_pictures_that_look_the_same_way_tell_no_hot_pixels():
    q_ic = random_attitude(np.random.default_rng(3))
    _, seen = looked(51, n=4, q_ic=q_ic)
    found = calibrate.of_seen(seen, KNOWN)
    assert "one direction" in found.hot.why
    assert len(found.hot.excess) == 0
    turned = quat_multiply(q_ic, quat_from_rotvec(np.array([1e-3, 0.0, 0.0])))  # 2.5 px
    _, seen = looked(51, n=4, q_ic=turned)
    assert calibrate.of_seen(seen, KNOWN).hot.why


def test_a_star_in_a_still_sky_is_no_hot_pixel_even_when_it_is_bright():
    one = hot_pixels.Bright(np.array([5005]), np.array([90.0]), 2.0)
    free = [np.zeros((100, 100), dtype=bool)] * 4
    seen = [one, one, one, hot_pixels.Bright(np.zeros(0, dtype=int), np.zeros(0), 2.0)]
    assert len(hot_pixels.find([one] * 4, free, np.arange(4), (100, 100)).excess) == 1
    assert len(hot_pixels.find(seen, free, np.arange(4), (100, 100)).excess) == 0  # not in all
    near = [np.ones((100, 100), dtype=bool)] * 2 + free[:2]
    assert len(hot_pixels.find([one] * 4, near, np.arange(4), (100, 100)).excess) == 0  # a star twice


def test_the_excess_of_weak_hot_pixels_is_not_that_of_the_pictures_that_show_it():
    """800 pixels 5 sigma above the sky in 30 pictures, seed 1: in one of 40 pictures a pixel is below 3."""
    rng, shape = np.random.default_rng(1), (100, 200)
    seen = []
    for _ in range(30):
        flat = rng.normal(0.0, 2.0, shape)
        flat[::5, ::5] += 10.0
        seen.append(hot_pixels.bright(flat, 2.0))
    found = hot_pixels.find(seen, [np.zeros(shape, dtype=bool)] * 30, np.arange(30), shape[::-1])
    off = (found.excess - 10.0) / found.sigma
    assert len(off) > 780 and abs(off.mean()) < 0.15 and 0.9 < off.std() < 1.1  # of those shown alone: 0.34


def test_variance_over_mean_tells_the_gain_that_made_it():
    rng = np.random.default_rng(6)
    g, r, black = 3.0, 9.0, 40.0
    found = []
    for electrons in (5.0, 100.0, 400.0):
        values = (rng.poisson(electrons, (400, 400)) + r * rng.standard_normal((400, 400))) / g + black
        found += noise.levels(np.rint(values).astype(np.float32), np.zeros((400, 400), dtype=bool))
    told = noise.told(found, black)
    assert abs(told.gain[0] - g) < 4.0 * told.gain[1] < 0.1
    assert abs(told.read_noise[0] - r) < 4.0 * told.read_noise[1] < 0.4


@pytest.mark.parametrize("n", [8, 9, 12, 16, 25, 100])
def test_the_width_of_a_spot_is_as_far_off_as_its_sigma_says(n):
    """With n drawn widths; the scatter by the median of eight made it 1.5 sigma."""
    rng = np.random.default_rng(12)
    found = np.array([spots.combined(0.8 + 0.02 * rng.standard_normal(n)) for _ in range(4000)])
    off = (found[:, 0] - 0.8) / found[:, 1]
    assert 0.88 < np.sqrt(np.mean(off**2)) < 1.1


def test_the_noise_of_the_sky_is_that_of_the_level_that_is_said():
    """A level between the darkest and the mean of all, at which no picture need have been taken."""
    rng, free = np.random.default_rng(13), np.zeros((256, 256), dtype=bool)
    g, r, black = 2.3, 8.0, 100.0
    found = []
    for mean_dn in (20.0, 60.0, 200.0):
        electrons = rng.poisson(mean_dn * g, free.shape) + r * rng.standard_normal(free.shape)
        found += noise.levels(np.rint(black + electrons / g), free)
    told = noise.told(found, black)
    value, sigma = told.background
    assert 120.0 < told.level_dn < 180.0
    assert abs(value - np.sqrt((r / g) ** 2 + (told.level_dn - black) / g)) < 4.0 * sigma < 0.3


def test_a_sky_that_is_cut_off_at_zero_tells_no_noise():
    """With all tiles the gain of 2.3 was told as 1.28 +- 0.07; what is left tells it or says nothing."""
    rng, free = np.random.default_rng(0), np.zeros((256, 256), dtype=bool)
    g, r = 2.3, 8.0

    def sky(mean_dn):
        electrons = rng.poisson(mean_dn * g, free.shape) + r * rng.standard_normal(free.shape)
        return np.maximum(np.rint(electrons / g), 0.0)

    dark = [level for mean_dn in (2.0, 5.0, 9.0) for level in noise.levels(sky(mean_dn), free)]
    assert dark == []
    whole = [level for mean_dn in (20.0, 60.0, 150.0) for level in noise.levels(sky(mean_dn), free)]
    assert len(whole) == 48
    told = noise.told(dark + whole, 0.0)
    assert abs(told.gain[0] - g) < 4.0 * told.gain[1] < 0.5
    assert abs(told.read_noise[0] - r) < 4.0 * told.read_noise[1] < 2.0


def test_a_sky_that_is_cut_off_at_zero_has_no_hot_pixels_that_are_noise(monkeypatch):
    """By the quantile below the median such a sky has no noise: 1752 of its pixels were hot."""
    monkeypatch.setattr("calibration_shots.BLACK_DN", 0.0)
    camera, seen = looked(60, n=6, skies=(0.0,))
    found = calibrate.of_seen(seen)
    at = {tuple(one) for one in found.hot.row_column.tolist()}
    true = {tuple(one) for one in camera.hot.tolist()}
    assert len(at - true) == 0 and len(at) > 0.9 * len(true)
    assert found.noise is None and "cut off" in found.why["noise"]
    per_pixel = np.hypot(READ_NOISE / PER_DN, np.sqrt(1.0 / 12.0))
    assert all(0.85 * per_pixel < one.bright.noise < 1.1 * per_pixel for one in seen)


def test_the_noise_of_many_levels_scatters_about_the_truth():
    """40 sets of 160 tiles of 500 differences each, seed 5: a tile that came out low has no more weight."""
    rng, off = np.random.default_rng(5), []
    for _ in range(40):
        pictures_dn = rng.normal(100.0, 2.0, (10, 128, 128))
        free = np.zeros((128, 128), dtype=bool)
        found = [level for one in pictures_dn for level in noise.levels(np.rint(one), free)]
        value, sigma = noise.told(found).background
        off.append((value - 2.0) / sigma)
    assert abs(np.mean(off)) < 0.48 and 0.75 < np.std(off) < 1.25  # 3 and 2.2 sigma


def test_few_stars_and_other_sizes_are_refused():
    _, seen = looked(52, n=2)
    nine = [lens_fit.Sights(one.sights.C_ci, *(part[:9] for part in one.sights[1:])) for one in seen]
    few = [one._replace(sights=sights) for one, sights in zip(seen, nine, strict=True)]
    assert "18 stars are named" in calibrate.of_seen(few)
    with pytest.raises(calibrate.CalibrationError, match=r"one size; .*0\.png has 659 x 493"):
        calibrate.of_seen([seen[0], seen[1]._replace(size_px=(640, 480))])
    unsolved = [pictures.Unsolved("cloud.png", "too_few_stars")]
    assert "cloud.png (too_few_stars)" in calibrate.of_seen(unsolved)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Pictures of one camera, in files, and one of clouds."""
    to = tmp_path_factory.mktemp("calibrate")
    rng = np.random.default_rng(77)
    camera = camera_of(rng)
    for k in range(8):
        Image.fromarray(shoot(rng, camera, background=SKIES[k % 4])).save(to / f"p{k}.png")
    cloud = np.rint(rng.normal(30.0, 2.2, SIZE_PX[::-1])).astype(np.uint8)
    Image.fromarray(cloud).save(to / "cloud.png")
    return to


def called(*words):
    return CliRunner().invoke(app, ["calibrate", *map(str, words)])


def test_the_file_that_is_written_solves_the_pictures_that_the_nominal_camera_does_not(folder):
    files, told, out = sorted(folder.glob("p*.png")), "shefex2_andoya", folder / "cam.yaml"
    one = called(*files, folder / "cloud.png", "--camera", told, "--epoch", YEAR, "--output", out, "--json")
    assert one.exit_code == 0, one.output
    numbers = json.loads(one.stdout)
    assert [unsolved["reason"] for unsolved in numbers["unsolved"]] == ["too_few_stars"]
    again = called(*files, "--camera", told, "--epoch", YEAR, "--output", out)
    assert again.exit_code == 2
    assert "exists already" in again.output

    def solved(camera):
        words = ["solve", *map(str, files), "--camera", str(camera), "--epoch", str(YEAR), "--json"]
        lines = CliRunner().invoke(app, words).stdout.splitlines()
        return [row for row in map(json.loads, lines) if row["status"] == "ok"]

    calibrated = solved(out)
    assert len(calibrated) == len(files)
    assert len(solved(told)) < len(files)
    assert all(row["residual_px"] < 0.3 for row in calibrated)
    detector = camera_file.base(out).detector
    assert detector.conversion == pytest.approx(numbers["gain_electrons_per_dn"]["value"] * 10**1.2, rel=1e-3)


def test_its_section_stands_in_a_scenario(folder):
    files, out = sorted(folder.glob("p*.png")), folder / "section.yaml"
    assert called(*files, "--camera", "shefex2_andoya", "--epoch", YEAR, "--output", out).exit_code == 0
    tree = camera_file.base(out).tree
    text = load.normalised({"extends": "shefex2_andoya.yaml", "star_camera": tree["star_camera"]})
    (folder / "flight.yaml").write_text(text)
    scenario = load.load(folder / "flight.yaml")
    assert scenario.star_camera.optics.focal_length == pytest.approx(
        camera_file.base(out).camera.params.camera.pinhole.focal_length_px * 9.9e-6, rel=1e-9
    )


def test_pictures_of_one_direction_are_remarked():
    """0.3 deg about the boresight's x, and a roll that moves no boresight; a field of view of 15 deg."""
    turn, angle = np.radians(0.3), np.radians(40.0)
    about_x = np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]])
    about_z = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    apart = calibrate._apart([np.eye(3), about_x, about_z])
    assert apart == pytest.approx(turn) and calibrate._apart([np.eye(3)]) == 0.0
    found = SimpleNamespace(
        size_px=(1000, 1000), lens=SimpleNamespace(values=[3800.0]), apart=apart, pictures=["a", "b", "c"]
    )
    assert "turn the camera" in table._alike(found)
    found.apart = np.radians(3.0)
    assert table._alike(found) == ""


def test_the_table_says_what_is_in_the_width_of_a_spot(folder):
    shown = called(*sorted(folder.glob("p*.png")), "--epoch", YEAR)
    assert shown.exit_code == 0, shown.output
    words = " ".join(shown.output.replace("│", " ").split())
    assert "moved during the exposure" in words and "pictures look apart by" in words


def test_what_cannot_be_calibrated_is_said_with_its_exit_code(folder):
    cloud = called(folder / "cloud.png", "--epoch", YEAR, "--fov", "15 deg")
    assert cloud.exit_code == 1
    assert "none of the 1 pictures is solved" in cloud.output
    no_match = commands._words(pictures.Unsolved("x.png", "no_match"), 15.0, "leave --fov out")
    assert "x.png is not solved and not used, no_match: " in no_match
    assert "within 20 % of 15 deg" in no_match and "{" not in no_match and "leave --fov out" in no_match
    undated = called(folder / "p0.png", "--fov", "15 deg")
    assert undated.exit_code == 2
    no_base = called(folder / "p0.png", "--output", folder / "x.yaml")
    assert no_base.exit_code == 2
    assert "needs --camera" in no_base.output
