"""Results of a long experiment, kept chunk by chunk in a folder so that a second run goes on from there.

A chunk is one file, written whole or not at all and never over another. Its head says what made it: the
experiment's code and that of the simulated world and the on-board software, the seed, the number and the size
of the chunk. A file that says anything else, or that cannot be read, is refused: results of two versions do
not mix. Files are plain NumPy archives without pickled objects, so that reading a foreign one runs nothing.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__, files
from shefex_nav.errors import UserError

HEAD = "head"  # name of the array that holds the fingerprint
PACKAGE = Path(__file__).parents[1]
PAPERS = "shefex_nav.papers."
WORLD = ("clock.py", "records.py", "compiled", "geometry", "environment", "world", "onboard", "data")


class StoreError(UserError, ValueError):
    """The folder holds something that cannot be used; for the user."""


class Store(NamedTuple):
    """A folder of chunks of one experiment."""

    folder: Path
    head: dict  # of every file, without the chunk's own entries
    chunk: int  # samples of a whole chunk

    def path(self, number):
        """File of a chunk."""
        return self.folder / f"{self.head['campaign']}-seed{self.head['seed']}-{number:05d}.npz"

    def load(self, number, size):
        """Result of a chunk, or None where there is no file. StoreError for a file of anything else."""
        path = self.path(number)
        if not path.exists():
            return None
        try:
            result = files.arrays(path)
            head = files.from_json(str(result.pop(HEAD)))
        except files.UNREADABLE:
            words = "is damaged, or no file of results; move it away to measure it again"
            raise StoreError(f"{path} {words}") from None
        wanted = self.head | {"chunk": number, "samples": size}
        if head != wanted:
            said = head if isinstance(head, dict) else {}
            what = [key for key in wanted if said.get(key) != wanted[key]] or [
                "more than this version writes"
            ]
            difference = "; ".join(f"{key}: {said.get(key)} there, {wanted.get(key)} here" for key in what)
            if what == ["samples"]:
                raise StoreError(
                    f"{path} is a chunk of another size ({difference}): what is kept can be extended where "
                    f"--samples is a multiple of {self.chunk}, a whole chunk; move this file away to measure "
                    "the chunk again, the others stay"
                )
            raise StoreError(f"{path} is of another run ({difference}); keep this one in another folder")
        return result

    def save(self, number, size, result):
        """Put a result, a dict of arrays, into the folder; a file that is there already stays."""
        path = self.path(number)
        head = json.dumps(self.head | {"chunk": number, "samples": size})
        part = path.with_name(f"{path.name}.{os.getpid()}.part")
        try:
            with part.open("wb") as file:
                np.savez_compressed(file, **{HEAD: np.array(head)}, **result)
                file.flush()
                os.fsync(file.fileno())
            os.link(part, path)  # unlike a renaming this does not replace what is there
        except FileExistsError:
            raise StoreError(f"{path} has appeared meanwhile; is another run at work there?") from None
        except OSError as error:
            raise StoreError(f"cannot write {path}: {error.strerror}") from None
        finally:
            part.unlink(missing_ok=True)


def store(experiment, seed, folder):
    """Store of an experiment.

    Parameters
    ----------
    experiment : Experiment with `kept`
    seed : int
    folder : Path of a folder that exists

    Raises
    ------
    StoreError : the experiment does not keep results
    """
    if not experiment.kept:
        raise StoreError("this experiment keeps no results; it is done in minutes")
    head = {
        "campaign": f"{experiment.measure.__module__.removeprefix(PAPERS)}.{experiment.measure.__name__}",
        "seed": seed,
        "version": __version__,
        "code": code_digest(experiment.kept),
    }
    return Store(Path(folder), head, experiment.chunk)


def code_digest(modules):
    """Fingerprint of what makes the results: these modules or folders, the world, the software on board."""
    own = [PACKAGE / "papers" / name.replace(".", "/") for name in modules]
    own = [path if path.is_dir() else path.with_suffix(".py") for path in own]
    roots = [*own, *(PACKAGE / name for name in WORLD)]
    every = [file for root in roots for file in (root.rglob("*") if root.is_dir() else [root])]
    return files.digest([file for file in every if file.suffix in (".py", ".gz", ".csv")], PACKAGE)
