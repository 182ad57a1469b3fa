"""`shefex-nav replay`: the on-board navigation over what was recorded elsewhere.

Exit codes: 0 done, 2 bad input: a scenario or data that cannot be replayed (the message names file and line).
"""

import math
from contextlib import contextmanager
from pathlib import Path

from shefex_nav.commands import options
from shefex_nav.commands.flights import followed, kept, object_of_failed
from shefex_nav.commands.options import Json, Until, argument, bad, mission_time, option
from shefex_nav.commands.output_files import OTHER_NAME, check_place, not_made_meanwhile
from shefex_nav.commands.printing import print_json, say, stdout
from shefex_nav.log.mcap_file import is_log


def replay(
    source: argument(str, "Replay scenario (a file, or the name of a shipped one), or a log."),
    data: option(Path | None, "Folder with the data that the scenario names.") = None,
    from_: option(str | None, "Begin the statistics at this mission time, e.g. 60s.", "--from") = None,
    until: Until = None,
    log: option(Path | None, "Write a log (.mcap) for report and view.") = None,
    overrides: options.overrides("Override one value, e.g. --set gnss.latency='0.1 s'.") = None,
    json: Json = False,
):
    """Run the on-board navigation over recorded data, or over a log with other settings."""
    from_s = -math.inf if from_ is None else mission_time(from_, "--from", "60s")
    until_s = math.inf if until is None else mission_time(until, "--until", "240s")
    if data is not None and not data.is_dir():
        raise bad("--data", f"there is no folder {data}")
    if log is not None:
        check_place(log, "--log")
    summarise = _of_log if is_log(Path(source)) else _of_data
    with kept(log, "replayed"), object_of_failed(log, json), not_made_meanwhile(log, "--log", OTHER_NAME):
        summary = summarise(source, data, overrides or (), (from_s, until_s), log)
    if until is not None and summary["until_s"] != until_s:
        say(f"--until {until}: the data are over before")
    if json:
        print_json(summary)
    else:
        from shefex_nav.report import table

        stdout(100).print(table.summary_table(summary))


def _of_data(source, folder, overrides, span_s, log):
    """Replay external data. span_s : from, until. -> the summary"""
    from_s, until_s = span_s
    from shefex_nav.replay import load

    scenario, files = load.load(source, overrides, folder)
    from shefex_nav.replay import replayed

    with _under_its_option():
        return replayed.of_data(scenario, files, from_s, log, followed, until_s=until_s)


def _of_log(source, folder, overrides, span_s, log):
    """Run the filter again over a log. span_s : from, until. -> the summary"""
    from_s, until_s = span_s
    if folder is not None:
        raise bad("--data", "belongs to a replay scenario; a log holds its data")
    from shefex_nav.replay import rerun

    recording = rerun.open_log(Path(source), overrides)
    from shefex_nav.replay import replayed

    with _under_its_option():
        return replayed.of_log(recording, from_s, log, followed, until_s=until_s)


@contextmanager
def _under_its_option():
    """That nothing is left for statistics is refused under the name of the option that leaves nothing."""
    from shefex_nav.replay.replayed import NothingLeft

    try:
        yield
    except NothingLeft as error:
        raise bad(error.option, str(error)) from None
