"""Every kind of fault that a scenario knows: logged, run again from the log, told in short, smoothed."""

from pathlib import Path

import numpy as np
import pytest
from fault_kinds import GPS, IMU, STARS

import shefex_nav
from shefex_nav import prepare, simulate
from shefex_nav.onboard.navigator import Columns
from shefex_nav.records import NavCovariance, NavSolution
from shefex_nav.replay import rerun, smooth
from shefex_nav.scenario import load

NIGHT = (
    Path(__file__).parents[2] / "scenarios" / "night_sky.yaml"
)  # at rest under stars, frames from the start
END_S = 5.0
BRIEFLY = (
    f"mission.time_limit={END_S} s",
    f"star_tracker.off={END_S} s",
    "gps.outages=[]",
    "star_tracker.rate=5 Hz",
)
FAULTS = {
    "stuck": ("imu", "sensor: gyro, axis: y"),
    "dead": ("imu", "sensor: accelerometer, axis: x"),
    "dropout": ("imu", ""),
    "repeat": ("imu", ""),
    "gyro_bias": ("imu", "axis: z, rate: 0.5 deg/s"),
    "gyro_scale": ("imu", "axis: x, factor: 5 %"),
    "accelerometer_bias": ("imu", "axis: x, acceleration: 50 mgee"),
    "accelerometer_scale": ("imu", "axis: z, factor: -5 %"),
    "outage": ("gps", ""),
    "freeze": ("gps", "time: stands"),
    "jump": ("gps", "position: [300 m, 0 m, 0 m]"),
    "drift": ("gps", "rate: [2 m/s, 0 m/s, 0 m/s], velocity_too: true"),
    "delay": ("gps", "by: 0.3 s, time: late"),
    "bias": ("star_tracker", "angles: [0.1 deg, 0 deg, 0.2 deg]"),
    "wrong_fixes": ("star_tracker", "every: 2, smallest: 0.5 deg, largest: 180 deg"),
    "blinded": ("star_tracker", ""),
}
FROM_S, UNTIL_S = 1.513, 3.521  # neither on a tick nor on a fix


def scenario_with(kind):
    device, more = FAULTS[kind]
    fault = f"{{fault: {kind}, from: {FROM_S} s, until: {UNTIL_S} s{', ' if more else ''}{more}}}"
    return load.load(NIGHT, (*BRIEFLY, f"faults.{device}=[{fault}]"))


def test_no_kind_is_left_out():
    assert {*IMU, *GPS, *STARS} == set(FAULTS)


@pytest.fixture(scope="module")
def healthy():
    """NavSolution of the flight without a fault."""
    return shefex_nav.fly(load.load(NIGHT, BRIEFLY), seed=1).data.nav


@pytest.mark.parametrize("kind", FAULTS)
def test_a_flight_with_it_is_the_same_from_its_log_and_can_be_smoothed(kind, healthy, tmp_path):
    """The same to the last bit, from the log and as columns at a tenth of the rate; smoothed it is whole."""
    scenario = scenario_with(kind)
    flown = shefex_nav.fly(scenario, seed=1, log=tmp_path / "run.mcap").data
    assert not np.array_equal(flown.nav.q_ib, healthy.q_ib)  # the fault is there
    recording = rerun.open_log(tmp_path / "run.mcap")
    again = [record for record in rerun.records(recording) if isinstance(record, NavSolution)]
    columns = Columns(10)
    rest = list(simulate.route(prepare.build_world(scenario, 1), scenario, 1, columns=columns))
    assert not {NavSolution, NavCovariance} & set(map(type, rest))
    few, covariances = columns.read()
    assert len(again) == len(flown.nav.t_s) == 100 * END_S and len(few.t_s) == 10 * END_S
    for name in NavSolution._fields:
        expected = getattr(flown.nav, name)
        assert np.array_equal([getattr(one, name) for one in again], expected, equal_nan=True), name
        assert np.array_equal(getattr(few, name), expected[9::10], equal_nan=True), name
    for name, found, expected in zip(NavCovariance._fields, covariances, flown.covariance, strict=True):
        assert np.array_equal(found, expected, equal_nan=found.dtype.kind == "f"), name
    out = smooth.run(recording).smoothed
    for name in ("r_i", "v_i", "q_ib", "sigma_r_e", "sigma_v_e", "sigma_theta_b"):
        assert np.isfinite(getattr(out.nav, name)).all(), name
    assert all(np.linalg.eigvalsh(P / np.outer(d, d))[0] > -1e-9 for P, d in scaled(out.covariance.P))


def scaled(covariances):
    """(covariance, its standard deviations) of each."""
    return [(P, np.sqrt(np.diag(P))) for P in covariances]
