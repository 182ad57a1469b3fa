"""Truth between its rows: a drive known at every sample is the authority for one told once a second."""

import drive
import numpy as np
import pytest
import replay_files

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import euler, rotation
from shefex_nav.replay import dataset, reference
from shefex_nav.replay.series import TruthSeries

EARTH = ephemeris.earth_rotation(replay_files.EPOCH, 0.0, 0.0, 0.0)
ROW = 100  # samples from one row of truth to the next: 1 s


@pytest.fixture(scope="module")
def driven():
    return drive.drive(EARTH, 30.0)


def told(driven, row=ROW, first=0):
    """TruthSeries of every row-th sample."""
    rows = slice(first, None, row)
    angles = np.array([euler.euler_from_dcm(C_nb) for C_nb in driven.C_nb[rows]])
    return TruthSeries(None, driven.t_s[rows], driven.r_e[rows], driven.v_e[rows], angles)


def sensed(driven, gyro_bias=0.0, accelerometer_bias=0.0):
    """Increments with constant errors, rad/s and m/s^2 on every axis."""
    step = 1.0 / drive.RATE
    dtheta_b, dv_b = driven.dtheta_b + gyro_bias * step, driven.dv_b + accelerometer_bias * step
    return dataset.Increments(driven.t_s, dtheta_b, dv_b, np.zeros(len(driven.t_s), dtype=bool))


def errors(driven, states):
    """Of position [m], velocity [m/s], attitude [rad] against what is known at every sample: three (N,)."""
    known = np.searchsorted(driven.t_s, states.t_s - 1e-6)
    every = reference.at(told(driven, 1), EARTH, driven.t_s[known])
    turn = rotation.rotvec_between(states.q_ib, every.q_ib)
    parts = states.r_i - every.r_i, states.v_i - every.v_i, turn
    return [np.linalg.norm(part, axis=1) for part in parts]


@pytest.mark.parametrize("biases", [(2e-3, 0.1), (0.05, 0.05)])
def test_a_motion_between_rows_is_that_of_the_imu(driven, biases):
    """Biases of a phone's IMU, and of a gyro with 3 deg/s, do not matter, for they last longer than a row."""
    truth = told(driven)
    imu = sensed(driven, *biases)
    lines = errors(driven, reference.at(truth, EARTH, driven.t_s))
    found = errors(driven, reference.as_felt(truth, EARTH, imu, driven.t_s))
    assert np.max(lines[1]) > 0.3 and np.degrees(np.max(lines[2])) > 1.0  # the family is no trivial one
    for line, one, share in zip(lines, found, (0.2, 0.02, 0.02), strict=True):
        assert np.max(one) < share * np.max(line)


def test_rows_between_samples_are_met_as_well(driven):
    """Rows of another clock lie within samples: states there are made of the same motion."""
    shifted = told(driven, ROW, 37)
    imu = sensed(driven)
    sums = [np.vstack([one[:1], one[1:].reshape(-1, 4, 3).sum(axis=1)]) for one in (imu.dtheta_b, imu.dv_b)]
    coarse = dataset.Increments(imu.t_s[::4], *sums, imu.bridged[::4])
    found = errors(driven, reference.as_felt(shifted, EARTH, coarse, coarse.t_s))
    lines = errors(driven, reference.at(shifted, EARTH, coarse.t_s))
    assert np.max(found[1]) < 0.1 * np.max(lines[1])


def test_the_rows_themselves_stay(driven):
    truth = told(driven)
    found = errors(driven, reference.as_felt(truth, EARTH, sensed(driven), truth.t_s))
    assert np.max(found[0]) < 1e-6 and np.max(found[1]) < 1e-9 and np.max(found[2]) < 1e-9


@pytest.mark.parametrize("fault", ["force", "turn", "gap"])
def test_what_is_no_motion_is_not_taken(driven, fault):
    """A spike would be an error that navigation and truth share: nothing is bent between its rows."""
    truth, imu, at = told(driven), sensed(driven), 1234
    if fault == "force":
        imu.dv_b[at] += [0.0, 30.0, 0.0]
    elif fault == "turn":
        imu.dtheta_b[at] += [0.0, 0.3, 0.0]
    else:
        imu.bridged[at] = True
    plain, found = reference.at(truth, EARTH, driven.t_s), reference.as_felt(truth, EARTH, imu, driven.t_s)
    there = (driven.t_s > 12.0) & (driven.t_s < 13.0)
    for one, other in zip(plain, found, strict=True):
        np.testing.assert_array_equal(one[there], other[there])
    assert np.max(errors(driven, found)[1][~there]) < 0.02


def test_truth_at_every_sample_is_left_as_it_is(driven):
    truth = told(driven, 1)
    plain, found = (
        reference.at(truth, EARTH, driven.t_s),
        reference.as_felt(truth, EARTH, sensed(driven), driven.t_s),
    )
    for one, other in zip(plain, found, strict=True):
        np.testing.assert_array_equal(one, other)
