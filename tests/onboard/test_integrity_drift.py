"""A barometer that drifts: what it does to the solution, whether that is noticed, and what the levels say."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from test_nav_barometer import BAROMETER, EARTH, SETTINGS, SITE, aid_of, here, level_fix, stand

from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, wgs84
from shefex_nav.instruments.barometer import Day
from shefex_nav.onboard.navigation import (
    integrity_drift,
    integrity_watch,
    measure_barometer,
    protected,
    solution,
)
from shefex_nav.onboard.navigation.aid import DriftRule
from shefex_nav.onboard.navigation.integrity import HEALTHY, chi_square_limit
from shefex_nav.records import Doubt, GpsFix

CHANCE = 1e-9
T = np.sqrt(chi_square_limit(CHANCE, 1))
# a reading is off by its own noise, and by the bias; the layer that it is in is 0.17 per mille warm
DAY = Day(pressure=800.0, temperature=measure_barometer.TEMPERATURE[0] * 0.05 / 288.15, depth=8e3)
AID = aid_of(
    BAROMETER._replace(settings=replace(SETTINGS, day=DAY), P_scale=measure_barometer.of_layers(DAY))
)
WATCHED = AID._replace(drift=DriftRule(CHANCE, np.inf, "Pa"))
BEGINS_S = 10.1  # a reading, at which a drift may begin: the first one and each `EVERY_S` after it


def readings(seconds, rate=0.0, begin_s=BEGINS_S, step=0.0, until_s=np.inf):
    """Of a vehicle at 360 m; rate Pa/s from a time on, or a step then."""
    true, rng, out = atmosphere.us76(360.0)[1], np.random.default_rng(8), []
    for k in range(1, round(10 * seconds) + 1):
        t_s = 0.1 * k
        off = (step if t_s > begin_s else 0.0) + rate * np.clip(t_s - begin_s, 0.0, until_s - begin_s)
        out.append(AID.record(t_s, t_s, true + 180.0 + 5.0 * rng.standard_normal() + off))
    return out


def drift_of(nav):
    return nav.watch.drifts["barometer"]


def up(nav):
    """m, of the last tick above the site."""
    return here(nav.history[-1].state).height - 360.0


def full_fix(t_s, sigma=3.0):
    """GpsFix of position with height."""
    r_e, nothing = wgs84.ecef_from_geodetic(*SITE, 360.0), (np.full(3, np.nan), np.full((3, 3), np.nan))
    return GpsFix(t_s, t_s, True, r_e, nothing[0], sigma**2 * np.eye(3), nothing[1], 6, 2.0, "")


# the numbers


@pytest.mark.parametrize("with_gps", [False, True])
def test_the_response_is_what_the_drift_has_done_to_the_filter(with_gps):
    """The same flight without the drift and with it: difference of the solutions is B times the rate."""
    fixes, rate, seconds = [full_fix(5.0 * k) for k in range(1, 5)] if with_gps else [], 0.2, 20.0
    plain, _ = stand(readings(seconds), seconds, fixes, aid=WATCHED)
    nav, results = stand(readings(seconds, rate), seconds, fixes, aid=WATCHED)
    assert all(one.accepted for one in results)
    drift, a, b = drift_of(nav), plain.history, nav.history
    k = int(np.argmin(np.abs(drift.starts_s - BEGINS_S)))
    assert drift.starts_s[k] == pytest.approx(BEGINS_S, abs=1e-6)
    up_i = here(nav.history[-1].state).up_i
    for block, part in ((slice(0, 3), b.x[:3] - a.x[:3]), (slice(3, 6), b.x[3:6] - a.x[3:6])):
        assert up_i @ part == pytest.approx(rate * up_i @ drift.B[block, k], rel=0.03)
    places = nav.layout
    bias = places.values["baro_bias"]
    assert b.x[bias] - a.x[bias] == pytest.approx(rate * drift.B[places.places["baro_bias"], k], rel=0.03)


def filtered(z_of, n=400):
    """Of one state, known at the start, and a Drift that sees its readings. -> Drift, estimate

    z_of : (step, estimate) -> innovation
    """
    drift, P, x = integrity_drift.Drift(DriftRule(CHANCE, np.inf, "Pa")), 1.0, 0.0
    drift.B = np.zeros((9, 0))
    drift._begin(0.0)
    H, R = np.zeros((1, 9)), 4.0
    H[0, 0] = 1.0
    for k in range(1, n + 1):
        P, z = P + 0.01, z_of(k, x)
        whole = np.zeros((9, 9))
        whole[0, 0] = P
        found = drift.judge(float(k), np.array([z]), H, np.array([[P + R]]))
        if found is not None:
            return drift, x, found
        drift.learn(float(k), whole, (H, np.array([[R]])), own=True)
        x, P = x + P / (P + R) * z, P * R / (P + R)
    return drift, x, None


def test_the_worst_that_passes_is_the_drift_that_the_test_just_misses(monkeypatch):
    """Without noise: at T/sqrt(J) a second nothing is found, and what it has done is the level's part."""
    monkeypatch.setattr(integrity_drift, "LEFT_OUT", 0.0)  # here B is all of the response
    quiet, _, _ = filtered(lambda k, x: 0.0)
    worst = T / np.sqrt(quiet.J[0])
    axes = np.vstack([np.eye(3), np.zeros(3)])
    told = quiet.worst(axes)
    below, x, found = filtered(lambda k, x: 0.999 * worst * k - x)
    assert found is None and below.found == ""
    assert abs(x) == pytest.approx(0.999 * told[protected.P_NED.start], rel=1e-9)
    above, _, found = filtered(lambda k, x: 1.001 * worst * k - x)
    assert found is not None and f"by {1.001 * worst:.3g} Pa/s since T+0 s" in above.found
    np.testing.assert_allclose(found.done[0], 1.001 * worst * above.B[0, 0], rtol=1e-9)


@pytest.mark.parametrize("times", [1.2, -2.0, 5.0])
def test_the_rate_that_is_told_is_that_of_the_drift_with_what_is_left_out(times):
    """Without noise, as shipped: the readings show all of h. What the drift has done is not counted short."""
    quiet, _, _ = filtered(lambda k, x: 0.0)
    rate = times * T / np.sqrt(quiet.J[0])
    drift, x, found = filtered(lambda k, x: rate * k - x)
    assert integrity_drift.LEFT_OUT > 0.0
    assert f"by {rate:.3g} Pa/s since T+0 s" in drift.found
    assert 1.0 < found.done[0] / x < 1.5


SCALE = 100.0  # m, of a pressure that falls with height


def bent(rate, knows):
    """A height that rests on a pressure of 1000 exp(-h/SCALE) which drifts. -> Drift, estimate, m

    knows : whether the Drift is told that readings bend
    """
    drift = integrity_drift.Drift(
        DriftRule(CHANCE, np.inf, "Pa", (lambda reading: 1.0 / reading) if knows else None)
    )
    drift.B = np.zeros((9, 0))
    drift._begin(0.0)
    P, x, R, H = 1.0, 0.0, 50.0**2, np.zeros((1, 9))
    for k in range(1, 301):
        P, expected = P + 0.01, 1000.0 * np.exp(-x / SCALE)
        z, H[0, 0], bend = 1000.0 + rate * k - expected, -expected / SCALE, drift.bend_of(expected)
        S, whole = H[0, 0] ** 2 * P + R, np.zeros((9, 9))
        whole[0, 0] = P
        drift.judge(float(k), np.array([z]), H, np.array([[S]]), bend)
        drift.found = ""  # at the rate that only just passes: followed to the end
        drift.learn(float(k), whole, (H, np.array([[R]])), own=True, bend=bend)
        x, P = x + P * H[0, 0] / S * z, P * R / S
    return drift, x


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_reading_that_bends_is_followed_to_second_order(side):
    """At the rate that just passes: what B says of the height, against the filter itself, far off."""
    rate = {}
    for knows in (True, False):
        worst = 0.2
        for _ in range(30):
            drift, x = bent(side * worst, knows)
            k = int(np.argmax(drift.sides == side)) if knows else 0
            worst = 0.5 * (worst + T / np.sqrt(drift.J[k]))
        rate[knows] = abs(drift.B[0, k] * worst), abs(x)
    told, true = rate[True]
    assert 0.05 * SCALE < true < 0.5 * SCALE
    linear, of_linear = rate[False]
    assert abs(told - true) < 0.2 * abs(linear - of_linear)
    assert told == pytest.approx(true, rel=0.03)


def test_healthy_innovations_make_a_chi_square():
    """Of 400 filters whose model is right the statistic of the end is of one degree of freedom."""
    rng, size = np.random.default_rng(5), []
    for _ in range(400):
        truth = [rng.standard_normal()]
        for _ in range(60):
            truth.append(truth[-1] + 0.1 * rng.standard_normal())

        def reading(k, x, truth=truth):
            return truth[k] + 2.0 * rng.standard_normal() - x

        drift, _, found = filtered(reading, n=60)
        assert found is None
        size.append(drift.y[0] ** 2 / drift.J[0])
    assert np.mean(size) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 400.0))
    assert np.mean(np.array(size) > 3.841) == pytest.approx(0.05, abs=0.04)


def test_what_is_left_out_of_the_response_shows_nothing_and_pulls_nothing_back():
    """Readings whose h is within the share LEFT_OUT of the drift; beyond, by what they are more."""
    drift, _, _ = filtered(lambda k, x: 0.0, n=50)
    slack, H = integrity_drift.LEFT_OUT * 51.0, np.zeros((1, 9))
    H[0, 0] = 1.0
    P, R = np.diag([1.0, *np.zeros(8)]), np.ones((1, 1))
    for off, pulled in ((-0.5 * slack, 0.0), (-3.0 * slack, -2.0 * slack), (0.5 * slack, 0.5 * slack)):
        drift.B[:] = 0.0
        drift.B[0, 0] = 51.0 - off  # h = off
        before = drift.J[0]
        drift.judge(51.0, np.zeros(1), H, np.ones((1, 1)))
        assert drift.J[0] - before == pytest.approx(max(abs(off) - slack, 0.0) ** 2, abs=1e-9)
        drift.learn(51.0, P, (H, R), own=True)
        assert drift.B[0, 0] - (51.0 - off) == pytest.approx(0.5 * pulled, abs=1e-9)


def test_a_rate_that_is_told_bounds_what_is_covered():
    quiet, _, _ = filtered(lambda k, x: 0.0)
    axes = np.vstack([np.eye(3), np.zeros(3)])
    open_ended = quiet.worst(axes)
    quiet.rule = quiet.rule._replace(fastest=0.25 * T / np.sqrt(quiet.J[0]))
    np.testing.assert_allclose(quiet.worst(axes), 0.25 * open_ended)
    quiet.rule = quiet.rule._replace(fastest=0.0)
    assert not quiet.worst(axes).any()


def test_the_times_that_are_kept_reach_back_to_the_first_and_thin_out():
    drift = integrity_drift.Drift(DriftRule(CHANCE, np.inf, "Pa"))
    drift.B = np.zeros((9, 0))
    for k in range(200):
        drift._begin(10.0 * k)
    starts_s, age = drift.starts_s, 1990.0 - drift.starts_s
    assert len(starts_s) == integrity_drift.MOST == drift.B.shape[1] == len(drift.J)
    assert starts_s[0] == 0.0 and starts_s[-1] == 1990.0
    assert (np.diff(starts_s) > 0.0).all()
    assert (np.diff(starts_s) <= 0.1 * age[:-1] + 10.0).all()  # none is far from one that is kept


AXES = np.vstack([np.eye(3), np.zeros(3)])


@pytest.mark.parametrize(("fastest", "bend"), [(np.inf, False), (np.inf, True), (0.5, False)])
def test_a_drift_that_has_done_something_and_was_never_judged_has_no_bound(fastest, bend):
    """Readings used and not judged: J = 0, and what the filter follows is all of it."""
    drift = integrity_drift.Drift(DriftRule(CHANCE, fastest, "Pa", (lambda reading: 1e-3) if bend else None))
    drift.B = np.zeros((9, 0))
    drift._begin(0.0)
    P, R, H = np.diag([100.0, *np.zeros(8)]), np.ones((1, 1)), np.zeros((1, 9))
    H[0, 0] = 1.0
    assert not drift.worst(AXES).any()  # one that has just begun has done nothing
    for k in range(1, 41):
        drift.learn(float(k), P, (H, R), own=True, bend=drift.bend_of(None))
    assert not drift.J.any() and drift.B[0] == pytest.approx(40.0, rel=0.01)
    north = drift.worst(AXES)[protected.P_NED.start]
    assert north == np.inf if fastest == np.inf else north == pytest.approx(fastest * 40.0, rel=0.01)
    assert (np.delete(drift.worst(AXES), protected.P_NED.start) == 0.0).all()
    drift.learn(40.0, P, (H, 1e-6 * R), own=False)  # others that measure it bring it back
    for k in range(41, 44):
        drift.judge(float(k), np.zeros(1), H, P[:1, :1] + R, bend=drift.bend_of(None))
    assert 0.0 < drift.worst(AXES)[protected.P_NED.start] < 1e-3


def test_readings_that_are_not_judged_have_passed_the_gate():
    """The drift whose largest innovation is just at the gate, with what is left out the bound is wider."""
    drift, gate = integrity_drift.Drift(DriftRule(CHANCE, np.inf, "Pa")), 10.8
    drift.B, H = np.zeros((9, 0)), np.zeros((1, 9))
    drift._begin(0.0)
    H[0, 0] = 1.0
    P, S, x, largest = np.diag([1.0, *np.zeros(8)]), np.full((1, 1), 5.0), 0.0, 0.0
    for k in range(1, 31):
        drift.passes_gate(float(k), H, S, gate)
        drift.learn(float(k), P, (H, S - 1.0), own=True)
        largest, x = max(largest, k - x), x + 0.2 * (k - x)
    fastest = np.sqrt(gate * 5.0) / largest
    assert fastest < drift.gated[0] < 1.3 * fastest
    assert drift.worst(AXES)[0] == pytest.approx(drift.gated[0] * x) and not drift.J.any()


@pytest.mark.parametrize("rate", [1.0, -3.0])
def test_what_is_followed_while_the_imu_is_blind_is_within_the_level(monkeypatch, rate):
    monkeypatch.setattr(integrity_watch.Watch, "imu_blind", property(lambda watch: True))
    nav, results = stand(readings(25.0, rate), 25.0, aid=WATCHED)
    assert all(one.accepted for one in results)
    drift, told = drift_of(nav), solution.solution(nav)
    assert not drift.J.any() and not drift.found
    worst = drift.worst(protected.level_axes(EARTH, 25.0, nav.history.x))[2]
    assert abs(up(nav)) < worst < told.protection_position[1] < np.inf


def test_once_found_nothing_is_followed_any_more():
    early, late = (
        drift_of(stand(readings(seconds, 20.0), seconds, aid=WATCHED)[0]) for seconds in (25.0, 35.0)
    )
    assert early.found and early.found == late.found
    np.testing.assert_array_equal(early.B, late.B)
    np.testing.assert_array_equal(early.starts_s, late.starts_s)
    assert late.motion.t_s < 25.0
    assert (
        late.B.any() and not late.worst(np.vstack([np.eye(3), np.zeros(3)])).any()
    )  # the covariance says it


# the filter


def test_a_fast_drift_is_noticed_and_the_solution_is_not_to_be_used():
    nav, results = stand(readings(25.0, 20.0), 25.0, aid=WATCHED)
    found = drift_of(nav).found
    assert found.startswith("drifts against the solution: by ")
    refused = [one for one in results if not one.accepted]
    assert refused[0].t_valid_s - BEGINS_S < 8.0
    assert refused[-1].note == found and results[-1] is refused[-1]
    assert all(one.note == found for one in refused if one.dof == 0)
    assert [one.reason for one in nav.watch.changes() if one.source == "barometer"][-1] == found
    told = solution.solution(nav)
    assert (told.doubt_position, told.doubt_velocity) == (Doubt.CONTRADICTED, Doubt.CONTRADICTED)
    assert abs(up(nav)) < told.protection_position[1]


def test_a_gps_height_settles_the_dispute_and_the_barometer_stays_out():
    fixes = [full_fix(float(k)) for k in range(25, 30)]
    nav, results = stand(readings(30.0, 20.0), 30.0, fixes, aid=WATCHED)
    assert drift_of(nav).found and not drift_of(nav).is_disputed
    assert any(one.sensor == "gps_position" and one.accepted for one in results)
    assert not [one for one in results if one.sensor == "barometer" and one.accepted and one.t_valid_s > 24.0]
    assert not nav.watch.graver_doubts(nav.health).any()
    assert abs(up(nav)) < 4.0


def test_fixes_without_height_settle_nothing():
    fixes = [level_fix(float(k), 0.0, 0.0) for k in range(25, 30)]
    nav, _ = stand(readings(30.0, 20.0), 30.0, fixes, aid=WATCHED)
    assert drift_of(nav).is_disputed
    assert (nav.watch.graver_doubts(nav.health) == Doubt.CONTRADICTED).all()


@pytest.mark.parametrize("rate", [1.0, -1.0, 3.0])
def test_a_slow_drift_is_within_the_level_which_the_sigma_alone_would_not_be(rate):
    nav, results = stand(readings(30.0, rate), 30.0, aid=WATCHED)
    bare, _ = stand(readings(30.0, rate), 30.0, aid=AID)
    assert all(one.accepted for one in results) and not drift_of(nav).found
    worst = drift_of(nav).worst(protected.level_axes(EARTH, 30.0, nav.history.x))
    level, before = (solution.solution(one).protection_position[1] for one in (nav, bare))
    assert abs(up(nav)) < worst[protected.P_NED.start + 2] < level
    assert level > before
    np.testing.assert_array_equal(nav.history.x, bare.history.x)  # watching moves nothing


def test_the_term_grows_while_height_rests_on_the_barometer_and_is_nothing_beside_gps():
    def term(seconds, fixes=()):
        nav, _ = stand(readings(seconds), seconds, fixes, aid=WATCHED)
        return drift_of(nav).worst(protected.level_axes(EARTH, seconds, nav.history.x))[2]

    early, late = term(10.0), term(30.0)
    beside = term(30.0, [full_fix(0.1 * k, 0.1) for k in range(1, 300)])
    assert early < late
    assert beside < 0.2 * late


def test_a_step_is_a_new_bias_and_no_drift():
    nav, results = stand(readings(20.0, step=3000.0), 20.0, aid=WATCHED)
    assert [one.note for one in results if one.note == "new bias"] == ["new bias"]
    assert drift_of(nav).found == "" and results[-1].accepted
    assert abs(up(nav)) < 4.0


def test_refused_readings_that_go_on_moving_are_no_new_bias():
    """A step and a fast drift with it: the gate refuses all of them, and each agrees with the one before."""
    fast = []
    for one in readings(24.0):
        off = 3000.0 + 100.0 * (one.t_valid_s - 20.0) if one.t_valid_s > 20.0 else 0.0
        fast.append(one._replace(pressure=one.pressure + off))
    nav, results = stand(fast, 24.0, aid=WATCHED)
    _, without = stand(fast, 24.0, aid=AID)
    assert any(one.note == "new bias" for one in without)
    assert not any(one.note == "new bias" for one in results)
    rate = float(drift_of(nav).found.split("by ")[1].split(" ")[0])
    assert rate == pytest.approx(100.0, abs=4.0 * 5.0 * np.sqrt(2.0) / 0.4)  # by two readings 0.4 s apart
    assert nav.health["barometer"] == HEALTHY._replace(used=nav.health["barometer"].used)
    assert solution.solution(nav).do_not_use_position
    assert abs(up(nav)) < 4.0


def test_a_drift_is_looked_for_in_readings_of_one_number_alone():
    def twice(model_expect, place, reading):
        seen = model_expect(place, reading)
        return seen._replace(
            z=np.repeat(seen.z, 2), H=np.repeat(seen.H, 2, axis=0), R=1e4 * np.eye(2), lasting=()
        )

    aid = WATCHED._replace(expect=partial(twice, WATCHED.expect))
    with pytest.raises(ValueError, match="readings of one number, not of 2"):
        stand(readings(0.2), 0.2, aid=aid)


def test_the_height_that_the_filter_follows_a_drift_to_is_below():
    """Pressure that rises is read as a descent: the sign of B."""
    nav, _ = stand(readings(20.0, 1.0), 20.0, aid=WATCHED)
    C_in = frames.dcm_ie(EARTH, 20.0) @ wgs84.dcm_en(*SITE)
    assert (C_in[:, 2] @ drift_of(nav).B[:3, 0]) > 0.0
