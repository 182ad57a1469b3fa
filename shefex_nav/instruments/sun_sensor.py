"""Sun sensor: the direction of the Sun in body axes, while it is seen.

**In the world** the direction s to the Sun, C_bi s_i, is turned by an alignment error of the sensor, drawn
per run, and by noise, each a small rotation vector. The Sun is seen while the vehicle is outside the Earth's
shadow, whose edge is the limb without air.

**On board** s_i is that of the epoch. C_bi(true) s_i = s_b + s_b x dtheta_b; two rows are used, across s_b,

    e_1 = (s_b x a)/|s_b x a|, a the body axis most across s_b,   e_2 = s_b x e_1

because along s_b a direction says nothing (Markley & Crassidis, Fundamentals of Spacecraft Attitude
Determination and Control, section 4.4). The alignment error a (block `sun_alignment`) turns what is read by
a x s_b. World and filter take the Sun of the epoch for the whole mission: it moves by 0.04 deg an hour.
"""

from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from shefex_nav.instruments import instrument
from shefex_nav.instruments.instrument import (
    Column,
    Drawn,
    Equation,
    Instrument,
    Plot,
    Sampled,
    StateBlock,
    Use,
)
from shefex_nav.onboard.navigation.aid import Aid, Block, Linearised
from shefex_nav.settings import number, quantity


class SunSensor(Sampled):
    """Sun sensor on board."""

    boresight: tuple[float, float, float] = number(
        "0", "middle of its field of view, body axes (x to the nose)"
    )
    field_of_view: float = quantity("rad", "60 deg", "half angle", positive=True, at_most="180 deg")
    alignment: float = quantity(
        "rad", "0.1 deg", "constant rotation about each axis, 1 sigma", positive=True, at_most="180 deg"
    )
    noise: float = quantity(
        "rad", "0.1 deg", "of one reading, each axis, 1 sigma, white", positive=True, at_most="180 deg"
    )


class SunReading(NamedTuple):
    """Direction of the Sun, where the sensor sees it."""

    t_valid_s: float
    t_available_s: float
    s_b: Annotated[
        np.ndarray, Column("", "unit vector to the Sun as measured, body axes; NaN: not seen", (3,))
    ]
    seen: Annotated[bool, Column("", "the Sun is in the field of view and not behind the Earth")]


def measure(settings, truth, rng):
    """Readings along a trajectory. SunSensor, Truth, Generator -> Measured, errors: (3,) rad, alignment"""
    from shefex_nav.geometry import frames, rotation, wgs84

    trajectory, alignment = truth.trajectory, settings.alignment * rng.standard_normal(3)
    k = instrument.samples(settings.rate, trajectory)
    turns = alignment + settings.noise * rng.standard_normal((len(k), 3))
    boresight, s_b, seen = np.array(settings.boresight), np.empty((len(k), 3)), np.empty(len(k), dtype=bool)
    nearest = np.cos(settings.field_of_view) * np.linalg.norm(boresight)
    for j, sample in enumerate(k.tolist()):
        true_b = rotation.dcm_from_quat(trajectory.q_ib[sample]).T @ truth.sun_i
        C_ei = frames.dcm_ie(truth.earth, trajectory.t_s[sample]).T
        is_lit = wgs84.limb_angle(C_ei @ trajectory.r_i[sample], C_ei @ truth.sun_i) > 0.0
        seen[j] = is_lit and true_b @ boresight >= nearest
        s_b[j] = rotation.dcm_from_rotvec(turns[j]) @ true_b if seen[j] else np.nan
    return instrument.Measured(
        instrument.readings(SunReading, settings, trajectory.t_s[k], s_b, seen), alignment
    )


def equation(settings, truth):
    """What a reading is. SunSensor, Truth -> Equation"""
    from shefex_nav.geometry import rotation

    def read(place, errors):
        return rotation.dcm_from_rotvec(errors["alignment"]) @ (place.C_ib.T @ truth.sun_i)

    alignment = Drawn("alignment", np.full(3, settings.alignment))
    return Equation((alignment,), read, settings.noise**2 * np.eye(3), sees)


def limited(settings, reading):
    """A reading whose direction is a unit vector."""
    return reading._replace(s_b=reading.s_b / np.linalg.norm(reading.s_b))


def aid(settings, use, known):
    """Aid of a filter. SunSensor, Use, Known"""
    alignment = Block("sun_alignment", settings.alignment**2 * np.eye(3), np.zeros(3))
    expected = partial(expect, settings.noise, known.sun_i)
    return Aid(SUN_SENSOR.name, SunReading, expected, (alignment,), holds=sees)


def expect(noise, sun_i, here, reading):
    """Linearised of a reading, two rows in rad. rad; (3,) to the Sun; aiding.Here, SunReading"""
    from shefex_nav.geometry import rotation

    s_b, H = here.C_ib.T @ sun_i, here.rows(2)
    e_1 = np.cross(s_b, np.eye(3)[np.argmin(np.abs(s_b))])
    e_1 /= np.linalg.norm(e_1)
    across = np.array([e_1, np.cross(s_b, e_1)])
    H[:, here.columns("attitude")] = across @ rotation.skew(s_b)
    H[:, here.columns("sun_alignment")] = -across @ rotation.skew(s_b)
    turned = s_b + np.cross(here.value("sun_alignment"), s_b)
    return Linearised(across @ (reading.s_b - turned), H, noise**2 * np.eye(2))


def sees(reading):
    """Whether the Sun was seen."""
    return reading.seen


def check(settings, use, year):
    """(path, words) of contradictions."""
    if not np.linalg.norm(settings.boresight) > 1e-6:
        yield ("sun_sensor", "boresight"), "must not be zero; give a direction such as [0, 1, 0]"


SUN_SENSOR = Instrument(
    name="sun_sensor",
    settings=SunSensor,
    record=SunReading,
    measure=measure,
    aid=aid,
    use=Use,
    states=(StateBlock("sun_alignment", 3, "rad", "a Sun sensor needs the state of its alignment"),),
    check=check,
    equation=equation,
    limited=limited,
    told=("alignment", "noise"),
    plots=(Plot("direction", "Direction of the Sun along body x, y, z", "", lambda read: read.s_b),),
    caption="Unit vector to the Sun as measured; no line where it is not in the field of view, or behind the "
    "Earth.",
)
