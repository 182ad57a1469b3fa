"""Tasks of the attitude programme. All times count from lift-off."""

from typing import Literal

from shefex_nav.settings import Settings, choice, quantity


class Task(Settings):
    """Something that the attitude control does from one time until another."""

    start: float = quantity("s", "70 s", "begin of the task", key="from")
    end: float = quantity("s", "145 s", "its end", key="until")


class Damp(Task):
    """Take away the rates across the roll axis and leave the spin alone."""

    task: Literal["damp"] = choice()


class Turn(Task):
    """Turn the roll axis to a direction."""

    task: Literal["turn"] = choice()
    azimuth: float = quantity("rad", "352 deg", "of the roll axis, north over east")
    elevation: float = quantity(
        "rad", "8.2 deg", "of the roll axis above the horizontal", at_least="-90 deg", at_most="90 deg"
    )
    at: float | None = quantity(
        "s", "149.2 s", "the horizontal is that below the vehicle then; as a rule at the end", None
    )

    @property
    def level_at(self):
        """Time for which the direction is meant, s."""
        return self.end if self.at is None else self.at


class AlignVelocity(Task):
    """Turn the roll axis along the air-relative velocity that the vehicle will have."""

    task: Literal["align_velocity"] = choice()
    at: float = quantity("s", "405 s", "the velocity is that of this time")


class SpinTo(Task):
    """Bring the spin about the roll axis to a rate."""

    task: Literal["spin"] = choice()
    rate: float = quantity("rad/s", "1 Hz", "roll rate at the end", turns=True)


class Point(Task):
    """Turn the boresight of the star camera to a direction."""

    task: Literal["point"] = choice()
    azimuth: float = quantity("rad", "100 deg", "of the boresight at the end, north over east")
    elevation: float = quantity(
        "rad",
        "50 deg",
        "above the horizontal below the vehicle at the end",
        at_least="-90 deg",
        at_most="90 deg",
    )
    roll: float = quantity(
        "rad", "0 deg", "about the boresight; 0: camera x as near to the roll axis as it gets"
    )


class PointInertial(Task):
    """Turn the boresight of the star camera to a place among the stars."""

    task: Literal["point_inertial"] = choice()
    right_ascension: float = quantity(
        "rad", "136 deg", "of the boresight at the end, axes of the GCRS (J2000)"
    )
    declination: float = quantity(
        "rad", "51 deg", "of the boresight at the end", at_least="-90 deg", at_most="90 deg"
    )
    roll: float = quantity(
        "rad", "0 deg", "about the boresight; 0: camera x as near to the roll axis as it gets", "0 deg"
    )


class PointNadir(Task):
    """Turn the body to the Earth: z to its centre, x along the flight across it, both as they are at the end.

    x lies along the inertial velocity less its part along the radius. It arrives at rest among the stars; a
    `turn_with_orbit` from there on keeps it.
    """

    task: Literal["point_nadir"] = choice()


class TurnWithOrbit(Task):
    """Turn about the orbit's normal as the orbit does: the side that faces the Earth goes on facing it.

    The rate is constant, the mean one over a revolution: within it an eccentricity e moves the Earth by up to
    2 e rad. It fades in and out; the angle of half a fade stays behind.
    """

    task: Literal["turn_with_orbit"] = choice()
    ramp: float = quantity(
        "s", "5 s", "in which the rate fades in and out", "5 s", positive=True, at_most="24 h"
    )


class Dwell(Task):
    """Hold an attitude in which the star camera works, but for rates that are asked for."""

    task: Literal["dwell"] = choice()
    boresight_rate: float = quantity("rad/s", "0.1 deg/s", "constant, about the boresight", "0 deg/s")
    cross_rate: float = quantity(
        "rad/s", "0.2 deg/s", "across it; its axis turns", "0 deg/s", non_negative=True
    )
    cross_period: float | None = quantity("s", "40 s", "of that turning", None, positive=True, at_most="24 h")
    cross_phase: float = quantity("rad", "0 deg", "of that turning at the start", "0 deg")
    ramp: float | None = quantity(
        "s", "5 s", "in which the rates fade in and out", None, positive=True, at_most="24 h"
    )

    @property
    def moves(self):
        """Whether rates are asked for."""
        return self.boresight_rate != 0.0 or self.cross_rate != 0.0


class Hold(Task):
    """Hold the attitude, or the direction of the roll axis of a spinning vehicle."""

    task: Literal["hold"] = choice()


KINDS = (Damp, Turn, AlignVelocity, SpinTo, Point, PointInertial, PointNadir, Dwell, TurnWithOrbit, Hold)
LOOKS = (Point, PointInertial, PointNadir, Dwell, TurnWithOrbit)  # the star camera works, nothing spins
