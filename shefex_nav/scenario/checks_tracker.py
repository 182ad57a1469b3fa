"""Values of a scenario that contradict each other: star tracker, its camera, the filter that waits."""

from shefex_nav.clock import TICK_HZ
from shefex_nav.onboard.startracker.settings import contradiction
from shefex_nav.scenario import lens
from shefex_nav.scenario.checks_flight import seconds
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.told import as_told
from shefex_nav.world.absent import STAR_NOISE

SPOTS = ("sequential", "maximum", "single_pixels")  # scans that take a star for a spot at rest
CENTROIDS = {"streaks": "fit", "run_length": "weighted"}  # what a scan brings along
SAME = 1e-9  # s, rounding of times that are to be equal


def _rows_and_frames(scenario):
    """Exposures that fit between the frames, with the times of the rows."""
    tracker, detector = scenario.star_tracker, scenario.star_camera.detector
    longest, interval = tracker.exposure.longest, 1.0 / tracker.rate
    field = ("star_tracker", "exposure", "longest")
    if detector.shutter == "global":
        if detector.line_time is not None:
            words = "a global shutter exposes all rows at once; write shutter: rolling or leave it out"
            yield ("star_camera", "detector", "line_time"), words
        busy = longest + detector.readout
        if busy > interval + SAME:
            words = (
                f"exposure and read-out take {1e3 * busy:g} ms, the frames follow each other "
                f"after {1e3 * interval:g} ms; shorten it or lower star_tracker.rate"
            )
            yield field, words
        return
    if detector.line_time is None:
        yield ("star_camera", "detector", "line_time"), "a rolling shutter needs it; such as 60 us"
        return
    if longest > interval + SAME:
        words = (
            f"every row is exposed for {1e3 * longest:g} ms, the frames follow each other "
            f"after {1e3 * interval:g} ms; shorten it or lower star_tracker.rate"
        )
        yield field, words
    rows_s = detector.line_time * detector.rows
    if rows_s > interval + SAME:
        words = (
            f"{detector.rows} rows take {1e3 * rows_s:g} ms to read out, the frames follow each other after "
            f"{1e3 * interval:g} ms; {1e6 * interval / detector.rows:.4g} us is the most"
        )
        yield ("star_camera", "detector", "line_time"), words


def _field(scenario):
    """A field of view that a lens can have."""
    camera = scenario.star_camera
    width, height, diagonal = lens.field_of_view_deg(camera)
    if diagonal > lens.WIDEST_DEG:
        chip, optics = camera.detector, camera.optics
        words = (
            f"{chip.columns} x {chip.rows} pixels of {1e6 * chip.pixel_size:.4g} um behind "
            f"{1e3 * optics.focal_length:.4g} mm see {width:.4g} x {height:.4g} deg, {diagonal:.4g} deg from "
            f"corner to corner; {lens.WIDEST_DEG:g} deg is the most that is simulated: is "
            "detector.pixel_size right?"
        )
        yield ("star_camera", "optics", "focal_length"), words


def _lens(scenario):
    """A distortion that can be taken out again, and a scan that knows of it. A Scenario, or a camera file"""
    path, camera = ("star_camera", "optics"), scenario.star_camera
    cameras = [(path, camera)]
    if hasattr(scenario, "navigation"):
        cameras += [(("navigation", "told", *path), as_told(scenario).star_camera)]
    given = [(where, words) for where, one in cameras if (words := lens.fault(one)) is not None]
    for where, words in given if len({words for _, words in given}) > 1 else given[:1]:
        yield (*where, "distortion"), words
    bent = [where for where, one in cameras if one.optics.distortion and any(one.optics.distortion)]
    if bent and scenario.star_tracker.detection.scan == "run_length":
        words = "scan 'run_length' takes the lens for a pinhole; choose sequential, maximum or streaks"
        yield ("star_tracker", "detection", "scan"), words


def _principal_point(scenario):
    """An optical axis that meets the detector, of the truth and of what is told."""
    for path, camera in (
        ((), scenario.star_camera),
        (("navigation", "told"), scenario.navigation.told.star_camera),
    ):
        point = camera and camera.optics and camera.optics.principal_point
        chip = scenario.star_camera.detector
        if point and not (-0.5 <= point[0] <= chip.columns - 0.5 and -0.5 <= point[1] <= chip.rows - 0.5):
            words = (
                f"[{point[0]:g} pix, {point[1]:g} pix] is not on a detector of {chip.columns} x {chip.rows} "
                "pixels"
            )
            yield (*path, "star_camera", "optics", "principal_point"), words


def _grey_values(scenario):
    """Grey values that the detector can have."""
    tracker, bits = scenario.star_tracker, scenario.star_camera.detector.bits
    largest = 2**bits - 1
    for path, value in (
        (("exposure", "brightest_mean"), tracker.exposure.brightest_mean),
        (("detection", "saturation"), tracker.detection.saturation),
    ):
        if value > largest:
            words = f"{value:g} DN is above {largest} DN, the largest grey value of {bits} bits"
            words += "; write automatic" * (path[-1] == "saturation")
            yield ("star_tracker", *path), words
    if bits > 8 and 4.0 * tracker.detection.saturation < largest:
        words = (
            f"{tracker.detection.saturation:g} DN is less than a quarter of {largest} DN, the largest grey "
            f"value of {bits} bits: most stars would count as saturated; write automatic, which is "
            f"{largest} DN here"
        )
        yield ("star_tracker", "detection", "saturation"), words
    black = scenario.star_camera.detector.black_level
    if black >= tracker.detection.saturation:
        words = f"must be above star_camera.detector.black_level, {black:g} DN"
        yield ("star_tracker", "detection", "saturation"), words


def _chain(scenario):
    """Ways to find and to identify objects that go together, with the camera that there is."""
    tracker, detector = scenario.star_tracker, scenario.star_camera.detector
    detection, path = tracker.detection, ("star_tracker", "detection")
    if detector.shutter == "rolling" and detection.scan in SPOTS:
        words = (
            f"'{detection.scan}' takes all rows for exposed at once, which a rolling shutter does not do; "
            "choose streaks or run_length, or star_camera.detector.shutter: global"
        )
        yield (*path, "scan"), words
    needed = CENTROIDS.get(detection.scan, detection.centroid)
    if detection.centroid != needed:
        words = f"scan {detection.scan!r} brings its own way along; write centroid: {needed}"
        yield (*path, "centroid"), words
    if detection.scan == "run_length":
        yield from _contiguous(tracker)
    window = detection.run_length.window
    if window & (window - 1):
        yield (*path, "run_length", "window"), f"{window} is not a power of two"
    deepest = tracker.identification.deepest
    if deepest is not None and deepest <= tracker.catalogue.faintest:
        words = f"{deepest:g} must be fainter than catalogue.faintest, {tracker.catalogue.faintest:g}"
        words += f" (both in {tracker.catalogue.system})"
        yield ("star_tracker", "identification", "deepest"), words


def _contiguous(tracker):
    """Frames without gaps, as the fusion of clusters needs them."""
    interval = 1.0 / tracker.rate
    for name in ("start", "shortest", "longest"):
        value = getattr(tracker.exposure, name)
        if abs(value - interval) > SAME:
            words = (
                f"scan 'run_length' follows each streak into the next frame, so there must be no gap: "
                f"{1e3 * value:g} ms must be {1e3 * interval:g} ms, the interval of star_tracker.rate"
            )
            yield ("star_tracker", "exposure", name), words


def _clock_and_window(scenario):
    """Frames that the clock can trigger, a window within the mission, thresholds the right way round."""
    tracker, path = scenario.star_tracker, ("star_tracker",)
    ticks = TICK_HZ / tracker.rate
    if abs(ticks - round(ticks)) > 1e-6:
        words = (
            f"{tracker.rate:g} Hz does not divide the on-board clock, 100 Hz; take 1, 2, 4, 5, 10 or 20 Hz"
        )
        yield (*path, "rate"), words
    exposure = tracker.exposure
    if not exposure.shortest <= exposure.start <= exposure.longest:
        limits = f"{1e3 * exposure.shortest:g} to {1e3 * exposure.longest:g} ms"
        words = f"{1e3 * exposure.start:g} ms must lie between shortest and longest, {limits}"
        yield (*path, "exposure", "start"), words
    mission = scenario.mission
    if not mission.start <= tracker.on < mission.time_limit:
        words = (
            f"{seconds(tracker.on)} is not within the mission, {mission.start:g} to {mission.time_limit:g} s"
        )
        yield (*path, "on"), words
    if tracker.off <= tracker.on:
        yield (*path, "off"), f"{seconds(tracker.off)} must be later than on, {seconds(tracker.on)}"
    elif tracker.off > mission.time_limit:
        yield (
            (*path, "off"),
            f"{seconds(tracker.off)} is after mission.time_limit, {seconds(mission.time_limit)}",
        )
    if tracker.detection.fewest_pixels > tracker.detection.most_pixels:
        yield (*path, "detection", "fewest_pixels"), "must not exceed most_pixels"
    if tracker.detection.grow_sigma > tracker.detection.seed_sigma:
        yield (*path, "detection", "grow_sigma"), "must not exceed seed_sigma"


def _catalogue_and_latency(scenario):
    """The catalogue flown against the stars that shine; the filter's memory against what arrives late."""
    tracker, navigation = scenario.star_tracker, scenario.navigation
    catalogue, camera = tracker.catalogue, scenario.star_camera
    if catalogue.faintest > camera.stars.faintest:
        on_board = f"{catalogue.system} {catalogue.faintest:g}"
        words = f"{on_board} on board, the camera draws stars to V {camera.stars.faintest:g}"
        yield ("star_tracker", "catalogue", "faintest"), words
    deepest = tracker.identification.deepest
    if deepest is not None and deepest > camera.stars.faintest:
        matched = f"{catalogue.system} {deepest:g}"
        words = f"{matched} is matched, the camera draws stars to V {camera.stars.faintest:g}"
        yield ("star_tracker", "identification", "deepest"), words
    if catalogue.kind == "asymmetric" and catalogue.faintest_south is None:
        yield ("star_tracker", "catalogue", "faintest_south"), "an asymmetric catalogue needs it"
    if tracker.identification.tracking and tracker.identification.method != "bayes":
        words = f"method {tracker.identification.method!r} cannot use a prediction; set tracking: false"
        yield ("star_tracker", "identification", "tracking"), words
    if (found := contradiction(tracker.identification)) is not None:
        yield ("star_tracker", "identification", found[0]), found[1]
    if navigation.stars == "vectors" and not tracker.identification.tracking:
        words = (
            "stars: vectors identifies one or two stars by the predicted attitude; set "
            "star_tracker.identification.tracking: true, or choose attitude"
        )
        yield ("navigation", "stars"), words
    if catalogue.kind == "combined" and catalogue.keep_to > catalogue.faintest:
        yield ("star_tracker", "catalogue", "keep_to"), "must not be fainter than faintest"
    rows_s = settings(camera.detector).line_s * (camera.detector.rows - 1)
    star_delay = tracker.exposure.longest + rows_s + camera.detector.readout + tracker.latency
    if star_delay >= navigation.history:
        late = f"the {1e3 * star_delay:g} ms that a star fix is late"
        words = f"{seconds(navigation.history)} must be longer than {late}"
        yield ("navigation", "history"), words


def _absent(scenario):
    """Errors that cannot be left out: noise of pictures is in their pixels."""
    tracker, absent = scenario.star_tracker, scenario.without
    if twice := [name for k, name in enumerate(absent) if name in absent[:k]]:
        yield ("without",), f"{twice[0]} is there twice; keep one of them"
    if tracker.enabled and tracker.frames != "statistical" and STAR_NOISE in absent:
        words = f"{STAR_NOISE} is in the pixels of a picture; fly with star_tracker.frames: statistical"
        yield ("without",), words


OF_CAMERA = (_rows_and_frames, _grey_values, _chain, _lens)  # of sections star_camera and star_tracker alone
PARTS = (_clock_and_window, _field, _principal_point, *OF_CAMERA, _catalogue_and_latency, _absent)
