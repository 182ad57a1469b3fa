"""ruststartracker: its Hipparcos catalogue to Hp 5.7, tolerance 2.5e-4 rad, give up after 0.5 s.

Its defaults (8e-4 rad, 10 stars) solve about half of these fields. Pixel (0, 0) is a centre; the quaternion
is scalar last and from the camera to ICRS. It has no tracking. PEER_MATCHES: stars it must match, 4 or 5.
"""

import os

import numpy as np
from ruststartracker import StarTracker, StarTrackerError
from ruststartracker.catalog import StarCatalog
from ruststartracker.star import CameraParameters
from worker import serve

HP_MINUS_V = 0.2  # mag; its magnitudes are Hp: with the same number as V it lacks red stars, and solves less


def prepare(view):
    stars = StarCatalog.from_hipparcos(max_magnitude=view.max_magnitude + HP_MINUS_V)
    cx, cy = view.centre_px
    matrix = np.array([[view.focal_px, 0.0, cx], [0.0, view.focal_px, cy], [0.0, 0.0, 1.0]], dtype=np.float32)
    tracker = StarTracker(
        stars.normalized_positions(epoch=view.epoch),
        stars.magnitude,
        CameraParameters(matrix, (view.width_px, view.height_px), None),
        inter_star_angle_tolerance=2.5e-4,
        n_minimum_matches=int(os.environ["PEER_MATCHES"]),
        timeout_secs=0.5,
    )

    def adapt(xy_px, predicted):
        return (np.ascontiguousarray(xy_px, dtype=np.float32),)

    def solve(xy):
        try:
            return tracker.process_image_coordiantes(xy)
        except StarTrackerError:
            return None

    def attitude(result):
        if result is None:
            return None
        x, y, z, w = np.asarray(result.quat, dtype=float)
        return np.array([w, -x, -y, -z])

    return adapt, solve, attitude


if __name__ == "__main__":
    serve(prepare)
