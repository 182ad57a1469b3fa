"""The published check-cases, where they are at hand."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def nesc_data():
    """Folder of the NESC check-cases beside this project."""
    folder = ROOT.parent / "shared" / "data" / "nesc"
    if not folder.is_dir():
        pytest.skip(f"the NESC trajectories are not at {folder}; they are not part of this project")
    return folder
