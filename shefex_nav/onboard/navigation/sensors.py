"""The sensors that the filter listens to: how each is linearised, gated and, in the end, believed.

A new sensor is an entry of `SENSORS` and a function that linearises it. What arrives on board may hold
several measurements: `ARRIVALS` says which.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.onboard.navigation import calibration, integrity, measurements, strapdown
from shefex_nav.onboard.navigation.state import ReleaseRule


class Trial(NamedTuple):
    """What decides whether a sensor that contradicts the filter is believed after all."""

    rule: ReleaseRule
    evidence: Any  # what is kept of the fix if it is rejected
    agree: Callable  # (earlier evidence, this evidence) -> bool


class Sensor(NamedTuple):
    """One measurement."""

    # (nav, state, imu, at_s, fix) -> z (m,), H (m, n), R (m, m); the same rows at every call with one fix.
    # nav : fusion.Filter; state : NavState of the instant; imu : ImuWindow; at_s : s from its start
    linearise: Callable
    block: str  # of the layout, which a reset forgets
    forgotten: float  # standard deviation that says nothing, in the units of the block
    # (nav, state, P, z, R, imu, at_s, fix) -> Trial
    trial: Callable
    with_it: tuple[str, ...] = ()  # blocks that a reset takes back to what was known at the start
    rows: int = 0  # rows gated together, whose noise must not be tied to that of others; 0: all
    labels: Callable | None = None  # fix -> name of each group of rows, for notes
    reset_note: str = "reset after timeout"


def _gps_position(nav, state, imu, at_s, fix):
    felt = strapdown.felt(state, imu, at_s)
    return measurements.gps_position(nav.layout, state, fix, nav.earth, nav.params.l_ba_b, *felt)


def _gps_velocity(nav, state, imu, at_s, fix):
    felt = strapdown.felt(state, imu, at_s)
    z, H, R = measurements.gps_velocity(nav.layout, state, fix, nav.earth, nav.params.l_ba_b, *felt)
    return z, H, R + vibration_covariance(nav.params, imu)


def _star_attitude(nav, state, imu, at_s, fix):
    params = nav.params
    return measurements.star_attitude(nav.layout, state, fix, params.C_bc, params.star_sigma_floor)


def vibration_covariance(params, imu):
    """What vibration puts between the strapdown's antenna velocity and the vehicle's: (3, 3) m^2/s^2.

    The velocity of the sensors, and the rate of one sample (change of a swinging angle in dt) times the
    lever arm.
    """
    model = params.imu
    rate2 = 2.0 * (model.gyro_vibration / imu.dt_s) ** 2
    variance = model.accel_vibration**2 + rate2 * (params.l_ba_b @ params.l_ba_b)
    return imu.vibration**2 * variance * np.eye(3)


def _gps_trial(nav, state, P, z, R, imu, at_s, fix):
    slack = nav.params.gps_agreement

    def agree(earlier, later):
        return integrity.gps_fixes_agree(earlier, later, slack)

    return Trial(nav.params.release_gps, fix, agree)


def _star_trial(nav, state, P, z, R, imu, at_s, fix):
    params = nav.params
    used = nav.health["star_tracker"].used
    rule = params.release_star if used else params.release_star_first
    P_rate = rate_covariance(nav.layout, state, P, *strapdown.felt(state, imu, at_s))
    limit = nav.limit(3)

    def agree(earlier, later):
        return integrity.star_fixes_agree(earlier, later, P_rate, limit)

    return Trial(rule, integrity.star_evidence(state, z, R), agree)


def never(nav, state, P, z, R, imu, at_s, fix):
    """Trial of a sensor that is never believed against the gate."""
    return Trial(ReleaseRule(np.inf, np.inf), None, None)


def rate_covariance(layout, state, P, omega_b, f_b):
    """Covariance of the corrected rate by the estimates of the gyro errors: (3, 3) rad^2/s^2."""
    J_omega, _ = calibration.jacobians(layout, state, omega_b, f_b)
    return J_omega @ P @ J_omega.T


SENSORS = {
    "gps_position": Sensor(_gps_position, "position", 1e5, _gps_trial),
    "gps_velocity": Sensor(_gps_velocity, "velocity", 1e4, _gps_trial),
    "star_tracker": Sensor(
        _star_attitude,
        "attitude",
        np.pi,
        _star_trial,
        with_it=("mounting",),  # whatever misled the attitude has misled the mounting too
        reset_note="attitude reset",
    ),
}
ARRIVALS = {"gps": ("gps_position", "gps_velocity"), "star_tracker": ("star_tracker",)}


def without_solution(arrival, fix):
    """Why a fix holds no measurement, '' if it does."""
    return f"no fix: {fix.reason}" if arrival == "gps" and not fix.valid else ""
