"""BRIGHT table 4: the three methods on frames of the ZY-3 star tracker, rendered instead of from orbit.

As in the paper, every frame shows at least six stars brighter than 5, and the brightness of a star differs
from the catalogue's by up to 0.7 mag. Exposure, optics and noise of the camera are not in the paper: they are
engineering values [E], 12-bit grey values among them, with which its accuracy is met: the centroids of the
stars to magnitude 5 are off by 5 arcsec (3 sigma).
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from shefex_nav.environment.stars import at_epoch, load_catalogue
from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.objects import detect
from shefex_nav.papers.bright import fields, outcomes
from shefex_nav.papers.bright.published import BRIGHT
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.stills import random_attitude
from shefex_nav.report import intervals
from shefex_nav.world.camera import motion, render

LEAST_STARS = 6  # brighter than 5, in every image of the paper
MAGNITUDE_SCATTER, MAGNITUDE_LIMIT = 0.25, 0.7  # mag; standard deviation [E], and the largest in the paper
SPIKES = 1.0  # false stars a frame, mean: debris and particle hits [E]
RENDER_LIMIT = 7.0  # V

ZERO_MAGNITUDE_ELECTRONS = 1.5e6  # of one exposure: about 0.25 s with 5 cm^2 [E]
PSF_SIGMA_PX = 1.0  # [E]
BACKGROUND_ELECTRONS, READ_NOISE_ELECTRONS = 100.0, 20.0  # [E]
ELECTRONS_PER_DN, BLACK_LEVEL_DN, LARGEST_DN = 15.0, 40.0, 4095  # 12 bits; V = 1 is on the edge [E]

DETECT = replace(STAR_TRACKER.detection, tile=64, most_objects=60, saturation=float(LARGEST_DN))
MODEL = CameraModel(fields.CAMERA, electrons_per_dn=ELECTRONS_PER_DN, psf_sigma=PSF_SIGMA_PX)
# of the identification in frames: their magnitudes are worse than in table 3
IDENTIFY = replace(fields.IDENTIFY, magnitude_error=MAGNITUDE_SCATTER)
REFERENCE_FLUX = 10.0 ** (-0.4 * (BRIGHT["protocol"]["reference_star_mag"] - MAGNITUDE_LIMIT))
SAME_PX = 2.0  # a detection this near to a star is that star


@lru_cache(maxsize=1)
def sky():
    """What the camera sees: (n, 3) directions and (n,) Hp."""
    stars = at_epoch(load_catalogue(RENDER_LIMIT), fields.EPOCH)
    magnitude = np.where(np.isnan(stars.hpmag), stars.vmag, stars.hpmag)
    return stars.u_i, magnitude


def draw_frame(rng):
    """A frame with enough stars: image (rows, columns) uint16, true attitude q_ic."""
    u_i, magnitude = sky()
    bright = fields.pairs()[0].stars
    q_ic = random_attitude(rng)
    while len(fields.in_view(bright, q_ic, False)[0]) < LEAST_STARS:
        q_ic = random_attitude(rng)
    off = np.clip(rng.normal(0.0, MAGNITUDE_SCATTER, len(magnitude)), -MAGNITUDE_LIMIT, MAGNITUDE_LIMIT)
    C_ci = np.ascontiguousarray(dcm_from_quat(q_ic).T)
    camera, psf = fields.CAMERA, render.gaussian_psf(PSF_SIGMA_PX)
    light = render.darkness(camera.width_px * camera.height_px)
    electrons = ZERO_MAGNITUDE_ELECTRONS * 10.0 ** (-0.4 * (magnitude + off))
    near = u_i @ C_ci[2] > 0.9
    render.add_points(light, camera, psf, motion.at_rest(C_ci), u_i[near], electrons[near], 0.01)
    n_spikes = rng.poisson(SPIKES)
    places = rng.uniform(0.0, [camera.width_px - 1.0, camera.height_px - 1.0], (n_spikes, 2))
    spike_electrons = ZERO_MAGNITUDE_ELECTRONS * 10.0 ** (-0.4 * rng.choice(bright.vmag, n_spikes))
    still = motion.at_rest(np.eye(3))
    render.add_points(light, camera, psf, still, unit_vectors(camera, places), spike_electrons, 0.01)
    return read_out(light.electrons.reshape(camera.height_px, camera.width_px), rng), q_ic


def read_out(electrons, rng):
    """12-bit grey values: shot noise and read noise. (rows, columns) mean electrons -> uint16.

    The shot noise is drawn as normal: with a background of 100 electrons the difference is in the tails.
    """
    mean = electrons + BACKGROUND_ELECTRONS
    noise = rng.standard_normal(mean.shape, dtype=np.float32)
    collected = mean + np.sqrt(mean + READ_NOISE_ELECTRONS**2) * noise
    grey = np.floor(collected / ELECTRONS_PER_DN + BLACK_LEVEL_DN + 0.5)
    return np.clip(grey, 0, LARGEST_DN).astype(np.uint16)


def detected_field(image_dn, q_ic):
    """What the detection makes of a frame: Field, with the star that each detection really is."""
    found, _ = detect(DETECT, MODEL, image_dn)
    stars = fields.pairs()[0].stars
    rows, xy_px = fields.in_view(stars, q_ic, False)
    star = np.full(len(found.xy_px), -1, dtype=np.int64)
    for row, place in zip(rows, xy_px, strict=True):
        distance = np.hypot(*(found.xy_px - place).T)
        nearest = distance.argmin()
        if distance[nearest] < SAME_PX:
            star[nearest] = row
    flux = found.flux_dn * ELECTRONS_PER_DN / ZERO_MAGNITUDE_ELECTRONS
    return fields.Field(unit_vectors(fields.CAMERA, found.xy_px), flux, star)


def measure_table4(samples, seed):
    """Outcome and seconds of each method, and how many of the ten brightest detections are false.

    Returns
    -------
    outcome, seconds : (methods, samples)
    n_false : (samples,)
    """
    rng, tables = np.random.default_rng(seed), fields.pairs()
    outcome = np.zeros((len(outcomes.TRIED), samples), dtype=np.int8)
    seconds, n_false = np.zeros(outcome.shape), np.zeros(samples, dtype=np.int16)
    warm = detected_field(*draw_frame(np.random.default_rng(0)))
    outcomes.attempt(IDENTIFY, REFERENCE_FLUX, tables, warm)
    for k in range(samples):
        field = detected_field(*draw_frame(rng))
        n_false[k] = (field.star[: IDENTIFY.most_centroids] < 0).sum()
        outcome[:, k], seconds[:, k] = outcomes.attempt(IDENTIFY, REFERENCE_FLUX, tables, field)
    return outcome, seconds, n_false


def conclude_table4(results):
    outcome = np.concatenate([result[0] for result in results], axis=1)
    seconds = np.array([result[1].mean(axis=1) for result in results])
    condition, published = "rendered frames", BRIGHT["table4"]
    n_false = np.concatenate([result[2] for result in results])
    share, interval = n_false.mean() / IDENTIFY.most_centroids, None
    if len(n_false) > 1:
        interval = tuple(v / IDENTIFY.most_centroids for v in intervals.mean(n_false))
    rows = [Row("false stars among the ten brightest", condition, None, float(share), interval)]
    rows += outcomes.method_rows("bright-table4", condition, outcome, published, 1000)
    for method, codes in zip(outcomes.METHODS, outcome, strict=False):
        if method in outcomes.OWN:
            rows += outcomes.own_rows(condition, method, codes, np.full(len(codes), LEAST_STARS))
    return rows + outcomes.time_rows(condition, seconds, published)


def draw_table4(figure, results, rows):
    """Failed and wrong, published and measured."""
    outcomes.draw_outcomes(figure, rows, ["rendered frames"])
