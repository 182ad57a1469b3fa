"""`shefex-nav compare`: logs, campaigns and software, run by run of one seed.

Exit codes: 0 compared, 1 runs were lost (the same command flies them) or no pair flew to its end, 2 bad input
or nothing that can be paired, 130 interrupted; the same command goes on.
"""

import os
from contextlib import suppress
from pathlib import Path

import typer

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.commands.options import Json, Overrides, RootSeed, Workers, argument, bad, option
from shefex_nav.commands.output_files import check_apart, check_file, check_writable
from shefex_nav.commands.printing import print_json, say, stdout

RUNS = 20
GOES_ON = "what is flown is kept, the same command goes on from there"


def compare(
    given: argument(
        list[str],
        "A log (.mcap); the folder of a campaign; software (built-in, my_filter.py:MyFilter, "
        "package.module:Class, 'command:./my_fsw --flag'); a scenario (.yaml), which is flown; or"
        " the solution of another filter for the first log (.csv, or run.mcap:name in it).",
        metavar="A B...",
    ),
    scenario: option(
        str | None, "Scenario that the software flies: a YAML file, or the name of a shipped one."
    ) = None,
    runs: option(int, "Number of runs to fly of each.", min=1, max=MOST_RUNS) = RUNS,
    seed: RootSeed = 1,
    workers: Workers = None,
    out: option(Path | None, "Folder of the flights. Default: logs/compare/<scenario>-seed<seed>.") = None,
    html: option(Path | None, "Write a page with tables and pictures, to hand over.") = None,
    force: option(bool, "Overwrite the file given with --html.", "--force") = False,
    overrides: Overrides = None,
    json: Json = False,
):
    """Compare logs, campaigns or flight software with the first one given, in pairs of one seed."""
    from shefex_nav.campaign.compare import flying
    from shefex_nav.campaign.compare import given as words

    _check_number(given)
    _check_outputs(given, out, html, force)
    told = [words.read(text) for text in given]
    if scenario is not None and not any(one.kind == words.SOFTWARE for one in told):
        raise bad("--scenario", f"{scenario}: no software is given that would fly in it")
    how = flying.How(scenario, tuple(overrides or ()), runs, seed, workers, out)
    flights = flying.planned([one for one in told if one.kind in words.FLOWN], how)
    there = _there(told)
    _check_seeds(told, there, flying.seeds(how))
    lost, interrupted = fly(flights, how)
    if interrupted:
        _show_what_is_there(told, there, flights, json)
        raise typer.Exit(130)
    sides, found = _compared(told, there, flights)
    _show(sides, found, html, json)
    nothing = any(not any(row.seeds for row in one.rows) for one in found)
    raise typer.Exit(1 if lost or nothing else 0)


def _check_outputs(given, out, html, force):
    """BadParameter for a folder or a page that cannot be written."""
    check_apart({"--out": out, "--html": html})
    if html is not None:
        check_file(html, "--html", force=force, given=[one for one in given if os.path.isfile(one)])
    if out is not None:
        check_writable(out, "--out")


def _check_number(given):
    """BadParameter for fewer than two to compare, or more than there are letters for."""
    from shefex_nav.campaign.compare.sides import MOST

    if len(given) < 2:
        raise typer.BadParameter(f"only {given[0]}; expected two or more to compare")
    if len(given) > MOST:
        raise typer.BadParameter(f"{len(given)} to compare; expected {MOST} at most")


def fly(flights, how):
    """Fly what is missing of each flying.Flight. -> how many runs were lost, whether somebody ended it"""
    from shefex_nav.campaign.compare import flying
    from shefex_nav.campaign.progress import TerminalShow
    from shefex_nav.stopping import stopping

    lost = 0
    for one in flights:
        say(f"{one.label}: {how.runs} runs, seed {how.seed} -> {one.folder}")
        try:
            with stopping() as stop:
                ended = flying.fly(one, how, TerminalShow(say), stop, flights)
        except KeyboardInterrupt:  # the second wish
            say(GOES_ON)
            raise
        if ended.interrupted:
            say(f"interrupted; {GOES_ON}")
            return lost, True
        for run in ended.lost:
            say(f"{one.label}: run {run.run} was lost: {run.reason}")
        lost += len(ended.lost)
    return lost, False


def _show_what_is_there(told, there, flights, as_json):
    """The comparison of what had flown when somebody ended it, if two sides have a seed in common.

    With --json nothing is printed: a program takes what it gets for the whole.
    """
    from shefex_nav.campaign.compare import comparison, flying, sides
    from shefex_nav.campaign.compare import given as words

    begun, found = iter(flights), []
    for letter, one in zip(sides.LETTERS, told, strict=False):
        side = there.get(letter) or flying.side_so_far(next(begun), letter, one.text)
        found += [] if side is None else [side]
    first, *others = found or [None]
    pairs = []
    for other in others:
        with suppress(words.CompareError):  # no seed in common yet
            pairs.append(comparison.compare(first, other))
    if not pairs:
        say("not two of them have runs of the same seed yet: there is nothing to compare")
        return
    say(f"what has flown so far; also by: {flying.command_of([side.where for side in found])}")
    if not as_json:
        _show([first, *(one.b for one in pairs)], pairs, None, False)


def _there(told):
    """{letter: Side} of those of list of given.Given that need not fly."""
    from shefex_nav.campaign.compare import given as words
    from shefex_nav.campaign.compare import sides

    found = {}
    for letter, one in zip(sides.LETTERS, told, strict=False):
        if one.kind == words.SOLUTION:
            if "A" not in found:
                raise words.CompareError(f"{one.text}: is about the flight of a log; expected that before it")
            found[letter] = sides.of_solution(one.text, letter, found["A"])
        elif one.kind not in words.FLOWN:
            found[letter] = sides.of(one.kind, one.text, letter, one.text)
    return found


def _check_seeds(told, there, planned):
    """CompareError where the first and another will have no seed in common after all have flown."""
    from shefex_nav.campaign.compare import comparison, sides

    first, *others = (
        there.get(letter) or sides.Planned(letter, one.text, planned)
        for letter, one in zip(sides.LETTERS, told, strict=False)
    )
    for other in others:
        comparison.in_common(first, other)


def _compared(told, there, flights):
    """(sides, Comparisons of the others with the first) of list of given.Given."""
    from shefex_nav.campaign.compare import comparison, sides
    from shefex_nav.campaign.compare import given as words

    flown, found = iter(flights), []
    for letter, one in zip(sides.LETTERS, told, strict=False):
        found.append(there.get(letter) or sides.of(words.CAMPAIGN, next(flown).folder, letter, one.text))
    first, *others = found
    return found, [comparison.compare(first, other) for other in others]


def _show(sides, found, html, as_json):
    """The result on stdout, and on a page if there is to be one."""
    from shefex_nav.campaign import tables
    from shefex_nav.campaign.compare import parts, summary

    if as_json:
        print_json(summary.summary(sides, found))
    else:
        stdout(160, highlight=False).print(tables.tables(parts.parts(sides, found)))
    if html is not None:
        from shefex_nav.campaign.compare import page

        page.write(html, sides, found)
        say(f"wrote {html}")
