"""Prediction: nominal state and covariance over parts of ticks, in one compiled call.

x <- strapdown(x),   P <- Phi P Phi^T + Q
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.onboard.navigation.error_model import process_noise, transition
from shefex_nav.onboard.navigation.state import X_CLOCK, X_RANGE, pack
from shefex_nav.onboard.navigation.strapdown import propagate_packed


class Growth(NamedTuple):
    """How the errors went over an interval."""

    Phi: np.ndarray  # (n, n)
    Q: np.ndarray  # (n, n)


def growth(layout, model, state, imu, begin_s, end_s, earth):
    """Transition matrix and process noise of the part begin_s ... end_s of a tick.

    Parameters
    ----------
    layout : Layout
    model : `error_model.record`
    state : NavState at begin_s
    imu : ImuWindow
    begin_s, end_s : s from the start of the window
    earth : EarthRotation

    Returns
    -------
    Growth
    """
    x = pack(state)
    arguments = (imu.increments, imu.dt_s, imu.saturated, imu.vibration, imu.extra, begin_s, end_s)
    return Growth(*_growth(layout.at, layout.n, model, x, state.t_s, *arguments, *earth)[1:])


def advance(layout, model, x, t_s, P, imu, begin_s, end_s, earth):
    """State and covariance after the part begin_s ... end_s of a tick.

    As `growth`, with the packed nominal state x (87,) at begin_s, mission time t_s, and its covariance
    P (n, n) -> x (87,), P (n, n)
    """
    arguments = (imu.increments, imu.dt_s, imu.saturated, imu.vibration, imu.extra, begin_s, end_s)
    return _advance(layout.at, layout.n, model, x, t_s, P, *arguments, *earth)


@njit(cache=True)
def _carry_receiver(model, x, pieces):
    """Take clock and range errors of the receiver along, in place."""
    total_s = 0.0
    for k in range(pieces.n):
        total_s += pieces.dt_s[k]
    x[X_CLOCK] += total_s * x[X_CLOCK + 1]
    x[X_RANGE] *= np.exp(-total_s / model.range_bias_time_s)


@njit(cache=True)
def _growth(
    at,
    n,
    model,
    x,
    t_s,
    increments,
    dt_s,
    saturated,
    vibration,
    extra,
    begin_s,
    end_s,
    C_iq,
    C_re,
    angle_0,
    rate,
):
    moved, pieces = propagate_packed(x, t_s, increments, dt_s, begin_s, end_s, C_iq, C_re, angle_0, rate)
    after = x.copy()
    after[:10] = moved
    _carry_receiver(model[0], after, pieces)
    Phi = transition(model, pieces, x, moved[6:], at, n)
    return after, Phi, process_noise(model[0], saturated, vibration, extra, pieces, Phi, at)


@njit(cache=True)
def _advance(
    at, n, model, x, t_s, P, increments, dt_s, saturated, vibration, extra, begin_s, end_s,
    C_iq, C_re, angle_0, rate,
):  # fmt: skip
    after, Phi, Q = _growth(
        at, n, model, x, t_s, increments, dt_s, saturated, vibration, extra, begin_s, end_s,
        C_iq, C_re, angle_0, rate,
    )  # fmt: skip
    P_after = Phi @ P @ Phi.T + Q
    for i in range(n):
        for j in range(i):
            P_after[i, j] = P_after[j, i] = 0.5 * (P_after[i, j] + P_after[j, i])
    return after, P_after
