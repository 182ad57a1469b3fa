"""`star_camera.optics.distortion` and `principal_point`: read, told otherwise, refused, and what is said."""

import json

import numpy as np
import pytest

from shefex_nav.frames import camera_file
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.prepare import settled
from shefex_nav.report import programme
from shefex_nav.scenario import lens, params_onboard
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.load import load
from shefex_nav.scenario.told import as_told, lines

NAME = "night_sky"
K = "[-0.376, 0, 0, 0, 0]"
TRUE, TOLD = f"star_camera.optics.distortion={K}", "navigation.told.star_camera.optics.distortion"
FOCAL_PX = 24.95e-3 / 9.9e-6
NO_PIXELS = np.zeros((0, 2), dtype=np.int64)


def on_board(scenario):
    return params_onboard.tracker_params(scenario, np.zeros(3), NO_PIXELS).camera


def refused(*overrides):
    with pytest.raises(ScenarioError) as caught:
        load(NAME, overrides)
    return str(caught.value)


def test_on_board_is_told_the_true_lens_unless_it_is_told_another():
    camera = on_board(settled(load(NAME, [TRUE, "star_camera.optics.principal_point=[330 pix, 240 pix]"])))
    np.testing.assert_array_equal(camera.distortion, [-0.376, 0, 0, 0, 0])
    assert (camera.pinhole.cx_px, camera.pinhole.cy_px) == (330.0, 240.0)
    r2 = ((329.5**2 + 246.5**2) ** 0.5 / FOCAL_PX) ** 2
    assert camera.displaced_px == pytest.approx(0.376 * r2 * 411.49, rel=0.1)  # to first order
    told = load(NAME, [TRUE, f"{TOLD}=[0, 0, 0, 0, 0]"])
    assert on_board(settled(told)).distortion is None
    assert told.star_camera.optics.distortion == (-0.376, 0, 0, 0, 0)
    (line,) = lines(told)
    assert line.endswith("distortion: [0.0, 0.0, 0.0, 0.0, 0.0], the truth is [-0.376, 0.0, 0.0, 0.0, 0.0]")
    assert on_board(settled(load(NAME))).distortion is None


def test_what_displaces_and_what_is_left():
    """Against the formula, to third order, over points of the detector; a decentring is mostly a turn."""
    true, told = load(NAME, [TRUE]), load(NAME, [TRUE, f"{TOLD}=[-0.326, 0, 0.002, 0, 0]"])
    corner = np.hypot(329.5, 246.5) / FOCAL_PX
    assert lens.displaced_px(true.star_camera) == pytest.approx(FOCAL_PX * 0.376 * corner**3, rel=0.05)
    assert lens.left(true.star_camera, true.star_camera) is None
    found = lens.left(told.star_camera, as_told(told).star_camera)
    x, y = np.meshgrid(np.linspace(-329.5, 329.5, 41) / FOCAL_PX, np.linspace(-246.5, 246.5, 41) / FOCAL_PX)
    x, y = x.ravel(), y.ravel()
    r2 = x**2 + y**2  # told minus true, of the inverse: minus the difference of the distortions
    off = -FOCAL_PX * np.column_stack(
        [0.05 * x * r2 + 0.004 * x * y, 0.05 * y * r2 + 0.002 * (r2 + 2 * y**2)]
    )
    G = FOCAL_PX * np.stack([np.stack(by, axis=-1) for by in turn_slopes(x, y)], axis=1)
    turn = np.linalg.lstsq(G.reshape(-1, 3), off.ravel(), rcond=None)[0]
    rest = np.hypot(*(off - G @ turn).T)
    np.testing.assert_allclose(found.turn, -turn, atol=0.1 * np.linalg.norm(turn))
    assert found.rest_px == pytest.approx(np.sqrt((rest**2).mean()), rel=0.12)
    assert found.largest_px == pytest.approx(np.hypot(*off.T).max(), rel=0.06)
    assert found.rest_px < found.worst_px < found.largest_px


def test_nothing_is_left_of_the_same_lens_in_other_words():
    """The middle written or left out, zeros or nothing; differences that no picture shows are not said."""
    middle = "navigation.told.star_camera.optics.principal_point=[329 pix, 246 pix]"
    for ways in (
        [TRUE, f"{TOLD}={K}", middle],
        ["star_camera.optics.distortion=[0, 0, 0, 0, 0]", middle],
        [TRUE, f"{TOLD}=[-0.376000001, 0, 0, 0, 0]"],
    ):
        scenario = load(NAME, ways)
        told = as_told(scenario).star_camera
        assert lens.words(scenario.star_camera, told) is None
    assert lens.left(load(NAME, [TRUE]).star_camera, as_told(load(NAME, [TRUE, middle])).star_camera) is None


def test_what_is_left_of_a_barrel_about_the_middle_is_no_turn():
    told = load(NAME, [TRUE, f"{TOLD}=[-0.326, 0, 0, 0, 0]"])
    _, said = lens.words(told.star_camera, as_told(told).star_camera)
    assert "no attitude fits them better, which leaves 0." in said and "arcsec" not in said


def test_distortion_must_be_undone_all_over_the_detector(monkeypatch):
    """Not in the corners alone: of a made-up inverse that is off in the middle of an edge, words."""
    from shefex_nav.geometry import distortion

    right = distortion.undistort

    def off(hole, k, xy_px):
        out = right(hole, k, xy_px)
        out[np.abs(xy_px - [329.0, -0.5]).max(axis=1) < 20.0] += 0.02
        return out

    camera = load(NAME, [TRUE]).star_camera
    assert lens.fault(camera) is None
    monkeypatch.setattr(distortion, "undistort", off)
    assert lens.fault(camera) == lens.TOO_STRONG


def test_displacement_is_the_largest_over_the_detector():
    """A radial term and its opposite, none in the corners: r^3 - r^5/R^2 is largest at r^2 = 0.6 R^2."""
    R2 = (329.5**2 + 246.5**2) / FOCAL_PX**2
    k1 = 1.0
    camera = load(NAME, [f"star_camera.optics.distortion=[{k1}, {-k1 / R2}, 0, 0, 0]"]).star_camera
    most = FOCAL_PX * k1 * (0.6 * R2) ** 1.5 * 0.4
    assert lens.displaced_px(camera) == pytest.approx(most, rel=0.02)


def test_field_of_view_is_that_of_the_lens():
    wide, tall, diagonal = lens.field_of_view_deg(load(NAME, [TRUE]).star_camera)
    plain = lens.field_of_view_deg(load(NAME).star_camera)
    for seen, behind, half_px in zip((wide, tall, diagonal), plain, (329.5, 246.5, 411.49), strict=True):
        x = half_px / FOCAL_PX
        ideal = x
        for _ in range(50):
            ideal = x / (1.0 - 0.376 * ideal**2)
        assert seen == pytest.approx(np.degrees(2.0 * np.arctan(ideal)), abs=1e-3)
        assert seen > behind
    moved = lens.field_of_view_deg(
        load(NAME, ["star_camera.optics.principal_point=[0 pix, 246 pix]"]).star_camera
    )
    assert moved[0] == pytest.approx(
        np.degrees(np.arctan(0.5 / FOCAL_PX) + np.arctan(658.5 / FOCAL_PX)), abs=1e-6
    )


def test_a_picture_that_folds_is_refused_with_the_place():
    """r (1 + k1 r^2) ends at 2 / (3 sqrt(-3 k1)): 0.163 f for k1 = -5.6, 411 px; -5.2 is a lens yet."""
    load(NAME, ["star_camera.optics.distortion=[-5.2, 0, 0, 0, 0]"])
    said = refused("star_camera.optics.distortion=[-6, 0, 0, 0, 0]")
    end_px = FOCAL_PX * 2.0 / 3.0 / np.sqrt(18.0)
    assert f"ends {end_px:.4g} pixels from the optical axis" in said and "411.5 pixels away" in said
    assert said.count("folds") == 1
    said = refused(TRUE, f"{TOLD}=[-6, 0, 0, 0, 0]")
    assert "navigation.told.star_camera.optics.distortion" in said and "folds the picture over" in said


@pytest.mark.parametrize(
    "overrides, says",
    [
        (
            ["star_camera.optics.distortion=[0.1, 0, 0]"],
            "expected a list of 5 values, got 3 values; for example [-0.3, 0.1, ",
        ),
        (["star_camera.optics.principal_point=[700 pix, 1 pix]"], "is not on a detector of 659 x 493 pixels"),
        (
            ["navigation.told.star_camera.optics.principal_point=[1 pix, 500 pix]"],
            "navigation.told.star_camera.optics.principal_point: [1 pix, 500 pix] is not on a detector",
        ),
        ([TRUE, "star_tracker.detection.scan=run_length"], "takes the lens for a pinhole"),
    ],
)
def test_mistakes(overrides, says):
    assert says in refused(*overrides)


def test_statistics_are_refused_where_stars_leave_their_gates():
    """They hold in pixels of the detector, whatever the lens; not for a calibration that is far off."""
    ways = ["star_tracker.frames=statistical"]
    assert load("shefex2_andoya", [*ways, TRUE]).star_camera.optics.distortion is not None
    load("shefex2_andoya", [*ways, TRUE, f"{TOLD}=[-0.35, 0, 0, 0, 0]"])
    with pytest.raises(ScenarioError, match=r"leaves stars 4\.3 pixels .* beyond their gate of 1\.1 pixels"):
        load("shefex2_andoya", [*ways, TRUE, f"{TOLD}=[0, 0, 0, 0, 0]"])


def test_keys_of_earlier_camera_files_have_moved(tmp_path):
    path = tmp_path / "camera.yaml"
    sections = "star_camera: {optics: {}, detector: {}}\nstar_tracker: {}\n"
    path.write_text(f"principal_point: [328.7 pix, 246.2 pix]\ndistortion: [0.1, 0, 0, 0, 0]\n{sections}")
    with pytest.raises(ScenarioError) as caught:
        camera_file.read(path)
    assert "has moved; write 'star_camera: {optics: {principal_point:" in str(caught.value)
    assert "has moved; write 'star_camera: {optics: {distortion:" in str(caught.value)


def test_check_says_how_far_stars_are_displaced(command):
    said = command("check", NAME, "--set", TRUE, "--set", f"{TOLD}=[-0.326, 0, 0.002, 0, 0]")
    assert said.code == 0
    assert "star_camera.optics.distortion: displaces stars by up to 4.25 pixels" in said.err
    assert "an attitude off by 6.74 arcsec leaves 0.2 pixels rms of it" in said.err
    assert "displaces" not in command("check", NAME).err
    said = command("check", NAME, "--set", "star_camera.optics.distortion=[-9, 0, 0, 0, 0]", "--json")
    assert "folds the picture over" in json.loads(said.out)["errors"][0]["text"]
    said = json.loads(command("check", NAME, "--set", TRUE, "--json").out)
    assert said["lens"] == ["star_camera.optics.distortion: displaces stars by up to 4.25 pixels"]


@pytest.mark.parametrize(
    ("point", "is_told"),
    [("[246 pix, 329 pix]", True), ("[164 pix, 123 pix]", True), ("[340 pix, 240 pix]", False)],
)
def test_an_axis_far_from_the_middle_is_told(point, is_told):
    """Column and row exchanged; of half the resolution; as lenses are."""
    scenario = settled(load(NAME, [f"star_camera.optics.principal_point={point}"]))
    found = {one.field for one in programme.foreseen(scenario)}
    assert (("star_camera", "optics", "principal_point") in found) is is_told
