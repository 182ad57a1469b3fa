"""Windows over innovations by a slow search, the share of process noise by its algebra, who is blamed."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from test_noise_that_counts import NOW_S, USED, P, alike, filter_of, white

from shefex_nav.onboard.navigation import adaptation
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.noise_evidence import Finding, Share, Window
from shefex_nav.onboard.navigation.sensor import Innovation

LIMITS = {dof: stats.chi2.isf(1e-9, dof) for dof in (3, 60, 180)}


def slow(seen):
    """Finding of all innovations so far, by the three statistics of the last 20 and 60."""
    large = process = sensor = full = False
    excess = 1.0
    for n in (20, 60):
        if len(seen) < n:
            continue
        w = np.array(seen[-n:])
        size, run = (w**2).sum(), (w.sum(axis=0) ** 2).sum() / n
        near = (w[1:] * w[:-1]).sum() / size * np.sqrt(3.0 * n)
        big = size > LIMITS[3 * n]
        large |= big
        process |= (big or run > LIMITS[3]) and near > 3.0
        sensor, full = n == 60 and big and near < 2.0, n == 60
        excess = size / (3.0 * n)
    return large, process, sensor, excess, full


@pytest.mark.parametrize(
    "scale, tie, offset", [(1.0, 0.0, 0.0), (1.8, 0.0, 0.0), (1.5, 0.6, 0.0), (0.3, 0.0, 1.2)]
)
def test_a_window_finds_what_its_statistics_say(scale, tie, offset):
    """200 innovations: more than are kept at a time."""
    rng, window, seen, w = np.random.default_rng(1), Window(), [], np.zeros(3)
    found = []
    for _ in range(200):
        w = tie * w + scale * np.sqrt(1.0 - tie**2) * rng.standard_normal(3)
        seen.append(w + offset)
        got, wanted = window.take(w + offset), slow(seen)
        assert (got.large, got.process, got.sensor, got.full) == tuple(map(bool, (*wanted[:3], wanted[4])))
        assert got.excess == pytest.approx(wanted[3])
        found.append(got)
    assert any(one.sensor for one in found) == (scale == 1.8)
    assert any(one.process for one in found) == (tie > 0.0 or offset > 0.0)
    last = window.last(20)
    window.take(w)
    np.testing.assert_allclose(last, seen[-20:])
    last[:] = 1e9  # a copy either way
    np.testing.assert_allclose(window.last(20), [*seen[-19:], w])
    window.forget()
    assert window.take(np.zeros(3)) == Finding(False, False, False, 1.0, False) and len(window.last(20)) == 1


def test_there_are_no_innovations_before_the_first():
    assert Window().last(6).shape == (0, 0)


def share_of(n=6):
    return Share(SimpleNamespace(P=np.zeros((n, n)), newest=7))


def test_the_share_of_process_noise_in_innovations():
    """Growth 1 + sum (z^T S^-1 z - m)/sum tr(S^-1 H P_Q H^T), its sigma sqrt(2 rows) over the same sum."""
    rng, one = np.random.default_rng(2), share_of()
    assert one.number == 7 and one.estimate() is None
    A = rng.standard_normal((6, 6))
    one.P = A @ A.T
    over = by_noise = rows = 0.0
    for m in (3, 2, 3):
        H, z, B = rng.standard_normal((m, 6)), rng.standard_normal(m), rng.standard_normal((m, m))
        S = B @ B.T + H @ one.P @ H.T
        one.innovation(z, H, S)
        over += z @ np.linalg.inv(S) @ z - m
        by_noise += np.trace(np.linalg.inv(S) @ H @ one.P @ H.T)
        rows += m
    got = one.estimate()
    assert got.count == 3 and got.share == pytest.approx(by_noise / rows)
    assert got.growth == pytest.approx(1.0 + over / by_noise)
    assert got.sigma == pytest.approx(np.sqrt(2.0 * rows) / by_noise)
    one.fade()
    half = one.estimate()
    assert half.count == 1 and half.growth == pytest.approx(got.growth)
    assert half.share == pytest.approx(got.share) and half.sigma == pytest.approx(np.sqrt(2.0) * got.sigma)
    one.begin(2)
    for count in (0, 0, 1):
        one.innovation(z, H, S)
        assert one.count == count
    one.by_noise = 0.0
    assert one.estimate() is None


def test_a_correction_takes_its_part_of_what_process_noise_has_brought():
    """(I - K H) P_Q (I - K H)^T by the gain of the filter; a part larger than the whole begins anew."""
    rng, one = np.random.default_rng(3), share_of()
    A, H = rng.standard_normal((6, 6)), rng.standard_normal((3, 6))
    whole = A @ A.T + np.eye(6)
    part = 0.5 * whole
    S = H @ whole @ H.T + np.eye(3)
    left = np.eye(6) - whole @ H.T @ np.linalg.inv(S) @ H
    one.P, one.count = part.copy(), 5
    one.corrected(whole, H, S)
    np.testing.assert_allclose(one.P, left @ part @ left.T, atol=1e-10)
    assert one.count == 5 and np.array_equal(one.P, one.P.T)
    for more, anew in ((1.009, False), (1.011, True)):
        one.P, one.count, one.skip = more * whole, 5, 4
        one.corrected(whole, H, S)
        assert (one.count == 0) == (not one.P.any()) == anew and one.skip == 4


def windows(nav, own, name="gps_velocity", position=(), **found):
    """Verdict by windows whose finding is given; those of the position hold what is given."""
    given = {"large": False, "process": False, "sensor": False, "excess": 1.0, "full": True, **found}
    for each in nav.noise.windows:
        nav.noise.windows[each] = SimpleNamespace(
            take=lambda w: Finding(**given), forget=lambda: None,
            last=lambda count, each=each: np.array(position if each == "gps_position" else alike(2.0)),
        )  # fmt: skip
    nav.noise.by_noise[name].clear()
    return adaptation._windows(nav, SimpleNamespace(P=P), np.zeros(3), own, name, USED)


@pytest.mark.parametrize(
    "excess, own, step",
    [
        (4.0, 0.5, np.sqrt(1.0 + 3.0 / 0.5)),  # what the sensor's noise does not share has grown
        (1.1, 0.5, 2.0),
        (30.0, 0.5, 4.0),  # all have passed the gate
        (1.5, 0.95, np.sqrt(1.0 + 0.5 / 0.1)),
        (0.5, 0.5, 2.0),
    ],
)
def test_innovations_that_are_too_large_and_hang_together_are_the_imu(excess, own, step):
    nav = filter_of()
    got = windows(nav, own, process=True, excess=excess)
    assert got.fate == Fate.RESET and isinstance(got.admitted, Grown)
    assert nav.noise.imu == pytest.approx(step) and got.note.endswith("innovations are too large")


def test_who_is_blamed_by_windows():
    """Own noise of more than 0.6 lets a sensor be blamed; too large and little of its own: the IMU."""
    nav = filter_of()
    assert windows(nav, 0.61, large=True, sensor=True, excess=4.0) is USED
    assert (
        nav.noise.of_sensor("gps_velocity") == pytest.approx(np.sqrt(1.0 + 3.0 / 0.61))
        and nav.noise.imu == 1.0
    )
    nav = filter_of()
    assert windows(nav, 0.59, large=True, sensor=True, excess=4.0).fate == Fate.RESET
    assert not nav.noise.sensors
    nav = filter_of()
    assert (
        windows(nav, 0.61, large=True, sensor=True, excess=4.0, full=False) is USED and not nav.noise.sensors
    )
    doubted = filter_of()
    adaptation.widen(doubted, SimpleNamespace(P=P), 2.0, USED, "")
    assert windows(doubted, 0.8, large=True, sensor=True, excess=4.0).fate == Fate.RESET
    assert not doubted.noise.sensors and doubted.noise.imu > 2.0
    nav = filter_of()
    assert windows(nav, 0.5, "gps_position", process=True, excess=4.0) is USED and nav.noise.imu == 1.0
    nav = filter_of()
    assert windows(nav, 0.5) is USED and not nav.noise.sensors and nav.noise.imu == 1.0


def test_the_receiver_is_asked_before_the_imu():
    """Positions of twice their sigma, white and their own noise, explain velocities as large."""
    nav = filter_of()
    nav.noise.by_noise["gps_position"].extend([0.1] * 30 + [0.8] * 20)  # the last 20 count
    assert windows(nav, 0.5, position=white(2.0, 20), process=True, excess=4.0) is USED
    assert nav.noise.imu == 1.0 and nav.noise.of_sensor("gps_position") == pytest.approx(
        np.sqrt(1.0 + 3.0 / 0.8)
    )


def weighed(nav, name="gps_velocity", verdict=USED, vibration=0.0, t_s=NOW_S):
    z = np.array([2.0, 3.0, 1.0])
    S = np.diag([4.0, 9.0, 1.0])
    now = SimpleNamespace(P=P, vibration=vibration, t_s=t_s, k=1)
    measurement = SimpleNamespace(sensor=name, fix=None)
    return adaptation.weigh(nav, now, Innovation(z, None, 0.5 * S, S, 3.0, np.inf), measurement, verdict)


def test_what_is_remembered_of_a_measurement():
    nav = filter_of()
    nav.noise.still = SimpleNamespace(look=lambda *_: None)
    assert weighed(nav) is USED
    np.testing.assert_allclose(nav.noise.recent["gps_velocity"][0], 1.0)
    assert (
        nav.noise.by_noise["gps_velocity"][0] == pytest.approx(0.5)
        and nav.noise.windows["gps_velocity"].n == 1
    )
    for given in ({"vibration": 1.0}, {"verdict": USED._replace(fate=Fate.REJECTED)}):
        weighed(nav, **given)
    assert len(nav.noise.recent["gps_velocity"]) == 3 and nav.noise.windows["gps_velocity"].n == 1
    for given in (
        {"name": "star_tracker"},
        {"verdict": USED._replace(fate=Fate.HELD)},
        {"verdict": USED._replace(fate=Fate.DOUBTED)},
    ):
        weighed(nav, **given)
    nav.watch.imu_blind = True
    weighed(nav)
    assert len(nav.noise.recent["gps_velocity"]) == 3 and "star_tracker" not in nav.noise.recent
    nav.watch.imu_blind = False
    for _ in range(20):
        weighed(nav, verdict=USED._replace(fate=Fate.REJECTED))
    assert len(nav.noise.recent["gps_velocity"]) == 10


def test_a_reset_is_asked_for_its_second_time_unless_the_receiver_has_come_back():
    believed = USED._replace(fate=Fate.RESET)
    nav = filter_of(moved=-np.array([2.0, 3.0, 1.0]))
    assert weighed(nav, "gps_position", believed) is believed and not nav.noise.resets
    nav = filter_of(moved=np.array([2.0, 3.0, 1.0]))
    weighed(nav, "gps_position", believed)
    assert nav.noise.resets or nav.noise.imu > 1.0


def test_rest_is_looked_for_at_each_velocity():
    nav, asked = filter_of(), []
    nav.noise.still = SimpleNamespace(look=lambda *given: asked.append(given))
    for name in ("gps_velocity", "gps_position", "gps_range_rate"):
        weighed(nav, name)
    assert len(asked) == 1
