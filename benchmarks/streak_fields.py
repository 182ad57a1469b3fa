"""Random fields of a camera that turns: streaks, each with the covariance of its centroid.

In: a case (a name of CASES) and a random generator. Out: a Field as of `star_fields`. The camera is that of
the Improved Multi-Poles paper (18 um, 52 mm, 1024 x 1024, exposed 0.2 s, shutter rolling over the detector in
0.2 s or global); a streak is found by a matched filter, and the bound of Cramer and Rao is the covariance of
its centroid. False detections are uniform in place, unless a case says otherwise, with magnitudes drawn from
the stars' and covariances of streaks that would be there.
"""

from functools import cache
from itertools import product

import numpy as np
from star_fields import CUT, Field, merged, predicted_attitude, sky

from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.shutter import row_times
from shefex_nav.geometry.streak import seen_from_to, velocity
from shefex_nav.solve.centroids import Camera

CAMERA = Camera(1024, 1024, 52.0e-3 / 18.0e-6)
PINHOLE = Pinhole(1024, 1024, CAMERA.focal_length_px, 511.5, 511.5)
EXPOSURE_S = 0.2
ELECTRONS_PER_S = 7.3e6  # of magnitude 0
NOISE_ELECTRONS = 93.0  # per pixel: dark current, stray light, read-out [E]
PSF_PX = 1.1  # sigma [E]
DETECTED_SNR = 5.5
DEPTH = 6.5  # V
COMPLETE = 0.9  # of the stars bright enough are detected: the worst case
SCATTER = 0.05  # mag, beside the noise
RATE_ERROR = 0.02  # deg/s per axis, not told
MIN_COSINE = 0.96  # 16 deg; the corner of the detector is at 14.1 deg
DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
NOISE_ONLY = (20, 110)
CASES = {
    "streaks 5 deg/s": {},
    "streaks 5 deg/s + 50 false": {"n_false": 50},
    "streaks 5 deg/s + 50 false, global": {"n_false": 50, "is_rolling": False},
    "streaks 2 deg/s + 50 false": {"n_false": 50, "rate": 2.0},
    "streaks 0 deg/s + 50 false": {"n_false": 50, "rate": 0.0},
    "streaks 10 deg/s": {"rate": 10.0},
    "streaks 10 deg/s + 50 false": {"rate": 10.0, "n_false": 50},
    "+ 50 false, covariance / 1.5^2": {"n_false": 50, "said": 1.5**-2},
    "+ 50 false, covariance / 3^2": {"n_false": 50, "said": 3.0**-2},
    "+ 50 false, covariance x 2^2": {"n_false": 50, "said": 4.0},
    "+ 50 false, rate wrong 0.2 deg/s": {"n_false": 50, "rate_error": 0.2},
    "+ 50 false, ellipses turned 30 deg": {"n_false": 50, "turned": 30.0},
    "+ 50 false, ellipses anyhow": {"n_false": 50, "turned": None},
    "+ 50 false, small covariances": {"n_false": 50, "false_said": 1e-3},
    "+ 50 false, in a cluster": {"n_false": 50, "shape": "cluster"},
    "+ 50 false, tracking 0.05 deg off": {"n_false": 50, "predicted": 0.05},
    "+ 50 false, tracking 2 deg off": {"n_false": 50, "predicted": 2.0},
    "false only": {"n_false": None},
    "false only, small covariances": {"n_false": None, "false_said": 1e-3},
    "false only, in a cluster": {"n_false": None, "shape": "cluster"},
    "false only, told anything": {"n_false": None, "false_said": None},
    "+ 50 false, isotropic 0.15 px": {"n_false": 50, "is_told": False},
}  # fmt: skip


@cache
def usual_magnitudes():
    """V of the stars of the sky that a usual streak of 5 deg/s shows: the false ones draw from it."""
    vmag = sky()[1]
    vmag = vmag[: np.searchsorted(vmag, DEPTH)]
    snr = snr_of(electrons_of(vmag), np.full(len(vmag), 51.0))
    return vmag[snr > DETECTED_SNR]


def electrons_of(vmag):
    """Electrons of a row's exposure."""
    return ELECTRONS_PER_S * EXPOSURE_S * 10.0 ** (-0.4 * vmag)


def snr_of(electrons, length_px):
    """Signal over noise of a matched streak: its light and that of the pixels it fills."""
    width = 2.0 * np.sqrt(np.pi) * PSF_PX
    return electrons / np.sqrt(NOISE_ELECTRONS**2 * width * np.hypot(length_px, width) + electrons)


def covariances(snr, motion_px):
    """(n, 2, 2) px^2: sqrt(L s sqrt(pi)) / SNR along the streak, sqrt(2) s / SNR across; motion (n, 2)."""
    length = np.hypot(*motion_px.T)
    across = np.sqrt(2.0) * PSF_PX / snr
    along = np.maximum(np.sqrt(length * PSF_PX * np.sqrt(np.pi)) / snr, across)
    t = np.where(length[:, None] > 0.0, motion_px, [1.0, 0.0])
    t = t / np.hypot(*t.T)[:, None]
    outer = t[:, :, None] * t[:, None, :]
    return along[:, None, None] ** 2 * outer + across[:, None, None] ** 2 * (np.eye(2) - outer)


def motion_of(xy, omega_c, times):
    """Motion (n, 2) px while the light of each is collected; middle and length (n,) of that time [s]."""
    motion, middle, duration = np.empty_like(xy), np.empty(len(xy)), np.empty(len(xy))
    for k, (x, y) in enumerate(xy):
        begin, end = seen_from_to(PINHOLE, times, omega_c, x, y)
        middle[k], duration[k] = 0.5 * (begin + end), end - begin
        motion[k] = np.array(velocity(PINHOLE, omega_c, x, y)) * duration[k]
    return motion, middle, duration


def in_frame(C_ci):
    """(xy_px, vmag) of the stars to DEPTH, brightest first, close pairs merged."""
    u_i, vmag = sky()
    n = np.searchsorted(vmag, DEPTH, side="right")
    near = np.flatnonzero(u_i[:n] @ C_ci[2] > MIN_COSINE)
    u_c = u_i[near] @ C_ci.T
    xy = PINHOLE.focal_length_px * u_c[:, :2] / u_c[:, 2:] + [PINHOLE.cx_px, PINHOLE.cy_px]
    inside = ((xy >= 0.0) & (xy <= 1023.0)).all(axis=1)
    return merged(xy[inside], vmag[near][inside])


def drawn(rng, P):
    """One error (n, 2) from each covariance."""
    return (np.linalg.cholesky(P) @ rng.standard_normal((len(P), 2, 1)))[:, :, 0]


def told(rng, P, said, turned):
    """What is said of the covariances: too small or large, turned by degrees, None: by any angle."""
    if said is None:
        P, said = P * 10.0 ** rng.uniform(-3.0, 2.0, (len(P), 1, 1)), 1.0
    angle = rng.uniform(0.0, np.pi, len(P)) if turned is None else np.full(len(P), np.radians(turned))
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
    P = said * R @ P @ R.transpose(0, 2, 1)
    return 0.5 * (P + P.transpose(0, 2, 1))


def make_field(
    rng,
    *,
    n_false=0,
    rate=5.0,
    is_rolling=True,
    said=1.0,
    rate_error=RATE_ERROR,
    turned=0.0,
    false_said=1.0,
    shape="uniform",
    predicted=None,
    is_told=True,
):
    """One frame at a random attitude, turning about one of the 26 directions to a cube's neighbours.

    Parameters
    ----------
    rng : Generator
    n_false : int, false detections; None: a number within NOISE_ONLY of them and no star
    rate : float [deg/s]
    is_rolling : bool, a shutter that goes on by one row in EXPOSURE_S / 1024, or a global one
    said : float, times the covariances of the errors
    rate_error : float [deg/s], sigma per axis; places refer to the frame's instant, the light does not
    turned : float [deg], ellipses are told with this error; None: with any orientation
    false_said : float, times the covariances of false detections; None: factors from 1e-3 to 100
    shape : 'uniform' or 'cluster', of the places of the false ones
    predicted : None or float [deg], error of a prediction
    is_told : bool, whether covariances are given at all

    Returns
    -------
    Field
    """
    q_ci = rng.standard_normal(4)
    q_ci /= np.linalg.norm(q_ci)
    direction = DIRECTIONS[rng.integers(len(DIRECTIONS))]
    omega_c = np.radians(rate) * direction / np.linalg.norm(direction)
    times = row_times(EXPOSURE_S, EXPOSURE_S / 1024 if is_rolling else 0.0, 1024)
    xy, vmag = in_frame(dcm_from_quat(q_ci))
    if n_false is None:
        xy, vmag, n_false = xy[:0], vmag[:0], int(rng.integers(*NOISE_ONLY))
    n_true = len(vmag)
    xy = np.vstack([xy, false_places(rng, n_false, shape)])
    vmag = np.concatenate([vmag, rng.choice(usual_magnitudes(), n_false)])
    motion, middle, duration = motion_of(xy, omega_c, times)
    snr = snr_of(electrons_of(vmag) * duration / EXPOSURE_S, np.hypot(*motion.T))
    is_false = np.arange(len(vmag)) >= n_true
    seen = (snr + rng.standard_normal(len(snr)) > DETECTED_SNR) & (rng.random(len(snr)) < COMPLETE) | is_false
    xy, vmag, snr, is_false = xy[seen], vmag[seen], snr[seen], is_false[seen]
    motion, middle = motion[seen], middle[seen]
    n_stars = int(((vmag <= CUT) & ~is_false).sum())
    P = covariances(snr, motion)
    late = np.radians(rate_error) * rng.standard_normal(3)
    xy = xy + drawn(rng, P)
    xy += middle[:, None] * np.array([velocity(PINHOLE, late, x, y) for x, y in xy]).reshape(-1, 2)
    mag = vmag + rng.normal(0.0, np.hypot(SCATTER, 1.0857 / np.maximum(snr, 3.0)))
    said_P = told(rng, P, said, turned)
    said_P[is_false] = told(rng, P[is_false], false_said, 0.0)
    mix = rng.permutation(len(mag))
    prediction = None if predicted is None else predicted_attitude(rng, q_ci, predicted)
    return Field(
        np.ascontiguousarray(xy[mix]), 10.0 ** (-0.4 * (mag[mix] - 10.0)), prediction, q_ci, n_stars,
        said_P[mix] if is_told else None,
    )  # fmt: skip


def false_places(rng, n, shape):
    """(n, 2) places of false detections."""
    if shape == "cluster":
        return np.clip(rng.uniform(0.0, 1023.0, 2) + rng.normal(0.0, 40.0, (n, 2)), 0.0, 1023.0)
    return rng.uniform(0.0, 1023.0, (n, 2))


def make_fields(case, samples, seed):
    """The fields of one case; the first ones are the same for any number of samples."""
    rng = np.random.default_rng([seed, 100 + list(CASES).index(case)])
    return [make_field(rng, **CASES[case]) for _ in range(samples)]
