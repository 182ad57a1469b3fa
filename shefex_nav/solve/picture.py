"""Picture files: grey values as they are, and when they were taken.

In: FITS, and of what Pillow reads the FORMATS, 8 or 16 bits, grey or colour. Out: the numbers of the
file as the detector gave them (`stored`), or grey values as float32, turned as a viewer shows them (`read`).
A file that is no single still picture of a usable size is refused with a PictureError.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.files import irregular
from shefex_nav.solve import deep, fits_head
from shefex_nav.solve.header import AS_STORED, as_stored, displayed, julian_year, velocity_of, year_of

SMALLEST_PX, LARGEST_PX = 64, 20_000  # of a side
MOST_PIXELS = 150_000_000
FITS_MAGIC = b"SIMPLE  ="
ROW_ORDER, LOWEST_FIRST = "ROWORDER", "BOTTOM-UP"  # keyword of Siril and others, and its value; or TOP-DOWN
READABLE = "PNG, JPEG, TIFF, WebP, BMP, GIF, PPM or FITS"
FORMATS = "PNG", "JPEG", "TIFF", "WEBP", "BMP", "GIF", "PPM"  # no others: EPS, for one, starts Ghostscript
RAW = (".raw", ".bin")  # endings of files that hold grey values alone
EXIF_TAKEN, EXIF_BLOCK = 36867, 34665  # DateTimeOriginal, and its block
EXIF_ORIENTATION = 274


class PictureError(UserError, ValueError):
    """A picture that cannot be read; the message names the file and what is wrong."""


class Picture(NamedTuple):
    """A picture in grey, as it is displayed."""

    grey: np.ndarray  # (rows, columns) float32, row 0 at the top
    julian_year: float | None  # when it was taken, if the file says so
    orientation: int = AS_STORED  # of EXIF, by which the rows of the file were turned
    velocity_i: np.ndarray | None = None  # (3,) m/s, of the camera relative to the Earth, likewise
    full: float | None = None  # largest grey value of a pixel of 8 or 16 bits; None of others


class Stored(NamedTuple):
    """A picture as a file holds it."""

    values: np.ndarray  # (rows, columns[, channels]), first row of the file first; of FITS the top one
    header: dict  # keyword -> text or number
    julian_year: float | None  # as of Picture
    orientation: int = AS_STORED  # of EXIF, 1 to 8; `values` are not turned


def read(path):
    """Picture of a file."""
    found = stored(path)
    turned = displayed(found.values, found.orientation)
    try:
        velocity_i = velocity_of(found.header)
    except ValueError as error:
        raise PictureError(f"{path}: {error}") from None
    full = full_of(found.values)
    return Picture(grey(turned, str(path)), found.julian_year, found.orientation, velocity_i, full)


def of_array(values):
    """Picture of an array (rows, columns[, channels]), whose row 0 is the top one."""
    return Picture(grey(values), None, full=full_of(values))


def full_of(values):
    """Largest grey value of the type of an array, None if it has none of 8 or 16 bits."""
    return float(np.iinfo(values.dtype).max) if values.dtype in (np.uint8, np.uint16) else None


def stored(path):
    """Stored of a file."""
    from pathlib import Path
    from warnings import catch_warnings, simplefilter

    from PIL import Image, UnidentifiedImageError

    path = Path(path)
    check_file(path)
    try:
        with catch_warnings():
            simplefilter("ignore")  # of odd metadata and of large pictures, which are bounded here
            with path.open("rb") as file:
                if file.read(len(FITS_MAGIC)) == FITS_MAGIC:
                    return _of_fits(path)
            with Image.open(path, formats=FORMATS) as image:
                return _decoded(path, image)
    except PictureError:
        raise
    except UnidentifiedImageError:
        raise PictureError(f"{path}: is not a picture that can be read; expected {READABLE}") from None
    except Image.DecompressionBombError:
        raise PictureError(
            f"{path}: has too many pixels; at most {MOST_PIXELS // 1_000_000} million"
        ) from None
    except Exception as error:  # decoders raise whatever they like (struct.error, zlib.error)
        if getattr(error, "errno", None) is not None:
            raise PictureError(f"{path}: cannot be read: {error.strerror}") from None
        raise PictureError(
            f"{path}: is cut off, damaged or of a kind that is not read; expected a whole picture: {READABLE}"
        ) from None


def check_file(path):
    """Refuse what is no file with something in it. pathlib.Path"""
    if not path.exists():
        raise PictureError(f"{path}: there is no such file")
    if path.is_dir():
        raise PictureError(f"{path}: is a folder; expected a picture")
    if what := irregular(path.stat()):
        raise PictureError(f"{path}: is {what}; expected a picture")
    if path.stat().st_size == 0:
        raise PictureError(f"{path}: is empty")


def raw(path, size_px, bits):
    """Grey values of a file without a header: row by row, 1 byte, or 2 of more bits, the low one first.

    size_px : (width, height) of the camera;  bits : of a grey value -> (rows, columns) uint8 or uint16
    """
    check_file(path)
    width, height = size_px
    kind = np.dtype("u1" if bits == 8 else "<u2")
    wanted, has = width * height * kind.itemsize, path.stat().st_size
    if has != wanted:
        raise PictureError(
            f"{path}: has {has} bytes; {width} x {height} pixels of {kind.itemsize} bytes, "
            f"as the camera has, are {wanted}"
        )
    return np.fromfile(path, kind).astype(kind.newbyteorder("="), copy=False).reshape(height, width)


def _of_fits(path):
    """Stored of a FITS file: its first picture, grey or of three planes, with the head of it.

    Its first row is the top one, unless ROWORDER says that it is the lowest (`BOTTOM-UP`).
    """
    from astropy.io import fits

    with path.open("rb") as file:
        try:
            fits_head.check(file)
        except fits_head.FitsError as error:
            raise PictureError(f"{path}: is no FITS picture that can be read: {error}") from None
    with fits.open(path, memmap=False) as parts:
        plane = next((one for one in parts if one.is_image and fits_head.is_picture(one.shape[::-1])), None)
        if plane is None:
            words = "expected one of two axes, or of one or three planes (red, green, blue); keep one plane"
            raise PictureError(f"{path}: holds no picture: {words}")
        _check_size(path, plane.header["NAXIS1"], plane.header["NAXIS2"])
        values, header = plane.data, dict(plane.header)
    if values.ndim == 3:
        values = values[0] if len(values) == 1 else np.moveaxis(values, 0, 2)
    if str(header.get(ROW_ORDER, "")).strip().upper() == LOWEST_FIRST:
        values = values[::-1]
    values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))
    return Stored(values, header, _year(header))


def _year(header):
    """Julian year of a header, None if it says none that can be read."""
    try:
        return year_of(header)
    except ValueError:
        return None


def _decoded(path, image):
    """Stored of an opened file."""
    frames = getattr(image, "n_frames", 1)
    if frames > 1:
        raise PictureError(f"{path}: holds {frames} pictures; expected one")
    _check_size(path, *image.size)
    turn = _orientation(image)
    values = deep.read(path, image)
    if values is None:
        image.load()
        values = np.asarray(_without_palette(image))
        if _orientation(image) != turn:  # Pillow turns a TIFF when it loads it, and forgets the number then
            values = as_stored(values, turn)
    header = {key: text for key, text in image.info.items() if isinstance(text, str)}
    return Stored(values, header, _year(header) or _julian_year(image), turn)


def _orientation(image):
    """Orientation of an opened file, 1 to 8."""
    number = image.getexif().get(EXIF_ORIENTATION)
    return number if number in range(1, 9) else AS_STORED


def _check_size(name, width, height):
    if min(width, height) < SMALLEST_PX or max(width, height) > LARGEST_PX or width * height > MOST_PIXELS:
        raise PictureError(
            f"{name}: has {width} x {height} pixels; expected sides of {SMALLEST_PX} to {LARGEST_PX} "
            f"and at most {MOST_PIXELS // 1_000_000} million pixels"
        )


def _without_palette(image):
    """The picture in a mode whose numbers are brightnesses."""
    if image.mode in ("L", "LA", "RGB", "RGBA", "I", "F") or image.mode.startswith("I;16"):
        return image
    return image.convert("L" if image.mode == "1" else "RGB")


def grey(values, name="image"):
    """Grey values of an array (rows, columns[, 1 to 4 channels]), float32; transparency is not looked at."""
    values = np.asarray(values)
    if values.dtype == bool:
        values = values.astype(np.uint8)
    if values.dtype.kind not in "uif" or values.ndim not in (2, 3):
        raise PictureError(
            f"{name}: expected numbers (rows, columns[, channels]), got {values.shape} {values.dtype}"
        )
    if values.ndim == 3 and values.shape[2] not in (1, 2, 3, 4):
        raise PictureError(f"{name}: expected 1 to 4 channels, got {values.shape[2]}")
    _check_size(name, values.shape[1], values.shape[0])
    given, whole = values, values.dtype.kind in "ui"
    if values.ndim == 3:
        values = _mean_of_colours(values) if values.shape[2] >= 3 else values[:, :, 0]
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused
        values = np.ascontiguousarray(values, dtype=np.float32)
    with np.errstate(invalid="ignore"):  # infinite values of either sign
        total = values.sum(dtype=np.float64)
    if not whole and not np.isfinite(total):
        largest = f"values beyond {np.finfo(np.float32).max:.2g}"
        what = largest if np.isfinite(given).all() else "NaN or infinite values"
        raise PictureError(f"{name}: contains {what}")
    return values


def _mean_of_colours(values):
    """Mean of the first three channels, (rows, columns) float32; `mean` over so short an axis is slow."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is infinite, of either sign, is refused later
        total = values[:, :, 0].astype(np.float32)
        for k in (1, 2):
            total += values[:, :, k]
    total /= 3.0
    return total


def _julian_year(image):
    """Julian year of the EXIF date, None without a usable one."""
    from datetime import datetime

    exif = image.getexif()
    text = exif.get_ifd(EXIF_BLOCK).get(EXIF_TAKEN)  # not when the file was changed
    try:
        when = datetime.strptime(str(text).strip("\0 "), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    year = julian_year(when)
    return year if 1900.0 < year < 2200.0 else None
