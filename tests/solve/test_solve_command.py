"""`shefex-nav solve` as a user calls it."""

import json

import night_sky
import numpy as np
import pytest
import test_axis_off
import test_picture
from PIL import Image
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from shefex_nav import Camera, solve_image
from shefex_nav.commands.app import app
from shefex_nav.commands.solve import julian_year
from shefex_nav.solve.solution import failed
from shefex_nav.solve.stages import contrast, describe, free_place


def solve(*arguments):
    return CliRunner().invoke(app, ["solve", *map(str, arguments)])


@pytest.fixture(scope="module")
def sky(tmp_path_factory):
    """A picture and its truth."""
    shot = night_sky.shoot(np.random.default_rng(1), fov_deg=14.0, limit=6.5, ra_deg=84.0, dec_deg=5.0)
    path = tmp_path_factory.mktemp("sky") / "orion.png"
    Image.fromarray(night_sky.to_8_bit(shot.image)).save(path)
    return path, shot


def test_json(sky):
    path, shot = sky
    done = solve(path, "--json", "--epoch", night_sky.YEAR)
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert list(result) == [
        "version", "file", "status", "reason", "ra_deg", "dec_deg", "roll_deg", "fov_x_deg", "fov_y_deg",
        "matched", "false_probability", "wall_ms", "axis_ra_deg", "axis_dec_deg", "q_ic", "sigma_arcsec",
        "covariance_rad2", "residual_px", "aberration_removed", "julian_year", "date_from", "camera",
        "camera_q_ci", "camera_covariance_rad2", "fov_x_sigma_deg",
    ]  # fmt: skip
    assert (result["file"], result["date_from"]) == (str(path), "epoch")
    for name in ("ra_deg", "dec_deg"):  # to 0.004 arcsec: a narrow field keeps the axis in the middle
        assert result[f"axis_{name}"] == pytest.approx(result[name], abs=1e-6)
    assert result["status"] == "ok" and result["reason"] == ""
    assert abs(result["ra_deg"] - shot.ra_deg) < 0.02 and abs(result["dec_deg"] - shot.dec_deg) < 0.02
    assert set(result["matched"][0]) == {"hip", "x_px", "y_px", "vmag", "name", "designation"}
    assert "Betelgeuse" in {match["name"] for match in result["matched"]}
    names = {match["hip"]: (match["name"], match["designation"]) for match in result["matched"]}
    assert names[27989] == ("Betelgeuse", "alpha Ori") and names[26207][1] == "lambda Ori"
    assert 0.0 < result["false_probability"] < 1e-7 and result["wall_ms"] > 0.0


def test_json_has_the_camera_that_was_found(tmp_path):
    """With its numbers alone, by the formula of OpenCV, stars are where they are in the picture."""
    image, _, off_px = test_axis_off.cut(np.random.default_rng(32), 62.0, 5.0)
    Image.fromarray(image).save(tmp_path / "wide.png")
    result = json.loads(solve(tmp_path / "wide.png", "--json", "--epoch", int(night_sky.YEAR)).stdout)
    camera = result["camera"]
    assert list(camera) == ["width_px", "height_px", "focal_length_px", "principal_point_px", "distortion"]
    assert (camera["width_px"], camera["height_px"]) == (1024, 768)
    assert np.abs(np.array(camera["principal_point_px"]) - [511.5, 383.5] - off_px).max() < 3.0
    assert camera["focal_length_px"] == pytest.approx(537.0 / np.tan(np.radians(31.0)), rel=0.01)
    matched = result["matched"]
    rows = [np.flatnonzero(night_sky.STARS.hip == one["hip"])[0] for one in matched]
    w, x, y, z = result["camera_q_ci"]
    turn = Rotation.from_quat([x, y, z, w])  # scalar last
    X, Y, Z = turn.apply(night_sky.STARS.u_i[rows]).T
    x, y = X / Z, Y / Z
    k1, k2, p1, p2, k3 = camera["distortion"]
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent = np.array(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )
    place_px = np.array(camera["principal_point_px"]) + camera["focal_length_px"] * bent.T
    off = place_px - [[one["x_px"], one["y_px"]] for one in matched]
    assert np.median(np.hypot(*off.T)) < 0.3
    P = np.array(result["camera_covariance_rad2"])
    assert (np.diag(P)[:2] > 25.0 * np.diag(result["covariance_rad2"])[:2]).all()
    assert np.array(Camera(**camera).principal_point_px) == pytest.approx(camera["principal_point_px"])


@pytest.mark.parametrize("fov", ["14 deg", "13", "0.25 rad", "15°"])
def test_table_and_field_of_view(sky, fov):
    done = solve(sky[0], "--fov", fov)
    assert done.exit_code == 0, done.output
    for text in (
        "right ascension",
        "the middle of the picture",
        "declination",
        "field of view",
        "brightest stars",
        "27989",
        "Betelgeuse",
        "alpha Ori",
    ):
        assert text in done.stdout


def test_unsolved_ends_with_1(tmp_path):
    rng = np.random.default_rng(2)
    noise = np.clip(rng.normal(60.0, 5.0, (300, 400)), 0, 255).astype(np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    done = solve(tmp_path / "noise.png", "--json", "--overlay", tmp_path / "drawn.png")
    assert done.exit_code == 1, done.output
    result = json.loads(done.stdout)
    assert (result["status"], result["reason"]) == ("failed", "too_few_stars")
    assert result["ra_deg"] is None and result["matched"] == [] and result["false_probability"] == 1.0
    assert (tmp_path / "drawn.png").exists()
    done = solve(tmp_path / "noise.png")
    assert done.exit_code == 1 and "not solved" in done.stdout and "too_few_stars" in done.stdout


@pytest.mark.parametrize("name, content, says", test_picture.HOSTILE, ids=lambda value: str(value)[:16])
def test_hostile_files_end_with_2(tmp_path, name, content, says):
    path = tmp_path / name
    path.write_bytes(content)
    done = solve(path, "--json")
    assert done.exit_code == 2 and done.stdout == ""
    assert "Traceback" not in done.stderr and name in done.stderr.replace("\n", "").replace("│", "").replace(
        " ", ""
    )


@pytest.mark.parametrize(
    "options, says",
    [
        (["--fov", "wide"], "--fov: expected an angle such as '11.4 deg', or a number of degrees"),
        (["--fov", "11.4 parsec"], "--fov: expected an angle"),
        (["--fov", "14,9 deg"], "decimals follow a point: '14.9 deg'"),
        (["--fov", "1,234,5 deg"], "or a number of degrees, got '1,234,5 deg'\n"),
        (["--fov", "14,9 parsec"], "or a number of degrees, got '14,9 parsec'\n"),
        (["--fov", "90 deg"], "--fov: expected 2 to 70 deg"),
        (["--fov", "0.25"], "'0.25', which is 0.25 deg"),
        (["--epoch", "20"], "--epoch"),
        (["--epoch", "0001-01-01T00:00+10:00"], "--epoch: expected UTC in ISO 8601"),
        (["--overlay", "drawing.jpg"], "--overlay"),
        (["--overlay", "nowhere/drawing.png"], "--overlay"),
    ],
)
def test_wrong_options_end_with_2(sky, options, says):
    done = solve(sky[0], *options)
    assert done.exit_code == 2 and says in done.stderr and "Traceback" not in done.stderr
    assert solve("nowhere.png").exit_code == 2


def test_overlay(sky, tmp_path):
    path, shot = sky
    drawn = tmp_path / "drawn.png"
    assert solve(path, "--overlay", drawn).exit_code == 0
    image = np.asarray(Image.open(drawn)).astype(int)
    assert image.shape[1] == shot.image.shape[1] and image.shape[0] > shot.image.shape[0]
    betelgeuse = shot.xy_px[list(shot.hip).index(27989)]
    x, y = np.rint(betelgeuse).astype(int)
    ring = [image[y + dy, x + dx] for dx, dy in ((9, 0), (-9, 0), (0, 9), (0, -9))]
    assert any(pixel[1] > pixel[0] + 40 for pixel in ring)  # green
    before = drawn.read_bytes()
    done = solve(path, "--overlay", drawn)
    assert done.exit_code == 2 and "exists" in done.stderr
    assert drawn.read_bytes() == before


def test_names_cover_nothing():
    """Boxes of names and stars placed at random do not overlap, whatever the crowd."""
    rng = np.random.default_rng(3)
    stars = rng.uniform(20.0, 480.0, (60, 2))
    taken = [(x - 9, y - 9, x + 9, y + 9) for x, y in stars]
    n_stars, placed = len(taken), 0
    for x, y in stars:
        box = free_place(x, y, 70.0, 12.0, (500, 500), taken)
        if box is None:
            continue
        assert box[0] >= 0 and box[1] >= 0 and box[2] <= 500 and box[3] <= 500
        for other in taken:
            assert box[0] >= other[2] or other[0] >= box[2] or box[1] >= other[3] or other[1] >= box[3]
        taken.append(box)
        placed += 1
    assert placed > 0.4 * n_stars


def test_epoch_is_a_date_or_ajulian_year():
    assert julian_year("2012.5") == 2012.5
    assert julian_year("2000-01-01T12:00:00Z") == pytest.approx(2000.0, abs=2e-6)
    assert julian_year("2012-06-22") == pytest.approx(2000.0 + 4555.5 / 365.25)  # JD 2456100.5


def test_stages_are_drawn_and_nothing_is_lost(sky, tmp_path):
    """Of a picture that is solved all six, of noise those that were reached; none is written over."""
    folder = tmp_path / "steps"
    done = solve(sky[0], "--epoch", night_sky.YEAR, "--stages", folder)
    assert done.exit_code == 0, done.output
    names = sorted(path.name for path in folder.iterdir())
    assert names == [
        "1-background.png", "2-objects.png", "3-centroids.png",
        "4-hypotheses.png", "5-residuals.png", "6-names.png",
    ]  # fmt: skip
    for name in names:
        assert np.asarray(Image.open(folder / name).convert("L")).std() > 5.0
    again = solve(sky[0], "--stages", folder)
    assert again.exit_code == 2 and "choose another folder" in again.output
    noise = tmp_path / "noise.png"
    Image.fromarray(np.random.default_rng(3).normal(60.0, 3.0, (300, 400)).astype(np.uint8)).save(noise)
    failed = solve(noise, "--stages", tmp_path / "none")
    assert failed.exit_code == 1
    left = {path.name for path in (tmp_path / "none").iterdir()}
    assert {"1-background.png", "2-objects.png"} <= left and "6-names.png" not in left


def test_mirrored_as_a_user_asks(sky, tmp_path):
    path = tmp_path / "mirror.png"
    Image.fromarray(np.ascontiguousarray(np.asarray(Image.open(sky[0]))[:, ::-1])).save(path)
    done = solve(path, "--epoch", night_sky.YEAR, "--mirrored", "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["mirrored"] and abs(result["ra_deg"] - sky[1].ra_deg) < 0.02
    refused = solve(path, "--mirrored", "--camera", "night_sky")
    assert refused.exit_code == 2 and "not together" in refused.output


def test_an_unreadable_picture_is_told_in_its_row_and_the_others_are_solved(sky, tmp_path):
    path, shot = sky
    text, gone = tmp_path / "text.jpg", tmp_path / "gone.png"
    text.write_text("no picture")
    done = solve(text, path, gone, "--json", "--epoch", night_sky.YEAR)
    assert done.exit_code == 2
    first, second, third = map(json.loads, done.stdout.splitlines())
    assert (first["file"], first["status"]) == (str(text), "refused")
    assert first["reason"].startswith("is not a picture that can be read; expected PNG")
    assert second["file"] == str(path) and abs(second["ra_deg"] - shot.ra_deg) < 0.02
    assert third["reason"] == "there is no such file"
    done = solve(path, text)
    assert done.exit_code == 2
    lines = done.stdout.splitlines()
    assert any("orion.png" in line and f"{second['ra_deg']:.2f}" in line for line in lines)
    assert any("text.jpg" in line and "is not a picture" in line for line in lines)
    alone = solve(text)
    assert alone.exit_code == 2 and alone.stdout == "" and f"{text}: is not a picture" in alone.stderr


def test_the_table_of_several_says_what_is_left_in(sky, tmp_path):
    path, _ = sky
    dated = tmp_path / "dated.jpg"
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9003] = "2012:06:22 20:00:00"
    Image.open(path).save(dated, exif=exif, quality=95)
    said = " ".join(solve(path, path).stdout.split())
    assert "aberration, up to 20.5 arcsec, is left in: the day is not known" in said
    said = " ".join(solve(path, dated).stdout.split())
    assert "is left in (of orion.png): the day is not known" in said
    assert "is left in" not in solve(path, dated, "--epoch", "2012-06-22").stdout


def test_a_field_of_view_that_is_wrong_is_thought_of(sky):
    wrong = " ".join(solve(sky[0], "--fov", "40").stdout.split())
    assert "within 20 % of 40 deg" in wrong and "leave --fov out" in wrong


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_white_picture_is_saturated_and_a_black_one_is_not(tmp_path, dtype):
    white, black = tmp_path / "white.png", tmp_path / "black.png"
    Image.fromarray(np.full((300, 400), np.iinfo(dtype).max, dtype)).save(white)
    Image.fromarray(np.zeros((300, 400), dtype)).save(black)
    done = solve(white)
    assert done.exit_code == 1 and "saturated: half of the picture or more" in done.stdout
    assert json.loads(solve(black, "--json").stdout)["reason"] == "too_few_stars"


def test_a_hot_pixel_does_not_hide_a_star_in_the_drawing_of_its_fit():
    rng, cut = np.random.default_rng(4), np.full((21, 21), 20.0)
    night_sky.star(cut, 10.0, 10.0, 300.0, 0.8)
    plain = contrast(cut + rng.normal(0.0, 2.0, cut.shape), (10.0, 10.0), 1)
    cut[8, 12] = 4000.0
    black, white = contrast(cut + rng.normal(0.0, 2.0, cut.shape), (10.0, 10.0), 1)
    assert 5.0 < black < 20.0 < white < cut[10, 10] and white > 0.8 * plain[1]
    assert contrast(np.zeros((5, 5)), (0.0, 4.0), 1)[0] < contrast(np.zeros((5, 5)), (0.0, 4.0), 1)[1]


def test_the_drawing_says_what_its_rings_are(sky):
    assert describe(failed("no_match", 1.0, np.zeros((7, 2)))) == "not solved: no match   7 objects (orange)"
    found = solve_image(sky[0], epoch=night_sky.YEAR)
    others = len(found.xy_px) - len(found.matched)
    assert f"{len(found.matched)} stars (green)   {others} not named (orange)" in describe(found)
