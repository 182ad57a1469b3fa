"""The camera in a file: what an export writes is what flies; mistakes are told with their place."""

import importlib
from pathlib import Path

import numpy as np
import pytest
import yaml
from exported_frames import DEEP, SEED, error_c, exported
from scipy.stats import chi2

from shefex_nav import prepare, solve_image
from shefex_nav.environment.ephemeris import julian_year
from shefex_nav.frames import camera_file, export
from shefex_nav.records import CameraCommand
from shefex_nav.scenario import load
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.solve.calibration import calibrate, pictures
from shefex_nav.solve.header import Taken
from shefex_nav.world.camera import expose


def test_exported_camera_is_the_one_on_board(still):
    told, world = camera_file.read(still.folder / export.TOLD), still.flight.world
    flies = world.computer.tracker
    assert told.params.settings == flies.settings
    assert told.params.camera.pinhole == flies.camera.pinhole
    assert np.array_equal(told.params.camera.bad_pixels, world.camera.bad_pixel_map)
    for name in ("electrons_per_dn", "psf_sigma", "zero_flux", "focal_length_error"):
        assert getattr(told.params.camera, name) == getattr(flies.camera, name)
    assert (told.bits, told.principal_point_error, told.line_s) == (12, 0.3, 0.0)


def test_true_camera_is_that_of_the_run(still):
    found, true = camera_file.read(still.folder / export.TRUE), still.flight.world.camera.pinhole
    np.testing.assert_allclose(found.params.camera.pinhole, true, rtol=1e-14)
    assert found.principal_point_error == 0.0 and found.params.camera.focal_length_error == 0.0
    told = camera_file.read(still.folder / export.TOLD).params.camera.pinhole
    assert abs(told.cx_px - true.cx_px) > 1e-3 and told.focal_length_px != true.focal_length_px


def test_scenario_stands_for_a_camera():
    found = camera_file.read("shefex2_andoya")
    scenario = load.load("shefex2_andoya")
    assert found.params.camera.pinhole.focal_length_px == pytest.approx(24.95e-3 / 9.9e-6)
    assert found.bits == scenario.star_camera.detector.bits and len(found.params.camera.bad_pixels) == 0


def test_scenario_along_a_trajectory_stands_for_a_camera():
    """It has no vehicle and no programme."""
    found = camera_file.read("given_trajectory")
    assert found.params.camera.pinhole == camera_file.read("shefex2_andoya").params.camera.pinhole
    assert found.julian_year == pytest.approx(2012.47, abs=0.01)


def test_what_is_told_on_board_is_in_the_file(tmp_path):
    """navigation.told: the file has the focal length that the software believes, not the true one."""
    scenario = load.load("night_sky", ("navigation.told.star_camera.optics.focal_length=24.7 mm",))
    assert camera_file.of_scenario(scenario).params.camera.pinhole.focal_length_px == pytest.approx(
        24.7e-3 / scenario.star_camera.detector.pixel_size
    )


@pytest.mark.parametrize(
    "old, new, says",
    [
        ("focal_length: 24", "focal_length: minus 24", "star_camera.optics.focal_length"),
        ("bits: 12", "bits: 7", "star_camera.detector.bits"),
        ("bad_pixels:", "bad_pixels:\n- [493, 0]", "is not on a detector of 493 rows and 659 columns"),
        ("bad_pixels:", "bad_pixels:\n- [-1, 0]", "bad_pixels"),
        ("saturation: 4000 DN", "saturation: 5000 DN", "4095 DN, the largest grey value of 12 bits"),
        ("star_tracker:", "star_trackers:", "star_tracker"),
        ("shutter: global", "shutter: rolling", "line_time"),
        ("description:", "epoch: yesterday\ndescription:", "epoch"),
    ],
)
def test_mistakes_have_their_place(still, tmp_path, old, new, says):
    text = (still.folder / export.TOLD).read_text()
    assert old in text
    path = tmp_path / "camera.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ScenarioError) as told:
        camera_file.read(path)
    assert says in str(told.value) and all(line.startswith(f"{path}:") for line in told.value.messages)


def test_of_another_kind(still):
    with pytest.raises(ScenarioError, match="is a replay scenario"):
        camera_file.read("csv_example")
    with pytest.raises(ScenarioError, match="is the camera of pictures; `shefex-nav solve IMAGE --camera"):
        load.load(still.folder / export.TOLD)


BENT = ("star_camera.optics.distortion=[-0.376, 0, 0, 0, 0]",)
TOLD = "navigation.told.star_camera.optics.distortion=[-0.35, 0, 0.001, 0, 0]"


def test_a_lens_with_distortion_goes_through_the_files(tmp_path):
    """As told, and as it is; both read again, and solve the pictures with attitudes of the right size."""
    made = exported(tmp_path / "bent", "night_sky", (*DEEP, *BENT, TOLD), SEED, 1.5)
    told = camera_file.read(made.folder / export.TOLD).params.camera
    true = camera_file.read(made.folder / export.TRUE).params.camera
    np.testing.assert_array_equal(told.distortion, [-0.35, 0, 0.001, 0, 0])
    np.testing.assert_array_equal(true.distortion, [-0.376, 0, 0, 0, 0])
    np.testing.assert_allclose(true.pinhole, made.flight.world.camera.pinhole, rtol=1e-14)
    shot = made.shots[0]
    taken = Taken(None, shot.frame.exposure_s, shot.v_i)
    found = solve_image(shot.frame.image_dn, camera=camera_file.read(made.folder / export.TRUE), taken=taken)
    assert found.status == "ok"
    assert np.linalg.norm(error_c(found.q_ci, shot.truth.q_ic)[:2]) < 4e-5  # 8 arcsec
    off = [np.hypot(*(shot.truth.xy_px - [one.x_px, one.y_px]).T).min() for one in found.matched]
    assert np.median(off) < 0.3  # named where they are on the detector


@pytest.mark.slow
def test_calibrate_finds_the_lens_of_the_simulated_camera(monkeypatch):
    """Ten rendered pictures in different directions: seven numbers, each by its sigma and all."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    bench = importlib.import_module("lens_distortion")
    squares, scenario = [], load.load("night_sky", [*BENT, *DEEP])
    told = pictures.Told(15.0, julian_year(scenario.mission.epoch))
    for seed in (1, 2):
        world = prepare.build_world(scenario, seed, brief=True)
        seen = []
        for k in range(10):
            q_ic = bench.dark_attitude(seed, k, world.camera.bodies.sun_u_i)
            command = CameraCommand(bench.T_S, 0.05, 0.0)
            at, rng = bench.at_rest(world.camera, q_ic), np.random.default_rng([seed, k])
            frame, _ = expose(world.camera, command, at, k, bench.T_S, rng)
            seen.append(pictures.look(f"{k}.png", frame.image_dn, Taken(told.julian_year, 0.05), told))
        found, hole = calibrate.of_seen(seen, calibrate.Known(60.0, 7.5)).lens, world.camera.pinhole
        true = np.array([hole.focal_length_px, hole.cx_px, hole.cy_px, -0.376, 0.0, 0.0, 0.0])
        d, P = (found.values[:7] - true), found.covariance[:7, :7]
        assert found.sigma[3] < 0.2 * 0.376
        assert (abs(d) < 4.0 * found.sigma[:7]).all()
        squares.append(d @ np.linalg.solve(P, d))
    assert sum(squares) < chi2.ppf(0.9995, 14)


SHORT = """
star_camera:
  optics:
    focal_length: {focal} mm
    focal_length_error: 1 %
    principal_point_error: 5 pix
    psf_sigma: 0.8 pix
    zero_magnitude_flux: 2e6 electron/s
  detector:
    {{columns: 659, rows: 493, pixel_size: 9.9 um, bits: {bits}, black_level: 60 DN,
      conversion: 7.5 electron/DN, shutter: {shutter}}}
"""


@pytest.mark.parametrize("bits, shutter", [(8, "global"), (12, "rolling\n      , line_time: 60 us")])
def test_a_short_file_has_a_star_tracker_for_its_camera(tmp_path, bits, shutter):
    path = tmp_path / "short.yaml"
    path.write_text(SHORT.format(focal=25, bits=bits, shutter=shutter))
    found = camera_file.base(path)
    settings, largest = found.camera.params.settings, 2**bits - 1
    assert settings.detection.saturation == largest
    assert settings.exposure.brightest_mean == pytest.approx(0.4 * largest)
    assert settings.detection.scan == ("sequential" if bits == 8 else "streaks")
    assert settings.catalogue.merge_radius == pytest.approx(3 * 9.9e-6 / 25e-3)
    assert found.camera.params.camera.electrons_per_dn == 7.5  # no amplifier
    assert "star_tracker" not in found.tree
    path.write_text(SHORT.format(focal=100, bits=bits, shutter=shutter))
    deeper = camera_file.read(path).params.settings.catalogue.faintest
    assert settings.catalogue.faintest < deeper <= 8.0


def test_a_short_file_solves_pictures(still, tmp_path):
    """That of the true camera, without its star tracker, and without what pictures do not need."""
    text = (still.folder / export.TRUE).read_text()
    tree = yaml.safe_load(text)
    del tree["star_tracker"], tree["bad_pixels"]
    for key in ("background", "read_noise", "full_well", "readout"):
        del tree["star_camera"]["detector"][key]
    path = tmp_path / "short.yaml"
    path.write_text(yaml.safe_dump(tree))
    shot, camera = still.shots[0], camera_file.read(path)
    found = solve_image(
        shot.frame.image_dn, camera=camera, taken=Taken(None, shot.frame.exposure_s, shot.v_i)
    )
    assert found.status == "ok"
    assert np.linalg.norm(error_c(found.q_ci, shot.q_mean)[:2]) < 4e-5  # 8 arcsec


def test_a_file_that_lacks_something_says_what_alone(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("star_camera: {optics: {focal_length: 15 mm}, detector: {columns: 1024, rows: 768}}")
    with pytest.raises(ScenarioError) as told:
        camera_file.read(path)
    lacks = [line.split(": ")[1] for line in told.value.messages if "is missing" in line]
    optics = ("focal_length_error", "principal_point_error", "psf_sigma", "zero_magnitude_flux")
    detector = ("pixel_size", "conversion", "black_level", "bits", "shutter")
    assert sorted(lacks) == sorted(
        [f"star_camera.optics.{key}" for key in optics] + [f"star_camera.detector.{key}" for key in detector]
    )
    assert "the shortest camera file is in docs/how-to/calibrate.md" in told.value.messages[-1]
    path.write_text(SHORT.format(focal=25, bits=12, shutter="global, line_time: 60 us"))
    with pytest.raises(ScenarioError, match="a global shutter exposes all rows at once"):
        camera_file.read(path)
