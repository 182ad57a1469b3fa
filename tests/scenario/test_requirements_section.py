"""The section about what a mission requires."""

import math
from types import SimpleNamespace

import pytest
from broken import DEFAULT, the_message

from shefex_nav.records import QUANTITIES
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
    said, limits = wanted.model_dump(), []
    for quantity in QUANTITIES:
        block = said.pop(quantity)
        limits.append(block.pop("limit"))
        assert set(block.values()) == {False}
    assert limits == pytest.approx([100.0, 1.0, math.radians(0.17)])
    assert said.pop("integrity_risk") == pytest.approx(1e-5)  # for which the levels are made
    assert said.pop("probability") == pytest.approx(0.99865)  # for which `trade` predicts
    assert said.pop("confidence") == pytest.approx(0.9)  # with which a campaign verifies
    assert set(said.values()) == {None, False}


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
        (
            ["requirements.attitude=0.1 deg"],
            "requirements.attitude",
            "got '0.1 deg'; its keys are limit, at_entry, while",
        ),
        (["requirements.usable_at_entry=1"], "usable_at_entry", "true or false"),
        (["requirements.positiom.limit=1 m"], "positiom", "position"),
        (["requirements.position.limit=3 m/s"], "position.limit", "expected a length"),
        (["requirements.velocity.limit=0 m/s"], "velocity.limit", "greater than zero"),
        (["requirements.integrity_risk=1e-5"], "integrity_risk", "'1e-05 /h'"),
        (["requirements.integrity_risk=0 /h"], "integrity_risk", "greater than zero"),
        (["requirements.integrity_risk=1000 /h"], "integrity_risk", "at most 100 /h"),
        (
            ["requirements.position_at_entry=80 m"],
            "requirements.position_at_entry",
            "has moved; write 'requirements.position: {limit: 80 m, at_entry: true}'",
        ),
        (
            ["requirements.velocity_at_entry=null"],
            "requirements.velocity_at_entry",
            "has moved; write 'requirements.velocity: {at_entry: false}'",
        ),
        (
            ["navigation.integrity.risk=1e-5"],
            "navigation.integrity.risk",
            "has moved; write 'requirements.integrity_risk: 1e-5 /h'",
        ),
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
    """What is required of a quantity is what the watch on board compares its protection level with."""
    own = "position.limit=7 m", "velocity.limit=0.2 m/s", "attitude.limit=0.05 deg"
    scenario = load(DEFAULT, [f"requirements.{text}" for text in own])
    limits = 7.0, 0.2, math.radians(0.05)
    assert params_onboard.nav_params(scenario).integrity.wanted.limits == pytest.approx(limits)
    found = requirements.limits(scenario.requirements)
    assert [found[f"{quantity}_at_entry"] for quantity in QUANTITIES] == [7.0, 0.2, 0.05]
    log = SimpleNamespace(scenario_text=scenario.source, sun_exclusion=math.nan, limb_exclusion=math.nan)
    assert configured.configured(SimpleNamespace(mission=log, events=())).limits == pytest.approx(
        dict(zip(QUANTITIES, limits, strict=True))
    )
