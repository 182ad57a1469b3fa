"""The made-up mission of tests/log serves the report's tests too."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "log"))


@pytest.fixture(scope="session")
def log(tmp_path_factory):
    """Log of ten seconds in which the star tracker works; tests copy what they change."""
    import recorded

    return recorded.write(tmp_path_factory.mktemp("view") / "run.mcap")
