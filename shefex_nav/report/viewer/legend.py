"""What colours, marks and axes on the pages of the viewer mean: a text beside each."""

from typing import NamedTuple

from shefex_nav.report.configured import configured


class Limit(NamedTuple):
    """The length of the table of detections, against the frames of a run."""

    most: int  # objects of a frame, star_tracker.detection.most_objects
    reached: int  # frames that have so many: there may have been more
    frames: int  # that were searched


def limit_of(data):
    """Limit of a RunData; None where its scenario does not say, or cannot be read."""
    scenario = configured(data).scenario
    if scenario is None:
        return None
    most = scenario.star_tracker.detection.most_objects
    reached = sum(len(fix.hip) >= most for fix in data.star_fixes)
    return Limit(most, reached, len(data.star_fixes))


ENTITY = "legend"
AXES = "**Axes.** x is red, y green, z blue."
_STATES = """**States.** Green: good or in use. Orange: not; *Events* say why. A name that has no room is
left out. *phase*: grey on the pad, red boost, white coast, blue manoeuvre, green pointing, violet descent,
yellow parachute. *gps*: what the receiver gives. *health*: what the navigation makes of a sensor.
*solution*: whether the computer lets attitude,
position, velocity be used. *star_tracker*: solved, or why not."""
_FRAME = """**Star camera.** Green square: detected and identified, with its Hipparcos number. Orange
square: detected, not identified: faint stars that the on-board catalogue lacks, hot pixels, particles. Blue
dot: where a bright catalogue star truly is. Pixels of sky background are set to zero where the log keeps no
others."""
_SCENE = """**Flight.** Axes at the place of the start: red east, green north, blue up. The path has the
colours of the phases. Body axes, rocket, frustum of the star camera and cones show directions, not sizes:
yellow cone, too near to the Sun; blue cone, too near to the Earth; light blue lines, GPS satellites (point
at the end of one for its name)."""
_ERRORS = """**Errors** are truth minus estimate: position and velocity in inertial axes (GCRS), attitude as
a rotation about the body axes, x along the roll axis. Blue: error, red: plus and minus 3 sigma of the
filter. The scale suits the better part of the flight; the title says what is cut off, such as the error in
a spin-up. Zoom with the mouse wheel, double click resets."""
_NEES = """**NEES**: 95 % lie between the red lines if the covariance is right."""
_TESTS = """**NIS over its limit**: a dot was used, a cross refused (above 1) or held back; blue GPS position,
violet GPS velocity, green star tracker. **Level**, the protection level: what the error (white, worst axis)
may not exceed unnoticed; position and velocity green horizontal, yellow vertical, attitude about x, y, z.
The scale suits the better part of the flight here, too."""
_NO_TRUTH = """**No truth.** The log does not say where the vehicle truly was: path, height, speed and roll
rate are those that the navigation estimated, and there are no errors."""
_STARS = """**Sky.** The stars to magnitude 5 around the camera, its field (green) and the way of its
boresight (grey), in degrees. **Curves** are those of the time in which the star tracker works. Orange: all
that was detected in a frame, green: those of it that were identified."""
_SENSORS = """**IMU**: mean of each tick in body axes; scatter is what is left within a second, vibration
and noise. **GPS**: satellites used, and dilution of precision of the position. **Age**: from the instant
that is measured to the instant at which the computer has it."""

TEXTS = {
    "Overview": (_FRAME, _SCENE, _ERRORS, _STATES),
    "Mission": (_SCENE, AXES, _STATES),
    "Star tracker": (_FRAME, _STARS, _STATES),
    "Navigation": (_ERRORS, _NEES, _TESTS, _STATES),
    "Sensors": (_SENSORS, AXES, _STATES),
}


def entity(page):
    """Entity of the text about a page of `layout.PAGES`."""
    return f"{ENTITY}/{page.lower().replace(' ', '_')}"


def overlaid(first, others):
    """Which colours are those of which log: texts, none for one log alone. others : [(name, colour)]"""
    if not others:
        return ()
    found = ", ".join(f"{colour} {name}" for name, colour in others)
    return (
        f"""**Logs.** Laid over {first}, whose colours are those named below: {found}: path, errors, 3 sigma
(darker) and NEES. States, events and all else are those of {first}; titles tell what is cut off of it.""",
    )


def _at_most(limit):
    """How many detections there can be in a frame: texts, none where that is not known. counts.Limit, None"""
    if limit is None:
        return ()
    kept = f"""**Limit.** No more than {limit.most} objects of a frame are kept, the brightest
(*star_tracker.detection.most_objects*). """
    if not limit.reached:
        return (f"{kept}No frame had so many.",)
    frames = f"{limit.reached} of {limit.frames} frames have so many"
    return (f"{kept}{frames}: what else was in them is neither drawn nor counted.",)


def send(sender, first, others=(), limit=None, errors=True):
    """The texts of all pages.

    first : name of the log that is shown whole;  others : (name, colour) of each that is laid over it
    limit : counts.Limit of the log that is shown whole, None where it is not known
    errors : whether it has a truth that they can be told by
    """
    import rerun as rr

    for page, parts in TEXTS.items():
        if not errors and page != "Sensors":
            parts = (_NO_TRUTH, *(part for part in parts if part not in (_ERRORS, _NEES)))
        parts = [text for part in parts for text in (part, *(_at_most(limit) if part is _STARS else ()))]
        parts = (*overlaid(first, others), *parts)
        text = "\n\n".join(part.replace("\n", " ") for part in parts)
        sender.static(entity(page), rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
