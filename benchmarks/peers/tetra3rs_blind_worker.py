"""tetra3rs on whole pictures of a field of view that is known to a range alone: for `blind_frames.py`.

    python WORKER.py FRAMES.npz     writes FRAMES.out.npz

In: images (n, rows, columns), across (narrowest, widest) deg, epoch (Julian year), rounds. Out: q_ci (n, 4),
scalar first, NaN where unsolved; ms (n, 2), the least processor time of centroids and attitude.
"""

import sys
import time
from pathlib import Path

import numpy as np
import tetra3rs


def main():
    path = Path(sys.argv[1])
    case = np.load(path)
    images, (narrow, wide) = case["images"], case["across"]
    middle = float(np.sqrt(narrow * wide))
    database = tetra3rs.SolverDatabase.generate_from_gaia(
        min_fov_deg=float(narrow), max_fov_deg=float(wide), epoch_proper_motion_year=float(case["epoch"])
    )
    q_ci, ms = np.full((len(images), 4), np.nan), np.full((len(images), 2), np.inf)
    for turn in range(int(case["rounds"]) + 1):
        for k, image in enumerate(images):
            begin = time.process_time()
            found = tetra3rs.extract_centroids(image, threads=1)
            between = time.process_time()
            result = database.solve_from_centroids(
                found.centroids,
                fov_estimate_deg=middle,
                fov_max_error_deg=float(max(wide - middle, middle - narrow)),
                image_shape=image.shape,
                solve_timeout_ms=2000,
            )
            elapsed = 1e3 * (between - begin), 1e3 * (time.process_time() - between)
            if result:
                q_ci[k] = np.asarray(result.quaternion)
            if turn:  # the first warms up
                ms[k] = np.minimum(ms[k], elapsed)
    np.savez(path.with_suffix(".out.npz"), q_ci=q_ci, ms=ms)


if __name__ == "__main__":
    main()
