"""Is the sky, as the star camera sees it, bright enough for the star tracker, and not too bright?

Three figures of a scenario, without any picture: how many stars of the catalogue are in the field of view on
average; to which magnitude the detection finds a star at rest in the longest exposure; the mean grey value of
the empty sky in the shortest one. They flatter the star tracker (no motion, no stray light), so what fails
here fails in flight.

Magnitudes are in the band of the catalogue on board, `star_tracker.catalogue.system`, but for those of the
stars that are drawn, which are V. The faintest star is white: its magnitude is the same in every band.

A star of E electrons has the share erf(h / sqrt(2) / s)^2 of them in a square of 2 h pixels around its middle
(Gaussian spot of standard deviation s). The detection finds it where that exceeds its threshold: `seed_sigma`
times the noise of a sum of 3x3 pixels, of a pixel where the scan looks at single ones, or an amount of charge
(`run_length`).
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import ephemeris, stars
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.scenario import lens
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.software import BUILT_IN
from shefex_nav.world.camera import detector

BLOCK = 3.0  # pixels, side of the sums that are searched (onboard.startracker.background)
SPHERE = 4.0 * math.pi
SURE = 20.0  # stars in the field on average: there are pairs enough
DEEPER = 1.2  # mag [E]: stars of a third of the light
LISTED = 8.0  # V, the faintest star of the program's table


class Light(NamedTuple):
    """What the star camera of a scenario sees of the sky."""

    in_field: float  # stars of the catalogue in the field of view, on average
    faintest: float  # magnitude that is found of a white star at rest
    found: float  # stars of the catalogue as bright as that, in the field of view, on average
    drawn: float  # stars that are drawn and found, in the field of view, on average
    empty_dn: float  # mean grey value of the empty sky in the shortest exposure
    field_deg: tuple  # (2,) width and height of the field of view


def of(scenario):
    """Light of a Scenario; raises CatalogueError where no catalogue can be made."""
    camera, tracker = settings(scenario.star_camera), settings(scenario.star_tracker)
    chip = camera.detector
    half, share = _field(camera)
    year = ephemeris.julian_year(scenario.mission.epoch)
    catalogue.check_deepest(tracker)
    known = _known(tracker.catalogue, year)
    if share * len(known.hip) < SURE:
        _check_pairs(tracker.catalogue, year, 2.0 * math.atan(math.hypot(*half)))
    faintest = _faintest(camera, tracker)
    electrons_per_dn = detector.electronics(chip, tracker.exposure.gain).electrons_per_dn
    return Light(
        share * len(known.hip),
        faintest,
        share * int(np.count_nonzero(known.vmag <= faintest)),
        share * _brighter(tracker.catalogue.system, faintest, camera.stars.faintest),
        chip.black_level + chip.background * tracker.exposure.shortest / electrons_per_dn,
        lens.field_of_view_deg(camera)[:2],
    )


def known(scenario):
    """OnboardCatalogue of a Scenario."""
    year = ephemeris.julian_year(scenario.mission.epoch)
    return _known(settings(scenario.star_tracker).catalogue, year)


@lru_cache(maxsize=8)  # `trade` asks for hundreds of cameras with one catalogue
def _known(of_catalogue, julian_year):
    """OnboardCatalogue of settings.Catalogue."""
    return catalogue.build(of_catalogue, stars.load_catalogue(LISTED), julian_year)


def _brighter(system, magnitude, drawn_to):
    """How many stars are as bright as that in a band of the catalogue, or brighter, and are drawn (V)."""
    sky = stars.load_catalogue(LISTED)
    seen = catalogue.magnitudes(sky, system) <= magnitude
    return int(np.count_nonzero(seen & (sky.vmag <= drawn_to)))


@lru_cache(maxsize=64)
def _check_pairs(of_catalogue, julian_year, max_angle):
    """CatalogueError where a field of view [rad] has no pairs of stars. of_catalogue : settings.Catalogue"""
    catalogue.pair_table(_known(of_catalogue, julian_year), max_angle)


def _faintest(camera, tracker):
    """Magnitude of the faintest white star at rest that the detection finds in the longest exposure."""
    chip, exposure, detection = camera.detector, tracker.exposure, tracker.detection
    per_dn = detector.electronics(chip, exposure.gain).electrons_per_dn
    sky = chip.background * exposure.longest  # electrons
    noise = math.sqrt(chip.read_noise**2 + sky + per_dn**2 / 12.0)
    side = 1.0 if detection.scan in ("run_length", "single_pixels") else BLOCK
    threshold = detection.seed_sigma * side * noise
    if detection.scan == "run_length":
        threshold = detection.run_length.threshold
    share = math.erf(0.5 * side / math.sqrt(2.0) / camera.optics.psf_sigma) ** 2
    collected = share * camera.optics.zero_magnitude_flux * exposure.longest
    return 2.5 * math.log10(collected / threshold)


def warnings(scenario):
    """(path in the scenario, text) of what leaves the star tracker without stars, or without a dark sky."""
    if not scenario.star_tracker.enabled:
        return
    if scenario.star_tracker.software != BUILT_IN:
        return
    seen, tracker = of(scenario), settings(scenario.star_tracker)
    width, height = seen.field_deg
    field = f"a field of view of {width:.3g} x {height:.3g} deg"
    wanted, exposure, band = tracker.identification.fewest_stars, tracker.exposure, tracker.catalogue.system
    if seen.in_field < wanted:
        words = (
            f"{field} holds {seen.in_field:.2g} stars of the catalogue on average, {wanted} are needed: take "
            "a shorter focal length, or a fainter star_tracker.catalogue.faintest"
        )
        yield ("star_camera", "optics", "focal_length"), words
    elif seen.found < wanted:
        words = (
            f"in {1e3 * exposure.longest:g} ms the detection finds stars to {band} {seen.faintest:.1f}, "
            f"of which {field} holds {seen.found:.2g} on average, and {wanted} are needed: it takes more "
            "light (f_number, transmission, star_tracker.exposure.longest) or less noise"
        )
        yield ("star_camera", "optics", "zero_magnitude_flux"), words
    if seen.empty_dn > exposure.brightest_mean:
        words = (
            f"the empty sky has a mean grey value of {seen.empty_dn:.0f} DN in the shortest exposure, "
            f"{1e3 * exposure.shortest:g} ms, at a gain of {exposure.gain:g} dB; frames above "
            f"{exposure.brightest_mean:g} DN count as saturated and give no attitude: lower the gain, or "
            "raise brightest_mean"
        )
        yield ("star_tracker", "exposure", "brightest_mean"), words


def notes(scenario):
    """Lines about what the star camera of a scenario sees, and what is made for one that sees less.

    Nothing of it is wrong; a camera with more light gains from larger values.
    """
    width, height, _ = lens.field_of_view_deg(scenario.star_camera)
    field = f"star_camera: a field of view of {width:.3g} x {height:.3g} deg"
    if not scenario.star_tracker.enabled or scenario.star_tracker.software != BUILT_IN:
        return [field]
    seen, tracker = of(scenario), settings(scenario.star_tracker)
    longest, drawn_to = 1e3 * tracker.exposure.longest, scenario.star_camera.stars.faintest
    band, known_to = tracker.catalogue.system, tracker.catalogue.faintest
    lines = [f"{field}, finds stars to {band} {seen.faintest:.1f} (at rest, in {longest:g} ms)"]
    if drawn_to < LISTED and seen.faintest - drawn_to > DEEPER:
        wanted = math.ceil(min(seen.faintest, LISTED))
        words = f"stars are drawn to V {drawn_to:g} alone; write {wanted:g} mag"
        lines.append(f"star_camera.stars.faintest: {words} for a sky as full as this camera sees it")
    reached = min(seen.faintest, catalogue.SILICON_TO if band == "silicon" else LISTED)
    if reached - known_to > DEEPER and tracker.identification.deepest is None:
        deep = math.floor(10.0 * min(reached - 1.0, drawn_to)) / 10.0  # as it is written
        words = f"the star tracker knows stars to {band} {known_to:g}"
        words += f", {seen.in_field:.0f} in the field on average"
        if deep > known_to:
            more = _field(scenario.star_camera)[1] * _brighter(band, deep, LISTED)
            lines.append(
                f"star_tracker.catalogue.faintest: {words}; {deep:.1f} mag knows {more:.0f}, or "
                f"star_tracker.identification.deepest: {deep:.1f} mag names them once a frame is identified"
            )
    if seen.drawn > tracker.detection.most_objects:
        words = f"{tracker.detection.most_objects} objects are kept, the brightest, of {seen.drawn:.0f} stars"
        more = 10 * math.ceil(0.15 * seen.drawn)
        lines.append(f"star_tracker.detection.most_objects: {words} in the field on average; write {more}")
    return lines


def _field(camera):
    """Half sides of the field of view at the distance 1, and its part of the sky. Camera -> (x, y), float"""
    chip = camera.detector
    x, y = (0.5 * n * chip.pixel_size / camera.optics.focal_length for n in (chip.columns, chip.rows))
    return (x, y), 4.0 * math.asin(x * y / math.sqrt((1.0 + x * x) * (1.0 + y * y))) / SPHERE
