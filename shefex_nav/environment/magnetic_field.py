"""Magnetic field of the Earth: the World Magnetic Models of 2010 to 2025, degree and order 12.

In: position in frame e and the decimal year. Out: the field in frame e, tesla, as the core makes it; fields
of the crust, of currents above the atmosphere and of the vehicle are not in it.

Tables: Chulliat A. et al., The US/UK World Magnetic Model for 2025-2030, Technical Report, NCEI and BGS
(2025), and its predecessors; data/wmm.csv has the Gauss coefficients g, h of each model, Schmidt
semi-normalised [nT], and their rates [nT/a]. Formula (1 to 9 of the report): B = -grad V,
V = a sum (a/r)^(n+1) (g cos(m lon) + h sin(m lon)) P_nm(sin lat), a = 6371.2 km, which is the sum that
`gravity` makes of normalised coefficients.

Each model is made for five years, in which its rates hold. A year between 2010 and 2030 has the model that
was made for it, so a flight of 2012 has the field of 2012. Up to 20 years outside, the nearest model is
carried on by its rates, with the error that `sigma_n` states; further away there is no answer.
"""

import csv
from datetime import datetime
from functools import cache
from importlib import resources

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment import gravity

DEGREE = 12
RADIUS = 6371200.0  # m, of the coefficients
NANOTESLA = 1e-9  # T
FIRST_YEAR, LAST_YEAR = 2010.0, 2030.0  # of the four models together
MOST_OUTSIDE = 20.0  # years by which the rates of a model may carry it on
# 1 sigma of one model in its own five years, north, east, down: most of it are crust and outer currents,
# which are not in it (error model of the report on WMM2025)
SIGMA_N = (137e-9, 89e-9, 141e-9)  # T
# and what a model loses in each year outside its time, since the rates change: WMM-2010, carried 5, 10 and
# 15 years beyond 2015, differs from the models made for then by at most this (rms); carried back, by less
SIGMA_CARRIED_N = (20e-9, 25e-9, 40e-9)  # T/a


def decimal_year(when):
    """Decimal year of a datetime, or of ISO 8601 text, in UTC: 2012.0 is the first instant of 2012."""
    when = datetime.fromisoformat(when) if isinstance(when, str) else when
    begin = datetime(when.year, 1, 1, tzinfo=when.tzinfo)
    return when.year + (when - begin) / (begin.replace(year=when.year + 1) - begin)


def load(year):
    """The field at a decimal year, as harmonics for `field_e`.

    In the hours of a flight the field changes by less than 1e-10 T: load once, at the epoch. ValueError more
    than 20 years outside 2010 to 2030.
    """
    outside = years_outside(year)
    if not outside <= MOST_OUTSIDE:
        earliest, latest = FIRST_YEAR - MOST_OUTSIDE, LAST_YEAR + MOST_OUTSIDE
        words = f"its models are made for {FIRST_YEAR:.0f} to {LAST_YEAR:.0f}"
        raise ValueError(
            f"the magnetic field of {year:.1f} is not known: {words} and carried on to "
            f"{earliest:.0f} and {latest:.0f} at most"
        )
    models = _models()
    epoch = max((one for one in models if one <= year), default=min(models))
    g, h, g_rate, h_rate = models[epoch][1]
    cosine, sine = (value + (year - epoch) * rate for value, rate in ((g, g_rate), (h, h_rate)))
    # Schmidt's functions are the fully normalised ones over sqrt(2 n + 1); the sign is that of B = -grad V
    factor = -NANOTESLA / np.sqrt(2.0 * np.arange(DEGREE + 1)[:, None] + 1.0)
    return gravity.from_normalised(RADIUS**2, RADIUS, cosine * factor, sine * factor)


def years_outside(year):
    """Years by which a decimal year lies outside 2010 to 2030, 0 within."""
    return float(max(FIRST_YEAR - year, year - LAST_YEAR, 0.0))


def sigma_n(year):
    """1 sigma of the model's north, east and down component near the ground at a decimal year: (3,) T."""
    return np.hypot(np.array(SIGMA_N), np.array(SIGMA_CARRIED_N) * years_outside(year))


@kernel
def field_e(harmonics, r_e):
    """Magnetic field at r_e on or above the ground: (3,) m -> (3,) T, frame e."""
    return gravity.gravity_e(harmonics, r_e)


@cache
def _models():
    """{epoch: (name, (g, h, g_rate, h_rate))}, each (13, 13) in nT and nT/a, of the table."""
    models = {}
    table = resources.files("shefex_nav") / "data" / "wmm.csv"
    with table.open(newline="") as lines:
        for row in csv.DictReader(lines):
            empty = tuple(np.zeros((DEGREE + 1, DEGREE + 1)) for _ in range(4))
            arrays = models.setdefault(float(row["epoch"]), (row["model"], empty))[1]
            for name, array in zip(("g", "h", "g_rate", "h_rate"), arrays, strict=True):
                array[int(row["n"]), int(row["m"])] = float(row[name])
    return models
