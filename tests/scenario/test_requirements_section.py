"""The section about what a mission requires."""

import math

import pytest
from broken import DEFAULT, the_message

from shefex_nav.scenario.load import load, load_text


def test_limits_are_read_with_their_units():
    wanted = load(
        DEFAULT, ["requirements.attitude_at_entry=12 arcmin", "requirements.apogee=170 km"]
    ).requirements
    assert wanted.attitude_at_entry == pytest.approx(math.radians(0.2))
    assert wanted.apogee == 170e3
    assert wanted.usable_at_entry is True and wanted.cold_gas is None


def test_nothing_is_required_where_nothing_is_said():
    wanted = load(DEFAULT.with_name("orbit.yaml")).requirements
    assert set(wanted.model_dump().values()) == {None, False}


def test_the_text_that_a_campaign_keeps_has_them():
    one = load(DEFAULT)
    assert load_text(one.source, "kept").requirements == one.requirements


@pytest.mark.parametrize(
    ("overrides", "field", "words"),
    [
        (["requirements.attitude_at_entry=0.17"], "attitude_at_entry", "has no unit"),
        (["requirements.attitude_at_entry=3 m"], "attitude_at_entry", "expected an angle"),
        (["requirements.usable_at_entry=1"], "usable_at_entry", "true or false"),
        (["requirements.atitude_at_entry=1 deg"], "atitude_at_entry", "attitude_at_entry"),
    ],
)
def test_what_cannot_be_is_refused(overrides, field, words):
    said = the_message(DEFAULT, overrides)
    assert field in said and words in said, said


def test_whatever_is_required_a_mission_without_star_tracker_may_be_flown():
    assert load(DEFAULT, ["star_tracker.enabled=false"]).requirements.star_fixes == pytest.approx(0.95)
