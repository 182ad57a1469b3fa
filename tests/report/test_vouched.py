"""A met requirement beside a quantity that is not usable: one sentence that says why both are true."""

import pytest

from shefex_nav.report import trust
from shefex_nav.report.requirements import Judged

MET = Judged("attitude_at_entry", 0.1, 0.032, "deg", True)
POINTED = Judged("attitude_while_pointing", 0.1, 0.037, "deg", True)


def integrity(share, *, usable=False, doubt="level"):
    said = {
        "usable_share": share,
        "limit_deg": 0.1,
        "limit_by_default": False,
        "doubts": {doubt: 1.0 - share},
    }
    entry = {"usable": usable, "doubt": "none" if usable else doubt, "protection_deg": [0.133, 0.134, 0.132]}
    other = {"usable_share": 0.9, "doubts": {}, "at_entry": {"usable": True}}
    return {"position": other, "velocity": other, "attitude": said | {"at_entry": entry}}


def said(judged, trusted):
    errors = {"attitude_sigma_deg": [0.0202, 0.0201, 0.0198]}
    return dict(trust.vouched({"navigation": {"integrity": trusted, "at_entry": errors}}, judged))


def test_it_says_that_the_level_is_above_the_limit_and_what_makes_it_large():
    words = said([MET, POINTED], integrity(0.0))["attitude"]
    assert words.startswith(
        "both are true: the error was small, but the computer on board cannot vouch for it"
    )
    parts = ["At entry: protection level above 0.1 deg (requirements.attitude.limit)", "0.134 deg"]
    parts += ["a sigma of 0.020 deg", "requirements.integrity_risk", "requirements.attitude.limit larger"]
    for part in parts:
        assert part in words


def test_while_pointing_the_share_of_the_time_is_said():
    words = said([POINTED], integrity(0.02))["attitude"]
    assert "For 98.0 % of the time: protection level above 0.1 deg" in words


def test_another_doubt_has_its_own_words_and_no_advice_about_levels():
    words = said([MET], integrity(0.3, doubt="imu"))["attitude"]
    assert words.endswith("At entry: the IMU does not measure the motion")


@pytest.mark.parametrize(
    ("judged", "trusted"),
    [
        ([MET], integrity(0.4, usable=True)),
        ([POINTED], integrity(0.4)),
        ([MET._replace(passed=False)], integrity(0.0)),
        ([], integrity(0.0)),
        ([MET], None),
    ],
)
def test_nothing_is_said_where_nothing_contradicts(judged, trusted):
    assert said(judged, trusted) == {}
