"""`shefex-nav scenarios`: what comes with the program, to look at and to copy.

Exit codes: 0 done, 2 bad input: an unknown name, or a file that would be overwritten.
"""

import os
from pathlib import Path

import typer

from shefex_nav import files
from shefex_nav.commands.options import argument, bad, option
from shefex_nav.commands.printing import print_json, say, stdout


def scenarios(
    name: argument(str | None, "Print this one in place of the list, e.g. rexus_like, ln_200s.") = None,
    copy: option(
        Path | None, "Copy it, with the files that it needs; overwrites nothing.", metavar="FOLDER"
    ) = None,
    json: option(bool, "Print the list as one JSON object on stdout.", "--json") = False,
):
    """List the scenarios and instruments that come with the program; print or copy one of them.

    Wherever a command takes a scenario, and in `extends:`, the name is enough; that of an instrument in
    `use:`.
    """
    from shefex_nav.scenario import instruments, shipped

    if name is None and copy is not None:
        raise bad("--copy", "needs the NAME of a scenario to copy")
    if name is not None and json:
        raise bad("--json", "is for the list of all; leave NAME out")
    if name is None:
        _show(shipped.folder(), shipped.listed(), instruments.listed(), json)
        return
    known, stem = shipped.files() | instruments.files(), name.removesuffix(shipped.ENDING)
    if stem not in known:
        raise bad("NAME", f"{name}: {_unknown(stem)}")
    if copy is None:
        typer.echo(Path(known[stem]).read_text(encoding="utf-8"), nl=False)
    else:
        _copy(shipped.with_what_it_names(known[stem]), copy)


def _unknown(name):
    """Words about a name that no scenario and no instrument has."""
    from shefex_nav.scenario import instruments, shipped

    scenarios, units = list(shipped.files()), list(instruments.files())
    if like := shipped.alike(name, [*scenarios, *units]):
        called = (f"the instrument {one}" if one in units else one for one in like)
        more = f"did you mean {' or '.join(called)}? `shefex-nav scenarios` lists all"
    else:
        more = f"there are {', '.join(scenarios)}, and the instruments {', '.join(units)}"
    return f"no scenario or instrument '{name}' comes with the program (in {shipped.folder()}); {more}"


def _show(folder, found, units, json):
    """Print the list of scenarios and of instruments, as tables or as JSON."""
    if json:
        named = {"scenarios": found, "instruments": units}
        listed = {key: [one._asdict() for one in several] for key, several in named.items()}
        print_json({"folder": folder, **listed})
        return
    from shefex_nav.report import columns

    rows = ((one.name, one.command, one.description) for one in found)
    table = columns.table(f"in {folder}", ("scenario", "command", "what it is"), rows, no_wrap=True)
    table.columns[-1].no_wrap = False
    title, heads = (
        "instruments, for example for imu: {use: ln_200s}",
        ("instrument", "section", "grade", "unit"),
    )
    rows = ((one.name, one.instrument, one.grade, one.unit) for one in units)
    console = stdout(130)
    console.print(table)
    console.print(columns.table(title, heads, rows, no_wrap=True))


def _copy(sources, folder):
    """Copy files into a folder, placed as they are about the first one; overwrites nothing."""
    base = os.path.dirname(sources[0])
    pairs = [(Path(one), folder / os.path.relpath(one, base)) for one in sources]
    content = {target: source.read_bytes() for source, target in pairs}
    try:
        for target in content:
            if target.exists() and (not target.is_file() or files.content_of(target) != content[target]):
                words = f"{target} exists already and is another; choose another folder"
                raise bad("--copy", words)
        for target in (one for one in content if not one.exists()):
            target.parent.mkdir(parents=True, exist_ok=True)
            with files.whole(target) as half:
                half.write_bytes(content[target])
            say(f"wrote {target}")
    except OSError as error:
        words = f"{error.filename or folder}: cannot be written: {error.strerror}"
        raise bad("--copy", words) from None
