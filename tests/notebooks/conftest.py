"""The short campaign of tests/campaign serves the notebooks too: its runs are flown in this process."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "campaign"))
