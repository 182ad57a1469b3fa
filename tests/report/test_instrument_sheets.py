"""`shefex-nav instruments`: every value as it is written, what is assumed, and the figures that follow."""

import json
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.commands.app import main
from shefex_nav.report import instrument_sheets
from shefex_nav.scenario import instruments
from shefex_nav.scenario.load import load

NAMES = list(instruments.files())


@pytest.fixture
def command(monkeypatch, capsys):
    """The command line in this process: words -> (exit code, stdout, stderr)."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["shefex-nav", "instruments", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code, printed.out, printed.err

    return call


@pytest.mark.parametrize("name", NAMES)
def test_a_sheet_has_every_value_of_the_file_and_every_mark(name):
    sheet = instrument_sheets.sheet(name)
    with open(sheet.file, encoding="utf-8") as file:
        body = file.read().split(f"instrument: {sheet.instrument}")[1].splitlines()
    lines = [line for line in body if ": " in line and not line.startswith(("unit:", "grade:", "source:"))]
    written = [line for line in lines if not line.partition(": ")[2].startswith("#")]
    assert len(sheet.values) == len(written)
    for value, line in zip(sheet.values, written, strict=True):
        key, _, said = line.strip().partition(": ")
        assert value.key.split(".")[-1] == key
        assert said.startswith(str(value.value)) or float(said.split()[0]) == float(value.value)
        assert value.assumed == ("[E]" in line) and "[E]" not in value.note


def test_the_list_has_all_by_kind_and_grade(command):
    code, out, _ = command()
    assert code == 0
    places = [out.index(f" {one.name} ") for one in instrument_sheets.sheets()]
    assert len(places) == len(NAMES) and places == sorted(places)
    assert "for imu: {use: " in out and "for gps: {use: " in out and "for star_camera: {use: " in out
    code, out, _ = command("--json")
    listed = json.loads(out)["instruments"]
    assert {one["name"] for kind in listed.values() for one in kind} == set(NAMES)
    assert all(one["instrument"] == kind for kind, several in listed.items() for one in several)


def test_one_is_explained_with_its_source_and_the_line_for_a_scenario(command):
    code, out, _ = command("stim300")
    assert code == 0 and "Sensonor STIM300, tactical MEMS" in out and "source: Sensonor" in out
    assert "in a scenario: imu: {use: stim300}" in out and "0.15 deg/sqrt(h)" in out and "assumed" in out
    code, out, _ = command("max_m8q", "--json")
    found = json.loads(out)
    values = {one["key"]: one for one in found["values"]}
    assert values["highest_height"]["value"] == "50 km" and values["latency"]["assumed"]
    assert found["use"] == "gps: {use: max_m8q}"


def test_a_name_of_none(command):
    code, out, err = command("stim30")
    assert code == 2 and not out
    assert "no instrument 'stim30' comes with the program; did you mean stim300? there are adis16465_1" in err


def test_a_file_of_ones_own_is_explained_like_one_of_the_package(command, tmp_path):
    """With its lens: a barrel of 10 % in k1 makes the field of view of 53.13 deg (X/Z = 0.5) wider."""
    path = tmp_path / "mine.yaml"
    text = "instrument: star_camera\nunit: Mine\ngrade: test\nsource: invented\n"
    text += "optics: {focal_length: 20 mm, psf_sigma: 0.8 pix, focal_length_error: 0.01 %%, "
    text += "principal_point_error: 0.1 pix, zero_magnitude_flux: 1e6 electron/s, distortion: %s}\n"
    text += "detector: {columns: 1000, rows: 1000, pixel_size: 20 um, background: 60 electron/s, "
    text += "read_noise: 8 electron, full_well: 10000 electron, conversion: 2.5 electron/DN, "
    text += "black_level: 64 DN, readout: 15 ms, bits: 12, shutter: global}\n"
    path.write_text(text % "[0, 0, 0, 0, 0]")
    code, out, _ = command(str(path))
    assert code == 0 and "53.1 x 53.1 deg" in out and "faintest star" in out and "use: mine" in out
    path.write_text(text % "[-0.1, 0, 0, 0, 0]")
    x = next(x for x in np.linspace(0.5, 0.6, 100_001) if x * (1.0 - 0.1 * x * x) >= 0.5)
    found = json.loads(command(str(path), "--json")[1])
    assert found["compared"]["field of view"] == "{0:.1f} x {0:.1f} deg".format(
        2 * math.degrees(math.atan(x))
    )
    assert {"key": "optics.distortion", "value": "[-0.1, 0, 0, 0, 0]"}.items() <= found["values"][5].items()
    path.write_text("instrument: imu\nunit: [\n")
    assert command(str(path))[0] == 2
    path.write_text("extends: orbit\n")
    code, _, err = command(str(path))
    assert code == 2 and "is no file of an instrument" in err
    assert "there is no file 'none.yaml'" in command("none.yaml")[2]


def test_what_a_star_camera_sees():
    sheet = instrument_sheets.sheet("rigel_l")
    assert sheet.compared["field of view"] == "21.9 x 21.9 deg"  # SSTL says 22.6 deg
    assert sheet.computed["star of magnitude 0"].startswith(sheet.compared["magnitude 0"])


def test_the_faintest_star_by_drawing_its_pixels():
    """Signal over noise of the sum of 3 x 3 pixels, drawn: 5."""
    optics = SimpleNamespace(psf_sigma=0.8)
    detector = SimpleNamespace(background=400.0, read_noise=16.0)
    faintest, rng = instrument_sheets.faintest_magnitude(2.5e6, optics, detector), np.random.default_rng(5)
    charge = 2.5e6 * 10.0 ** (-0.4 * faintest) * instrument_sheets.EXPOSURE_S
    places = rng.normal(0.0, optics.psf_sigma, (200_000, 2))  # of its electrons
    share = np.mean(np.all(np.abs(places) < 1.5, axis=1))
    dark = rng.poisson(20.0, (50_000, 9)) + rng.normal(0.0, 16.0, (50_000, 9))
    total = rng.poisson(charge * share, 50_000) + dark.sum(axis=1)
    assert (total.mean() - dark.sum(axis=1).mean()) / total.std() == pytest.approx(5.0, rel=0.02)


def test_what_imus_are_compared_by_is_what_a_scenario_gets():
    for name in ("kvh_1750", "ln_200s"):
        gyro = load("shefex2_andoya", [f"imu.use={name}"]).imu.gyro
        number = float(instrument_sheets.sheet(name).compared["gyro random walk"].split()[0].strip("*"))
        assert math.radians(number) / 60.0 == pytest.approx(gyro.random_walk)
