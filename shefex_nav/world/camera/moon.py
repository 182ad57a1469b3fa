"""The Moon in the frame: where it is, and its light on the detector.

In: ephemeris, vehicle, how the camera looks during the frame. Out: mean electrons per pixel. A sphere lit by
the Sun, with a sharp edge, lit as a matt one (Lambert's). Its light as a whole is that of the Moon at its
phase: shadows on rough ground take 0.71 of it at half Moon.
"""

import math

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry.elementary import power
from shefex_nav.world.camera.optics import as_pinhole
from shefex_nav.world.camera.render import add, open_for

RADIUS = 1737.4e3  # m
LINEAR, FOURTH = 0.026, 4e-9  # mag/deg, mag/deg^4 fainter than full: Allen (1976)


def seen_from(bodies, r_i):
    """The Moon from the vehicle: direction (3,) and angular radius [rad].

    Not aberrated: it shares the Earth's velocity, and its light is only 1.3 s old.
    """
    toward_i = bodies.moon_r_i - r_i
    distance = np.sqrt(toward_i @ toward_i)
    return toward_i / distance, math.asin(RADIUS / distance)


def dimming(phase_angle):
    """Light of the Moon over that of a matt sphere which is as bright when it is full.

    By Allen's law, as in Krisciunas & Schaefer, PASP 103, 1033 (1991). From 168 deg on, near new Moon, where
    nobody has measured it, as bright as the sphere.

    phase_angle : rad, at the Moon between Sun and camera
    """
    alpha = min(max(phase_angle, 0.0), math.pi)
    degrees = math.degrees(alpha)
    share = float(power(10.0, -0.4 * (LINEAR * degrees + FOURTH * degrees**4)))
    sphere = (math.sin(alpha) + (math.pi - alpha) * math.cos(alpha)) / math.pi
    return min(1.0, share / max(sphere, 1e-12))


def add_moon(light, camera, path, moon_u_i, angular_radius, sun_u_i, electrons, lens=None):
    """Add the Moon, in place.

    Parameters
    ----------
    light, camera, path : as in `render.add_points`
    moon_u_i, sun_u_i : (3,) unit vectors
    angular_radius : float [rad]
    electrons : float, of the exposure of a row from a full Moon; the phase takes its part here
    lens : Lens, None of a pinhole; the disc stays round, and as bright as it is
    """
    radius_px = camera.focal_length_px * math.tan(angular_radius)
    # the mean of cos(incidence) over the disc of a fully lit sphere is 2/3
    per_px = 1.5 * electrons / (np.pi * radius_px**2)
    per_px *= dimming(math.acos(min(1.0, max(-1.0, -float(moon_u_i @ sun_u_i)))))
    C_ci = 0.5 * (path.C_ci[1:] + path.C_ci[:-1])  # in the middle of the steps
    moon_c = C_ci @ moon_u_i
    if lens is not None:
        moon_c, scales = as_pinhole(lens, moon_c)
        scale = float(scales.mean())
        radius_px, per_px = radius_px * scale, per_px / scale**2
    _moon_kernel(light, camera, path, moon_c, radius_px, C_ci @ sun_u_i, per_px)


@kernel
def _moon_kernel(light, camera, path, moon_c, radius_px, sun_c, electrons_per_px):
    """Add one disc for each step."""
    for k in range(moon_c.shape[0]):
        if moon_c[k, 2] <= 0.0:
            continue
        x = camera.cx_px + camera.focal_length_px * moon_c[k, 0] / moon_c[k, 2]
        y = camera.cy_px + camera.focal_length_px * moon_c[k, 1] / moon_c[k, 2]
        from_s = path.begin_s + k * path.step_s
        for row in range(max(0, int(y - radius_px)), min(camera.height_px, int(y + radius_px) + 2)):
            open_s = open_for(path.times, row, from_s, from_s + path.step_s)
            if open_s == 0.0:
                continue
            in_pixel = electrons_per_px * open_s / path.times.exposure_s
            for column in range(max(0, int(x - radius_px)), min(camera.width_px, int(x + radius_px) + 2)):
                a, b = (column - x) / radius_px, (row - y) / radius_px
                if a * a + b * b < 1.0:  # the visible half of the sphere faces the camera: -z
                    cos_incidence = (
                        a * sun_c[k, 0] + b * sun_c[k, 1] - np.sqrt(1.0 - a * a - b * b) * sun_c[k, 2]
                    )
                    if cos_incidence > 0.0:
                        add(light, row * camera.width_px + column, in_pixel * cos_incidence)
