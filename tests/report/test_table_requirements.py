"""What the closing table says of the requirements of a scenario."""

import pytest
from typer.testing import CliRunner

from shefex_nav import cli
from shefex_nav.report import table
from shefex_nav.report.requirements import Judged

JUDGED = [
    Judged("attitude_at_entry", 0.17, 0.0052, "deg", True),
    Judged("wrong_star_fixes", 0, 3, "", False),
    Judged("position_at_entry", 100.0, None, "m", False),
]


@pytest.mark.parametrize(("is_part", "last"), [(False, "not met"), (True, "not reached")])
def test_each_requirement_is_a_line(is_part, last):
    lines = {name: str(value) for name, value in table._requirement_rows(JUDGED, is_part)}
    assert lines == {
        "attitude at entry": "0.0052 deg, wanted at most 0.17 deg: met",
        "wrong star fixes": "3, wanted at most 0: not met",
        "position at entry": f"not measured, wanted at most 100 m: {last}",
    }


def test_run_and_report_say_whether_requirements_are_met(tmp_path):
    """Twelve seconds of stars on the ground, which fixes every frame but has no entry."""
    log = tmp_path / "sky.mcap"
    wanted = "requirements={star_fixes: 90 %, attitude_at_entry: 0.17 deg}"
    ends = ["--set", "mission.time_limit=12 s", "--set", "star_tracker.off=12 s"]
    settings = [*ends, "--set", wanted]
    flown = CliRunner().invoke(cli.app, ["run", "scenarios/night_sky.yaml", "--out", str(log), *settings])
    read = CliRunner().invoke(cli.app, ["report", str(log)])
    for result in (flown, read):
        assert result.exit_code == 0, result.output
        said = " ".join(result.stdout.split())
        assert "star fixes" in said and "wanted at least 90 %: met" in said
        assert "not measured, wanted at most 0.17 deg: not met" in said
