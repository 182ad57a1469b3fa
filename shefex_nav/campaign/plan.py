"""What the runs of a campaign have in common, and what tells one from the other."""

import hashlib
import pickle
import sys
from typing import NamedTuple

FORMAT = 1  # of the folder


class Plan(NamedTuple):
    """What every worker gets once."""

    name: str  # of the mission
    source: str  # YAML text of the scenario, with everything in it
    seed: int  # root of all randomness
    runs: int  # asked for
    sampling: str  # random, latin_hypercube
    series_rate: float  # Hz
    flight: bytes | None  # the one flight of all runs, pickled; None: each has its own


class Job(NamedTuple):
    """One run."""

    run: int
    seed: int  # of its sensors
    draws: dict  # path -> value, in the unit of the dispersion


def digest(text):
    """sha256 of a text, as 64 hexadecimal digits."""
    return digest_of_bytes(text.encode())


def digest_of_bytes(content):
    """sha256 of bytes, as 64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def versions():
    """Versions of what a result may depend on."""
    from importlib.metadata import version

    names = ("numpy", "scipy", "numba", "astropy", "filterpy")
    python = ".".join(map(str, sys.version_info[:3]))
    from shefex_nav import __version__

    return {"shefex_nav": __version__, "python": python} | {name: version(name) for name in names}


def shared_flight(scenario, seed):
    """The flight that all runs share, as bytes."""
    from shefex_nav import prepare

    return pickle.dumps(prepare.fly_vehicle(scenario, seed), protocol=5)
