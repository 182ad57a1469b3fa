"""A star tracker by statistics against one that searches rendered pictures: does a mission notice?

uv run shefex-nav campaign scenarios/shefex2_dispersed.yaml --runs 300 --seed 1 --out RENDERED
uv run shefex-nav campaign scenarios/shefex2_dispersed.yaml --runs 1000 --seed 1 --out STATISTICAL \\
    --set star_tracker.frames=statistical
uv run python benchmarks/statistical.py RENDERED STATISTICAL [--json]

Reads two campaigns of the same scenario, flown in whatever way, and prints, axis by axis, the ratio of the
RMS attitude errors at entry with its 95 % interval, availability, wrong fixes and missions an hour.

With the same root seed the runs of one number share every draw and all noise but the star tracker's. Whether
they do is looked at: sensor seeds and draws of the runs that both have. If all agree, there are three
estimates of the ratio, `independent`, `paired` and `controlled` (paired_ratios.py says what they are), if not
the first alone. The one with the smallest intervals, over the three axes together, judges: chosen by its
width, which says nothing of where it lies. Pairs are the runs that reached the entry in both; further runs
those whose number the rendered campaign did not fly.

Exit code 1 if an interval of it does not contain 1 or does not lie within 0.85 to 1.18, or if availability
differs by more than 2 points; 2 if the folders cannot be compared.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import paired_ratios

LOW, HIGH, POINTS = 0.85, 1.18, 2.0
FEWEST = 30  # pairs; of fewer a regression says little
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


def shared(rendered, statistical):
    """Runs that both have: how many with the same sensor seed and the same draws, and how many in all."""
    both = []
    for campaign in (rendered, statistical):
        # by name: a table and records differ in the order of the columns
        draws = [column for _, column in sorted(campaign.draws.items())]
        rows = zip(campaign.runs.astype(int), campaign["seed"], *draws, strict=True)
        both.append({int(row[0]): row[1:] for row in rows})
    common = both[0].keys() & both[1].keys()
    return [sum(both[0][run] == both[1][run] for run in common), len(common)]


def errors(campaign):
    """{run: (3,) attitude error at entry, deg} of the runs that have one."""
    table = np.column_stack([campaign.numbers(f"{ENTRY}.{axis}") for axis in range(3)])
    runs = campaign.runs.astype(int)
    return {int(run): row for run, row in zip(runs, table, strict=True) if np.isfinite(row).all()}


def compared(rendered, statistical, rng):
    """Estimates of the ratio and which of them judges: dict."""
    one, other, same = errors(rendered), errors(statistical), shared(rendered, statistical)
    if len(one) < 2 or len(other) < 2:
        sys.exit(_refused("at least two runs of each must have reached the entry"))
    pairs = sorted(one.keys() & other.keys())
    further = sorted(other.keys() - set(rendered.runs.astype(int).tolist()))
    estimates, correlation = [paired_ratios.independent(_table(other), _table(one), rng)], None
    if same[0] == same[1] and len(pairs) >= FEWEST:
        a, b = _table(other, pairs), _table(one, pairs)
        correlation = paired_ratios.correlation(a, b)
        estimates.append(paired_ratios.paired(a, b, rng))
        if further:
            estimates.append(paired_ratios.controlled(a, b, _table(other, further), rng))
    return {
        "shared": same,
        "samples": {
            "rendered": len(one), "statistical": len(other), "pairs": len(pairs), "further": len(further),
        },
        "estimates": estimates,
        "correlation": None if correlation is None else correlation.tolist(),
        "judged_by": min(estimates, key=lambda estimate: estimate.width).name,
    }  # fmt: skip


def _table(part, runs=None):
    """(n, 3) errors of some runs, of all."""
    return np.array([part[run] for run in (sorted(part) if runs is None else runs)])


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


def show(result):
    """Print the estimates. -> rows of each as dict"""
    samples, (same, common) = result["samples"], result["shared"]
    print(f"of {common} runs that both campaigns have {same} share seed and draws")
    words = {
        "independent": "{statistical} statistical over {rendered} rendered missions, each drawn by itself",
        "paired": "{pairs} pairs with the same draws",
        "controlled": "{pairs} pairs, and {further} further statistical missions as control variate",
    }
    found = {}
    for one in result["estimates"]:
        judges = ", which judges" if one.name == result["judged_by"] else ""
        print(f"RMS attitude error at entry, {one.name}{judges}: {words[one.name].format(**samples)}")
        found[one.name] = [_row(*axis) for axis in zip("xyz", one.ratio, one.low, one.high, strict=True)]
        for row in found[one.name]:
            verdict = "" if row["good"] else "not shown"
            print(f"  {row['axis']}  {row['ratio']:.3f}   {row['low']:.3f} ... {row['high']:.3f}   {verdict}")
    if result["correlation"] is not None:
        print("correlation of the squared errors", *(f"{one:.2f}" for one in result["correlation"]))
    return found


def _row(axis, ratio, low, high):
    good = bool(low <= 1.0 <= high and low >= LOW and high <= HIGH)
    return {"axis": axis, "ratio": float(ratio), "low": float(low), "high": float(high), "good": good}


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
    result = compared(rendered, statistical, np.random.default_rng(0))
    rows = show(result)
    apart = available[1] - available[0]
    print(f"availability differs by {apart:+.3f} points")
    good = all(row["good"] for row in rows[result["judged_by"]]) and abs(apart) <= POINTS
    print("shown" if good else "not shown", f"by the {result['judged_by']} estimate")
    if options.json:
        print(json.dumps(result | {"estimates": rows, "availability_points": apart, "good": good}))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
