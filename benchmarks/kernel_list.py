"""Writes shefex_nav/compiled/entries.json: the kernels that Python calls, and which jobs need them.

    uv run python benchmarks/kernel_list.py            # all jobs of JOBS, a few minutes with warm kernels
    uv run python benchmarks/kernel_list.py --check    # write nothing; exit code 1 if the list would change

Every job is a command as a user would give it. A job has features: its command, and every choice that its
scenario makes in words ("navigation.gps=tight"). A kernel needs the fewest features that tell the jobs of a
command which used it from those that did not.

To be run when a kernel that Python calls is new, or has other arguments. Without that the program works all
the same, and compiles such a kernel when it is called, in one process.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from shefex_nav import runs
from shefex_nav.compiled.ahead import ENTRIES
from shefex_nav.compiled.numba_hooks import USES

ROOT = Path(__file__).parent.parent
REFUSED = 2  # exit code of a scenario that cannot be flown so
METHODS = ("pyramid", "voting", "brightness")
CENTROIDS = """
import numpy as np
import shefex_nav as sn
camera = sn.Camera(659, 493, 2525.0)
rng = np.random.default_rng(1)
for flux in (None, rng.uniform(1e3, 1e4, 8)):
    for errors in (None, np.tile(0.01 * np.eye(2), (8, 1, 1))):
        more = {"epoch": 2012.5, "centroid_covariance_px": errors}
        sn.solve_centroids(rng.uniform(0, 480, (8, 2)), flux, camera=camera, **more)
"""
MOST_S = {"orbit": "400s", "night_sky": "60s"}  # of missions in which the same goes on


def jobs(folder):
    """Command lines: list of lists."""
    log = f"{folder}/shefex2_andoya.mcap"
    found = []
    for path in sorted((ROOT / "scenarios").glob("*.yaml")):
        cut = ["--until", MOST_S[path.stem]] if path.stem in MOST_S else []
        out = ["--out", f"{folder}/{path.stem}.mcap"]
        found.append(["run", path, *out, *cut])
        if path.stem not in ("shefex2_dispersed", "shefex2_dispersed_sensors"):
            out = ["--out", f"{folder}/{path.stem}-s.mcap"]
            found.append(["run", path, *out, "--set", "star_tracker.frames=statistical", *cut])
    default = ROOT / "scenarios" / "shefex2_andoya.yaml"
    for method in METHODS:
        lost = ["--set", "star_tracker.identification.tracking=false"]
        out = ["--out", f"{folder}/{method}.mcap", "--until", "250s"]
        found.append(["run", default, *out, *lost, "--set", f"star_tracker.identification.method={method}"])
    campaign = ROOT / "scenarios" / "shefex2_dispersed.yaml"
    found.append(["campaign", campaign, "--runs", 2, "--out", f"{folder}/campaign"])
    found.append(["replay", log])
    found.append(["replay", ROOT / "scenarios" / "replay" / "csv_example.yaml"])
    found.append(["smooth", log])
    found.append(["solve", f"{folder}/sky.png"])
    found.append(["solve", f"{folder}/sky.png", "--camera", "shefex2_andoya"])
    found.append(["-c", CENTROIDS])
    return found


def used(job, folder):
    """(features, {(kernel, signature as JSON)}) of a job; None if it is refused, RuntimeError if it fails."""
    path = Path(folder, "used.jsonl")
    if job[0] == "solve":
        frames = runs.open_run(f"{folder}/shefex2_andoya.mcap").frames
        Image.fromarray(frames[300.0].image_dn).save(job[1])
    path.write_text("", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, *([] if job[0] == "-c" else ["-m", "shefex_nav"]), *map(str, job)],
        cwd=ROOT,
        env={**os.environ, USES: str(path)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode == REFUSED:
        return None
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, job))}: {done.stderr}")
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    features = [frozenset(line) for line in lines if all(isinstance(one, str) for one in line)]
    kernels = {(line[0], json.dumps(line[1])) for line in lines if line and isinstance(line[-1], list)}
    return frozenset.union(*features), kernels


def listed(jobs_used):
    """Content of entries.json from [(features, kernels)]."""
    users = {}
    for k, (features, kernels) in enumerate(jobs_used):
        command = next(one for one in features if one.startswith("command="))
        for one in kernels:
            users.setdefault((*one, command), set()).add(k)
    texts = sorted({json.dumps(kind) for _, types, _ in users for kind in json.loads(types)})
    groups = {}
    for (kernel, types, command), jobs in sorted(users.items()):
        numbers = [texts.index(json.dumps(kind)) for kind in json.loads(types)]
        groups.setdefault((command, *needs(jobs, jobs_used, command)), []).append([kernel, numbers])
    return {
        "types": [json.loads(text) for text in texts],
        "groups": [{"needs": list(needed), "kernels": groups[needed]} for needed in sorted(groups)],
    }


def needs(jobs, jobs_used, command):
    """The fewest features that tell the jobs of a command that use a kernel from its others: list of str."""
    common = frozenset.intersection(*(jobs_used[k][0] for k in jobs))
    others = [one for k, (one, _) in enumerate(jobs_used) if k not in jobs and command in one]
    others = [features for features in others if not common <= features]
    found = set()
    while others:
        one = min(common, key=lambda feature: (sum(feature in job for job in others), len(feature), feature))
        found.add(one)
        others = [features for features in others if one in features]
    return sorted(found)


def as_text(content):
    """JSON with a line for each type and each kernel."""
    types = ",\n".join(json.dumps(one) for one in content["types"])
    groups = ",\n".join(
        f'{{"needs": {json.dumps(group["needs"])}, "kernels": [\n'
        + ",\n".join(json.dumps(one) for one in group["kernels"])
        + "\n]}"
        for group in content["groups"]
    )
    return f'{{"types": [\n{types}\n],\n"groups": [\n{groups}\n]}}\n'


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args()
    jobs_used = []
    with tempfile.TemporaryDirectory() as folder:
        for job in jobs(folder):
            one = used(job, folder)
            if one is not None:
                jobs_used.append(one)
                print(f"{len(one[1]):4} kernels: {' '.join(map(str, job))}", file=sys.stderr)
    content = listed(jobs_used)
    text = as_text(content)
    same = ENTRIES.exists() and ENTRIES.read_text("utf-8") == text
    if not same and not arguments.check:
        ENTRIES.write_text(text, encoding="utf-8")
    count = sum(len(group["kernels"]) for group in content["groups"])
    print(f"{count} kernels, {'as listed before' if same else 'the list has changed'}")
    return int(arguments.check and not same)


if __name__ == "__main__":
    sys.exit(main())
