"""The simulations of the IMPA campaign: frames, the paper's chain and ours on the same ones.

A simulation flies up to 60 contiguous frames at a constant rate and ends when the paper's chain has had its
attitude in the best and in the worst case. The cases share the frames: the false objects of the worst one
enter the lists after the fusion. Our tracker sees the first two frames, with and without the same false
objects in its list, and the same two frames again with 50 hits in the picture.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.papers.impa import field, trackers
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.stills import electrons, still

MOST_IMAGES = IMPA["protocol"]["max_images"]
CASES = ("best_case", "worst_case")
SITUATIONS = ("best_case", "worst_case", "hits in the frame")  # of ours
OWN_FRAMES = 2


class Assumed(NamedTuple):
    """What the paper does not give."""

    sigma_px: float  # of the spot
    uniform: bool  # magnitudes of the false objects: even from 0 to the catalogue's limit, or as of its stars
    with_own: bool  # whether our tracker flies too
    longer_px: tuple = (0.0,)  # extents of streaks: each gives a list of objects, as `chain.compensated`


AS_SET = Assumed(field.PSF_SIGMA_PX, False, True)
BOTH_ENDS_PX = 1.0  # longer are extents that count both end rows and columns
# the spot is fitted to table 8, success within two images at 1 and 2 deg/s
JOINT = Assumed(0.7, True, False, (0.0, BOTH_ENDS_PX))

NEAR = np.cos(0.5 * field.FIELD + np.radians(3.0))  # of the boresight: stars that are drawn


def frame(shutter, case, number, rng, sigma_px=field.PSF_SIGMA_PX, psf=None):
    """Frame `number` (0, 1, ...) of a simulation: (rows, columns) uint16. psf: of another spot, `spot`."""
    camera = field.camera(shutter)._replace(sigma_psf_px=sigma_px, psf=psf)
    q_ic = field.attitude_at(case, number)
    u_i, light = near_stars(camera, q_ic)
    return still(camera, u_i, light, q_ic, rng, omega_c=case.omega_c)[0]


def pictures(shutter, case, rng, **how):
    """The first two frames of a simulation; how: as `frame` has them."""
    return [frame(shutter, case, number, rng, **how) for number in (0, 1)]


def near_stars(camera, q_ic):
    """Stars around the boresight: directions (n, 3), electrons (n,)."""
    u_i, vmag = field.stars()
    w, x, y, z = q_ic
    boresight = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
    rows = np.flatnonzero(u_i @ boresight > NEAR)
    return u_i[rows], electrons(camera, vmag[rows])


def simulate(shutter, case, seed, most_images=MOST_IMAGES, assumed=AS_SET):
    """One simulation.

    Parameters
    ----------
    shutter : one of SHUTTERS
    case : impa_field.Case
    seed : SeedSequence
    most_images : int, of the paper's chain; 0: ours alone
    assumed : Assumed; without our tracker `own` is zero

    Returns
    -------
    published : (2, 2, 4) for each of CASES and ACCEPTANCES: images needed (0: no attitude), error about x, y,
        z [arcsec]. (2, 3, 4) with `longer_px` of two: the last one with the second, verified
    own : (3, 2, 7) for each of SITUATIONS and frame: 1: an attitude, error, its standard deviation [arcsec]
    flown : int, frames that the paper's chain processed
    """
    noise, false_rng, gyro_rng, hit_rng = (np.random.default_rng(s) for s in seed.spawn(4))
    omega_c, P_omega_c = field.gyro(case, gyro_rng)
    published = np.zeros((len(CASES), len(trackers.ACCEPTANCES) + len(assumed.longer_px) - 1, 4))
    own = np.zeros((len(SITUATIONS), OWN_FRAMES, 7))
    times, clusters, number = field.times(shutter), None, 0
    motion = trackers.streaks.Motion(omega_c, P_omega_c, times)
    while number < max(OWN_FRAMES, most_images) and not (number >= OWN_FRAMES and published[..., 0].all()):
        image = frame(shutter, case, number, noise, assumed.sigma_px)
        truth, false = field.attitude_at(case, number), trackers.false_objects(false_rng, assumed.uniform)
        if number < OWN_FRAMES and assumed.with_own:
            found = trackers.streaks_of(image, omega_c, P_omega_c, times)
            struck = trackers.streaks_of(trackers.with_hits(image, hit_rng), omega_c, P_omega_c, times)
            lists = (found, trackers.with_false(found, false, omega_c), struck)
            for k, detections in enumerate(lists):
                own[k, number] = _own_result(trackers.own_attitude(detections, motion), truth)
        if most_images:
            clusters, lists = _objects(times, clusters, image, assumed.longer_px)
        if most_images and number > 0:
            crowded = [trackers.with_false(one, false, case.omega_c) for one in lists]
            for k, of_case in enumerate((lists, crowded)):
                if published[k, :, 0].all():
                    continue
                for a, q_ic in enumerate(_attitudes(of_case)):
                    if q_ic is not None and not published[k, a, 0]:
                        error = trackers.error_of(q_ic, truth) / trackers.ARCSEC
                        published[k, a] = number + 1, *error
        number += 1
    return published, own, number if most_images else 0


def _objects(times, before, image_dn, longer_px):
    """Clusters of a frame, and its objects with each of the extents: Clusters, list of Detections."""
    clusters = cluster.find(trackers.DETECT, trackers.MODEL, image_dn)
    if before is None:
        return clusters, []
    settings = trackers.DETECT.run_length
    rows, shift_px = chain.fused(settings, before, clusters, image_dn.shape)
    given = settings, times, clusters, rows, shift_px
    return clusters, [chain.detections(*given, longer_px=one) for one in longer_px]


def _attitudes(lists):
    """q_ic or None: of the first list by each of ACCEPTANCES, of the others verified."""
    first, *others = (trackers.published_attitudes(one) for one in lists)
    return [*first, *(found[0] for found in others)]


def _own_result(found, truth):
    if found is None:
        return np.concatenate([[0.0], np.full(6, np.nan)])
    q_ic, P_c = found
    sigma = np.sqrt(np.diag(P_c))
    return np.concatenate([[1.0], trackers.error_of(q_ic, truth) / trackers.ARCSEC, sigma / trackers.ARCSEC])


def measure_joint(samples, seed, first):
    """The same with JOINT, without ours and the flights at 10 deg/s."""
    return measure(samples, seed, first, JOINT)


def measure(samples, seed, first, assumed=AS_SET):
    """Samples first ... of the campaign, each with both shutters.

    Returns
    -------
    dict of arrays over the m simulations of the samples, two shutters each:
        rate_deg_s (m,), attitude (m,), direction (m,), published (m, 2, 2, 2 or 3, 4), own
        (m, 2, 3, 2, 7), flown (m, 2); see `simulate`. At 10 deg/s the paper's chain has not flown.
    """
    names = ("rate_deg_s", "attitude", "direction", "published", "own", "flown")
    rows = {name: [] for name in names}
    for number, own_seed in zip(range(first, first + samples), seed.spawn(samples), strict=True):
        for case in field.cases(number):
            if case.rate >= field.FAST and not assumed.with_own:
                continue
            images = MOST_IMAGES if case.rate < field.FAST else 0
            seeds = own_seed.spawn(len(field.SHUTTERS))
            done = [
                simulate(shutter, case, one, images, assumed)
                for shutter, one in zip(field.SHUTTERS, seeds, strict=True)
            ]
            rows["rate_deg_s"].append(round(float(np.degrees(case.rate)), 6))
            rows["attitude"].append(case.attitude)
            rows["direction"].append(case.direction)
            for name, column in zip(("published", "own", "flown"), zip(*done, strict=True), strict=True):
                rows[name].append(column)
    return {name: np.array(column) for name, column in rows.items()}
