"""What the workers of all peers share: fields from a file, one timed call a field, results to a file.

A worker is a script that runs in the environment of its peer and has NumPy and the peer only.

    python WORKER.py FOLDER CASE.npz ...     reads FOLDER/CASE.npz, writes FOLDER/CASE.out.npz
"""

import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

WARM_UP = 20  # calls before the clock counts


class View(NamedTuple):
    """The camera as a worker is told."""

    width_px: int
    height_px: int
    focal_px: float
    centre_px: np.ndarray  # (2,) principal point; pixel (0, 0) is the centre of the top-left pixel
    epoch: float  # Julian year
    max_magnitude: float  # V


def read_fields(path):
    """View and a list of (xy_px brightest first, q_ci predicted or None), written by `run.write_fields`."""
    data = np.load(path)
    view = View(
        int(data["width_px"]),
        int(data["height_px"]),
        float(data["focal_px"]),
        data["centre_px"],
        float(data["epoch"]),
        float(data["max_magnitude"]),
    )
    places = np.split(data["xy_px"], data["start"][1:-1])
    predictions = data["predicted"] if len(data["predicted"]) else [None] * len(places)
    return view, list(zip(places, predictions, strict=True))


def serve(prepare):
    """Run `prepare(view) -> (adapt, solve, attitude)` over the files named on the command line.

    adapt(xy_px, predicted) makes the arguments of the peer, solve(*arguments) is its call and the only part
    that is timed, attitude(result) is q_ci (4,), scalar first, or None.
    """
    folder, ready = Path(sys.argv[1]), None
    for name in sys.argv[2:]:
        view, fields = read_fields(folder / name)
        if ready is None:
            ready = prepare(view)
            for xy_px, predicted in fields[:WARM_UP]:
                ready[1](*ready[0](xy_px, predicted))
        adapt, solve, attitude = ready
        q_ci, elapsed_ms = np.full((len(fields), 4), np.nan), np.zeros(len(fields))
        for k, (xy_px, predicted) in enumerate(fields):
            arguments = adapt(xy_px, predicted)
            begin = time.process_time()
            result = solve(*arguments)
            elapsed_ms[k] = 1e3 * (time.process_time() - begin)
            found = attitude(result)
            if found is not None:
                q_ci[k] = found
        np.savez(folder / name.replace(".npz", ".out.npz"), q_ci=q_ci, ms=elapsed_ms)
        print(name, flush=True)


def quat_from_dcm(C):
    """Unit quaternion, scalar first, of a rotation matrix: first eigenvector of K (Bar-Itzhack, 2000)."""
    K = np.array(
        [
            [C[0, 0] + C[1, 1] + C[2, 2], C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]],
            [C[2, 1] - C[1, 2], C[0, 0] - C[1, 1] - C[2, 2], C[0, 1] + C[1, 0], C[0, 2] + C[2, 0]],
            [C[0, 2] - C[2, 0], C[0, 1] + C[1, 0], C[1, 1] - C[0, 0] - C[2, 2], C[1, 2] + C[2, 1]],
            [C[1, 0] - C[0, 1], C[0, 2] + C[2, 0], C[1, 2] + C[2, 1], C[2, 2] - C[0, 0] - C[1, 1]],
        ]
    )
    return np.linalg.eigh(K)[1][:, -1]
