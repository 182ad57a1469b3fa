"""`solve --camera`: attitudes of exported pictures with a covariance that is right, or why there is none."""

import csv
import json
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
from exported_frames import error_c
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from scipy.stats import chi2
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.environment.stars import load_catalogue, silicon_magnitude
from shefex_nav.frames import camera_file, export
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.solve import picture, told
from shefex_nav.solve.header import Taken, julian_year
from shefex_nav.solve.image import solve_image
from shefex_nav.solve.picture import PictureError

SHARE = 0.99
YEAR = julian_year(datetime(2010, 10, 8, 20, 30, 2))  # of the pictures at rest


def command(*arguments):
    return CliRunner().invoke(app, ["solve", *map(str, arguments)])


def cameras(found):
    """StarCamera as it is in the run, and as calibrated."""
    return camera_file.read(found.folder / export.TRUE), camera_file.read(found.folder / export.TOLD)


def files(found):
    with (found.folder / export.TRUTH).open(encoding="utf-8") as file:
        return [found.folder / row["file"] for row in csv.DictReader(file)]


def with_focal_length(camera, factor):
    model = camera.params.camera
    hole = model.pinhole._replace(focal_length_px=factor * model.pinhole.focal_length_px)
    return replace(camera, params=camera.params._replace(camera=model._replace(pinhole=hole)))


def taken_of(shot):
    """As the file says it."""
    return Taken(YEAR, shot.frame.exposure_s, shot.v_i)


@pytest.fixture(scope="module")
def solutions(still, turning):
    """(ImageSolution, Shot) of all pictures, with the camera of their run."""
    out = {}
    for name, found in (("still", still), ("turning", turning)):
        camera = cameras(found)[0]
        solved = [solve_image(path, camera=camera) for path in files(found)]
        out[name] = [pair for pair in zip(solved, found.shots, strict=True) if pair[0].status == "ok"]
    return out


@pytest.mark.parametrize("name, least", [("still", 25), ("turning", 30)])
def test_covariance_describes_the_errors(solutions, name, least):
    """NEES of three degrees of freedom, against the mean attitude of the exposure; spots and streaks."""
    found = solutions[name]
    assert len(found) >= least
    errors = np.array([error_c(solution.q_ci, shot.q_mean) for solution, shot in found])
    P = np.array([solution.covariance for solution, _ in found])
    nees = np.einsum("ki,kij,kj->k", errors, np.linalg.inv(P), errors)
    low, high = chi2.ppf([0.5 - SHARE / 2, 0.5 + SHARE / 2], 3 * len(found)) / len(found)
    assert low < nees.mean() < high
    assert np.abs(errors / np.sqrt(np.einsum("kii->ki", P))).max() < 5.0
    assert np.degrees(np.sqrt(P[:, 0, 0].max())) * 3600.0 < 30.0


def test_it_is_what_flies(solutions):
    """The same stars as on board; the attitude within the error of the calibration."""
    for solution, shot in solutions["still"]:
        assert {match.hip for match in solution.matched} == {int(hip) for hip in shot.fix.hip if hip}
        assert np.linalg.norm(error_c(solution.q_ci, shot.fix.q_ic)) < np.radians(0.03)


def test_calibration_is_in_the_covariance(still):
    """As calibrated, a run is off by its principal point: its picture alone could not say so."""
    true, calibrated = cameras(still)
    image, shot = still.shots[5].frame.image_dn, still.shots[5]
    with_true = solve_image(image, camera=true, taken=taken_of(shot))
    found = solve_image(image, camera=calibrated, taken=taken_of(shot))
    assert np.array_equal(with_true.covariance, with_true.noise_covariance)
    f = calibrated.params.camera.pinhole.focal_length_px
    assert np.array_equal(found.camera_covariance, found.covariance)
    constant = found.covariance - found.noise_covariance
    np.testing.assert_allclose(np.sqrt(np.diag(constant))[:2], 0.3 / f, rtol=0.05)
    hole, true_hole = calibrated.params.camera.pinhole, true.params.camera.pinhole
    moved = (true_hole.cx_px - hole.cx_px) / f, (true_hole.cy_px - hole.cy_px) / f
    error = error_c(found.q_ci, shot.q_mean)
    np.testing.assert_allclose(error[:2], [-moved[1], moved[0]], atol=2e-5)
    assert error @ np.linalg.solve(found.covariance, error) < 25.0
    assert error @ np.linalg.solve(found.noise_covariance, error) > 25.0


@pytest.mark.parametrize("number", [2, 3, 6])
def test_pixels_are_taken_as_they_are_stored(still, tmp_path, number):
    """Whatever EXIF says of how a viewer is to turn them: the lens is that of the detector."""
    exif = Image.Exif()
    exif[picture.EXIF_ORIENTATION] = number
    kept = Image.open(files(still)[3])
    texts = PngInfo()
    for key, text in kept.text.items():
        texts.add_text(key, text)
    kept.save(tmp_path / "turned.png", exif=exif, pnginfo=texts)
    camera = cameras(still)[0]
    plain, found = (
        solve_image(files(still)[3], camera=camera),
        solve_image(tmp_path / "turned.png", camera=camera),
    )
    assert (found.status, found.orientation, found.as_stored) == ("ok", number, True)
    np.testing.assert_array_equal(found.q_ci, plain.q_ci)
    np.testing.assert_array_equal(found.xy_px, plain.xy_px)
    told_of = command(tmp_path / "turned.png", "--camera", still.folder / export.TRUE, "--overlay",
                      tmp_path / "named.png")  # fmt: skip
    assert told_of.exit_code == 0 and "not applied, pixels as stored" in told_of.stdout
    command(files(still)[3], "--camera", still.folder / export.TRUE, "--overlay", tmp_path / "plain.png")
    drawn = [np.asarray(Image.open(tmp_path / name)) for name in ("named.png", "plain.png")]
    np.testing.assert_array_equal(*drawn)


def test_velocity_is_used_and_truth_is_not(still, tmp_path):
    camera, shot = cameras(still)[0], still.shots[3]
    with_it = solve_image(files(still)[3], camera=camera)
    Image.fromarray(shot.frame.image_dn).save(tmp_path / "bare.png")  # no text in it
    bare = solve_image(tmp_path / "bare.png", camera=camera)
    assert np.linalg.norm(error_c(bare.q_ci, shot.q_mean)) < np.radians(5.0 / 3600.0) * 4
    fast = Taken(YEAR, shot.frame.exposure_s, shot.v_i + np.array([0.0, 0.0, 30e3]))
    moved = solve_image(shot.frame.image_dn, camera=camera, taken=fast)
    assert np.linalg.norm(error_c(moved.q_ci, shot.q_mean)) > np.radians(5.0 / 3600.0)
    again = solve_image(shot.frame.image_dn, camera=camera, taken=taken_of(shot))
    assert np.linalg.norm(error_c(again.q_ci, with_it.q_ci * [1, -1, -1, -1])) < 1e-8


@pytest.mark.parametrize("factor", [0.9, 0.95, 0.99, 0.998, 1.001, 1.01, 1.05, 1.1])
def test_wrong_focal_length_gives_no_attitude(still, factor):
    camera = with_focal_length(cameras(still)[1], factor)
    for shot in still.shots[::4]:
        found = solve_image(shot.frame.image_dn, camera=camera, taken=taken_of(shot))
        assert found.status == "failed" and found.reason in ("no_match", "residuals", "focal_length")
        assert found.covariance is None and np.isnan(found.q_ci).all()


def test_mirrored_pictures_give_no_attitude(still):
    camera = cameras(still)[1]
    for shot in still.shots[::4]:
        for turned in (shot.frame.image_dn[:, ::-1], shot.frame.image_dn[::-1]):
            found = solve_image(np.ascontiguousarray(turned), camera=camera, taken=taken_of(shot))
            assert (found.status, found.reason) == ("failed", "mirrored")


def test_streaks_give_no_attitude(turning):
    """Faster than star_tracker.highest_rate is told, the picture itself says that it is smeared."""
    camera = cameras(turning)[0]
    settings = replace(camera.params.settings, highest_rate=np.radians(2.0))
    slow = replace(camera, params=camera.params._replace(settings=settings))
    fast = [shot for shot in turning.shots if np.linalg.norm(shot.omega_c) > np.radians(4.0)]
    assert len(fast) > 3
    for shot in fast:
        found = solve_image(shot.frame.image_dn, camera=slow, taken=taken_of(shot))
        assert found.status == "failed" and found.reason in (
            "smeared",
            "too_few_stars",
            "no_match",
            "saturated",
        )
    reasons = [solve_image(shot.frame.image_dn, camera=slow, taken=taken_of(shot)).reason for shot in fast]
    assert "smeared" in reasons
    rolling = replace(camera, line_s=20e-6)
    assert solve_image(fast[0].frame.image_dn, camera=rolling, taken=taken_of(fast[0])).reason == "rolling"


@pytest.mark.parametrize(
    "change, says",
    [
        (lambda a: a[:-1], "has 659 x 492 pixels, the camera 659 x 493"),
        (lambda a: a.T, "has 493 x 659 pixels"),
        (lambda a: a.astype(np.float32), "expected whole grey values"),
        (lambda a: (a // 16).astype(np.uint8), "has 8 bits a pixel, the camera's grey values 12"),
        (lambda a: a * 16, "those of the camera have 12 bits, 0 to 4095"),
        (lambda a: np.stack([a] * 3, axis=2), "has shape"),
        (lambda a: a.astype(np.int32) - 100, "grey values from"),
    ],
)
def test_pictures_that_the_camera_does_not_make(still, change, says):
    with pytest.raises(PictureError, match=says):
        solve_image(change(still.shots[0].frame.image_dn), camera=cameras(still)[0])


def test_raw_files(still, tmp_path):
    camera, shot = cameras(still)[0], still.shots[3]
    path = tmp_path / "frame.raw"
    path.write_bytes(shot.frame.image_dn.astype("<u2").tobytes())
    found = solve_image(path, camera=camera)
    assert found.status == "ok" and np.linalg.norm(error_c(found.q_ci, shot.q_mean)) < np.radians(0.02)
    path.write_bytes(shot.frame.image_dn.astype("<u2").tobytes()[:-2])
    with pytest.raises(PictureError, match=r"frame.raw: has 649772 bytes; 659 x 493 pixels of 2 bytes"):
        solve_image(path, camera=camera)
    path.write_bytes(shot.frame.image_dn.astype("<u2").tobytes())
    done = command(path, "--camera", still.folder / export.TRUE, "--overlay", tmp_path / "drawn.png")
    assert done.exit_code == 0 and (tmp_path / "drawn.png").exists(), done.output


def test_command(still, tmp_path):
    camera, pictures = still.folder / export.TOLD, files(still)[:3]
    done = command(*pictures, "--camera", camera, "--json")
    assert done.exit_code == 0, done.output
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["file"] for line in lines] == [str(path) for path in pictures]
    for line, shot in zip(lines, still.shots, strict=False):
        assert line["status"] == "ok" and np.array(line["covariance_rad2"]).shape == (3, 3)
        sigma = np.radians(np.array(list(line["sigma_arcsec"].values())) / 3600.0)
        np.testing.assert_allclose(sigma**2, np.diag(line["covariance_rad2"]))
        assert np.linalg.norm(error_c(np.array(line["q_ic"]) * [1, -1, -1, -1], shot.q_mean)) < 1e-3
    done = command(pictures[0], "--camera", camera)
    assert done.exit_code == 0 and "1 sigma about x, y, boresight" in done.stdout
    words = " ".join(done.stdout.replace("│", " ").split())
    assert "nobody has told" not in words and "q_ic and covariances are of the axis of the lens" in words
    assert "the date in the camera file" not in words  # these pictures have theirs
    done = command(*pictures, "--camera", camera)
    assert done.exit_code == 0 and done.stdout.count("frame_0000") >= 3
    assert "RA, Dec and roll are of the middle of the picture" in done.stdout


def test_magnitudes_are_of_the_band_of_the_catalogue(still, tmp_path):
    """V is not said of them: of a catalogue in silicon red stars are brighter than V."""
    text = (still.folder / export.TRUE).read_text(encoding="utf-8")
    red = tmp_path / "red.yaml"
    assert "system: V" in text
    red.write_text(text.replace("system: V", "system: silicon"), encoding="utf-8")
    lines = {}
    for camera in (still.folder / export.TRUE, red):
        done = command(files(still)[0], "--camera", camera)
        assert done.exit_code == 0 and "│  mag │" in done.stdout.replace("┃", "│")
        line = json.loads(command(files(still)[0], "--camera", camera, "--json").stdout)
        lines[camera] = {star["hip"]: star["vmag"] for star in line["matched"]}
    in_v, in_silicon = lines.values()
    sky = load_catalogue(8.0)
    row = {hip: n for n, hip in enumerate(sky.hip.tolist())}
    both = [hip for hip in in_v if hip in in_silicon]
    rows = [row[hip] for hip in both]
    difference = silicon_magnitude(sky.vmag[rows], sky.bv[rows]) - sky.vmag[rows]
    found = np.array([in_silicon[hip] - in_v[hip] for hip in both])
    assert len(both) >= 5 and np.median(np.abs(found - difference)) < 0.01  # some have neighbours


def test_which_axis_is_meant(still):
    """The axis of the lens is that of the attitude, and off the middle by the principal point."""
    camera, picture = still.folder / export.TRUE, files(still)[0]
    line = json.loads(command(picture, "--camera", camera, "--json").stdout)
    axis_i, middle_i = (direction(line[f"{of}ra_deg"], line[f"{of}dec_deg"]) for of in ("axis_", ""))
    q = np.array(line["q_ic"])
    np.testing.assert_allclose(axis_i, dcm_from_quat(q)[:, 2], atol=1e-12)
    hole = cameras(still)[0].params.camera.pinhole
    off_px = np.hypot(hole.cx_px - 0.5 * (hole.width_px - 1), hole.cy_px - 0.5 * (hole.height_px - 1))
    assert off_px > 0.05
    assert np.linalg.norm(axis_i - middle_i) == pytest.approx(off_px / hole.focal_length_px, rel=1e-3)


def direction(ra_deg, dec_deg):
    """Unit vector in the ICRS."""
    ra, dec = np.radians([ra_deg, dec_deg])
    return np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])


def test_the_date_of_the_camera_file_is_said(still, tmp_path):
    bare, dated = tmp_path / "bare.png", files(still)[0]
    Image.fromarray(still.shots[0].frame.image_dn).save(bare)  # without texts
    camera = still.folder / export.TOLD
    done = command(bare, "--camera", camera)
    words = " ".join(done.stdout.replace("│", " ").split())
    assert "removed, as of 2010-10-08, the date in the camera file" in words
    assert json.loads(command(bare, "--camera", camera, "--json").stdout)["date_from"] == "camera"
    assert json.loads(command(dated, "--camera", camera, "--json").stdout)["date_from"] == "picture"
    said = " ".join(command(bare, dated, "--camera", camera).stdout.split())
    assert "the date in the camera file: the picture says none (of bare.png)" in said
    given = command(bare, "--camera", camera, "--epoch", "2010-10-08", "--json")
    assert json.loads(given.stdout)["date_from"] == "epoch"


def test_command_tells_why_one_is_not_solved(still, tmp_path):
    turned = Image.open(files(still)[0]).transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    turned.save(tmp_path / "mirror.png")
    done = command(files(still)[1], tmp_path / "mirror.png", "--camera", still.folder / export.TOLD)
    words = " ".join(done.stdout.split())
    assert done.exit_code == 1 and "mirrored: the stars fit only when the picture is mirrored" in words


@pytest.mark.parametrize(
    "options, says",
    [
        (["--camera", "nowhere.yaml"], "nowhere.yaml"),
        (["--camera", "{camera}", "--fov", "12 deg"], "--fov: not together with --camera"),
        (["--camera", "shefex2_andoya"], "those of the camera have 8 bits"),
        (["{picture}", "--overlay", "a.png", "--camera", "{camera}"], "--overlay: is of one picture"),
    ],
)
def test_command_refuses(still, options, says):
    names = {"camera": still.folder / export.TOLD, "picture": files(still)[1]}
    done = command(files(still)[0], *(text.format(**names) for text in options))
    words = " ".join(done.stderr.replace("│", " ").split())
    assert done.exit_code == 2 and says in words and "Traceback" not in words and done.stdout == ""


def test_headers_that_cannot_be_read(still, tmp_path):
    from PIL.PngImagePlugin import PngInfo

    for key, value, says in (
        ("DATE-OBS", "last night", "DATE-OBS: expected UTC in ISO 8601"),
        ("EXPTIME", "-1", "EXPTIME: expected a positive number of seconds"),
        ("EXPTIME", "1e30", "EXPTIME: expected a positive number of seconds, at most 86400"),
        ("VELX", "12", "VELY: is missing"),
        ("EXPTIME", "long", "EXPTIME: expected a number"),
    ):
        texts = PngInfo()
        texts.add_text(key, value)
        Image.fromarray(still.shots[0].frame.image_dn).save(tmp_path / "odd.png", pnginfo=texts)
        with pytest.raises(PictureError, match=f"odd.png: {says}"):
            solve_image(tmp_path / "odd.png", camera=cameras(still)[0])


def test_another_solver_agrees(still):
    """tetra3rs: its own detection, catalogue and attitude, on the exported pixels with the exported truth."""
    tetra3rs = pytest.importorskip("tetra3rs", reason="tetra3rs is not installed: no independent solver")
    camera = cameras(still)[0]
    hole = camera.params.camera.pinhole
    database = tetra3rs.SolverDatabase.generate_from_gaia(
        min_fov_deg=13.0, max_fov_deg=17.0, epoch_proper_motion_year=YEAR
    )
    offset = [hole.cx_px - 0.5 * (hole.width_px - 1), hole.cy_px - 0.5 * (hole.height_px - 1)]
    model = tetra3rs.CameraModel(hole.focal_length_px, hole.width_px, hole.height_px, crpix=offset)
    earth_i, solved = told.earth_velocity(round(YEAR * told.MINUTES)), 0
    for shot in still.shots:
        spots = tetra3rs.extract_centroids(shot.frame.image_dn, saturation_level=4000).centroids
        velocity = ((earth_i + shot.v_i) / 1e3).tolist()
        found = database.solve_from_centroids(
            spots, camera_model=model, match_threshold=1e-3, observer_velocity_km_s=velocity
        )
        if not found or shot.fix.reason != 0:
            continue
        theta, xi, eta = found.attitude_sigma_rad
        error, ours = error_c(np.asarray(found.quaternion), shot.q_mean), np.sqrt(np.diag(shot.fix.P_c))
        assert np.hypot(*error[:2]) < 5.0 * np.hypot(np.hypot(xi, eta), np.hypot(*ours[:2]))
        assert abs(error[2]) < 5.0 * np.hypot(theta, ours[2])
        solved += 1
    assert solved > 20


def test_a_picture_of_an_unknown_day_is_refused(still, tmp_path):
    camera = replace(cameras(still)[0], julian_year=None)
    bare = tmp_path / "bare.png"
    Image.fromarray(still.shots[0].frame.image_dn).save(bare)  # without texts
    with pytest.raises(PictureError, match=r"bare\.png: does not say when it was taken"):
        solve_image(bare, camera=camera)
    solution = solve_image(bare, camera=camera, epoch=YEAR)
    assert solution.status == "ok"
