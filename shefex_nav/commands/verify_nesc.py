"""`shefex-nav verify nesc`: fly NASA's check-cases and compare with what its simulators have published.

Exit codes: 0 all within their tolerances, 1 a comparison fails, 2 no data or bad input.
"""

from pathlib import Path

import typer

from shefex_nav.commands.options import Json, OverwriteOut, option
from shefex_nav.commands.output_files import check_picture
from shefex_nav.commands.printing import print_json, say, stdout


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
