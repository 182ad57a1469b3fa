"""One picture of a calibration: solved without being told the lens, and what the detector shows in it.

Pictures are read one after the other, so that few are in memory at once; of each is kept what the
calibration needs.
"""

from hashlib import sha256
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.pinhole import solid_angle
from shefex_nav.solve import background, image, picture, search, told
from shefex_nav.solve import lens as lenses
from shefex_nav.solve.calibration import hot_pixels, noise, spots
from shefex_nav.solve.calibration.lens_fit import Sights
from shefex_nav.solve.header import Taken, of_header, says_day
from shefex_nav.solve.lens import Lens

LOSSY = (".jpg", ".jpeg", ".webp")  # neighbouring pixels share their noise, or lose it
FAINTEST = 20_000  # stars on the whole sky that a picture may show: to V 7.3
NO_DAY = "tells no day; aberration changes the focal length by up to 2e-4 from one to another"
SPOT_PX = 4.0  # radius of a star that was not detected


class Told(NamedTuple):
    """What is said of the pictures beside themselves; None where nobody says it."""

    fov_deg: float | None = None
    julian_year: float | None = None
    detector: tuple | None = None  # (size_px, bits) of the camera


class Seen(NamedTuple):
    """What a picture gives to a calibration."""

    name: str
    size_px: tuple  # (width, height)
    sights: Sights
    lens: Lens  # as this picture alone tells it
    widths_px: np.ndarray  # (k,) of spots
    levels: list  # of noise.Level
    no_levels: str  # why there are none; or empty
    bright: hot_pixels.Bright
    detected_px: np.ndarray  # (n, 2) named stars
    radius_px: np.ndarray  # (n,)
    year: float
    depth: int  # 8: bits as stored; 16: grey values above 255; 0: not told, as of developed pictures
    digest: bytes  # of the grey values


class Unsolved(NamedTuple):
    """A picture without an attitude."""

    name: str
    reason: str


def read(path, given):
    """Grey values as stored, and Taken, of a file. given : Told

    Raises PictureError, which names the file: it cannot be read, is not of the camera, or has no date.
    """
    values, taken = _stored(path, given)
    if taken.julian_year is None:  # the aberration of another day would change the focal length by up to 2e-4
        words = "does not say when it was taken, and pictures without a date are refused"
        ways = "give --epoch YEAR, an epoch in the file of --camera, or DATE-OBS in a header"
        raise picture.PictureError(f"{path}: {words}; {ways}")
    if not says_day(taken.julian_year):
        raise picture.PictureError(f"{path}: was taken in {taken.julian_year:g}, which {NO_DAY}")
    if given.detector is not None:
        _check_detector(path, values, *given.detector)
    return values, taken


def _stored(path, given):
    """Grey values, and Taken, whose year is None where neither the file nor `given` says it."""
    if path.suffix.lower() in picture.RAW:
        if given.detector is None:
            raise picture.PictureError(
                f"{path}: holds grey values alone; --camera says their number and depth"
            )
        return picture.raw(path, *given.detector), Taken(given.julian_year)
    stored = picture.stored(path)
    try:
        taken = of_header(stored.header)
    except ValueError as error:
        raise picture.PictureError(f"{path}: {error}") from None
    years = taken.julian_year, stored.julian_year, given.julian_year
    return stored.values, taken._replace(julian_year=next((one for one in years if one is not None), None))


def _check_detector(path, values, size_px, bits):
    """PictureError where a detector of this size and depth does not give such a picture."""
    height, width = values.shape[:2]
    if (width, height) != tuple(size_px):
        raise picture.PictureError(
            f"{path}: has {width} x {height} pixels, the detector of --camera {size_px[0]} x {size_px[1]}"
        )
    if _no_levels(path, values):  # such values are not the detector's, and tell nothing but the lens
        return
    if bits > 8 and values.dtype.itemsize == 1:
        raise picture.PictureError(f"{path}: has 8 bits a pixel, the grey values of --camera {bits}")
    low, high = values.min(), values.max()
    if low < 0 or high >= 2**bits:
        raise picture.PictureError(
            f"{path}: has grey values from {low:g} to {high:g}; those of --camera have {bits} bits, "
            f"0 to {2**bits - 1}"
        )


def velocity_of(taken):
    """Velocity of a camera relative to the barycentre [m/s], from Taken: (3,)."""
    v_i = told.earth_velocity(round(taken.julian_year * told.MINUTES))
    return v_i if taken.velocity_i is None else v_i + taken.velocity_i


def look(name, values, taken, given, *, velocity_i=None):
    """Seen of a picture, or Unsolved.

    values : (rows, columns[, channels]) grey values as the detector gives them
    velocity_i : (3,) m/s, relative to the barycentre; by default of `velocity_of`
    """
    grey, record = picture.grey(values, name), image.Record()
    year = taken.julian_year
    answer = image.solve_picture(
        picture.Picture(grey, year, full=picture.full_of(values)), fov_deg=given.fov_deg, epoch=year,
        record=record,
    )  # fmt: skip
    if answer.status != "ok":
        return Unsolved(name, answer.reason)
    known, found, lens = record.known, record.field, record.adjusted.lens
    velocity_i = velocity_of(taken) if velocity_i is None else velocity_i
    u_i = aberrate(record.u_i, velocity_i)
    sights = Sights(lens.C_ci, u_i, found.xy_px[known], found.P_px[known])
    radius = np.sqrt(found.n_pixels[known] / np.pi) * found.binning + hot_pixels.NEAR_PX
    size_px = grey.shape[::-1]
    flat, sigma, _ = background.flatten(grey)
    bright_stars = found.xy_px[known][~found.saturated[known]]
    covered = _covered(found, lens, size_px, year)
    no_levels = _no_levels(name, values)
    levels = [] if no_levels else noise.levels(grey, covered)
    if levels:  # finer than by quantiles, which are whole grey values
        finer = float(np.sqrt(np.median([one.variance for one in levels])))
        sigma = max(
            finer, noise.LEAST_DN * background.grey_step(grey)
        )  # none is left where the sky is one value
    sigma = max(sigma, noise.of_cut(grey, flat, covered))
    widths = spots.widths(grey, flat, bright_stars, sigma)
    return Seen(
        name, size_px, sights, lens, widths, levels, no_levels, hot_pixels.bright(flat, sigma),
        found.xy_px[known], radius, year, 0 if no_levels else _depth(values), sha256(grey).digest(),
    )  # fmt: skip


def _covered(found, lens, size_px, year):
    """Pixels that show more than sky: detections, and stars of the catalogue too faint for that."""
    radius = np.sqrt(found.n_pixels / np.pi) * found.binning + hot_pixels.NEAR_PX
    refused = np.full(len(found.refused_px), SPOT_PX * found.binning)
    faint = faint_stars(lens, size_px, year)
    at = np.concatenate([found.xy_px, found.refused_px, faint])
    radii = np.concatenate([radius, refused, np.full(len(faint), SPOT_PX)])
    return hot_pixels.near_stars(at, radii, size_px)


def faint_stars(lens, size_px, year):
    """Places of the stars of the catalogue in a picture, those below its noise among them: (n, 2) px."""
    share = solid_angle(*size_px, lens.focal_px) / (4.0 * np.pi)  # of the sky
    sky = search.sky_of(lens, max(int(FAINTEST * share), 10), size_px, year)
    at, _ = lenses.project(lens, sky.u_i, size_px)
    return at[((at > -SPOT_PX) & (at < np.asarray(size_px) + SPOT_PX)).all(axis=1)]


def _depth(values):
    """Depth of grey values, as of Seen."""
    return 8 if values.dtype.itemsize == 1 else 16 * int(values.max() > 255)


def _no_levels(name, values):
    """Why the noise of a picture is not the detector's; empty if it is."""
    if str(name).lower().endswith(LOSSY):
        return "the pictures are compressed with loss, which changes noise"
    if values.ndim == 3 and values.shape[2] >= 3:
        return "the pictures are in colour: values of neighbours are mixed in them"
    with np.errstate(invalid="ignore"):  # infinite values: they are not whole, and refused later
        whole = values.dtype.kind != "f" or not (values % 1.0 != 0.0).any()
    if not whole:
        return "the grey values are not whole: they are no longer those of the detector"
    return ""
