"""Digests of the records of a few flights: whether a change of the program changed any result.

    uv run python benchmarks/record_digests.py --json > before.json       # the six flights of FLIGHTS
    ... change something ...
    uv run python benchmarks/record_digests.py --compare before.json      # exit status 1 if a topic differs

    uv run python benchmarks/record_digests.py default night_sky --seed 2 # some of them, another seed
    uv run python benchmarks/record_digests.py rexus_like --until 60      # any scenario, cut at T+60 s

How much a topic differs is told if both times the logs are kept:

    uv run python benchmarks/record_digests.py --json --keep /tmp/before > before.json
    uv run python benchmarks/record_digests.py --compare before.json --keep /tmp/after

The relative difference of a field is the largest difference over the largest magnitude in the flight; printed
is that of the field that differs most. "other" stands for whole numbers and texts that differ, and for a list
of another length.

A digest covers the messages of a topic of the log, byte for byte, each with its log time, and the grey values
of all pictures, also of those that the log thins out. It leaves out /timing, which is measured, and how
messages of several topics follow each other in the file, which depends on when it was flushed. The digest of
a flight is that of its topics' digests. Flights are cut after some seconds of pictures, or of faults.
"""

import argparse
import hashlib
import json
import math
import struct
import sys
import tempfile
from pathlib import Path

import shefex_nav  # noqa: F401 first: it chooses for which processor NumPy computes

# isort: split
import numpy as np
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from shefex_nav import runs
from shefex_nav.log import reader, topics
from shefex_nav.log.run_data import ARRAYS, LISTS
from shefex_nav.records import Alignment, Frame
from shefex_nav.scenario import load

SCENARIOS = Path(__file__).parent.parent / "scenarios"
FLIGHTS = {  # name -> file, mission time [s] at which it is cut
    "default": ("shefex2_andoya", 264.0),
    "night_sky": ("night_sky", 30.0),
    "orbit": ("orbit", 150.0),
    "tight": ("tight", 150.0),
    "imu_faults": ("imu_faults", 325.0),
    "shefex2_aps_rolling": ("shefex2_aps_rolling", 240.0),
}
MEASURED = next(topic.topic for topic in topics.topics() if topic.record is topics.Timing)
PIXELS = "/star_tracker/frame image_dn"  # of all pictures
LETTERS = 16  # of a digest


def short(digest):
    return digest.hexdigest()[:LETTERS]


def fly(name, seed, until_s, log):
    """Fly a scenario and log it. -> {topic: digest}"""
    file, cut_s = FLIGHTS.get(name, (name, math.inf))
    scenario = load.load(str(SCENARIOS / f"{file}.yaml"))
    pixels = hashlib.sha256()

    def watched(records, *_):
        for record in records:
            if type(record) is Frame and record.image_dn is not None:
                pixels.update(np.ascontiguousarray(record.image_dn).tobytes())
            yield record

    cut_s = cut_s if until_s is None else until_s
    runs.fly(scenario, seed, until_s=cut_s, log=log, overwrite=True, watch=watched)
    return {PIXELS: short(pixels), **of_log(log)}


def of_log(path):
    """{topic: digest} of the messages of a log that are results."""
    names, digests = {}, {}
    with Path(path).open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            for one in breakup_chunk(record) if isinstance(record, Chunk) else (record,):
                if isinstance(one, Channel):
                    names[one.id] = one.topic
                    digests.setdefault(one.topic, hashlib.sha256())
                elif isinstance(one, Message):
                    digest = digests[names[one.channel_id]]
                    digest.update(struct.pack("<QI", one.log_time, len(one.data)))
                    digest.update(one.data)
    return {name: short(digest) for name, digest in sorted(digests.items()) if name != MEASURED}


def in_all(digests):
    """Digest of the digests of all topics."""
    return short(hashlib.sha256(json.dumps(digests, sort_keys=True).encode()))


def numbers(value, where, found):
    """Collect what a record or a list of records holds: {field: [flat arrays]}."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        for name, part in zip(value._fields, value, strict=True):
            numbers(part, f"{where}.{name}" if where else name, found)
    elif isinstance(value, list | tuple):
        for part in value:
            numbers(part, where, found)
    else:
        found.setdefault(where, []).append(np.ravel(value))
    return found


def difference(a, b):
    """Relative difference of two lists of arrays; inf if that is no number."""
    a, b = np.concatenate(a), np.concatenate(b)
    if len(a) != len(b) or a.dtype.kind != "f" or b.dtype.kind != "f":
        return 0.0 if len(a) == len(b) and bool(np.all(a == b)) else math.inf
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return math.inf
    held = np.isfinite(a)
    largest = max(np.max(np.abs(a[held]), initial=0.0), 1e-300)
    return float(np.max(np.abs(a[held] - b[held]), initial=0.0) / largest)


def differences(log, other):
    """{topic: (relative difference, field)} of two logs, of the topics that hold whole records."""
    topic_of = {topic.record: topic.topic for topic in topics.topics()}
    names = {**ARRAYS, **LISTS, topics.Mission: "mission", Alignment: "alignment"}
    first, second = reader.read(log), reader.read(other)
    result = {}
    for record, name in names.items():
        if record is not topics.Timing:
            a, b = (numbers(getattr(data, name), "", {}) for data in (first, second))
            found = [(difference(a[key], b[key]) if key in b else math.inf, key) for key in a]
            result[topic_of[record]] = max(found, default=(0.0, ""))
    return result


def told(topic, found):
    """What is printed of a topic that differs."""
    if topic not in found:
        return topic
    largest, field = found[topic]
    return f"{topic} {'other' if math.isinf(largest) else f'{largest:.1e}'} ({field})"


def compare(flight, before, log, logs_before):
    """Texts of the topics of a flight whose digests are other than before."""
    names = sorted({*flight["topics"], *before["topics"]})
    moved = [name for name in names if flight["topics"].get(name) != before["topics"].get(name)]
    other = Path(logs_before or "") / log.name
    kept = bool(moved and logs_before) and other.is_file() and other.resolve() != log.resolve()
    found = differences(log, other) if kept else {}
    return [told(name, found) for name in moved]


def report(name, flight, before, log, file):
    """Print a flight; whether it is the same as before."""
    moved, verdict = [], ""
    if before is not None and name not in before["flights"]:
        moved, verdict = [], "  not among those to compare with"
    elif before is not None:
        moved = compare(flight, before["flights"][name], log, before["kept"])
        verdict = "  other" if moved else "  same"
    print(f"{name:22s} {flight['digest']}{verdict}", *moved, sep="\n    ", file=file, flush=True)
    return verdict in ("", "  same")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="*", help=f"{', '.join(FLIGHTS)} (default: these), or others")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--until", type=float, help="mission time [s] at which all flights are cut")
    parser.add_argument("--json", action="store_true", help="print one JSON object, for --compare")
    parser.add_argument("--compare", metavar="FILE", help="what --json printed before")
    parser.add_argument("--keep", metavar="FOLDER", help="keep the logs there")
    asked = parser.parse_args()
    before = json.loads(Path(asked.compare).read_text()) if asked.compare else None
    result, same = {"seed": asked.seed, "kept": asked.keep and str(Path(asked.keep).resolve())}, True
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(asked.keep or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        flights = result["flights"] = {}
        for name in asked.scenario or FLIGHTS:
            log = folder / f"{name}-seed{asked.seed}.mcap"
            digests = fly(name, asked.seed, asked.until, log)
            flights[name] = {"digest": in_all(digests), "topics": digests}
            if before is not None or not asked.json:
                same &= report(name, flights[name], before, log, sys.stderr if asked.json else sys.stdout)
    if asked.json:
        print(json.dumps(result, indent=1))
    sys.exit(0 if same else 1)


if __name__ == "__main__":
    main()
