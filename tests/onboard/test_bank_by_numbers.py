"""The bank of windows against a slow search over all of them, and what follows from an alarm."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, fly
from scipy import stats

from shefex_nav.onboard.navigation import fusion, integrity_bank
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.gate import Verdict
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate
from shefex_nav.onboard.navigation.integrity_bank import Alarm, Stream

WINDOWS = (3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
USED = Verdict(Fate.USED, None, None, "", True)


@cache
def limit(dof):
    return stats.chi2.isf(1e-9, dof)


def slow(w, sizes=True):
    """Statistic furthest beyond its limit: window, whether by its run, value; None if none is."""
    w, d, worst = np.array(w), len(w[0]), (1.0, None)
    for n in WINDOWS:
        if n <= len(w):
            last = w[-n:]
            size, run = (last**2).sum(), (last.sum(axis=0) ** 2).sum() / n
            for by_run, value, dof in ((False, size, n * d), (True, run, d)):
                if by_run or sizes:
                    worst = max(worst, (value / limit(dof), (n, by_run, value)), key=lambda one: one[0])
    return worst[1]


@pytest.mark.parametrize("d", [1, 3, 6])
@pytest.mark.parametrize("sizes", [True, False])
@pytest.mark.parametrize("offset, scale", [(0.0, 1.0), (0.0, 2.2), (1.2, 1.0), (0.9, 1.6)])
def test_a_stream_finds_what_a_search_over_all_windows_finds(d, sizes, offset, scale):
    """300 innovations, more than are kept; excess: of the variance that the mean or the size says."""
    rng, one, seen = np.random.default_rng(d), Stream(d, sizes), []
    for k in range(300):
        w = offset + scale * rng.standard_normal(d)
        seen.append(w)
        found, wanted = one.take(w, float(k), 0.3), slow(seen[-128:], sizes)
        assert (found is None) == (wanted is None)
        if found:
            n, by_run, _ = wanted
            assert found.one_sided == by_run and found.words.endswith(f"of {n} fixes")
            assert found.words.startswith("on one side" if by_run else "too large")
            mean = np.mean(seen[-n:], axis=0)
            np.testing.assert_allclose(found.mean, mean, rtol=1e-9)
            more = (n * mean @ mean / d - 1.0) / n if by_run else np.mean(np.square(seen[-n:])) - 1.0
            assert found.excess == pytest.approx(more)
    assert one.fed_s == 299.0 and len(one.recent) == 10 and one.recent[-1][1] == 0.3
    np.testing.assert_allclose(one.last(20), seen[-20:])
    one.forget()
    assert one.take(np.full(d, 9.0)) is None and len(one.last(5)) == 1


@pytest.mark.parametrize("d, sizes", [(3, True), (3, False), (2, True)])
def test_ten_innovations_of_healthy_size_and_run_are_calm(d, sizes):
    for scale, offset in ((1.0, 0.0), (1.5, 0.0), (0.2, 0.9), (0.2, 1.2), (0.1, 0.0)):
        one, rng = Stream(d, sizes), np.random.default_rng(3)
        w = offset + scale * rng.standard_normal((10, d))
        for k in range(9):
            one.take(w[k])
            assert not one.calm()
        one.take(w[9])
        small = (w**2).sum() < stats.chi2.isf(1e-2, 10 * d) or not sizes
        assert one.calm() == bool(small and (w.sum(axis=0) ** 2).sum() / 10 < stats.chi2.isf(1e-2, d))


def test_a_refused_fix_counts_for_no_more_than_five_sigma():
    w = np.array([30.0, -40.0])
    np.testing.assert_allclose(integrity_bank._clipped(w), [3.0, -4.0])
    for size in (4.9, 5.0):
        w = size * np.array([0.6, -0.8])
        assert np.array_equal(integrity_bank._clipped(w), w)
    for raises in (1, 2):  # one or two in a row are too little for an alarm
        one = Stream(3)
        for w in [np.zeros(3)] * 20 + [5.0 * np.eye(3)[0]] * raises + [np.zeros(3)] * 20:
            assert one.take(w) is None


@pytest.fixture
def nav():
    """A filter at its first tick, whose bank and watch are new."""
    return fusion.start(PARAMS, alignment(fly(0.1)[1][0]), EARTH)


def at(nav, now_s):
    nav.history.ends_s[-1] = now_s
    return SimpleNamespace(x=nav.history.x, P=nav.history.P, t_s=now_s, vibration=0.0)


def fed(nav, now_s, z, name="gps_velocity", verdict=USED, own=0.5, t_valid_s=None):
    fix = SimpleNamespace(t_valid_s=now_s if t_valid_s is None else t_valid_s)
    z = np.array(z, dtype=float)
    S = np.diag([4.0, 9.0, 1.0])[: len(z), : len(z)]
    measurement = SimpleNamespace(sensor=name, fix=fix)
    return nav.bank.take(nav, at(nav, now_s), z, own * S, S, measurement, verdict)


FAR = np.array([2.0, 3.0, 1.0]) * 4.0 / np.sqrt(3.0)  # four sigma


def alarmed(nav, number=3, **given):
    for k in range(number):
        got = fed(nav, 10.0 + k, FAR, verdict=USED._replace(fate=Fate.REJECTED), **given)
        assert got.fate == Fate.REJECTED
    return got


def test_an_alarm_withdraws_the_solution_and_grows_the_covariance_at_the_next_fix_that_is_used(nav):
    """Four sigma three times: the mean square is 16/3; own noise half, so what is left grows by more."""
    alarmed(nav, 2)
    assert not nav.watch.alarms
    alarmed(nav, 1)
    nav.watch.alarms.clear(), nav.bank.due.clear()
    nav.bank.forget("gps")
    alarmed(nav)
    assert nav.watch.alarms == {"gps": 12.0}
    alarm = nav.bank.due["gps"]
    assert alarm.t_s == 12.0
    excess = 48.0 / 9.0 - 1.0 if slow([FAR / [2.0, 3.0, 1.0]] * 3)[1] is False else (48.0 / 3.0 - 1.0) / 3.0
    assert alarm.factor == pytest.approx(np.sqrt(1.0 + excess / 0.5))
    np.testing.assert_allclose(alarm.mean, FAR)
    got = fed(nav, 13.0, np.zeros(3))
    assert got.fate == Fate.RESET and isinstance(got.admitted, Grown) and "gyro_bias" in got.doubts
    assert got.note == "what was learnt is doubted" and not nav.bank.due and nav.bank.before == {"gps": 12.0}
    assert got.admitted.factors[0] == pytest.approx(alarm.factor)


@pytest.mark.parametrize("of_receiver", [True, False])
def test_what_was_learnt_by_a_receiver_told_too_good_grows_to_the_start(nav, of_receiver, monkeypatch):
    """A gyro bias known to a third of the start: its prior was right, whatever the noise of the receiver."""
    monkeypatch.setattr(integrity_bank.adaptation, "blame_receiver", lambda nav, streams: of_receiver)
    bias, P = nav.layout.places["gyro_bias"], nav.history.P
    P[bias, bias] /= 9.0
    P[bias, 0] = P[0, bias] = 1e-3 * np.sqrt(P[bias, bias].diagonal() * P[0, 0])
    alarmed(nav)
    factor = nav.bank.due["gps"].factor
    assert factor > 3.0
    got = fed(nav, 13.0, np.zeros(3))
    np.testing.assert_allclose(got.admitted.factors[bias], 3.0 if of_receiver else factor)
    assert got.admitted.factors[0] == pytest.approx(factor)


def test_what_an_alarm_grows_by_has_bounds(nav):
    for own, size, factor in ((0.0, 3.6, 2.0), (0.99, 9.0, 8.0)):
        found = integrity_bank.Finding("", size**2 / 3.0 - 1.0 if own else 0.5, np.zeros(3), False)
        nav.bank._alarm(nav, "gps", "gps_velocity", found, own, np.eye(3))
        assert nav.bank.due["gps"].factor == factor
    found = found._replace(excess=0.2)
    nav.bank._alarm(nav, "gps", "gps_velocity", found, 0.99, np.eye(3))
    assert nav.bank.due["gps"].factor == pytest.approx(np.sqrt(1.0 + 0.2 / 0.05))  # own noise 0.95 at most


def test_nothing_grows_of_an_alarm_that_is_old_or_of_a_sensor_that_was_just_refused(nav):
    nav.bank.due["gps"] = Alarm(0.0, 3.0, np.zeros(3))
    assert fed(nav, 15.1, np.zeros(3)) is USED and not nav.bank.due
    nav.bank.due["gps"] = Alarm(0.0, 3.0, np.zeros(3))
    nav.health["gps_velocity"] = HEALTHY._replace(in_a_row=1)
    assert fed(nav, 1.0, np.zeros(3)) is USED and nav.bank.due
    nav.health["gps_velocity"] = HEALTHY
    assert fed(nav, 14.9, np.zeros(3)).fate == Fate.RESET


def test_stars_wait_for_what_the_gyros_say(nav):
    nav.bank.due["star_tracker"] = Alarm(0.0, 3.0, np.full(3, 1e-3))
    assert fed(nav, 3.9, np.zeros(3), "star_tracker") is USED and nav.bank.due
    got = fed(nav, 4.1, np.zeros(3), "star_tracker")
    assert got.fate == Fate.RESET and "gyro_bias" in got.doubts and not nav.bank.due


def test_an_alarm_is_over_when_all_that_still_speak_are_calm(nav):
    nav.watch.alarms["gps"] = 0.0
    nav.watch.reasons["gps innovations"] = "too large"
    for k in range(4):
        fed(nav, 0.5 * k, np.zeros(3), "gps_position")
    for k in range(12):
        fed(nav, 5.0 + k, np.zeros(3))
    assert "gps" in nav.watch.alarms  # the position spoke last at 1.5 s, not 15 s ago, and said too little
    fed(nav, 16.6, np.zeros(3))
    assert not nav.watch.alarms and nav.watch.pending[-1].healthy
    nav.watch.alarms["gps"] = 16.6
    fed(nav, 21.5, np.zeros(3))
    assert nav.watch.alarms
    fed(nav, 21.7, np.zeros(3))
    assert not nav.watch.alarms


def test_position_and_velocity_of_one_fix_are_looked_at_together(nav):
    fed(nav, 1.0, [2.0, 0.0, 0.0], "gps_position", t_valid_s=0.5)
    fed(nav, 1.0, [0.0, 3.0, 0.0], "gps_velocity", t_valid_s=0.5)
    np.testing.assert_allclose(nav.bank.streams["gps"].last(1)[0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
    fed(nav, 2.0, [0.0, 3.0, 0.0], "gps_velocity", t_valid_s=1.5)  # of another fix
    assert nav.bank.streams["gps"].n == 1 and nav.bank.streams["gps_velocity"].n == 2
    nav.bank.begin_anew()
    assert not any(one.n for one in nav.bank.streams.values())
    assert not nav.bank.streams["gps_velocity"].recent


def test_which_innovations_count(nav):
    """A refused star fix does not, nor a refused position that jumps alone; none while the IMU is blind."""
    moves = HEALTHY._replace(used=9)
    nav.health.update(gps_position=moves, gps_velocity=moves)
    counts = lambda name, fate: integrity_bank._counts(nav, name, fate)  # noqa: E731
    for name in ("gps_position", "gps_velocity", "star_tracker"):
        assert counts(name, Fate.USED) and not counts(name, Fate.HELD) and not counts(name, Fate.DOUBTED)
    assert counts("gps_velocity", Fate.REJECTED)
    assert not counts("gps_position", Fate.REJECTED) and not counts("star_tracker", Fate.REJECTED)
    nav.health["gps_velocity"] = moves._replace(rejected=1)
    assert counts("gps_position", Fate.REJECTED)
    nav.watch.unread = True
    assert not counts("gps_velocity", Fate.USED)


def test_what_is_believed_has_doubts_of_its_own(nav):
    believed = USED._replace(fate=Fate.RESET)
    for name, verdict, over in (
        ("gps_velocity", believed, True),
        ("gps_velocity", believed._replace(admitted=Grown(np.ones(nav.layout.n))), False),
        ("gps_position", believed, False),
    ):
        nav.watch.alarms["gps"], nav.bank.due["gps"] = 0.0, Alarm(0.0, 3.0, np.zeros(3))
        fed(nav, 1.0, np.zeros(3), "gps_velocity", USED._replace(fate=Fate.HELD))
        assert fed(nav, 1.0, FAR, name, verdict) is verdict
        assert ("gps" not in nav.watch.alarms) == over and not nav.bank.due
    assert fed(nav, 1.0, FAR, "barometer") is USED
