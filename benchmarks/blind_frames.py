"""Clean frames of 1 Mpx, 8 to 30 deg across, nothing told: processor time of `solve_image`, and of tetra3rs.

Grey values to attitude: nothing is read or decoded. Each frame is solved --rounds times by each; the least of
them counts, so that a busy machine matters less. tetra3rs has a database for 8 to 30 deg and is told 15.5 deg
with an error of 14.5, which is that range; `solve_image` looks from 5 to 70 deg and for distortion besides.

    uv run python benchmarks/blind_frames.py [--seed 1] [--frames 40] [--rounds 7] [--peer-python PATH]
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pictures
from peers import run as peers

from shefex_nav.environment.stars import at_epoch, load_catalogue

ACROSS_DEG = (8.0, 30.0)
FAINTEST = (7.5, 6.0)  # V of a star that stands out ten times, at both
SIZE_PX, SIGMA_PX, NOISE, BACKGROUND = 1024, 1.0, 2.0, 60.0
YEAR = 2020.0  # a whole one tells no day: no aberration
WRONG = np.radians(0.05)
WORKER = "tetra3rs_blind_worker.py"


def frames(seed, n):
    """n of (image uint8, C_ci)."""
    rng, stars = np.random.default_rng(seed), at_epoch(load_catalogue(pictures.BEYOND), YEAR)
    for _ in range(n):
        across = np.exp(rng.uniform(*np.log(ACROSS_DEG)))
        lens = pictures.Lens("rectilinear", 0.5 * SIZE_PX / np.tan(np.radians(0.5 * across)), (0.0,) * 5)
        C_ci = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        C_ci *= np.linalg.det(C_ci)
        u_c = stars.u_i @ C_ci.T
        ahead = u_c[:, 2] > 0.8
        faintest = np.interp(across, ACROSS_DEG, FAINTEST)
        unit = 10.0 * NOISE * np.sqrt(4.0 * np.pi) * SIGMA_PX
        image = rng.normal(BACKGROUND, NOISE, (SIZE_PX, SIZE_PX))
        places = pictures.places(lens, u_c[ahead], (SIZE_PX, SIZE_PX))
        for (x, y), mag in zip(places, stars.vmag[ahead], strict=True):
            if -5.0 < x < SIZE_PX + 5.0 and -5.0 < y < SIZE_PX + 5.0:
                pictures.spot(image, x, y, unit * 10.0 ** (-0.4 * (mag - faintest)), SIGMA_PX, 0.0, 0.0)
        yield np.clip(np.rint(image), 0.0, 255.0).astype(np.uint8), C_ci


def ours(images, rounds):
    """C_ci (n, 3, 3), NaN where unsolved, and the least processor time (n,) [ms]."""
    from shefex_nav.geometry.rotation import dcm_from_quat
    from shefex_nav.solve.image import solve_image

    C_ci, ms = np.full((len(images), 3, 3), np.nan), np.full(len(images), np.inf)
    for turn in range(rounds + 1):  # the first makes tables
        for k, image in enumerate(images):
            begin = time.process_time()
            found = solve_image(image, epoch=YEAR)
            elapsed = 1e3 * (time.process_time() - begin)
            if found.status == "ok":
                C_ci[k] = dcm_from_quat(found.q_ci)
            ms[k] = min(ms[k], elapsed) if turn else np.inf
    return C_ci, ms


def theirs(python, images, rounds):
    """The same of tetra3rs, and its time of the centroids alone."""
    import os
    import subprocess

    from shefex_nav.geometry.rotation import dcm_from_quat

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "frames.npz"
        np.savez(file, images=np.array(images), across=ACROSS_DEG, epoch=YEAR, rounds=rounds)
        worker = Path(__file__).parent / "peers" / WORKER
        environ = {**os.environ, **peers.ONE_THREAD}
        environ.pop("PYTHONPATH", None)
        subprocess.run([str(python), str(worker), str(file)], check=True, env=environ)
        done = np.load(file.with_suffix(".out.npz"))
        C_ci = np.array([dcm_from_quat(q) for q in done["q_ci"]])
        return C_ci, done["ms"].sum(axis=1), done["ms"][:, 0]


def described(name, C_ci, ms, truth):
    """One line."""
    trace = np.einsum("nij,nij->n", C_ci, truth)
    off = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    solved = np.isfinite(trace)
    return (
        f"{name}: {solved.sum()} of {len(ms)} solved, {(off[solved] > WRONG).sum()} wrong, processor "
        f"{np.median(ms):.1f} ms in the median, {np.percentile(ms, 95):.1f} p95"
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--peer-python", help="Python with tetra3rs in the place of one that is made")
    given = parser.parse_args()
    images, truth = map(np.array, zip(*frames(given.seed, given.frames), strict=True))
    print(described("solve_image", *ours(images, given.rounds), truth), flush=True)
    try:
        say = lambda words: print(words, file=sys.stderr)  # noqa: E731
        python = given.peer_python or peers.environment(peers.PEERS["tetra3rs"], say)
    except peers.Unavailable as error:
        print(f"without tetra3rs: {error}", file=sys.stderr)
        return
    C_ci, ms, centroids_ms = theirs(python, images, given.rounds)
    print(described("tetra3rs", C_ci, ms, truth), f"(centroids {np.median(centroids_ms):.1f} ms)")


if __name__ == "__main__":
    main()
