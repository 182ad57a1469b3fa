"""What the runs of a campaign have in common, and what tells one from the other."""

import hashlib
import json
import math
import os
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

from shefex_nav import files
from shefex_nav.compiled import target

FORMAT = 2  # of the folder
BLOCKS = ("attitude", "velocity", "position", "gyro_bias", "accel_bias")  # of a series, in this order
PACKAGE = Path(__file__).parents[1]
DATA = "data/*.csv", "data/*.csv.gz", "data/*.f8"  # stars, fields, air; coast lines are of pictures alone


class Plan(NamedTuple):
    """What every worker gets once."""

    name: str  # of the mission
    source: str  # YAML text of the scenario, with everything in it
    seed: int  # root of all randomness
    runs: int  # asked for
    sampling: str  # random, latin_hypercube
    series_rate: float  # Hz
    shared: bool  # whether all runs have one flight
    versions: dict  # of what results depend on
    flight: bytes | None = None  # that flight, as `flight_file` writes it

    @property
    def digest(self):
        """What tells this plan from others, 64 hexadecimal digits; its flight follows from the rest."""
        return digest(json.dumps(self._replace(flight=None)))


class Job(NamedTuple):
    """One run."""

    run: int
    seed: int  # of its sensors
    draws: dict  # path -> value, in the unit of the dispersion
    plan: str  # digest of the Plan that it belongs to
    log: str | None = None  # file for a log of the run


def of_scenario(scenario, seed, runs):
    """Plan of a campaign of a Scenario, still without its flight."""
    how = scenario.campaign
    return Plan(
        name=scenario.mission.name,
        source=scenario.source,
        seed=seed,
        runs=runs,
        sampling=how.sampling,
        series_rate=how.series,
        shared=how.flight == "shared",
        versions=versions(),
    )


def writable(draws):
    """Draws as JSON can hold them; an infinite one, with which no run flies, as a word."""
    return {
        name: value if not isinstance(value, float) or math.isfinite(value) else str(value)
        for name, value in draws.items()
    }


def digest(content):
    """sha256 of a text or of bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def versions():
    """Versions of what a result may depend on: {name: str}.

    `code` and `data` are digests of files of this package, `target` is what arithmetic is done with.
    """
    from importlib.metadata import version

    from shefex_nav import __version__

    own = {"shefex_nav": __version__, "python": ".".join(map(str, sys.version_info[:3]))}
    own |= {"code": _contents(PACKAGE, "**/*.py"), "data": _contents(PACKAGE, *DATA)}
    own |= {"target": target.told(os.environ), "libc": _libc()}
    return own | {name: version(name) for name in ("numpy", "scipy", "numba", "astropy", "filterpy")}


def _libc():
    """Version of the C library, whose functions change from one to the next: str; "" where it is not told."""
    try:
        return os.confstr("CS_GNU_LIBC_VERSION") or ""
    except (AttributeError, OSError, ValueError):  # Windows; another library
        return ""


@cache
def _contents(folder, *patterns):
    """Digest of the names and contents of the files in `folder` that fit a pattern."""
    return files.digest((path for pattern in patterns for path in folder.glob(pattern)), folder)
