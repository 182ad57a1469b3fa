"""How many stars that the star tracker knows are in its field where the programme points it?

The sky is not the same everywhere: a field that holds six stars of the catalogue on average has one or none
in many places, and no attitude comes of it. `star_light` has the average, this the way that is flown.
"""

import math

import numpy as np

from shefex_nav.environment import ephemeris, stars
from shefex_nav.geometry import rotation
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.report import star_light, star_sight
from shefex_nav.scenario import lens, params
from shefex_nav.scenario.software import BUILT_IN

STEP = 0.1  # mag, of the catalogues that are tried


def poor(scenario, seen, looks):
    """Warnings: (path in the scenario, text) where the field has too few stars for an attitude.

    seen : star_sight.Sight;  looks : of (name, task) in which the star camera is pointed, slews included
    """
    tracker = scenario.star_tracker
    pointed = star_sight.pointed(scenario, seen, looks)
    if not (tracker.enabled and tracker.software == BUILT_IN and len(pointed.t_s)):
        return
    light, wanted = star_light.of(scenario), tracker.identification.fewest_stars
    if light.found < wanted:
        return  # `star_light` has said so of the whole sky
    known = star_light.known(scenario)
    count = counts(scenario, pointed, known.u_i[known.vmag <= light.faintest])
    few = count < wanted
    if few.mean() <= star_sight.SHARE:
        return
    k = int(np.argmin(count))
    seconds = few.size * float(np.median(np.diff(pointed.t_s))) if few.size > 1 else 0.0
    part = "all of" if few.all() else f"{100.0 * few.mean():.0f} % of"
    of = f"{tracker.catalogue.system} {tracker.catalogue.faintest:g} or brighter"
    words = (
        f"for {part} the {seconds:.0f} s in which the star camera is pointed and its tracker is on, fewer "
        f"than {wanted} of the stars that it knows ({of}) are in its field, at T{pointed.t_s[k]:+.0f} s "
        f"{count[k]}: that gives no attitude"
    )
    name = star_sight.aims(looks, float(np.median(pointed.t_s[few])))
    yield ("programme", name), f"{words}; {_way_out(scenario, pointed, light.faintest, wanted)}"


def counts(scenario, seen, u_i):
    """How many of some stars are in the field of view at each instant, (N,). u_i : (n, 3)"""
    width, height, _ = lens.field_of_view_deg(scenario.star_camera)
    half = [math.tan(math.radians(0.5 * one)) for one in (width, height)]
    C_bc, found = params.mounting(scenario), []
    for q_ib in seen.q_ib:
        x, y, z = (u_i @ (rotation.dcm_from_quat(q_ib) @ C_bc)).T
        found.append(np.count_nonzero((z > 0.0) & (np.abs(x) < half[0] * z) & (np.abs(y) < half[1] * z)))
    return np.array(found, dtype=int)


def _way_out(scenario, pointed, faintest, wanted):
    """What to change: the magnitude to which the catalogue has enough along the whole way, if any."""
    of_catalogue, elsewhere = scenario.star_tracker.catalogue, "point it elsewhere, or take a wider field"
    if of_catalogue.kind != "magnitude_limited":
        return elsewhere
    band = of_catalogue.system
    sky = stars.at_epoch(
        stars.load_catalogue(star_light.LISTED), ephemeris.julian_year(scenario.mission.epoch)
    )
    magnitudes = catalogue.magnitudes(sky, band)
    ends = faintest, catalogue.SILICON_TO if band == "silicon" else star_light.LISTED
    drawn = sky.vmag <= scenario.star_camera.stars.faintest
    for limit in np.arange(of_catalogue.faintest + STEP, min(ends) + 0.5 * STEP, STEP):
        least = counts(scenario, pointed, sky.u_i[drawn & (magnitudes <= limit)]).min()
        if least > wanted:
            key = "star_tracker.catalogue.faintest"
            return f"write {key}: {limit:.1f} mag ({least} at least), {elsewhere}"
    return elsewhere
