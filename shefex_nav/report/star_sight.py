"""Where the star camera looks while a programme points it: too near to the Sun, or to the Earth's limb?

And whether the programme turns it faster than its star tracker takes frames (`too_fast`), or the vehicle
turns so while the star tracker is on (`turning`).

Frames within the exclusion angles are taken and tried all the same, and are not of the star tracker's window.
So a programme that points the camera there has a star tracker that counts nothing.

And how many stars that the star tracker knows are in its field then (`poor`)? The sky is not the same
everywhere: a field that holds six stars of the catalogue on average has one or none in many places, and no
attitude comes of it. `star_light` has the average, this the way that is flown.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import ephemeris, stars
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.report import star_light
from shefex_nav.scenario import lens, params
from shefex_nav.scenario.software import BUILT_IN
from shefex_nav.world.camera.optics import SUN_RADIUS

TURNS = "point", "point_inertial", "point_nadir"  # kinds of tasks that turn the star camera elsewhere
STEP_S = 1.0
SHARE = 0.3  # of the time: a slew that begins near the Sun is not told
IN_ORBIT = 0.7  # for the Earth: each direction that a vehicle in orbit holds meets its limb for a while
CATALOGUE_STEP = 0.1  # mag, of the catalogues that are tried


class Sight(NamedTuple):
    """Attitude and place of the vehicle, about each second."""

    t_s: np.ndarray  # (N,)
    q_ib: np.ndarray  # (N, 4)
    r_i: np.ndarray  # (N, 3) m


def sight(t_s, q_ib, r_i):
    """Sight of samples."""
    rows = np.unique(np.searchsorted(t_s, np.arange(t_s[0], t_s[-1], STEP_S)))
    return Sight(t_s[rows], q_ib[rows], r_i[rows])


def pointed(scenario, seen, looks):
    """Sight of the instants at which a task points the star camera and its tracker is on."""
    tracker, rows = scenario.star_tracker, np.zeros(len(seen.t_s), dtype=bool)
    for _, task in looks:
        first_s, last_s = max(task.start, tracker.on), min(task.end, tracker.off)
        rows |= (seen.t_s >= first_s) & (seen.t_s <= last_s)
    return Sight(*(values[rows] for values in seen))


def angles(seen, C_bc, sun_i, earth):
    """Angles of the boresight to the Sun and to the Earth's limb, (N,) rad each; to a hidden Sun pi."""
    found = []
    for t_s, q_ib, r_i in zip(*seen, strict=True):
        boresight_i, C_ei = rotation.dcm_from_quat(q_ib) @ C_bc[:, 2], frames.dcm_ie(earth, t_s).T
        sun_angle = np.arccos(np.clip(boresight_i @ sun_i, -1.0, 1.0))
        if wgs84.limb_angle(C_ei @ r_i, C_ei @ sun_i) <= -SUN_RADIUS:
            sun_angle = np.pi
        found.append((sun_angle, wgs84.limb_angle(C_ei @ r_i, C_ei @ boresight_i)))
    return np.array(found).reshape(-1, 2).T


def excluded(scenario, seen, looks):
    """Warnings: (path in the scenario, text) where the pointing as a whole is of little use.

    seen : Sight;  looks : of (name, task) in which the star camera is pointed, slews included
    """
    from shefex_nav.prepare import earth_rotation

    stray, during = scenario.star_camera.stray_light, pointed(scenario, seen, looks)
    if not (scenario.star_tracker.enabled and len(during.t_s)):
        return
    sun_i = ephemeris.sky_bodies(scenario.mission.epoch).sun_u_i
    found = angles(during, params.mounting(scenario), sun_i, earth_rotation(scenario))
    limits = stray.sun_exclusion, stray.earth_exclusion
    shares = SHARE, SHARE if scenario.orbit is None else IN_ORBIT
    for what, angle, limit, share in zip(("the Sun", "the Earth's limb"), found, limits, shares, strict=True):
        inside = angle < limit
        if inside.mean() > share:
            name = aims(looks, float(np.median(during.t_s[inside])))
            yield ("programme", name), _words(what, during.t_s, angle, limit, inside)


def too_fast(scenario):
    """Warnings: (path in the scenario, text) of tasks whose rates leave the star tracker without attitude."""
    tracker = scenario.star_tracker
    if not tracker.enabled or tracker.software != BUILT_IN:
        return
    for name, task in scenario.tasks:
        if task.task != "dwell" or task.end <= tracker.on or task.start >= tracker.off:
            continue
        rate = float(np.hypot(task.boresight_rate, task.cross_rate))
        if rate > tracker.highest_rate:
            words = (
                f"turns at {np.degrees(rate):.3g} deg/s; frames taken faster than star_tracker.highest_rate"
            )
            limit = f"{np.degrees(tracker.highest_rate):.3g} deg/s"
            yield ("programme", name), f"{words}, {limit}, give no attitude: turn more slowly, or raise it"


def turning(scenario, moved):
    """Warnings: (path in the scenario, text) of a star tracker that is on while the vehicle turns too fast.

    moved : sensor_limits.Motion, the largest rates of each second
    """
    tracker = scenario.star_tracker
    if not tracker.enabled or tracker.software != BUILT_IN or any(too_fast(scenario)):
        return
    rates = moved.rate[(moved.t_s >= tracker.on) & (moved.t_s < tracker.off)].max(axis=1, initial=0.0)
    fast = rates > tracker.highest_rate
    if fast.any() and fast.mean() > SHARE:
        words = (
            f"in {fast.sum()} of the {fast.size} seconds in which the star tracker is on, the vehicle turns "
            f"faster than {np.degrees(tracker.highest_rate):.3g} deg/s at an instant at least, up to "
            f"{np.degrees(rates.max()):.3g} deg/s about an axis: frames from then give no attitude; switch "
            "it on when the vehicle is slow, or raise this"
        )
        yield ("star_tracker", "highest_rate"), words


def aims(looks, t_s):
    """Name of the task that says where the camera looks at an instant: a dwell keeps what was before."""
    begun = [one for one in looks if one[1].start <= t_s]
    turned = [name for name, task in begun if task.task in TURNS]
    return turned[-1] if turned else begun[-1][0]


def _words(what, t_s, angle, limit, inside):
    k, seconds = int(angle.argmin()), inside.size * float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
    part = "all of" if inside.all() else f"{100.0 * inside.mean():.0f} % of"
    nearest = f"as near as {np.degrees(angle[k]):.0f} deg"
    if angle[k] < 0.0:
        nearest = f"{-np.degrees(angle[k]):.0f} deg below it, into the Earth"
    return (
        f"for {part} the {seconds:.0f} s in which the star camera is pointed and its tracker is "
        f"on, it looks within {np.degrees(limit):.0f} deg of {what}, at T{t_s[k]:+.0f} s {nearest}: "
        "such frames are not of the window; point it elsewhere"
    )


def poor(scenario, seen, looks):
    """Warnings: (path in the scenario, text) where the field has too few stars for an attitude.

    seen : Sight;  looks : of (name, task) in which the star camera is pointed, slews included
    """
    tracker = scenario.star_tracker
    during = pointed(scenario, seen, looks)
    if not (tracker.enabled and tracker.software == BUILT_IN and len(during.t_s)):
        return
    light, wanted = star_light.of(scenario), tracker.identification.fewest_stars
    if light.found < wanted:
        return  # `star_light` has said so of the whole sky
    known = star_light.known(scenario)
    count = counts(scenario, during, known.u_i[known.vmag <= light.faintest])
    few = count < wanted
    if few.mean() <= SHARE:
        return
    k = int(np.argmin(count))
    seconds = few.size * float(np.median(np.diff(during.t_s))) if few.size > 1 else 0.0
    part = "all of" if few.all() else f"{100.0 * few.mean():.0f} % of"
    of = f"{tracker.catalogue.system} {tracker.catalogue.faintest:g} or brighter"
    words = (
        f"for {part} the {seconds:.0f} s in which the star camera is pointed and its tracker is on, fewer "
        f"than {wanted} of the stars that it knows ({of}) are in its field, at T{during.t_s[k]:+.0f} s "
        f"{count[k]}: that gives no attitude"
    )
    name = aims(looks, float(np.median(during.t_s[few])))
    yield ("programme", name), f"{words}; {_way_out(scenario, during, light.faintest, wanted)}"


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
    for limit in np.arange(
        of_catalogue.faintest + CATALOGUE_STEP, min(ends) + 0.5 * CATALOGUE_STEP, CATALOGUE_STEP
    ):
        least = counts(scenario, pointed, sky.u_i[drawn & (magnitudes <= limit)]).min()
        if least > wanted:
            key = "star_tracker.catalogue.faintest"
            return f"write {key}: {limit:.1f} mag ({least} at least), {elsewhere}"
    return elsewhere
