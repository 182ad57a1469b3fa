"""Rendered runs of a characterisation, kept: a fit can be made again without flying them again.

DIR/characterise.json says of what they are (scenario, root seed, version of the program); DIR/000123.npz is
one run, written under another name first, so that it is there as a whole or not at all. The program may have
changed since, or nobody could mend a fit with what was flown; a run says by which code it was flown, and the
fitted file names all of them.
"""

import json
from typing import NamedTuple

import numpy as np

from shefex_nav import files
from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.characterise.collect import Collected, Frames, Searches, Sources
from shefex_nav.errors import UserError
from shefex_nav.records import Reason

FORMAT = 2
HEAD = "characterise.json"
PARTS = {"frames": Frames, "sources": Sources, "searches": Searches}
MOST = 1e15  # of any number
WIDTHS = {  # of arrays with more than a number a row
    (Frames, "error"): 3, (Frames, "sigma"): 3, (Sources, "features"): 3, (Sources, "along"): 4,
    (Sources, "across"): 4, (Sources, "error"): 2, (Sources, "reported"): 2, (Searches, "error"): 3,
}  # fmt: skip
FLAGS = "first", "clear", "found", "named", "saturated", "matched", "good"
COUNTS = "frame", "hip", "reason", "stars", "objects", "strangers"
UNKNOWN = "error", "sigma", "reported"  # NaN where there is no fix, or nothing was found
NEVER_NEGATIVE = "rate", "exposure_s", "length_px", "sigma", "reported", *COUNTS


class Flown(NamedTuple):
    """A rendered run, as a worker sends it back."""

    run: int
    collected: object  # collect.Collected
    settings: dict  # of camera and star tracker
    code: str  # digest of the program that flew it


class RecordsError(UserError):
    """A folder of records that cannot be used; the message says why."""


class Records:
    """Folder of rendered runs of one scenario and root seed.

    folder : Path, made if it is not there
    plan : plan.Plan
    """

    def __init__(self, folder, plan):
        self.folder = folder
        head = {
            "format": FORMAT, "scenario": planning.digest(plan.source), "seed": plan.seed,
            "runs": plan.runs, "versions": {**plan.versions, "code": None},
        }  # fmt: skip
        path = folder / HEAD
        try:
            folder.mkdir(exist_ok=True)
            if not path.exists():
                if any(folder.iterdir()):
                    raise RecordsError(f"{folder} has something else in it; name a new or an empty folder")
                files.put(path, json.dumps(head, indent=1))
            _compare(path, head)
        except OSError as error:
            raise RecordsError(f"{folder}: {error.strerror or error}") from None

    def read(self, run):
        """Flown of a run that is kept; None without a readable one. RecordsError if it cannot be."""
        try:
            file = files.arrays(self._path(run))
            parts = [kind(*(file[f"{part}.{name}"] for name in kind._fields)) for part, kind in PARTS.items()]
            flown = Flown(run, Collected(*parts), *files.from_json(str(file["about"])))
        except files.UNREADABLE:
            return None
        if words := fault(*flown[1:]):
            again = "take the file away, and the run is flown again"
            raise RecordsError(f"{self._path(run)}: {words}; {again}")
        return flown

    def keep(self, flown):
        """Write a Flown."""
        columns = {
            f"{part}.{name}": column
            for part in PARTS
            for name, column in getattr(flown.collected, part)._asdict().items()
        }
        about = np.array(json.dumps([flown.settings, flown.code]))
        try:
            files.put_arrays(self._path(flown.run), {"about": about, **columns})
            files.settle(self.folder)
        except OSError as error:
            raise RecordsError(f"{self.folder}: {error.strerror or error}") from None

    def _path(self, run):
        return self.folder / f"{run:06d}.npz"


def _compare(path, head):
    """Refuse records of something else."""
    try:
        found = files.from_json(files.text_of(path))
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise RecordsError(f"{path} cannot be read: it is damaged, or no head of rendered runs")
    for name, value in head.items():
        if found.get(name) != value:
            raise RecordsError(f"{path}: these runs are of another {_what(name, value, found.get(name))}")


def _what(name, value, found):
    """What differs, for people."""
    if name == "versions" and isinstance(found, dict):
        name = next(key for key in {**value, **found} if value.get(key) != found.get(key))
        return f"version of {name}: {found.get(name)}, now {value.get(name)}"
    words = "number of runs" if name == "runs" else name
    return words if name == "scenario" else f"{words}: {found}, now {value}"


def fault(collected, settings, code):
    """Words about what cannot be in a run that is kept, with its array; '' if all can."""
    if not isinstance(settings, dict) or not isinstance(code, str):
        return "about: expected settings and a digest of the program"
    for name, part in zip(collected._fields, collected, strict=True):
        rows = len(part[0]) if part[0].ndim else 0
        for field, values in zip(part._fields, part, strict=True):
            if words := _fault(type(part), field, values, rows):
                return f"{name}.{field}: {words}"
    frames, sources = collected.frames, collected.sources
    if len(sources.frame) and sources.frame.max() >= len(frames.t_s):
        return f"sources.frame: got {sources.frame.max()}, expected a row of {len(frames.t_s)} frames"
    if len(frames.reason) and frames.reason.max() > max(Reason):
        return f"frames.reason: got {frames.reason.max()}, expected 0 to {max(Reason)}"
    if not (np.diff(frames.t_s) > 0.0).all():
        return "frames.t_s: expected times that increase"
    return ""


def _fault(part, field, values, rows):
    """Words about an array."""
    width = WIDTHS.get((part, field))
    shape = (rows,) if width is None else (rows, width)
    if values.shape != shape and not (values.size == 0 and rows == 0):
        return f"got an array of {_size(values.shape)}, expected {_size(shape)}"
    kinds, words = ("b", "flags") if field in FLAGS else ("iu", "whole numbers")
    if field not in FLAGS + COUNTS:
        kinds, words = "f", "numbers"
    if values.size and values.dtype.kind not in kinds:
        return f"got {values.dtype}, expected {words}"
    if kinds == "f":
        bad = ~(np.abs(values) < MOST) & ~(np.isnan(values) & (field in UNKNOWN))
        if bad.any():
            return f"got {values[bad][0]:g}, expected numbers below {MOST:g}"
    if field in NEVER_NEGATIVE and (values < 0).any():
        return f"got {values[values < 0][0]:g}, expected none below 0"
    return ""


def _size(shape):
    return " x ".join(map(str, shape)) or "a single number"
