"""The field of view of a star camera: its detector behind its lens."""

import math

WIDEST_DEG = 100.0  # from corner to corner. At 50 deg from the axis a pinhole draws distances 2.4 times as
# long as in the middle, and a real lens has 0.17 of the light there (cos^4), which is not simulated


def degrees(camera):
    """Width, height and diagonal of the field of view, deg: (3,) floats. camera : section star_camera"""
    chip, focal_length = camera.detector, camera.optics.focal_length
    if camera.optics.distortion is not None or camera.optics.principal_point is not None:
        from shefex_nav.scenario import lens

        return lens.field_deg(camera)
    sides = [0.5 * n * chip.pixel_size / focal_length for n in (chip.columns, chip.rows)]
    return tuple(math.degrees(2.0 * math.atan(one)) for one in (*sides, math.hypot(*sides)))
