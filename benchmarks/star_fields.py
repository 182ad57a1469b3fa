"""Random fields for star identification: what a camera would detect, and what it was in truth.

In: a case (a name of CASES) and a random generator. Out: a Field. The stars are those of the Hipparcos
catalogue, merged here where the camera cannot separate them, not those of the on-board catalogue. False
detections are uniform in place, unless a case says otherwise, with magnitudes drawn from the catalogue.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import at_epoch, load_catalogue
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply
from shefex_nav.solve.centroids import Camera

EPOCH = 2012.47  # Julian year, of the flight
CAMERA = Camera(659, 493, 25.0e-3 / 9.9e-6)
SIZE = np.array([CAMERA.width_px, CAMERA.height_px])
CUT = 5.5  # V
MERGE_PX = 2.0
MIN_COSINE = 0.98  # 11.5 deg; the corner of the detector is at 9.2 deg
PREDICTION_SIGMA = np.radians(0.05)  # per axis, what a prediction claims
NOISE_ONLY = (6, 25)  # number of detections, at least and less than
AIMS = {"Pleiades": (56.75, 24.12)}  # right ascension, declination [deg]: clusters weigh much and turn easily
CASES = {
    "0 false": {},
    "1 false": {"n_false": 1},
    "5 false": {"n_false": 5},
    "15 false": {"n_false": 15},
    "5 false, 0.5 px": {"n_false": 5, "noise_px": 0.5},
    "0 false, 0.5 px": {"noise_px": 0.5},
    "5 false, 30 % missing": {"n_false": 5, "missing": 0.3},
    "1 false, focal +0.5 %": {"n_false": 1, "focal": 1.005},
    "1 false, focal -0.5 %": {"n_false": 1, "focal": 0.995},
    "5 false, 1.7 noise, 1.5 mag": {"n_false": 5, "noise_px": 0.255, "scatter": 0.3},
    "15 false in a cluster": {"n_false": 15, "shape": "cluster"},
    "15 false on a line": {"n_false": 15, "shape": "line"},
    "5 false, zero point 0.3": {"n_false": 5, "zero_point": 0.3},
    "5 false, stars to 6.5": {"n_false": 5, "depth": 6.5},
    "5 false, stars to 5.0": {"n_false": 5, "depth": 5.0},
    "5 false, scatter 0.5 mag": {"n_false": 5, "scatter": 0.5},
    "5 false, doubles +-1 px": {"n_false": 5, "doubles": 0.2},
    "5 false, no flux": {"n_false": 5, "with_flux": False},
    "noise only": {"n_false": None},
    "tracking, 0.05 deg off": {"n_false": 5, "predicted": 0.05},
    "tracking, 10 deg off": {"n_false": 5, "predicted": 10.0},
    # a case added at the end leaves the fields of the others as they are
    "noise only, no flux": {"n_false": None, "with_flux": False},
    "noise only, clustered": {"n_false": None, "shape": "cluster"},
    "5 false, Pleiades": {"n_false": 5, "aim": "Pleiades"},
    "5 false, Pleiades, focal +0.5 %": {"n_false": 5, "aim": "Pleiades", "focal": 1.005},
}


class Field(NamedTuple):
    """One frame and its truth."""

    xy_px: np.ndarray  # (n, 2) in any order
    flux: np.ndarray | None  # (n,)
    prediction: tuple | None  # (q_ci, P (3, 3) rad^2 in camera axes)
    q_ci: np.ndarray  # (4,)
    n_stars: int  # detected stars to V = CUT
    P_px: np.ndarray | None = None  # (n, 2, 2) px^2, what is said of the errors of the places


@cache
def sky():
    """Stars to V = 8 at the epoch: directions, magnitudes; brightest first."""
    stars = at_epoch(load_catalogue(8.0), EPOCH)
    order = np.argsort(stars.vmag)
    return np.ascontiguousarray(stars.u_i[order]), stars.vmag[order]


def merged(xy, mag):
    """Points of light brightest first, those within MERGE_PX of a brighter one added to it."""
    k = 0
    while k < len(mag):
        group = np.hypot(*(xy - xy[k]).T) < MERGE_PX
        group[:k] = False
        if group.sum() > 1:
            flux = 10.0 ** (-0.4 * mag[group])
            xy[k] = flux @ xy[group] / flux.sum()
            mag[k] = -2.5 * np.log10(flux.sum())
            group[k] = False
            xy, mag = xy[~group], mag[~group]
        k += 1
    return xy, mag


def stars_on_detector(C_ci, depth, focal):
    """(xy_px, vmag) of the stars to V = depth, brightest first; focal: times the nominal focal length."""
    u_i, vmag = sky()
    n = np.searchsorted(vmag, depth, side="right")
    near = np.flatnonzero(u_i[:n] @ C_ci[2] > MIN_COSINE)
    u_c = u_i[near] @ C_ci.T
    xy = focal * CAMERA.focal_length_px * u_c[:, :2] / u_c[:, 2:] + CAMERA.principal_point_px
    inside = ((xy >= -0.5) & (xy <= SIZE - 0.5)).all(axis=1)
    return merged(xy[inside], vmag[near][inside])


def false_places(rng, n, shape):
    """(n, 2) places of false detections."""
    edge = SIZE - 1.0
    if shape == "cluster":
        return np.clip(rng.uniform([0.0, 0.0], edge) + rng.normal(0.0, 25.0, (n, 2)), 0.0, edge)
    if shape == "line":
        start, end = rng.uniform([0.0, 0.0], edge, (2, 2))
        return start + rng.random((n, 1)) * (end - start) + rng.normal(0.0, 0.5, (n, 2))
    return rng.uniform([0.0, 0.0], edge, (n, 2))


def attitude_towards(rng, q_ci, aim):
    """The attitude turned by the shortest way so that AIMS[aim] is anywhere on the detector."""
    ra, dec = np.radians(AIMS[aim])
    u_i = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    from_c = dcm_from_quat(q_ci) @ u_i
    place = (rng.uniform([0.0, 0.0], SIZE - 1.0) - CAMERA.principal_point_px) / CAMERA.focal_length_px
    to_c = np.append(place, 1.0) / np.hypot(1.0, np.hypot(*place))
    axis = np.cross(from_c, to_c)
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, from_c @ to_c)
    return quat_multiply(quat_from_rotvec(angle * axis / sine), q_ci)


def predicted_attitude(rng, q_ci, off_deg):
    """A prediction that is wrong by an angle about a random axis, and claims PREDICTION_SIGMA."""
    axis = rng.standard_normal(3)
    off = np.radians(off_deg) * axis / np.linalg.norm(axis)
    return quat_multiply(quat_from_rotvec(off), q_ci), np.eye(3) * PREDICTION_SIGMA**2


def make_field(
    rng,
    *,
    n_false=0,
    noise_px=0.15,
    scatter=0.1,
    missing=0.0,
    focal=1.0,
    shape="uniform",
    zero_point=0.0,
    depth=CUT,
    doubles=0.0,
    with_flux=True,
    predicted=None,
    aim=None,
):
    """One frame at a random attitude.

    Parameters
    ----------
    rng : Generator
    n_false : int, false detections; None: a number within NOISE_ONLY of them and no star
    noise_px : float, per axis
    scatter : float [mag]
    missing : float, share of the stars that are not detected
    focal : float, times the nominal focal length
    shape : 'uniform', 'cluster' or 'line', of the places of the false ones
    zero_point : float [mag]
    depth : float, V of the faintest detected star
    doubles : float, share of the stars that are up to 1 px off per axis
    with_flux : bool
    predicted : None or float [deg], error of a prediction
    aim : None or key of AIMS, somewhere on the detector

    Returns
    -------
    Field
    """
    q_ci = rng.standard_normal(4)
    q_ci /= np.linalg.norm(q_ci)
    if aim is not None:
        q_ci = attitude_towards(rng, q_ci, aim)
    xy, mag = stars_on_detector(dcm_from_quat(q_ci), depth, focal)
    if n_false is None:
        xy, mag, n_false = xy[:0], mag[:0], int(rng.integers(*NOISE_ONLY))
    keep = rng.random(len(mag)) >= missing
    xy, mag = xy[keep], mag[keep]
    n_stars = int((mag <= CUT).sum())
    xy = xy + rng.normal(0.0, noise_px, xy.shape)
    shifted = rng.random(len(mag)) < doubles
    xy[shifted] += rng.uniform(-1.0, 1.0, (shifted.sum(), 2))
    mag = mag + rng.normal(0.0, scatter, len(mag))
    xy = np.vstack([xy, false_places(rng, n_false, shape)])
    vmag = sky()[1]
    mag = np.concatenate([mag, rng.choice(vmag[: np.searchsorted(vmag, CUT)], n_false)])
    mix = rng.permutation(len(mag))
    flux = 1000.0 * 10.0 ** (-0.4 * (mag[mix] + zero_point)) if with_flux else None
    prediction = None if predicted is None else predicted_attitude(rng, q_ci, predicted)
    return Field(np.ascontiguousarray(xy[mix]), flux, prediction, q_ci, n_stars)


def make_fields(case, samples, seed):
    """The fields of one case; the first ones are the same for any number of samples."""
    rng = np.random.default_rng([seed, list(CASES).index(case)])
    return [make_field(rng, **CASES[case]) for _ in range(samples)]
