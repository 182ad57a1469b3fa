"""Ranges of a position that jumps: what they say it is off by, how long they insist, what waits for them."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_nav_ranges import EARTH, LAYOUT, antenna_of, measured, ranges_of, state_of

from shefex_nav.geometry import frames
from shefex_nav.onboard.navigation import gate, integrity, measure_ranges, sensors
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate, Limits, RangeEvidence, Steps
from shefex_nav.onboard.navigation.settings import Release
from shefex_nav.onboard.navigation.state import POS, VEL
from shefex_nav.records import GpsRanges

ONE, LIMITS = np.eye(3), Limits(1e-4)
OFF_E = np.array([700.0, -300.0, 400.0])
C_IE = frames.dcm_ie(EARTH, state_of().t_s)


def moved(off_e, clock=0.0):
    """State that is off by so much less than what is measured, and the ranges."""
    truth = state_of()
    at = truth._replace(r_i=truth.r_i - C_IE @ off_e, clock=truth.clock - np.array([clock, 0.0]))
    return at, measured(truth)


@pytest.mark.parametrize("clock", [0.0, 3e5])
def test_ranges_say_what_the_position_is_off_by_whatever_the_clock(clock):
    """To second order, d^2 over the distance; covariance that of least squares by rows of H."""
    state, message = moved(OFF_E, clock)
    z, H, R = ranges_of(state, message)
    got, P = measure_ranges.offset(message, z, R, antenna_of(LAYOUT, state).r_e)
    np.testing.assert_allclose(got, OFF_E, atol=0.5)
    A = np.column_stack([H[:, POS] @ C_IE, np.ones(len(z))])
    wanted = np.linalg.inv(A.T @ np.linalg.inv(R) @ A)[:3, :3]
    np.testing.assert_allclose(P, wanted, rtol=1e-5)
    one = RangeEvidence(message, got, P, ONE)
    assert one.is_off(LIMITS[3])


def test_a_clock_alone_is_no_place_and_three_satellites_say_none():
    state, message = moved(np.zeros(3), 3e5)
    z, _, R = ranges_of(state, message)
    r_e = antenna_of(LAYOUT, state).r_e
    got, P = measure_ranges.offset(message, z, R, r_e)
    assert not RangeEvidence(message, got, P, ONE).is_off(LIMITS[3])
    few = GpsRanges(*(field[:3] if isinstance(field, np.ndarray) else field for field in message))
    got, P = measure_ranges.offset(few, z[:3], R[:3, :3], r_e)
    assert np.all(np.isnan(got)) and not RangeEvidence(few, got, P, ONE).is_off(LIMITS[3])
    spoilt = z.copy()
    spoilt[0] = np.nan  # four are left
    assert np.all(np.isfinite(measure_ranges.offset(message, spoilt, R, r_e)[0]))
    same = message._replace(r_es_e=np.tile(message.r_es_e[0], (5, 1)))
    assert np.all(np.isnan(measure_ranges.offset(same, z, R, r_e)[0]))  # all in one direction


def test_offsets_agree_and_widen_as_those_of_fixes():
    first, later = (RangeEvidence(None, z, ONE, 4.0 * ONE) for z in (np.zeros(3), np.array([9.0, 0.0, 0.0])))
    assert integrity.offsets_agree(first, later, 13.51) and not integrity.offsets_agree(first, later, 13.49)
    assert integrity.has_widened(first, later._replace(R=17.0 * ONE))
    assert not integrity.has_widened(first, later._replace(R=15.0 * ONE))


RULE, JUMP = Release(rejections=5, duration=4.0), Release(rejections=30, duration=29.0)


def trial(range_health, rate_health, off_e, clock=0.0):
    state, message = moved(off_e, clock)
    z, _, R = ranges_of(state, message)
    nav = SimpleNamespace(
        params=SimpleNamespace(gps_agreement=1.0, release=SimpleNamespace(gps=RULE)),
        health={"gps_range": range_health, "gps_range_rate": rate_health},
        limits=LIMITS, earth=EARTH, watch=SimpleNamespace(params=SimpleNamespace(gps_jump=JUMP)),
    )  # fmt: skip
    now = SimpleNamespace(t_s=state.t_s, P=np.diag(np.arange(1.0, LAYOUT.n + 1.0)))
    return sensors._range_position_trial(nav, now, z, R, message)


@pytest.fixture(autouse=True)
def antenna(monkeypatch):
    """That of the state which `moved` makes, of the offset that is tried."""
    monkeypatch.setattr(sensors, "_antenna", lambda nav, now: antenna_of(LAYOUT, state_of()))


USED = HEALTHY._replace(used=9)


def test_ranges_that_jump_without_their_rates_must_insist_for_longer():
    got = trial(USED, USED, OFF_E)
    assert got.rule == JUMP and got.steady is not None and got.still is integrity.offset_remains
    np.testing.assert_allclose(got.evidence.P, C_IE.T @ np.diag([1.0, 2.0, 3.0]) @ C_IE, atol=1e-9)
    for ranges, rates, off, clock in (
        (USED, USED._replace(rejected=1), OFF_E, 0.0),  # the rates contradict too
        (USED, HEALTHY, OFF_E, 0.0),  # there are none
        (HEALTHY, USED, OFF_E, 0.0),
        (USED, USED, np.zeros(3), 3e5),  # a clock that has jumped
    ):
        got = trial(ranges, rates, off, clock)
        assert got.rule == RULE and got.steady is None and got.still is None
    # the first of the refused says which of the two it is
    first = RangeEvidence(None, OFF_E, ONE, ONE)
    assert trial(USED._replace(first=first), USED, np.zeros(3)).rule == JUMP
    assert trial(USED._replace(first=first._replace(z=np.zeros(3))), USED, OFF_E).rule == RULE


def test_a_position_off_as_before_is_steady_and_one_that_goes_on_is_not():
    got = trial(USED, USED, OFF_E)
    for change, steady in ((0.0, True), (200.0, False)):
        assert got.steady(got.evidence._replace(z=got.evidence.z + change), got.evidence) == steady


def waits(off_e, health, v_off_i=0.0, passed=True, dt_s=0.0, sigma=0.05):
    """Rates of a place that is off, with the true velocity against the Earth but for v_off_i."""
    truth = state_of()
    off_i = C_IE @ off_e
    at = truth._replace(
        r_i=truth.r_i - off_i, v_i=truth.v_i - np.cross(frames.omega_ie_i(EARTH), off_i) - v_off_i
    )
    message = measured(truth)
    z, H, _ = measure_ranges.range_rates(LAYOUT, at, message, antenna_of(LAYOUT, at))
    R = sigma**2 * np.eye(len(z))
    S = R + 1e-4 * (H[:, VEL] @ H[:, VEL].T)
    nav = SimpleNamespace(
        health={"gps_range": health}, earth=EARTH, limits=LIMITS,
        sensors={"gps_range_rate": SimpleNamespace(rows=1)},
    )  # fmt: skip
    now = SimpleNamespace(t_s=truth.t_s + dt_s)
    return gate._waits_for_ranges(nav, now, (z, H, R, S, 0.0, 0.0), "gps_range_rate", passed)


def refused(off_e, **change):
    fix = SimpleNamespace(t_valid_s=state_of().t_s)
    evidence = RangeEvidence(fix, off_e, ONE, ONE)
    return USED._replace(**{"far": True, "in_a_row": 1, "evidence": evidence, **change})


def test_rates_wait_while_the_place_of_their_lines_of_sight_is_denied():
    far = 20.0 * OFF_E  # 17 km
    assert waits(far, refused(far)) and waits(far, refused(far), passed=False)
    # a velocity that is wrong from there as well contradicts
    assert not waits(far, refused(far), v_off_i=np.array([30.0, 0.0, 0.0]), passed=False)
    small = 0.01 * OFF_E
    assert not waits(small, refused(small))  # hardly another line of sight
    assert not waits(far, refused(far, far=False)) and not waits(far, refused(far, in_a_row=0))
    assert not waits(far, refused(far, evidence=None))
    assert not waits(far, refused(far), dt_s=10.1)  # refused ten seconds ago
    nowhere = np.full(3, np.nan)  # three satellites: it is not known how far
    assert waits(far, refused(nowhere)) and not waits(far, refused(nowhere), passed=False)


def test_what_ranges_are_believed_to_be_off_by_is_remembered():
    nav = SimpleNamespace(limits=LIMITS)
    trial = SimpleNamespace(evidence=RangeEvidence(None, OFF_E, ONE, ONE))
    before = USED._replace(first=trial.evidence)
    assert gate._offset(nav, "gps_range", before, trial) is OFF_E
    clock = USED._replace(first=trial.evidence._replace(z=np.zeros(3)))
    assert gate._offset(nav, "gps_range", clock, trial) is None
    for name in ("gps_position", "gps_range_rate", "star_tracker"):
        assert gate._offset(nav, name, before, trial) is None
    said = []
    watch = SimpleNamespace(unread=False, moved=Steps(), accept_position=said.append)
    verdict = gate.Verdict(Fate.RESET, None, None, "", True, offset=OFF_E)
    nav = SimpleNamespace(watch=watch, limits=LIMITS)
    gate._doubted(nav, None, np.ones(7), 0.0, "gps_range", verdict)
    assert said == [OFF_E]
    gate._doubted(nav, None, np.ones(7), 0.0, "gps_range", verdict._replace(offset=None))
    assert len(said) == 1 and not watch.moved
    gate._doubted(nav, None, np.ones(7), 0.0, "gps_range", verdict._replace(fate=Fate.USED, insisted=True))
    assert np.array_equal(watch.moved.kept, [OFF_E])


def test_an_attitude_that_is_used_ends_what_single_stars_have_said():
    bad = USED._replace(rejected=1, in_a_row=5, far=True, evidence=3)
    nav = SimpleNamespace(health={"star_vectors": bad, "gps_range": bad, "star_tracker": USED})
    gate._settle_single_stars(nav)
    assert nav.health["star_vectors"] == USED._replace(t_first_s=nav.health["star_vectors"].t_first_s)
    assert nav.health["gps_range"] is bad
