"""A star tracker by statistics against one that searches rendered pictures: does a mission notice?

uv run python benchmarks/statistical.py FOLDER [--rendered 300] [--statistical 1000] [--workers 2] [--set ...]

Two campaigns of the same scenario with the same root seed are flown into FOLDER/rendered and
FOLDER/statistical; a second call goes on from there. Printed are, axis by axis, the ratio of the RMS attitude
errors at entry with its 95 % interval (bootstrap over the runs: those that both campaigns have are drawn
together), the same for the runs that both have, availability, wrong fixes, and missions an hour. Exit code 1
if an interval does not contain 1 or does not lie within 0.85 to 1.18, or if availability differs by more
than 2 points.
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np
from missions import SCENARIOS

LOW, HIGH, POINTS = 0.85, 1.18, 2.0
DRAWS = 10_000
ENTRY = "summary.navigation.at_entry.attitude_error_deg"
TRACKER = "summary.star_tracker"


def fly(options, frames, runs):
    """Fly a campaign, or what is missing of it. -> results.Campaign"""
    from shefex_nav.campaign import results

    folder = options.folder / frames
    words = [sys.executable, "-m", "shefex_nav.cli", "campaign", options.scenario, "--runs", runs]
    words += ["--seed", options.seed, "--out", folder, "--set", f"star_tracker.frames={frames}"]
    words += ["--workers", options.workers] if options.workers else []
    for one in options.set:
        words += ["--set", one]
    if not options.flown:
        subprocess.run([str(word) for word in words], check=False, stdout=subprocess.DEVNULL)
    return results.open_campaign(folder)


def errors(campaign):
    """{run: (3,) attitude error at entry, deg} of the runs that have one."""
    table = np.column_stack([campaign.numbers(f"{ENTRY}.{axis}") for axis in range(3)])
    runs = campaign.runs.astype(int)
    return {int(run): row for run, row in zip(runs, table, strict=True) if np.isfinite(row).all()}


def ratios(rendered, statistical, rng):
    """RMS of the statistical over the rendered errors: (3,), and the ends of its 95 % interval (2, 3)."""
    both = sorted(set(rendered) & set(statistical))
    groups = [
        (np.array([rendered[run] for run in both]), np.array([statistical[run] for run in both])),
        (np.array([rendered[run] for run in sorted(set(rendered) - set(both))]).reshape(-1, 3), None),
        (None, np.array([statistical[run] for run in sorted(set(statistical) - set(both))]).reshape(-1, 3)),
    ]

    def ratio(pick):
        sums = np.zeros((2, 3))
        counts = np.zeros(2)
        for group in groups:
            rows = pick(max(len(part) for part in group if part is not None))
            for k, part in enumerate(group):
                if part is not None:
                    sums[k] += (part[rows] ** 2).sum(axis=0)
                    counts[k] += len(rows)
        return np.sqrt(sums[1] / counts[1] / (sums[0] / counts[0]))

    drawn = [ratio(lambda n: rng.integers(n, size=n)) for _ in range(DRAWS)]
    return ratio(np.arange), np.percentile(drawn, [2.5, 97.5], axis=0)


def describe(name, campaign):
    """A line about a campaign. -> availability, per cent"""
    solved, frames = campaign.numbers(f"{TRACKER}.solved"), campaign.numbers(f"{TRACKER}.in_window")
    wrong = np.nansum(campaign.numbers(f"{TRACKER}.wrong"))
    wall_s = campaign.numbers("timing.wall_s")
    available = 100.0 * np.nansum(solved) / np.nansum(frames)
    good = int(campaign.succeeded.sum())
    print(
        f"{name:12s} {good} of {len(campaign)} runs succeeded; fixes in the window {available:.3f} %, wrong "
        f"{wrong:.0f} of {np.nansum(solved):.0f}; {np.nanmean(wall_s):.2f} s a mission, "
        f"{3600.0 / np.nanmean(wall_s):.0f} an hour and worker"
    )
    return available


def show(title, ratio, interval):
    print(title)
    good = True
    for axis, one, low, high in zip("xyz", ratio, *interval, strict=True):
        fits = low <= 1.0 <= high and low >= LOW and high <= HIGH
        good &= fits
        print(f"  {axis}  {one:.3f}   {low:.3f} ... {high:.3f}   {'' if fits else 'outside'}")
    return good


def options_of(argv):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenario", default=str(SCENARIOS / "campaign.yaml"))
    parser.add_argument("--rendered", type=int, default=300)
    parser.add_argument("--statistical", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--flown", action="store_true", help="judge what there is")
    return parser.parse_args(argv)


def main(argv=None):
    options = options_of(argv)
    options.folder.mkdir(parents=True, exist_ok=True)
    rendered = fly(options, "rendered", options.rendered)
    statistical = fly(options, "statistical", options.statistical)
    available = [describe("rendered", rendered), describe("statistical", statistical)]
    rng = np.random.default_rng(0)
    one, other = errors(rendered), errors(statistical)
    title = f"RMS attitude error at entry, {len(other)} statistical over {len(one)} rendered missions"
    good = show(title, *ratios(one, other, rng))
    both = set(one) & set(other)
    if len(both) > 1:
        pair = [{run: part[run] for run in both} for part in (one, other)]
        show(f"the same of the {len(both)} runs that both have", *ratios(*pair, rng))
    apart = available[1] - available[0]
    print(f"availability differs by {apart:+.3f} points")
    return 0 if good and abs(apart) <= POINTS else 1


if __name__ == "__main__":
    sys.exit(main())
