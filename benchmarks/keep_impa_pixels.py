"""Write the table of `impa-pixels` that the package keeps, from the chunks of its command.

    shefex-nav reproduce impa-pixels --samples 650 --seed 1 --keep FOLDER
    python benchmarks/keep_impa_pixels.py FOLDER 650 1

Chunks of other code, another seed or another size are refused.
"""

import sys

from shefex_nav import __version__
from shefex_nav.papers import engine, keep, registry
from shefex_nav.papers.impa import kept, pixel_tables


def main(folder, samples, seed):
    """Table of the chunks in a folder."""
    experiment = registry.load(kept.RUN)
    store = keep.store(experiment, seed, folder)
    sizes = [size for size, _ in engine.chunks(experiment, samples, seed)]
    results = [store.load(k, size) for k, size in enumerate(sizes)]
    if any(one is None for one in results):
        raise SystemExit(f"{folder} does not hold all {len(sizes)} chunks of {samples} samples")
    command = f"shefex-nav reproduce {kept.RUN} --samples {samples} --seed {seed} (shefex_nav {__version__})"
    kept.write(kept.PATH, command, pixel_tables.figures(results))
    print(f"wrote {kept.PATH}")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
