"""`shefex-nav verify bound`: the errors of a mission's filter over the posterior Cramer-Rao bound.

Exit codes: 0 done, 2 bad input. A study of many seeds in parallel is `benchmarks/consistency.py`.
"""

from pathlib import Path

from shefex_nav.commands.options import (
    MOST_SEEDS,
    FirstSeed,
    Json,
    OverwriteOut,
    Scenario,
    StudyOverrides,
    bad,
    option,
)
from shefex_nav.commands.output_files import check_picture
from shefex_nav.commands.printing import print_json, say, stdout


def bound(
    scenario: Scenario,
    seeds: option(int, "How many runs; a ratio of one run says little.", min=1, max=MOST_SEEDS) = 5,
    first: FirstSeed = 0,
    overrides: StudyOverrides = None,
    out: option(Path | None, "Draw the curves into a .png or .svg file.") = None,
    force: OverwriteOut = False,
    json: Json = False,
):
    """Fly a scenario with some seeds and compare the errors with what is possible at best."""
    if out is not None:
        check_picture(out, "--out", force=force)
    from shefex_nav.scenario import load
    from shefex_nav.scenario.software import refuse_own

    loaded = load.load(scenario, overrides or ())
    refuse_own(loaded, "the bound")
    from shefex_nav.verify import over_bound

    if over_bound.left_out(loaded):
        words = f"{scenario} has errors that the bound does not know: {over_bound.left_out(loaded)}"
        raise bad("SCENARIO", words)
    from shefex_nav import runs

    runs.get_ready(loaded)
    found = over_bound.curves(*over_bound.flights(loaded, range(first, first + seeds), say))
    ratios = over_bound.ratios(found)
    if json:
        print_json(over_bound.as_numbers(loaded, first, seeds, ratios))
    else:
        stdout(130).print(over_bound.table(ratios, seeds))
    if out is not None:
        from shefex_nav.verify import consistency_figures

        consistency_figures.draw_bound({"filter": found}, out, runs=seeds)
        say(f"wrote {out}")
