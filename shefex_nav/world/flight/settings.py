"""Settings of a flight: parts of the vehicle, where it starts, what turns and slows it besides its motors.

All times count from lift-off. Stations are distances behind the nose tip. Pairs are about, or along, body y
and z.
"""

from math import inf

from shefex_nav.settings import Settings, quantity, section


class RigidPart(Settings):
    """A rigid part: the payload, or a stage without its propellant."""

    mass: float = quantity("kg", "480 kg", "mass", positive=True)
    station: float = quantity("m", "2.1 m", "centre of mass, behind the nose tip", non_negative=True)
    inertia_roll: float = quantity("kg m2", "55 kg m2", "about the roll axis", positive=True)
    inertia_pitch: float = quantity(
        "kg m2", "700 kg m2", "across, about its own centre of mass", positive=True
    )


class Payload(RigidPart):
    """What is left when every stage is gone, and in what the whole vehicle is not symmetric."""

    centre_of_mass_offset: tuple[float, float] = quantity(
        "m",
        "1 mm",
        ("of the vehicle off the roll axis in body y", "in body z"),
        ("0 m", "0 m"),
        at_least="-1 km",
        at_most="1 km",
    )
    principal_axis_tilt: tuple[float, float] = quantity(
        "rad",
        "0.1 deg",
        ("of the vehicle about body y", "about body z"),
        ("0 deg", "0 deg"),
        at_least="-10 deg",
        at_most="10 deg",
    )


class Separation(Settings):
    """How a stage is dropped."""

    at: float = quantity("s", "65 s", "when", positive=True)
    impulse: float = quantity(
        "N s", "200 N s", "on what flies on, towards the nose", "0 N s", non_negative=True
    )
    tip_off: tuple[float, float] = quantity(
        "rad/s", "0.5 deg/s", ("given to what flies on, about body y", "about body z"), ("0 deg/s", "0 deg/s")
    )


class Nozzle(Settings):
    """What every motor has: a nozzle, and what is not perfect about its thrust."""

    exit_area: float = quantity("m2", "0.45 m2", "nozzle exit", positive=True)
    exit_station: float = quantity("m", "12.6 m", "nozzle exit", positive=True, at_most="1 km")
    misalignment: tuple[float, float] = quantity(
        "rad",
        "0.1 deg",
        ("thrust turned about body y", "thrust turned about body z"),
        ("0 deg", "0 deg"),
        at_least="-45 deg",
        at_most="45 deg",
    )
    offset: tuple[float, float] = quantity(
        "m",
        "2 mm",
        ("thrust line off the roll axis in body y, at the exit", "in body z"),
        ("0 mm", "0 mm"),
        at_least="-1 km",
        at_most="1 km",
    )


class Launch(Settings):
    """Where the vehicle stands, and the rail."""

    latitude: float = quantity("rad", "69.2942 deg", "geodetic, WGS 84", at_least="-90 deg", at_most="90 deg")
    longitude: float = quantity(
        "rad", "16.0190 deg", "east of Greenwich", at_least="-180 deg", at_most="360 deg"
    )
    height: float = quantity("m", "10 m", "of the IMU above the ellipsoid", at_least="-500 m", at_most="9 km")
    azimuth: float = quantity(
        "rad", "352 deg", "of the rail, north over east", at_least="-360 deg", at_most="360 deg"
    )
    elevation: float = quantity("rad", "88 deg", "of the rail", at_least="45 deg", at_most="90 deg")
    roll: float = quantity(
        "rad", "0 deg", "about the roll axis; 0: body y is horizontal, to the right along the azimuth"
    )
    rail_length: float = quantity(
        "m", "12 m", "travel until the vehicle is free", positive=True, at_most="1 km"
    )


class Ground(Settings):
    """Where a vehicle stands still for the whole time, with the sky above it.

    Its weight stays: `navigation.states` should have gyro_g_sensitivity, accel_scale and accel_misalignment.
    """

    latitude: float = quantity("rad", "48.1 deg", "geodetic, WGS 84", at_least="-90 deg", at_most="90 deg")
    longitude: float = quantity(
        "rad", "11.3 deg", "east of Greenwich", at_least="-180 deg", at_most="360 deg"
    )
    height: float = quantity(
        "m", "600 m", "of the IMU above the ellipsoid", at_least="-500 m", at_most="9 km"
    )
    azimuth: float = quantity(
        "rad", "90 deg", "of the roll axis, north over east", at_least="-360 deg", at_most="360 deg"
    )
    elevation: float = quantity("rad", "0 deg", "of the roll axis", at_least="-90 deg", at_most="90 deg")
    roll: float = quantity(
        "rad", "-90 deg", "about the roll axis; 0: body y is horizontal, to the right along the azimuth"
    )


class Orbit(Settings):
    """Osculating elements at the start; the roll axis then points along the velocity, body z down."""

    perigee_height: float = quantity(
        "m", "500 km", "above the equatorial radius", at_least="80 km", at_most="1000000 km"
    )
    apogee_height: float = quantity("m", "520 km", "above the equatorial radius", at_most="100000 km")
    inclination: float = quantity("rad", "97.4 deg", "to the equator", at_least="0 deg", at_most="180 deg")
    node: float = quantity(
        "rad", "30 deg", "right ascension of the ascending node", at_least="-360 deg", at_most="360 deg"
    )
    perigee: float = quantity("rad", "0 deg", "argument of perigee", at_least="-360 deg", at_most="360 deg")
    anomaly: float = quantity("rad", "0 deg", "true anomaly", at_least="-360 deg", at_most="360 deg")


class SpinMotors(Settings):
    """Small motors that turn the vehicle about its roll axis."""

    at: float = quantity("s", "384 s", "ignition")
    duration: float = quantity("s", "2 s", "how long they burn", positive=True, at_most="24 h")
    torque: float = quantity("N m", "200 N m", "about the roll axis; positive: positive roll rate")


class YoYo(Settings):
    """Two masses on cords, wound around the vehicle, that take its spin away."""

    at: float = quantity("s", "219 s", "release")
    mass: float = quantity(
        "kg", "2 kg", "both masses together, not part of the payload's mass", positive=True
    )
    cord_length: float = quantity("m", "5 m", "of each", positive=True, at_most="1 km")
    radius: float = quantity(
        "m", "0.5 m", "of the vehicle where they are wound up", positive=True, at_most="1 km"
    )


class AttitudeReference(Settings):
    """Errors of the attitude by which the cold-gas system steers; the filter does not steer. 1 sigma."""

    misalignment: float = quantity(
        "rad", "0.2 deg", "about each axis, constant", non_negative=True, at_most="180 deg"
    )
    drift: float = quantity("rad/s", "10 deg/h", "about each axis", non_negative=True)
    roll_scale_factor: float = quantity("", "100 ppm", "of the roll rate", non_negative=True)


class ColdGas(Settings):
    """Attitude control by cold gas: pairs of valves that are open or shut and give pure couples."""

    torque: tuple[float, float, float] = quantity(
        "N m", "60 N m", "of an open pair, about x, y, z", positive=True
    )
    arm: tuple[float, float, float] = quantity(
        "m", "2 m", "torque over thrust of a pair, about x, y, z", positive=True, at_most="1 km"
    )
    specific_impulse: float = quantity("s", "68 s", "of the gas", positive=True, at_most="10000 s")
    propellant: float = quantity(
        "kg", "8 kg", "gas in the tank, part of the payload's mass, which stays as it is", positive=True
    )
    period: float = quantity(
        "s", "20 ms", "of the controller; the shortest opening", at_least="2.5 ms", at_most="1 s"
    )
    dead_band_angle: tuple[float, float, float] = quantity(
        "rad", "0.2 deg", "errors that are left alone, about x, y, z", non_negative=True, at_most="180 deg"
    )
    dead_band_rate: tuple[float, float, float] = quantity(
        "rad/s", "0.1 deg/s", "rates that are left alone", non_negative=True
    )
    bandwidth: float = quantity("rad/s", "1 rad/s", "of the control loop", positive=True, at_most="100 rad/s")
    reference: AttitudeReference = section()


class Parachute(Settings):
    """A parachute; opens on the way down through a height, or at a time."""

    height: float | None = quantity(
        "m", "5 km", "above the ellipsoid, on the way down", None, positive=True, at_most="1000000 km"
    )
    at: float | None = quantity("s", "300 s", "when it opens, if not by its height", None)
    drag_area: float = quantity("m2", "12 m2", "drag coefficient times area when it is full", positive=True)
    inflation: float = quantity("s", "2 s", "time in which it fills", positive=True, at_most="24 h")
    station: float = quantity("m", "1.5 m", "where its lines are fixed", non_negative=True)

    @property
    def opens_below(self):
        """Height on the way down, m; -inf: it opens at a time."""
        return -inf if self.height is None else self.height

    @property
    def opens_at(self):
        """Time, s; inf: it opens at a height."""
        return inf if self.at is None else self.at
