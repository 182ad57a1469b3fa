"""`star_tracker.detection.saturation: automatic` follows the detector; cameras of any bits in one sweep."""

import pytest
from broken import the_message

from shefex_nav.scenario import sweeps
from shefex_nav.scenario.json_schema import json_schema
from shefex_nav.scenario.load import load, load_text
from shefex_nav.verify.trade import plan

NAME, KEY = "shefex2_andoya", "star_tracker.detection.saturation"


@pytest.mark.parametrize("given", ["automatic", "null"])
@pytest.mark.parametrize("bits", [None, 8, 10, 12, 16])
def test_it_is_the_largest_grey_value(given, bits):
    more = [] if bits is None else [f"star_camera.detector.bits={bits}"]
    loaded = load(NAME, [f"{KEY}={given}", *more])
    assert loaded.star_tracker.detection.saturation == 2.0 ** (bits or 8) - 1.0
    again = load_text(loaded.source, "its text")  # in which the word stays, for another detector
    assert again.model_dump() == loaded.model_dump()
    assert ("saturation: automatic" in loaded.source) is (given == "automatic")


def test_what_is_wrong_is_told_of_the_detector_alone():
    said = the_message(NAME, [f"{KEY}=automatic", "star_camera.detector.bits=70"])
    assert said == "--set star_camera.detector.bits: must be at most 16, got 70"
    assert "automatic" in the_message(NAME, [f"{KEY}=automtic"])
    said = the_message(NAME, [f"{KEY}=1000 DN", "star_camera.detector.bits=12"])
    assert said.endswith("write automatic, which is 4095 DN here")


@pytest.mark.parametrize("camera", ["prosilica_ec655", "mt9v034_16mm", "ar0134_12mm", "imx250_35mm"])
def test_a_camera_of_any_depth_goes_into_the_default_mission(camera):
    """With 255 DN in it, `star_camera.use` alone was refused for every one of more than 8 bits."""
    loaded = load(NAME, [f"star_camera.use={camera}"])
    assert loaded.star_tracker.detection.saturation == 2.0**loaded.star_camera.detector.bits - 1.0


def test_the_schema_takes_the_word():
    assert "or 'automatic'" in str(json_schema())


def test_cameras_of_ten_and_twelve_bits_in_one_sweep():
    """And a value that fits one of them only is refused in the other combination, not before."""
    cameras = sweeps.axis("star_camera=mt9v034_16mm,ar0134_12mm")
    asked = plan.Asked("night_sky", (cameras,), (f"{KEY}=automatic",))
    _, chosen = plan.checked(asked)
    found = [load(asked.scenario, (*asked.overrides, *sweeps.overrides(one))) for one in chosen]
    assert [one.star_tracker.detection.saturation for one in found] == [1023.0, 4095.0]
    values = sweeps.Axis(KEY, ("1023 DN", "4095 DN"))
    _, chosen = plan.checked(asked._replace(axes=(cameras, values), overrides=()))
    assert len(chosen) == 4
