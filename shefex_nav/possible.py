"""What the numbers of a record can be, by their fields: members of a list, ranges, covariances, rotations.

Everything that the program writes lies within; what does not has been written by somebody else. Of NaN, which
is what is not known, nothing is said here. Nor is anything of readings of instruments, whose fields may have
the same names and be something else.
"""

import math
from enum import EnumMeta
from functools import cache, partial
from math import inf, pi

import numpy as np

from shefex_nav.fields import UNIT

LARGEST_OTHER = 1e30  # of a number that may be NaN; what is computed of it is a number yet
LONGEST_S = 1e6  # from the first to the last time of a topic
LEAST_EIGENVALUE = 1e-15  # of correlations: less is rounding
SAME = 1e-6  # of the product of two sigmas, by which a covariance may be off
COVARIANCES = "P", "P_c", "R_r_e", "R_v_e", "P_theta_b"
DIVIDED = "P", "P_c"  # of these, by which errors are divided
ROTATIONS = "C_iq", "C_re", "C_bc"
RANGES = {  # attribute of the program's records: least, most
    "launch_latitude": (-pi / 2.0, pi / 2.0),
    "launch_longitude": (-2.0 * pi, 2.0 * pi),
    "launch_height": (-1e5, 1e9),
    "width_px": (1, 100_000),
    "height_px": (1, 100_000),
    "focal_length_px": (1e-3, 1e9),
    "bits": (1, 16),
    "dt_s": (1e-6, 100.0),
    "exposure_s": (0.0, 1e4),
    "line_s": (0.0, 1e3),
    "n_satellites": (-1, 1000),  # -1: recorded data say a number that there cannot be
    "pdop": (0.0, inf),
    "chain_s": (0.0, 1e6),
    "wall_s": (0.0, 1e9),
    "dof": (0, 1_000_000),
    "nis": (0.0, inf),
}
EARTH_RATE = 1e-3  # rad/s, at most


@cache
def rule(field):
    """What a field cannot be: (function of its values (N, n) -> (N,) bool, words); None: anything.

    field : fields.Field
    """
    name = field.source.rpartition(".")[2]
    if isinstance(field.kind, EnumMeta):
        members = [int(one) for one in field.kind]
        return partial(_no_member, members), f"one of {min(members)} to {max(members)}"
    if name in DIVIDED:
        return _not_definite, "a covariance"
    if name in COVARIANCES:
        return _no_covariance, "a covariance"
    if name in ROTATIONS:
        return _no_rotation, "a rotation"
    if field.source == "earth.rate":
        return partial(_outside, -EARTH_RATE, EARTH_RATE), f"at most {EARTH_RATE:g} rad/s"
    if name.startswith("sigma"):
        return partial(_outside, 0.0, inf), "none below 0"
    if name.startswith("protection"):
        return lambda values: (values <= 0.0).any(axis=1), "all above 0"
    if name in RANGES:
        least, most = RANGES[name]
        words = f"at least {least:g}" if most == inf else f"{least:.10g} to {most:.10g}"
        return partial(_outside, least, most), words
    return None


def _no_member(members, values):
    return (values[:, :, None] != members).all(axis=2).any(axis=1)


def _outside(least, most, values):
    return ((values < least) | (values > most)).any(axis=1)


def _no_rotation(values):
    C = values.reshape(-1, 3, 3)
    off = np.abs(np.einsum("kij,kil->kjl", C, C) - np.eye(3)).max(axis=(1, 2))
    return ~(off < UNIT) | ~(np.linalg.det(C) > 0.0)


def _not_definite(values):
    """Records whose matrix (N, n n) is no covariance, or one that is singular; NaN says nothing."""
    bad = _no_covariance(values)
    told = np.flatnonzero(~bad & np.isfinite(values).all(axis=1))
    n = math.isqrt(values.shape[1])
    P = values[told].reshape(-1, n, n)
    sigma = np.sqrt(np.einsum("kii->ki", P))
    sigma[sigma == 0.0] = 1.0  # then the row is zero, and so is a pivot
    correlations = P / (sigma[:, :, None] * sigma[:, None, :])
    try:
        np.linalg.cholesky(correlations)
    except np.linalg.LinAlgError:  # at least one
        bad[told] = np.linalg.eigvalsh(correlations)[:, 0] <= LEAST_EIGENVALUE
    return bad


def _no_covariance(values):
    """Records whose matrix (N, n n) has a negative variance, or correlations beyond 1."""
    n = math.isqrt(values.shape[1])
    P = values.reshape(-1, n, n)
    variances = np.einsum("kii->ki", P)
    sigma = np.sqrt(np.abs(variances))
    most = sigma[:, :, None] * sigma[:, None, :]
    slack = SAME * most
    bad = (np.abs(P) > most + slack) | (np.abs(P - np.swapaxes(P, 1, 2)) > slack)
    return (variances < 0.0).any(axis=1) | bad.any(axis=(1, 2))
