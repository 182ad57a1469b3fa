"""The gate's verdict on a measurement, with sensors of which all answers are given."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from test_gate_cases import NOW, ONE, X, evidence, filter_of, gps
from test_who_is_believed import trial

from shefex_nav.onboard.navigation import gate, integrity_protection
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate
from shefex_nav.onboard.navigation.sensor import Innovation
from shefex_nav.onboard.navigation.state import layout

LIMIT = stats.chi2.isf(1e-3, 3)  # of `filter_of`
FAR = stats.chi2.isf(1e-12, 3)


def sensor(rows=0, alone=None, agree=True, admits=None, **rule):
    """A sensor whose trial gives these answers; `asked` counts how often it is tried."""
    asked = []

    def tried(nav, now, z, R, fix):
        asked.append(fix)
        given = {"rejections": 3, "duration": 2.0, **rule}
        return trial(evidence(z, t_s=fix.t_valid_s), agree, **given)

    return SimpleNamespace(
        rows=rows, alone=None if alone is None else (lambda nav, S: alone), trial=tried, admits=admits,
        gate_probability=None, reset_note="reset", labels=None, asked=asked,
    )  # fmt: skip


def verdict(nav, name="gps_velocity", nis=1.0, t_s=10.0, z=X, v=(1.0, 0.0, 0.0), S=ONE):
    measurement = SimpleNamespace(sensor=name, fix=gps(t_s, v))
    limit = nav.limits[len(z)]
    return gate._verdict(nav, NOW, Innovation(np.array(z), None, ONE, S, nis, limit), measurement)


def of(one, **health):
    names = "gps_position", "gps_velocity", "star_tracker"
    nav = filter_of({**dict.fromkeys(names, HEALTHY), **health})
    nav.sensors = dict.fromkeys(names, one)
    return nav


def test_a_fix_inside_the_gate_is_used_without_a_trial():
    one = sensor()
    nav = of(one)
    got = verdict(nav, nis=0.999 * LIMIT)
    assert (got.fate, got.note, got.alone, got.rows) == (Fate.USED, "", True, None) and not one.asked
    assert nav.health["gps_velocity"].used == 1
    got = verdict(nav, nis=1.001 * LIMIT)
    assert (got.fate, got.note) == (Fate.REJECTED, "rejected") and len(one.asked) == 1
    assert nav.health["gps_velocity"].rejected == 1
    verdict(nav)  # after a rejected one it is tried again
    assert len(one.asked) == 2


def test_a_sensor_that_insists_is_believed():
    nav = of(sensor())
    fates = [verdict(nav, nis=2.0 * LIMIT, t_s=float(t)).fate for t in range(4)]
    assert fates == [Fate.REJECTED, Fate.REJECTED, Fate.RESET, Fate.REJECTED]
    nav = of(sensor(admits=lambda nav, z: 7.0 * z[0]))
    for t_s in range(3):
        got = verdict(nav, nis=2.0 * LIMIT, t_s=float(t_s))
    assert got.admitted == 7.0 and got.note == "reset, or the camera has moved"


@pytest.mark.parametrize("nis, far", [(0.99 * FAR, False), (1.01 * FAR, True)])
def test_one_fix_that_is_far_off_is_remembered_while_they_are_rejected(nis, far):
    nav = of(sensor(rejections=9))
    verdict(nav, nis=nis)
    assert nav.health["gps_velocity"].far == far
    verdict(nav, nis=1.1 * LIMIT, t_s=11.0)
    assert nav.health["gps_velocity"].far == far
    assert not nav.watch.far if not far else nav.watch.far
    verdict(nav, nis=1.0, t_s=12.0)
    assert not nav.health["gps_velocity"].far


def test_where_one_is_not_enough_it_is_held():
    one = sensor(alone=False)
    nav = of(one)
    got = verdict(nav, "star_tracker")
    assert (got.fate, got.alone) == (Fate.HELD, False) and got.note.startswith("held") and one.asked
    assert verdict(nav, "star_tracker").fate == Fate.USED


def test_positions_wait_while_their_velocity_is_doubtful():
    refused = HEALTHY._replace(far=True, in_a_row=1, evidence=evidence(X, t_s=9.0))
    nav = of(sensor(), gps_velocity=refused)
    got = verdict(nav, "gps_position")
    assert (got.fate, got.note) == (Fate.HELD, gate.WAITS)
    assert verdict(nav, "star_tracker").fate == Fate.USED
    assert verdict(nav, "gps_position", t_s=19.5).fate == Fate.USED


def test_rows_are_judged_by_their_groups():
    nav = of(sensor(rows=1))
    z, S = np.array([0.1, 9.0, 0.1]), ONE
    got = verdict(nav, z=z, S=S, nis=81.0)
    assert got.fate == Fate.USED and got.rows.tolist() == [True, False, True]
    got = verdict(nav, z=np.array([9.0, 9.0, 0.1]), nis=162.0)
    assert got.fate == Fate.REJECTED


@pytest.mark.parametrize("name, insists", [("gps_velocity", True), ("star_tracker", False)])
def test_what_said_the_same_when_it_was_rejected_insists(name, insists):
    rejected = HEALTHY._replace(used=5, rejected=1, evidence=evidence(X), first=evidence(X))
    nav = of(sensor(agree=False), **{name: rejected})
    assert verdict(nav, name).insisted == insists
    nav = of(sensor(agree=False), **{name: rejected})
    assert not verdict(nav, name, nis=2.0 * LIMIT).insisted  # not used
    assert not verdict(of(sensor()), name).insisted
    nav = of(sensor(agree=False), **{name: rejected})
    assert not verdict(nav, name, z=5.0 * X).insisted


@pytest.mark.parametrize("nis, insists", [(1.01, True), (0.99, False)])
def test_a_velocity_far_off_to_the_same_side_insists_if_it_passes_only_just(nis, insists):
    """Beyond the quantile of one in a hundred."""
    narrow = stats.chi2.isf(1e-2, 3)
    rejected = HEALTHY._replace(used=5, rejected=1, far=True, evidence=evidence(X), first=evidence(X))
    nav = of(sensor(agree=False), gps_velocity=rejected)
    assert verdict(nav, z=3.0 * X, nis=nis * narrow).insisted == insists


def slope_of(name, rows=0, block="velocity", H=None, fate=Fate.USED, confirmed=False, forgot=False):
    """What `of_measurement` asks for, by name."""
    order, n = layout(("mounting",)), layout(("mounting",)).n
    P = np.eye(n) + 0.01
    sensors = {name: SimpleNamespace(rows=rows, block=block, gate_probability=None)}
    axes = SimpleNamespace(axes=lambda *_: np.vstack([ONE, [0.0, 0.0, 1e-4]]))
    watch = SimpleNamespace(protection=axes)
    nav = SimpleNamespace(limits=filter_of().limits, sensors=sensors, watch=watch, layout=order, earth=None)
    H = np.zeros((3, n)) if H is None else H
    H[:3, 3:6] = ONE
    after = P - P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(len(H))) @ H @ P
    measurement = SimpleNamespace(sensor=name, admitted=None, fate=fate)
    now = SimpleNamespace(P=after, t_s=0.0, x=None)
    prior = 4.0 * P if forgot else P
    return integrity_protection.of_measurement(nav, now, measurement, P, prior, H, np.eye(len(H)), confirmed)


def test_a_slope_follows_from_how_a_sensor_is_gated():
    """Stars apart from the others; positions and velocities bound what they measure; resets are confirmed."""
    plain = slope_of("gps_velocity")
    assert not plain.stars and np.isfinite(plain.table[5, 3:6]).all() and np.isinf(plain.table[5, :3]).all()
    assert np.isinf(slope_of("barometer", block=None).table[5]).all()
    assert np.isinf(slope_of("gps_velocity", forgot=True).table[5]).all()
    assert slope_of("star_tracker").stars and slope_of("star_vectors", rows=2, H=np.zeros((4, 18))).stars
    many = slope_of("gps_range_rate", rows=1)
    assert not many.stars and np.isinf(many.table[5]).all()
    for given in ({"fate": Fate.RESET}, {"confirmed": True}):
        surer = slope_of("gps_velocity", **given)
        assert np.all(surer.table[0, 3:6] <= plain.table[0, 3:6] * (1.0 + 1e-9))
    wide = slope_of("gps_velocity", forgot=True)
    np.testing.assert_allclose(wide.table[1], plain.table[1])  # before anything was forgotten
