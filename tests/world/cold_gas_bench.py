"""A rigid body in space and the cold-gas control in a closed loop, without the flight around them."""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.world.flight import attitude_program, control
from shefex_nav.world.flight.settings import AttitudeReference, ColdGas

DEG = np.pi / 180.0

COLD_GAS = ColdGas(
    torque=(5.0, 60.0, 60.0),
    arm=(0.5, 2.0, 2.0),
    specific_impulse=68.0,
    propellant=8.0,
    period=0.02,
    dead_band_angle=(0.3 * DEG, 0.2 * DEG, 0.2 * DEG),
    dead_band_rate=(0.15 * DEG, 0.1 * DEG, 0.1 * DEG),
    bandwidth=0.5,
    reference=AttitudeReference(misalignment=0.2 * DEG, drift=10.0 * DEG / 3600.0, roll_scale_factor=20e-6),
)
STACK = np.array([177.0, 3100.0, 3100.0])  # kg m^2, second stage full
EMPTY = np.array([68.0, 1690.0, 1690.0])  # and burnt out


class Run(NamedTuple):
    """What happened, sampled at the ticks."""

    t_s: np.ndarray  # (M,)
    q_ib: np.ndarray  # (M, 4)
    omega_b: np.ndarray  # (M, 3) rad/s
    error: np.ndarray  # (M, 3) rad
    torque: np.ndarray  # (M, 3) N m
    gas_kg: float  # used in this run

    def firings(self, axis):
        """How often a valve of an axis opens."""
        on = self.torque[:, axis] != 0.0
        return int(on[0]) + int((on[1:] & ~on[:-1]).sum())


@kernel
def _rates(x, torque, inertia):
    p, q, r = x[10], x[11], x[12]
    out = np.zeros(7)
    out[:4] = 0.5 * rotation.quat_multiply(x[6:10].copy(), np.array([0.0, p, q, r]))
    out[4] = (torque[0] - (inertia[2] - inertia[1]) * q * r) / inertia[0]
    out[5] = (torque[1] - (inertia[0] - inertia[2]) * r * p) / inertia[1]
    out[6] = (torque[2] - (inertia[1] - inertia[0]) * p * q) / inertia[2]
    return out


@kernel
def _fly(x, law, n, inertia, states):
    """n periods of Euler's equations under the valves' torque; x (19,) in place, eight steps a period."""
    h = law.period / 8.0
    for k in range(n):
        control.command(law, law.next_s[0], x, inertia[0], inertia[1], inertia[2])
        states[k] = x
        for _ in range(8):
            y = x.copy()
            k1 = _rates(y, law.torque, inertia)
            y[6:13] = x[6:13] + 0.5 * h * k1
            k2 = _rates(y, law.torque, inertia)
            y[6:13] = x[6:13] + 0.5 * h * k2
            k3 = _rates(y, law.torque, inertia)
            y[6:13] = x[6:13] + h * k3
            x[6:13] += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + _rates(y, law.torque, inertia))
            x[6:10] /= np.sqrt((x[6:10] ** 2).sum())


def state(q_ib=(1.0, 0.0, 0.0, 0.0), omega_b=(0.0, 0.0, 0.0)):
    """(19,) state of a body in space."""
    x = np.zeros(19)
    x[6:10], x[10:13] = q_ib, omega_b
    return x


def steer(x, law, follow, inertia, seconds, cold_gas=COLD_GAS, q_wanted=None, rng=None):
    """Fly a `RateLaw` from its start for some seconds, (19,) x in place -> Run."""
    n = round(seconds / cold_gas.period)
    steering = control.start(cold_gas, rng, n)._replace(follow=follow, law=law)
    steering.next_s[0] = steering.clock[0] = law.t_0
    steering.q_wanted[:] = control.estimated_attitude(steering, x[6:10]) if q_wanted is None else q_wanted
    control.settle(steering, np.array([[x[10], 0.0, 0.0]]))  # as after a long coast
    states = np.empty((n, 19))
    _fly(x, steering, n, np.asarray(inertia, dtype=float), states)
    h = steering.history
    return Run(h[:, 0], states[:, 6:10], states[:, 10:13], h[:, 1:4], h[:, 4:7], steering.propellant[0])


def still(t_0, t_1):
    """Law of an attitude that is held."""
    return attitude_program.hold(t_0, t_1, 0.0)
