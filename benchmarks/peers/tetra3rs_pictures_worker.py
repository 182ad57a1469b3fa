"""tetra3rs on whole pictures: its centroids, its attitude, the velocity of the camera told.

    python WORKER.py FOLDER CASE.npz ...     reads FOLDER/CASE.npz, writes FOLDER/CASE.out.npz

A case has images (n, rows, columns), focal_px, centre_px (2,) with the centre of the top-left pixel at 0,
epoch (Julian year), velocity (n, 3) [m/s] relative to the barycentre and saturation. What comes out: q_ci
(n, 4), scalar first, NaN where unsolved; sigma (n, 2) [rad] about the boresight and across it, by its own
account; ms (n, 2) of CPU time of centroids and attitude.
"""

import sys
import time
from pathlib import Path

import numpy as np
import tetra3rs

WARM_UP = 3


def solve(database, camera, image, velocity, saturation):
    """(result or None, ms of CPU time of both steps)."""
    begin = time.process_time()
    found = tetra3rs.extract_centroids(image, saturation_level=saturation, threads=1)
    middle = time.process_time()
    result = database.solve_from_centroids(
        found.centroids,
        camera_model=camera,
        match_threshold=1e-3,
        solve_timeout_ms=1000,
        observer_velocity_km_s=(velocity / 1e3).tolist(),
    )
    end = time.process_time()
    return result or None, (1e3 * (middle - begin), 1e3 * (end - middle))


def main():
    folder = Path(sys.argv[1])
    for name in sys.argv[2:]:
        case = np.load(folder / name)
        images = case["images"]
        rows, columns = images.shape[1:]
        focal = float(case["focal_px"])
        wide = 2.0 * np.degrees(np.arctan(0.5 * columns / focal))
        database = tetra3rs.SolverDatabase.generate_from_gaia(
            min_fov_deg=0.9 * wide, max_fov_deg=1.1 * wide, epoch_proper_motion_year=float(case["epoch"])
        )
        offset = case["centre_px"] - 0.5 * (np.array([columns, rows]) - 1.0)
        camera = tetra3rs.CameraModel(focal, columns, rows, crpix=offset.tolist())
        q_ci, sigma = np.full((len(images), 4), np.nan), np.full((len(images), 2), np.nan)
        ms, saturation = np.zeros((len(images), 2)), float(case["saturation"])
        for image, velocity in list(zip(images, case["velocity"], strict=True))[:WARM_UP]:
            solve(database, camera, image, velocity, saturation)
        for k, (image, velocity) in enumerate(zip(images, case["velocity"], strict=True)):
            result, ms[k] = solve(database, camera, image, velocity, saturation)
            if result is not None:
                q_ci[k] = np.asarray(result.quaternion)
                theta, xi, eta = result.attitude_sigma_rad
                sigma[k] = theta, np.hypot(xi, eta)
        np.savez(folder / name.replace(".npz", ".out.npz"), q_ci=q_ci, sigma=sigma, ms=ms)
        print(name, flush=True)


if __name__ == "__main__":
    main()
