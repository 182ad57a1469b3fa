"""What users give of a frame: numbers and arrays of our own, or a ValueError that says what is wrong."""

import numpy as np

from shefex_nav.geometry.rotation import quat_conjugate
from shefex_nav.solve.camera import floats, numbers

FLOAT = np.dtype(np.float64)
COMPLEX = (np.dtype(np.complex64), np.dtype(np.complex128))


def places(xy_px):
    """Centroids as an array of our own: one layout, one compilation. -> (n, 2)."""
    if is_ours(xy_px) and xy_px.ndim == 2 and xy_px.shape[1] == 2:
        return xy_px
    real("xy_px", xy_px)
    array = floats("xy_px", xy_px, "(n, 2)")
    if array.size == 0 and array.ndim <= 2:
        return np.zeros((0, 2))
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"xy_px: expected shape (n, 2), got {array.shape}")
    return array


def fluxes(flux, n):
    """Brightness of the n centroids, likewise."""
    if is_ours(flux) and flux.shape == (n,):
        return flux
    real("flux", flux)
    array = floats("flux", flux, (n,))
    if array.shape != (n,):
        raise ValueError(f"flux: expected shape ({n},), got {array.shape}")
    return array


def is_ours(values):
    """Whether these are an array as the kernels are compiled for. They do not write into it."""
    return type(values) is np.ndarray and values.dtype is FLOAT and values.flags.carray


def real(name, values):
    """Refuse what a conversion to numbers would silently cut off."""
    if isinstance(values, np.ma.MaskedArray) or getattr(values, "dtype", None) in COMPLEX:
        raise ValueError(f"{name}: expected real numbers, none masked, got {type(values).__name__}")


def number(name, value):
    """A float, or a ValueError that says what is wrong."""
    if isinstance(value, str | bytes | bool | complex) or np.ndim(value):
        raise ValueError(f"{name}: expected a number, got {value!r}")
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected a number, got {value!r}") from None


def prediction(said):
    """(True, q_ic, P), as the identification takes it, of a checked (q_ci, P)."""
    try:
        q_ci, P = said
    except (TypeError, ValueError):
        raise ValueError("prediction: expected (q_ci, covariance)") from None
    q_ci, P = numbers("prediction q_ci", q_ci, (4,)), numbers("prediction covariance", P, (3, 3))
    norm = np.linalg.norm(q_ci)
    if not 0.9 < norm < 1.1:
        raise ValueError(f"prediction q_ci: expected a unit quaternion, got norm {norm:.3g}")
    if np.linalg.eigvalsh(0.5 * (P + P.T))[0] <= 0.0:
        raise ValueError("prediction covariance: expected a positive definite matrix")
    return True, quat_conjugate(q_ci / norm), np.ascontiguousarray(0.5 * (P + P.T))
