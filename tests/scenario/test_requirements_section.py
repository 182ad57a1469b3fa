"""The section about what a mission requires."""

import math
from types import SimpleNamespace

import pytest
from broken import DEFAULT, the_message

from shefex_nav.report import configured, requirements
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.load import load, load_text


def test_limits_are_read_with_their_units():
    wanted = load(
        DEFAULT, ["requirements.attitude.limit=12 arcmin", "requirements.apogee=170 km"]
    ).requirements
    assert wanted.attitude.limit == pytest.approx(math.radians(0.2))
    assert wanted.apogee == 170e3
    assert wanted.usable_at_entry is True and wanted.cold_gas is None


def test_nothing_is_required_where_nothing_is_said():
    wanted = load(DEFAULT.with_name("orbit.yaml")).requirements
    assert wanted.attitude.limit == pytest.approx(math.radians(0.17))  # of the computer on board
    assert set(wanted.model_dump(exclude={"attitude": {"limit"}}).pop("attitude").values()) == {False}
    assert set(wanted.model_dump(exclude={"attitude"}).values()) == {None, False}


def test_the_text_that_a_campaign_keeps_has_them():
    one = load(DEFAULT)
    assert load_text(one.source, "kept").requirements == one.requirements


@pytest.mark.parametrize(
    ("overrides", "field", "words"),
    [
        (["requirements.attitude.limit=0.17"], "attitude.limit", "has no unit"),
        (["requirements.attitude.limit=3 m"], "attitude.limit", "expected an angle"),
        (["requirements.attitude.limit=0 deg"], "attitude.limit", "greater than zero"),
        (["requirements.attitude.at_entry=yes please"], "attitude.at_entry", "true or false"),
        (["requirements.attitude=0.1 deg"], "requirements.attitude", "section with keys of its own"),
        (["requirements.usable_at_entry=1"], "usable_at_entry", "true or false"),
        (["requirements.position_at_entri=1 m"], "position_at_entri", "position_at_entry"),
        (
            ["requirements.attitude_at_entry=0.1 deg"],
            "requirements.attitude_at_entry",
            "has moved; write 'requirements.attitude: {limit: 0.1 deg, at_entry: true}'",
        ),
        (
            ["requirements.protection_at_entry=0.1 deg"],
            "requirements.protection_at_entry",
            "has moved; write 'requirements.attitude: {limit: 0.1 deg, protection_at_entry: true}'",
        ),
        (
            ["navigation.integrity.attitude=0.1 deg"],
            "navigation.integrity.attitude",
            "has moved; write 'requirements.attitude: {limit: 0.1 deg}'",
        ),
        (
            ["requirements.attitude_at_entry=null"],
            "requirements.attitude_at_entry",
            "has moved; write 'requirements.attitude: {at_entry: false}'",
        ),
    ],
)
def test_what_cannot_be_is_refused(overrides, field, words):
    said = the_message(DEFAULT, overrides)
    assert field in said and words in said, said


def test_a_file_that_takes_away_what_has_moved_is_told_so(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(f"extends: {DEFAULT}\nrequirements:\n  attitude_at_entry: null\n", encoding="utf-8")
    said = the_message(path)
    assert f"{path}:3:" in said and "requirements.attitude_at_entry: has moved" in said, said
    assert "{at_entry: false}" in said


def test_whatever_is_required_a_mission_without_star_tracker_may_be_flown():
    assert load(DEFAULT, ["star_tracker.enabled=false"]).requirements.star_fixes == pytest.approx(0.95)


def test_one_limit_for_the_mission_the_computer_and_the_reports():
    """What is required of the attitude is what the watch on board compares the protection level with."""
    scenario = load(DEFAULT, ["requirements.attitude.limit=0.05 deg"])
    limit = math.radians(0.05)
    assert params_onboard.nav_params(scenario).integrity.wanted.attitude == pytest.approx(limit)
    assert requirements.limits(scenario.requirements)["attitude_at_entry"] == 0.05
    log = SimpleNamespace(scenario_text=scenario.source, sun_exclusion=math.nan, limb_exclusion=math.nan)
    assert configured.configured(SimpleNamespace(mission=log, events=())).attitude_rad == pytest.approx(limit)
