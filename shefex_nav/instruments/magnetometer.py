"""Magnetometer: the Earth's magnetic field along the body axes.

**In the world** the field is that of the World Magnetic Model at the true place and the date of the mission,
and what no such model has, of crust and outer currents: a field of its own in level axes, first-order
Gauss-Markov along the path, with the scatter that the model states of itself. Of B in body axes the sensor
reports

    B_m = (I + S) B + h + noise,

h the hard iron of vehicle and sensor, S soft iron, scale factors and misalignments together, each element
drawn by itself; then limited and counted in whole quanta (Groves, 2nd ed., section 6.1.1).

**On board** with the model's field B at the estimated place: C_bi(true) B = B_b + B_b x dtheta_b, and h is
the block `hard_iron`. How the field changes with the place, 2e-11 T in a metre, is left out. The heading is
the part of z athwart the horizontal field, in radians: z_heading = e . z with e = (d x B)/|B_h|^2, d down,
B_h the horizontal part, so that what tilts the level tilts the heading by the inclination, as it does a
compass. Soft iron and the field that no model has are no states: they last.
"""

import math
from functools import partial
from typing import Annotated, Literal, NamedTuple

import numpy as np

from shefex_nav.instruments import instrument
from shefex_nav.instruments.instrument import Column, DataColumn, Drawn, Equation, Plot, StateBlock
from shefex_nav.onboard.navigation.aid import Aid, Block, Linearised, Renewal
from shefex_nav.settings import Settings, choice, quantity, section, switch

ANOMALY_LENGTH = 50e3  # m [E], along the path, over which the field of the crust goes with itself
NO_HEADING = 10.0  # [E] sigmas of the model by which the horizontal field must exceed it for a heading


class Magnetometer(instrument.Sampled):
    """Magnetometer on board: the Earth's field along the three body axes."""

    hard_iron: float = quantity(
        "T", "500 nT", "constant field of the vehicle, each axis, 1 sigma", non_negative=True
    )
    soft_iron: float = quantity(
        "", "0.5 %", "scale, misalignment and soft iron, each element, 1 sigma", "0 %", non_negative=True,
        at_most="50 %",
    )  # fmt: skip
    noise: float = quantity("T", "50 nT", "of one reading, each axis, 1 sigma, white", positive=True)
    quantum: float = quantity("T", "15 nT", "field of one count", "off", positive=True, words=(("off", 0.0),))
    range: float = quantity("T", "200 uT", "largest field on an axis", "200 uT", positive=True)


class MagnetometerUse(Settings):
    """How the filter uses the magnetometer."""

    used: bool = switch("false: the filter does without it", default=True)
    rows: Literal["field", "heading"] = choice(
        "the three axes, or the heading alone where only that is to be trusted", "field"
    )
    model_error: float = quantity(
        "", "0.5 %", "of the field, besides what its model states", "0 %", non_negative=True, at_most="50 %"
    )
    memory: float = quantity(
        "s", "100 s", "for how long soft iron and errors of the model keep their sign", "100 s", positive=True
    )
    release: instrument.Release = section(
        "when readings that contradict the filter are a new hard iron",
        {"rejections": 50, "duration": "5 s"},
    )


class MagnetometerReading(NamedTuple):
    """Magnetic field along the body axes."""

    t_valid_s: float
    t_available_s: float
    field_b: Annotated[np.ndarray, Column("T", "as measured, body axes", (3,))]
    at_limit: Annotated[bool, Column("", "an axis is at an end of its range")] = False


class Errors(NamedTuple):
    """What was drawn for one run."""

    hard_iron: np.ndarray  # (3,) T
    soft_iron: np.ndarray  # (3, 3)


def measure(settings, truth, rng):
    """Readings along a trajectory. Magnetometer, Truth, Generator -> Measured

    As many numbers are drawn whatever the settings say but for the rate.
    """
    iron = settings.hard_iron * rng.standard_normal(3)
    errors = Errors(iron, settings.soft_iron * rng.standard_normal((3, 3)))
    k = instrument.samples(settings.rate, truth.trajectory)
    white, drive = rng.standard_normal((2, len(k), 3))
    read = _true_field(truth, k, drive) @ (np.eye(3) + errors.soft_iron).T
    read = read + errors.hard_iron + settings.noise * white
    sensed = instrument.readings(MagnetometerReading, settings, truth.trajectory.t_s[k], read)
    return instrument.sent(limited, settings, sensed, errors)


def limited(settings, reading):
    """A reading in whole quanta and within the range."""
    counted = instrument.counted(reading.field_b, settings.quantum)
    field_b = np.clip(counted, -settings.range, settings.range)
    return reading._replace(field_b=field_b, at_limit=bool(_at_limit(settings, counted)))


def _at_limit(settings, field_b):
    """Whether an axis is at an end of its range. (..., 3) T -> (...) bool"""
    return (np.abs(field_b) >= settings.range).any(axis=-1)


def _micro_tesla(read):
    """Field of readings."""
    return 1e6 * read.field_b


def _size(read):
    """Of the field of readings, micro-tesla."""
    return np.linalg.norm(_micro_tesla(read), axis=1)


def _true_field(truth, k, drive):
    """Field in body axes at samples k: (n, 3) T. drive : (n, 3) white, of what the model has not."""
    from shefex_nav.environment import magnetic_field
    from shefex_nav.geometry import frames, rotation

    trajectory, harmonics = truth.trajectory, magnetic_field.load(truth.year)
    sigma_n = magnetic_field.sigma_n(truth.year)
    out, more, before = np.empty((len(k), 3)), np.zeros(3), None
    for j, sample in enumerate(k.tolist()):
        C_ei = frames.dcm_ie(truth.earth, trajectory.t_s[sample]).T
        r_e = C_ei @ trajectory.r_i[sample]
        if before is None:
            more = drive[j]
        else:
            keeps = math.exp(-np.linalg.norm(r_e - before) / ANOMALY_LENGTH)
            more = keeps * more + np.sqrt(1.0 - keeps**2) * drive[j]
        b_e, before = _field_e(harmonics, r_e, sigma_n * more), r_e
        out[j] = rotation.dcm_from_quat(trajectory.q_ib[sample]).T @ C_ei.T @ b_e
    return out


def _field_e(harmonics, r_e, anomaly_n):
    """Field of the model and what it lacks (3,) T, north, east, down: (3,) T, frame e."""
    from shefex_nav.environment import magnetic_field
    from shefex_nav.geometry import wgs84

    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    return magnetic_field.field_e(harmonics, r_e) + wgs84.dcm_en(latitude, longitude) @ anomaly_n


def equation(settings, truth):
    """What a reading is. Magnetometer, Truth -> Equation"""
    from shefex_nav.environment import magnetic_field
    from shefex_nav.geometry import frames

    harmonics = magnetic_field.load(truth.year)
    drawn = (
        Drawn("hard_iron", np.full(3, settings.hard_iron)),
        Drawn("soft_iron", np.full(9, settings.soft_iron)),
        Drawn("anomaly", np.asarray(magnetic_field.sigma_n(truth.year)), length=ANOMALY_LENGTH),
    )

    def read(place, errors):
        C_ei = frames.dcm_ie(truth.earth, place.t_s).T
        b_b = place.C_ib.T @ C_ei.T @ _field_e(harmonics, C_ei @ place.r_i, errors["anomaly"])
        return b_b + errors["soft_iron"].reshape(3, 3) @ b_b + errors["hard_iron"]

    R = (settings.noise**2 + settings.quantum**2 / 12.0) * np.eye(3)
    return Equation(drawn, read, R, lambda reading: not reading.at_limit)


class Model(NamedTuple):
    """What the filter assumes."""

    settings: Magnetometer
    use: MagnetometerUse
    harmonics: tuple  # of `magnetic_field.load`
    sigma_n: np.ndarray  # (3,) T, of the harmonics, north, east and down, 1 sigma


def aid(settings, use, known):
    """Aid of a filter. Magnetometer, MagnetometerUse, Known"""
    from shefex_nav.environment import magnetic_field

    model = Model(settings, use, magnetic_field.load(known.year), magnetic_field.sigma_n(known.year))
    # what is off in heading by the same angle need be no hard iron: of heading alone nothing is ever believed
    renewal = Renewal("hard_iron", 1e-4, use.release.rejections, use.release.duration, "new hard iron")
    block = Block("hard_iron", settings.hard_iron**2 * np.eye(3), np.zeros(3))
    return Aid(
        MAGNETOMETER.name,
        MagnetometerReading,
        partial(expect, model),
        (block,),
        unfit=partial(unfit, model),
        renewal=None if use.rows == "heading" else renewal,
    )


def expect(model, here, reading):
    """Linearised of a reading, three rows in T, or one in rad of a heading. Model, aiding.Here"""
    from shefex_nav.geometry import rotation

    settings, use = model.settings, model.use
    noise = float(np.hypot(settings.noise, settings.quantum / np.sqrt(12.0)))
    share = float(np.hypot(settings.soft_iron, use.model_error))
    b_b, C_bn, horizontal = field(model, here)
    iron, H = here.value("hard_iron"), here.rows(3)
    H[:, here.columns("attitude")] = rotation.skew(b_b)
    H[:, here.columns("hard_iron")] = np.eye(3)
    lasting = C_bn @ np.diag(model.sigma_n**2) @ C_bn.T
    lasting = lasting + (share**2 * float(b_b @ b_b)) * np.eye(3)
    z, R = reading.field_b - iron - b_b, noise**2 * np.eye(3)
    if use.rows == "field":
        return Linearised(z, H, R, ((lasting, use.memory),))
    e = np.cross(C_bn[:, 2], b_b) / horizontal**2
    own, shared = np.array([[e @ R @ e]]), np.array([[e @ lasting @ e]])
    return Linearised(np.array([e @ z]), (e @ H)[None], own, ((shared, use.memory),))


def field(model, here):
    """The model's field. -> (3,) T in body axes, C_bn (3, 3), horizontal part T"""
    from shefex_nav.environment import magnetic_field

    C_bn = here.C_ib.T @ here.C_ie @ here.C_en
    b_n = here.C_en.T @ magnetic_field.field_e(model.harmonics, here.r_e)
    return C_bn @ b_n, C_bn, float(np.hypot(b_n[0], b_n[1]))


def unfit(model, here, reading):
    """Why a reading is not to be used; '' if it may."""
    if reading.at_limit:
        return "not used: the sensor is at an end of its range"
    if model.use.rows == "heading" and field(model, here)[2] < NO_HEADING * model.sigma_n.max():
        return "not used: the horizontal field is too weak for a heading"
    return ""


def check(settings, use, year):
    """(path, words) of contradictions."""
    from shefex_nav.environment import magnetic_field

    outside = magnetic_field.years_outside(year)
    if outside > magnetic_field.MOST_OUTSIDE:
        words = f"the magnetic field is not known {outside:.0f} years outside its models, 2010 to 2030"
        yield ("mission", "epoch"), words


def _measurable(field_b):
    """Whether there can be such a field. (..., 3) T -> (..., 3) bool"""
    return np.abs(field_b) < 1e3  # [E]


MAGNETOMETER = instrument.Instrument(
    name="magnetometer",
    settings=Magnetometer,
    record=MagnetometerReading,
    measure=measure,
    aid=aid,
    use=MagnetometerUse,
    states=(StateBlock("hard_iron", 3, "T", "a magnetometer needs the state of its hard iron"),),
    check=check,
    equation=equation,
    limited=limited,
    told=("hard_iron", "soft_iron", "noise", "quantum"),
    stream=11,
    data=(
        DataColumn(
            "field",
            "field_b",
            "uT",
            "T",
            "columns of the magnetic field",
            vector=True,
            is_valid=_measurable,
            wanted="a field is below 1000 T",
        ),
    ),
    at_limit=_at_limit,
    plots=(
        Plot("field", "Magnetic field along body x, y, z", "uT", _micro_tesla),
        Plot("size", "Size of the magnetic field", "uT", _size),
    ),
    caption="As the computer got it, hard iron included: a field whose size changes as the vehicle turns.",
    errors_last=True,
)
