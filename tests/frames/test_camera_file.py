"""The camera in a file: what an export writes is what flies; mistakes are told with their place."""

import numpy as np
import pytest

from shefex_nav.frames import camera_file, export
from shefex_nav.scenario import load
from shefex_nav.scenario.layers import ScenarioError


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
