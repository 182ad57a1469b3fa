"""Makes the covering design of `shefex-nav verify robustness` anew, from its levels and a fixed seed.

uv run python benchmarks/robustness_design.py [--check]

Writes shefex_nav/verify/robustness/design.csv; with --check it is compared, exit code 1 if it differs.
"""

import argparse
import sys
from pathlib import Path

import covering_array

from shefex_nav.verify.robustness import design
from shefex_nav.verify.robustness.factors import TOLD
from shefex_nav.verify.robustness.happenings import HAPPENS, STARS

CELLS, SEED = 400, 20120622
PATH = Path(design.__file__).parent / design.FILE


WITH_STARS = ("shefex2_andoya",)


def possible(levels):
    """Whether levels can meet. dict, factor -> level, of some or all factors."""
    stars = TOLD[levels["told"]].needs_stars if "told" in levels else False
    stars |= HAPPENS[levels["happens"]].device == STARS if "happens" in levels else False
    if stars and levels.get("rocket") not in (None, *WITH_STARS):
        return False
    seen_stars = "happens" in levels and HAPPENS[levels["happens"]].device == STARS
    return not (seen_stars and levels.get("phase") not in (None, "quiet"))  # the camera is off elsewhere


def text():
    """Contents of the file."""
    table = covering_array.array(design.FACTORS, possible, CELLS, SEED)
    head = ["cell", *design.FACTORS]
    rows = [[str(k), *(row[name] for name in design.FACTORS)] for k, row in enumerate(table)]
    return "\n".join(",".join(row) for row in [head, *rows]) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    given, made = parser.parse_args(), text()
    if given.check:
        return int(made != PATH.read_text())
    PATH.write_text(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
