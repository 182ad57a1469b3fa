"""The flux of a star of magnitude 0 from lens and detector: the number, and which of the two ways holds."""

import math

import numpy as np
import pytest
from broken import SCENARIO_FOLDER, messages, the_message

from shefex_nav.environment import starlight
from shefex_nav.frames import camera_file
from shefex_nav.scenario.load import Pattern, load, load_text

BASE = "extends: shefex2_andoya\n"
FLUX = "star_camera.optics.zero_magnitude_flux"
LENS = "star_camera:\n  optics: {f_number: 1.4, transmission: 80 %}\n  detector: {quantum_efficiency: 40 %}\n"
SETS = [
    "star_camera.optics.f_number=1.4",
    "star_camera.optics.transmission=80 %",
    "star_camera.detector.quantum_efficiency=40 %",
]


@pytest.fixture
def written(tmp_path, monkeypatch):
    """The current folder is empty; written("a.yaml", text) puts a file there and returns its path."""
    monkeypatch.chdir(tmp_path)

    def write(name, text):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return write


def test_photons_of_vega():
    """At 555.6 nm 3.46e-9 erg/cm2/s/A with V = 0.03 (Megessier, A&A 296, 771, 1995); in V 8.8e5 a cm2."""
    energy = 6.62607015e-34 * 299792458.0 / 555.6e-9
    vega = 3.46e-9 * 1e-7 * 1e4 * 1e10 / energy  # photons in s, m^2, m
    here = starlight.photons(np.array([555.6e-9]))[0] * 10.0 ** (-0.4 * 0.03)
    assert here == pytest.approx(vega, rel=0.03)
    assert 1e-4 * starlight.photons_in_v() == pytest.approx(8.8e5, rel=0.01)


def test_spectrum_passes_through_the_bands_it_is_made_of():
    """Photons per wavelength are flux over h and wavelength: for each of the bands."""
    expected = starlight.FLUXES / (6.62607015e-34 * starlight.WAVELENGTHS)
    np.testing.assert_allclose(starlight.photons(starlight.WAVELENGTHS), expected, rtol=1e-12)


def test_silicon_counts_as_gaia_does():
    """Gaia: 2.58e6 electrons in a second and cm2 from a star of G = 0 (zero point 25.69 mag, 0.728 m2), some
    0.7 of the photons at 550 nm. Its silicon is redder than the one here: 15 % either way."""
    gaia = 10.0 ** (0.4 * 25.6874) / 0.7278e4
    assert starlight.zero_magnitude_flux(
        "silicon", 2.0 / math.sqrt(math.pi) * 1e-2, 1.0, 0.7
    ) == pytest.approx(gaia, rel=0.15)


def test_product_of_pupil_transmission_and_efficiency():
    whole = starlight.zero_magnitude_flux("V", 2.0 / math.sqrt(math.pi), 1.0, 1.0)  # 1 m^2
    assert whole == pytest.approx(starlight.photons_in_v())
    part = starlight.zero_magnitude_flux("V", 1.0 / math.sqrt(math.pi), 0.5, 0.25)
    assert part == pytest.approx(whole / 32.0)


def test_the_default_camera_within_15_percent():
    """Its flux was computed for f/1.4, 80 % and a CCD: 13 % less than with the 40 % assumed for it here."""
    given = load("shefex2_andoya").star_camera.optics.zero_magnitude_flux
    computed = load("shefex2_andoya", ["star_camera.use=prosilica_ec655"]).star_camera.optics
    assert computed.zero_magnitude_flux / given == pytest.approx(1.128, abs=2e-3)


def test_lens_on_top_takes_the_place_of_the_flux_and_the_other_way_round(written):
    lens = load(written("lens.yaml", BASE + LENS))
    assert lens.star_camera.optics.zero_magnitude_flux == pytest.approx(2.8197e6, rel=1e-4)
    back = written(
        "back.yaml", "extends: lens.yaml\nstar_camera:\n  optics: {zero_magnitude_flux: 3e6 electron/s}\n"
    )
    optics = load(back).star_camera.optics
    assert optics.zero_magnitude_flux == 3e6 and optics.f_number is None
    again = load(back, SETS)
    assert again.star_camera.optics.zero_magnitude_flux == lens.star_camera.optics.zero_magnitude_flux
    assert load("lens.yaml", [f"{FLUX}=1e6 electron/s"]).star_camera.optics.zero_magnitude_flux == 1e6


def test_an_aperture_takes_the_place_of_an_f_number(written):
    written("lens.yaml", BASE + LENS)
    one = load(
        written("a.yaml", "extends: lens.yaml\nstar_camera: {optics: {aperture: 10 mm}}\n")
    ).star_camera
    assert one.optics.f_number is None
    expected = starlight.zero_magnitude_flux("silicon", 0.01, 0.8, 0.4)
    assert one.optics.zero_magnitude_flux == pytest.approx(expected)
    other = load("lens.yaml", ["star_camera.stars.band=V"]).star_camera.optics.zero_magnitude_flux
    assert other == pytest.approx(expected * (24.95 / 14.0) ** 2 / starlight.factor("silicon"))


def test_both_in_one_file_is_an_error(written):
    text = LENS.replace("transmission: 80 %", "transmission: 80 %, zero_magnitude_flux: 2e6 electron/s")
    said = the_message(written("a.yaml", BASE + text))
    assert said.startswith(
        "a.yaml:3:22: star_camera.optics.f_number: zero_magnitude_flux says so too; keep it"
    )
    said = the_message(written("b.yaml", BASE + LENS.replace("80 %", "80 %, aperture: 1 cm")))
    assert "star_camera.optics.aperture: f_number says so too; keep one of them" in said


def test_both_set_at_once_is_an_error():
    said = the_message("shefex2_andoya", [*SETS, f"{FLUX}=2e6 electron/s"])
    words = "star_camera.optics.f_number, from which it follows, is set too; set one of them"
    assert said == f"--set {FLUX}: {words}"


def test_two_pupils_set_at_once_are_an_error():
    pupils = ["star_camera.optics.f_number=1.4", "star_camera.optics.aperture=30 mm"]
    rest = [one for one in SETS if "f_number" not in one and "aperture" not in one]
    said = the_message("shefex2_andoya", [*rest, *pupils])
    assert "star_camera.optics.f_number is set too; set one of them" in said
    assert said == the_message("shefex2_andoya", [*rest, *pupils[::-1]])


@pytest.mark.parametrize(
    ("gone", "path"),
    [
        ("transmission: 80 %", "star_camera.optics.transmission"),
        ("quantum_efficiency: 40 %", "star_camera.detector.quantum_efficiency"),
        ("f_number: 1.4, ", "star_camera.optics.f_number"),
    ],
)
def test_what_is_missing_is_told(written, gone, path):
    said = the_message(written("a.yaml", BASE + LENS.replace(gone, "")))
    assert f"{path}: is missing; the flux of a star follows from f_number (or aperture)" in said


def test_neither_is_an_error_as_before():
    said = the_message("shefex2_andoya", [f"{FLUX}=null"])
    assert (
        f"{FLUX}: is missing; expected for example 'zero_magnitude_flux: 2.5e6 electron/s', or f_number"
        in said
    )


def test_a_value_that_is_wrong_is_told_once(written):
    text = LENS.replace("f_number: 1.4", "f_number: 0.1").replace("40 %", "40")
    said = messages(written("a.yaml", BASE + text))
    assert [line.split(": ")[1] for line in said] == [
        "star_camera.optics.f_number", "star_camera.detector.quantum_efficiency",
    ]  # fmt: skip


def test_what_a_log_keeps_says_lens_and_detector_and_gives_the_same(written):
    own = load(written("a.yaml", BASE + LENS))
    assert load_text(own.source, "log").star_camera == own.star_camera and "electron/s" in own.source
    assert "zero_magnitude_flux" not in own.source


def test_a_campaign_may_disperse_the_efficiency_not_the_flux(written):
    key = "star_camera.detector.quantum_efficiency"
    text = f"{BASE}{LENS}dispersions:\n  {key}: {{normal: 2 %}}\n"
    pattern = Pattern(load(written("a.yaml", text)).source, "a.yaml")
    optics = [pattern.with_draws({key: draw}).star_camera.optics for draw in (0.0, 4.0)]
    assert optics[1].zero_magnitude_flux == pytest.approx(1.1 * optics[0].zero_magnitude_flux)
    said = the_message(
        written("b.yaml", f"{BASE}{LENS}dispersions:\n  {FLUX}: {{normal: 2 %, apply: scale}}\n")
    )
    assert f"{FLUX} is not given, so there is nothing that could differ" in said


def test_told_takes_a_flux_only(written):
    text = "navigation:\n  told:\n    star_camera:\n      optics: {f_number: 2}\n"
    assert "f_number: unknown key" in the_message(written("a.yaml", BASE + text))
    text = LENS + text.replace("f_number: 2", "zero_magnitude_flux: 2e6 electron/s")
    assert load(written("b.yaml", BASE + text)).star_camera.optics.zero_magnitude_flux > 2.5e6


def test_a_camera_file_of_it_holds_the_flux(written):
    """For `solve --camera`; and one of a user may give the lens."""
    from types import SimpleNamespace

    own = load(written("a.yaml", BASE + LENS))
    world = SimpleNamespace(camera=SimpleNamespace(bad_pixel_map=np.zeros((0, 2), dtype=int)))
    text = camera_file.written(own, world)
    assert "f_number" not in text and "quantum_efficiency" not in text
    found = camera_file.read(written("camera.yaml", text))
    assert found.params.camera.zero_flux == pytest.approx(
        camera_file.of_scenario(own).params.camera.zero_flux
    )
    flux = f"zero_magnitude_flux: {own.star_camera.optics.zero_magnitude_flux!r} electron/s"
    assert flux in text
    text = text.replace(flux, "f_number: 1.4, transmission: 80 %")
    text = text.replace("columns: 659", "columns: 659, quantum_efficiency: 40 %")
    again = camera_file.read(written("lens.yaml", text))
    assert again.params.camera.zero_flux == pytest.approx(found.params.camera.zero_flux)


def test_the_folder_of_scenarios_gives_one_of_the_two_everywhere():
    """No scenario of the package was moved by the other way to say it."""
    assert all(
        "quantum_efficiency" not in path.read_text(encoding="utf-8")
        for path in SCENARIO_FOLDER.glob("*.yaml")
    )
