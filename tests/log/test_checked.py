"""Impossible records of a log: refused with topic, message and field."""

from types import SimpleNamespace
from typing import Annotated, NamedTuple

import numpy as np
import pytest
import synthetic_run

from shefex_nav.fields import Column
from shefex_nav.instruments import TABLE
from shefex_nav.instruments.instrument import Instrument
from shefex_nav.log import checked
from shefex_nav.log.run_data import RunDataBuilder, stack
from shefex_nav.log.topics import LogError
from shefex_nav.records import GateResult, GpsRanges, Reason, row
from shefex_nav.replay.dataset import NONSENSE

OPTIONS = synthetic_run.Options(start_s=231.0, end_s=236.0)
WRONG = (
    ("truth", "t_s", np.nan, r"got \[nan\], expected numbers below 2e\+09"),
    ("truth", "r_i", np.inf, "got .*inf.*, expected numbers"),
    ("truth", "f_b", 1e16, r"got .*1.e\+16.*, expected numbers"),
    ("truth", "q_ib", 0.0, "got .*, expected a unit quaternion"),
    ("nav", "v_i", np.nan, "got .*nan.*, expected numbers"),
    ("nav", "q_ib", 0.9, "got .*0.9 0.9.*, expected a unit quaternion"),
    ("imu", "dtheta_b", np.nan, "got .*nan.*, expected numbers"),
    ("covariance", "P", 1e9, "got .*, expected a covariance"),  # of rank one
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
    with pytest.raises(LogError, match=rf"message 3: {name}: got .* after .*, expected a larger number"):
        check(changed(arrays, name, 2, getattr(arrays, name)[1]))


def test_pictures_of_one_time_are_named(data):
    first, second, *others = data.frame_truths
    for t_s in (first.t_valid_s, first.t_valid_s - 1.0):
        given = [first, second._replace(t_valid_s=t_s), *others]
        with pytest.raises(
            LogError, match=r"message 2: t_valid_s: got .* after .*, expected a larger number"
        ):
            check(given, type(first))


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


def test_no_number_of_any_record_is_infinite(data):
    """Of those that may be NaN too: a protection level, the limit of a gate, the covariance of a state."""
    for bad in (np.inf, -np.inf, 1e300):
        kinds = ("nav", "angle_of_attack"), ("nav", "protection_attitude"), ("covariance", "P")
        for kind, name in kinds:
            if name.startswith("protection") and bad == np.inf:  # nothing is known, says own software so
                check(changed(getattr(data, kind), name, 2, bad))
                continue
            with pytest.raises(
                LogError, match=rf"message 3: {name}: got .*, expected numbers below 1e\+30, or"
            ):
                check(changed(getattr(data, kind), name, 2, bad))
        gate = GateResult(1.0, 1.0, 0, 3, 2.0, 7.8, True, False, np.ones(3))
        check([gate, gate._replace(limit=np.nan)], GateResult)
        with pytest.raises(
            LogError, match=r"message 2: limit: got .*, expected numbers below 1e\+30, or NaN"
        ):
            check([gate, gate._replace(limit=bad)], GateResult)
        with pytest.raises(
            LogError, match=r"message 1: camera\.cx_px: got .*, expected numbers below 1e\+15"
        ):
            mission = synthetic_run.mission()
            check([mission._replace(camera=mission.camera._replace(cx_px=bad))], type(mission))


TILT = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # turned, and left-handed
IMPOSSIBLE = (
    ("truth", "phase", 99, r"got \[99\], expected one of 0 to"),
    ("nav", "doubt_position", 77, "expected one of"),
    ("nav", "sigma_r_e", -1.0, "expected none below 0"),
    ("nav", "protection_attitude", 0.0, "expected all above 0"),
    ("truth", "r_i", 1.0, r"got 1.732 m from the centre of the Earth, expected 6.3e\+06 m at least"),
    ("imu", "dt_s", 0.0, "expected 1e-06 to 100"),
    ("imu", "t_valid_s", 0.0, "got 0 after .*, expected a larger number"),
    ("frames", "bits", 0, "expected 1 to 16"),
    ("frames", "exposure_s", -1.0, "expected 0 to 10000"),
    ("covariance", "P", np.eye(9) - 2.0 * np.diag(np.eye(9)[4]), "expected a covariance"),
    ("covariance", "P", np.eye(9) + 1.1 * np.eye(9, k=1) + 1.1 * np.eye(9, k=-1), "expected a covariance"),
    ("covariance", "P", np.eye(9) + 0.5 * np.eye(9, k=1), "expected a covariance"),
)


@pytest.mark.parametrize("kind, name, value, words", IMPOSSIBLE)
def test_values_that_cannot_be_are_named(data, kind, name, value, words):
    with pytest.raises(LogError, match=rf"message 3: {name}: .*{words}"):
        check(changed(getattr(data, kind), name, 2, value))


def test_what_the_mission_cannot_be_is_named():
    good = synthetic_run.mission()
    check([good], type(good))
    wrong = {
        "C_bc": good._replace(C_bc=TILT),
        "earth.C_iq": good._replace(earth=good.earth._replace(C_iq=5.0 * np.eye(3))),
        "earth.rate": good._replace(earth=good.earth._replace(rate=1e9)),
        "launch_latitude": good._replace(launch_latitude=100.0),
        "camera.focal_length_px": good._replace(camera=good.camera._replace(focal_length_px=-2500.0)),
    }
    for name, bad in wrong.items():
        with pytest.raises(LogError, match=rf"message 1: {name}: got .*, expected"):
            check([bad], type(good))


def test_star_fixes_and_blocks_that_cannot_be_are_named(data):
    solved = next(one for one in data.star_fixes if one.reason == Reason.NONE)
    for name, bad in (("reason", 77), ("P_c", -np.ones((3, 3)))):
        with pytest.raises(LogError, match=rf"message 2: {name}: got .*, expected"):
            check([solved, solved._replace(**{name: bad})], type(solved))
    block = row(data.imu, 3)
    for n in (0, 2000):
        bad = block._replace(dtheta_b=np.zeros((n, 3)), dv_b=np.zeros((n, 3)))
        with pytest.raises(LogError, match=rf"message 1: dtheta_b: got {n} samples, expected 1 to 1000"):
            check([bad], type(block))


def test_what_flies_fast_and_what_recorders_write_can_be(data):
    """A rocket of 20 turns a second; a number of satellites that a replay has found to be nonsense."""
    truth, fix = data.frame_truths[0], data.gps[0]
    check([truth._replace(rate=40.0 * np.pi)], type(truth))
    check([fix._replace(n_satellites=NONSENSE)], type(fix))


class Own(NamedTuple):
    """What a plug-in reads: names of the program's records, other meanings."""

    t_valid_s: Annotated[float, Column("s", "")]
    t_available_s: Annotated[float, Column("s", "")]
    rate: Annotated[float, Column("rad/s", "signed")]
    P: Annotated[np.ndarray, Column("Pa", "of three ports", (3,))]
    sigma: Annotated[float, Column("", "skew")]
    height: Annotated[float, Column("m", "infinite without an echo")]


def test_readings_of_a_plug_in_are_its_own_but_for_their_times(monkeypatch):
    monkeypatch.setitem(TABLE, "own", Instrument("own", None, Own, None))
    reading = Own(1.0, 1.1, -3.0, np.array([-1.0, 2.0, 1e40]), -0.5, np.inf)
    check([reading], Own)
    check(stack(Own, [reading, reading]))
    with pytest.raises(LogError, match=r"message 1: t_valid_s: got \[nan\]"):
        check([reading._replace(t_valid_s=np.nan)], Own)
    barometer = TABLE["barometer"].record(1.0, 1.1, np.inf)
    with pytest.raises(LogError, match=r"message 1: pressure: got .*inf"):
        check([barometer], type(barometer))


def test_a_time_far_away_is_named(data):
    """What is computed once a second would fill the memory."""
    with pytest.raises(LogError, match=r"t_s: goes from 231.* to 1000000000 s, expected 1e\+06 s at most"):
        check(changed(data.truth, "t_s", -1, 1e9))


def test_a_time_that_no_log_holds_is_named(data):
    """As nanoseconds it has more than 64 bits; a replay would write it."""
    fixes = [data.gps[0], data.gps[0]._replace(t_valid_s=1e14)]
    with pytest.raises(
        LogError, match=r"message 2: t_valid_s: got \[1\.e\+14\], expected numbers below 2e\+09"
    ):
        check(fixes, type(fixes[0]))


def test_lists_that_should_be_of_one_length_are_named(data):
    rows = [row(data.covariance, k) for k in range(3)]
    rows = [
        one._replace(estimates=np.zeros(n), sigmas=np.zeros(2))
        for one, n in zip(rows, (2, 2, 3), strict=True)
    ]
    with pytest.raises(ValueError, match=r"^estimates has 2 rows in one, 3 in another$"):
        stack(type(rows[0]), rows)


TEXTS = {"scenario": "a", "seed": "1", "version": "0.1.0", "epoch_utc": "2012-06-22T19:18:00"}
WRONG_TEXTS = (
    ("seed", "-1", "got '-1', expected a whole number of 30 digits at most"),
    ("seed", "9" * 31, "expected a whole number of 30 digits at most"),
    ("epoch_utc", "yesterday", "got 'yesterday', expected an instant of 1973 to 2100"),
    ("epoch_utc", "0001-01-01", "got '0001-01-01', expected an instant of 1973 to 2100"),
    ("plugins", "[[1]]", r"got '\[\[1\]\]', expected a list of lists of 2 texts"),
    ("software", "{", r"got '\{', expected a list of lists of 3 texts"),
    ("distortion", "[1, 2]", r"got '\[1, 2\]', expected a list of 5 numbers"),
    ("distortion", "[1, 2, 3, 4, NaN]", "expected a list of 5 numbers"),
)


def described_mission(metadata, attachments):
    raw = SimpleNamespace(metadata=metadata, attachments=attachments)
    return checked.mission("a.mcap", synthetic_run.mission(), raw)


def test_texts_of_the_metadata_are_those_of_the_mission():
    lists = {"plugins": '[["a.py", "00"]]', "distortion": "[0, 0.1, 0, 0, 0]"}
    found = described_mission(TEXTS | lists, {"scenario.yaml": b"mission: {}"})
    assert (found.seed, found.scenario_text) == (1, "mission: {}")
    assert (
        found.plugins == (("a.py", "00"),) and found.distortion == (0, 0.1, 0, 0, 0) and found.software == ()
    )


@pytest.mark.parametrize("key, text, words", WRONG_TEXTS)
def test_texts_of_the_metadata_that_cannot_be_meant_are_named(key, text, words):
    with pytest.raises(LogError, match=rf"^a\.mcap: metadata 'shefex_nav': {key}: .*{words}"):
        described_mission(TEXTS | {key: text}, {"scenario.yaml": b""})


@pytest.mark.parametrize("key", TEXTS)
def test_a_text_that_is_missing_is_named(key):
    less = {other: text for other, text in TEXTS.items() if other != key}
    with pytest.raises(LogError, match=f"{key} is missing"):
        described_mission(less, {"scenario.yaml": b""})
    with pytest.raises(LogError, match=r"no attachment scenario\.yaml"):
        described_mission(TEXTS, {})
