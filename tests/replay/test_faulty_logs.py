"""A flight with every fault of an IMU, from its first block on, run again and smoothed afterwards."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import shefex_nav
from shefex_nav.replay import rerun, smooth
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
FAULTS = """[
    {fault: dropout, from: -10 s, until: -9.9 s},
    {fault: dropout, from: 1 s, until: 1.1 s},
    {fault: repeat, from: 2 s, until: 2.05 s},
    {fault: stuck, sensor: gyro, axis: y, from: 3 s, until: 4 s},
    {fault: dead, sensor: accelerometer, axis: x, from: 5 s, until: 6 s},
]"""
BEGIN_S, NOTICED_S = (-10.0, 1.0, 2.0, 3.0, 5.0), 0.2


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("faulty") / "run.mcap"
    scenario = shefex_nav.Scenario.load(SCENARIO, [f"faults.imu={' '.join(FAULTS.split())}"])
    shefex_nav.fly(scenario, seed=1, until_s=8.0, log=path)
    return path


@pytest.fixture(scope="module")
def recording(log):
    return rerun.open_log(log)


def test_run_again_is_what_flew(recording):
    flown = recording.data
    again = [record for record in rerun.records(recording) if type(record).__name__ == "NavSolution"]
    assert (~flown.imu.valid).sum() == 20
    assert np.array_equal([record.r_i for record in again], flown.nav.r_i)
    assert np.array_equal([record.q_ib for record in again], flown.nav.q_ib)


def test_smoothed_it_is_whole_and_honest(recording):
    """Of nine degrees of freedom; one flight has one draw, so that only the far end of chi-square is refused.

    For as long as it takes to notice a fault, 0.2 s, the error is in nobody's covariance.
    """
    smoothed = smooth.run(recording).smoothed
    assert np.isfinite(smoothed.nav.r_i).all() and np.isfinite(smoothed.covariance.P).all()
    t_s, nees, _ = normalised_errors(smoothed, navigation_errors(smoothed))
    unnoticed = np.any([(from_s < t_s) & (t_s < from_s + NOTICED_S) for from_s in BEGIN_S], axis=0)
    assert nees[~unnoticed].max() < chi2.ppf(1.0 - 1e-9, 9)
