"""Programmes that point the star camera at Sun, Earth or too few stars are told before the flight."""

import re

import numpy as np
import pytest

from shefex_nav.environment import stars
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.report import programme, sensor_limits, star_sight
from shefex_nav.scenario import load, params


@pytest.mark.parametrize(
    ("overrides", "what"),
    [((), None), (("star_camera.stray_light.sun_exclusion=130 deg",), "130 deg of the Sun"),
     (("star_camera.stray_light.earth_exclusion=80 deg",), "80 deg of the Earth's limb")],
)  # fmt: skip
def test_where_the_programme_points(overrides, what):
    found = [one for one in programme.foreseen(load.load("shefex2_andoya", overrides))]
    if what is None:
        assert found == []
    else:
        (one,) = found
        assert one.field == ("programme", "slew") and what in one.text


BACK = """\
extends: cubesat
mission: {name: back}
programme:
  pointing: null
  star: {task: point_inertial, from: 0 s, until: 40 s, right_ascension: 213.9 deg, declination: 19.2 deg}
  back: {task: point_nadir, from: 40 s, until: 80 s}
  follow: {task: turn_with_orbit, from: 80 s, until: 300 s}
star_camera: {stray_light: {earth_exclusion: 60 deg}}
"""


def test_the_task_that_is_named_is_the_last_that_turned_the_camera(tmp_path):
    """After it the camera looks 30 deg above the horizontal, some 52 deg above the limb."""
    path = tmp_path / "back.yaml"
    path.write_text(BACK)
    (one,) = (one for one in programme.foreseen(load.load(path)) if "limb" in one.text)
    assert one.field == ("programme", "back")


def test_angles_of_the_boresight():
    """Above the pole, the boresight (body x here) up, level and 30 deg from the Sun, then down."""
    above = np.array([0.0, 0.0, wgs84.B + 200e3])
    up, level, down = [0.5**0.5, 0.0, -(0.5**0.5), 0.0], [1.0, 0.0, 0.0, 0.0], [0.5**0.5, 0.0, 0.5**0.5, 0.0]
    seen = star_sight.Sight(np.zeros(3), np.array([up, level, down]), np.array([above] * 3))
    C_bc = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    sun_i = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
    earth = EarthRotation(np.eye(3), np.eye(3), 0.3, 7.3e-5)
    sun_angle, limb_angle = np.degrees(star_sight.angles(seen, C_bc, sun_i, earth))
    np.testing.assert_allclose(sun_angle, [90.0, 30.0, 90.0], atol=1e-9)
    below_i = np.array([np.cos(0.4), 0.0, -np.sin(0.4)])  # 23 deg down, the limb is 14: the Sun is not there
    hidden_angle, _ = np.degrees(star_sight.angles(seen, C_bc, below_i, earth))
    np.testing.assert_array_equal(hidden_angle, 180.0)
    np.testing.assert_allclose(np.diff(limb_angle), [-90.0, -90.0], atol=1e-9)
    dip_deg = np.degrees(np.arccos(wgs84.A / (wgs84.A + 200e3)))  # of a sphere; flattening: 0.1 deg
    assert limb_angle[1] == pytest.approx(dip_deg, abs=0.15)


def test_samples_are_about_a_second_apart():
    t_s = np.arange(0.0, 10.0, 0.0025)
    seen = star_sight.sight(t_s, np.zeros((len(t_s), 4)), np.zeros((len(t_s), 3)))
    np.testing.assert_allclose(np.diff(seen.t_s), 1.0, atol=0.003)


def test_a_programme_that_turns_faster_than_the_star_tracker_takes_frames():
    """Rates about the boresight and across it are at right angles: 3 and 4 deg/s are 5."""
    rates = [
        f"programme.pointing.{key}" for key in ("boresight_rate=3 deg/s", "cross_rate=4 deg/s", "ramp=2 s")
    ]
    found = {}
    for limit in (4.9, 5.1):
        scenario = load.load("orbit", [*rates, f"star_tracker.highest_rate={limit} deg/s"])
        found[limit] = list(star_sight.too_fast(scenario))
    assert found[5.1] == []
    ((path, text),) = found[4.9]
    assert path == ("programme", "pointing") and "turns at 5 deg/s" in text and "4.9 deg/s, give no" in text
    off = [*rates, "star_tracker.highest_rate=1 deg/s", "star_tracker.enabled=false"]
    assert list(star_sight.too_fast(load.load("orbit", off))) == []
    assert [
        one.field for one in programme.warnings(load.load("orbit", [*rates]), programme.Flown((), 0.0, 9.0))
    ]


def test_a_star_tracker_that_is_on_while_the_vehicle_spins():
    """On from T+100 s to T+200 s; the vehicle spins until the share of that which is not told, and longer."""
    times = "star_tracker.on=100 s", "star_tracker.off=200 s"
    off = "star_tracker.enabled=false"
    for until_s, told in ((130.0, False), (131.0, True)):
        t_s = np.arange(0.0, 300.0)
        rate = np.zeros((300, 3))
        rate[t_s < until_s, 0] = np.radians(540.0)
        moved = sensor_limits.Motion(t_s, rate, rate)
        found = list(star_sight.turning(load.load("shefex2_andoya", times), moved))
        assert bool(found) is told
        assert not list(star_sight.turning(load.load("shefex2_andoya", [*times, off]), moved))
    ((path, text),) = found
    assert path == ("star_tracker", "highest_rate")
    assert text.startswith(
        "in 31 of the 100 seconds in which the star tracker is on, the vehicle turns faster"
    )
    assert "2.5 deg/s at an instant at least, up to 540 deg/s" in text
    quick = load.load("shefex2_andoya", [*times, "star_tracker.highest_rate=541 deg/s"])
    assert not list(star_sight.turning(quick, moved))


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
