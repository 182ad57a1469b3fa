"""Rendered frames of the star tracker by the hundred thousand: is any attitude wrong?

uv run python benchmarks/million_frames.py --keep FRAMES.jsonl [--frames 100000] [--first 0] [--workers N]

A unit is the default mission with rendered frames, some 1250 of them while the star camera may see the sky;
unit k is drawn from seed k alone: the epoch (a day of June of 2005 to 2024, so Moon and planets are elsewhere
each time), the direction, the roll about it and the rates, and what its stratum, k modulo their number, makes
worse. Nothing is told to the star tracker but what a stratum says. Each unit that is done is a line of the
file, and the same command goes on with those that are missing. Prints, a stratum a line, frames, solved,
wrong with the upper 95 % bound of the rate (Clopper and Pearson), refused by reason, time of the chain, and
the memory of the processes over their units. Exit code 1 if an attitude was wrong by more than 0.5 deg.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

PATH = str(Path(__file__).parent.parent / "scenarios" / "shefex2_andoya.yaml")
FRAMES_A_UNIT = 1250
WRONG = np.radians(0.5)
EXPOSURE = "star_tracker.exposure"


def nominal(rng):
    return {}


def fast(rng):
    """2 to 10 deg/s, detection along the streaks that the gyros predict."""
    rate = rng.uniform(2.0, 10.0)
    return {
        "star_tracker.highest_rate": "12 deg/s",
        "star_tracker.detection.scan": "streaks",
        "programme.pointing.cross_rate": f"{rate:.3f} deg/s",
    }


def exposed(rng):
    """One exposure of 15 to 75 ms, whatever the picture looks like; more do not fit between two frames."""
    time_ms = f"{15.0 * 5.0 ** rng.random():.1f} ms"
    return {f"{EXPOSURE}.{key}": time_ms for key in ("start", "shortest", "longest")}


def hot(rng):
    """60 to 6000 hot pixels, 3 to 300 bad ones that nobody knows."""
    factor = 10.0 ** rng.uniform(0.0, 2.0)
    artefacts = {"hot_pixels": 60 * factor, "unknown_bad_pixels": 3 * factor, "dead_pixels": 10 * factor}
    return {f"star_camera.artefacts.{key}": str(round(value)) for key, value in artefacts.items()}


def hit(rng):
    """Spikes by particles 1 to 300 times as many, false objects 1 to 30 times."""
    spikes, false = 0.2 * 10.0 ** rng.uniform(0.0, 2.5), 250 * 10.0 ** rng.uniform(0.0, 1.5)
    return {
        "star_camera.artefacts.spikes_per_frame": f"{spikes:.3f}",
        "star_camera.artefacts.false_objects": str(round(false)),
    }


def defocused(rng):
    """Spots 0.5 to 2 times as wide as the star tracker is told."""
    told = 0.8
    return {
        "star_camera.optics.psf_sigma": f"{told * 2.0 ** rng.uniform(-1.0, 1.0):.3f} pix",
        "navigation.told.star_camera.optics.psf_sigma": f"{told} pix",
    }


def told_wrongly(rng):
    """Noise of centroids and magnitudes told 0.5 to 2 times the default."""
    factors = 2.0 ** rng.uniform(-1.0, 1.0, 2)
    return {
        "star_tracker.identification.centroid_error": f"{0.25 * factors[0]:.4f} pix",
        "star_tracker.identification.magnitude_error": f"{0.3 * factors[1]:.4f} mag",
    }


def glowing(rng):
    """Background of the sky 1 to 100 times as bright."""
    return {"star_camera.detector.background": f"{400.0 * 10.0 ** rng.uniform(0.0, 2.0):.0f} electron/s"}


STRATA = nominal, fast, exposed, hot, hit, defocused, told_wrongly, glowing


def overrides(k):
    """Values of unit k, as `--set` takes them."""
    rng = np.random.default_rng([k, 20120622])
    day = datetime(2005 + rng.integers(20), 6, 1, 19, 18, tzinfo=UTC) + timedelta(
        days=float(rng.integers(30))
    )
    offset, about = 8.0 * np.sqrt(rng.random()), 2.0 * np.pi * rng.random()
    elevation = 52.0 + offset * np.cos(about)
    rate, share = 2.0 * rng.random(), rng.uniform(-1.0, 1.0)
    values = {
        "mission.epoch": f"{day:%Y-%m-%dT%H:%M:%SZ}",
        "attitude": "prescribed",
        "programme.slew.azimuth": f"{115.0 + offset * np.sin(about) / np.cos(np.radians(elevation)):.3f} deg",
        "programme.slew.elevation": f"{elevation:.3f} deg",
        "programme.slew.roll": f"{rng.uniform(-180.0, 180.0):.2f} deg",
        "programme.pointing.boresight_rate": f"{rate * share:.4f} deg/s",
        "programme.pointing.cross_rate": f"{rate * np.sqrt(1.0 - share**2):.4f} deg/s",
        "programme.pointing.cross_period": "8 s",
        "programme.pointing.cross_phase": f"{rng.uniform(0.0, 360.0):.1f} deg",
        "programme.pointing.ramp": "3 s",
    }
    values |= STRATA[k % len(STRATA)](rng)
    return [f"{key}={value}" for key, value in values.items()]


def fly(k):
    """Line of unit k: dict. Frames count where Sun and Earth are outside the exclusion angles."""
    from missions import flown

    from shefex_nav.records import Reason
    from shefex_nav.report import star_metrics

    began = time.process_time()
    data = flown((PATH, overrides(k), k))
    fixes = star_metrics.star_errors(data)
    error = np.linalg.norm(fixes.rotation_c, axis=1)
    clear = {frame.number for frame in data.frame_truths if frame.exclusion_met}
    reasons = Counter(Reason(fix.reason).name.lower() for fix in data.star_fixes if fix.number in clear)
    took = data.compute_times
    chain_ms = 1e3 * took.chain_s[np.isin(took.frame_number, list(clear))]
    return {
        "unit": k,
        "stratum": STRATA[k % len(STRATA)].__name__,
        "frames": len(clear),
        "solved": reasons.pop("none", 0),
        "wrong": int((error > WRONG).sum()),  # of all, also with the Sun in the picture
        "no_fix": dict(reasons),
        "largest_arcsec": float(np.degrees(error.max(initial=0.0)) * 3600.0),
        "chain_ms": float(np.median(chain_ms)) if len(chain_ms) else None,
        "memory_mb": int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6,
        "process": os.getpid(),
        "processor_s": time.process_time() - began,
    }


def study(wanted, keep, workers, code):
    """Fly what is missing; each unit that is done is a line of the file."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    done = {row["unit"] for row in lines(keep)}
    missing = [k for k in wanted if k not in done]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool, keep.open("a", encoding="utf-8") as file:
        futures = [pool.submit(fly, k) for k in missing]
        for n, future in enumerate(as_completed(futures), 1):
            row = future.result() | {"code": code}
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(f"{n} of {len(missing)}: unit {row['unit']}, {row['stratum']}", file=sys.stderr)


def lines(keep):
    """Units that are in the file: list of dict."""
    text = keep.read_text(encoding="utf-8") if keep.exists() else ""
    return [json.loads(line) for line in text.splitlines() if line.endswith("}")]


def most(wrong, frames):
    """Upper 95 % bound of a rate (Clopper and Pearson)."""
    from scipy.special import betaincinv

    return 1.0 if wrong >= frames else float(betaincinv(wrong + 1.0, frames - wrong, 0.95))


def report(rows):
    """Table by stratum."""
    for name in (*(one.__name__ for one in STRATA), "all"):
        own = [row for row in rows if name in (row["stratum"], "all")]
        frames, solved, wrong = (sum(row[key] for row in own) for key in ("frames", "solved", "wrong"))
        reasons = sum((Counter(row["no_fix"]) for row in own), Counter())
        said = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common(5))
        if frames:
            print(
                f"  {name:13}{len(own):5} units {frames:8} frames  solved {100 * solved / frames:6.2f} %  "
                f"wrong {wrong} (at most {most(wrong, frames):.1e})  "
                f"{np.median([row['chain_ms'] for row in own if row['chain_ms']]):5.2f} ms  {said}"
            )
    for process in sorted({row["process"] for row in rows}):
        used = [row["memory_mb"] for row in rows if row["process"] == process]
        if len(used) > 2:
            print(f"  process {process}: {len(used)} units, {used[1]:.0f} to {used[-1]:.0f} MB")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, required=True, help="file, a line of JSON a unit")
    parser.add_argument("--frames", type=int, default=100_000, help="how many")
    parser.add_argument("--first", type=int, default=0, help="number of the first unit")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--json", action="store_true", help="print what is kept of these units")
    given = parser.parse_args()
    units = range(given.first, given.first + -(-given.frames // FRAMES_A_UNIT))
    code = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True
    ).stdout.strip()
    study(units, given.keep, given.workers, code)
    rows = [row for row in lines(given.keep) if row["unit"] in units]
    print(json.dumps(rows)) if given.json else report(rows)
    sys.exit(any(row["wrong"] for row in rows))


if __name__ == "__main__":
    main()
