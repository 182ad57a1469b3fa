"""Sections of a scenario about what turns, steers and slows the vehicle besides its motors.

Values are floats in SI and radians once loaded. All times count from lift-off.
"""

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Quantity, Time, Vector


class SpinMotors(Block):
    """Small motors that turn the vehicle about its roll axis."""

    at: Time("384 s", "ignition")
    duration: Quantity("s", "2 s", "how long they burn", positive=True)
    torque: Quantity("N m", "200 N m", "about the roll axis; positive: positive roll rate")


class YoYo(Block):
    """Two masses on cords, wound around the vehicle, that take its spin away."""

    at: Time("219 s", "release")
    mass: Quantity("kg", "2 kg", "both masses together, not part of the payload's mass", positive=True)
    cord_length: Quantity("m", "5 m", "of each", positive=True)
    radius: Quantity("m", "0.5 m", "of the vehicle where they are wound up", positive=True)


class AttitudeReference(Block):
    """Errors of the attitude by which the cold-gas system steers; the filter does not steer. 1 sigma."""

    misalignment: Quantity("rad", "0.2 deg", "about each axis, constant", non_negative=True)
    drift: Quantity("rad/s", "10 deg/h", "about each axis", non_negative=True)
    roll_scale_factor: Quantity("", "100 ppm", "of the roll rate", non_negative=True)


class ColdGas(Block):
    """Attitude control by cold gas: pairs of valves that are open or shut and give pure couples."""

    torque: Vector("N m", "60 N m", "of an open pair, about x, y, z", positive=True)
    arm: Vector("m", "2 m", "torque over thrust of a pair, about x, y, z", positive=True)
    specific_impulse: Quantity("s", "68 s", "of the gas", positive=True)
    propellant: Quantity(
        "kg", "8 kg", "gas in the tank, part of the payload's mass, which stays as it is", positive=True
    )
    period: Quantity(
        "s", "20 ms", "of the controller; the shortest opening", at_least="2.5 ms", at_most="1 s"
    )
    dead_band_angle: Vector("rad", "0.2 deg", "errors that are left alone, about x, y, z", non_negative=True)
    dead_band_rate: Vector("rad/s", "0.1 deg/s", "rates that are left alone", non_negative=True)
    bandwidth: Quantity("rad/s", "1 rad/s", "of the control loop", positive=True, at_most="100 rad/s")
    reference: AttitudeReference


class Parachute(Block):
    """A parachute; opens on the way down through a height, or at a time."""

    height: Quantity("m", "5 km", "above the ellipsoid, on the way down", positive=True) | None = None
    at: Time("300 s", "when it opens, if not by its height") | None = None
    drag_area: Quantity("m2", "12 m2", "drag coefficient times area when it is full", positive=True)
    inflation: Quantity("s", "2 s", "time in which it fills", positive=True)
    station: Quantity("m", "1.5 m", "where its lines are fixed", non_negative=True)
