"""Where a picture points, in the angles of astronomers."""

import numpy as np


def marks(size_px):
    """Pixels that `angles` needs of a picture (width, height): (6, 2).

    The middle, one pixel above it, and the middles of the left, right, upper and lower edge.
    """
    (width, height), (cx, cy) = size_px, (0.5 * (size_px[0] - 1.0), 0.5 * (size_px[1] - 1.0))
    right, bottom = width - 0.5, height - 0.5
    return np.array([[cx, cy], [cx, cy - 1.0], [-0.5, cy], [right, cy], [cx, -0.5], [cx, bottom]])


def direction(u_i):
    """Right ascension and declination of a direction (3,) in the ICRS: 2 floats [deg]."""
    ra, dec = _ra_dec(u_i)
    return float(np.degrees(ra % (2.0 * np.pi))), float(np.degrees(dec))


def _ra_dec(u_i):
    """The same, rad."""
    return np.arctan2(u_i[1], u_i[0]), np.arcsin(np.clip(u_i[2], -1.0, 1.0))


def angles(u_i):
    """Right ascension and declination of the middle, position angle of up, fields of view across and down.

    u_i : (6, 3) directions of the `marks`, ICRS -> 5 floats [deg]; the position angle counts from north
    through east
    """
    centre, up = u_i[0], u_i[1]
    ra, dec = _ra_dec(centre)
    north = np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    roll = np.arctan2(up @ east, up @ north)
    fov = [2.0 * np.arcsin(0.5 * np.linalg.norm(u_i[k] - u_i[k + 1])) for k in (2, 4)]
    return tuple(float(np.degrees(v)) for v in (ra % (2.0 * np.pi), dec, roll % (2.0 * np.pi), *fov))
