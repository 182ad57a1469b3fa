"""The star catalogue: Hipparcos stars brighter than V = 8, their motion, colour and aberration.

In: `data/hipparcos_v8.csv.gz` (ICRS, epoch J1991.25; ESA SP-1200 for V, van Leeuwen 2007, A&A 474, 653
for astrometry, Hp and B-V). Out: arrays of unit vectors and magnitudes for the camera's sky and for the
catalogue that flies on board.
"""

import gzip
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry.elementary import log10, power

EPOCH = 1991.25  # Julian year of the Hipparcos positions
MAS = np.pi / 180.0 / 3.6e6  # rad, one milliarcsecond

ZERO, POINT, MINUS, COMMA, LINE_END = b"0.-,\n"

BV_RANGE = (-0.31, 2.45)  # range of the fit below
BV_UNKNOWN = 0.65  # for the 0.1 % of stars without B-V: the Sun's colour [E]
ROUNDING = 1e-7  # rad, more than that of an angle of 0.1 mrad from its cosine
# G - V of 13192 stars with 3 < V < 7 against B-V, highest power first; scatter 0.033 mag. Gaia's G is the
# band of a bare silicon detector.
G_MINUS_V = (-0.0247, 0.0017, -0.1305, -0.0887, -0.0218)


class StarCatalogue(NamedTuple):
    """Stars as arrays over n entries."""

    hip: np.ndarray  # (n,) Hipparcos number, int64
    u_i: np.ndarray  # (n, 3) unit vectors at `epoch`, barycentric (no aberration, no parallax)
    pm_i: np.ndarray  # (n, 3) rad per Julian year, proper motion, across the direction
    vmag: np.ndarray  # (n,) Johnson V
    hpmag: np.ndarray  # (n,) Hipparcos Hp; NaN for 17 stars without Hipparcos astrometry
    bv: np.ndarray  # (n,) B-V, NaN where unknown
    epoch: float  # Julian year of u_i


@lru_cache(maxsize=2)  # a campaign asks again for every run
def load_catalogue(max_magnitude):
    """Stars with V <= max_magnitude, ordered by Hipparcos number, at epoch J1991.25.

    The file is complete for V < 8; it also holds the five stars with V >= 8 that van Leeuwen lists with
    Hp < 7. It is read once in a process: nobody may change the arrays.
    """
    packed = (files("shefex_nav") / "data" / "hipparcos_v8.csv.gz").read_bytes()
    text = gzip.decompress(packed)
    heading = text.index(b"\n") + 1
    table = _numbers(np.frombuffer(text, dtype=np.uint8, offset=heading)).reshape(
        -1, text[:heading].count(b",") + 1
    )
    hip, ra_deg, dec_deg, pm_ra, pm_dec, _parallax, vmag, hpmag, bv = table[table[:, 6] <= max_magnitude].T
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    cos_ra, sin_ra, cos_dec, sin_dec = np.cos(ra), np.sin(ra), np.cos(dec), np.sin(dec)
    u_i = np.column_stack([cos_dec * cos_ra, cos_dec * sin_ra, sin_dec])
    east_i = np.column_stack([-sin_ra, cos_ra, np.zeros_like(ra)])
    north_i = np.column_stack([-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec])
    pm_i = MAS * (pm_ra[:, None] * east_i + pm_dec[:, None] * north_i)  # pm_ra holds the cos(dec)
    return StarCatalogue(hip.astype(np.int64), u_i, pm_i, vmag.copy(), hpmag.copy(), bv.copy(), EPOCH)


@kernel
def _numbers(text):
    """The decimals of a table, which commas and ends of lines close, NaN for none. (n,) ASCII -> (m,)

    The digits make one whole number, which is divided by a power of ten. Both are exact up to 15 digits, so
    the quotient is the nearest float, as Python reads it. ValueError for what is no such decimal.
    """
    values, n = np.empty(len(text)), 0
    whole, power_of_ten, digits, negative, has_point = 0, 1, 0, False, False
    for byte in text:
        if ZERO <= byte <= ZERO + 9:
            whole, digits = 10 * whole + (int(byte) - ZERO), digits + 1
            power_of_ten = 10 * power_of_ten if has_point else power_of_ten
        elif byte == POINT and not has_point:
            has_point = True
        elif byte == MINUS and not (negative or digits or has_point):
            negative = True
        elif byte in (COMMA, LINE_END) and digits <= 15 and (digits or not (negative or has_point)):
            size = whole / power_of_ten if digits else np.nan
            values[n] = -size if negative else size
            n += 1
            whole, power_of_ten, digits, negative, has_point = 0, 1, 0, False, False
        else:
            raise ValueError("not a table of decimals")
    return values[:n].copy()


def select(catalogue, rows):
    """The given rows of a catalogue (boolean mask or indices)."""
    return StarCatalogue(*(column[rows] for column in catalogue[:-1]), catalogue.epoch)


def at_epoch(catalogue, julian_year):
    """Catalogue moved along its proper motions, u = normalise(u0 + pm (t - t0)).

    Against the full space motion with parallax and radial velocity: at most 0.02 mas over 21 years.
    """
    moved = catalogue.u_i + catalogue.pm_i * (julian_year - catalogue.epoch)
    u_i = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    return catalogue._replace(u_i=u_i, epoch=float(julian_year))


def silicon_magnitude(vmag, bv):
    """Magnitude in the band of a silicon detector (Gaia's G). (n,), (n,) -> (n,); B-V may be NaN."""
    colour = np.clip(np.where(np.isnan(bv), BV_UNKNOWN, bv), *BV_RANGE)
    return vmag + np.polyval(G_MINUS_V, colour)


@kernel
def aberrate(u_i, v_i):
    """Directions as a moving observer sees them; the inverse is `aberrate(u_i, -v_i)`.

    u' = (u/gamma + (1 + u.v / (1 + 1/gamma)) v) / (1 + u.v), v in units of c: Lorentz transformation of
    the direction of light (Explanatory Supplement, 3rd ed., eq. 7.40).

    Parameters
    ----------
    u_i : (n, 3) unit vectors in the barycentric frame
    v_i : (3,) barycentric velocity of the observer [m/s]

    Returns
    -------
    (n, 3) unit vectors
    """
    vx, vy, vz = v_i[0] / SPEED_OF_LIGHT, v_i[1] / SPEED_OF_LIGHT, v_i[2] / SPEED_OF_LIGHT
    inverse_gamma = np.sqrt(1.0 - vx * vx - vy * vy - vz * vz)
    seen_i = np.empty((u_i.shape[0], 3))
    for k in range(u_i.shape[0]):
        uv = u_i[k, 0] * vx + u_i[k, 1] * vy + u_i[k, 2] * vz
        w = 1.0 + uv / (1.0 + inverse_gamma)
        seen_i[k, 0] = (u_i[k, 0] * inverse_gamma + w * vx) / (1.0 + uv)
        seen_i[k, 1] = (u_i[k, 1] * inverse_gamma + w * vy) / (1.0 + uv)
        seen_i[k, 2] = (u_i[k, 2] * inverse_gamma + w * vz) / (1.0 + uv)
    return seen_i


def photocentres(catalogue, max_magnitude, radius_rad, magnitude=None):
    """Catalogue of what a camera sees as single points: neighbours merged into their centre of light.

    Every star with V <= max_magnitude, brightest first, takes all stars of the catalogue within
    radius_rad that no brighter one has taken; the entry keeps the Hipparcos number of the brightest.
    Directions and proper motions are weighted with the flux in a silicon detector; V, Hp and B-V are
    those of the summed light.

    Parameters
    ----------
    catalogue : StarCatalogue, deeper than max_magnitude: the faint neighbours pull too
    max_magnitude : float, V or in the band of `magnitude`
    radius_rad : float [rad]
    magnitude : None or (n,) in another band than V, by which stars are bright

    Returns
    -------
    StarCatalogue, brightest first
    """
    by_z = np.argsort(catalogue.u_i[:, 2], kind="stable")
    z, u_by_z = catalogue.u_i[by_z, 2], catalogue.u_i[by_z]
    has_near = np.zeros(len(by_z), dtype=bool)
    has_near[by_z] = _with_neighbours(u_by_z, radius_rad + ROUNDING)
    flux = power(10.0, -0.4 * silicon_magnitude(catalogue.vmag, catalogue.bv))
    taken = np.zeros(len(catalogue.hip), dtype=bool)
    cos_radius = np.cos(radius_rad)
    u_i, pm_i = catalogue.u_i.copy(), catalogue.pm_i.copy()
    vmag, hpmag, bv = catalogue.vmag.copy(), catalogue.hpmag.copy(), catalogue.bv.copy()
    own = catalogue.vmag if magnitude is None else magnitude
    bright = np.flatnonzero(own <= max_magnitude)
    bright = bright[np.argsort(own[bright], kind="stable")]
    swallowed = np.zeros(len(by_z), dtype=bool)
    for star in bright[has_near[bright]]:
        if taken[star]:
            continue
        first, last = np.searchsorted(z, u_i[star, 2] + np.array([-radius_rad, radius_rad]))
        near = by_z[first:last]
        near = near[(catalogue.u_i[near] @ catalogue.u_i[star] >= cos_radius) & ~taken[near]]
        taken[near] = True
        taken[star] = True
        near = near[near != star]
        if near.size == 0:
            continue
        swallowed[near] = True
        group = np.append(near, star)
        one = _centre_of_light(select(catalogue, group), flux[group])
        u_i[star], pm_i[star], vmag[star], hpmag[star], bv[star] = one
    merged = StarCatalogue(catalogue.hip, u_i, pm_i, vmag, hpmag, bv, catalogue.epoch)
    entries = bright[~swallowed[bright]]
    return select(merged, entries[np.argsort(vmag[entries], kind="stable")])


@kernel
def _with_neighbours(u_i, radius):
    """Which stars, ordered by z, have another within a radius [rad]. (n, 3) -> (n,) bool"""
    found, cosine = np.zeros(len(u_i), dtype=np.bool_), np.cos(radius)
    for k in range(len(u_i)):
        for j in range(k + 1, len(u_i)):
            if u_i[j, 2] - u_i[k, 2] > radius:
                break
            if u_i[k, 0] * u_i[j, 0] + u_i[k, 1] * u_i[j, 1] + u_i[k, 2] * u_i[j, 2] >= cosine:
                found[k] = found[j] = True
    return found


def _centre_of_light(stars, flux):
    """u_i, pm_i, vmag, hpmag and bv of the stars of a StarCatalogue seen as one. flux : (n,) of each"""
    weight = flux / flux.sum()
    centre, vmag = weight @ stars.u_i, _summed(stars.vmag)
    bv = _summed(stars.vmag + np.where(np.isnan(stars.bv), BV_UNKNOWN, stars.bv)) - vmag
    return centre / np.linalg.norm(centre), weight @ stars.pm_i, vmag, _summed(stars.hpmag), bv


def _summed(magnitudes):
    """Magnitude of the summed light."""
    return -2.5 * log10(power(10.0, -0.4 * magnitudes).sum())
