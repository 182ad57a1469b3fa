"""Cases of the gate that flights meet rarely: groups of rows, doubtful receivers, insisting, doubts."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from shefex_nav.onboard.navigation import gate, integrity_gps
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.gate import Verdict
from shefex_nav.onboard.navigation.history import Corrections
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate, GpsEvidence, Limits, Steps
from shefex_nav.onboard.navigation.sensor import Innovation
from shefex_nav.records import GpsFix, Reason

ONE = np.eye(3)
USED = Verdict(Fate.USED, None, None, "", True)
RESET = USED._replace(fate=Fate.RESET)


def gps(t_s=0.0, v=(0.0, 0.0, 0.0)):
    return GpsFix(t_s, t_s, True, np.zeros(3), np.array(v), ONE, ONE, 8, 2.0, "")


def evidence(z, **fix):
    return GpsEvidence(gps(**fix), np.array(z), ONE)


def watch(**values):
    """A watch that notes what it is told, as its `pending`, by name and arguments."""
    said = []

    def note(name):
        return lambda *given: said.append((name, *given))

    told = SimpleNamespace(
        pending=said, unread=False, moved=Steps(), disputed=0.0, gps_drift=integrity_gps.QUIET,
        drift_limit=30.0, far=False, replaced=False,
        accept_velocity=note("velocity"), accept_position=note("position"),
        attitude_was_wrong=note("attitude"), accept=note("accept"), report=note("report"),
        learnt=SimpleNamespace(pushed=lambda t_s, x: 7.0, confirmed=note("confirmed")),
        gyros=SimpleNamespace(doubt=note("doubt"), forget=note("forget"), checked_s=np.nan),
    )  # fmt: skip
    for name, value in values.items():
        setattr(told, name, value)
    return told


def filter_of(health=None, **values):
    return SimpleNamespace(
        limits=Limits(1e-3), health=health or {}, watch=watch(**values),
        history=SimpleNamespace(ends_s=[0.0, 42.0], corrections=Corrections()),
        params=SimpleNamespace(lasting_share=0.0),
    )  # fmt: skip


LIMIT = stats.chi2.isf(1e-3, 2)


def test_refused_groups_are_named():
    rows = np.array([True, True, False, False, True, True])
    named = SimpleNamespace(rows=2, labels=lambda fix: ["G01", "G07", "G30"])
    assert gate._rejected(named, None, rows) == ["G07"]
    assert gate._rejected(SimpleNamespace(rows=2, labels=None), None, rows) == ["row 1"]


def test_a_result_counts_the_rows_that_were_used():
    nav = filter_of()
    nav.sensors = {"gps_range": SimpleNamespace(rows=1, labels=None, gate_probability=None)}
    S, z = np.diag([4.0, 9.0, 1.0]), np.array([2.0, 99.0, 3.0])
    measurement = SimpleNamespace(sensor="gps_range", fix=SimpleNamespace(t_valid_s=41.0))
    verdict = USED._replace(rows=np.array([True, False, True]), note="said")
    innovation = Innovation(z, None, None, S, 1e4, stats.chi2.isf(1e-3, 3))
    got = gate._result(nav, innovation, measurement, verdict)
    assert (got.t_s, got.t_valid_s, got.sensor, got.dof) == (42.0, 41.0, "gps_range", 2)
    assert got.nis == pytest.approx(1.0 + 9.0) and got.limit == pytest.approx(LIMIT)
    assert got.accepted and got.note == "said; rejected: row 1" and got.innovation.tolist() == [2.0, 3.0]
    got = gate._result(nav, innovation, measurement, USED._replace(fate=Fate.HELD))
    assert not got.accepted and got.nis == 1e4 and got.limit == pytest.approx(stats.chi2.isf(1e-3, 3))
    assert gate._result(nav, innovation, measurement, RESET).accepted


@pytest.mark.parametrize(
    "change, doubtful",
    [({}, True), ({"far": False}, False), ({"in_a_row": 5}, True), ({"in_a_row": 6}, False)],
)
def test_a_receiver_is_doubtful_while_its_velocities_have_just_been_refused(change, doubtful):
    record = HEALTHY._replace(
        **{"far": True, "in_a_row": 1, "evidence": evidence(np.ones(3), t_s=10.0), **change}
    )
    nav = filter_of({"gps_velocity": record})
    assert gate._receiver_is_doubtful(nav, gps(19.9)) == doubtful
    assert not gate._receiver_is_doubtful(nav, gps(20.1))  # ten seconds ago
    assert not gate._receiver_is_doubtful(nav, gps(11.0, (np.nan, 0.0, 0.0)))


X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    "z, far, narrow, insists",
    [
        (1.2 * X, False, False, True),  # the same offset, to half of it
        (3.0 * X, False, False, False),
        (3.0 * X, True, True, True),  # far off, to the same side, only just inside
        (3.0 * X, True, False, False),
        (3.0 * X, False, True, False),
        (3.0 * Y, True, True, False),
    ],
)
def test_a_velocity_insists_on_its_offset_or_on_its_side(z, far, narrow, insists):
    before = HEALTHY._replace(first=evidence(X), far=far, rejected=1)
    assert gate._insists("gps_velocity", before, evidence(z), narrow) == insists
    assert not gate._insists("star_tracker", before, evidence(z), narrow)


def test_a_position_insists_if_the_gate_has_widened_over_it():
    wide = GpsEvidence(gps(), X, 99.0 * ONE)
    for change, insists in (
        ({"rejected": 3}, True),
        ({"rejected": 2}, False),
        ({"rejected": 1, "far": True}, True),
    ):
        before = HEALTHY._replace(evidence=evidence(X), **change)
        assert gate._insists("gps_position", before, wide, False) == insists
        assert not gate._insists("gps_position", before, evidence(X), False)


NOW = SimpleNamespace(t_s=41.0, x=np.zeros(16), P=ONE, vibration=0.0, sensed_packed=np.arange(6.0), k=0)


def doubted(nav, name, verdict, nis=0.0, z=3.0 * X):
    return gate._doubted(nav, NOW, z, nis, name, verdict)


@pytest.fixture
def learnt(monkeypatch):
    """What would be doubted, named by its reason."""
    for name in ("by_stars", "by_velocity", "by_surprise"):
        monkeypatch.setattr(gate.integrity_learnt, name, lambda *a, name=name: (name, a[-1]))


def test_what_is_doubted_with_a_sensor_that_is_believed_at_last(learnt):
    """Stars: gyros and all that was learnt; velocities likewise; a position was wrong by itself."""
    nav = filter_of()
    assert doubted(nav, "star_tracker", RESET).doubts == ("by_stars", False)
    assert ("attitude", 3.0) in nav.watch.pending and ("doubt", 3.0) in nav.watch.pending
    assert doubted(filter_of(), "star_tracker", RESET._replace(admitted=1.0)).doubts == ("by_stars", True)
    nav = filter_of()
    assert doubted(nav, "gps_velocity", RESET).doubts[0] == "by_velocity"
    assert nav.watch.pending[0] == ("doubt",)
    assert nav.watch.pending[1][:2] == ("velocity", "gps_velocity") and nav.watch.pending[1][3] == 7.0
    assert doubted(filter_of(), "gps_range_rate", RESET).doubts[0] == "by_velocity"
    nav = filter_of()
    assert doubted(nav, "gps_position", RESET) is RESET and nav.watch.pending[0][0] == "position"
    nav = filter_of()
    doubted(nav, "gps_position", RESET._replace(admitted=2.0))
    assert not nav.watch.pending
    nav, grown = filter_of(), RESET._replace(admitted=Grown(np.ones(15)))
    assert doubted(nav, "gps_velocity", grown) is grown and not nav.watch.pending  # the model is at fault


def test_a_fix_that_insists_is_remembered_as_a_step(learnt):
    nav = filter_of()
    doubted(nav, "gps_position", USED._replace(insisted=True))
    assert np.array_equal(nav.watch.moved.kept, [[3.0, 0.0, 0.0]])
    nav = filter_of(unread=True)
    doubted(nav, "gps_position", USED._replace(insisted=True))
    assert not nav.watch.moved
    nav = filter_of()
    doubted(nav, "gps_velocity", USED._replace(insisted=True))
    assert not nav.watch.moved and nav.watch.pending[0][0] == "velocity"


def test_a_confirmed_fix_that_is_hardly_likely_teaches_with_doubt(learnt):
    """Beyond the quantile of one in a hundred, if one fix alone was not enough: by nis over its mean."""
    surprising = stats.chi2.isf(1e-2, 3)
    first = USED._replace(alone=False)
    assert doubted(filter_of(), "star_tracker", first, 1.01 * surprising).doubts == (
        "by_surprise", pytest.approx(1.01 * surprising / 3.0)
    )  # fmt: skip
    assert doubted(filter_of(), "star_tracker", first, 0.99 * surprising).doubts is None
    assert doubted(filter_of(), "star_tracker", USED, 1.01 * surprising).doubts is None


@pytest.mark.parametrize("nis, in_doubt", [(0.0, False), (99.0, True)])
def test_the_log_is_told_what_becomes_of_a_sensor(nis, in_doubt):
    nav = filter_of({"gps_velocity": HEALTHY._replace(rejected=3 if in_doubt else 2)})
    gate._report(nav, 5.0, "gps_velocity", Fate.REJECTED, "")
    told = [one for one in nav.watch.pending if one[0] == "report"]
    assert told == ([("report", 5.0, "gps_velocity", "contradicts the accelerometers")] if in_doubt else [])
    nav = filter_of()
    for fate, said in ((Fate.USED, "accept"), (Fate.RESET, "report"), (Fate.DOUBTED, "report")):
        gate._report(nav, 5.0, "gps_velocity", fate, "why")
        assert nav.watch.pending[-1][0] == said
    nav.watch.pending.clear()
    gate._report(filter_of({"star_tracker": HEALTHY}), 5.0, "star_tracker", Fate.HELD, "")
    assert not nav.watch.pending


def test_the_attitude_is_that_of_a_fix_or_of_the_frame_of_single_stars():
    nav, z = filter_of(), np.ones(3)
    nav.sensors = {"star_tracker": SimpleNamespace(linearise=lambda *_: (2.0 * z, None, 3.0 * ONE))}

    def attitude(name, fate=Fate.USED, reason=Reason.NONE):
        measurement = SimpleNamespace(sensor=name, fix=SimpleNamespace(reason=reason))
        return gate._attitude(nav, NOW, z, ONE, measurement, fate)

    assert attitude("star_tracker")[0] is z and attitude("star_tracker", Fate.REJECTED)[0] is z
    assert attitude("star_vectors")[0].tolist() == [2.0, 2.0, 2.0]
    assert attitude("star_vectors", Fate.REJECTED) is None
    assert attitude("star_vectors", reason=Reason.NO_MATCH) is None
    assert attitude("gps_position") is None


def gyros(nav, now=NOW, fate=Fate.USED, found=None):
    asked = []
    nav.watch.gyros.compare = lambda *a: asked.append(a) or found
    nav.watch.gyros_wrong = lambda *a: nav.watch.pending.append(("wrong", *a))
    return gate._gyros_wrong(nav, now, 3.0 * X, ONE, fate), asked


def test_gyros_are_compared_with_the_stars_but_in_vibration_or_at_a_reset():
    nav = filter_of()
    found, ((seen, A, turned),) = gyros(nav)
    assert found is None and seen.f_b.tolist() == [3.0, 4.0, 5.0] and turned == 0.0
    assert A.tolist() == [1.0, 0.0, 0.0, 0.0]  # nothing was corrected
    assert gyros(filter_of(), fate=Fate.REJECTED)[1][0][-1] == 3.0  # the camera may be turned by the angle
    shaken = SimpleNamespace(**{**vars(NOW), "vibration": 1.0})
    for nav, given in (
        (filter_of(unread=True), {}),
        (filter_of(), {"now": shaken}),
        (filter_of(), {"fate": Fate.RESET}),
    ):
        assert gyros(nav, **given) == (None, []) and nav.watch.pending == [("forget",)]
    nav = filter_of()
    nav.watch.gyros.checked_s = NOW.t_s
    gyros(nav)
    assert nav.watch.pending[0][0] == "confirmed"
    nav = filter_of()
    assert gyros(nav, found="wrong")[0] == "wrong" and nav.watch.pending == [("wrong", 42.0, "wrong")]


def followed(nav, z, fate=Fate.USED, number=1):
    for _ in range(number):
        got = gate._drifts(nav, fate, z, ONE, None)
    return got


def test_a_sensor_that_drifts_is_doubted_and_once_something_is_admitted():
    nav = filter_of()
    assert followed(nav, 4.0 * X, number=5) == (Fate.USED, None)  # 4 (1 - 0.9^n) sigma: 1.6, of 2
    fates = [followed(nav, 4.0 * X) for _ in range(20)]
    first = next(k for k, (fate, _) in enumerate(fates) if fate == Fate.DOUBTED)
    assert fates[first][1] > 4.0 and all(one == (Fate.DOUBTED, 0.0) for one in fates[first + 1 :])
    assert followed(nav, 4.0 * X, Fate.REJECTED) == (Fate.REJECTED, None)
    assert nav.watch.gps_drift is integrity_gps.QUIET


@pytest.mark.parametrize("counted", [True, False])
def test_gyros_that_are_found_wrong_explain_what_they_can_have_done(counted, learnt):
    """Half as much again as the rate since the stars last agreed, 300 s at most."""
    found = SimpleNamespace(axes=("gyro x", "gyro z"), largest=0.01, admitted=np.ones(3))
    nav = filter_of({"star_tracker": HEALTHY._replace(used=7, rejected=2)}, disputed=0.5)
    verdict = USED if counted else USED._replace(fate=Fate.REJECTED)
    for checked_s, angle, explained in (
        (31.0, 0.14, True),
        (31.0, 0.16, False),
        (np.nan, 4.4, True),
        (np.nan, 4.6, False),
    ):
        nav.watch.gyros.checked_s, nav.watch.pending[:] = checked_s, []
        measurement = SimpleNamespace(sensor="star_tracker")
        got = gate._find_again(nav, NOW, verdict, found, measurement, angle * Y)
        assert got.fate == Fate.RESET and got.note == "gyro x gyro z wrong: bias to be found again"
        assert got.doubts == ("by_stars", explained or counted)
        assert nav.watch.pending == ([] if explained or counted else [("doubt", angle)])
        np.testing.assert_allclose(got.admitted["attitude"], angle)
        np.testing.assert_array_equal(got.admitted["gyro_bias"], np.ones(3))
    assert nav.health["star_tracker"].rejected == 0 and nav.watch.disputed == 0.0  # 4.5 rad explain 0.5
    nav = filter_of({"star_tracker": HEALTHY._replace(used=7)}, disputed=0.5)
    nav.watch.gyros.checked_s = 31.0
    gate._find_again(nav, NOW, verdict, found, SimpleNamespace(sensor="star_tracker"), 0.1 * Y)
    assert nav.health["star_tracker"].used == (7 if counted else 8) and nav.watch.disputed == 0.5
