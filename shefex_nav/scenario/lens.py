"""The lens of a star camera as a scenario says it: what it sees, does it fold, how far does it displace.

What is told in the place of the truth leaves a residual. A part of it is a turn of the picture, which no star
tracker can tell from an attitude; the rest shows in the residuals of the stars.
"""

import math
from typing import NamedTuple

import numpy as np

WIDEST_DEG = 100.0  # from corner to corner. At 50 deg from the axis a pinhole draws distances 2.4 times as
# long as in the middle, and a real lens has 0.17 of the light there (cos^4), which is not simulated
INVERSE_PX = 0.01  # to which the distortion must be undone
LEAST_PX = 1e-3  # less is not said: a hundredth of what a centroid is known to
LEAST_ARCSEC = 1e-3
OFF_AXIS = 0.1  # of the detector's size; lenses sit within a few hundredths
TOO_STRONG = "is too strong: what parts of the detector see cannot be told; use smaller coefficients"


class Left(NamedTuple):
    """What a calibration leaves over the detector, for stars that are spread evenly."""

    largest_px: float  # distance of a star from where it is expected
    turn: tuple  # (3,) rad, dtheta_c: q_ic(true) = q_ic(fix) exp(turn), the attitude that fits the stars best
    rest_px: float  # rms distance that is left by that attitude
    worst_px: float  # its largest


def pinhole_of(star_camera):
    """Pinhole of a section star_camera, of which it needs optics and detector."""
    from shefex_nav.geometry.pinhole import pinhole

    optics, detector = star_camera.optics, star_camera.detector
    focal_px = optics.focal_length / detector.pixel_size
    return pinhole(detector.columns, detector.rows, focal_px, optics.principal_point)


def distortion_of(star_camera):
    """Distortion (5,) of the same, None of a pinhole."""
    k = star_camera.optics.distortion
    return None if k is None or not any(k) else np.array(k, dtype=float)


def ideal(star_camera, xy_px):
    """X/Z, Y/Z of places on the detector of a section star_camera. (n, 2) px -> (n, 2)"""
    from shefex_nav.geometry import distortion

    hole, k = pinhole_of(star_camera), distortion_of(star_camera)
    return distortion.ideal_of(hole, xy_px if k is None else distortion.undistort(hole, k, xy_px))


def field_deg(star_camera):
    """Width, height and diagonal of the field of view, deg: the angles between what opposite points see."""
    hole = pinhole_of(star_camera)
    right, bottom = hole.width_px - 0.5, hole.height_px - 0.5
    x, y = 0.5 * (right - 0.5), 0.5 * (bottom - 0.5)
    ends = [(-0.5, y), (right, y), (x, -0.5), (x, bottom), (-0.5, -0.5), (right, bottom)]
    rays = np.column_stack([ideal(star_camera, np.array(ends)), np.ones(6)])
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    sine = np.linalg.norm(np.cross(rays[::2], rays[1::2]), axis=1)
    return tuple(np.degrees(np.arctan2(sine, (rays[::2] * rays[1::2]).sum(axis=1))).tolist())


def displaced_px(star_camera):
    """Largest displacement by the distortion, from where a pinhole puts a star, of a section star_camera."""
    from shefex_nav.geometry import distortion

    return distortion.displaced_px(pinhole_of(star_camera), distortion_of(star_camera))


def _same(true, told):
    """Whether two sections mean one lens, in whatever words: a middle that is written is the middle."""
    k, other = distortion_of(true), distortion_of(told)
    if k is None or other is None:
        alike = k is other
    else:
        alike = np.array_equal(k, other)
    return alike and pinhole_of(true) == pinhole_of(told)


def left(true, told):
    """Left of two sections star_camera of one detector; None where both have the same lens."""
    if _same(true, told):
        return None
    from shefex_nav.geometry.distortion import grid_px
    from shefex_nav.geometry.pinhole import turn_slopes

    focal_px = pinhole_of(told).focal_length_px
    xy_px = grid_px(pinhole_of(true))
    is_at = ideal(true, xy_px)
    off_px = focal_px * (ideal(told, xy_px) - is_at)
    G = focal_px * np.stack([np.stack(by, axis=-1) for by in turn_slopes(*is_at.T)], axis=1)  # (n, 2, 3)
    # a fix that is turned by it sees the stars where the calibration takes them to be
    turn = np.linalg.lstsq(G.reshape(-1, 3), off_px.ravel(), rcond=None)[0]
    rest = np.hypot(*(off_px - G @ turn).T)
    return Left(
        float(np.hypot(*off_px.T).max()),
        tuple((-turn).tolist()),
        float(np.sqrt((rest**2).mean())),
        float(rest.max()),
    )


def displaces(true):
    """What the distortion of a section star_camera does, as a line; None of none."""
    if (largest := displaced_px(true)) < LEAST_PX:
        return None
    return f"star_camera.optics.distortion: displaces stars by up to {largest:.3g} pixels"


def words(true, told):
    """What a calibration leaves of a lens: (path of the section, text); None of a right one."""
    if (found := left(true, told)) is None or found.largest_px < LEAST_PX:
        return None
    angle = math.degrees(math.hypot(*found.turn)) * 3600.0
    rest = f"{found.rest_px:.2g} pixels rms of it, {found.worst_px:.2g} at most"
    if angle < LEAST_ARCSEC:
        fit = "no attitude fits them better, which leaves " + rest
    elif found.worst_px < LEAST_PX:
        fit = f"an attitude off by {angle:.3g} arcsec leaves nothing of it"
    else:
        fit = f"an attitude off by {angle:.3g} arcsec leaves {rest}"
    said = f"stars are up to {found.largest_px:.3g} pixels from where they are expected; {fit}"
    return ("navigation", "told", "star_camera", "optics"), said


def off_axis(star_camera):
    """Words for a principal point of another resolution, or with column and row exchanged; None of others."""
    hole = pinhole_of(star_camera)
    size = hole.width_px, hole.height_px
    off = [at - 0.5 * (n - 1) for at, n in zip((hole.cx_px, hole.cy_px), size, strict=True)]
    if max(abs(one) / n for one, n in zip(off, size, strict=True)) <= OFF_AXIS:
        return None
    return (
        f"the axis of the lens is {off[0]:+.0f} columns and {off[1]:+.0f} rows from the middle of the "
        f"{size[0]} x {size[1]} detector; is it [column, row], and of this resolution?"
    )


def fault(star_camera):
    """Words for a distortion that is none of a lens on its detector; None of a good one."""
    k = distortion_of(star_camera)
    if k is None:
        return None
    from shefex_nav.geometry import distortion
    from shefex_nav.geometry.edges import is_lens

    hole = pinhole_of(star_camera)
    corners = distortion.corners_px(hole)
    half = np.abs(corners - [hole.cx_px, hole.cy_px]).max(axis=0)
    if not is_lens(float(hole.focal_length_px), k, tuple((2.0 * half).tolist())):
        r_px = hole.focal_length_px * _folds_at(k, half / hole.focal_length_px)
        corner_px = math.hypot(*half)
        if r_px <= corner_px:
            return (
                f"folds the picture over: it ends {r_px:.4g} pixels from the optical axis, where "
                f"distances begin to shrink again; a corner of the detector is {corner_px:.4g} "
                "pixels away. Use smaller coefficients"
            )
        return TOO_STRONG
    return None if distortion.undone_to_px(hole, k) < INVERSE_PX else TOO_STRONG


def _folds_at(k, half):
    """Distance from the axis over f at which the picture ends, towards the corners of (2,); the least."""
    from shefex_nav.geometry.distortion import bent, slopes

    r = np.linspace(0.0, 3.0, 3001)[1:, None]
    least = math.inf
    for side in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        ray = half * side / np.hypot(*half)
        folds = np.linalg.det(slopes(k, r * ray)) <= 0.0
        if folds.any():
            least = min(least, float(np.hypot(*bent(k, (r * ray)[[np.argmax(folds)]])[0])))
    return least


def field_of_view_deg(camera):
    """Width, height and diagonal of the field of view, deg: (3,) floats. camera : section star_camera"""
    chip, focal_length = camera.detector, camera.optics.focal_length
    if camera.optics.distortion is not None or camera.optics.principal_point is not None:
        pass

        return field_deg(camera)
    sides = [0.5 * n * chip.pixel_size / focal_length for n in (chip.columns, chip.rows)]
    return tuple(math.degrees(2.0 * math.atan(one)) for one in (*sides, math.hypot(*sides)))
