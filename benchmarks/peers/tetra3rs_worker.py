"""tetra3rs: database of Gaia and Hipparcos stars for 14 to 18 deg, match_threshold 1e-3.

Its default threshold of 1e-5 solves fewer of these sparse fields, and neither accepted noise. Pixels count
from the principal point; the quaternion is ours: ICRS to camera, scalar first. With a prediction it tracks.
"""

import numpy as np
import tetra3rs
from worker import serve

HINT_DEG = 0.26  # three times the total error of a prediction that is 0.05 deg off per axis


def prepare(view):
    database = tetra3rs.SolverDatabase.generate_from_gaia(
        min_fov_deg=14.0, max_fov_deg=18.0, epoch_proper_motion_year=view.epoch
    )
    camera = tetra3rs.CameraModel(view.focal_px, view.width_px, view.height_px)

    def adapt(xy_px, predicted):
        return np.ascontiguousarray(xy_px - view.centre_px), predicted

    def solve(xy, predicted):
        hint = {} if predicted is None else {"attitude_hint": predicted, "hint_uncertainty_deg": HINT_DEG}
        return database.solve_from_centroids(
            xy,
            camera_model=camera,
            fov_max_error_deg=0.3,
            match_threshold=1e-3,
            solve_timeout_ms=500,
            **hint,
        )

    def attitude(result):
        return np.asarray(result.quaternion) if result else None

    return adapt, solve, attitude


if __name__ == "__main__":
    serve(prepare)
