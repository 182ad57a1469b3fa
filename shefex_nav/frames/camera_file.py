"""The star camera in a file: what `solve --camera` takes, and what an export of frames writes.

The sections have the keys and units of a scenario. A scenario may stand in the place of such a file.
"""

from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, create_model

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.distortion import displaced_px
from shefex_nav.geometry.pinhole import solid_angle
from shefex_nav.onboard.startracker import settings as startracker
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.tracker import TrackerParams
from shefex_nav.scenario import checks_tracker, kind, layers, lens, load
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.mission import Epoch
from shefex_nav.scenario.of_settings import section, settings
from shefex_nav.scenario.starlight import OF_LENS
from shefex_nav.scenario.told import as_told
from shefex_nav.solve.camera import of_pinhole
from shefex_nav.solve.told import StarCamera
from shefex_nav.world import camera_settings

MISSION = "shefex2_andoya"
STARS = 30  # of the catalogue, in the field on average
DEEPEST = 8.0  # V
MERGED_PX = 3.0  # closer stars are one point of light
BRIGHT = 0.4  # mean of a picture that is too bright, as a share of the largest grey value
RATE = 1.0  # Hz: leaves time to read out all rows of any shutter; nothing else follows from it
FLIGHT = ("vehicle", "programme", "trajectory")  # sections that only a scenario of a flight has
HEAD = "# Star camera of pictures, for `shefex-nav solve --camera`; keys and units are those of scenarios.\n"
FLUX = "zero_magnitude_flux"
WORLD_ONLY = ("frames", "model", "software")  # keys of star_tracker that are not of the star tracker itself


NOT_IN_PICTURES = {"background": None, "read_noise": None, "full_well": None, "readout": "0 s"}
SHORTEST = "the shortest camera file is in docs/how-to/calibrate.md"


def tracker_of(sensor):
    """Section star_tracker for a section star_camera with optics and detector, of a file that says none.

    It is that of the default mission, with what follows from the camera: saturation by the bits of a grey
    value, the way to look for objects by the shutter, how far stars are merged by the pixels, how deep its
    catalogue goes by the field of view. There is no amplifier: `conversion` is that of the pictures.
    """
    detector, hole = sensor.detector, lens.pinhole_of(sensor)
    usual = load.load(MISSION).star_tracker
    largest = 2**detector.bits - 1
    return usual.with_sections(
        rate=RATE,
        exposure=usual.exposure.with_sections(brightest_mean=BRIGHT * largest, gain=0.0),
        detection=usual.detection.with_sections(
            saturation=float(largest), scan="streaks" if detector.shutter == "rolling" else "sequential"
        ),
        catalogue=usual.catalogue.with_sections(
            faintest=faintest(hole), merge_radius=MERGED_PX / hole.focal_length_px
        ),
    )


def faintest(hole):
    """V of the faintest star, so that the field of a Pinhole holds STARS of them on average."""
    share = solid_angle(hole.width_px, hole.height_px, hole.focal_length_px) / (4.0 * np.pi)  # of the sky
    vmag = np.sort(load_catalogue(DEEPEST).vmag)
    return float(vmag[min(int(STARS / share), len(vmag) - 1)])


def with_tracker(check):
    """A check of a camera file that has its star tracker, or `tracker_of` it. check : of checks_tracker"""

    def of_file(given):
        own = given.star_tracker
        yield from check(given if own else given.with_sections(star_tracker=tracker_of(given.star_camera)))

    return of_file


def told_tracker(given):
    """Settings of the star tracker of a camera file, of its own or `tracker_of` it; and its gain [dB]."""
    tracker = given.star_tracker or tracker_of(given.star_camera)
    return settings(tracker), tracker.exposure.gain


def _of_pictures(detector):
    """Section of a detector in which what pictures do not need may be left out."""
    fields = detector.model_fields
    optional = {
        name: (
            Annotated[fields[name].annotation, *fields[name].metadata] | None,
            Field(default=default, description=fields[name].description),
        )
        for name, default in NOT_IN_PICTURES.items()
    }
    return create_model(detector.__name__, __base__=detector, __module__=__name__, **optional)


class Sensor(Block):
    """The star camera as it is known."""

    optics: section(camera_settings.Optics)
    detector: _of_pictures(section(camera_settings.Detector))


class CameraFile(Block):
    """A star camera and its star tracker."""

    NAME: ClassVar[str] = "Camera"
    EXAMPLE: ClassVar[str] = "camera.yaml"

    description: str = Field(default="", description="for people")
    epoch: Epoch | None = Field(
        default=None, description="UTC of pictures that do not say it; left out: such pictures are refused"
    )
    star_camera: Sensor
    bad_pixels: list[tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]] = Field(
        default=[], description="row and column of each, the first is 0; they are not looked at"
    )
    star_tracker: section(startracker.StarTracker) | None = Field(
        default=None, description="left out: that of the default mission, for this camera (camera_file.py)"
    )


class Base(NamedTuple):
    """A camera as a file says it, for another file that says it better."""

    camera: StarCamera
    detector: Block  # section of the file
    gain_db: float
    tree: dict  # of a camera file
    files: tuple  # paths of the texts that it is made of


def read(path):
    """StarCamera of a camera file or of a scenario, a path or the name of a shipped one.

    Raises ScenarioError, which lists every error with its place.
    """
    return base(path).camera


def base(path):
    """Base of the same."""
    path = layers.file_of(path)
    texts = layers.Texts()
    tree, _ = layers.extended(path, texts)
    if any(key in tree for key in FLIGHT):
        scenario = load.load(path)
        camera = of_scenario(scenario)
        detector, gain_db = scenario.star_camera.detector, scenario.star_tracker.exposure.gain
        return Base(camera, detector, gain_db, _tree_of(scenario), tuple(texts))
    try:
        given, _, _ = load.load_as(
            lambda provided: CameraFile,
            path,
            parts=(_bad_pixels, *map(with_tracker, checks_tracker.OF_CAMERA)),
            instead=kind.instead_of_camera,
        )
    except ScenarioError as error:
        if not any("is missing" in line for line in error.messages):
            raise
        raise ScenarioError([*error.messages, f"{path}: {SHORTEST}"]) from None
    sensor = given.star_camera
    bad = np.array(given.bad_pixels, dtype=np.int64).reshape(-1, 2)
    tracker, gain_db = told_tracker(given)
    camera = _star_camera(sensor, tracker, bad, given.epoch)
    return Base(camera, sensor.detector, gain_db, tree, tuple(texts))


def of_scenario(scenario, bad_pixels=()):
    """StarCamera of a Scenario, as its flight software is told it; bad pixels differ from run to run."""
    told = as_told(scenario)
    bad = np.array(bad_pixels, dtype=np.int64).reshape(-1, 2)
    return _star_camera(told.star_camera, settings(told.star_tracker), bad, scenario.mission.epoch)


def _star_camera(sensor, tracker, bad_pixels, epoch):
    """StarCamera of sections that have been read."""
    from shefex_nav.environment.ephemeris import julian_year

    optics, detector, exposure = sensor.optics, sensor.detector, tracker.exposure
    hole, distortion = lens.pinhole_of(sensor), lens.distortion_of(sensor)
    per_dn = detector.conversion / 10.0 ** (exposure.gain / 20.0)
    model = CameraModel(
        pinhole=hole,
        bad_pixels=bad_pixels,
        electrons_per_dn=per_dn,
        psf_sigma=optics.psf_sigma,
        zero_flux=optics.zero_magnitude_flux * exposure.longest / per_dn,
        focal_length_error=optics.focal_length_error,
        distortion=distortion,
        displaced_px=displaced_px(hole, distortion),
    )
    line_s = detector.line_time if detector.shutter == "rolling" and detector.line_time else 0.0
    return StarCamera(
        params=TrackerParams(tracker, model, np.zeros(3)),
        principal_point_error=optics.principal_point_error,
        bits=detector.bits,
        line_s=line_s,
        julian_year=None if epoch is None else julian_year(epoch),
    )


def true_lens(scenario, world):
    """solve.Camera of the star camera as it is in a run. Scenario, prepare.World"""
    return of_pinhole(world.camera.pinhole, lens.distortion_of(scenario.star_camera))


def _bad_pixels(given):
    """(path of the field, words) of bad pixels that are not on the detector."""
    detector = given.star_camera.detector
    for k, (row, column) in enumerate(given.bad_pixels):
        if row >= detector.rows or column >= detector.columns:
            place = f"[{row}, {column}] is not on a detector"
            yield ("bad_pixels", k), f"{place} of {detector.rows} rows and {detector.columns} columns"


def written(scenario, world, *, true=False):
    """Text of the camera file of a run.

    scenario, world : Scenario, prepare.World
    true : with the lens as it is in this run, and no error of it; otherwise as
        the flight software is told them
    """
    out = _tree_of(scenario)
    if true:
        out["description"] = f"{scenario.mission.name}, true in this run"
        hole, pixel_m = world.camera.pinhole, scenario.star_camera.detector.pixel_size
        out["star_camera"]["optics"] |= {
            "focal_length": f"{hole.focal_length_px * pixel_m * 1e3!r} mm",
            "focal_length_error": "0 %",
            "principal_point": [f"{float(hole.cx_px)!r} pix", f"{float(hole.cy_px)!r} pix"],
            "principal_point_error": "0 pix",
        }
        distortion = scenario.star_camera.optics.distortion
        if distortion is None:
            out["star_camera"]["optics"].pop("distortion", None)
        else:
            out["star_camera"]["optics"]["distortion"] = list(distortion)
    out["bad_pixels"] = world.camera.bad_pixel_map.tolist()
    return HEAD + load.normalised(out)


def _tree_of(scenario):
    """Tree of the camera file of a Scenario, as its flight software is told it; without bad pixels."""
    tree = layers.parsed(scenario.source, scenario.mission.name).tree
    camera, told = tree["star_camera"], tree.get("navigation", {}).get("told", {}) or {}
    optics, detector = camera["optics"], camera["detector"]
    if FLUX not in optics:  # it follows from lens and detector, of which the file then says nothing
        flux = scenario.star_camera.optics.zero_magnitude_flux
        kept = {key: value for key, value in optics.items() if key not in OF_LENS["optics"]}
        optics = {**kept, FLUX: f"{flux!r} electron/s"}
    out = {
        "description": f"{scenario.mission.name}, as calibrated",
        "epoch": tree["mission"]["epoch"],
        "star_camera": {
            "optics": {**optics, **(told.get("star_camera") or {}).get("optics", {})},
            "detector": {key: value for key, value in detector.items() if key not in OF_LENS["detector"]},
        },
    }
    out["star_tracker"] = {key: value for key, value in tree["star_tracker"].items() if key not in WORLD_ONLY}
    return out
