"""Short flights, exported once for all tests of frames."""

import pytest
from exported_frames import DEEP, SEED, exported


@pytest.fixture(scope="session")
def still(tmp_path_factory):
    """PNG of 12 bits of a camera at rest on the ground."""
    return exported(tmp_path_factory.mktemp("still") / "frames", "night_sky", DEEP, SEED, 4.0)


@pytest.fixture(scope="session")
def turning(tmp_path_factory):
    """FITS of 12 bits of a camera in orbit that turns at up to 8 deg/s."""
    return exported(
        tmp_path_factory.mktemp("turning") / "frames", "high_rate", DEEP, SEED, 24.0, every=4, kind="fits"
    )
