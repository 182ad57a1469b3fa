"""The chain is also tested on frames of the simulated camera, which the tests of the world set up."""

import sys
from pathlib import Path

import shefex_nav.plugins  # noqa: F401 which adds the methods of the papers

sys.path.append(str(Path(__file__).parents[1] / "world"))
