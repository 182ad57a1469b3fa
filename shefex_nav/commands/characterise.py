"""`shefex-nav characterise`: fit the statistics of a star tracker to rendered runs.

Exit codes: 0 done and every test within its limits, 1 written, but a test on runs that were not fitted is
outside, or they are too few to say so (the table and the file say which), 2 bad input or no fit, 130
interrupted, nothing written. Single runs that fail, or that no worker brings to an end, are left out and
counted; with --records nothing that was flown is lost in any case.
"""

from pathlib import Path

import typer

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.commands import options
from shefex_nav.commands.options import DispersedScenario, OverwriteOut, RootSeed, Workers, bad, option
from shefex_nav.commands.output_files import check_apart, check_file, check_writable
from shefex_nav.commands.printing import print_json, say, stdout


def characterise(
    scenario: DispersedScenario,
    runs: option(int, "Rendered runs to fly; a part of them judges the fit.", min=6, max=MOST_RUNS),
    out: option(Path, "File of the statistics (JSON), for star_tracker.model."),
    seed: RootSeed = 1,
    workers: Workers = None,
    records: option(
        Path | None, "Keep the rendered runs here; what is there is not flown again.", metavar="DIR"
    ) = None,
    overrides: options.overrides("Override one value, as of shefex-nav run.") = None,
    force: OverwriteOut = False,
    json: option(bool, "Print the file's content on stdout.", "--json") = False,
):
    """Fit the statistics of a scenario's star tracker to rendered runs, for frames: statistical."""
    loaded = _loaded(scenario, overrides or ())
    check_apart({"--out": out, "--records": records})
    check_file(out, "--out", force=force, given=[name for name, _ in loaded.files])
    if records is not None and not records.parent.is_dir():
        raise bad("--records", f"there is no folder {records.parent}")
    if records is not None:
        check_writable(records, "--records")
    say(f"{loaded.mission.name}, {runs} rendered runs, seed {seed}; the first run on a machine compiles")
    result = _characterised(loaded, runs, seed, workers, records)
    _write(out, result.content)
    if json:
        print_json(result.content)
    else:
        _show(result)
    if result.failed:
        say(f"{len(result.failed)} of {runs} rendered runs failed and are not in it")
    if result.lost:
        again = "" if records is None else "; the same command with --force flies them"
        say(f"{len(result.lost)} runs were lost, no worker brought them to an end, and are not in it{again}")
    say(f"wrote {out}")
    raise typer.Exit(0 if all(test.good for test in result.tests) else 1)


def _loaded(path, overrides):
    """The scenario, with pictures, if there can be statistics of it."""
    from shefex_nav.scenario import load, star_statistics
    from shefex_nav.scenario.software import refuse_own

    # without the model that it may name: one of another format or star tracker is what this is to replace
    loaded = load.load(path, (*overrides, "star_tracker.frames=rendered", "star_tracker.model=null"))
    if wrong := list(star_statistics.fitness(loaded)):
        raise bad("SCENARIO", f"{path}: {wrong[0][1]}")
    refuse_own(loaded, "characterise", "star_tracker")
    if not loaded.star_tracker.enabled:
        raise bad("SCENARIO", f"{path}: star_tracker.enabled is false")
    return loaded


def _characterised(loaded, runs, seed, workers, folder):
    """running.Result; what goes wrong with the name of the option that it is about."""
    from shefex_nav.campaign.characterise import running
    from shefex_nav.campaign.characterise.records import RecordsError
    from shefex_nav.campaign.engine import EngineError

    try:
        return running.characterise(loaded, runs, seed, workers=workers, folder=folder, done=say)
    except RecordsError as error:
        raise bad("--records", str(error)) from None
    except EngineError as error:
        words = f"{error}; if memory is short, try fewer"
        raise bad("--workers", words) from None


def _write(out, content):
    """Put the file in its place as a whole."""
    from shefex_nav import files
    from shefex_nav.campaign.characterise import model

    try:
        files.put(out, model.text(content))
        files.settle(out.parent)
    except OSError as error:
        raise bad("--out", f"{out}: {error.strerror or error}") from None


def _show(result):
    """Tables of the parameters and of the tests."""
    from shefex_nav.campaign.characterise import tables

    console = stdout(120)
    console.print(tables.parameters(result.content))
    console.print(tables.tests(result.tests))
