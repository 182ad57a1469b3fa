"""`shefex-nav instruments`: IMUs, receivers and star cameras that a scenario may use by name.

Exit codes: 0 done, 2 an unknown name, or a file that is no instrument.
"""

import os
from pathlib import Path

from shefex_nav.commands.options import argument, bad, option
from shefex_nav.commands.printing import print_json, stdout

ENDING = ".yaml"


def instruments(
    name: argument(
        str | None, "Explain this one in place of the list, e.g. stim300, or a file of your own."
    ) = None,
    json: option(bool, "Print it as one JSON object on stdout.", "--json") = False,
):
    """List the instruments that come with the program, with the figures that are compared; or explain one.

    Every value of an instrument is shown in the units of its data sheet, with its source, and what is
    assumed. A scenario takes one with `imu: {use: NAME}`, `gps: {use: NAME}`, `star_camera: {use: NAME}`.
    """
    from shefex_nav.report import instrument_sheets

    if name is None:
        _list(instrument_sheets, instrument_sheets.sheets(), json)
        return
    stem = Path(name).name.removesuffix(ENDING)
    if name.endswith(ENDING) and Path(name).exists():
        found = instrument_sheets.of_file(stem, name)
    else:
        try:
            found = instrument_sheets.sheet(name.removesuffix(ENDING))
        except KeyError:
            raise bad("NAME", _unknown(name)) from None
    if json:
        print_json(found.as_json())
    else:
        _explain(instrument_sheets, found)


def _unknown(name):
    """Words about a name that no instrument has."""
    from shefex_nav.scenario import instruments, shipped

    if os.path.isdir(name):
        return f"{name} is a folder; expected the name of an instrument, or its file"
    if name != (name := name.removesuffix(ENDING)):
        return f"there is no file '{name}{ENDING}', and no instrument '{name}' comes with the program"
    known = list(instruments.files())
    like = shipped.alike(name, known)
    near = f"did you mean {' or '.join(like)}? " if like else ""
    return f"no instrument '{name}' comes with the program; {near}there are {', '.join(known)}"


def _list(of, found, json):
    """Print a table for each kind, or all as JSON."""
    if json:
        kinds = {kind: [one.as_json() for one in found if one.instrument == kind] for kind in of.KINDS}
        print_json({"instruments": kinds})
        return
    from shefex_nav.report import columns

    console = stdout(150)
    for kind, words in of.KINDS.items():
        several = [one for one in found if one.instrument == kind]
        rows = ((one.name, one.unit, one.grade, *one.compared.values()) for one in several)
        title = f"{words}, for {several[0].use}"
        console.print(columns.table(title, of.HEADS[kind], rows))
    console.print("* assumed; `shefex-nav instruments NAME` says what else is, and the source of the rest")


def _explain(of, one):
    """Print all of an instrument."""
    from shefex_nav.report import columns

    console = stdout(130)
    console.print(f"{one.unit}, {one.grade}")
    console.print(f"source: {one.source}")
    rows = ((value.key, value.value, "assumed" if value.assumed else "", value.note) for value in one.values)
    console.print(columns.table(one.file, ("key", "value", "", "note"), rows))
    for name, words in one.computed.items():
        console.print(f"{name}: {words}")
    console.print(f"in a scenario: {one.use}")
