"""`shefex-nav verify`: fly check-cases that others have published, and compare; errors over their bound and
over what the filter says of them.

`bound` and `nesc` are here. Exit codes: 0 done, or all within their tolerances; 1 a comparison fails; 2 no
data or bad input. A study of many seeds in parallel is `benchmarks/consistency.py`.
"""

from pathlib import Path

import typer

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
from shefex_nav.commands.refusal import TRUST_HELP, NumbersGroup
from shefex_nav.commands.verify_consistency import consistency
from shefex_nav.commands.verify_robustness import robustness


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


def nesc(
    data: option(Path, "Folder with trajectories and DAVE-ML models, of any layout."),
    case: option(list[str] | None, "Fly this case only, e.g. 01; more: 01,17.") = None,
    out: option(Path | None, "Draw the comparison into a .png or .svg file.") = None,
    force: OverwriteOut = False,
    json: Json = False,
):
    """Fly NASA's NESC check-cases (01 to 10 and 17) and compare with its simulators."""
    if out is not None:
        check_picture(out, "--out", force=force)
    from shefex_nav.verify.data import search

    files = search(data)
    from shefex_nav import warmup
    from shefex_nav.verify import nesc as cases

    wanted = [number.strip().zfill(2) for item in case or () for number in item.split(",")]
    chosen, others = cases.choose(files, wanted)
    flown = []
    warmup.get_ready({"command=verify nesc"})  # none are listed ahead; it says when one is compiled
    for number in chosen:
        say(f"case {number}: {cases.CASES[number].title}")
        for note in cases.NOTES.get(number, ()):
            say(f"  as the published trajectory, which departs from the models: {note}")
        flown.append(cases.run(files, number))
    for why in sorted({cases.why_not(number) for number in others}):
        say(f"not flown: {', '.join(n for n in others if cases.why_not(n) == why)} ({why})")
    if json:
        print_json(cases.as_numbers(flown, others))
    else:
        stdout(130).print(cases.table(flown))
    if out is not None:
        from shefex_nav.verify import picture

        picture.draw(flown, out)
        say(f"wrote {out}")
    failed = [f"case {one.number}: {', '.join(one.failed)}" for one in flown if one.failed]
    if failed:
        say("differs by more than is allowed: " + "; ".join(failed))
        raise typer.Exit(1)


app = typer.Typer(
    cls=NumbersGroup,
    help="Compare flights with published check-cases, and navigation with what is possible.",
    no_args_is_help=True,
)
app.command(epilog=TRUST_HELP)(bound)
app.command(epilog=TRUST_HELP)(consistency)
app.command(epilog=TRUST_HELP)(robustness)
app.command()(nesc)


@app.callback()
def verify():
    """Compare flights with published check-cases, and navigation with what is possible."""
