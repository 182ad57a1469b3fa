"""Write the table of `impa-pixels` that the package keeps, from the chunks of its command.

    shefex-nav reproduce impa-pixels --samples 650 --seed 1 --keep FOLDER
    python benchmarks/keep_impa_pixels.py FOLDER 650 1

Chunks of other code, another seed or another size are refused. It also prints, table by table, what
comes of choosing the reading on every second chunk and counting the published figures that it reproduces on
the others.
"""

import sys

import numpy as np

from shefex_nav import __version__
from shefex_nav.papers import engine, keep, registry
from shefex_nav.papers.impa import kept, moments, pixel_tables


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
    kept.write(kept.PATH, f"{command} {made_by}", pixel_tables.figures(results))
    print(f"wrote {kept.PATH}")
    print("\n".join(halves(results)))


def halves(results):
    """The reading that reproduces most published figures on one half of the chunks, on the other: lines."""
    parts = [{one[:5]: one for one in pixel_tables.figures(half)} for half in (results[::2], results[1::2])]
    out = []
    for table in moments.TABLES:
        for chooses, judges in (parts, parts[::-1]):
            there, here = kept.reached(table, chooses), kept.reached(table, judges)
            reading, counts = max(there, key=there.get), list(here.values())
            words = f"{there[reading]} where it was chosen, {here[reading]} on the other half"
            out.append(f"{table}: {reading}: {words} (best {max(counts)}, median {np.median(counts):g})")
    return out


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
