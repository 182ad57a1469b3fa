"""`shefex-nav new`: a file of the user's own to start from.

Exit codes: 0 done, 2 bad input: an unknown kind, or a file that would be overwritten.
"""

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from shefex_nav.commands.output_files import check_place
from shefex_nav.commands.printing import say

TEMPLATES = Path(__file__).resolve().parent.parent / "templates"


class Template(NamedTuple):
    """A file that is written, and what is done with it."""

    file: str
    next: tuple[str, ...]  # commands, with {file} and {name} in them


class Kind(StrEnum):
    """What can be written."""

    FILTER = "filter"
    TRACKER = "tracker"
    SENSOR = "sensor"
    SCENARIO = "scenario"


KINDS = {
    Kind.FILTER: Template(
        "filter.py", ("run shefex2_andoya --set navigation.software={file}:MyFilter --trust",)
    ),
    Kind.TRACKER: Template(
        "tracker.py", ("run night_sky --set star_tracker.software={file}:MyTracker --trust",)
    ),
    Kind.SENSOR: Template(
        "sensor.py",
        (
            "run rexus_like --set 'plugins=[{file}]' --set 'radar_altimeter={{rate: 5 Hz, latency: 10 ms, "
            "bias: 1 m, noise: 2 m}}' --set navigation.states=automatic --trust",
        ),
    ),
    Kind.SCENARIO: Template("scenario.yaml", ("check {file}", "run {file}")),
}


def new(
    kind: Annotated[Kind, typer.Argument(help="What to write.")],
    file: Annotated[Path, typer.Argument(help="Where; must not exist.")],
):
    """Write a filter, star tracker, sensor or scenario of your own to start from; it flies as it is."""
    template = KINDS[kind]
    ending = Path(template.file).suffix
    if file.suffix != ending:
        raise typer.BadParameter(f"{file}: a {kind} is a file that ends in {ending}", param_hint="FILE")
    check_place(file, "FILE")
    text = (TEMPLATES / template.file).read_text(encoding="utf-8")
    text = text.replace("FILE", str(file)).replace("name: NAME", f"name: {file.stem}")
    try:
        with file.open("x", encoding="utf-8") as out:
            out.write(text)
    except OSError as error:
        raise typer.BadParameter(f"{file}: {error.strerror}", param_hint="FILE") from None
    say(f"wrote {file}; fly it:")
    for line in template.next:
        say(f"  shefex-nav {line.format(file=os.fspath(file))}")
