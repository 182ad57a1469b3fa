"""The short flight of the filter's tests serves those of its logs too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "onboard"))
