"""What a log says that cannot be meant: refused with topic, message and field."""

import numpy as np
import pytest
import synthetic_run

from shefex_nav.log import checked
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.topics import LogError
from shefex_nav.records import GpsRanges, Reason

OPTIONS = synthetic_run.Options(start_s=231.0, end_s=236.0)
WRONG = (
    ("truth", "t_s", np.nan, r"got \[nan\], expected numbers below 1e\+15"),
    ("truth", "r_i", np.inf, "got .*inf.*, expected numbers"),
    ("truth", "f_b", 1e16, r"got .*1.e\+16.*, expected numbers"),
    ("truth", "q_ib", 0.0, "got .*, expected a unit quaternion"),
    ("nav", "v_i", np.nan, "got .*nan.*, expected numbers"),
    ("nav", "q_ib", 0.9, "got .*0.9 0.9.*, expected a unit quaternion"),
    ("imu", "dtheta_b", np.nan, "got .*nan.*, expected numbers"),
    ("imu", "t_valid_s", 1e300, r"got .*e\+300.*, expected numbers"),
    ("frames", "exposure_s", np.nan, "got .*nan.*, expected numbers"),
)


@pytest.fixture(scope="module")
def data():
    builder = RunDataBuilder(synthetic_run.mission(start_s=OPTIONS.start_s))
    for record in synthetic_run.simulate(OPTIONS):
        builder.add(record)
    return builder.build()


def check(given, record=None):
    checked.check("a.mcap", "/topic", record or type(given), given)


def changed(arrays, name, row, value):
    values = getattr(arrays, name).copy()
    values[row] = value
    return arrays._replace(**{name: values})


def test_what_was_flown_can_be_meant(data):
    for name in ("truth", "nav", "imu", "covariance", "frames", "control"):
        check(getattr(data, name))
    for rows in (data.gps, data.star_fixes, data.frame_truths):
        assert rows
        check(rows, type(rows[0]))


@pytest.mark.parametrize("kind, name, value, words", WRONG)
def test_numbers_that_are_none_are_named(data, kind, name, value, words):
    with pytest.raises(LogError, match=rf"^a\.mcap: /topic: message 3: {name}: {words}"):
        check(changed(getattr(data, kind), name, 2, value))


TIMES = ("truth", "t_s"), ("nav", "t_s"), ("covariance", "t_s"), ("frames", "number")


@pytest.mark.parametrize("kind, name", TIMES)
def test_times_that_do_not_go_on_are_named(data, kind, name):
    arrays = getattr(data, kind)
    with pytest.raises(LogError, match=rf"message 3: {name}: got .* after .*, expected more"):
        check(changed(arrays, name, 2, getattr(arrays, name)[1]))


def test_lists_of_any_length_are_looked_at(data):
    nothing, nowhere = np.zeros(0), np.zeros((0, 3))
    none = GpsRanges(1.0, 1.2, np.zeros(0, int), nothing, nothing, nowhere, nowhere, nothing, nothing)
    three = none._replace(pseudorange=np.full(3, 2e7), r_es_e=np.full((3, 3), 1e7))
    check([none, three, three._replace(pseudorange=np.full(2, 2e7))], GpsRanges)
    for bad in (np.nan, np.inf, 1e16):
        with pytest.raises(LogError, match=r"message 2: r_es_e: got .*, expected numbers"):
            check([none, three._replace(r_es_e=np.full((3, 3), bad))], GpsRanges)
    check([], GpsRanges)


def test_what_says_itself_that_it_is_none_may_be_nan(data):
    """A block without an answer, a fix without a solution, a frame without an attitude; protection levels."""
    check(changed(changed(data.imu, "dv_b", 2, np.nan), "valid", 2, False))
    check(changed(data.nav, "protection_attitude", 2, np.nan))
    fixes, nothing = list(data.gps), np.full(3, np.nan)
    fixes[1] = fixes[1]._replace(r_ea_e=nothing, valid=False)
    check(fixes, type(fixes[0]))
    fixes[1] = fixes[1]._replace(valid=True)
    with pytest.raises(LogError, match=r"/topic: message 2: r_ea_e: got .*, expected numbers"):
        check(fixes, type(fixes[0]))
    solved = next(one for one in data.star_fixes if one.reason == Reason.NONE)
    unsolved = solved._replace(q_ic=np.full(4, np.nan), reason=int(Reason.TOO_FEW_STARS))
    check([solved, unsolved], type(solved))
    with pytest.raises(LogError, match=r"message 2: q_ic: got .*, expected a unit quaternion"):
        check([solved, solved._replace(q_ic=2.0 * solved.q_ic)], type(solved))
