"""`calibrate` with bad input: every refusal names the file, what it has and what would be right."""

from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from calibration_shots import SIZE_PX, YEAR, camera_of, shoot
from PIL import Image
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.frames import calibrated, camera_file
from shefex_nav.scenario import load
from shefex_nav.solve.calibration import calibrate, pictures
from shefex_nav.solve.header import of_header
from shefex_nav.solve.picture import PictureError

BASE = "shefex2_andoya"
DATED = "--epoch", YEAR
TOLD = pictures.Told(15.0, YEAR, (SIZE_PX, 8))


@pytest.fixture(scope="module")
def shots():
    """Two pictures of one camera."""
    rng = np.random.default_rng(78)
    camera = camera_of(rng)
    return [shoot(rng, camera, background=20.0) for _ in range(2)]


@pytest.fixture
def folder(tmp_path, shots, monkeypatch):
    """The two in files: p0.png, p1.png, p0.raw."""
    for k, image in enumerate(shots):
        Image.fromarray(image).save(tmp_path / f"p{k}.png")
    shots[0].tofile(tmp_path / "p0.raw")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def camera_text(**changed):
    """Text of the camera file of BASE. changed : optics, detector with other keys; epoch=None without it"""
    tree = camera_file.base(BASE).tree
    if "epoch" in changed:
        tree.pop("epoch")
    for part in ("optics", "detector"):
        tree["star_camera"][part] |= changed.get(part, {})
    return load.normalised(tree)


def refused(*words):
    """What is printed when bad input is refused."""
    result = CliRunner().invoke(app, ["calibrate", *map(str, words)])
    assert result.exit_code == 2, (result.output, result.exception)
    return " ".join(result.output.split())


def test_a_picture_without_a_date_is_refused_whatever_its_format(folder):
    Path("cam.yaml").write_text(camera_text(epoch=None))
    for name in ("p0.raw", "p0.png"):
        said = refused(name, "p1.png", "--camera", "cam.yaml")
        assert f"{name}: does not say when it was taken" in said
        assert "--epoch YEAR" in said


@pytest.mark.parametrize("year", ["2012", "2012.5"])
def test_a_year_that_tells_no_day_is_refused(folder, year):
    """Ten pictures towards the apex: 2012.0 in place of 2012.47 is 0.47 px of 2520, 1.8 sigma."""
    said = refused("p0.png", "p1.png", "--epoch", year)
    assert f"{year} tells no day" in said and "2012-06-22" in said
    with pytest.raises(PictureError, match=rf"p0\.png: was taken in {year}, which tells no day"):
        pictures.read(Path("p0.png"), pictures.Told(15.0, float(year)))


def test_the_camera_has_the_size_of_its_pictures(folder):
    Path("cam.yaml").write_text(camera_text(detector={"columns": 640, "rows": 480}))
    said = refused("p0.png", "p1.png", "--camera", "cam.yaml", *DATED)
    assert "p0.png: has 659 x 493 pixels, the detector of --camera 640 x 480" in said
    assert "1 of 2" not in said  # before anything is solved


def test_the_camera_has_the_depth_of_its_pictures(folder, shots):
    deep, base = shots[0].astype(np.uint16) * 16, camera_file.base(BASE)
    Image.fromarray(deep).save("deep.png")
    with pytest.raises(
        PictureError, match=r"deep\.png: has grey values from \d+ to 4080; .* 8 bits, 0 to 255"
    ):
        pictures.read(Path("deep.png"), calibrated.told(base, 15.0, YEAR))
    values, _ = pictures.read(Path("deep.png"), TOLD._replace(detector=(SIZE_PX, 12)))
    assert (values == deep).all()
    with pytest.raises(PictureError, match=r"p0\.png: has 8 bits a pixel, the grey values of --camera 12"):
        pictures.read(Path("p0.png"), TOLD._replace(detector=(SIZE_PX, 12)))
    fits.PrimaryHDU(shots[0].astype(float) - 40.0).writeto("dark.fits")  # the black level is taken off
    with pytest.raises(PictureError, match=r"dark\.fits: has grey values from -"):
        pictures.read(Path("dark.fits"), TOLD)


def test_developed_pictures_have_the_depth_that_they_have(folder, shots):
    Image.fromarray(shots[0]).save("p.jpg")
    Image.fromarray(np.stack([shots[0]] * 3, axis=2)).save("colour.png")
    fits.PrimaryHDU(shots[0] / 255.0).writeto("scaled.fits")
    for name in ("p.jpg", "colour.png", "scaled.fits"):
        values, taken = pictures.read(Path(name), TOLD._replace(detector=(SIZE_PX, 12)))
        if name != "p.jpg":
            seen = pictures.look(name, values, taken, TOLD)
            assert seen.levels == []  # they tell no noise
            assert seen.no_levels


def test_no_file_that_is_read_is_overwritten(folder):
    Path("base.yaml").write_text(camera_text())
    Path("cam.yaml").write_text("extends: base.yaml\n")
    before = Path("base.yaml").read_text()
    for name in ("cam.yaml", "base.yaml", "p0.png"):
        words = "--camera", "cam.yaml", "--output", name, "--force"
        assert f"{name} is a file that is read here" in refused("p0.png", "p1.png", *DATED, *words)
    assert Path("base.yaml").read_text() == before


def test_one_picture_counts_once(folder, shots):
    Path("link.png").symlink_to("p0.png")
    for again in (folder / "p0.png", "link.png"):
        assert f"p0.png is given twice, as p0.png and as {again}" in refused("p0.png", again, *DATED)
    assert "p0.png is given twice" in refused("p0.png", "p0.png", *DATED)
    Image.fromarray(shots[0]).save("copy.tif")
    for copy in ("copy.tif", "p0.raw"):
        said = refused("p1.png", "p0.png", copy, "--camera", BASE, *DATED)
        assert f"{copy} has the grey values of p0.png" in said


def test_pictures_of_8_bits_and_deeper_ones_are_of_two_cameras(shots):
    deep = shots[1].astype(np.uint16) * 16
    taken = of_header({"DATE-OBS": "2012-06-20"})
    told = pictures.Told(15.0)
    seen = [pictures.look(name, image, taken, told) for name, image in (("a", shots[0]), ("b", deep))]
    with pytest.raises(calibrate.CalibrationError, match=r"a has 8 bits a pixel, b grey values above 255"):
        calibrate.check_together(seen)
    whole = pictures.look("c", shots[1].astype(float), taken, told)  # a FITS file may hold 8 bits so
    calibrate.check_together([seen[0], whole])
    calibrate.check_together([whole, seen[1]._replace(digest=b"another")])


@pytest.mark.parametrize(("focal", "width"), [("1.5 mm", "131 deg"), ("400 mm", "0.934 deg")])
def test_a_camera_that_is_too_wide_or_too_narrow_is_refused(folder, focal, width):
    Path("cam.yaml").write_text(camera_text(optics={"focal_length": focal}))
    said = refused("p0.png", "--camera", "cam.yaml", *DATED)
    assert f"the field of view is {width} wide; expected 2 to 70 deg" in said


def test_a_speed_that_no_camera_has_is_refused():
    with pytest.raises(ValueError, match=r"VELX, VELY, VELZ: expected a speed below 1e\+06 m/s, got 4e\+08"):
        of_header({"VELX": 4e8, "VELY": 0.0, "VELZ": 0.0})
    np.testing.assert_allclose(of_header({"VELX": 0.0, "VELY": "7600", "VELZ": 0.0}).velocity_i[1], 7600.0)


@pytest.mark.filterwarnings("error")
def test_values_beyond_float32_are_refused_without_a_warning(folder, shots):
    fits.PrimaryHDU(shots[0] * 1e300).writeto("huge.fits")
    assert "huge.fits: contains values beyond 3.4e+38" in refused("huge.fits", *DATED)
    assert "huge.fits: has grey values" in refused("huge.fits", "--camera", BASE, *DATED)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
def test_values_that_are_no_numbers_are_refused_without_a_warning(folder, shots, value):
    values = shots[0].astype(np.float32)
    values[3, 4] = value
    Image.fromarray(values).save("odd.tif")
    assert "odd.tif: contains NaN or infinite values" in refused("odd.tif", "--camera", BASE, *DATED)


@pytest.mark.parametrize("name", ["none", "empty", "folder", "short"])
@pytest.mark.parametrize("ending", ["png", "raw"])
def test_what_is_no_picture_is_refused(folder, name, ending):
    path = Path(f"{name}.{ending}")
    if name == "folder":
        path.mkdir()
    elif name != "none":
        path.write_bytes(Path("p0.png").read_bytes()[: 4000 if name == "short" else 0])
    assert f"{path}: " in refused(path, "--camera", BASE, *DATED)
