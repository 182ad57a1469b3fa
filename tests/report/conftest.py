"""The made-up mission of tests/log serves the report's tests too."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "log"))
