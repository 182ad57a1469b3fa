"""Settings of the parts of a vehicle: masses, separations, nozzles.

Stations are distances behind the nose tip. Pairs are about, or along, body y and z.
"""

from shefex_nav.settings import Settings, quantity


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
