"""A star tracker by statistics against one that searches rendered pictures: does a mission notice?

uv run shefex-nav campaign scenarios/campaign.yaml --runs 300 --seed 1 --out RENDERED
uv run shefex-nav campaign scenarios/campaign.yaml --runs 1000 --seed 1 --out STATISTICAL \\
    --set star_tracker.frames=statistical
uv run python benchmarks/statistical.py RENDERED STATISTICAL [--json]

Reads two campaigns of the same scenario, flown in whatever way, and prints, axis by axis, the ratio of the
RMS attitude errors at entry with its 95 % interval, availability, wrong fixes and missions an hour. The
interval is a bootstrap over the runs; those that both have with the same draws (the same root seed) are drawn
together, and their ratio is printed by itself as well. Exit code 1 if an interval does not contain 1 or does
not lie within 0.85 to 1.18, or if availability differs by more than 2 points; 2 if the folders cannot be
compared.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

LOW, HIGH, POINTS = 0.85, 1.18, 2.0
DRAWS = 10_000
ENTRY = "summary.navigation.at_entry.attitude_error_deg"
TRACKER = "summary.star_tracker"


def opened(folder, frames):
    """results.Campaign of a folder; SystemExit with a message if it is not one with such frames."""
    from shefex_nav.campaign import results, store

    try:
        campaign = results.open_campaign(folder)
    except store.StoreError as error:
        sys.exit(_refused(str(error)))
    found = campaign.scenario.star_tracker.frames
    if found != frames:
        sys.exit(_refused(f"{folder} was flown with frames: {found}, wanted are {frames}"))
    if not len(campaign):
        sys.exit(_refused(f"{folder} has no run yet"))
    return campaign


def _refused(text):
    print(text, file=sys.stderr)
    return 2


def check_scenarios(rendered, statistical):
    """SystemExit if the campaigns differ in more than how frames come about."""
    one, other = (
        campaign.scenario.model_dump(exclude={"star_tracker": {"frames", "model"}})
        for campaign in (rendered, statistical)
    )
    if one != other:
        section = next(name for name in one if one[name] != other[name])
        sys.exit(_refused(f"the campaigns are of two scenarios: they differ in {section}"))


def paired(rendered, statistical):
    """Runs that both have, with the same seed and the same draws: set."""
    both = []
    for campaign in (rendered, statistical):
        draws = [
            column for _, column in sorted(campaign.draws.items())
        ]  # a table and records differ in order
        rows = zip(campaign.runs.astype(int), campaign["seed"], *draws, strict=True)
        both.append({int(row[0]): row[1:] for row in rows})
    return {run for run, drawn in both[0].items() if both[1].get(run) == drawn}


def errors(campaign):
    """{run: (3,) attitude error at entry, deg} of the runs that have one."""
    table = np.column_stack([campaign.numbers(f"{ENTRY}.{axis}") for axis in range(3)])
    runs = campaign.runs.astype(int)
    return {int(run): row for run, row in zip(runs, table, strict=True) if np.isfinite(row).all()}


def ratios(rendered, statistical, both, rng):
    """RMS of the statistical over the rendered errors: (3,), and the ends of its 95 % interval (2, 3).

    rendered, statistical : {run: (3,)}; both : runs that are drawn together
    """
    alone = [
        np.array([part[run] for run in sorted(set(part) - both)]).reshape(-1, 3)
        for part in (rendered, statistical)
    ]
    together = [
        np.array([part[run] for run in sorted(both)]).reshape(-1, 3) for part in (rendered, statistical)
    ]
    groups = [together, (alone[0], None), (None, alone[1])]

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
    available = 100.0 * float(np.nansum(solved) / np.nansum(frames))
    good = int(campaign.succeeded.sum())
    print(
        f"{name:12s} {good} of {len(campaign)} runs succeeded; fixes in the window {available:.3f} %, wrong "
        f"{wrong:.0f} of {np.nansum(solved):.0f}; {np.nanmean(wall_s):.2f} s a mission, "
        f"{3600.0 / np.nanmean(wall_s):.0f} an hour and worker"
    )
    return available


def show(title, ratio, interval):
    """Print a table of the axes. -> rows as dict"""
    print(title)
    rows = []
    for axis, one, low, high in zip("xyz", ratio, *interval, strict=True):
        good = bool(low <= 1.0 <= high and low >= LOW and high <= HIGH)
        rows.append({"axis": axis, "ratio": float(one), "low": float(low), "high": float(high), "good": good})
        print(f"  {axis}  {one:.3f}   {low:.3f} ... {high:.3f}   {'' if good else 'outside'}")
    return rows


def main(argv=None):
    """Compare and print. -> exit code"""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rendered", type=Path)
    parser.add_argument("statistical", type=Path)
    parser.add_argument("--json", action="store_true", help="the figures as JSON after the tables")
    options = parser.parse_args(argv)
    rendered = opened(options.rendered, "rendered")
    statistical = opened(options.statistical, "statistical")
    check_scenarios(rendered, statistical)
    available = [describe("rendered", rendered), describe("statistical", statistical)]
    rng, one, other = np.random.default_rng(0), errors(rendered), errors(statistical)
    if len(one) < 2 or len(other) < 2:
        sys.exit(_refused("at least two runs of each must have reached the entry"))
    both = paired(rendered, statistical) & set(one) & set(other)
    title = f"RMS attitude error at entry, {len(other)} statistical over {len(one)} rendered missions"
    rows = show(title, *ratios(one, other, both, rng))
    if len(both) > 1:
        pair = [{run: part[run] for run in both} for part in (one, other)]
        show(f"the same of the {len(both)} runs that both have", *ratios(*pair, both, rng))
    apart = available[1] - available[0]
    print(f"availability differs by {apart:+.3f} points")
    if options.json:
        found = {"rendered": len(one), "statistical": len(other), "paired": len(both), "axes": rows}
        print(json.dumps(found | {"availability_points": apart}))
    return 0 if all(row["good"] for row in rows) and abs(apart) <= POINTS else 1


if __name__ == "__main__":
    sys.exit(main())
