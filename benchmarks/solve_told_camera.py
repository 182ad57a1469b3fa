"""Frames exported at full depth, solved again with the camera told: errors against the truth, and times.

Each flight is exported as `shefex-nav export --frames` does, with a detector of 12 bits, and its pictures are
read back and solved by `solve_image` with `camera_true.yaml`, the camera as it is in the run. NEES is that of
the attitude, of three degrees of freedom, against the mean attitude of the exposure; of so many independent
pictures, 99 % of the means are in the interval. With `camera.yaml`, the camera as calibrated, all pictures of
a run share the errors of its calibration, so one picture of each of many runs is taken. tetra3rs solves the
same pictures, if its environment can be made (`peers`) or is given. Times are CPU times of one process each,
one after the other, on pictures in memory: they are those of an idle machine on a busy one, too.

    uv run python benchmarks/solve_told_camera.py [--seeds 201 202] [--frames 40] [--runs 40]
        [--peer-python PATH]
"""

import argparse
import csv
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from peers import run as peers
from scipy.stats import chi2

from shefex_nav.frames import camera_file, export, flown
from shefex_nav.geometry.rotation import quat_conjugate, rotvec_between
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import Frame
from shefex_nav.scenario import load
from shefex_nav.solve import picture, told
from shefex_nav.solve.header import of_header
from shefex_nav.solve.image import solve_image

SHARE = 0.99
DEEP = (  # a detector of 12 bits whose full well is its greatest grey value
    "star_camera.detector.bits=12",
    "star_camera.detector.conversion=7.5 electron/DN",
    "star_camera.detector.black_level=60 DN",
    "star_tracker.exposure.gain=0 dB",
    "star_tracker.exposure.brightest_mean=1600 DN",
    "star_tracker.detection.saturation=4000 DN",
)
NO_MARGIN = ("star_tracker.centroid_floor=0 pix",)  # high_rate has one, for rates that change
FLIGHTS = (  # scenario, first and last frame [s]
    ("shefex2_andoya", 234.0, 385.0),
    ("orbit", 125.0, 725.0),
    ("high_rate", 2.0, 419.0),
    ("night_sky", 1.0, 60.0),
)
SIZES = {"default size": (), "1 Mpx": ("star_camera.detector.columns=1024", "star_camera.detector.rows=1024")}
BITS = {"8 bits": (), "12 bits": DEEP}
ROUNDS = 20  # of the pictures that are timed
PEER_WORKER = "tetra3rs_pictures_worker.py"


class Seen(NamedTuple):
    """A picture with its truth."""

    image: np.ndarray
    taken: object
    q_ic: np.ndarray  # mean of the exposure
    sigma_c: np.ndarray  # (3,) rad, of the star tracker on board; NaN without a fix
    rate: float  # deg/s


def exported(parent, name, overrides, seed, between_s, wanted):
    """Folder with about `wanted` frames of a flight, spread over its time."""
    folder = Path(tempfile.mkdtemp(dir=parent))
    flight = flown.of_scenario(load.load(name, overrides), seed)
    begin_s, end_s = between_s[0], min(between_s[1], flight.until_s)
    n = max(int((end_s - begin_s) * flight.scenario.star_tracker.rate), 1)
    shots = flown.shots(flight, None, begin_s, end_s, max(n // wanted, 1))
    for _ in export.write(folder, flight, shots, "png"):
        pass
    return folder


def read(folder):
    """list of Seen of an exported folder."""
    seen = []
    with (folder / export.TRUTH).open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            stored = picture.stored(folder / row["file"])

            def numbers(names, row=row):
                return np.array([float(row[name] or "nan") for name in names])

            omega_c = numbers([f"omega_c_{axis}_rad_s" for axis in "xyz"])
            seen.append(
                Seen(
                    stored.values,
                    of_header(stored.header),
                    numbers([f"q_ic_mean_{part}" for part in "wxyz"]),
                    numbers([f"fix_sigma_{axis}_rad" for axis in "xyz"]),
                    float(np.degrees(np.linalg.norm(omega_c))),
                )
            )
    return seen


def solved(seen, camera):
    """A row for each picture: NEES, three errors in sigmas, rate; NaN where there is no attitude."""
    rows = []
    for one in seen:
        found, row = solve_image(one.image, camera=camera, taken=one.taken), [np.nan] * 4
        if found.status == "ok":
            error = rotvec_between(quat_conjugate(found.q_ci), one.q_ic)
            P = found.covariance
            row = [error @ np.linalg.solve(P, error), *error / np.sqrt(np.diag(P))]
        rows.append([*row, one.rate])
    return np.array(rows, dtype=float)


def described(name, rows):
    """Figures of rows of `solved`, as JSON."""
    good = np.isfinite(rows[:, 0])
    n, nees, sigmas = int(good.sum()), rows[good, 0], np.abs(rows[good, 1:4])
    interval = chi2.ppf([0.5 - SHARE / 2, 0.5 + SHARE / 2], 3 * n) / n
    return json.dumps(
        {
            "case": name,
            "pictures": len(rows),
            "solved": n,
            "mean_nees": round(float(nees.mean()), 3),
            "interval": interval.round(3).tolist(),
            "mean_square_sigmas": (sigmas**2).mean(axis=0).round(3).tolist(),
            "largest_sigmas": sigmas.max(axis=0).round(2).tolist(),
            "fastest_deg_s": round(float(rows[good, 4].max()), 2),
        }
    )


def peer_on(folder, seen, camera, python):
    """What tetra3rs makes of pictures: q_ci (n, 4), sigma about and across the boresight, ms, both (n, 2)."""
    import subprocess

    hole = camera.params.camera.pinhole
    earth = [told.earth_velocity(round(one.taken.julian_year * told.MINUTES)) for one in seen]
    np.savez(
        folder / "case.npz",
        images=np.array([one.image for one in seen]),
        focal_px=hole.focal_length_px,
        centre_px=[hole.cx_px, hole.cy_px],
        epoch=seen[0].taken.julian_year,
        velocity=np.array([v + one.taken.velocity_i for v, one in zip(earth, seen, strict=True)]),
        saturation=camera.params.settings.detection.saturation,
    )
    worker = Path(__file__).parent / "peers" / PEER_WORKER
    subprocess.run(
        [python, worker, folder, "case.npz"], check=True, env=peers.ONE_THREAD, stdout=subprocess.DEVNULL
    )
    out = np.load(folder / "case.out.npz")
    return out["q_ci"], out["sigma"], out["ms"]


def peer_errors(seen, found):
    """Errors of the peer about and across the boresight in sigmas, its own and the log's together: (n, 2)."""
    rows = []
    for one, q_ci, sigma in zip(seen, found[0], found[1], strict=True):
        error = rotvec_between(quat_conjugate(q_ci), one.q_ic)
        about = abs(error[2]) / np.hypot(sigma[0], one.sigma_c[2])
        rows.append([about, np.hypot(*error[:2]) / np.hypot(sigma[1], np.hypot(*one.sigma_c[:2]))])
    return np.array(rows)


def median_ms(function, seen):
    """Median CPU time of a function of a Seen."""
    for one in seen:
        function(one)
    times = []
    for _ in range(ROUNDS):
        for one in seen:
            begin = time.process_time()
            function(one)
            times.append(1e3 * (time.process_time() - begin))
    return float(np.median(times))


def times(parent, seed, python):
    """Print the medians for each size and depth."""
    for size, larger in SIZES.items():
        for bits, deeper in BITS.items():
            folder = exported(parent, "night_sky", (*larger, *deeper), seed, (1.0, 3.0), 10)
            seen, camera = read(folder), camera_file.read(folder / export.TOLD)
            year = seen[0].taken.julian_year
            tracker = told.tracker_of(camera, round(year * 365.25))
            state, _ = star_tracker.start(tracker, 0.0)
            context = star_tracker.NO_CONTEXT._replace(velocity_i=seen[0].taken.velocity_i)

            def on_board(one, tracker=tracker, state=state, context=context):
                frame = Frame(0, 0.0, 0.0, 0.0, one.taken.exposure_s, 0.0, one.image)
                star_tracker.step(tracker, state, frame, context)

            ours = median_ms(lambda one, c=camera: solve_image(one.image, camera=c, taken=one.taken), seen)
            line = {
                "size": size,
                "depth": bits,
                "solve_image_ms": ours,
                "on_board_ms": median_ms(on_board, seen),
            }
            if python:
                ms = peer_on(folder, seen, camera, python)[2].sum(axis=1)
                line["tetra3rs_ms"] = float(np.median(ms))
            print(json.dumps({k: round(v, 2) if isinstance(v, float) else v for k, v in line.items()}))


def peer_python(given):
    """Path of a Python with tetra3rs; None and a line why, if there is none."""
    if given:
        return given
    try:
        return peers.environment(peers.PEERS["tetra3rs"], lambda words: print(words, file=sys.stderr))
    except peers.Unavailable as error:
        print(f"without tetra3rs: {error}", file=sys.stderr)
        return None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[201, 202, 203])
    parser.add_argument("--frames", type=int, default=40, help="of each flight")
    parser.add_argument("--runs", type=int, default=40, help="of which one picture is solved as calibrated")
    parser.add_argument("--peer-python", help="Python with tetra3rs in the place of one that is made")
    given = parser.parse_args()
    python, every, ratios = peer_python(given.peer_python), [], []
    with tempfile.TemporaryDirectory() as parent:
        for name, *between_s in FLIGHTS:
            rows = []
            for seed in given.seeds:
                folder = exported(parent, name, (*DEEP, *NO_MARGIN), seed, between_s, given.frames)
                seen, camera = read(folder), camera_file.read(folder / export.TRUE)
                rows.append(solved(seen, camera))
                if python:
                    fixed = [one for one in seen if np.isfinite(one.sigma_c[0])]
                    ratios.append(peer_errors(fixed, peer_on(folder, fixed, camera, python)))
            every += rows
            print(described(f"{name}, camera of the run", np.concatenate(rows)), flush=True)
        print(described("all, camera of the run", np.concatenate(every)))
        if python:
            found = np.concatenate(ratios)
            ok = np.isfinite(found[:, 0])
            largest = found[ok].max(axis=0).round(2)
            print(f"tetra3rs: {ok.sum()} of {len(found)}, errors about and across, in sigmas, to {largest}")
        single = []
        for k in range(given.runs):
            folder = exported(parent, "night_sky", DEEP, 10 * given.seeds[0] + k, (1.0, 1.2), 1)
            single.append(solved(read(folder)[:1], camera_file.read(folder / export.TOLD)))
        print(described("one picture a run, camera as calibrated", np.concatenate(single)), flush=True)
        times(parent, given.seeds[0], python)


if __name__ == "__main__":
    main()
