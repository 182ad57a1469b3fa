"""Picture files: grey values as they are, and when they were taken.

In: PNG, JPEG, TIFF or what else Pillow reads, 8 or 16 bits, grey or colour. Out: grey values as float32. A
file that is no single still picture of a usable size is refused with a PictureError.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.solve import deep

SMALLEST_PX, LARGEST_PX = 64, 20_000  # of a side
MOST_PIXELS = 150_000_000
EXIF_TAKEN, EXIF_CHANGED, EXIF_BLOCK = 36867, 306, 34665  # DateTimeOriginal, DateTime, the block of the first


class PictureError(UserError, ValueError):
    """A picture that cannot be read; the message names the file and what is wrong."""


class Picture(NamedTuple):
    """A picture in grey."""

    grey: np.ndarray  # (rows, columns) float32, row 0 at the top
    julian_year: float | None  # when it was taken, if the file says so


def read(path):
    """Picture of a file."""
    from pathlib import Path
    from warnings import catch_warnings, simplefilter

    from PIL import Image, UnidentifiedImageError

    path = Path(path)
    if not path.exists():
        raise PictureError(f"{path}: there is no such file")
    if path.is_dir():
        raise PictureError(f"{path}: is a folder; expected a picture")
    try:
        if path.stat().st_size == 0:
            raise PictureError(f"{path}: is empty")
        with catch_warnings():
            simplefilter("ignore")  # of odd metadata and of large pictures, which are bounded here
            with Image.open(path) as image:
                return _decoded(path, image)
    except PictureError:
        raise
    except UnidentifiedImageError:
        raise PictureError(f"{path}: is not a picture that can be read; expected PNG, JPEG or TIFF") from None
    except Image.DecompressionBombError:
        raise PictureError(
            f"{path}: has too many pixels; at most {MOST_PIXELS // 1_000_000} million"
        ) from None
    except Exception as error:  # decoders raise whatever they like (struct.error, zlib.error)
        raise PictureError(
            f"{path}: is damaged or of an unknown kind ({type(error).__name__}: {error})"
        ) from None


def _decoded(path, image):
    """Picture of an opened file."""
    frames = getattr(image, "n_frames", 1)
    if frames > 1:
        raise PictureError(f"{path}: holds {frames} pictures; expected one")
    _check_size(path, *image.size)
    values = deep.read(path, image)
    if values is None:
        image.load()
        values = np.asarray(_without_palette(image))
    return Picture(grey(values, str(path)), _julian_year(image))


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
    if values.ndim == 3:
        colours = 3 if values.shape[2] >= 3 else 1
        values = values[:, :, :colours].mean(axis=2, dtype=np.float32)
    values = np.ascontiguousarray(values, dtype=np.float32)
    if not np.isfinite(values.sum(dtype=np.float64)):
        raise PictureError(f"{name}: contains NaN or infinite values")
    return values


def _julian_year(image):
    """Julian year of the EXIF date, None without a usable one. Its orientation is not applied."""
    from datetime import datetime

    exif = image.getexif()
    text = exif.get_ifd(EXIF_BLOCK).get(EXIF_TAKEN) or exif.get(EXIF_CHANGED)
    try:
        taken = datetime.strptime(str(text).strip("\0 "), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    year = julian_year(taken)
    return year if 1900.0 < year < 2200.0 else None


def julian_year(moment):
    """Decimal Julian year of a datetime without time zone: 2000.0 is 2000-01-01 12:00."""
    from datetime import datetime

    return 2000.0 + (moment - datetime(2000, 1, 1, 12)).total_seconds() / (365.25 * 86400.0)
