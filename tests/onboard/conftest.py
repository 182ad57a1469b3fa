"""The chain is also tested on frames of the simulated camera, which the tests of the world set up."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "world"))
