"""What several commands say of flights: what is wrong with one, where its log ends, how well it went."""

import signal
from contextlib import contextmanager

from shefex_nav.commands.printing import counter, print_json, say, stdout
from shefex_nav.errors import SoftwareError
from shefex_nav.progress import bar
from shefex_nav.stopping import at_once_if_waiting, wishes


@contextmanager
def about(scenario, loaded=None):
    """A flight that cannot be, or a star catalogue, is told with the name or the line of its scenario file.

    loaded : the Scenario; what is odd about its vehicle is told first, as it may be why
    """
    from shefex_nav.onboard.startracker.catalogue import CatalogueError
    from shefex_nav.world.flight.timeline import FlightError

    try:
        yield
    except CatalogueError as error:
        words = f"{scenario}: {error}" if loaded is None else loaded.line_about(error.field, error.words)
        raise CatalogueError(words) from None
    except FlightError as error:
        if loaded is not None:
            from shefex_nav.report import programme

            warn(loaded, programme.of_parts(loaded))
        is_placed = loaded is not None and error.field
        place = loaded.line_about(error.field, str(error)) if is_placed else f"{scenario}: {error}"
        raise FlightError(place) from None


@contextmanager
def object_of_failed(log, as_json):
    """Prints what `report --json` says of a flight whose software failed; the failure goes on.

    log : Path, or None of a flight that has none
    """
    before = written(log)
    try:
        yield
    except SoftwareError:
        if as_json and written(log) != before:
            from shefex_nav.report import metrics
            from shefex_nav.runs import open_run

            print_json(metrics.summarise(open_run(log).data, log=log))
        raise


@contextmanager
def kept(log, done):
    """Says where a flight is whose log is interrupted.

    log : Path, or None;  done : what was done to it, such as flown
    """
    before = written(log)
    try:
        yield
    except KeyboardInterrupt:
        if written(log) != before:
            say(f"{log}: what was {done} until now")
        raise


def written(log):
    """When a file was written last; None if there is none."""
    return log.stat().st_mtime_ns if log is not None and log.exists() else None


def warn(scenario, warnings):
    """A line for each thing that a scenario gets wrong of its flight, with its place."""
    for one in warnings:
        say(f"warning: {scenario.line_about(one.field, one.text)}")


def warn_of_parts(path, overrides):
    """A line for each part of a vehicle that no rocket has. path, overrides : of the scenario"""
    from shefex_nav.report import programme
    from shefex_nav.scenario import load

    loaded = load.load(path, overrides)
    warn(loaded, programme.of_parts(loaded))


def say_missing_plugins(path, pins):
    """A line for each plug-in of a log or a campaign that cannot be loaded here, as its `plugins` say."""
    from shefex_nav import plugins

    for words in plugins.left_out(pins):
        say(f"{path}: without what a plug-in brought: {words}")


def say_if_cut(log, data):
    """A line for the user of a log that was not closed, or whose mission was not flown or seen to its end."""
    if data.failure:
        first = data.failure.splitlines()[0]
        say(f"{log}: the flight failed, {first}; this is about what there is")
    elif data.ended_early:
        say(f"{log}: the run ended early, at T{data.reached_s:+.2f} s; this is about what there is")
    elif data.until_s is not None:
        say(f"{log}: the mission was looked at until T{data.until_s:+.2f} s; this is about what there is")


def show_run(summary, as_json, data, scenario=None):
    """Print the summary of a RunData as one JSON object or, with what was required, as a table.

    scenario : as of `configured.judged`
    """
    if as_json:
        print_json(summary)
        return
    from shefex_nav.report import configured, table

    stdout(100).print(table.summary_table(summary, configured.judged(data, summary, scenario)))


def show_campaign(campaign, series):
    """Print the tables of a campaign. results.Campaign, over_time.Series or None"""
    from shefex_nav.campaign.parts import parts
    from shefex_nav.campaign.tables import tables

    stdout(160, highlight=False).print(tables(parts(campaign, series)))


def _interruptible(records):
    """The same records; Ctrl-C and SIGTERM take effect between two of them, never inside compiled code.

    An exception in the middle of something may be lost: Python ignores those that arise in a destructor. The
    second signal raises it all the same: software of a user's own may never give the next record. So does the
    first while a program of its own is waited for.
    """
    with wishes(at_once_if_waiting, (signal.SIGINT, signal.SIGTERM)) as asked:
        for record in records:
            if asked:
                raise KeyboardInterrupt
            yield record


def followed(records, start_s, end_s):
    """The same records of a replay; how far it is is shown on stderr: a bar, or a line for each tenth."""
    from shefex_nav.progress import lines
    from shefex_nav.records import ImuBlock

    total, done = max(int(end_s - start_s), 1), 0
    with counter(total, lines(total, say)) as count:
        for record in records:
            if type(record) is ImuBlock:
                for _ in range(done, min(total, int(record.t_valid_s - start_s))):
                    done += 1
                    count(f"T{record.t_valid_s:+.0f} s of T{end_s:+.0f} s")
            yield record


def watched(records, start_s, end_s):
    """The same records; mission time, phase and speed are shown on stderr, and Ctrl-C ends them.

    start_s, end_s: of the flight, for the bar.
    """
    from rich.progress import BarColumn, TextColumn

    from shefex_nav.clock import SAME_S
    from shefex_nav.log.steady import Reached
    from shefex_nav.records import Phase

    words = "T{task.fields[t_s]:+8.1f} s  {task.fields[phase]:<9} {task.fields[speed]:6.0f} x real time"
    with bar(BarColumn(), TextColumn(words)) as progress:
        task = progress.add_task("fly", total=end_s - start_s, t_s=start_s, phase="", speed=0.0)
        for record in _interruptible(records):
            if type(record) is Reached and (record.t_s + SAME_S) % 1.0 < 0.005:
                elapsed = max(progress.tasks[0].elapsed or 0.0, 1e-3)
                phase = Phase(record.phase).name.lower()
                done_s = record.t_s - start_s
                progress.update(task, completed=done_s, t_s=record.t_s, phase=phase, speed=done_s / elapsed)
            yield record
