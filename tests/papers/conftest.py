"""Methods are tested on fields of stars as the chain on board is."""

import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path += [str(TESTS / "onboard"), str(TESTS / "world")]
