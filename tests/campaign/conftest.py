"""The short campaign that a file of tests looks at; how many runs it has, the file says in RUNS."""

import pytest
from short_campaign import fly, write

from shefex_nav.scenario import load


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    """The short mission."""
    return load.load(write(tmp_path_factory.mktemp("scenario")))


@pytest.fixture(scope="module")
def whole(request, scenario, tmp_path_factory):
    """(folder, Ended) of a campaign that nothing disturbed."""
    folder = tmp_path_factory.mktemp("whole") / "campaign"
    return folder, fly(scenario, folder, request.module.RUNS)
