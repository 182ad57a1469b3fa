"""The magnetic field as charts and the reports on the models give it: north, east and down, and angles."""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import magnetic_field
from shefex_nav.geometry import wgs84


class Elements(NamedTuple):
    """Field as charts give it."""

    declination: float  # rad, from true north towards east
    inclination: float  # rad, below the horizon
    horizontal: float  # T
    total: float  # T


def field_n(harmonics, latitude, longitude, height):
    """Magnetic field north, east and down at a place: rad, rad, m -> (3,) T."""
    r_e = wgs84.ecef_from_geodetic(latitude, longitude, height)
    return wgs84.dcm_en(latitude, longitude).T @ magnetic_field.field_e(harmonics, r_e)


def elements(b_n):
    """Declination, inclination and intensities of a field north, east and down: (3,) T -> Elements."""
    horizontal = float(np.hypot(b_n[0], b_n[1]))
    return Elements(
        float(np.arctan2(b_n[1], b_n[0])),
        float(np.arctan2(b_n[2], horizontal)),
        horizontal,
        float(np.linalg.norm(b_n)),
    )


def declination_sigma(b_n, year):
    """1 sigma of the declination [rad] by `magnetic_field.sigma_n` where the field is b_n, (3,) T."""
    sigma = magnetic_field.sigma_n(year)
    return float(np.hypot(b_n[1] * sigma[0], b_n[0] * sigma[1]) / (b_n[0] ** 2 + b_n[1] ** 2))
