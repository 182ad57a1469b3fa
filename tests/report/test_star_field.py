"""A programme that points the star camera at too few stars that are known is told before the flight."""

import re

import numpy as np
import pytest

from shefex_nav.environment import stars
from shefex_nav.report import programme, star_sight
from shefex_nav.scenario import load, params

# near the south galactic pole: a field that holds 4.5 stars of the catalogue on average has 3 there
EMPTY = """\
extends: cubesat
mission: {name: empty, time_limit: 100 s}
programme:
  pointing: null
  pole: {task: point_inertial, from: 0 s, until: 20 s, right_ascension: 12.9 deg, declination: -27.1 deg}
  watch: {task: dwell, from: 20 s, until: 100 s}
star_tracker: {on: 20 s, off: 100 s, catalogue: {faintest: 5.7 mag}}
star_camera: {optics: {focal_length: 33 mm}}
"""


def told(tmp_path, text, *overrides):
    """Warnings of a scenario that are about too few stars."""
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return [one for one in programme.foreseen(load.load(path, overrides)) if "no attitude" in one.text]


def test_a_field_without_stars_is_told_with_what_would_do(tmp_path):
    (one,) = told(tmp_path, EMPTY)
    assert one.field == ("programme", "pole")
    assert re.search(r"for (all of|\d+ % of) the 80 s .* fewer than 4 of the stars that it knows", one.text)
    limit = re.search(r"write star_tracker.catalogue.faintest: ([\d.]+ mag)", one.text)[1]
    assert not told(tmp_path, EMPTY, f"star_tracker.catalogue.faintest={limit}")


def test_a_field_with_stars_and_a_star_tracker_that_is_off_are_not(tmp_path):
    rich = EMPTY.replace("12.9 deg", "83 deg").replace("-27.1 deg", "-3 deg")  # Orion's sword
    assert not told(tmp_path, rich)
    assert not told(tmp_path, EMPTY, "star_tracker.enabled=false")


@pytest.mark.parametrize("edge", [1.0, -1.0])
def test_stars_are_counted_to_the_edge_of_the_field(edge):
    """A star a hundredth of a degree inside of each edge counts, one outside of it and one behind do not."""
    scenario = load.load("shefex2_andoya")
    camera, chip = scenario.star_camera, scenario.star_camera.detector
    half = 0.5 * np.array([chip.columns, chip.rows]) * chip.pixel_size / camera.optics.focal_length
    step = np.radians(0.01)
    inside = [[edge * (half[0] - step), 0.0, 1.0], [0.0, edge * (half[1] - step), 1.0]]
    outside = [[edge * (half[0] + step), 0.0, 1.0], [0.0, edge * (half[1] + step), 1.0], [0.0, 0.0, -1.0]]
    u_c = np.array([*inside, *outside])
    u_i = (u_c / np.linalg.norm(u_c, axis=1, keepdims=True)) @ params.mounting(scenario).T
    seen = star_sight.Sight(np.zeros(1), np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[7e6, 0.0, 0.0]]))
    assert star_sight.counts(scenario, seen, u_i).tolist() == [2]


def test_the_shipped_missions_look_at_stars():
    assert len(stars.load_catalogue(5.5).hip) > 2500
    for name in ("shefex2_andoya", "cubesat", "shefex2_woomera"):
        assert not [one for one in programme.foreseen(load.load(name)) if "no attitude" in one.text]
