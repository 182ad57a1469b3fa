"""`shefex-nav reproduce`: the papers' experiments, published against measured.

Exit codes: 0 done, also where a figure disagrees (the table says so and why), 2 bad input, 130 interrupted.
"""

from pathlib import Path

import typer

from shefex_nav.commands.options import Json, Seed, argument, bad, option
from shefex_nav.commands.output_files import check_writable, make_folder
from shefex_nav.commands.printing import print_json, say, stdout
from shefex_nav.papers import registry
from shefex_nav.progress import bar, lines
from shefex_nav.stopping import interrupt, wishes

OUT = Path("logs/reproduce")
MOST_SAMPLES = 1_000_000_000  # [E] of any experiment
REPORT = "report"  # in place of an experiment


class ListingCommand(typer.core.TyperCommand):
    """A command whose help ends with the list of experiments."""

    def format_help(self, ctx, formatter):
        """The usual help, then the experiments."""
        super().format_help(ctx, formatter)
        formatter.write(f"Experiments:\n{registry.listing()}\n")


def reproduce(
    name: argument(str | None, "Experiment, all, or report; none lists them.") = None,
    samples: option(
        int | None, "Sample size; default as in the paper, with 'all' less for long ones."
    ) = None,
    seed: Seed = 1,
    out: option(Path, "Folder for figures (PNG), results (JSON) and the page.") = OUT,
    keep: option(
        Path | None,
        "Keep results here chunk by chunk; a second run goes on from them, one with more --samples "
        "too if the first had whole chunks alone (a message says of how many).",
    ) = None,
    json: Json = False,
):
    """Run an experiment of the papers again and compare with what was published.

    'report' runs nothing: it makes one HTML page of what is in the folder of --out. 'all' ends with it.
    """
    if name is None or name == REPORT:
        _nothing_runs(name, {"--samples": samples, "--keep": keep, "--json": json or None})
    if name is None:
        typer.echo(f"Experiments, each of them or 'all':\n{registry.listing()}")
        return
    if name == REPORT:
        _page(out)
        return
    names = list(registry.EXPERIMENTS) if name == "all" else [name]
    if names[0] not in registry.EXPERIMENTS:
        known = ", ".join(["all", REPORT, *registry.EXPERIMENTS])
        raise bad("NAME", f"there is no experiment {name!r}; choose from: {known}")
    if samples is not None and not 1 <= samples <= MOST_SAMPLES:
        words = f"{samples} is not possible; 1 to {MOST_SAMPLES}"
        raise bad("--samples", words)
    _writable(out, "--out")
    if keep is not None:
        _writable(keep, "--keep")
    done = []
    for one in names:
        folder = keep if name != "all" or registry.load(one).kept else None
        size = samples or (registry.load(one).brief if name == "all" else None)
        outcome = _run(one, size, seed, out, folder, dict(done), show=not json)
        done.append((one, outcome))
    _close(done, out, name == "all", json)


def _nothing_runs(name, given):
    """Refuse options {name: value, or None} of an experiment where none is run. name : REPORT, or None"""
    for flag, value in given.items():
        if value is not None:
            words = f"{REPORT} is the page of what there is" if name else "without NAME they are listed"
            raise bad(flag, f"goes with an experiment or 'all'; {words}")


def _close(done, out, every, json):
    """JSON of (name, Outcome), or the counts and the page of all."""
    from shefex_nav.papers import table

    if every:
        _page(out)
    if json:
        objects = [table.as_numbers(one, registry.load(one), outcome) for one, outcome in done]
        print_json({"experiments": objects} if every else objects[0])
    elif every:
        stdout(150).print(table.counts_table(done))


def _page(out):
    """Make the page of a folder."""
    from shefex_nav import files
    from shefex_nav.papers import page

    try:
        made = page.page(out)
    except page.FolderError as error:
        raise bad("--out", str(error)) from None
    files.put(out / "report.html", made)
    say(f"wrote {out / 'report.html'}")


def _run(name, samples, seed, out, keep, before, show):
    """One experiment, after those of `before`: measure, leave figure and rows, show if wanted. Outcome."""
    import json as formats

    from shefex_nav import files
    from shefex_nav.papers import picture, table
    from shefex_nav.papers.keep import StoreError
    from shefex_nav.papers.rows import linked

    experiment = registry.load(name)
    samples = samples or experiment.samples
    say(f"{name}: {samples} {experiment.unit}, seed {seed}; the first run on a machine compiles")
    try:
        outcome = _watched(experiment, samples, seed, keep)
    except StoreError as error:
        raise bad("--keep", str(error)) from None
    outcome = linked(before | {name: outcome})[name]
    if show:
        stdout(140).print(table.experiment_table(name, experiment, outcome))
    path = out / f"{name}.png"
    picture.draw(experiment, outcome, path)
    rows = table.as_numbers(name, experiment, outcome)
    files.put(out / f"{name}.json", formats.dumps(rows, allow_nan=False, indent=1))
    say(f"wrote {path}")
    return outcome


def _watched(experiment, samples, seed, folder):
    """Run with a progress bar on stderr, or with lines where that is no terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

    from shefex_nav.papers import engine
    from shefex_nav.papers import keep as keeping

    store = None if folder is None else keeping.store(experiment, seed, folder)
    told, done = lines(samples, say), 0
    with bar(BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as progress:
        task = progress.add_task("measure", total=samples)
        with wishes(_stop) as asked:

            def note(n):
                nonlocal done
                done += n
                progress.update(task, completed=done)
                if progress.disable:
                    told(done, f"{done} of {samples} done")
                if asked:  # the compiler can swallow the exception and fail a little later with another one
                    raise KeyboardInterrupt

            try:
                return engine.run(experiment, samples=samples, seed=seed, progress=note, store=store)
            except BaseException as error:
                if not (asked or isinstance(error, KeyboardInterrupt)):
                    raise
                words = _interrupted(experiment, samples, store)
    say(words)  # below the bar, which is gone now
    raise typer.Exit(130)


def _stop(asked):
    """KeyboardInterrupt at once: a chunk may take minutes."""
    interrupt()


def _interrupted(experiment, samples, store):
    """What is left of an experiment that was stopped: str."""
    if store is not None:
        n_chunks = -(-samples // experiment.chunk)
        kept = sum(store.path(k).exists() for k in range(n_chunks))
        return (
            f"interrupted; {kept} of {n_chunks} chunks are kept in {store.folder}, the same command goes on "
            "from there"
        )
    return "interrupted; nothing is kept" + (", --keep FOLDER would" if experiment.kept else "")


def _writable(out, option):
    """Make a folder that takes files, before anything is computed, or refuse it."""
    check_writable(out, option)
    make_folder(out, option)
