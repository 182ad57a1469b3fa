"""Radar altimeter: height above the ellipsoid, as far up as it has an echo."""

from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from shefex_nav.geometry import frames, wgs84
from shefex_nav.instruments.instrument import (
    Column,
    DataColumn,
    Drawn,
    Equation,
    Instrument,
    Measured,
    Plot,
    Sampled,
    StateBlock,
    Use,
    readings,
    samples,
)
from shefex_nav.onboard.navigation.aid import Aid, Block, Linearised
from shefex_nav.settings import quantity


class RadarAltimeter(Sampled):
    """Radar altimeter on board."""

    bias: float = quantity("m", "1 m", "constant in a flight, 1 sigma", positive=True)
    noise: float = quantity("m", "2 m", "of one reading, 1 sigma, white", positive=True)
    highest: float = quantity("m", "20 km", "up to which it has an echo", "20 km", positive=True)


class Height(NamedTuple):
    """Height above the ellipsoid; NaN where there is no echo."""

    t_valid_s: float
    t_available_s: float
    height: Annotated[float, Column("m", "above the ellipsoid, NaN without an echo")]


def measure(settings, truth, rng):
    """The world: readings along the true flight."""
    flight, bias = truth.trajectory, settings.bias * rng.standard_normal()
    k = samples(settings.rate, flight)
    noise = settings.noise * rng.standard_normal(len(k))
    places = (frames.dcm_ie(truth.earth, flight.t_s[n]).T @ flight.r_i[n] for n in k)
    true = np.array([wgs84.geodetic_from_ecef(r_e)[2] for r_e in places])
    height = np.where(true < settings.highest, true + bias + noise, np.nan)
    return Measured(readings(Height, settings, flight.t_s[k], height), bias)


def aid(settings, use, known):
    """On board: what the filter knows of it."""
    bias = Block("altimeter_bias", np.array([[settings.bias**2]]), np.zeros(1))
    return Aid("radar_altimeter", Height, partial(expect, settings), (bias,), holds=has_echo)


def expect(settings, here, reading):
    """What a reading says of the errors. The height changes along the vertical alone."""
    H = here.rows(1)
    H[0, here.columns("position")] = here.up_i
    H[0, here.columns("altimeter_bias")] = 1.0
    z = reading.height - here.height - here.value("altimeter_bias")
    return Linearised(z, H, np.array([[settings.noise**2]]))


def has_echo(reading):
    """Whether a reading measures anything."""
    return bool(np.isfinite(reading.height))


def kilometres(read):
    """For the plot, of all readings."""
    return 1e-3 * read.height


def equation(settings, truth):
    """The world again, for the bound of the errors: a reading without noise, what is drawn, the noise."""

    def read(place, errors):
        r_e = frames.dcm_ie(truth.earth, place.t_s).T @ place.r_i
        return wgs84.geodetic_from_ecef(r_e)[2] + errors["bias"]

    bias = Drawn("bias", np.array([settings.bias]))
    return Equation((bias,), read, np.array([[settings.noise**2]]), has_echo)


PROVIDES = [
    Instrument(
        name="radar_altimeter",
        settings=RadarAltimeter,
        record=Height,
        measure=measure,
        aid=aid,
        use=Use,
        equation=equation,
        states=(StateBlock("altimeter_bias", 1, "m", "a radar altimeter needs the state of its bias"),),
        told=("bias", "noise"),
        data=(DataColumn("height", "height", "m", "m", "column of the height above the ellipsoid"),),
        plots=(Plot("height", "Height by the radar altimeter", "km", kilometres),),
        caption="Height above the ellipsoid as measured; nothing where there is no echo.",
    )
]
