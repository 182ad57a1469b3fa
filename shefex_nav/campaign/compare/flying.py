"""Software and scenarios flown for a comparison: a campaign each, with the same root seed, in its own folder.

The name of a folder ends in a digest of what flies there (the scenario's whole text, with the software's
SHA-256): the same command goes on with it, and software that was edited gets a new one.
"""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

from shefex_nav.campaign import draws, running, store
from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.compare import sides
from shefex_nav.campaign.compare.given import BUILT_IN, CAMPAIGN, SOFTWARE, CompareError, override
from shefex_nav.campaign.head import read_head
from shefex_nav.scenario import load, software

OUT = Path("logs/compare")
DIGITS = 8  # of the digest


class How(NamedTuple):
    """How all of them are flown."""

    scenario: str | None  # in which software flies
    overrides: tuple
    runs: int
    seed: int
    workers: int | None
    out: Path | None


class Flight(NamedTuple):
    """One campaign to fly."""

    scenario: object  # Scenario
    label: str
    folder: Path


def planned(given, how):
    """Flight of each Given of a kind that flies: list. ScenarioError, CompareError; nothing is written."""
    found = []
    for one in given:
        if one.kind == SOFTWARE:
            if how.scenario is None:
                words = f"{one.text}: software needs a scenario to fly in"
                raise CompareError(f"{words}; add --scenario, for example --scenario shefex2_andoya")
            loaded = load.load(how.scenario, (*how.overrides, override(one.text)))
        else:
            loaded = load.load(one.text, how.overrides)
        software.refuse_reached(loaded)
        found.append(Flight(loaded, one.text, _folder(loaded, one, how)))
    return found


def seeds(how):
    """Seeds of the runs that are flown: tuple of int."""
    return tuple(draws.sensor_seed(how.seed, run) for run in range(how.runs))


def _folder(scenario, given, how):
    """Where a Scenario flies."""
    name = Path(given.text).name if given.kind == SOFTWARE else scenario.mission.name
    name = re.sub(r"[^\w.]+", "-", name).strip("-.") or BUILT_IN
    out = how.out or OUT / f"{scenario.mission.name}-seed{how.seed}"
    return out / f"{name}-{planning.digest(scenario.source)[:DIGITS]}"


def fly(flight, how, show, stopped, others=()):
    """Fly what is missing of a Flight. -> running.Ended

    others : Flights of the same comparison, which are named where the folder has more runs than are asked
    """
    asked = running.Request(flight.scenario, how.runs, how.seed, how.workers, None, ())
    try:
        with store.Store(flight.folder) as folder:
            return running.fly(running.checked(asked), folder, show, stopped)
    except store.FewerRunsError as error:
        words, advice = error.args
        raise store.FewerRunsError(words, _see(others) or advice) from None


def _see(flights):
    """How to compare what has flown of Flights: str; '' where fewer than two have begun."""
    begun = [str(one.folder) for one in flights if read_head(one.folder, missing=None) is not None]
    return f"`{command_of(begun)}` compares the runs that have flown" if len(begun) > 1 else ""


def command_of(folders):
    """Shell command that compares what is in folders."""
    return shlex.join(["shefex-nav", "compare", *map(str, folders)])


def side_so_far(flight, letter, label):
    """Side of the runs of a Flight that are done; None without any."""
    if read_head(flight.folder, missing=None) is None:
        return None
    try:
        return sides.of(CAMPAIGN, flight.folder, letter, label)
    except store.StoreError:  # no run is done
        return None
