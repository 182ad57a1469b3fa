"""The two trackers of the IMPA campaign: the paper's chain and ours, which knows the rate; and false objects.

The paper's: clusters fused over two frames, compensated, Improved Multi-Poles, q-method, as published and
believed as published. Ours: one frame, streaks found along the motion that the gyros tell, the default
identification and the attitude of largest likelihood, all with the covariance of each streak.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.geometry.streak import velocity
from shefex_nav.onboard.startracker import objects, streaks, tracker
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.papers.impa import field
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.records import Reason
from shefex_nav.world.camera import hits

ARCSEC = np.radians(1.0 / 3600.0)
ZERO_FLUX_DN = field.ZERO_MAGNITUDE / field.ELECTRONS_PER_DN
SATURATION_DN = int(field.FULL_WELL / field.ELECTRONS_PER_DN + field.BLACK_LEVEL_DN)
DETECT = replace(
    STAR_TRACKER.detection,
    tile=64,
    most_objects=100,
    saturation=float(SATURATION_DN),
    run_length=replace(
        STAR_TRACKER.detection.run_length,  # with the window and v* of the scenario [E]
        threshold=IMPA["camera"]["tau_pre_electrons"],
        fusion_distance=float(IMPA["camera"]["fusion_distance_px"]),
    ),
)
IDENTIFY = replace(
    STAR_TRACKER.identification,  # eps_m is not given [E]; the paper does not have the verification
    method="multipole",
    tolerance=IMPA["protocol"]["tolerance_arcsec"] * ARCSEC,
    most_centroids=200,
    fewest_stars=IMPA["protocol"]["accept_stars"],
    centroid_error=0.3,
)
MODEL = CameraModel(
    field.CAMERA,
    electrons_per_dn=field.ELECTRONS_PER_DN,
    psf_sigma=field.PSF_SIGMA_PX,
    zero_flux=ZERO_FLUX_DN,
)
N_FALSE = IMPA["protocol"]["false_objects_worst_case"]
SUCCESS = IMPA["protocol"]["success_arcsec"] * ARCSEC  # of each cross-boresight error


@cache
def own():
    """Settings of our tracker for the paper's camera: TrackerParams."""
    identify = replace(STAR_TRACKER.identification, tolerance=IDENTIFY.tolerance)
    settings = replace(STAR_TRACKER, detection=DETECT, identification=identify)
    return tracker.TrackerParams(settings, MODEL, np.zeros(3))  # no aberration in the paper's sky


class False50(NamedTuple):
    """The false objects of one frame."""

    xy_px: np.ndarray  # (50, 2) uniform on the detector
    vmag: np.ndarray  # (50,)


def false_objects(rng, uniform=False):
    """Draw them, as bright as stars of the on-board catalogue, or evenly from 0 to its limit: False50."""
    size = np.array([field.CAMERA.width_px, field.CAMERA.height_px])
    if uniform:
        vmag = rng.uniform(0.0, IMPA["camera"]["catalogue_mag"], N_FALSE)
    else:
        vmag = rng.choice(field.pairs(False).stars.vmag, N_FALSE)
    return False50(rng.uniform(-0.5, size - 0.5, (N_FALSE, 2)), vmag)


def with_false(found, false, omega_c):
    """A list of detections with false objects in it, by brightness.

    Each false object has the covariance of the star of the frame that is nearest in brightness, turned from
    the direction in which that one moves to that in which a star would move there.
    """
    flux = ZERO_FLUX_DN * 10.0 ** (-0.4 * false.vmag)
    P_px = np.tile(0.09 * np.eye(2), (len(flux), 1, 1))
    if len(found.flux_dn):
        like = np.abs(np.log(flux[:, None] / found.flux_dn[None])).argmin(axis=1)
        turns = _heading(omega_c, false.xy_px) - _heading(omega_c, found.xy_px[like])
        C = turn2(turns).transpose(2, 0, 1)
        P_px = C @ found.P_px[like] @ C.transpose(0, 2, 1)
    none = np.zeros(len(flux), dtype=np.int64)
    columns = (false.xy_px, flux, none + 9, none, P_px)
    order = np.argsort(-np.concatenate([found.flux_dn, flux]), kind="stable")
    return type(found)(*(np.concatenate(pair)[order] for pair in zip(found, columns, strict=True)))


def _heading(omega_c, xy_px):
    """Direction in which a star moves at each place. (n, 2) -> (n,) rad."""
    v = _velocities(field.CAMERA, omega_c, xy_px)
    return np.arctan2(v[:, 1], v[:, 0])


@kernel
def _velocities(camera, omega_c, xy_px):
    """`velocity` at each place. (n, 2) -> (n, 2) px/s."""
    out = np.empty(xy_px.shape)
    for k in range(len(xy_px)):
        out[k] = velocity(camera, omega_c, xy_px[k, 0], xy_px[k, 1])
    return out


def turn2(angle):
    """Rotation of the picture plane by an angle: (2, 2)."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


ACCEPTANCES = ("verified", "as published")  # of the paper's identification


def published_attitudes(detections):
    """q_ic by the paper's identification of a list, or None, for each of ACCEPTANCES.

    Where the paper's check phase lets nothing pass there is nothing to verify either.
    """
    results = chain.attitudes(IDENTIFY, MODEL, field.pairs(False), detections)
    published, verified = (q_ic if found.reason == Reason.NONE else None for found, q_ic in results)
    return verified, published


def streaks_of(image_dn, omega_c, P_omega_c, times):
    """Our detections in one frame: Detections."""
    motion = streaks.Motion(omega_c, P_omega_c, times)
    return streaks.detect_streaks(DETECT, MODEL, image_dn, motion)[0]


def own_attitude(detections, motion):
    """Attitude of a list by our tracker with the motion that it was made with: q_ic and P_c, or None."""
    ready = tracker.Tracker(own(), field.pairs(True))
    rate = objects.rate_of(field.CAMERA, motion, detections)
    _, reason, (q_ic, P_c, _) = tracker.attitude(ready, detections, tracker.NO_CONTEXT, rate)
    return None if reason != Reason.NONE else (q_ic, P_c)


def error_of(q_ic, truth):
    """Attitude error (3,) rad about the axes of the camera: x, y across the boresight, z about it."""
    return rotvec_between(q_ic, truth)


def is_right(error):
    """Whether an error (3,) [rad] is a success of the paper: both angles across within 360 arcsec."""
    return (np.abs(error[:2]) <= SUCCESS).all()


HIT_TRAIL_PX = 3.0  # mean length of a trail on the detector [E]


def with_hits(image_dn, rng):
    """A copy of a frame with 50 particle hits, as much charge in each as light in a false object.

    Every second one comes down steeply, the others leave straight trails of any direction, their lengths
    drawn from an exponential distribution.
    """
    objects, (rows, columns) = false_objects(rng), image_dn.shape
    charge = field.ZERO_MAGNITUDE * 10.0 ** (-0.4 * objects.vmag)
    steep = hits.upsets(columns, rows, objects.xy_px[::2], charge[::2])
    electrons = np.zeros(rows * columns)
    np.add.at(electrons, steep.pixel, steep.electrons)
    for place, amount in zip(objects.xy_px[1::2], charge[1::2], strict=True):
        length, angle = 1.0 + rng.exponential(HIT_TRAIL_PX), rng.uniform(0.0, 2.0 * np.pi)
        half = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
        one = hits.trail(columns, rows, place - half, place + half, amount / length)
        np.add.at(electrons, one.pixel, one.electrons)
    struck = np.flatnonzero(electrons)
    grey = image_dn.ravel().astype(np.int64)
    grey[struck] += np.rint(rng.poisson(electrons[struck]) / field.ELECTRONS_PER_DN).astype(np.int64)
    return np.minimum(grey, SATURATION_DN).astype(image_dn.dtype).reshape(image_dn.shape)
