"""Pictures for the tests of `shefex_nav.solve`; the frames of a real camera are not part of the project."""

from pathlib import Path

import pytest

REAL = Path(__file__).parents[2].parent / "shared" / "data" / "real_images"


@pytest.fixture
def real_frames():
    """Folder with four real frames, or a skip."""
    if not REAL.is_dir():
        pytest.skip(f"no {REAL}: real frames are not part of the project")
    return REAL
