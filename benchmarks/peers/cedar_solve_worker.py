"""cedar-solve: the database of its package, field of view known to 0.3 deg, give up after 0.5 s.

Centroids are (y, x) from the corner of the top-left pixel; the answer is right ascension, declination and
roll, positive when north is counter-clockwise from up. It has no tracking.
"""

import logging

import numpy as np
from tetra3 import Tetra3
from worker import quat_from_dcm, serve


def prepare(view):
    logging.disable(logging.CRITICAL)
    solver = Tetra3()
    fov_deg = 2.0 * np.degrees(np.arctan(0.5 * view.width_px / view.focal_px))
    size = (view.height_px, view.width_px)

    def adapt(xy_px, predicted):
        return (np.ascontiguousarray(xy_px[:, ::-1] + 0.5),)

    def solve(yx):
        return solver.solve_from_centroids(
            yx, size, fov_estimate=fov_deg, fov_max_error=0.3, solve_timeout=500
        )

    def attitude(result):
        if result["RA"] is None:
            return None
        ra, dec, roll = np.radians([result["RA"], result["Dec"], result["Roll"]])
        east = np.array([-np.sin(ra), np.cos(ra), 0.0])
        north = np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
        right = -np.sin(roll) * north - np.cos(roll) * east
        down = -np.cos(roll) * north + np.sin(roll) * east
        return quat_from_dcm(np.array([right, down, np.cross(right, down)]))

    return adapt, solve, attitude


if __name__ == "__main__":
    serve(prepare)
