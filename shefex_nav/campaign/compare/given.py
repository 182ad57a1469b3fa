"""What a word of `shefex-nav compare` means: a log, the folder of a campaign, software, or a scenario."""

import json
import re
from pathlib import Path
from typing import NamedTuple

from shefex_nav.errors import UserError
from shefex_nav.log.mcap_file import is_log
from shefex_nav.scenario import software

LOG, CAMPAIGN, SOFTWARE, SCENARIO = "log", "campaign", "software", "scenario"
SOLUTION = "solution"  # a CSV: what another filter says of the flight of the first log
IN_LOG = re.compile(r"(.+\.mcap):([a-z][a-z0-9_]*)")  # such a solution, by its name in a log
FLOWN = SOFTWARE, SCENARIO  # kinds that have to fly first
BUILT_IN = "built-in"
FORMS = (
    "expected a log (.mcap), the folder of a campaign, a scenario (.yaml), what a filter says of the first "
    "log (.csv, or run.mcap:name), or software: built-in, my_filter.py:MyFilter, package.module:Class or "
    "'command:./my_fsw --flag'"
)


class CompareError(UserError):
    """Something that cannot be compared; the message says why and what would be right."""


class Given(NamedTuple):
    """One of the things to compare."""

    text: str
    kind: str


def read(text):
    """Given of a word; CompareError if it is none of them."""
    path = Path(text)
    if path.is_dir():
        return Given(text, CAMPAIGN)
    if IN_LOG.fullmatch(text) or is_log(path):
        return Given(text, LOG)
    if text in (BUILT_IN, software.BUILT_IN) or _is_software(text):
        return Given(text, SOFTWARE)
    if path.suffix in (".yaml", ".yml") or text in _shipped():
        return Given(text, SCENARIO)
    if path.suffix == ".csv":
        return Given(text, SOLUTION)
    if path.suffix == ".py":
        raise CompareError(f"{text}: names no class; expected {text}:MyFilter")
    raise CompareError(f"{text}: there is no such thing to compare; {FORMS}")


def _is_software(text):
    """Whether a word names software, as `navigation.software` would or with what it is before it."""
    if text.startswith((f"{software.CONNECT}:", "tcp://", "udp://")):
        raise CompareError(
            f"{text}: is one program, which flies once; a comparison starts one for each run: give its "
            "command, 'command:./my_fsw --flag'"
        )
    if text.startswith(f"{software.COMMAND}:"):
        if not text.partition(":")[2].strip():
            raise CompareError(f"{text}: names no program; expected 'command:./my_fsw --flag'")
        return True
    file, colon, name = text.rpartition(":")
    return bool(colon and file) and name.isidentifier()


def _shipped():
    from shefex_nav.scenario import shipped

    return shipped.files()


def override(text):
    """`--set` of the software that a word names."""
    if text in (BUILT_IN, software.BUILT_IN):
        value = software.BUILT_IN
    elif text.startswith(f"{software.COMMAND}:"):
        value = json.dumps({software.COMMAND: text.partition(":")[2].strip()})
    else:
        value = text
    return f"navigation.software={value}"
