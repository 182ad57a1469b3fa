"""Impact ellipses: where landings of many flights lie, in the plane that touches the Earth at their mean.

An ellipse of k sigma holds 1 - exp(-k^2/2) of a normal distribution in two dimensions: 39.3, 86.5 and 98.9 %
for 1, 2, 3. That is of the distribution, not of a single axis (68.3, 95.4, 99.7 %). One that n landings gave
holds less, as their mean and covariance are not those of the distribution: the next landing by Hotelling's
T^2 (Johnson, Wichern, Applied Multivariate Statistical Analysis, 6th ed., section 5.4), with 3 sigma of three
landings 52 %, of eight 90 %, of thirty 97.5 %.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import normality
from shefex_nav.geometry import wgs84

SIGMAS = 1, 2, 3
FEWEST = 3  # landings of an ellipse
SAME_M = 1e-3  # rounding of positions


class Ellipse(NamedTuple):
    """Landings of a body and their ellipse."""

    body: str
    latitude: float  # rad, of the centre
    longitude: float  # rad
    error: tuple  # m, standard error of the centre, to the north and to the east
    axes: tuple  # m, semi-axes of 1 sigma, the longer one first
    azimuth: float  # rad, of the longer one, north over east, 0 to pi
    offsets: np.ndarray  # (n, 2) m, of the landings from the centre, north and east
    inside: tuple  # how many of them lie within 1, 2, 3 sigma
    shape: object = None  # normality.Shape; None: not tested

    @property
    def not_normal(self):
        """Whether the landings are no sample of a normal distribution."""
        return self.shape is not None and not self.shape.normal

    @property
    def axes_error(self):
        """Standard error of the semi-axes, relative to them, if the landings are normally distributed."""
        return 1.0 / math.sqrt(2.0 * (len(self.offsets) - 1))

    def holds(self, sigmas):
        """Share of a normal distribution that the ellipse holds, on the average over such ellipses."""
        return share(sigmas, len(self.offsets))

    def outline(self, sigmas, points=120):
        """(points, 2) rad, geodetic latitude and longitude around the ellipse; closed."""
        angle = np.linspace(0.0, 2.0 * np.pi, points)
        along, across = (
            sigmas * axis * f(angle) for axis, f in zip(self.axes, (np.cos, np.sin), strict=True)
        )
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        level = np.column_stack([c * along - s * across, s * along + c * across, np.zeros(points)])
        centre = wgs84.ecef_from_geodetic(self.latitude, self.longitude, 0.0)
        r_e = centre + level @ wgs84.dcm_en(self.latitude, self.longitude).T
        return np.array([wgs84.geodetic_from_ecef(r)[:2] for r in r_e])


def of_bodies(landings):
    """Ellipses of the bodies that have one, each with its shape: tuple. landings : {body: (n, 2) rad}"""
    drawn = [ellipse(body, *places.T) for body, places in landings.items()]
    held = [one for one in drawn if one is not None]
    shapes = normality.shapes([one.offsets for one in held])
    return tuple(one._replace(shape=shape) for one, shape in zip(held, shapes, strict=True))


def share(sigmas, landings):
    """Probability that the next landing is within so many sigma of an ellipse that n of them gave, if normal.

    That of F with 2 and n - 2 degrees of freedom up to k^2 n (n - 2) / (2 (n^2 - 1)), in its closed form.
    """
    n = landings
    return -math.expm1(-0.5 * (n - 2) * math.log1p(sigmas**2 * n / (n**2 - 1.0)))


def missing(landings):
    """Why so many landings have no ellipse, in words."""
    return f"an ellipse needs {FEWEST}" if landings < FEWEST else "all are in one place: there is no ellipse"


def ellipse(body, latitude, longitude):
    """Ellipse of landings (n,) rad; None for fewer than three, or if all are in one place."""
    if len(latitude) < FEWEST:
        return None
    r_e = np.array([wgs84.ecef_from_geodetic(*one, 0.0) for one in zip(latitude, longitude, strict=True)])
    mean_e = r_e.mean(axis=0)
    centre = wgs84.geodetic_from_ecef(mean_e)[:2]
    level = (r_e - mean_e) @ wgs84.dcm_en(*centre)
    offsets = level[:, :2] - level[:, :2].mean(axis=0)
    variances, directions = np.linalg.eigh(np.cov(offsets.T))
    if variances[1] <= SAME_M**2:
        return None
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    along = offsets @ directions / np.maximum(sigmas, 1e-9)
    distance = np.hypot(*along.T)
    azimuth = math.atan2(directions[1, 1], directions[0, 1]) % math.pi
    error = tuple((offsets.std(axis=0, ddof=1) / math.sqrt(len(offsets))).tolist())
    inside = tuple(int((distance <= k).sum()) for k in SIGMAS)
    axes = float(sigmas[1]), float(sigmas[0])
    return Ellipse(body, *map(float, centre), error, axes, azimuth, offsets, inside)
