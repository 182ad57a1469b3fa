"""What single values cannot show: values of a scenario that contradict each other."""

import math

from shefex_nav.clock import IMU_HZ
from shefex_nav.instruments import state_sizes
from shefex_nav.scenario import (
    aboard,
    checks_flight,
    checks_gps,
    checks_tracker,
    checks_vehicle,
    dispersions,
    partial,
    sensors,
    software,
    star_statistics,
    told,
    trajectory,
)
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.checks_flight import seconds

STAGES = ("vehicle", "stages")
COUNTED = ("imu", "vibration", "boost")  # one value for each stage
REPORT_RATE = 10.0  # Hz, of the logged covariance, which reports want on whole seconds
LOG_RATES = (10.0, 20.0, 50.0, 100.0)  # Hz
IMU_NYQUIST = 0.5 * IMU_HZ


def cross_check(scenario, rated=None):
    """Contradictions in a valid scenario: list of (path of the field, text for people).

    `rated`: what motor files say of their propellant, as `expand` returns it.
    """
    start = list(checks_flight.start(scenario))
    return start or [one for part in _parts(scenario, rated) for one in part]


def check_what_is_known(scenario, rated=None):
    """The same of a scenario from `partial`, as far as its values are good."""
    start = partial.known(checks_flight.start(scenario))
    return start or [one for part in _parts(scenario, rated) for one in partial.known(part)]


def _parts(scenario, rated):
    """Iterator of iterators of contradictions; without a start none could be judged."""
    if getattr(scenario, "trajectory", None) is None:
        yield checks_vehicle.contradictions(scenario, rated or {})
        flown = checks_flight.PARTS
    else:
        flown = (trajectory.contradictions, checks_flight.air)
    alone = (
        *flown,
        _clocks,
        _vibration,
        *checks_gps.PARTS,
        aboard.contradictions,
        _camera,
        _states,
        *checks_tracker.PARTS,
        star_statistics.contradictions,
        sensors.contradictions,
        software.contradictions,
        told.contradictions,
        _told,
        dispersions.contradictions,
    )
    for part in alone:
        yield part(scenario)


def _clocks(scenario):
    """Clocks that meet."""
    start, rate = scenario.mission.start, scenario.log.rate
    if abs(start * REPORT_RATE - round(start * REPORT_RATE)) > 1e-6:
        yield (
            ("mission", "start"),
            f"{seconds(start)} must be a multiple of 0.1 s, the interval of the logged covariance",
        )
    if rate not in LOG_RATES:
        yield ("log", "rate"), f"{rate:g} Hz is not offered; choose from: 10 Hz, 20 Hz, 50 Hz, 100 Hz"


def band_without_width(vibration):
    """(path, words) of a vibration whose band ends before it begins."""
    if vibration.lowest_frequency >= vibration.highest_frequency:
        words = f"must be below highest_frequency, {vibration.highest_frequency:g} Hz"
        yield ("imu", "vibration", "lowest_frequency"), words


def _vibration(scenario):
    """Bands and durations the right way round."""
    vibration = scenario.imu.vibration
    if vibration.lowest_frequency >= IMU_NYQUIST:
        words = (
            f"{vibration.lowest_frequency:g} Hz must be below {IMU_NYQUIST:g} Hz, half the rate of the IMU"
        )
        yield ("imu", "vibration", "lowest_frequency"), words
    else:
        yield from band_without_width(vibration)
    given = scenario.trajectory
    stages = len(scenario.vehicle.stages) if given is None else 1 + len(given.separations)
    if len(vibration.boost) != stages and not (given and not vibration.boost):
        named = f" ({', '.join(scenario.vehicle.stages)})" if given is None and stages else ""
        words = f"{count(len(vibration.boost), 'value')} for {count(stages, 'stage')}{named}; "
        yield ("imu", "vibration", "boost"), f"{words}give one for each stage"


def states_that_clash(names):
    """(path, words) of blocks of states of the filter that do not go together."""
    from shefex_nav.onboard.navigation.blocks import LayoutError, checked

    try:
        checked(names, state_sizes())
    except LayoutError as error:
        last = len(names) - 1 - names[::-1].index(error.name)
        yield ("navigation", "states", last), str(error)


def count(number, noun):
    """`1 stage`, `2 stages`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _states(scenario):
    """Blocks of states that go together."""
    if scenario.navigation.states != AUTOMATIC:
        yield from states_that_clash(scenario.navigation.states)


def _told(scenario):
    """What the computer is told goes together, as what is true does."""
    known = told.as_told(scenario)
    if known is scenario:
        return
    for part in (_vibration, _camera):
        true = list(part(scenario))
        for path, words in part(known):
            if (path, words) not in true:
                yield ("navigation", "told", *path), words


def _camera(scenario):
    """Directions that make a frame, limits the right way round."""
    path, camera = ("star_camera", "mounting"), scenario.star_camera
    boresight, right = camera.mounting.boresight, camera.mounting.image_right
    lengths = math.hypot(*boresight), math.hypot(*right)
    for name, length in zip(("boresight", "image_right"), lengths, strict=True):
        if length < 1e-6:
            yield (*path, name), "must not be zero; give a direction such as [0, 1, 0]"
    if min(lengths) >= 1e-6:
        cosine = sum(a * b for a, b in zip(boresight, right, strict=True)) / (lengths[0] * lengths[1])
        if abs(cosine) > 1e-4:
            angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            yield (*path, "image_right"), f"must be at right angles to boresight, is at {angle:.2f} deg"
    artefacts = camera.artefacts
    if artefacts.hot_pixel_weakest > artefacts.hot_pixel_strongest:
        yield ("star_camera", "artefacts", "hot_pixel_weakest"), "must not exceed hot_pixel_strongest"
    for least, most in (("particle_weakest", "particle_strongest"), ("moving_slowest", "moving_fastest")):
        if getattr(artefacts, least) > getattr(artefacts, most):
            yield ("star_camera", "artefacts", least), f"must not exceed {most}"
    if artefacts.false_brightest > artefacts.false_faintest:
        words = "must not be a larger magnitude, that is fainter, than false_faintest"
        yield ("star_camera", "artefacts", "false_brightest"), words
    bad = artefacts.hot_pixels + artefacts.dead_pixels + artefacts.unknown_bad_pixels
    if bad > camera.detector.columns * camera.detector.rows // 10:
        yield (
            ("star_camera", "artefacts", "hot_pixels"),
            f"{bad} bad pixels are more than a tenth of the detector",
        )


def noted(found, names, places, others):
    """The same contradictions; the first about stages says which are inherited, and how to leave them out.

    Parameters
    ----------
    found : list of (path of the field, text)
    names : of the stages
    places : messages.Places of the scenario
    others : {path of another file: 'extends', 'uses', what the scenario does with it}
    """
    inherited = {}  # file: names
    for name in names:
        file = places.key((*STAGES, name)).file
        if others.get(file) == "extends":
            inherited.setdefault(file, []).append(name)
    mine = len(names) - sum(map(len, inherited.values()))
    about = [k for k, (path, _) in enumerate(found) if _is_about(path)]
    if not (inherited and mine and about):
        return found
    first = min(about, key=lambda k: places.value(found[k][0]))
    path, words = found[first]
    for file, left in inherited.items():
        nulls = ", ".join(f"{name}: null" for name in left)
        verb = "comes" if len(left) == 1 else "come"
        words += f"; {' and '.join(left)} {verb} from {file}: '{nulls}' under vehicle.stages leaves out"
        words += " what your rocket has not"
    return [*found[:first], (path, words), *found[first + 1 :]]


def _is_about(path):
    return path[:2] == STAGES or path[:3] == COUNTED
