"""Fields of gravity, atmospheres and winds by their names: classes of them, and those of the program.

A plug-in brings objects of the same classes (`plugins`). The kernels of the flight call none of their
functions: they get coefficients of harmonics, and tables over height and time (`sampling`).
"""

from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.settings import Settings, number

HIGHEST_DEGREE = 80  # of a field: above it factors of the recursion leave the range of a double
AIR_HEIGHTS = (  # m, where an atmosphere is asked first
    *(100.0 * k for k in range(-5, 300)),
    *(500.0 * k for k in range(60, 300)),
    *(5000.0 * k for k in range(30, 201)),
)
WIND_HEIGHTS = (*(200.0 * k for k in range(-2, 150)), *(1000.0 * k for k in range(30, 121)))  # m, a wind


class Coefficients(NamedTuple):
    """Harmonics of a field of gravity, fully normalised as those of EGM96, to degree and order N."""

    gm: float  # m^3/s^2
    radius: float  # m, of the coefficients
    cosine: np.ndarray  # (N + 1, N + 1) C[n, m]; C[0, 0] is 1
    sine: np.ndarray  # (N + 1, N + 1) S[n, m]


class Gravity(NamedTuple):
    """A field of gravity, `earth.gravity`."""

    name: str
    coefficients: Any  # function of earth.gravity_degree, which it may ignore, that gives Coefficients
    plugin: Any = None  # Plugin that brought it


class Site(NamedTuple):
    """When and where a flight starts, and the settings of the model that is asked."""

    epoch: str  # UTC of lift-off, ISO 8601
    latitude: float  # rad, geodetic; of an orbit that below its start
    longitude: float  # rad
    settings: Any = None  # of the class that the model names


class Air(NamedTuple):
    """Air at n heights."""

    density: np.ndarray  # (n,) kg/m^3
    pressure: np.ndarray  # (n,) Pa
    sound: np.ndarray | None = None  # (n,) m/s; None: sqrt(1.4 pressure / density)


class Atmosphere(NamedTuple):
    """An atmosphere, `atmosphere.model`; its settings are the section `atmosphere.<name>`."""

    name: str
    air: Any  # function of heights (n,) m above the ellipsoid and Site, that gives Air; None: kernels have it
    settings: Any = None  # class of Settings
    heights: tuple = AIR_HEIGHTS  # m, where it is asked first; above the last is vacuum
    plugin: Any = None


class Wind(NamedTuple):
    """A wind, `wind`; with settings `wind: {model: <name>, ...}`."""

    name: str
    wind: Any  # function of heights (n,) m, time s from lift-off and Site, that gives the wind to the north
    # and to the east, (n,) m/s each; None: calm
    settings: Any = None  # class of Settings
    heights: tuple = WIND_HEIGHTS  # m, where it is asked first; beyond the ends as there
    plugin: Any = None


class Msis(Settings):
    """What the Sun does to the upper air, for NRLMSIS."""

    f107: float = number(
        "97.7", "solar flux at 10.7 cm of the day before, in sfu", positive=True, at_most=500
    )
    f107_average: float = number("127.3", "its mean over 81 days, in sfu", positive=True, at_most=500)
    ap: float = number("4", "daily geomagnetic index", non_negative=True, at_most=400)


def words(one):
    """Which Gravity, Atmosphere or Wind it is, for messages."""
    brought = f" of {one.plugin.name}" if one.plugin else ""
    return f"{type(one).__name__.lower()} '{one.name}'{brought}"


def _late(module, name):
    """A function of a module of this folder that is imported when it is called."""

    def function(*given):
        return getattr(import_module(f"shefex_nav.environment.{module}"), name)(*given)

    return function


def _table(*models):
    return {one.name: one for one in models}


MSIS_HEIGHTS = (  # m; the model reaches a little below the ellipsoid
    *(200.0 * k for k in range(-2, 750)),
    *(500.0 * k for k in range(300, 2001)),
)
BUILT_IN = {  # class -> models of the program by name
    Gravity: _table(*(Gravity(name, _late("gravity", name)) for name in ("egm96", "j2", "point"))),
    Atmosphere: _table(
        Atmosphere("us76", None), Atmosphere("msis", _late("msis", "air"), Msis, MSIS_HEIGHTS)
    ),
    Wind: _table(Wind("none", None)),
}
