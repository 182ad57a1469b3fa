"""The command line: parse, call one function, print.

Results go to stdout, progress and messages to stderr. Exit codes: 0 done, 2 bad input (one clear message,
nothing written), 1 an internal fault (traceback, and the log up to that moment stays readable),
130 interrupted.
"""

import json as json_module
import math
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.campaign.characterise.command import characterise
from shefex_nav.campaign.command import campaign, repeat  # which imports late
from shefex_nav.ending import end_quickly
from shefex_nav.refusal import PlainGroup
from shefex_nav.replay.command import replay  # likewise
from shefex_nav.replay.smooth_command import smooth
from shefex_nav.report import export_command  # imports late
from shefex_nav.reproduce.command import ListingCommand, reproduce  # which import late
from shefex_nav.scenario.command import scenarios
from shefex_nav.solve.command import solve
from shefex_nav.verify.command import app as verify_app  # which imports late, too
from shefex_nav.warmup_command import warmup

app = typer.Typer(
    name="shefex-nav",
    cls=PlainGroup,
    help="Hybrid INS/GPS/star-tracker navigation simulator for sounding rockets and small satellites.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
app.add_typer(verify_app, name="verify")
app.command(cls=ListingCommand)(reproduce)
app.command()(solve)
app.command()(characterise)
app.command()(replay)
app.command()(smooth)
app.command()(campaign)
app.command()(repeat)
app.command()(export_command.export)
app.command()(scenarios)
app.command()(warmup)

ScenarioArgument = Annotated[
    str, typer.Argument(help="Scenario: a YAML file, or the name of a shipped one, e.g. shefex2_andoya.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override one value, e.g. --set star_tracker.rate='5 Hz'."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


@app.command()
def run(
    scenario: ScenarioArgument,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all randomness.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Log; default logs/<scenario>-seed<seed>.mcap.")] = None,
    overrides: SetOption = None,
    until: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="Look at the mission until this time only, e.g. 60s; its log ends there."
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file given with --out.")] = False,
    json: JsonOption = False,
):
    """Fly a scenario: simulate, navigate, log, and print how well it went."""
    from shefex_nav.scenario import load

    until_s = math.inf if until is None else mission_time(until, "--until")
    loaded = load.load(scenario, overrides or ())
    from shefex_nav import runs

    if not until_s >= runs.earliest_end(loaded):
        words = (
            f"{until} is not after the start of the mission, T{loaded.mission.start:+g} s: "
            f"from {runs.earliest_end(loaded):g} s on there is something to see"
        )
        raise typer.BadParameter(words, param_hint="--until")
    path = out or free_name(loaded.mission.name, seed)
    export_command.check_file(path, "--out", force=force, given=loaded_files(loaded))
    say(f"{loaded.mission.name}, seed {seed} -> {path}")
    with about(scenario):
        flown = runs.fly(
            loaded,
            seed,
            until_s=until_s,
            log=path,
            overwrite=force,
            watch=lambda records, start_s, end_s: interruptible(watched(records, start_s, end_s)),
            told=lambda warnings: warn(loaded, warnings),
        )
    if until is not None and flown.data.until_s is None:
        say(f"--until {until}: the mission was over before, at T{flown.data.last_t_s:+.2f} s")
    show(flown.summary(), json, flown.data)


def loaded_files(loaded):
    """Paths of the files that a Scenario was read from."""
    return [Path(name) for name, _ in loaded.files]


def free_name(name, seed):
    """First unused path logs/<name>-seed<seed>[-<n>].mcap; the folder is made if need be."""
    path, n = Path("logs") / f"{name}-seed{seed}.mcap", 1
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        raise typer.BadParameter(f"cannot make the folder {path.parent}: {error.strerror}") from None
    while path.exists():
        n += 1
        path = path.with_name(f"{name}-seed{seed}-{n}.mcap")
    return path


def say(text):
    """A line for people, on stderr."""
    typer.echo(text, err=True)


@contextmanager
def about(scenario):
    """A flight that cannot be is told with the name of its scenario file."""
    from shefex_nav.world.flight.fly import FlightError

    try:
        yield
    except FlightError as error:
        raise FlightError(f"{scenario}: {error}") from None


def warn(scenario, warnings):
    """A line for each thing that a scenario gets wrong of its flight, with its place."""
    for one in warnings:
        say(f"warning: {scenario.line_about(one.field, one.text)}")


def interruptible(records):
    """The same records; Ctrl-C takes effect between two of them, never inside compiled code."""
    import signal

    wishes = []
    before = signal.signal(signal.SIGINT, lambda *_: wishes.append(True))
    try:
        for record in records:
            if wishes:
                raise KeyboardInterrupt
            yield record
    finally:
        signal.signal(signal.SIGINT, before)


def watched(records, start_s, end_s):
    """The same records; shows mission time, phase and speed on stderr while they pass.

    start_s, end_s: of the flight, for the bar.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from shefex_nav.records import Phase, TruthSample

    console = Console(stderr=True)
    columns = (
        BarColumn(),
        TextColumn(
            "T{task.fields[t_s]:+8.1f} s  {task.fields[phase]:<9} {task.fields[speed]:6.0f} x real time"
        ),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("fly", total=end_s - start_s, t_s=start_s, phase="", speed=0.0)
        for record in records:
            if type(record) is TruthSample and record.t_s % 1.0 < 0.005:
                elapsed = max(progress.tasks[0].elapsed or 0.0, 1e-3)
                phase = Phase(record.phase).name.lower()
                done_s = record.t_s - start_s
                progress.update(task, completed=done_s, t_s=record.t_s, phase=phase, speed=done_s / elapsed)
            yield record


@app.command()
def report(
    log: Annotated[Path, typer.Argument(help="Log of a run (MCAP), or folder of a campaign.")],
    html: Annotated[Path | None, typer.Option(help="Write a page to hand over, with every figure.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite what --html and --figures name.")] = False,
    figures: Annotated[Path | None, typer.Option(help="Folder for the pictures, each a PNG.")] = None,
    json: JsonOption = False,
):
    """Print the results of a run from its log, or those of a campaign from its folder."""
    if html is not None:
        export_command.check_file(html, "--html", force=force, given=[log])
    if figures is not None:
        export_command.check_pictures(figures, _picture_names(log), "--figures", force=force)
    if log.is_dir():
        from shefex_nav.campaign import report_command

        report_command.report(log, json=json, html=html, figures=figures)
        return
    from shefex_nav.log import reader
    from shefex_nav.report import metrics

    data = reader.read(log)
    tell_if_cut(log, data)
    if figures is not None:
        export_command.folder_for(figures, "--figures")
    if html is not None:
        export_command.write_page(html, data, log)
    if figures is not None:
        from shefex_nav.report import figures as pictures

        for path in pictures.save_all(data, figures):
            say(f"wrote {path}")
    show(metrics.summarise(data, log=log), json, data)


def _picture_names(log):
    """Names of the pictures that a report may write: of a campaign's folder, or of a run's log."""
    if log.is_dir():
        from shefex_nav.campaign import figures

        return figures.NAMES
    from shefex_nav.report import figures

    return [entry.name for entry in figures.catalogue()]


@app.command()
def view(
    logs: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="Logs of runs (MCAP), killed runs too; the others are drawn over the first one.",
        ),
    ],
    page: Annotated[
        str,
        typer.Option(
            "--view",
            metavar="NAME",
            help="Page open at first: overview, mission, star-tracker, navigation, sensors.",
        ),
    ] = "overview",
    save: Annotated[Path | None, typer.Option(help="Write a rerun recording (.rrd), do not open it.")] = None,
    screenshot: Annotated[Path | None, typer.Option(help="PNG of the viewer; needs no screen.")] = None,
    at: Annotated[str | None, typer.Option(help="Mission time of the screenshot, e.g. 240s.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser on this machine.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite what --save and --screenshot name.")
    ] = False,
):
    """Open logs in the rerun viewer, laid out."""
    at_s = None if at is None else mission_time(at, "--at")
    if at is not None and screenshot is None:
        raise typer.BadParameter(
            f"{at} is the time of a picture; name it with --screenshot", param_hint="--at"
        )
    if web and (save or screenshot):
        raise typer.BadParameter("does not go with --save or --screenshot", param_hint="--web")
    for path, option, ending in ((save, "--save", ".rrd"), (screenshot, "--screenshot", ".png")):
        if path is not None:
            export_command.check_file(path, option, force=force, given=logs)
            if path.suffix.lower() != ending:
                words = (
                    f"{path}: only {ending.removeprefix('.').upper()} is written; end its name in {ending}"
                )
                raise typer.BadParameter(words, param_hint=option)
    from shefex_nav.report import viewer
    from shefex_nav.report.viewer import layout

    names = {name.lower().replace(" ", "-"): name for name in layout.PAGES}
    if page.lower() not in names:
        raise typer.BadParameter(f"{page!r} is no page; choose from: {', '.join(names)}", param_hint="--view")
    runs = viewer.view(logs, save=save, screenshot=screenshot, at_s=at_s, page=names[page.lower()], web=web)
    for log, data in zip(logs, runs, strict=True):
        tell_if_cut(log, data)
    for written in (save, screenshot):
        if written is not None:
            say(f"wrote {written}")


def mission_time(text, option):
    """Seconds from a time with its unit that an option gives, such as 240s or '4 min'."""
    from pydantic_core import PydanticCustomError

    from shefex_nav.scenario.quantity import QuantitySpec

    try:
        return QuantitySpec("s", "240s").read(text)
    except PydanticCustomError as error:
        raise typer.BadParameter(error.message(), param_hint=option) from None


def tell_if_cut(log, data):
    """A line for the user of a log that was not closed, or whose mission was not seen to its end."""
    if data.ended_early:
        say(f"{log}: the run ended early, at T{data.last_t_s:+.2f} s; this is about what there is")
    elif data.until_s is not None:
        say(f"{log}: the mission was looked at until T{data.until_s:+.2f} s; this is about what there is")


@app.command()
def check(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    against: Annotated[
        Path | None,
        typer.Option(help="List each value that differs from a campaign's folder, a log or a scenario."),
    ] = None,
):
    """Check a scenario file; all its errors at once, with line and column.

    A vehicle that is launched is flown, without its sensors: times that do not fit the flight are told, and
    errors of the IMU that last in it but are noise to the filter.
    """
    from shefex_nav.report import programme
    from shefex_nav.scenario import load, told

    loaded, differences = load.load(scenario, overrides or ()), []
    if against is not None:
        from shefex_nav.campaign import against as other

        differences = other.lines(loaded, against)
    with about(scenario):
        loaded, effects = settled(loaded)
        found = programme.foreseen(loaded)
    warn(loaded, found)
    count = f", with {len(found)} warning{'s' if found[1:] else ''}" if found else ""
    for line in told.lines(loaded):
        say(f"told otherwise: {line}")
    typer.echo(f"{scenario}: good{count}")
    if effects:
        from rich.console import Console

        from shefex_nav.report import states

        Console(width=None if sys.stdout.isatty() else 130).print(states.table(effects))
    for line in differences:
        typer.echo(line)


def settled(loaded):
    """A Scenario with the names of its filter's states, and why these, if it leaves them to the program.

    -> Scenario, list of wanted_states.Effect
    """
    from shefex_nav.scenario import block, load

    if loaded.navigation.states != block.AUTOMATIC:
        return loaded, []
    from shefex_nav import prepare

    effects = prepare.wanted(loaded)
    return load.with_states(loaded, [one.block for one in effects if one.on]), effects


@app.command()
def schema():
    """Print the JSON Schema of scenario files, for completion in editors."""
    from shefex_nav.scenario import json_schema

    typer.echo(json_module.dumps(json_schema.json_schema(), indent=2))


def show(summary, as_json, data):
    """Print the summary of a RunData as one JSON object or, with what was required, as a table."""
    if as_json:
        typer.echo(json_module.dumps(summary, allow_nan=False))
        return
    from rich.console import Console

    from shefex_nav.report import configured, table

    closing = table.summary_table(summary, configured.judged(data, summary))
    Console(width=None if sys.stdout.isatty() else 100).print(closing)


def main():
    """Entry point; `refusal.PlainGroup` turns bad input into one message and exit code 2."""
    end_quickly()
    try:
        app()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
