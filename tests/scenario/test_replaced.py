"""Another instrument by --set or --sweep: what the scenario puts on top of its own goes, and is told."""

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.report import programme
from shefex_nav.scenario import sweeps
from shefex_nav.scenario.load import load

G = 9.80665
OWN = """extends: night_sky
imu: {use: stim300, vibration: {coast: 0.5 gee}, accelerometer: {range: 80 gee}}
gps: {use: oem719, latency: 0.3 s}
star_camera: {use: prosilica_ec655, optics: {psf_sigma: 0.9 pix}}
"""
DOUBLED = "extends: own.yaml\nimu: {gyro: {bias: 7 deg/h}}\n"


@pytest.fixture
def path(tmp_path):
    """Of a scenario that puts something on top of each of its instruments."""
    (tmp_path / "own.yaml").write_text(OWN)
    (tmp_path / "doubled.yaml").write_text(DOUBLED)
    return str(tmp_path / "own.yaml")


def test_the_instrument_that_is_there_stays_as_the_scenario_has_it(path):
    base = load(path)
    assert base.imu.accelerometer.range == pytest.approx(80.0 * G) and not base.dropped
    for key, name in (("imu", "stim300"), ("gps", "oem719"), ("star_camera", "prosilica_ec655")):
        for texts in ([f"{key}.use={name}"], sweeps.overrides({f"{key}.use": name})):
            again = load(path, texts)
            assert again.model_dump() == base.model_dump() and again.source == base.source
            assert not again.dropped


@pytest.mark.parametrize(
    ("key", "name", "gone"),
    [
        ("imu", "adis16505_1", "on top of stim300: accelerometer.range 80 gee;"),
        ("gps", "zed_f9p", "on top of oem719: latency 0.3 s;"),
        ("star_camera", "imx174_25mm", "on top of prosilica_ec655: optics.psf_sigma 0.9 pix;"),
    ],
)
def test_another_instrument_comes_as_its_file_has_it(path, key, name, gone):
    for begin, texts in (
        (f"--set {key}.use", [f"{key}.use={name}", *WITH.get(key, ())]),
        (f"--sweep {key}.use={name}", [*sweeps.overrides({f"{key}.use": name}), *WITH.get(key, ())]),
    ):
        other = load(path, texts)
        plain = load("night_sky", [f"{key}.use={name}", *WITH.get(key, ())])
        assert getattr(other, key).model_dump(exclude={"vibration"}) == getattr(plain, key).model_dump(
            exclude={"vibration"}
        )
        assert other.imu.vibration == load(path).imu.vibration  # which is not the instrument's
        (said,) = other.dropped
        assert said.field == (key, "use") and gone in said.text
        assert other.line_about(*said).startswith(f"{begin}: {name} comes as its file has it")
        assert programme.foreseen(prepare.settled(other))[0] == said  # check says it


WITH = {"star_camera": ["star_tracker.detection.saturation=automatic"]}


def test_what_is_set_beside_it_is_kept(path):
    """The words of the message do what they say, in either order."""
    keep = "imu.accelerometer.range=80 gee"
    for texts in ([keep, "imu.use=adis16505_1"], ["imu.use=adis16505_1", keep]):
        assert load(path, texts).imu.accelerometer.range == pytest.approx(80.0 * G)
    assert f"--set '{keep}'" in load(path, ["imu.use=adis16505_1"]).dropped[0].text


def test_files_that_extend_each_other(path, tmp_path):
    """On top are the values of all files; a unit without a file is what the first file says of it."""
    (said,) = load(str(tmp_path / "doubled.yaml"), ["imu.use=ln_200s"]).dropped
    assert "gyro.bias 7 deg/h" in said.text and "accelerometer.range 80 gee" in said.text
    (tmp_path / "inline.yaml").write_text("extends: night_sky\nimu: {accelerometer: {range: 80 gee}}\n")
    (said,) = load(str(tmp_path / "inline.yaml"), ["imu.use=ln_200s"]).dropped
    assert "of the unit that it extends: accelerometer.range 80 gee;" in said.text
    assert not load("night_sky", ["imu.use=ln_200s"]).dropped
    assert not load("shefex2_andoya", ["imu.use=ln_200s", "gps.use=oem719"]).dropped


def test_what_the_computer_is_told(path):
    """The same of navigation.told.imu."""
    told = "navigation.told.imu={use: hg9900, gyro: {bias: 3 deg/h}}"
    same = load(path, [told])
    assert not same.dropped and np.degrees(same.navigation.told.imu.gyro.bias) * 3600.0 == pytest.approx(3.0)
