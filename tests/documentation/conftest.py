"""The short campaign of tests/campaign serves the pages too: its runs are flown in this process."""

import sys
from pathlib import Path

import plugin_tables
import pytest

sys.path.append(str(Path(__file__).parents[1] / "campaign"))


@pytest.fixture(autouse=True)
def without_plugins_of_other_pages():
    with plugin_tables.restored():
        yield
