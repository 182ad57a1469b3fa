"""Which noise the filter blames, and how much more of it counts: case by case, without a flight.

Whitened innovations are given as numbers. White ones have neighbours that do not hang together, those of
process noise keep their sign; a factor is that of the standard deviation, so its square that of the variance.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import MODEL, PARAMS

from shefex_nav.onboard.navigation import adaptation, error_model
from shefex_nav.onboard.navigation.adaptation import Noise
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.gate import Verdict
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate, Steps
from shefex_nav.onboard.navigation.integrity_bank import Stream
from shefex_nav.onboard.navigation.noise_evidence import Estimate
from shefex_nav.onboard.navigation.sensor import Innovation
from shefex_nav.onboard.navigation.state import ATT, layout

USED = Verdict(Fate.USED, None, None, "", True)
BELIEVED = USED._replace(fate=Fate.RESET)
P = np.eye(15) + 0.1  # ties between all errors
NOW_S = 50.0


def filter_of(moved=None, **health):
    """What of a Filter is looked at here; it remembers whether its bank began anew. moved : an open step"""
    anew, steps = [], Steps()
    if moved is not None:
        steps.add(moved)
    records = {"gps_position": HEALTHY._replace(used=100), "gps_velocity": HEALTHY._replace(used=100)}
    return SimpleNamespace(
        noise=Noise(), params=PARAMS._replace(imu=MODEL), layout=layout(()), health={**records, **health},
        constants=SimpleNamespace(model=error_model.record(PARAMS)),
        history=SimpleNamespace(ends_s=[0.0, NOW_S], P=P, newest=1, oldest=0, number=lambda k: k),
        watch=SimpleNamespace(
            pending=[], moved=steps, imu_blind=False, gyros=SimpleNamespace(noise=np.zeros(5))
        ),
        bank=SimpleNamespace(begin_anew=lambda: anew.append(True), anew=anew),
    )  # fmt: skip


def white(size, count=10):
    """(count, 3) of mean square size^2 whose neighbours have opposite signs in turn: they cancel."""
    signs = np.array([1.0, 1.0, -1.0, -1.0])
    return [size * signs[k % 4] * np.ones(3) for k in range(count)]


def alike(size, count=10):
    """(count, 3) of one sign."""
    return [size * np.ones(3)] * count


def count(nav, factor):
    """Let noise of the IMU count by an alarm; what was said and remembered of it is cleared."""
    adaptation.widen(nav, SimpleNamespace(P=P), factor, USED, "")
    nav.watch.pending.clear()


def test_neighbours_are_told_from_white_ones():
    assert adaptation.neighbours(np.array(white(3.0, 20))) < 2.0 < adaptation.neighbours(np.array(alike(3.0)))
    assert adaptation._is_white(white(2.0)) and not adaptation._is_white(alike(2.0))
    assert not adaptation._is_white(white(2.0, 9))  # too few to say


@pytest.mark.parametrize("step, counts", [(2.0, 2.0), (4.0, 4.0), (100.0, 16.0)])
def test_noise_of_the_imu_counts_from_an_alarm_on(step, counts):
    """Random walks and bias walks by the factor, in standard deviation; the covariance grows with them."""
    nav = filter_of()
    got = adaptation.widen(nav, SimpleNamespace(P=P), step, USED, "why")
    assert got.fate == Fate.RESET and isinstance(got.admitted, Grown) and got.note.endswith("too small: why")
    assert got.admitted.factors.tolist() == [step] * ATT.start + [1.0] * 9  # not what is hardly known
    assert nav.noise.imu == counts and nav.noise.schedule == [(NOW_S, counts, (1.0, 1.0))]
    before, after = (nav.constants.model[k] for k in (0, 1))
    assert before["from_s"] == -np.inf and after["from_s"] == NOW_S
    for name in ("gyro_random_walk", "accel_random_walk", "gyro_bias_walk", "accel_bias_walk"):
        assert before[name] == getattr(MODEL, name)
        assert after[name] == pytest.approx(counts * getattr(MODEL, name))
    assert nav.watch.gyros.noise[0] == pytest.approx((counts * MODEL.gyro_random_walk) ** 2)
    assert nav.noise.share.skip == 10 and not nav.watch.pending[0].healthy
    again = adaptation.widen(nav, SimpleNamespace(P=P), 1.5, USED, "")
    assert nav.noise.imu == min(1.5 * counts, 16.0)  # factors multiply, up to the largest
    assert (again is USED) == (counts == 16.0)


def test_the_worst_of_rest_and_innovations_counts():
    """White noise by the larger factor; that at rest says nothing of the walk of the biases."""
    model = error_model.record(PARAMS)
    adaptation.scheduled(model, MODEL, [(10.0, 2.0, (3.0, 1.5))])
    row = model[error_model.valid(model, 11.0)]
    assert row["gyro_random_walk"] == pytest.approx(3.0 * MODEL.gyro_random_walk)
    assert row["accel_random_walk"] == pytest.approx(2.0 * MODEL.accel_random_walk)
    assert row["gyro_bias_walk"] == pytest.approx(2.0 * MODEL.gyro_bias_walk)
    row = model[error_model.valid(model, 9.0)]
    assert row["gyro_random_walk"] == MODEL.gyro_random_walk
    noise = Noise()
    noise.imu, noise.rest = 2.0, (3.0, 1.0)
    assert noise.gyro == 3.0 and noise.of_sensor("gps_position") == 1.0


def reset(nav, recent, name="gps_velocity", t_s=NOW_S, verdict=BELIEVED):
    nav.noise.recent[name] = recent
    return adaptation._second_reset(nav, SimpleNamespace(t_s=t_s, P=P), name, verdict)


def test_one_reset_is_the_sensor_and_a_second_one_within_a_minute_the_filter():
    nav, far = filter_of(), alike(5.0)
    assert reset(nav, far) is BELIEVED and nav.noise.imu == 1.0
    assert reset(nav, far, t_s=NOW_S + 61.0) is BELIEVED and nav.noise.imu == 1.0
    got = reset(nav, far, t_s=NOW_S + 61.0 + 59.0)
    assert got.note.endswith("second reset")
    assert nav.noise.imu == pytest.approx(5.0)  # the largest of the innovations: root mean square
    assert reset(nav, far, t_s=NOW_S + 125.0) is BELIEVED  # the loop begins anew


def test_a_reset_of_small_innovations_is_the_filter_at_once():
    """Below four sigma each has passed the gate; those that contradict from the start are the filter's."""
    first = reset(filter_of(), alike(3.9))
    assert first.fate == Fate.RESET and first.note.endswith("contradicted by little")  # there was no other
    nav = filter_of()
    reset(nav, alike(3.9))
    assert nav.noise.imu == pytest.approx(3.9)
    nav = filter_of()
    assert reset(nav, alike(4.1)) is BELIEVED
    young = filter_of(gps_velocity=HEALTHY._replace(used=5))
    assert reset(young, alike(6.0)).note.endswith("contradicted from the start") and young.noise.imu == 6.0
    assert reset(filter_of(gps_velocity=HEALTHY._replace(used=6)), alike(6.0)) is BELIEVED
    position = filter_of(gps_position=HEALTHY._replace(used=5))
    assert reset(position, alike(6.0), "gps_position") is BELIEVED  # only rates show the inertial sensors


def test_white_resets_are_noise_of_the_sensor():
    nav = filter_of()
    assert reset(nav, white(3.0)) is BELIEVED
    assert nav.noise.sensors == {"gps_velocity": pytest.approx(3.0)} and nav.noise.imu == 1.0
    reset(nav, white(2.0))
    assert nav.noise.of_sensor("gps_velocity") == pytest.approx(6.0)
    doubted = filter_of()
    count(doubted, 2.0)
    assert reset(doubted, white(3.0)) is BELIEVED and not doubted.noise.sensors  # it is the IMU already


def test_a_position_speaks_for_the_velocity_only_if_no_velocity_says_otherwise():
    lost = HEALTHY._replace(used=100, rejected=1)
    for velocity, widens in ((HEALTHY._replace(used=100), False), (lost, True), (HEALTHY, True)):
        nav = filter_of(gps_velocity=velocity)
        reset(nav, alike(3.0), "gps_position")
        assert (nav.noise.imu > 1.0) == widens


@pytest.mark.parametrize("change", [{"admitted": 3.0}, {"insisted": True}])
def test_what_is_admitted_or_insisted_says_nothing_of_the_noise(change):
    nav, verdict = filter_of(), BELIEVED._replace(**change)
    assert reset(nav, alike(3.0), verdict=verdict) is verdict and not nav.noise.resets


def stream(w, own):
    one = Stream(3)
    for each in w:
        one.take(each, NOW_S, own)
    return one


def again(nav, position, velocity, own=(0.8, 0.8), factor=3.0):
    streams = {"gps_position": stream(position, own[0]), "gps_velocity": stream(velocity, own[1])}
    return adaptation.too_large_again(nav, SimpleNamespace(P=P), factor, USED, streams), streams


def test_velocities_that_hang_together_too_large_twice_are_the_imu():
    nav = filter_of()
    got, _ = again(nav, white(1.0), alike(2.0))
    assert got.fate == Fate.RESET and nav.noise.imu == 3.0 and not nav.noise.sensors
    nav = filter_of()
    again(nav, white(1.0), white(2.0), own=(0.8, 0.5))  # hardly the receiver's own noise
    assert nav.noise.imu == 3.0
    nav = filter_of()
    got, _ = again(nav, white(1.0), alike(1.1))  # as large as they should be
    assert got is USED and nav.noise.imu == 1.0


def test_white_ones_too_large_twice_are_the_receiver():
    """w^2 - 1 more than the whole, of which the share of the noise is all that can have grown."""
    nav = filter_of()
    got, streams = again(nav, white(2.0), white(3.0))
    assert got is USED and nav.noise.imu == 1.0
    assert nav.noise.sensors == {
        "gps_position": pytest.approx(np.sqrt(1.0 + 3.0 / 0.8)),
        "gps_velocity": pytest.approx(np.sqrt(1.0 + 8.0 / 0.8)),
    }
    assert not streams["gps_position"].recent and not streams["gps_velocity"].recent
    nav = filter_of()
    again(nav, white(1.0), white(3.0, 9))  # too few to say
    assert not nav.noise.sensors and nav.noise.imu == 1.0
    count(nav, 2.0)
    again(nav, white(2.0), white(3.0))
    assert not nav.noise.sensors  # while the IMU is in doubt


def blamed(nav, position=2.0, velocity=2.0, own=0.8):
    return adaptation._blame_if_white(nav, np.array(white(position)), own, np.array(white(velocity)))


def test_a_receiver_that_says_too_little_of_both_is_blamed():
    """Positions of twice their sigma: 1 + 3/0.8 times the variance, of velocities alike."""
    nav, factor = filter_of(), np.sqrt(1.0 + 3.0 / 0.8)
    nav.noise.sensors["gps_velocity"] = 2.0
    assert blamed(nav) and nav.bank.anew
    assert nav.noise.of_sensor("gps_position") == pytest.approx(factor)
    assert nav.noise.of_sensor("gps_velocity") == pytest.approx(2.0 * factor)
    most = np.sqrt(1.5) * factor  # velocities may have grown half as much again in variance
    assert blamed(filter_of(), velocity=0.99 * most) and not blamed(filter_of(), velocity=1.01 * most)
    assert not blamed(filter_of(), position=1.14) and not blamed(filter_of(), own=0.6)
    short = np.array(white(2.0, 5))
    assert not adaptation._blame_if_white(filter_of(), short, 0.8, short)
    nav = filter_of()
    nav.noise.sensors = {"gps_position": 16.0, "gps_velocity": 16.0}
    assert not blamed(nav)  # both count as much as may be
    nav.noise.sensors["gps_velocity"] = 8.0
    assert blamed(nav)


def test_the_bank_hands_its_streams_over():
    nav = filter_of()
    streams = {"gps_position": stream(white(2.0), 0.8), "gps_velocity": stream(white(2.0), 0.1)}
    assert not adaptation.blame_receiver(nav, {"gps_position": streams["gps_position"]})
    assert not adaptation.blame_receiver(nav, {**streams, "gps_velocity": Stream(3)})
    assert adaptation.blame_receiver(nav, streams)
    assert nav.noise.of_sensor("gps_position") == pytest.approx(np.sqrt(1.0 + 3.0 / 0.8))


def found(excess, sensor=True):
    return SimpleNamespace(excess=excess, sensor=sensor)


def test_the_noise_of_a_sensor_rises_at_once_and_falls_slowly():
    nav = filter_of()
    adaptation._blame(nav, "gps_position", found(4.0), 0.75)
    assert nav.noise.of_sensor("gps_position") == pytest.approx(np.sqrt(1.0 + 3.0 / 0.75))
    word = nav.watch.pending[-1]
    assert (word.t_s, word.source, word.healthy) == (NOW_S, "gps_position noise", False)
    adaptation._blame(nav, "gps_position", found(0.9, sensor=False), 1.0)  # not so much less
    assert nav.noise.of_sensor("gps_position") == pytest.approx(np.sqrt(5.0))
    adaptation._blame(nav, "gps_position", found(0.1, sensor=False), 1.0)
    assert nav.noise.of_sensor("gps_position") == pytest.approx(0.7 * np.sqrt(5.0))
    for _ in range(3):
        adaptation._blame(nav, "gps_position", found(0.1, sensor=False), 1.0)
    assert nav.noise.of_sensor("gps_position") == 1.0 and nav.watch.pending[-1].healthy
    adaptation._blame(nav, "gps_position", found(1e6), 1.0)
    assert nav.noise.of_sensor("gps_position") == 16.0


def test_a_sensor_that_is_right_is_left_alone_and_a_small_factor_is_said():
    """A remark from 1.15 on, what there is no factor of is not taken back."""
    nav = filter_of()
    nav.noise.by_noise["gps_position"].append(0.5)
    adaptation._blame(nav, "gps_position", found(1.0, sensor=False), 1.0)
    assert not nav.noise.sensors and not nav.watch.pending and nav.noise.by_noise["gps_position"]
    adaptation._blame(nav, "gps_position", found(1.3), 1.0)  # 1.14 in standard deviation
    assert nav.noise.of_sensor("gps_position") == 1.0
    adaptation._blame(nav, "gps_position", found(1.4), 1.0)
    assert nav.noise.of_sensor("gps_position") == pytest.approx(np.sqrt(1.4))
    assert not nav.watch.pending[-1].healthy and "about 1.2 times" in nav.watch.pending[-1].reason
    assert not nav.noise.by_noise["gps_position"]


def learn(nav, **estimate):
    """What follows from an estimate of the share of process noise."""
    given = {"count": 40, "share": 0.5, "growth": 1.0, "sigma": 0.1, **estimate}
    calls = []
    nav.noise.share = SimpleNamespace(
        number=0, carry=lambda *_: None, innovation=lambda *a: calls.append("innovation"),
        corrected=lambda *a: calls.append("corrected"), estimate=lambda: Estimate(**given),
        fade=lambda: calls.append("fade"), begin=lambda *a: calls.append("begin"),
    )  # fmt: skip
    return calls


def seen(nav, name="gps_velocity", fate=Fate.USED, rows=3, k=1):
    innovation = Innovation(np.zeros(rows), np.zeros((rows, 15)), np.eye(rows), np.eye(rows), 0.0, np.nan)
    nav.sensors = {name: SimpleNamespace(counted=None)}
    measurement = SimpleNamespace(sensor=name, fix=None)
    adaptation._learn(nav, SimpleNamespace(k=k, P=P), innovation, measurement, fate)


@pytest.mark.parametrize(
    "estimate, factor",
    [
        ({"growth": 2.25}, 1.5),  # standard deviation by the root of the growth of the variance
        ({"growth": 0.64}, 0.8),
        ({"growth": 0.1}, 0.7),  # no more than slowly down
        ({"growth": 1e4}, 4.0),
        ({"growth": 2.25, "count": 29}, 1.0),  # too few
        ({"growth": 2.25, "share": 0.09}, 1.0),  # hardly any process noise in them
        ({"growth": 2.25, "share": 0.11, "count": 30}, 1.5),
        ({"growth": 1.19}, 1.0),  # within two sigma
        ({"growth": 1.21}, 1.1),
    ],
)
def test_the_factor_follows_what_innovations_say(estimate, factor):
    nav = filter_of()
    count(nav, 4.0)
    calls = learn(nav, **estimate)
    seen(nav)
    assert nav.noise.imu == pytest.approx(4.0 * factor)
    assert ("begin" in calls) == (factor != 1.0)
    assert "fade" not in calls and not nav.noise.confirmed


@pytest.mark.parametrize("share, known", [(0.31, True), (0.29, False)])
def test_after_a_hundred_innovations_it_is_said_whether_the_factor_can_be_told(share, known):
    nav = filter_of()
    count(nav, 4.0)
    calls = learn(nav, count=100, share=share)
    seen(nav)
    assert nav.noise.confirmed == known and "fade" in calls and nav.noise.imu == 4.0
    assert ("about 4 times" in nav.noise.told) == known


def test_a_factor_near_one_is_none():
    nav = filter_of()
    count(nav, 2.0)
    nav.noise.confirmed = True
    learn(nav, growth=0.3)  # 1.4 by the slowest way down
    seen(nav)
    assert nav.noise.imu == pytest.approx(1.4)
    learn(nav, growth=0.6)
    seen(nav)
    assert nav.noise.imu == 1.0 and nav.noise.share is None and not nav.noise.confirmed
    assert nav.watch.pending[-1].healthy


@pytest.mark.parametrize(
    "name, fate, calls",
    [
        ("gps_velocity", Fate.USED, ["innovation", "corrected"]),
        ("gps_range_rate", Fate.USED, ["innovation", "corrected"]),
        ("gps_position", Fate.USED, ["corrected"]),  # its velocity says otherwise, or nothing
        ("star_tracker", Fate.USED, ["corrected"]),
        ("gps_velocity", Fate.RESET, []),
        ("gps_velocity", Fate.REJECTED, None),
    ],
)
def test_only_what_shows_the_velocity_tells_of_the_inertial_sensors(name, fate, calls):
    nav = filter_of()
    got = learn(nav, count=0)
    seen(nav, name, fate)
    assert [one for one in got if one in ("innovation", "corrected")] == (calls or [])


def test_readings_at_rest_only_raise_the_noise():
    nav = filter_of()
    for rest, kept in (
        ((2.0, 1.0), (2.0, 1.0)),
        ((1.5, 3.0), (2.0, 3.0)),
        (None, (2.0, 3.0)),
        ((99.0, 1.0), (16.0, 3.0)),
    ):
        nav.noise.still = SimpleNamespace(look=lambda *_, rest=rest: rest)
        adaptation._rest(nav, None)
        assert nav.noise.rest == kept
    assert len(nav.noise.schedule) == 3
    assert (
        nav.noise.told
        == "IMU noise told too small: at rest gyros about 16 times, accelerometers about 3 times"
    )
    assert adaptation._at_rest((1.0, 1.0)) == ""


def test_each_remark_is_made_once():
    nav = filter_of()
    for words in ("a", "a", "", "a"):
        adaptation._report(nav, words)
    assert [(one.reason, one.healthy) for one in nav.watch.pending] == [
        ("a", False),
        ("", True),
        ("a", False),
    ]
