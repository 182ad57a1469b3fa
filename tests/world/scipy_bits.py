"""Filters of ours that replace SciPy's, whose import takes a second, give the same numbers."""

import platform

import numpy as np

FUSES = platform.machine() not in ("x86_64", "AMD64")  # SciPy's own code there multiplies and adds in one


def assert_as_scipy(found, expected):
    """To the last bit, where SciPy rounds each operation, as ours do everywhere."""
    if FUSES:
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)
    else:
        np.testing.assert_array_equal(found, expected)
