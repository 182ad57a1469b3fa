"""Pictures that a camera stored turned: they are solved as a viewer shows them."""

import json

import night_sky
import numpy as np
import picture_files
import pytest
from PIL import Image, ImageOps
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.solve import header, picture
from shefex_nav.solve.image import solve_image

ALL = range(1, 9)
INVERSE = {6: 8, 8: 6}


def tagged(number):
    """EXIF with an orientation."""
    exif = Image.Exif()
    exif[picture.EXIF_ORIENTATION] = number
    return exif


def as_pillow_shows(values, number):
    """A stored picture as it is displayed, by Pillow."""
    image = Image.fromarray(values)
    image.getexif()[picture.EXIF_ORIENTATION] = number
    return np.asarray(ImageOps.exif_transpose(image))


@pytest.fixture
def colours():
    return np.random.default_rng(4).integers(0, 255, (70, 111, 3), dtype=np.uint8)


@pytest.mark.parametrize("number", ALL)
def test_is_what_viewers_show(colours, number):
    shown = header.displayed(colours, number)
    np.testing.assert_array_equal(shown, as_pillow_shows(colours, number))
    np.testing.assert_array_equal(header.as_stored(shown, number), colours)


@pytest.mark.parametrize("number", [0, 9, 300])
def test_numbers_that_mean_nothing(colours, tmp_path, number):
    Image.fromarray(colours).save(tmp_path / "a.png", exif=tagged(number))
    found = picture.stored(tmp_path / "a.png")
    assert found.orientation == 1
    np.testing.assert_array_equal(found.values, colours)


@pytest.mark.parametrize("number", ALL)
@pytest.mark.parametrize(
    "name, options", [("a.png", {}), ("a.tif", {}), ("packed.tif", {"compression": "tiff_lzw"}),
                      ("a.webp", {"lossless": True})],
)  # fmt: skip
def test_files_of_all_kinds(colours, tmp_path, number, name, options):
    """Pillow turns a TIFF by itself, others it does not."""
    path = tmp_path / name
    Image.fromarray(colours).save(path, exif=tagged(number), **options)
    found = picture.stored(path)
    assert found.orientation == number
    np.testing.assert_array_equal(found.values, colours)
    shown = as_pillow_shows(colours, number).mean(axis=2, dtype=np.float32)
    np.testing.assert_array_equal(picture.read(path).grey, shown)


@pytest.mark.parametrize("number", [3, 6])
def test_deep_tiff(tmp_path, number):
    """16 bits a channel in colour are not read by Pillow."""
    deep = np.random.default_rng(5).integers(0, 65535, (70, 111, 3)).astype(np.uint16)
    (tmp_path / "a.tif").write_bytes(picture_files.tiff(deep, orientation=number))
    found = picture.stored(tmp_path / "a.tif")
    assert found.orientation == number
    np.testing.assert_array_equal(found.values, deep)


@pytest.fixture(scope="module")
def shot():
    return night_sky.shoot(np.random.default_rng(1), fov_deg=14.0, limit=6.5, ra_deg=84.0, dec_deg=5.0)


@pytest.fixture(scope="module")
def files(shot, tmp_path_factory):
    """Eight files that show the same picture, each stored in its own way, by number."""
    folder, shown = tmp_path_factory.mktemp("turned"), night_sky.to_8_bit(shot.image)
    paths = {}
    for number in ALL:
        paths[number] = folder / f"{number}.png"
        kept = as_pillow_shows(shown, INVERSE.get(number, number))
        Image.fromarray(kept).save(paths[number], exif=tagged(number))
    return paths


def test_eight_files_of_one_picture(files, shot):
    """The same solution, that of the picture as it is shown; none is taken for a mirrored one."""
    first = solve_image(files[1], epoch=night_sky.YEAR)
    right, down, forward = night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg)
    assert np.abs(dcm_from_quat(first.q_ci) - [right, down, forward]).max() < 1e-3
    for number in ALL:
        found = solve_image(files[number], epoch=night_sky.YEAR)
        assert (found.status, found.orientation, found.as_stored) == ("ok", number, False)
        np.testing.assert_array_equal(found.q_ci, first.q_ci)
        np.testing.assert_array_equal(found.xy_px, first.xy_px)
        assert found.matched == first.matched and found.camera == first.camera


def test_turned_file_of_a_mirrored_picture(shot, tmp_path):
    """--mirrored is about the picture as it is shown."""
    mirrored = night_sky.to_8_bit(shot.image)[:, ::-1]
    path = tmp_path / "a.png"
    Image.fromarray(as_pillow_shows(np.ascontiguousarray(mirrored), 8)).save(path, exif=tagged(6))
    assert solve_image(path, epoch=night_sky.YEAR).reason == "mirrored"
    found = solve_image(path, epoch=night_sky.YEAR, mirrored=True)
    assert (found.status, found.mirrored, found.orientation) == ("ok", True, 6)


def test_command_says_it(files, shot, tmp_path):
    """Table, JSON and overlay are those of the picture as it is shown."""
    drawn = {}
    for number in (1, 6):
        to = tmp_path / f"{number}.png"
        done = CliRunner().invoke(
            app, ["solve", str(files[number]), "--epoch", str(night_sky.YEAR), "--overlay", str(to)]
        )
        assert done.exit_code == 0, done.output
        assert ("EXIF orientation 6" in done.stdout) == (number == 6)
        drawn[number] = np.asarray(Image.open(to))
    np.testing.assert_array_equal(drawn[6], drawn[1])
    done = CliRunner().invoke(app, ["solve", str(files[6]), "--epoch", str(night_sky.YEAR), "--json"])
    result = json.loads(done.stdout)
    assert result["exif_orientation"] == 6 and result["pixels"] == "as displayed"


@pytest.mark.parametrize("number", [4, 5, 8])
def test_jpeg(colours, tmp_path, number):
    Image.fromarray(colours).save(tmp_path / "a.jpg", exif=tagged(number))
    with Image.open(tmp_path / "a.jpg") as image:
        shown = np.asarray(ImageOps.exif_transpose(image)).mean(axis=2, dtype=np.float32)
    np.testing.assert_array_equal(picture.read(tmp_path / "a.jpg").grey, shown)
