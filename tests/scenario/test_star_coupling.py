"""The key navigation.stars: what it sets on both sides of the star tracker, and what it does not go with."""

import numpy as np
import pytest
from broken import DEFAULT, check_one_message, messages, the_message

from shefex_nav.environment import ephemeris
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.load import load


@pytest.mark.parametrize(("overrides", "way"), [((), "attitude"), (("navigation.stars=vectors",), "vectors")])
def test_filter_and_star_tracker_are_told(overrides, way):
    scenario = load(DEFAULT, overrides)
    assert params_onboard.nav_params(scenario).stars == way
    bodies = ephemeris.sky_bodies("2012-06-22T19:18:00")
    tracker = params_onboard.tracker_params(scenario, bodies.earth_v_i, np.zeros((0, 2), dtype=np.int64))
    assert tracker.vectors == (way == "vectors") and tracker.settings.identification.tracking


def test_single_stars_need_a_prediction():
    said = the_message(DEFAULT, ["navigation.stars=vectors", "star_tracker.identification.tracking=false"])
    assert "navigation.stars: stars: vectors identifies one or two stars by the predicted attitude" in said
    assert "set star_tracker.identification.tracking: true, or choose attitude" in said
    assert load(DEFAULT, ["star_tracker.identification.tracking=false"]).navigation.stars == "attitude"


def test_another_way_does_not_exist(tmp_path):
    said = " ".join(messages(DEFAULT, ["navigation.stars=quest"]))
    assert "navigation.stars: 'quest' is not known; choose from: attitude, vectors" in said
    check_one_message(
        tmp_path,
        "  gate_probability: 1e-4\n",
        "  gate_probability: 1e-4\n  stars: @5\n",
        "navigation.stars",
        "5",
    )


def test_deep_matching_needs_stars_that_are_fainter_and_drawn():
    key = "star_tracker.identification.deepest"
    assert load(DEFAULT).star_tracker.identification.deepest is None
    assert load(DEFAULT, [f"{key}=7 mag"]).star_tracker.identification.deepest == 7.0
    assert "fainter than catalogue.faintest, 5.5" in the_message(DEFAULT, [f"{key}=5 mag"])
    assert "V 7.5 is matched, the camera draws stars to V 7" in the_message(DEFAULT, [f"{key}=7.5 mag"])
    silicon = "star_tracker.catalogue.system=silicon"
    assert "5.5 (both in silicon)" in the_message(DEFAULT, [f"{key}=5 mag", silicon])
    assert "silicon 7.5 is matched, the camera draws" in the_message(DEFAULT, [f"{key}=7.5 mag", silicon])
