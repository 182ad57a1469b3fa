"""A filter that is told too little noise of its IMU: it says so, counts more, and goes on."""

import numpy as np
import pytest
from navigation_flight import DT, EARTH, MODEL, PARAMS, alignment, fly, gps_fix

from shefex_nav.onboard.navigation import adaptation, error_model, fusion
from shefex_nav.onboard.navigation.gate import Verdict
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensor import Correction, Interval

SECONDS = 75
TRUE = MODEL._replace(
    gyro_random_walk=3e-4, accel_random_walk=0.15, gravity=0.0, accel_scale=0.0, accel_misalignment=0.0
)


def flown(told, seed, recorder=None):
    """Filter at the end, GateResult, NavHealth and position errors of a drive with noise TRUE."""
    blocks, states = fly(SECONDS)
    rng, nav = np.random.default_rng(seed), None
    noise = np.repeat([TRUE.gyro_random_walk, TRUE.accel_random_walk], 3) * np.sqrt(DT)
    params = PARAMS._replace(
        imu=TRUE._replace(
            gyro_random_walk=told * TRUE.gyro_random_walk, accel_random_walk=told * TRUE.accel_random_walk
        ),
        motors=np.zeros((0, 2)), states=(), sigma_blocks={},
    )  # fmt: skip
    nav = fusion.start(params, alignment(states[0]), EARTH, recorder)
    gates, health, errors = [], [], []
    for n, (block, state) in enumerate(zip(blocks, states[1:], strict=True), 1):
        read = noise * rng.standard_normal((4, 6))
        fusion.advance(
            nav, block._replace(dtheta_b=block.dtheta_b + read[:, :3], dv_b=block.dv_b + read[:, 3:])
        )
        if n % 100 == 20 and n > 100:
            fix = gps_fix(blocks, states, (n - 20) / 100.0, 0.2, rng)
            gates += fusion.fuse(nav, [("gps", fix)])
            health += nav.watch.changes()
            errors.append(np.linalg.norm(nav.history.x[:3] - state.r_i))
    fusion.finish(nav)
    return nav, gates, health, np.array(errors)


@pytest.fixture(scope="module")
def wrong():
    kept = []
    return *flown(0.1, 1, kept.append), kept


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_told_right_is_left_alone(seed):
    nav, gates, health, _ = flown(1.0, seed)
    assert nav.noise.imu == 1.0
    assert not nav.noise.schedule
    assert not [one for one in health if "noise" in one.source]
    assert np.isinf(nav.constants[1]["from_s"][1:]).all()
    assert not [one for one in gates if "told" in one.note]


def test_noise_told_too_small_is_said_and_counted(wrong):
    nav, gates, health, errors, _ = wrong
    remarks = [one for one in health if one.source == "imu noise"]
    assert remarks[0].reason.startswith("IMU noise told too small: counts")
    assert not remarks[0].healthy
    assert [one for one in gates if one.note.startswith("IMU noise told too small")]
    assert 3.0 < nav.noise.imu <= 16.0  # ten times, and it has had a minute
    after = [one.nis for one in gates if one.sensor == "gps_velocity" and one.t_s > nav.noise.schedule[-1][0]]
    assert np.mean(after) < 2.0 * 3  # degrees of freedom
    resets = [one for one in gates if one.note == "reset after timeout"]
    assert len([one for one in resets if one.sensor == "gps_velocity"]) <= 2
    *_, right = flown(1.0, 1)
    late = slice(20, None)
    assert np.sqrt((errors[late] ** 2).mean()) < 1.5 * np.sqrt((right[late] ** 2).mean())


def test_noise_told_too_large_never_shrinks_the_covariance():
    nav, _, health, _ = flown(5.0, 1)
    assert nav.noise.imu == 1.0
    assert not [one for one in health if "noise" in one.source]


def test_a_recorder_gets_the_noise_that_counted(wrong):
    """Q of velocity over a tick is N^2 T as it counted then; and what grew is recorded, too."""
    nav, *_, kept = wrong
    since_s = nav.noise.schedule[0][0]
    whole = [one for one in kept if isinstance(one, Interval) and one.t_end_s - one.t_begin_s > 0.0099]
    told = (0.1 * TRUE.accel_random_walk) ** 2
    for one in whole[:: max(len(whole) // 50, 1)]:
        factor = 1.0
        for from_s, imu, _ in nav.noise.schedule:
            factor = imu if one.t_end_s > from_s + 1e-9 else factor
        assert one.Q[3, 3] / 0.01 == pytest.approx(factor**2 * told, rel=0.05)
    assert whole[0].t_end_s < since_s < whole[-1].t_begin_s
    grown = [one for one in kept if isinstance(one, Correction) and one.fate == Fate.RESET]
    assert any(np.trace(one.P_forgotten) > 3.0 * np.trace(one.P) for one in grown)


def test_the_smoother_begins_with_the_schedule(wrong):
    nav = wrong[0]
    fresh = fusion.start(nav.params, alignment(fly(SECONDS)[1][0]), EARTH)
    model = adaptation.replayed(fresh, nav.noise.schedule).constants[1]
    for from_s, imu, _ in nav.noise.schedule:
        row = model[error_model.valid(model, from_s + 0.01)]
        assert row["accel_random_walk"] == pytest.approx(imu * nav.params.imu.accel_random_walk)
    assert model["accel_random_walk"][0] == nav.params.imu.accel_random_walk
    assert adaptation.replayed(fresh, []) is fresh


def test_rows_that_no_memory_reaches_make_room():
    """Many factors one after the other: the model keeps those that the filter may go back to."""
    params = PARAMS._replace(imu=TRUE)
    model = error_model.record(params)
    schedule = [(float(k), 1.0 + 0.1 * k, (1.0, 1.0)) for k in range(1, 40)]
    adaptation.scheduled(model, TRUE, schedule, since_s=36.5)
    for t_s, factor in ((36.9, 4.6), (37.5, 4.7), (39.5, 4.9)):
        row = model[error_model.valid(model, t_s)]
        assert row["gyro_random_walk"] == pytest.approx(factor * TRUE.gyro_random_walk)


def noisy_receiver(seed, told=0.5):
    """Filter at the end of a drive with fixes that report `told` times their noise, and NavHealth."""
    blocks, states = fly(SECONDS)
    rng, health = np.random.default_rng(seed), []
    quiet = MODEL._replace(gravity=0.0, accel_scale=0.0, accel_misalignment=0.0)
    params = PARAMS._replace(imu=quiet, motors=np.zeros((0, 2)), states=(), sigma_blocks={})
    nav = fusion.start(params, alignment(states[0]), EARTH)
    noise = np.repeat([quiet.gyro_random_walk, quiet.accel_random_walk], 3) * np.sqrt(DT)
    for n, block in enumerate(blocks, 1):
        read = noise * rng.standard_normal((4, 6))
        fusion.advance(
            nav, block._replace(dtheta_b=block.dtheta_b + read[:, :3], dv_b=block.dv_b + read[:, 3:])
        )
        if n % 100 == 20 and n > 100:
            fix = gps_fix(blocks, states, (n - 20) / 100.0, 0.2, rng)
            fix = fix._replace(R_r_e=told**2 * fix.R_r_e, R_v_e=told**2 * fix.R_v_e)
            fusion.fuse(nav, [("gps", fix)])
            health += nav.watch.changes()
    return nav, health


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_white_innovations_that_are_too_large_twice_are_noise_of_the_receiver(seed):
    """Half of its noise is reported; the mean square of some innovations tells it roughly."""
    nav, health = noisy_receiver(seed)
    assert 1.4 < nav.noise.of_sensor("gps_position") < 2.8
    assert 1.4 < nav.noise.of_sensor("gps_velocity") < 2.8
    assert nav.noise.imu == 1.0
    assert next(one for one in health if one.source == "gps_velocity noise").t_s < 40.0
    nav, _ = noisy_receiver(seed, 1.0)
    assert nav.noise.sensors == {} and nav.noise.imu == 1.0


@pytest.mark.parametrize(
    "position, velocity, own, confirmed, to_blame",
    [
        (2.0, 1.9, 0.8, False, True),
        (2.0, 4.0, 0.8, False, False),  # more than a receiver's noise makes: the IMU
        (1.0, 2.0, 0.8, False, False),  # positions are as good as they say
        (2.0, 1.9, 0.4, False, False),  # what makes them too large can be the IMU as well
        (2.0, 1.9, 0.8, True, False),
    ],
)
def test_positions_tell_the_noise_of_the_receiver_from_that_of_the_imu(
    position, velocity, own, confirmed, to_blame
):
    """Innovations of a velocity do not; an accusation of the IMU that nothing confirms is taken back."""
    blocks, states = fly(2)
    nav = fusion.start(PARAMS, alignment(states[0]), EARTH)
    fusion.advance(nav, blocks[0])
    adaptation.widen(nav, nav.history, 2.0, Verdict(Fate.USED, None, None, "", True), "test")
    nav.noise.confirmed = confirmed
    w = np.random.default_rng(1).standard_normal((2, 20, 3))
    assert adaptation._blame_if_white(nav, position * w[0], own, velocity * w[1]) == to_blame
    assert (nav.noise.imu == 1.0) == to_blame and (nav.noise.share is None) == to_blame
    factors = [nav.noise.of_sensor(name) for name in ("gps_position", "gps_velocity")]
    assert factors[0] == factors[1]
    assert (1.8 < factors[0] < 2.6) == to_blame


def test_noise_of_the_imu_that_throws_velocities_far_beyond_the_gate_is_blamed(monkeypatch):
    """Velocities that are reset while far off insist on nothing: the second reset says that it is the IMU."""
    monkeypatch.setattr("test_adaptation.TRUE", TRUE._replace(accel_random_walk=1.5))
    nav, *_ = flown(0.02, 1)
    assert nav.noise.imu > 3.0
