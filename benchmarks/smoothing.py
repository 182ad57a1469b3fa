"""What smoothing gains: errors of the smoothed flight over those of the filter, and whether it is honest.

uv run python benchmarks/smoothing.py FOLDER [--seeds 20] [--first 0] [--json FILE]

FOLDER holds star fixes of whole runs of the default mission, as `benchmarks/consistency.py FOLDER` keeps
them; the first seeds of which there are some are taken. IMU, GPS and truth are made again from the seed.
Prints for each part of the flight the RMS over all seeds of filter and smoother with their ratio and its 95 %
interval (bootstrap over seeds), and the NEES of both at some instants with the interval that holds 99.9 % of
means over so many seeds.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from missions import SCENARIOS

from shefex_nav.clock import SAMPLES_PER_TICK

AT_S = (-5.0, 30.0, 100.0, 130.0, 160.0, 200.0, 240.0, 270.0, 320.0, 370.0, 390.0, 398.0, 420.0, 480.0)
MADE_FOR = {"scenario": "shefex2_andoya.yaml", "set": []}  # whose star fixes they must be
BLOCKS = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}


def recording_of(scenario, seed, folder):
    """rerun.Recording of a seed, as its log would give it."""
    from shefex_nav import prepare, simulate
    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.replay import rerun
    from shefex_nav.verify import flown
    from shefex_nav.world import imu

    world = prepare.build_world(scenario, seed)
    trajectory = world.flight.trajectory
    builder = RunDataBuilder(prepare.mission(scenario, seed, trajectory))
    builder.add(world.alignment)
    for n, block in enumerate(imu.blocks(world.imu), 1):
        builder.add(simulate.truth_sample(trajectory, n * SAMPLES_PER_TICK))
        builder.add(block)
    fixes = flown.load(Path(folder) / f"fixes-{seed:04d}.npz", MADE_FOR)
    for record in (*world.flight.events, *world.gps_fixes, *fixes):
        builder.add(record)
    return rerun.of_data(builder.build(), f"seed {seed}")


def errors_at(data):
    """NEES of each block at AT_S: {name: (len(AT_S),)}."""
    from shefex_nav.report import metrics

    errors = metrics.navigation_errors(data)
    i, j = metrics.same_times(errors.t_s, data.covariance.t_s)
    x = np.hstack([errors.position_i, errors.velocity_i, errors.attitude_b])[i]
    found = {}
    for name, block in BLOCKS.items():
        rows = [int(np.argmin(np.abs(errors.t_s[i] - t_s))) for t_s in AT_S]
        found[name] = [_nees(x[k, block], data.covariance.P[j[k]][block, block]) for k in rows]
    return found


def _nees(x, P):
    scale = np.sqrt(np.diag(P))
    z = x / scale
    return float(z @ np.linalg.solve(P / np.outer(scale, scale), z))


def measure(scenario, seed, folder):
    """One seed: its parts as `compare.compare` has them, and the NEES."""
    from shefex_nav.replay import compare, smooth

    result = smooth.run(recording_of(scenario, seed, folder))
    nees = {name: errors_at(getattr(result, name)) for name in ("filtered", "smoothed")}
    return {"seed": seed, "parts": compare.compare(*result), "nees": nees}


def show(runs):
    """Print what the runs say."""
    from scipy.stats import chi2

    n = len(runs)
    rng = np.random.default_rng(0)
    print(f"{n} seeds: {[run['seed'] for run in runs]}; RMS, filtered -> smoothed, ratio [95 %]")
    for name in [row["part"] for row in runs[0]["parts"]]:
        rows = [row for run in runs for row in run["parts"] if row["part"] == name]
        cells = []
        for quantity in rows[0]["ratio"]:
            before, after = (
                np.array([row[w][quantity] ** 2 for row in rows]) for w in ("filtered", "smoothed")
            )
            drawn = rng.integers(0, len(rows), (4000, len(rows)))
            low, high = np.percentile(np.sqrt(after[drawn].mean(1) / before[drawn].mean(1)), [2.5, 97.5])
            values = np.sqrt([before.mean(), after.mean(), after.mean() / before.mean()])
            cells.append(
                f"{quantity} {values[0]:.4f} -> {values[1]:.4f}, {values[2]:.2f} [{low:.2f}, {high:.2f}]"
            )
        print(f"  {name:20s} {'   '.join(cells)}")
    low, high = chi2.ppf([0.0005, 0.9995], 3 * n) / n
    print(f"NEES of 3, filtered -> smoothed; 99.9 % of means within {low:.2f} to {high:.2f}")
    for k, t_s in enumerate(AT_S):
        cells = []
        for block in BLOCKS:
            f, s = (np.mean([run["nees"][w][block][k] for run in runs]) for w in ("filtered", "smoothed"))
            cells.append(f"{block} {f:.2f} -> {s:.2f}{'' if low < s < high else ' (!)'}")
        print(f"  T{t_s:+6.1f} s  {'   '.join(cells)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", type=Path, help="what was measured of each seed, in full")
    options = parser.parse_args()
    from shefex_nav.scenario import load
    from shefex_nav.verify import flown

    scenario = load.load(SCENARIOS / "shefex2_andoya.yaml")
    runs, folder = [], Path(options.folder)
    kept = sorted(int(path.stem.removeprefix("fixes-")) for path in folder.glob("fixes-*.npz"))
    seeds = [seed for seed in kept if seed >= options.first][: options.seeds]
    if not seeds:
        parser.error(f"{folder} holds no star fixes of seed {options.first} or later")
    print(f"star fixes: {flown.told(folder / f'fixes-{seed:04d}.npz' for seed in seeds)}")
    for seed in seeds:
        runs.append(measure(scenario, seed, options.folder))
        print(f"seed {seed} done", flush=True)
        if options.json:
            options.json.write_text(json.dumps(runs), encoding="utf-8")
    show(runs)


if __name__ == "__main__":
    main()
