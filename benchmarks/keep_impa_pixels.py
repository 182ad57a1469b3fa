"""Write the table of `impa-pixels` that the package keeps, from the chunks of its command.

    shefex-nav reproduce impa-pixels --samples 650 --seed 1 --keep FOLDER
    python benchmarks/keep_impa_pixels.py FOLDER 650 1

Chunks of other code, another seed or another size are refused. It also prints, table by table, what
comes of choosing the reading on every second chunk and counting the published figures that it reproduces on
the others.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from shefex_nav import __version__
from shefex_nav.papers import engine, keep, registry
from shefex_nav.papers.impa import kept, moments, pixels
from shefex_nav.papers.verdict import Verdict

DIGITS = 4  # of a kept figure


def write(path, command, figures):
    """Write a table. figures: moments.Figure"""
    with Path(path).open("w", newline="") as file:
        file.write(f"# {command}\n")
        out = csv.writer(file, lineterminator="\n")
        out.writerow(moments.Figure._fields)
        for one in figures:
            out.writerow([f"{value:.{DIGITS}g}" if isinstance(value, float) else value for value in one])


def reached(table, of):
    """How many published figures of a table each reading reproduces: {reading: int}. of: as `read` has it"""
    mine = [one for one in of.values() if one.table == table]
    return {
        reading: sum(
            moments.judged(one, "").verdict == Verdict.REPRODUCED for one in mine if one.reading == reading
        )
        for reading in kept.READINGS
    }


def main(folder, samples, seed):
    """Table of the chunks in a folder."""
    experiment = registry.load(kept.RUN)
    store = keep.store(experiment, seed, folder)
    sizes = [size for size, _ in engine.chunks(experiment, samples, seed)]
    results = [store.load(k, size) for k, size in enumerate(sizes)]
    if any(one is None for one in results):
        raise SystemExit(f"{folder} does not hold all {len(sizes)} chunks of {samples} samples")
    command = f"shefex-nav reproduce {kept.RUN} --samples {samples} --seed {seed}"
    made_by = f"(shefex_nav {__version__}, code {store.head['code']})"
    write(kept.PATH, f"{command} {made_by}", pixels.figures(results))
    print(f"wrote {kept.PATH}")
    print("\n".join(halves(results)))


def halves(results):
    """The reading that reproduces most published figures on one half of the chunks, on the other: lines."""
    parts = [{one[:5]: one for one in pixels.figures(half)} for half in (results[::2], results[1::2])]
    out = []
    for table in moments.TABLES:
        for chooses, judges in (parts, parts[::-1]):
            there, here = reached(table, chooses), reached(table, judges)
            reading, counts = max(there, key=there.get), list(here.values())
            words = f"{there[reading]} where it was chosen, {here[reading]} on the other half"
            out.append(f"{table}: {reading}: {words} (best {max(counts)}, median {np.median(counts):g})")
    return out


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
