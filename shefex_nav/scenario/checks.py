"""What single values cannot show: values of a scenario that contradict each other."""

import math
from itertools import pairwise

from shefex_nav.scenario.quantity import STANDARD_GRAVITY

TICK_RATE = 100.0  # Hz, of the on-board computer
REPORT_RATE = 10.0  # Hz, of the logged covariance, which reports want on whole seconds
IMU_NYQUIST = 200.0  # Hz, half the rate of the IMU


def cross_check(scenario):
    """Contradictions in a valid scenario: list of (path of the field, text for people)."""
    return [
        *_times(scenario),
        *_vehicle(scenario),
        *_lift_off(scenario),
        *_sensors(scenario),
        *_camera(scenario.star_camera),
        *_star_tracker(scenario),
    ]


def _seconds(t_s):
    return f"{t_s:g} s"


def _times(scenario):
    """The programme in order, burns before what follows them, everything within the mission."""
    programme, mission = scenario.programme, scenario.mission
    burn_out_1 = scenario.vehicle.stages[0].motor.burn_time
    burn_out_2 = programme.ignition_2 + scenario.vehicle.stages[1].motor.burn_time
    steps = [
        ("burn-out of the first stage", burn_out_1),
        ("separation", programme.separation),
        ("precession_start", programme.precession_start),
        ("precession_end", programme.precession_end),
        ("ignition_2", programme.ignition_2),
        ("burn-out of the second stage", burn_out_2),
        ("despin_start", programme.despin_start),
        ("despin_end", programme.despin_end),
        ("pointing_start", programme.pointing_start),
        ("pointing_end", programme.pointing_end),
        ("entry_slew_end", programme.entry_slew_end),
        ("spin_up_end", programme.spin_up_end),
        ("mission.time_limit", mission.time_limit),
    ]
    for (before, t_before), (name, t_s) in pairwise(steps):
        if t_s > t_before:
            continue
        where = ("mission", "time_limit") if name == "mission.time_limit" else ("programme", name)
        yield where, f"{_seconds(t_s)} must be later than {before}, {_seconds(t_before)}"
    if programme.entry_aim < programme.pointing_end:
        end = _seconds(programme.pointing_end)
        words = f"{_seconds(programme.entry_aim)} must not be before pointing_end, {end}"
        yield ("programme", "entry_aim"), words
    ramp, dwell = programme.pointing.ramp, programme.pointing_end - programme.pointing_start
    if dwell > 0.0 and 2.0 * ramp > dwell:
        words = f"fading in and out takes {_seconds(2.0 * ramp)}, the pointing lasts {_seconds(dwell)} only"
        yield ("programme", "pointing", "ramp"), words
    if abs(mission.start * REPORT_RATE - round(mission.start * REPORT_RATE)) > 1e-6:
        yield (
            ("mission", "start"),
            f"{_seconds(mission.start)} must be a multiple of 0.1 s, the interval of the logged covariance",
        )


def _vehicle(scenario):
    """Motors that can burn, tables that can be interpolated."""
    for number, stage in enumerate(scenario.vehicle.stages):
        path = ("vehicle", "stages", number)
        grain, motor = stage.propellant, stage.motor
        if grain.inner_radius >= grain.outer_radius:
            words = f"{grain.inner_radius:g} m must be smaller than outer_radius, {grain.outer_radius:g} m"
            yield (*path, "propellant", "inner_radius"), words
        if motor.rise + motor.tail_off >= motor.burn_time:
            words = f"{_seconds(motor.burn_time)} must be longer than rise and tail_off together"
            yield (*path, "motor", "burn_time"), words
    for name in ("stack", "upper"):
        yield from _tables(("vehicle", "aerodynamics", name), getattr(scenario.vehicle.aerodynamics, name))


def _tables(path, tables):
    """Columns of one length over increasing Mach numbers."""
    mach = tables.mach
    for k in range(1, len(mach)):
        if mach[k] <= mach[k - 1]:
            yield (*path, "mach", k), f"Mach numbers must increase: {mach[k]:g} follows {mach[k - 1]:g}"
    columns = ("axial", "normal_slope", "pressure_station", "pitch_damping", "roll_damping", "roll_by_cant")
    lengths = {column: len(getattr(tables, column)) for column in columns}
    odd = [column for column in columns if lengths[column] != len(mach)]
    if len(odd) == len(columns) and len(set(lengths.values())) == 1:
        words = f"{len(mach)} Mach numbers, but {lengths['axial']} values in every other column"
        yield (*path, "mach"), words
        return
    for column in odd:
        yield (*path, column), f"{lengths[column]} values for {len(mach)} Mach numbers; give one for each"


def _lift_off(scenario):
    """Thrust after the rise, at sea level, against the weight on the rail."""
    vehicle = scenario.vehicle
    first, second = vehicle.stages
    motor = first.motor
    flat = motor.burn_time - motor.rise - motor.tail_off
    if flat <= 0.0:
        return
    shape = 0.5 * (motor.rise + (1.0 + motor.level_ratio) * flat + motor.level_ratio * motor.tail_off)
    vacuum_thrust = first.propellant.mass * motor.specific_impulse * STANDARD_GRAVITY / shape
    thrust = vacuum_thrust - 101325.0 * motor.exit_area  # N, against the pressure at sea level
    mass = vehicle.payload.mass + sum(stage.dry.mass + stage.propellant.mass for stage in (first, second))
    weight = mass * STANDARD_GRAVITY
    if thrust <= weight:
        words = (
            f"the first stage gives {1e-3 * thrust:.0f} kN at sea level, "
            f"the vehicle weighs {1e-3 * weight:.0f} kN; it would not lift off"
        )
        yield ("vehicle", "stages", 0, "motor"), words


def _sensors(scenario):
    """Bands and durations the right way round."""
    vibration = scenario.imu.vibration
    if vibration.lowest_frequency >= IMU_NYQUIST:
        words = (
            f"{vibration.lowest_frequency:g} Hz must be below {IMU_NYQUIST:g} Hz, half the rate of the IMU"
        )
        yield ("imu", "vibration", "lowest_frequency"), words
    elif vibration.lowest_frequency >= vibration.highest_frequency:
        words = f"must be below highest_frequency, {vibration.highest_frequency:g} Hz"
        yield ("imu", "vibration", "lowest_frequency"), words
    if vibration.boost_1 == 0.0 and vibration.boost_2 > 0.0:
        words = "must not be zero unless boost_2 is: the filter takes boost_2 relative to it"
        yield ("imu", "vibration", "boost_1"), words
    for number, outage in enumerate(scenario.gps.outages):
        if outage.shortest > outage.longest:
            words = f"{_seconds(outage.shortest)} is longer than longest, {_seconds(outage.longest)}"
            yield ("gps", "outages", number, "shortest"), words


def _camera(camera):
    """Directions that make a frame, limits the right way round."""
    path = ("star_camera", "mounting")
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
    if artefacts.false_brightest > artefacts.false_faintest:
        words = "must not be a larger magnitude, that is fainter, than false_faintest"
        yield ("star_camera", "artefacts", "false_brightest"), words
    bad = artefacts.hot_pixels + artefacts.dead_pixels + artefacts.unknown_bad_pixels
    if bad > camera.detector.columns * camera.detector.rows // 10:
        yield (
            ("star_camera", "artefacts", "hot_pixels"),
            f"{bad} bad pixels are more than a tenth of the detector",
        )


def _star_tracker(scenario):
    """Frames that the clock can trigger, exposures that fit between them, a window within the mission."""
    tracker, path = scenario.star_tracker, ("star_tracker",)
    ticks = TICK_RATE / tracker.rate
    if abs(ticks - round(ticks)) > 1e-6:
        words = (
            f"{tracker.rate:g} Hz does not divide the on-board clock, 100 Hz; take 1, 2, 4, 5, 10 or 20 Hz"
        )
        yield (*path, "rate"), words
    exposure, interval = tracker.exposure, 1.0 / tracker.rate
    busy = exposure.longest + scenario.star_camera.detector.readout
    if busy > interval + 1e-9:
        words = (
            f"exposure and read-out take {1e3 * busy:g} ms, the frames follow each other "
            f"after {1e3 * interval:g} ms; shorten it or lower star_tracker.rate"
        )
        yield (*path, "exposure", "longest"), words
    if not exposure.shortest <= exposure.start <= exposure.longest:
        limits = f"{1e3 * exposure.shortest:g} to {1e3 * exposure.longest:g} ms"
        words = f"{1e3 * exposure.start:g} ms must lie between shortest and longest, {limits}"
        yield (*path, "exposure", "start"), words
    mission = scenario.mission
    if not mission.start <= tracker.on < mission.time_limit:
        words = (
            f"{_seconds(tracker.on)} is not within the mission, {mission.start:g} to {mission.time_limit:g} s"
        )
        yield (*path, "on"), words
    if tracker.off <= tracker.on:
        yield (*path, "off"), f"{_seconds(tracker.off)} must be later than on, {_seconds(tracker.on)}"
    elif tracker.off > mission.time_limit:
        yield (
            (*path, "off"),
            f"{_seconds(tracker.off)} is after mission.time_limit, {_seconds(mission.time_limit)}",
        )
    if tracker.detection.fewest_pixels > tracker.detection.most_pixels:
        yield (*path, "detection", "fewest_pixels"), "must not exceed most_pixels"
    if tracker.detection.grow_sigma > tracker.detection.seed_sigma:
        yield (*path, "detection", "grow_sigma"), "must not exceed seed_sigma"
    yield from _catalogue_and_latency(scenario)


def _catalogue_and_latency(scenario):
    """The catalogue flown against the stars that shine; the filter's memory against what arrives late."""
    tracker, navigation = scenario.star_tracker, scenario.navigation
    catalogue, camera = tracker.catalogue, scenario.star_camera
    if catalogue.faintest > camera.stars.faintest:
        words = f"V {catalogue.faintest:g} on board, the camera draws stars to V {camera.stars.faintest:g}"
        yield ("star_tracker", "catalogue", "faintest"), words
    if catalogue.kind == "combined" and catalogue.keep_to > catalogue.faintest:
        yield ("star_tracker", "catalogue", "keep_to"), "must not be fainter than faintest"
    star_delay = tracker.exposure.longest + camera.detector.readout + tracker.latency
    delay, name = max((scenario.gps.latency, "GPS fix"), (star_delay, "star fix"))
    if delay >= navigation.history:
        words = (
            f"{_seconds(navigation.history)} must be longer than the {1e3 * delay:g} ms that a {name} is late"
        )
        yield ("navigation", "history"), words
