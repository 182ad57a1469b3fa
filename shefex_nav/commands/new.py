"""`shefex-nav new`: a file of the user's own to start from.

Exit codes: 0 done, 2 bad input: an unknown kind, or a file that would be overwritten.
"""

import os
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from shefex_nav.commands.options import argument, bad
from shefex_nav.commands.output_files import check_place
from shefex_nav.commands.printing import say

TEMPLATES = Path(__file__).resolve().parent.parent / "templates"


class Template(NamedTuple):
    """A file that is written, and what is done with it."""

    file: str
    next: tuple[str, ...]  # commands, with {file} and {stem} in them
    beside: tuple[str, ...] = ()  # files that it needs, which are written into the same folder
    note: str = ""  # what one may have wanted instead


class Kind(StrEnum):
    """What can be written."""

    FILTER = "filter"
    C = "c"
    TRACKER = "tracker"
    IDENTIFICATION = "identification"
    SENSOR = "sensor"
    SCENARIO = "scenario"


KINDS = {
    Kind.FILTER: Template(
        "filter.py",
        (
            "shefex-nav run shefex2_andoya --set navigation.software={file}:MyFilter --trust",
            "shefex-nav compare built-in {file}:MyFilter --scenario shefex2_andoya --runs 20 --trust",
        ),
    ),
    Kind.C: Template(
        "strapdown.c",
        (
            "cc -O2 -o {stem} {file} -lm",
            "shefex-nav run shefex2_andoya --set 'navigation.software={{command: {stem}}}' --trust",
        ),
        ("shefex_fsw.h",),
    ),
    Kind.TRACKER: Template(
        "tracker.py", ("shefex-nav run night_sky --set star_tracker.software={file}:MyTracker --trust",)
    ),
    Kind.IDENTIFICATION: Template(
        "identification.py",
        (
            "shefex-nav run night_sky --until 20s --trust --set 'plugins=[{file}]'"
            " --set star_tracker.identification.method=mine --set star_tracker.identification.tracking=false",
        ),
    ),
    Kind.SENSOR: Template(
        "sensor.py",
        (
            "shefex-nav run rexus_like --trust --set 'plugins=[{file}]' --set navigation.states=automatic"
            " --set 'radar_altimeter={{rate: 5 Hz, latency: 10 ms, bias: 1 m, noise: 2 m}}'",
        ),
    ),
    Kind.SCENARIO: Template(
        "scenario.yaml",
        ("shefex-nav check {file}", "shefex-nav run {file}"),
        note="it is rexus_like with other instruments; for a rocket of your own, from its motor file on, see "
        "docs/describe-your-rocket.md",
    ),
}


def new(
    kind: argument(Kind, "What to write."),
    file: argument(Path, "Where; must not exist."),
):
    """Write software, a sensor or a scenario of your own to start from; it flies as it is."""
    template = KINDS[kind]
    ending = Path(template.file).suffix
    if file.suffix != ending:
        raise bad("FILE", f"{file}: a {kind} is a file that ends in {ending}")
    check_place(file, "FILE")
    text = (TEMPLATES / template.file).read_text(encoding="utf-8")
    stem = os.path.join(".", file.with_suffix(""))
    told = os.path.join(".", file) if str(file).startswith("-") else str(file)  # else it is an option
    for word, meant in (("FILE", told), ("PROGRAM", stem), ("name: NAME", f"name: {file.stem}")):
        text = text.replace(word, meant)
    others = {file.parent / name: (TEMPLATES / name).read_text(encoding="utf-8") for name in template.beside}
    written = {file: text} | {path: content for path, content in others.items() if not path.exists()}
    try:
        for path, content in written.items():
            with path.open("x", encoding="utf-8") as out:
                out.write(content)
    except OSError as error:
        raise bad("FILE", f"{error.filename}: {error.strerror}") from None
    say(f"wrote {', '.join(map(str, written))}; fly it:")
    for line in template.next:
        say(f"  {line.format(file=told, stem=stem)}")
    if template.note:
        say(template.note)
