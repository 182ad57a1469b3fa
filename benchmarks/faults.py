"""Does the navigation keep the promises of the fault scenarios, with more than one seed? And false alarms.

uv run python benchmarks/faults.py NAME ... [--seeds 8] [--first 0] [--jobs 2] [--stars FOLDER] [--json FILE]

NAME is gps_outage, frozen_gps, star_tracker_blinded, imu_faults, or clean: the default mission, in which
every alarm is a false one. Star fixes are those of rendered frames, flown with the scenario; with --stars
those of the default mission that `benchmarks/consistency.py FOLDER` has kept, which takes seconds instead of
minutes. Prints a row for every seed with what the scenario promises, and what was not kept. Exit code 1 if
something was not.
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from fault_flights import REQUIRED, fly

SMALLEST = np.radians(2e-5)  # [E] 0.07": before a fix is missing the variances are equal but for rounding
UNTOUCHED = 1e-4  # of a sigma: rounding, as the way of the filter is cut at other instants
ONLY_BLINDED = "faults.star_tracker=[{fault: blinded, from: 300 s, until: 330 s}]"
IMU_FAULTS = (  # source, from, until, the reason begins with
    ("imu", 120.0, 120.05, "no samples"),
    ("imu", 130.0, 130.05, "the same block"),
    ("gyro y", 290.0, 300.0, "stuck"),
    ("accelerometer x", 310.0, 320.0, "stuck"),
)


def gps_outage(flight):
    lost = flight.during(100.0, 400.0)
    ratio = float((np.abs(flight.error[lost, :3]) / flight.sigma[lost, :3]).max())
    error_deg, met = flight.attitude_at_entry()
    back_s = (flight.used("gps_position", 400.0) or [np.inf])[0]
    row = {
        "position error / sigma, largest": ratio,
        "position error at T+400 s, m": float(np.linalg.norm(flight.error[lost, :3][-1])),
        "attitude at entry, deg": error_deg,
        "first fix after, s": back_s - 400.0,
    }
    used = flight.used("gps_position", 100.0, 400.0) + flight.used("gps_velocity", 100.0, 400.0)
    return row, {"3 sigma": ratio < 3.0, "entry": met, "none used": not used, "back": back_s <= 402.0}


def frozen_gps(flight):
    sensors = ("gps_position", "gps_velocity")
    frozen = sum(len(flight.used(sensor, 2.5, 59.9)) for sensor in sensors)
    again_s = (flight.used("gps_position", 59.9) or [np.inf])[0] - 60.0
    jumped = len(flight.used("gps_position", 99.9, 119.9))
    drifted = flight.used("gps_position", 279.9, 339.9)
    after = flight.during(60.0, 400.0)
    over = np.abs(flight.error[after, :3]) / flight.sigma[after, :3]
    row = {
        "frozen fixes used": frozen,
        "first good one used after, s": again_s,
        "jumped fixes used": jumped,
        "drift: last used after, s": max(drifted, default=280.0) - 280.0,
        "largest position error from T+60 s, m": float(np.linalg.norm(flight.error[after, :3], axis=1).max()),
        "position error / sigma, largest": float(over.max()),
    }
    kept = {"none frozen": frozen == 0, "back": again_s <= 2.0, "none jumped": jumped == 0}
    kept["covariance"] = over.max() < most_normal(over.size)
    return row, kept | {"drift": row["drift: last used after, s"] < 15.0}


def star_tracker_blinded(flight, clean, unseen):
    """unseen : the flight in which the frames of wrong fixes do not exist; None where they are rendered."""
    stars = [gate for gate in flight.gates if gate.sensor == "star_tracker"]
    used = [gate for gate in stars if gate.accepted and gate.t_valid_s in flight.wrong_s]
    refused = [
        gate for gate in stars if gate.dof and not gate.accepted and gate.t_valid_s not in flight.wrong_s
    ]
    begin_s = flight.used("star_tracker")[0]
    before, with_wrong = (one.rms_attitude(begin_s, flight.entry_s) for one in (clean, flight))
    moved, chance = difference(flight, clean, begin_s + 1.0)
    error_deg, met = flight.attitude_at_entry()
    row = {
        "star fixes": len(stars),
        "wrong": len(flight.wrong_s),
        "wrong and used": len(used),
        "good and refused": len(refused),
        "attitude, deg": with_wrong,
        "without wrong ones, deg": before,
        "over that": with_wrong / before,
        "difference / what fewer fixes explain, largest": moved,
        "attitude at entry, deg": error_deg,
    }
    untouched = {}
    if unseen is not None:
        rows = flight.during(-np.inf, flight.entry_s)
        by_wrong = np.abs(flight.error - unseen.error)[rows] / flight.sigma[rows]
        row["moved by wrong ones / sigma, largest"] = float(by_wrong.max())
        untouched = {"untouched": by_wrong.max() < UNTOUCHED}
    return row, untouched | {
        "none used": not used and bool(flight.wrong_s),
        "1.1": with_wrong < 1.1 * before,
        "difference": moved < chance,
        "entry": met,
    }


def difference(fewer, more, begin_s):
    """Largest difference of attitude over its sigma, of two flights of which one filter got fewer fixes.

    An estimate from some of the measurements is that from all of them plus something independent of its
    error, so the difference has the variance P(fewer) - P(more). A wrong fix that is used, or good ones
    that are weighed otherwise, are not in it. -> float, what chance alone does not exceed (`most_normal`)
    """
    rows = fewer.during(begin_s, fewer.entry_s)
    moved = (fewer.error - more.error)[rows, 6:]
    variance = (fewer.sigma**2 - more.sigma**2)[rows, 6:]
    ratio = np.abs(moved) / np.sqrt(np.maximum(variance, SMALLEST**2))
    return float(ratio.max()), most_normal(ratio.size)


def blinded_over_all(rows):
    """Attitude with wrong fixes over that without, RMS over all flights; its 99 % interval (bootstrap).

    Beside the ratio of each flight, which is broken where the error without wrong fixes happens to be a fifth
    of its sigma: a tenth of that is less than what fewer fixes move it by.
    -> text, promise -> whether it is kept
    """
    squares = np.array([[row["attitude, deg"] ** 2, row["without wrong ones, deg"] ** 2] for row in rows])
    drawn = np.random.default_rng(0).integers(0, len(rows), (4000, len(rows)))
    ratios = np.sqrt(squares[drawn, 0].mean(axis=1) / squares[drawn, 1].mean(axis=1))
    low, high = np.percentile(ratios, [0.5, 99.5])
    ratio = np.sqrt(squares[:, 0].mean() / squares[:, 1].mean())
    above = int((squares[:, 0] > 1.1**2 * squares[:, 1]).sum())
    text = (
        f"attitude over that without wrong ones, rms of all: {ratio:.3f}, 99 %: {low:.3f} to {high:.3f}; "
        f"{above} of {len(rows)} flights above 1.1"
    )
    return text, {"1.1 over all": high < 1.1}


def imu_faults(flight):
    delays, ends = [], []
    for source, begin_s, end_s, reason in IMU_FAULTS:
        said = [one for one in flight.health if one.source == source]
        seen = [one.t_s for one in said if begin_s <= one.t_s <= end_s + 0.2 and reason in one.reason]
        over = [one.t_s for one in said if end_s <= one.t_s <= end_s + 0.05 and one.healthy]
        delays.append(min(seen, default=np.inf) - begin_s)
        ends.append(bool(over))
    ratios = np.abs(flight.error) / flight.sigma
    faulty = flight.during(120.0, 131.0) | flight.during(290.0, 321.0)
    ratio = float(ratios.max())
    misled = (np.abs(flight.error[:, 6:]) > flight.protection_b).any(axis=1) & (flight.doubt == 0)
    error_deg, met = flight.attitude_at_entry()
    blamed = {one.source for one in flight.health} - {"gps", "imu", "gyro y", "accelerometer x"}
    row = {
        "longest until noticed, s": max(delays),
        "error / sigma, largest": ratio,
        "while readings are missing": float(ratios[faulty].max()),
        "misleading, s": 0.1 * int(misled.sum()),
        "attitude at entry, deg": error_deg,
        "others blamed": " ".join(sorted(blamed)) or "-",
    }
    kept = {"0.2 s": max(delays) <= 0.2, "over": all(ends), "entry": met, "misleading": not misled.any()}
    return row, kept | {"blame": not blamed, "covariance": ratio < most_normal(ratios.size)}


def most_normal(n):
    """What none of n normal errors of sigma 1 exceeds, however they are tied, but once in 1000 flights."""
    from scipy.special import ndtri

    return float(-ndtri(0.5e-3 / n))


def clean(flight):
    """Every alarm is false."""
    met = [gate for gate in flight.gates if gate.dof]
    refused = {}
    for gate in met:
        if not gate.accepted:
            kind = f"{gate.sensor} {gate.note.split(':')[0]}"
            refused[kind] = refused.get(kind, 0) + 1
    aided = flight.aided & (flight.t_s <= flight.entry_s)
    outside = (np.abs(flight.error[:, 6:]) > flight.protection_b).any(axis=1)
    needless = (flight.doubt > 0) & aided & (np.abs(flight.error[:, 6:]) < REQUIRED).all(axis=1)
    sources = {one.source for one in flight.health if not one.healthy} - {"gps"}
    row = {
        "measurements": len(met),
        "held": refused.pop("star_tracker held", 0),
        "refused": sum(refused.values()),
        "refused, which": ", ".join(f"{n} {kind}" for kind, n in sorted(refused.items())) or "-",
        "'do not use' needlessly after stars, s": 0.1 * int(needless.sum()),
        "misleading, s": 0.1 * int((outside & (flight.doubt == 0)).sum()),
        "blamed": " ".join(sorted(sources)) or "-",
    }
    return row, {"blame": not sources, "misleading": row["misleading, s"] == 0.0}


CHECKS = {  # scenario, until, overrides of the flight that it is compared with
    "gps_outage": (gps_outage, "gps_outage", 420.0, None),
    "frozen_gps": (frozen_gps, "frozen_gps", 400.0, None),
    "star_tracker_blinded": (star_tracker_blinded, "star_tracker_blinded", 420.0, (ONLY_BLINDED,)),
    "imu_faults": (imu_faults, "imu_faults", 420.0, None),
    "clean": (clean, "shefex2_andoya", np.inf, None),
}


OVER_ALL = {"star_tracker_blinded": blinded_over_all}  # promises that all seeds keep together


def check(job):
    """One seed: what was measured, and whether each promise was kept."""
    function, scenario, until_s, other = CHECKS[job["name"]]
    job = job | {"scenario": scenario, "until_s": until_s, "overrides": job["set"]}
    flight, compared = fly(job), []
    if other is not None:
        job = job | {"overrides": (*job["set"], *other)}
        compared = [fly(job), fly(job | {"without": flight.wrong_s}) if job["stars"] else None]
    row, kept = function(flight, *compared)
    return {"seed": job["seed"], **row, "not kept": [what for what, good in kept.items() if not good]}


def table(name, rows):
    """Print the rows, columns named above them."""
    columns = [key for key in rows[0] if key not in ("seed", "not kept")]
    print(
        f"\n{name}, {len(rows)} seeds; columns: " + "; ".join(f"[{k}] {c}" for k, c in enumerate(columns, 1))
    )
    print("  seed " + "".join(f"{f'[{k}]':>10s}" for k in range(1, len(columns) + 1)) + "  not kept")
    for row in rows:
        cells = [f"{row[c]:10.4g}" if not isinstance(row[c], str) else f"  {row[c]:>8s}" for c in columns]
        print(f"  {row['seed']:4d} {''.join(cells)}  {', '.join(row['not kept']) or '-'}")
    for name in columns:
        values = np.array([row[name] for row in rows if not isinstance(row[name], str)], dtype=float)
        if len(values):
            total, middle, most = values.sum(), np.median(values), values.max()
            print(f"  {name}: sum {total:.6g}, median {middle:.4g}, largest {most:.4g}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="+", choices=list(CHECKS), metavar="NAME")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--stars", help="folder of star fixes that are kept; seeds without are left out")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="as of shefex-nav run"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    seeds = range(options.first, options.first + options.seeds)
    if options.stars:
        folder = Path(options.stars)
        seeds = [seed for seed in seeds if (folder / f"fixes-{seed:04d}.npz").exists()]
        if not seeds:
            parser.error(f"{folder} holds no star fixes of these seeds")
        from shefex_nav.verify import flown

        print(f"star fixes: {flown.provenance(folder / f'fixes-{seed:04d}.npz' for seed in seeds)}")
    found, broken = {}, []
    with ProcessPoolExecutor(max_workers=options.jobs, mp_context=get_context("spawn")) as pool:
        for name in options.names:
            base = {"name": name, "stars": options.stars, "set": tuple(options.set)}
            found[name] = list(pool.map(check, [base | {"seed": seed} for seed in seeds]))
            table(name, found[name])
            if name in OVER_ALL:
                text, kept = OVER_ALL[name](found[name])
                broken += [what for what, good in kept.items() if not good]
                print(f"  {text}; not kept: {', '.join(broken) or '-'}")
            sys.stdout.flush()
            if options.json:
                options.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return int(bool(broken) or any(row["not kept"] for rows in found.values() for row in rows))


if __name__ == "__main__":
    sys.exit(main())
