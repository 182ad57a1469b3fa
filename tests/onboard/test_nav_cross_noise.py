"""Noise that stands for scale factors and misalignments of the gyros, against turns in which they act.

The truth here is a turn integrated step by step: every error of a triad by itself, added up in inertial axes.
"""

import numpy as np
import pytest
from navigation_flight import PARAMS

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import error_model, process_noise
from shefex_nav.onboard.navigation.blocks import Beforehand
from shefex_nav.onboard.navigation.state import ImuModel
from shefex_nav.scenario import params_filter

SCALE, MISALIGNED = 1e-4, 5e-5
OFF_ROLL = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # what roll meets has states
SIGMAS = MISALIGNED * OFF_ROLL + SCALE * np.diag([0.0, 1.0, 1.0])


def variance(roll_rate, across_rate, angle, fixed=False):
    """Variance of the attitude error about each body axis at the end of a turn of the roll axis by `angle`.

    roll_rate, across_rate : rad/s, the latter about one axis of inertial space, or (fixed) of the body
    """
    n = max(2000, int(20.0 * roll_rate * angle / across_rate))
    dt_s, C = angle / across_rate / n, np.eye(3)
    psi = np.zeros((3, 3, 3))  # inertial axes, by error ij of the triad
    for k in range(n):
        phase = 0.0 if fixed else roll_rate * (k + 0.5) * dt_s
        omega = np.array([roll_rate, across_rate * np.cos(phase), -across_rate * np.sin(phase)])
        middle = C @ rotation.dcm_from_rotvec(0.5 * dt_s * omega)
        psi += dt_s * middle[:, :, None] * omega
        C = C @ rotation.dcm_from_rotvec(dt_s * omega)
    ends = np.einsum("ji,jkl->ikl", C, psi)
    return ((ends * SIGMAS) ** 2).sum(axis=(1, 2))


def assumed(roll_rate, across_rate, angle):
    """Variance that the filter gathers in the same time: about the roll axis, about each of the others."""
    cross2 = (SCALE**2 + 2.0 * MISALIGNED**2) / 3.0
    model = ImuModel(**dict.fromkeys(ImuModel._fields, 0.0))._replace(
        gyro_cross=np.sqrt(cross2),
        spun_along=MISALIGNED**2 / cross2,
        spun_across=0.25 * (SCALE**2 + MISALIGNED**2) / cross2,
        manoeuvre_angle=1.0,
        thrust_time_s=20.0,
    )
    record = error_model.record(PARAMS._replace(imu=model))
    densities = _densities(record, (0.01 * roll_rate, 0.01 * across_rate, 0.0))
    return np.array(densities) * angle / across_rate


@kernel
def _densities(record, dtheta):
    zero = (0.0, 0.0, 0.0)
    along, across, _ = process_noise.densities(record[0], 0.0, 1.0, 0.01, 0.01, dtheta, zero, zero[:2])
    return along[0], across[0]


def test_a_turn_without_roll():
    """Trace of the three axes: which of them turns is not known beforehand."""
    along, across = assumed(0.0, 0.04, 1.0)
    assert along + 2.0 * across == pytest.approx(variance(0.0, 0.04, 1.0).sum(), rel=0.03)


@pytest.mark.parametrize("roll_rate", [1.0, 9.4])
def test_a_turn_while_spinning(roll_rate):
    """Both axes across together; the roll axis has hardly any and the filter never less than it needs."""
    true = variance(roll_rate, 0.04, 1.0)
    along, across = assumed(roll_rate, 0.04, 1.0)
    assert 0.95 < 2.0 * across / true[1:].sum() < 1.15
    assert along > true[0]
    everywhere = assumed(0.0, 0.04, 1.0)
    assert along < 0.6 * everywhere[0] and across < 0.7 * everywhere[1]


def test_rolling_about_an_axis_beside_the_roll_axis():
    """The rate across stays in the body, as of a vehicle out of balance: errors about roll add up."""
    true = variance(9.4, 0.02, 1.0, fixed=True)
    along, across = assumed(9.4, 0.02, 1.0)
    assert along == pytest.approx(true[0], rel=0.02)
    assert across > true[1:].max()


@pytest.mark.parametrize("roll_rate", [0.005, 0.02, 0.05, 0.2])
def test_in_between_it_is_neither_far_too_small_nor_far_too_large(roll_rate):
    along, across = assumed(roll_rate, 0.04, 1.0)
    assert 0.8 < (along + 2.0 * across) / variance(roll_rate, 0.04, 1.0).sum() < 1.5


def test_the_shares_are_those_of_the_scenario():
    """imu_model of a scenario whose gyros have these errors."""
    from pathlib import Path

    from shefex_nav.scenario import load

    scenario = load.load(str(Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"))
    gyro = scenario.imu.gyro
    told = Beforehand(gyro, scenario.imu.accelerometer, gyro.scale_factor_roll, gyro.misalignment)
    model = params_filter.imu_model(scenario, told)
    assert (gyro.scale_factor, gyro.misalignment) == pytest.approx((SCALE, MISALIGNED))
    assert model.gyro_cross**2 * model.spun_along == pytest.approx(MISALIGNED**2)
    assert model.gyro_cross**2 * model.spun_across == pytest.approx((SCALE**2 + MISALIGNED**2) / 4.0)
