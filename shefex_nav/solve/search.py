"""The attitude of a list of detections by a lens that nobody told: proposals, adjusted, until one is proved.

In: places and brightnesses, the range of focal lengths. Out: the fit that is true, or the reason for none.
Wide fields are looked at with several laws of lenses in turn, because a triangle has another shape in each.
"""

from functools import lru_cache
from time import perf_counter
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import select
from shefex_nav.geometry.pinhole import solid_angle
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS
from shefex_nav.solve import lens, patterns, proof, triangles

ROUNDS = (8, 15, 24)  # brightest detections that form triangles, more and more
FEW_ROUNDS = ROUNDS[:2]  # where nothing but a word depends on it: a quarter of all triangles
CLEAR, WORTH = 45.0, 18.0  # ln odds of proposals: tried at once, tried at all
TRIED = 8  # proposals a round, apart from the clear ones
LEAST = 5  # detections without which nothing is begun
BLEND_PX = 2.5  # closer stars are one point of light
FAINT_NEIGHBOUR = 1.5  # mag, a star may be fainter than the faintest and still pull a brighter one
DEEPER, DEEPER_BY = 1.5, 15  # stars for so many detections: the sky is uneven, and some are hidden
CUBIC = (1.0 / 3.0, -0.01)  # of r / f in angle^3: a pinhole, and a little beyond r = f theta
LAW_SHARE = 0.03  # laws whose corners differ by less, relative, are one
WIDEST = 1.2  # rad from the axis, of a polynomial in tan^2
MARGIN = 0.01  # rad, around the picture


class Clock:
    """Time since it was made, without the waits for tables."""

    def __init__(self):
        self.began = perf_counter()

    def wait_for(self, make, *arguments):
        """The result of a function whose time does not count."""
        stopped = perf_counter()
        made = make(*arguments)
        self.began += perf_counter() - stopped
        return made

    def ms(self):
        """Milliseconds."""
        return 1e3 * (perf_counter() - self.began)


class Search(NamedTuple):
    """What is looked for."""

    size_px: tuple  # (width, height)
    focal_range: tuple  # (shortest, longest) focal length [px]
    year: float
    may_distort: bool


def solve(xy_px, flux, search, clock, trials=None, rounds=ROUNDS):
    """The (Fit, Proof) that is true, or None; and the reason.

    trials : list, filled with what was examined
    rounds : how many of the brightest detections form triangles, more and more
    """
    if len(flux) < LEAST:
        return None, "too_few_stars"
    xy_px, flux = np.ascontiguousarray(xy_px[:MAX_DETECTIONS]), flux[:MAX_DETECTIONS]
    cells, wide_px = triangles.detection_cells(xy_px, *search.size_px), tuple(map(float, search.size_px))
    spots = triangles.Spots(xy_px, -2.5 * np.log10(flux), wide_px, cells, 0.0)
    size = np.sqrt(search.size_px[0] * search.size_px[1])
    numbers = patterns.bands(size / search.focal_range[1], size / search.focal_range[0])
    ways = [
        (number, xi)
        for number in numbers
        for xi in (laws(number, search.size_px) if search.may_distort else (0.0,))
    ]
    tried = max(sum(number == other for other, _ in ways) for number in numbers)
    kept, filled = np.zeros((len(ways), triangles.KEPT, 12)), np.zeros(len(ways), dtype=np.int64)
    done, reason = set(), "no_match"
    for first, last in zip((2, *rounds[:-1]), rounds, strict=True):
        for w in (*range(len(ways)), -1):  # each way for itself, then the best of all
            if w >= 0 and first < len(flux):
                number, xi = ways[w]
                band = clock.wait_for(patterns.band, number, search.year)
                faintest = first, min(last, len(flux))
                filled[w], _ = triangles.propose(
                    spots._replace(xi=xi), search.focal_range, *faintest, band, kept[w], filled[w]
                )
            chosen = kept[w] if w >= 0 else kept.reshape(-1, 12)
            for proposal in _best(chosen, CLEAR if w >= 0 else WORTH, done):
                found, outcome = _examined(proposal, xy_px, flux, search, tried)
                if trials is not None:
                    trials.append((proposal, found, outcome))
                if outcome is not None and outcome.is_true:
                    return (found, outcome), ""
                if outcome is not None and outcome.is_rivalled:
                    reason = "ambiguous"
    return None, reason


@lru_cache(maxsize=64)
def laws(number, size_px):
    """xi of the lenses that proposals of a band are made for, the pinhole first."""
    corner = 0.5 * np.hypot(*size_px) / np.sqrt(size_px[0] * size_px[1])
    angle = np.arctan(corner * patterns.SMALLEST * patterns.RATIO ** (number + 0.5))
    n = 1 + int((CUBIC[0] - CUBIC[1]) * angle**2 / LAW_SHARE)
    cubic = np.linspace(*CUBIC, n) if n > 1 else np.array(CUBIC[:1])
    # r / f = (1 + xi) sin / (cos + xi) = angle + (1 / (2 (1 + xi)) - 1/6) angle^3 + ...
    return tuple((0.5 / (cubic + 1.0 / 6.0) - 1.0).tolist())


def lens_of(proposal, size_px):
    """Lens of a row of proposals: its law as a polynomial of tan^2 over the picture."""
    C_ci, focal_px, xi = proposal[2:11].reshape(3, 3), float(proposal[1]), float(proposal[11])
    if xi == 0.0:
        return lens.Lens(C_ci, focal_px)
    m2 = (0.5 * np.hypot(*size_px) / (focal_px * (1.0 + xi))) ** 2  # of `triangles.directions`
    farthest = (xi + np.sqrt(max(1.0 + (1.0 - xi * xi) * m2, 0.0))) / (1.0 + m2) - xi
    angle = min(float(np.arccos(np.clip(farthest, -1.0, 1.0))), WIDEST) * np.linspace(0.1, 1.0, 20)
    t2 = np.tan(angle) ** 2
    ratio = (1.0 + xi) * np.cos(angle) / (np.cos(angle) + xi) - 1.0
    k1, k2, k3 = np.linalg.lstsq(np.column_stack([t2, t2**2, t2**3]), ratio, rcond=None)[0].tolist()
    return lens.Lens(C_ci, focal_px, (k1, k2, 0.0, 0.0, k3))


def _best(kept, least, done):
    """The best proposals with at least these odds that are not in `done`, where they are put."""
    chosen = []
    if kept[:, 0].max() < least:  # nearly always
        return chosen
    for proposal in kept[np.argsort(-kept[:, 0])]:
        if len(chosen) == TRIED or proposal[0] < least:
            break
        if tuple(proposal) not in done:
            done.add(tuple(proposal))
            chosen.append(proposal.copy())
    return chosen


def _examined(proposal, xy_px, flux, search, tried):
    """Fit and Proof of a proposal; None, None when nothing fits."""
    size_px, focal_range, year, may_distort = search
    first = lens_of(proposal, size_px)
    if not lens.is_lens(first, size_px):
        return None, None
    sky = sky_of(first, DEEPER * len(flux) + DEEPER_BY, size_px, year)
    if len(sky.hip) < LEAST:
        return None, None
    fit = lens.fit(first, sky.u_i, xy_px, size_px, least=proof.MIN_MATCHED, may_distort=may_distort)
    if fit is None or not 0.98 * focal_range[0] < fit.lens.focal_px < 1.02 * focal_range[1]:
        return None, None
    log_range = np.log(focal_range[1] / focal_range[0])
    return fit, proof.prove(fit, sky, xy_px, flux, size_px, log_range, tried)


def sky_of(at, n_stars, size_px, year):
    """Stars in and a little around a picture, to the magnitude that so many are in it in the mean."""
    stars = patterns.catalogue(year)
    vmag = patterns.magnitude_of(n_stars / solid_angle(*size_px, at.focal_px))
    radius = lens.corner_angle(at, size_px) + MARGIN
    near = (stars.u_i @ at.C_ci[2] > np.cos(radius)) & (stars.vmag <= vmag + FAINT_NEIGHBOUR)
    return patterns.merged(select(stars, np.flatnonzero(near)), vmag, BLEND_PX / at.focal_px)
