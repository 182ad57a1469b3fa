"""Thrust in vacuum of a motor, from any of the forms in which a scenario may give it."""

from itertools import pairwise
from typing import NamedTuple

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.scenario.vehicle import ShapedMotor

SEA_LEVEL = 101325.0  # Pa, US Standard Atmosphere 1976


class Curve(NamedTuple):
    """Thrust in vacuum over the time since ignition, a broken line."""

    t_s: list
    thrust_n: list
    exhaust_speed: float  # m/s, thrust per mass flow


def burn_time(motor):
    """s, from ignition to the end of the thrust."""
    return motor.burn_time if isinstance(motor, ShapedMotor) else motor.thrust.time[-1]


def vacuum_curve(motor, propellant_mass):
    """Curve of a motor that burns propellant_mass kg.

    Its area is propellant mass times exhaust speed, exactly: a table is scaled to the specific impulse if
    one is given (`checks` lets two percent pass), and gives the exhaust speed if not. Thrust measured at sea
    level lacks what the air's pressure takes from the nozzle exit, 101325 Pa times its area, while it burns,
    that is, wherever there is thrust. A thrust factor changes thrust and exhaust speed alike.
    """
    if isinstance(motor, ShapedMotor):
        t_s, shape = _shape(motor)
    else:
        t_s, shape = list(motor.thrust.time), vacuum_force(motor)
    impulse = area(t_s, shape)
    if motor.specific_impulse is None:
        exhaust_speed = impulse / propellant_mass
    else:
        exhaust_speed = motor.specific_impulse * STANDARD_GRAVITY
    scale = motor.thrust_factor * propellant_mass * exhaust_speed / impulse
    return Curve(t_s, [scale * force for force in shape], motor.thrust_factor * exhaust_speed)


def vacuum_force(motor):
    """Forces of a thrust table, N, in vacuum."""
    if motor.measured_at == "vacuum":
        return list(motor.thrust.force)
    lost = SEA_LEVEL * motor.exit_area
    return [force + lost if force > 0.0 else 0.0 for force in motor.thrust.force]


def area(t_s, force):
    """Impulse of a broken line."""
    return sum(0.5 * (a + b) * (t_b - t_a) for (t_a, a), (t_b, b) in pairwise(zip(t_s, force, strict=True)))


def _shape(motor):
    """Corners of rise, slow decline and tail-off; thrust at them relative to that after the rise."""
    t_s = [0.0, motor.rise, motor.burn_time - motor.tail_off, motor.burn_time]
    return t_s, [0.0, 1.0, motor.level_ratio, 0.0]
