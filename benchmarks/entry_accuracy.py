"""Navigation errors at 100 km on the way down, with and without the star tracker, side by side.

uv run python benchmarks/entry_accuracy.py [--seeds 20] [SCENARIO ...]
"""

import argparse
from pathlib import Path

import numpy as np
from missions import SCENARIOS, fly_all
from scipy.stats import chi2

DEFAULT = ("shefex2_andoya", "no_star_tracker", "imu_300ppm")


def table(name, runs):
    """Print the figures of one scenario."""
    entry = [run["navigation"]["at_entry"] for run in runs]
    attitude = np.array([one["attitude_error_deg"] for one in entry])
    worst = np.abs(attitude).max(axis=1)
    position = np.array([one["position_error_m"] for one in entry])
    velocity = np.array([one["velocity_error_m_s"] for one in entry])
    nees = np.array([one["nees"] for one in entry])
    n = len(runs)
    low, high = chi2.ppf([0.025, 0.975], 9 * n) / n
    print(f"\n{name}: {n} seeds, at 100 km on the way down")
    print(f"  attitude, rms about x, y, z  {np.sqrt((attitude**2).mean(axis=0)).round(4)} deg")
    print(f"  worst axis                   median {np.median(worst):.4f}, max {worst.max():.4f} deg")
    print(f"  every axis under 0.17 deg    {(worst < 0.17).sum()} of {n}")
    print(
        f"  position                     rms {np.sqrt((position**2).mean()):.2f}, max {position.max():.2f} m"
    )
    rms = np.sqrt((velocity**2).mean())
    print(f"  velocity                     rms {rms:.3f}, max {velocity.max():.3f} m/s")
    print(
        f"  NEES, 9 dof                  mean {nees.mean():.2f} (95 % of means in {low:.2f} ... {high:.2f})"
    )
    print(f"  NEES by seed                 {nees.round(1)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=DEFAULT)
    parser.add_argument("--seeds", type=int, default=20, help="how many")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="as of shefex-nav run"
    )
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    for name in options.scenarios:
        path = SCENARIOS / f"{name}.yaml" if not name.endswith(".yaml") else Path(name)
        table(name, fly_all([(str(path), tuple(options.set), seed) for seed in seeds]))


if __name__ == "__main__":
    main()
