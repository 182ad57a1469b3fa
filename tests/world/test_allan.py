"""Allan deviation of every IMU of the package, drawn: random walk and floor of the data sheet."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.scenario import instruments
from shefex_nav.scenario.load import load, load_as
from shefex_nav.scenario.of_settings import settings
from shefex_nav.settings import changed
from shefex_nav.world import allan

IMUS = [one.name for one in instruments.listed() if one.instrument == "imu"]
TRIADS = {"gyro": 0, "accelerometer": 1}
TIMES = 50  # length of a series over its longest averaging time, at least


@pytest.fixture
def series_of(monkeypatch):
    """The module that draws series of a unit at rest."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    return importlib.import_module("allan")


def unit(name):
    """settings.Imu of an instrument of the package."""
    return settings(load("shefex2_andoya", [f"imu.use={name}"]).imu)


@pytest.mark.parametrize("name", IMUS)
def test_random_walk_and_floor_are_those_of_the_file(series_of, name):
    """Random walk within 5 %, floor within 25 % of what the file says the data sheet has, 3 axes together."""
    file, _, _ = load_as(lambda provided: instruments.SECTIONS["imu",], instruments.files()[name])
    own, rng = unit(name), np.random.default_rng(7)
    for triad, column in TRIADS.items():
        part = getattr(own, triad)
        lowest, at_s = allan.floor(part)
        longest_s, dt_s = min(1.5 * at_s, allan.PEAK * part.in_run_bias_time), at_s / 40.0
        n = int(np.ceil(2.0 * TIMES * longest_s / dt_s))
        series = series_of.at_rest(own, n, dt_s, rng)[column]
        tau_s, found = series_of.measured(series, dt_s, np.geomspace(dt_s, longest_s, 30))
        assert n * dt_s >= TIMES * tau_s[-1]
        curve = np.sqrt(np.mean(found**2, axis=1))
        assert curve[0] * np.sqrt(tau_s[0]) == pytest.approx(part.random_walk, rel=0.05)
        sheet = getattr(file.floor, triad)
        assert curve.min() == pytest.approx(sheet or lowest, rel=0.25)
        if sheet:
            assert lowest == pytest.approx(sheet, rel=0.05)


def test_a_series_has_the_deviation_of_the_formula(series_of):
    """Also beyond the floor, where a Gauss-Markov bias rises and falls again, and with coarse quanta.

    Quanta are not much larger than what the noise makes of one sample: so their rest is even and unrelated.
    """
    own, rng = unit("mpu_6050"), np.random.default_rng(3)
    for quantum in (0.0, 2.0 * own.gyro.random_walk):
        coarse = changed(own, {"gyro.quantum": quantum})
        series = series_of.at_rest(coarse, 400_000, 2.0, rng)[0]
        tau_s, found = series_of.measured(series, 2.0, [2.0, 8.0, 40.0, 200.0, 570.0, 3000.0])
        curve, expected = np.sqrt(np.mean(found**2, axis=1)), allan.deviation(coarse.gyro, tau_s)
        np.testing.assert_allclose(curve[:3], expected[:3], rtol=0.02)
        np.testing.assert_allclose(curve[3:], expected[3:], rtol=0.08)


def test_the_curve_has_the_slopes_of_its_parts():
    """-1 for quanta, -1/2 for the random walk, +1/2, then -1/2 for the bias, peak 0.617 sigma at 1.89 T."""
    nothing = {"random_walk": 0.0, "in_run_bias": 0.0, "in_run_bias_time": 100.0, "quantum": 0.0}
    tau_s = np.array([0.01, 0.02])
    for part, slope in (("quantum", -1.0), ("random_walk", -0.5), ("in_run_bias", 0.5)):
        curve = allan.deviation(SimpleNamespace(**nothing | {part: 1.0}), tau_s)
        assert np.log2(curve[1] / curve[0]) == pytest.approx(slope, abs=1e-3)
    bias = SimpleNamespace(**nothing | {"in_run_bias": 1.0})
    tau_s = np.geomspace(1.0, 1e6, 100_001)
    curve = allan.deviation(bias, tau_s)
    assert curve.max() == pytest.approx(0.617, abs=5e-4)
    assert tau_s[np.argmax(curve)] == pytest.approx(allan.PEAK * 100.0, rel=0.01)
    assert curve[-1] * np.sqrt(tau_s[-1]) == pytest.approx(np.sqrt(2.0 * 100.0), rel=1e-3)


def test_what_the_oldest_file_calls_in_run_bias():
    """adis16470 has its data sheet's stability as sigma of the wandering bias: its floor is half of that."""
    gyro = unit("adis16470").gyro
    assert 0.4 < allan.floor(gyro)[0] / gyro.in_run_bias < 0.5
