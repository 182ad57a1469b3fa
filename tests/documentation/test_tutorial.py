"""What the tutorial prints about its own scenario is what comes out."""

import page_blocks
import pytest
from page_session import ROOT

from shefex_nav import prepare
from shefex_nav.report import programme
from shefex_nav.scenario import load

PAGE = (ROOT / "docs" / "tutorial.md").read_text()


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """Name of the reader's own scenario, in a folder that looks like the project."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    for block in page_blocks.blocks(PAGE, "tutorial"):
        if block.kind == "file":
            (tmp_path / block.file).write_text(block.text)
    monkeypatch.chdir(tmp_path)
    return "mine.yaml"


def test_the_programme_of_the_page_fits_its_flight(mine):
    scenario = load.load(mine)
    flight = prepare.fly_vehicle(scenario, 1)
    assert programme.warnings(scenario, programme.of_flight(flight)) == ()
    at = {event.name: event for event in flight.events}
    yours = {name: row.split("|")[3].strip() for name, row in _rows().items()}
    assert yours["apogee"] == f"{at['apogee'].altitude_m / 1e3:.1f} km"
    assert yours["entry, through 100 km"] == f"T{at['entry'].t_s:+.1f} s"


def _rows():
    """{name: line} of the table that compares the two flights."""
    lines = [line for line in PAGE.splitlines() if line.startswith("| ")]
    return {line.split("|")[1].strip(): line for line in lines}


def test_the_warnings_of_the_page_are_those_of_the_program(mine):
    scenario = load.load(mine, ["launch.elevation=82 deg"])
    told = [f"warning: {scenario.line_about(one.field, one.text)}" for one in programme.foreseen(scenario)]
    printed = "\n".join([*told, f"mine.yaml: good, with {len(told)} warnings"])
    assert len(told) == 5 and f"```text\n{printed}\n```" in PAGE
