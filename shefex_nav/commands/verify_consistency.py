"""`shefex-nav verify consistency`: are a filter's errors as large as it says? NEES, NIS, 3 sigma over seeds.

Exit codes: 0 every statistic is inside its interval, 1 one is outside, 2 bad input, 130 interrupted.
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
    Workers,
    option,
)
from shefex_nav.commands.output_files import check_apart, check_picture, check_writable, make_folder
from shefex_nav.commands.printing import counter, print_json, say, stdout


def consistency(
    scenario: Scenario,
    seeds: option(int, "How many runs; intervals get narrower with them.", min=2, max=MOST_SEEDS) = 20,
    first: FirstSeed = 0,
    overrides: StudyOverrides = None,
    workers: Workers = None,
    keep: option(
        Path | None, "Folder for the star fixes of the flights; seeds that it has are not flown again."
    ) = None,
    turn_field: option(
        bool, "Let what the on-board model leaves out of gravity point elsewhere in each run.", "--turn-field"
    ) = False,
    histories: option(int, "Histories that make the intervals of the NEES.", min=100, max=100_000) = 1000,
    out: option(Path | None, "Draw the NEES over time into a .png or .svg file.") = None,
    force: OverwriteOut = False,
    json: Json = False,
):
    """Fly a scenario with many seeds and hold the filter's errors against its own covariance."""
    _check_outputs(out, keep, force=force)
    asked = _study(scenario, overrides or (), keep, turn_field)
    chosen = list(range(first, first + seeds))
    found = _watched(asked, chosen, histories, workers)

    if json:
        from shefex_nav.verify import study

        print_json(study.as_numbers(asked, chosen, histories, found))
    else:
        _show(asked, chosen, found)
    if out is not None:
        from shefex_nav.verify import consistency_figures

        consistency_figures.draw_nees(found.runs, out)
        say(f"wrote {out}")
    if outside := [one.what for one in found.verdicts if not one.good]:
        say(f"{len(outside)} of {len(found.verdicts)} statistics outside: " + "; ".join(outside))
        raise typer.Exit(1)


def _check_outputs(out, keep, *, force):
    """Refuse a picture or a folder that cannot be written, would be lost, or is the other one."""
    check_apart({"--out": out, "--keep": keep})
    if out is not None:
        check_picture(out, "--out", force=force)
    if keep is not None:
        check_writable(keep, "--keep")


def _study(scenario, overrides, keep, turn_field):
    """study.Study of a scenario, whose kernels are compiled; keep : Path of the star fixes, or None."""
    from shefex_nav.scenario import load

    loaded = load.load(scenario, overrides)
    from shefex_nav import runs
    from shefex_nav.verify import study

    study.check(loaded)
    if keep is not None:
        make_folder(keep, "--keep")
    runs.get_ready(loaded)
    return study.of_scenario(loaded, None if keep is None else str(keep), turn_field=turn_field)


def _watched(asked, chosen, histories, workers):
    """`study.run` with a bar on stderr, or with lines where that is no terminal."""
    from shefex_nav.verify import study

    total = len(chosen) + 1
    with counter(total, lambda done, words: say(f"{words}, {done} of {total} done")) as note:
        try:
            return study.run(asked, chosen, histories=histories, workers=workers, note=note)
        except KeyboardInterrupt:
            study.sweep(asked, chosen)
    say(_interrupted(asked, chosen))  # below the bar, which is gone now
    raise typer.Exit(130)


def _interrupted(asked, chosen):
    """What is left of a study that was stopped: str."""
    if asked.folder is None:
        return "interrupted; nothing is kept, --keep FOLDER would"
    kept = sum(asked.path(seed).exists() for seed in chosen)
    return (
        f"interrupted; the star fixes of {kept} of {len(chosen)} seeds are kept in {asked.folder}, the same "
        "command goes on from there"
    )


def _show(asked, chosen, found):
    """The result as people read it."""
    from shefex_nav.verify import study

    fields = "another field of gravity in each" if asked.turn_field else "all in the field of the Earth"
    title = f"{asked.name}, seeds {chosen[0]} to {chosen[-1]}, {fields}; NEES, NIS: 1 is expected"
    stdout(130).print(study.table(title, found.verdicts))
    for name, (number, met) in study.refused(found.runs).items():
        typer.echo(f"{name}: {number} of {met} refused by the gate")
    typer.echo(f"variances of the histories within {found.apart:.1%} of the filter's own")
    if asked.folder is not None:
        typer.echo(f"star fixes of flights by {study.made_by(asked, chosen)}")
