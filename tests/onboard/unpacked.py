"""Single steps of the on-board software with NavState and ImuBlock in and out, for tests.

Everything here packs, calls what flies (`prediction`, `strapdown.propagate`, `eskf.update_packed`, ...) and
unpacks; the reference of the covariance, filterpy's prediction, is the only arithmetic that does not fly.
"""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.onboard.navigation import error_model, eskf, measurements, prediction, strapdown
from shefex_nav.onboard.navigation.blocks import WEIGHTS
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.state import (
    X_Q,
    X_R,
    X_V,
    ImuModel,
    NavState,
    corrected,
    layout,
    pack,
    unpack,
)
from shefex_nav.onboard.navigation.strapdown import BEFORE, NO_EXTRA

CORE = layout(())
QUIET = ImuModel(**dict.fromkeys(ImuModel._fields, 0.0))._replace(
    thrust_time_s=30.0, gravity_time_s=50.0, spun_along=1.0, spun_across=1.0
)
FIXED_EARTH = EarthRotation(np.eye(3), np.eye(3), 0.0, 0.0)
FALLING = pack(
    NavState(0.0, np.array([7e6, 0, 0]), np.zeros(3), np.array([1.0, 0, 0, 0]), *[np.zeros(3)] * 4)
)
NO_P = np.zeros((CORE.n, CORE.n))


def noise_of(model):
    """What kernels take for an ImuModel alone."""
    receiver = {"clock_white": 0.0, "clock_walk": 0.0, "range_bias_sigma": 0.0, "range_bias_time_s": np.inf}
    return error_model.record(SimpleNamespace(imu=model, gravity_error=0.0, **receiver))


NO_NOISE = noise_of(QUIET)


def window(block, before=None, vibration=0.0, extra=NO_EXTRA):
    """ImuWindow of an ImuBlock behind the window before it, as `prediction.enter` leaves it in a History."""
    n, end_s = len(block.dtheta_b), block.t_valid_s
    history = History(Tick(end_s - n * block.dt_s, FALLING, NO_P, before))
    place = history.make_room(n)
    history.increments[place, BEFORE : BEFORE + n] = np.hstack([block.dtheta_b, block.dv_b])
    history.extra[place] = extra
    motors = np.zeros((0, 2))
    constants = prediction.constants(CORE, NO_NOISE, FIXED_EARTH)
    prediction.enter(constants, history.arrays, 1, motors, end_s, block.dt_s, n)
    history.extend([end_s])
    return history.imu(-1)._replace(vibration=vibration)


def propagate(state, imu, begin_s, end_s, earth):
    """The state after the part begin_s ... end_s of a window, by `prediction.propagate`.

    NavState at begin_s, ImuWindow, s from its start, EarthRotation -> r_i, v_i, q_ib
    """
    constants = prediction.constants(CORE, NO_NOISE, earth)
    x, _ = prediction.advance(constants, pack(state), state.t_s, NO_P, imu, begin_s, end_s)
    return x[X_R], x[X_V], x[X_Q]


def integrate(state, imu, begin_s, end_s, g_i):
    """`propagate` under a given gravitation (3,) m/s^2, by `strapdown.propagate`."""
    x, none = pack(state), np.zeros(WEIGHTS, dtype=bool)
    nothing = error_model.Responses(none, none, np.empty((0, 3, 3, 3)), np.empty((0, 2, 3, 3)))
    strapdown.propagate(x, imu, begin_s, end_s, tuple(g_i), nothing)
    return x[X_R], x[X_V], x[X_Q]


def felt(state, imu, at_s):
    """Corrected rate and specific force, (3,) rad/s, (3,) m/s^2: means of the sample in which at_s lies."""
    how = imu.increments, imu.n, imu.dt_s, imu.vibration, imu.drive
    found = strapdown.sensed_packed(pack(state), *how, at_s)
    return found[:3], found[3:]


def correct(order, state, dx):
    """truth = estimate (+) error. Layout, NavState, (n,) -> NavState"""
    return unpack(state.t_s, corrected(pack(state), np.asarray(dx, dtype=float), order.nominal))


class Corrected(NamedTuple):
    """What an update made of the state."""

    state: NavState
    P: np.ndarray  # (n, n)
    dx: np.ndarray  # (n,) the estimated error that was taken into the state
    G: np.ndarray  # (3, 3) by which the attitude error was turned into the new body axes


def update(kalman, order, state, P, z, H, R, turns=True):
    """`eskf.update_packed`. -> Corrected"""
    x, P_after = pack(state), np.empty(P.shape)
    dx, G = eskf.update_packed(kalman, order, P, (z, H, R), x, P_after, turns=turns)
    return Corrected(unpack(state.t_s, x), P_after, dx, G)


def predict(order, P, Phi, Q):
    """Phi P Phi^T + Q by filterpy, exactly symmetric: what `prediction` is held against."""
    kalman = eskf.engine(order)
    kalman.P = P
    kalman.predict(F=Phi, Q=Q)
    return 0.5 * (kalman.P + kalman.P.T)


def star_attitude(order, state, fix, C_bc, sigma_floor):
    """`measurements.star_attitude`. -> z, H, R"""
    return measurements.star_attitude(order, pack(state), fix, C_bc, sigma_floor)


def tick(software, block, arrived):
    """A tick of a driving.Software: on with one ImuBlock, and what has arrived. -> records"""
    rows = type(block)(*(np.array([field]) for field in block))
    made, _ = software.advance(rows, 0, 1)
    assert made == 1
    return software.update(arrived)
