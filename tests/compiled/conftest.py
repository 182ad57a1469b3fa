"""The package of two small files of kernels, as tests want it."""

import pytest
from kernel_package import Package


@pytest.fixture
def package(tmp_path):
    """Two files of kernels, and an empty cache."""
    return Package(tmp_path / "one", tmp_path / "cache")


@pytest.fixture(scope="session")
def compiled_package(tmp_path_factory):
    """The same, run once: (Package, Result). Not to be edited; its cache not to be spoilt."""
    folder = tmp_path_factory.mktemp("kernels")
    one = Package(folder / "one", folder / "cache")
    return one, one.run()
