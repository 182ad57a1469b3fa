"""Methods are tested on fields of stars as the chain on board is."""

import sys
from pathlib import Path

from shefex_nav import plugins  # noqa: F401 the methods of the papers are known by their names

TESTS = Path(__file__).parents[1]
sys.path += [str(TESTS / "onboard"), str(TESTS / "world")]
