"""Attitude from a picture of the night sky, of any camera.

The route: `picture` reads the file, `field` finds point-like objects with the detection and the fit that
fly, `patterns` and `triangles` propose attitudes and focal lengths by the shape of triangles, `lens` adjusts
them, `proof` decides with the identification that flies, and `naming` and `lens` make the attitude of all
stars that are named. Nothing is given out that chance would make more often than once in 10^7 pictures.
"""

from dataclasses import dataclass, replace
from dataclasses import field as of_each
from functools import lru_cache
from os import PathLike
from pathlib import Path

import numpy as np

from shefex_nav import warmup
from shefex_nav.solve import field, given, lens, naming, patterns, picture, proof, told, triangles
from shefex_nav.solve import search as searching
from shefex_nav.solve.camera import Camera, check_lens
from shefex_nav.solve.header import AS_STORED, ON_ITS_SIDE, Taken, of_header, says_day, this_year
from shefex_nav.solve.solution import failed

FOV_DEG = (5.0, 70.0)  # horizontal, when nothing is said about it
EDGE = 1.02  # factor beyond both: proposals scatter, and no lens has quite the focal length of a pinhole
NARROWEST_DEG = 2.0  # that may be told
ARRAY = "(rows, columns[, channels]) of NumPy"
SATURATED = 0.5  # share of the pixels at the end of their range, from which on a picture is too bright
FOV_TOLERANCE = 1.2  # factor either way, of a field of view that is given
CAMERA_TOLERANCE = 1.02  # of the focal length of a given camera


@lru_cache(maxsize=4)
def _load(year):
    """Stars and compiled code, before the clock runs: something small through all stages."""
    patterns.catalogue(year)
    patterns.magnitudes()
    grid = np.mgrid[40:200:40, 40:200:40].reshape(2, -1).T.astype(float)
    spots = np.random.default_rng(0).normal(0.0, 1.0, (256, 256)).astype(np.float32)
    for x, y in grid.astype(int):
        spots[y - 1 : y + 2, x - 1 : x + 2] += [[10.0, 20.0, 10.0], [20.0, 40.0, 20.0], [10.0, 20.0, 10.0]]
    field.find(spots)
    at = lens.Lens(np.eye(3), 2000.0)
    flux = np.linspace(2.0, 1.0, len(grid))
    size_px = (256, 256)
    sky = searching.sky_of(at, 60, size_px, year)
    perfect = lens.fit(at, sky.u_i, lens.project(at, sky.u_i, size_px)[0], size_px)
    proof.prove(perfect, sky, grid, flux, size_px, 1.0)
    lens.directions(Camera(256, 256, 2000.0, None, (0.1, 0.0, 0.0, 0.0, 0.0)), grid)
    band = patterns.band(patterns.bands(0.5, 0.5)[0], year)
    cells = triangles.detection_cells(grid, *size_px)
    spots = triangles.Spots(grid, flux, (256.0, 256.0), cells, 0.0)
    triangles.propose(spots, (400.0, 600.0), 2, 4, band, np.zeros((triangles.KEPT, 12)), 0)


@dataclass
class Record:
    """How a picture was solved, for those who want to see it."""

    field: object = None  # Field
    trials: list = of_each(default_factory=list)  # (proposal, Fit or None, Proof or None), as they were tried
    adjusted: object = None  # Adjusted, of a picture that is solved
    known: object = None  # (k,) rows of the detections that have a name
    residual_px: object = None  # (k, 2) detection minus star
    u_i: object = None  # (k, 3) directions of their stars in the catalogue, without aberration


def solve_image(image, *, camera=None, fov_deg=None, epoch=None, taken=None, mirrored=False):
    """Attitude, field of view and stars of a picture of the night sky.

    The field of view across may be 5 to 70 degrees, told 2 to 70. The lens may be anything between a pinhole
    with a few per cent of distortion and r = f theta; its focal length, principal point and five terms of
    distortion are found as well. The tables for a range of fields of view are made when they are first
    needed, 0.1 to 2 s each, and kept.

    The covariance is that of the attitude with all of the lens unknown. Aberration is taken out where the day
    of the picture is known, by its file or the epoch; where not, the attitude is that against the stars as
    they are seen, up to 20.5 arcsec from their places in the catalogue (`aberration_removed` of the result).
    With a StarCamera the picture goes through the star tracker that flies.

    Parameters
    ----------
    image : path of a picture file, or a NumPy array (rows, columns[, channels]) of grey values, row 0 at the
        top
        a file is turned as its EXIF orientation says, unless the camera is a StarCamera
    camera : None, a Camera (of the picture as displayed) whose focal length is right to two per cent, or a
        StarCamera (of the pixels as stored)
    fov_deg : None, or the horizontal field of view, right to 20 per cent; by default anything from 5 to 70
    epoch : None or a Julian year, for proper motions and the velocity of the Earth, the latter if it says a
        day (2012.473, not 2012 or 2012.5); by default the date of the file, else today
    taken : None or a Taken, of an array and with a StarCamera only; a file says it itself
    mirrored : bool, the picture is mirrored, as through a telescope with a diagonal; q_ci and camera of the
        solution are those of the picture turned over, left for right; a mirrored picture is refused without

    Returns
    -------
    ImageSolution; a picture that cannot be solved is not an error

    Raises
    ------
    PictureError : a file that cannot be read, or an array that is no picture, or none of the StarCamera
    ValueError : any other argument
    """
    is_array = isinstance(image, np.ndarray)
    if not is_array and not isinstance(image, str | PathLike):
        words = f"{ARRAY} or the path of a file, got {type(image).__name__}"
        raise picture.PictureError(f"image: expected an array {words}")
    if taken is not None and not (is_array and isinstance(camera, told.StarCamera)):
        raise ValueError("taken: goes with an array and a StarCamera; the file of a picture says it itself")
    if isinstance(camera, told.StarCamera):
        if mirrored:
            raise ValueError("mirrored: not together with a StarCamera, whose pictures are as they are")
        if fov_deg is not None:
            raise ValueError("fov_deg: not together with a camera, which has its own")
        return _of_star_camera(image, camera, epoch, taken)
    seen = picture.of_array(image) if is_array else picture.read(image)
    return solve_picture(seen, camera=camera, fov_deg=fov_deg, epoch=epoch, mirrored=mirrored)


def _of_star_camera(image, camera, epoch, taken):
    """`solve_image` of a StarCamera."""
    is_array = isinstance(image, np.ndarray)
    image_dn, taken, turn = (image, taken or Taken(), AS_STORED) if is_array else as_stored(image, camera)
    if epoch is not None:
        taken = taken._replace(julian_year=_year(epoch, None))
    warmup.get_ready({"command=solve"})
    try:
        found = told.solve(image_dn, camera, taken)._replace(orientation=turn, as_stored=True)
    except picture.PictureError as error:
        raise error if is_array else _of_file(image, error) from None
    return found if epoch is None else found._replace(date_from="epoch")


def _of_file(path, error):
    """The PictureError about a file from an error about its grey values."""
    return picture.PictureError(f"{path}: {str(error).removeprefix('image: ')}")


def as_stored(path, camera):
    """Grey values of a file of a StarCamera, Taken, and its orientation; PictureError names the file."""
    path, hole = Path(path), camera.params.camera.pinhole
    if path.suffix.lower() in picture.RAW:
        return picture.raw(path, (hole.width_px, hole.height_px), camera.bits), Taken(), AS_STORED
    found = picture.stored(path)
    try:
        taken = of_header(found.header)
        if taken.julian_year is None:
            taken = taken._replace(julian_year=found.julian_year)
        return told.checked(found.values, camera), taken, found.orientation
    except ValueError as error:
        raise _of_file(path, error) from None


def solve_picture(seen, *, camera=None, fov_deg=None, epoch=None, mirrored=False, record=None):
    """`solve_image` for a Picture that has been read. record : Record, filled with the way there."""
    found = _solved(seen, camera, fov_deg, epoch, mirrored, record)
    said = "epoch" if epoch is not None else "today" if seen.julian_year is None else "picture"
    return found._replace(orientation=seen.orientation, date_from=said)


def _solved(seen, camera, fov_deg, epoch, mirrored, record):
    """`solve_picture`."""
    if mirrored:
        width = seen.grey.shape[1]
        over = seen._replace(grey=np.ascontiguousarray(seen.grey[:, ::-1]))
        camera = turned_over(camera) if isinstance(camera, Camera) else camera
        return back(_solved(over, camera, fov_deg, epoch, False, record), width)
    warmup.get_ready({"command=solve"})
    size_px = seen.grey.shape[::-1]
    focal_range = _focal_range(size_px, camera, fov_deg, is_turned=seen.orientation in ON_ITS_SIDE)
    year = _year(epoch, seen.julian_year)
    _load(year)
    clock = searching.Clock()
    found = field.find(seen.grey)
    trials = None
    if record is not None:
        record.field, trials = found, record.trials
    xy_px = found.xy_px
    if camera is not None:
        xy_px = naming.centred(camera, xy_px)
    search = searching.Search(size_px, focal_range, year, camera is None)
    solved, reason = searching.solve(xy_px[found.in_sky], found.flux[found.in_sky], search, clock, trials)
    if solved is None and not found.in_sky.all():
        solved, reason = searching.solve(xy_px, found.flux, search, clock, trials)
    if solved is None and reason == "no_match":
        turned = xy_px[found.in_sky] * [-1.0, 1.0] + [size_px[0] - 1.0, 0.0]
        flux, rounds = found.flux[found.in_sky], searching.FEW_ROUNDS
        if searching.solve(turned, flux, search, clock, rounds=rounds)[0] is not None:
            reason = "mirrored"
    if solved is None:
        full = seen.full is not None and np.mean(seen.grey >= seen.full) > SATURATED
        return failed("saturated" if full else reason, clock.ms(), found.xy_px)
    day = year, _velocity(epoch, seen)
    return naming.described(solved, found, xy_px, size_px, day, camera, clock, record)


def turned_over(camera):
    """Camera of pictures that are turned over, left for right."""
    x, y = camera.principal_point_px
    k = camera.distortion
    k = k if k is None else (k[0], k[1], k[2], -k[3], k[4])
    return replace(camera, principal_point_px=(camera.width_px - 1.0 - x, y), distortion=k)


def back(found, width):
    """ImageSolution of a picture that was turned over, with the pixels of the picture as it is."""
    matched = [match._replace(x_px=width - 1.0 - match.x_px) for match in found.matched]
    xy_px = found.xy_px * [-1.0, 1.0] + [width - 1.0, 0.0]
    reason = "not_mirrored" if found.reason == "mirrored" else found.reason
    return found._replace(reason=reason, matched=matched, xy_px=xy_px, mirrored=True)


def _focal_range(size_px, camera, fov_deg, is_turned=False):
    """Shortest and longest focal length [px] to look for.

    is_turned : on its side by EXIF: the field of view that is told may be meant of either side
    """
    if camera is not None:
        if fov_deg is not None:
            raise ValueError("fov_deg: not together with a camera, which has its own")
        if not isinstance(camera, Camera):
            raise ValueError(f"camera: expected a Camera, got {camera!r}")
        if (camera.width_px, camera.height_px) != size_px:
            raise ValueError(
                f"camera: has {camera.width_px} x {camera.height_px} pixels, "
                f"the picture {size_px[0]} x {size_px[1]}"
            )
        check_lens(camera)
        return camera.focal_length_px / CAMERA_TOLERANCE, camera.focal_length_px * CAMERA_TOLERANCE
    narrow, wide = FOV_DEG[0] / EDGE, FOV_DEG[1] * EDGE
    if fov_deg is not None:
        wanted = given.number("fov_deg", fov_deg)
        if not NARROWEST_DEG <= wanted <= FOV_DEG[1]:
            raise ValueError(
                f"fov_deg: expected {NARROWEST_DEG:g} to {FOV_DEG[1]:g} degrees, got {fov_deg!r}"
            )
        narrow, wide = wanted / FOV_TOLERANCE, wanted * FOV_TOLERANCE
    sides = size_px if is_turned and fov_deg is not None else size_px[:1]
    found = [0.5 * side / np.tan(0.5 * np.radians(fov)) for side in sides for fov in (wide, narrow)]
    return min(found), max(found)


def _velocity(epoch, seen):
    """Barycentric velocity of the camera [m/s] when a Picture was taken; None where nobody says the day."""
    when = epoch if epoch is not None else seen.julian_year
    if when is None or not says_day(when):
        return None
    velocity_i = told.earth_velocity(round(when * told.MINUTES))
    return velocity_i if seen.velocity_i is None else velocity_i + seen.velocity_i


def _year(epoch, seen_year):
    """Epoch of the star positions."""
    if epoch is None:
        return seen_year if seen_year is not None else this_year()
    year = given.number("epoch", epoch)
    if not 1900.0 < year < 2200.0:
        raise ValueError(f"epoch: expected a Julian year between 1900 and 2200, got {epoch!r}")
    return year
