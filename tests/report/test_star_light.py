"""A star camera that cannot see enough stars, or only a bright sky, is told before the flight."""

import math

import numpy as np
import pytest

from shefex_nav.commands.app import main
from shefex_nav.environment.stars import load_catalogue
from shefex_nav.onboard.startracker.catalogue import CatalogueError, magnitudes
from shefex_nav.report import programme, star_light
from shefex_nav.scenario import load

CATALOGUE = "star_tracker.catalogue"


def warned(*overrides):
    """{field: text} of what is said of the default camera with overrides."""
    found = star_light.warnings(load.load("shefex2_andoya", overrides))
    return {".".join(path): text for path, text in found}


def test_the_default_camera_sees_enough():
    assert warned() == {}


@pytest.mark.parametrize(
    ("overrides", "field", "words"),
    [
        (["star_camera.optics.focal_length=25 m"], "star_camera.optics.focal_length", "no two pairs fit"),
        (["star_tracker.catalogue.faintest=-3 mag"], "star_tracker.catalogue.faintest", "no star is as"),
        ([f"{CATALOGUE}.kind=combined", f"{CATALOGUE}.size=7000"], f"{CATALOGUE}.size", "are wanted, only"),
        ([f"{CATALOGUE}.kind=combined", f"{CATALOGUE}.size=300"], f"{CATALOGUE}.size", "keep_to alone"),
    ],
)
def test_catalogues_that_cannot_be(overrides, field, words):
    """Each was a traceback of `run`."""
    scenario = load.load("shefex2_andoya", overrides)
    with pytest.raises(CatalogueError) as caught:
        programme.foreseen(scenario)
    assert ".".join(caught.value.field) == field and words in str(caught.value)


def test_check_names_the_line_and_ends_with_2(tmp_path, capsys, monkeypatch):
    path = tmp_path / "long.yaml"
    text = "extends: orbit\nmission: {name: far}\nstar_camera: {optics: {focal_length: 25 m}}\n"
    path.write_text(text, encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["shefex-nav", "check", str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith(f"{path}:3:38: star_camera.optics.focal_length: no attitude is possible")


@pytest.mark.parametrize(("angle_deg", "good"), [(99.9, True), (100.1, False), (179.0, False)])
def test_a_field_that_no_lens_without_distortion_has(angle_deg, good):
    """The pixels of 659 x 493 that make the diagonal of the field of view this large, behind 25 mm."""
    pixel_mm = 2.0 * 25.0 * math.tan(math.radians(0.5 * angle_deg)) / math.hypot(659, 493)
    given = [f"star_camera.detector.pixel_size={pixel_mm!r} mm", "star_camera.optics.focal_length=25 mm"]
    if good:
        assert load.load("shefex2_andoya", given)
        return
    with pytest.raises(load.ScenarioError) as caught:
        load.load("shefex2_andoya", given)
    (words,) = caught.value.messages
    assert "star_camera.optics.focal_length: 659 x 493 pixels of" in words
    assert f"{angle_deg:.4g} deg from corner to corner" in words and "pixel_size" in words


def test_check_of_a_lens_prints_its_field_of_view(tmp_path, capsys, monkeypatch):
    path = tmp_path / "lens.yaml"
    optics = "{optics: {f_number: 1.8, transmission: 80 %}, detector: {quantum_efficiency: 50 %}}"
    path.write_text(f"extends: night_sky\nmission: {{name: lens}}\nstar_camera: {optics}\n", encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["shefex-nav", "check", str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    chip, focal_length = (659 * 9.9, 493 * 9.9), 24.95e3  # um
    width, height = (2.0 * math.degrees(math.atan(0.5 * side / focal_length)) for side in chip)
    said = capsys.readouterr().err
    assert f"star_camera: a field of view of {width:.3g} x {height:.3g} deg, finds stars to V " in said


def noted(*overrides):
    """{field: text} of what is noted of the default camera with overrides."""
    lines = star_light.notes(load.load("shefex2_andoya", overrides))
    return dict(line.split(": ", 1) for line in lines)


def test_keys_that_are_made_for_a_camera_with_less_light_are_named():
    """Ten times the light is 2.5 magnitudes: drawn to V 7, known to 5.5, forty objects kept."""
    flux = 10.0 * load.load("shefex2_andoya").star_camera.optics.zero_magnitude_flux
    lens = f"star_camera.optics.zero_magnitude_flux={flux} electron/s"
    assert list(noted()) == ["star_camera"] and "finds stars to V 6.5 (" in noted()["star_camera"]
    found = noted(lens)
    assert "finds stars to V 9.0 (at rest, in 50 ms)" in found["star_camera"]
    assert "drawn to V 7 alone; write 8 mag" in found["star_camera.stars.faintest"]
    known = load_catalogue(8.0).vmag
    of_sphere = 4.0 * math.pi / ((659 * 9.9e-3 / 24.95) * (493 * 9.9e-3 / 24.95))
    seventh = np.count_nonzero(known <= 7.0) / of_sphere
    words = found["star_tracker.catalogue.faintest"]
    assert float(words.split("knows ")[2].split(",")[0]) == pytest.approx(seventh, rel=0.04)
    assert "identification.deepest: 7.0 mag" in words
    kept = found["star_tracker.detection.most_objects"]
    assert kept.startswith("40 objects are kept, the brightest, of ")
    assert int(kept.split("write ")[1]) == pytest.approx(1.5 * seventh, abs=16.0)
    deeper = ("star_camera.stars.faintest=8 mag", "star_tracker.catalogue.faintest=7 mag")
    assert list(noted(lens, *deeper, "star_tracker.detection.most_objects=300")) == ["star_camera"]
    assert list(noted(lens, "star_tracker.enabled=false")) == ["star_camera"]


def test_what_a_fainter_catalogue_knows_is_what_it_knows_when_it_is_written_so():
    """The magnitude is rounded before its stars are counted: 6.6 mag knew 38, and 39 when one wrote it."""
    camera = "star_camera.use=altair_hb", "star_tracker.rate=2 Hz"
    words = noted(*camera)["star_tracker.catalogue.faintest"]
    deep = words.split("; ")[1].split(" mag")[0]
    said = float(words.split("knows ")[2].split(",")[0])
    share = star_light._field(load.load("shefex2_andoya", camera).star_camera)[1]
    assert said == round(share * np.count_nonzero(load_catalogue(8.0).vmag <= float(deep)))


@pytest.mark.parametrize(("system", "end"), [("V", 8.0), ("Hp", 8.0), ("silicon", 6.5)])
def test_magnitudes_are_of_the_band_of_the_catalogue(system, end):
    """Words and numbers of stars; V is said of what is drawn alone. silicon ends where the table is whole."""
    default = load.load("shefex2_andoya")
    lens = f"star_camera.optics.zero_magnitude_flux={10.0 * default.star_camera.optics.zero_magnitude_flux}"
    said = [f"{CATALOGUE}.system={system}", f"{CATALOGUE}.faintest=5.0 mag"]
    found = noted(f"{lens} electron/s", *said)
    assert f"finds stars to {system} 9.0 (at rest" in found["star_camera"]
    assert "drawn to V 7 alone; write 8 mag" in found["star_camera.stars.faintest"]
    words = found["star_tracker.catalogue.faintest"]
    deep = min(end - 1.0, 7.0)
    assert f"knows stars to {system} 5," in words and f"identification.deepest: {deep:.1f} mag" in words
    known = magnitudes(load_catalogue(8.0), system)
    of_sphere = 4.0 * math.pi / ((659 * 9.9e-3 / 24.95) * (493 * 9.9e-3 / 24.95))
    counted = float(words.split("knows ")[2].split(",")[0])
    assert counted == pytest.approx(np.count_nonzero(known <= deep) / of_sphere, rel=0.05)
    (dark,) = warned(*said, "star_camera.optics.zero_magnitude_flux=2500 electron/s").values()
    assert f"the detection finds stars to {system} " in dark


def test_deep_matching_to_stars_that_the_table_has_not():
    """In silicon it is whole to 6.5; of the others it has all that can be asked for."""
    deepest = "star_tracker.identification.deepest=7 mag"
    assert list(warned(deepest)) == []
    with pytest.raises(CatalogueError) as caught:
        warned(deepest, f"{CATALOGUE}.system=silicon")
    assert caught.value.field == ("star_tracker", "identification", "deepest")
    assert "whole to 6.5 in silicon" in str(caught.value)


def test_too_narrow_a_field():
    """The mean number of stars is that of the catalogue times the share of the sky: here a small one."""
    (text,) = warned("star_camera.optics.focal_length=120 mm").values()
    stars = np.count_nonzero(load_catalogue(8.0).vmag <= 5.5)
    share = (659 * 9.9e-3 / 120.0) * (493 * 9.9e-3 / 120.0) / (4.0 * math.pi)
    assert f"holds {stars * share:.2g} stars" in text and "4 are needed" in text


def test_too_little_light():
    """A hundredth of the light is five magnitudes less, whatever the rest."""
    bright = load.load("shefex2_andoya")
    flux = bright.star_camera.optics.zero_magnitude_flux
    less = [f"star_camera.optics.zero_magnitude_flux={flux / 100.0} electron/s"]
    dark = load.load("shefex2_andoya", less)
    assert star_light.of(bright).faintest - star_light.of(dark).faintest == pytest.approx(5.0)
    assert "star_camera.optics.zero_magnitude_flux" in warned(
        f"star_camera.optics.zero_magnitude_flux={flux / 1000.0} electron/s"
    )


def test_a_sky_that_counts_as_saturated():
    """Grey value = black level + charge over the conversion at the gain: 20 dB are a factor of ten."""
    found = warned("star_tracker.exposure.gain=60 dB")
    (text,) = found.values()
    scenario = load.load("shefex2_andoya", ["star_tracker.exposure.gain=60 dB"])
    chip = scenario.star_camera.detector
    charge = chip.background * scenario.star_tracker.exposure.shortest
    empty_dn = chip.black_level + 1000.0 * charge / chip.conversion
    assert list(found) == ["star_tracker.exposure.brightest_mean"]
    assert f"{empty_dn:.0f} DN" in text and "60 dB" in text


def test_nothing_is_said_without_a_star_tracker():
    assert warned("star_tracker.enabled=false", "star_tracker.exposure.gain=60 dB") == {}


def test_orbits_are_looked_at_too():
    """A receiver that falls silent at 500 m/s, and a camera that looks down."""
    down = "programme.slew.elevation=-90 deg"
    overrides = ["gps.highest_speed=500 m/s", "programme.slew.azimuth=0 deg", down]
    said = {".".join(one.field): one.text for one in programme.foreseen(load.load("orbit", overrides))}
    assert "is exceeded for 90" in said["gps.highest_speed"]
    assert "into the Earth" in said["programme.slew"]
