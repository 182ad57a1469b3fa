"""The camera of the public functions: a pinhole with or without distortion."""

from dataclasses import dataclass
from math import isfinite
from numbers import Real

import numpy as np

from shefex_nav.geometry.distortion import undistort, undone_to_px
from shefex_nav.geometry.pinhole import Pinhole

UNDONE_PX = 0.1  # [E] by which a distortion there and back may be off


@dataclass(frozen=True)
class Camera:
    """A camera. Pixel (0, 0) is the centre of the top-left pixel, x right, y down, z along the boresight.

    principal_point_px: (x, y), by default the middle of the detector. distortion: None or
    (k1, k2, p1, p2, k3) of Brown and Conrady in the order of OpenCV, from the ideal to the distorted image.
    """

    width_px: int
    height_px: int
    focal_length_px: float
    principal_point_px: tuple | None = None
    distortion: tuple | None = None

    def __post_init__(self):
        for name in ("width_px", "height_px", "focal_length_px"):
            value = getattr(self, name)
            if not (isinstance(value, Real) and isfinite(value) and value > 0):
                raise ValueError(f"Camera.{name}: expected a positive number, got {value!r}")
        if self.principal_point_px is None:
            centre = (0.5 * (self.width_px - 1), 0.5 * (self.height_px - 1))
        else:
            centre = numbers("Camera.principal_point_px", self.principal_point_px, (2,))
        object.__setattr__(self, "principal_point_px", tuple(float(v) for v in centre))
        if self.distortion is not None:
            values = numbers("Camera.distortion", self.distortion, (5,))
            object.__setattr__(self, "distortion", tuple(float(v) for v in values))


def of_pinhole(hole, k):
    """Camera of a Pinhole and its distortion, array (5,) or None."""
    k = None if k is None else tuple(k.tolist())
    return Camera(hole.width_px, hole.height_px, hole.focal_length_px, (hole.cx_px, hole.cy_px), k)


def pinhole_of(camera):
    """Pinhole of a Camera, without its distortion."""
    return Pinhole(
        camera.width_px, camera.height_px, float(camera.focal_length_px), *camera.principal_point_px
    )


def check_lens(camera):
    """ValueError where the distortion of a Camera is none of a lens on its detector."""
    if camera.distortion is None:
        return
    if not undone_to_px(pinhole_of(camera), np.array(camera.distortion)) < UNDONE_PX:
        words = "expected one that can be undone everywhere on the detector"
        raise ValueError(
            f"Camera.distortion: {words}; {camera.distortion} folds the picture over, or is too strong"
        )


def undistorted(camera, xy_px):
    """Pixels of `pinhole_of` a Camera from those of the Camera. (n, 2) -> (n, 2), float"""
    xy_px = np.ascontiguousarray(xy_px, dtype=float)
    if camera.distortion is None:
        return xy_px
    return undistort(pinhole_of(camera), np.array(camera.distortion), xy_px)


def floats(name, value, shape):
    """A copy as an array: one layout, one compilation. shape : in words, for the ValueError if it is none"""
    try:
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers of shape {shape}, got {value!r}") from None


def numbers(name, value, shape):
    """Finite float array of a shape, where None is any length; or a ValueError that says what is wrong."""
    array = floats(name, value, shape)
    fits = array.ndim == len(shape) and all(
        wanted in (None, has) for wanted, has in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name}: expected shape {str(shape).replace('None', 'n')}, got {array.shape}")
    if not isfinite(array.sum()):  # one NaN or infinity is enough
        raise ValueError(f"{name}: contains NaN or infinite values")
    return array
