"""BRIGHT figure 1: the centroids of a star that moves through the frames."""

from functools import partial

import numpy as np

from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.geometry.rotation import quat_from_rotvec
from shefex_nav.onboard.startracker.objects import by_fit, detect
from shefex_nav.papers import rows
from shefex_nav.papers.bright.methods.centroids import by_interpolation, by_mass
from shefex_nav.papers.bright.published import BRIGHT
from shefex_nav.papers.picture import COLOURS, tidy
from shefex_nav.papers.shefex2.frames import DETECT, MODEL, SPACE
from shefex_nav.papers.stills import StillCamera, electrons, still
from shefex_nav.papers.verdict import POINTS
from shefex_nav.report import intervals

IMAGES = 50
VMAG = 2.9
ROI_PX = 5
STEPS_PX = (0.1, 1.0)  # from image to image, drawn evenly [E]
TRACK_CENTROIDS = {
    "centre_of_mass": partial(by_mass, roi_px=ROI_PX),
    "gaussian_interpolation": partial(by_interpolation, roi_px=ROI_PX),
    "fit": by_fit,
}
# [E] the paper tells neither the width of the spots nor the noise: those of the SHEFEX camera
TRACKER = StillCamera(
    pinhole(
        128, 128, BRIGHT["camera"]["focal_length_mm"] * 1e3 / BRIGHT["camera"]["pixel_um"]
    ),  # the part of the detector that the star crosses
    0.8,
    SPACE.electronics,
    20.0,
    2.5e6 * 0.05,
)


def track(rng):
    """One star outwards from the middle of the detector: distance by method in each image, (methods, images).

    Also the true distance, last.
    """
    angle, step_px = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*STEPS_PX)
    across = np.array([-np.sin(angle), np.cos(angle), 0.0])
    f, light = TRACKER.pinhole.focal_length_px, electrons(TRACKER, [VMAG])
    distance = np.empty((len(TRACK_CENTROIDS) + 1, IMAGES))
    camera = MODEL._replace(pinhole=TRACKER.pinhole, psf_sigma=TRACKER.sigma_psf_px)
    middle = np.array([TRACKER.pinhole.cx_px, TRACKER.pinhole.cy_px])
    begin_px = rng.uniform(2.0, 8.0)
    for k in range(IMAGES):
        q_ic = quat_from_rotvec(-across * np.arctan((begin_px + k * step_px) / f))
        image, xy_px = still(TRACKER, np.array([[0.0, 0.0, 1.0]]), light, q_ic, rng)
        distance[-1, k] = np.linalg.norm(xy_px[0] - middle)
        for m, centres in enumerate(TRACK_CENTROIDS.values()):
            found, _ = detect(DETECT, camera, image, centres)
            distance[m, k] = np.linalg.norm(found.xy_px[0] - middle)
    return distance


def scatter(distance):
    """1 - r^2 of a straight line through equal steps. (..., images) -> (...)."""
    t = np.arange(distance.shape[-1]) - 0.5 * (distance.shape[-1] - 1)
    centred = distance - distance.mean(axis=-1, keepdims=True)
    slope = (centred @ t) / (t @ t)
    rest = centred - slope[..., None] * t
    return (rest**2).sum(axis=-1) / (centred**2).sum(axis=-1)


def measure_centroids(samples, seed):
    """Tracks of one star: (samples, methods + 1, images) px."""
    rng = np.random.default_rng(seed)
    return np.array([track(rng) for _ in range(samples)])


def conclude_centroids(results):
    """Rows: which centroid is the smoother, r^2 and error of each."""
    distance = np.concatenate(results)
    left = scatter(distance[:, :-1])
    smoother = left[:, 0] < left[:, 1]
    condition = f"{IMAGES} images of a star of V {VMAG:g}"
    quantity, one = "tracks on which the centre of mass has the higher r^2", ", published: one track"
    k, n = int(smoother.sum()), len(smoother)
    given = k / n, intervals.proportion(k, n), n
    criterion = {"least": np.nextafter(0.5, 1.0), "resolves": POINTS}
    found = [rows.statement(quantity, condition + one, None, *given, **criterion)]
    names = [method.replace("_", " ") for method in TRACK_CENTROIDS]
    for m, name in enumerate(names):
        found.append(rows.median(f"1 - r^2, {name}", condition, left[:, m]))
    for m, name in enumerate(names):
        error = np.sqrt(((distance[:, m] - distance[:, -1]) ** 2).mean(axis=1))
        found.append(rows.median(f"error along the track [px rms], {name}", condition, error))
    return found


def draw_centroids(figure, results, _rows):
    """The first track as in the paper's figure 1: distance from the straight line, image by image."""
    distance = results[0][0]
    images = np.arange(1, distance.shape[1] + 1)
    figure.set_size_inches(10.0, 4.5)
    left, right = figure.subplots(1, 2)
    for m, method in enumerate(TRACK_CENTROIDS):
        name, colour = method.replace("_", " "), COLOURS[m]
        line = np.polyval(np.polyfit(images, distance[m], 1), images)
        left.plot(images, distance[m] - distance[m, 0], lw=1.0, color=colour, label=name)
        right.plot(images, distance[m] - line, "o-", ms=3, lw=0.8, color=colour, label=name)
    left.set_ylabel("change of the distance [px]")
    right.set_ylabel("distance from a straight line [px]")
    for axis in (left, right):
        axis.set_xlabel("image")
        axis.legend(frameon=False, fontsize=9)
        tidy(axis)
