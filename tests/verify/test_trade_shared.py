"""What combinations of a trade share, and what they must not: each is predicted as it would be by itself."""

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.scenario import load
from shefex_nav.verify import over_bound
from shefex_nav.verify.trade import predict

NAME = "shefex2_andoya"


@pytest.mark.parametrize(
    "override",
    [
        "star_camera.mounting.boresight=[0, 0, 1]",  # to which the vehicle turns: another flight
        "navigation.told.star_camera.optics.focal_length_error=1 %",
    ],
)
def test_a_combination_is_predicted_as_by_itself(override):
    model = load.star_statistics_of(NAME)
    base, other = load.load(NAME), load.load(NAME, [override])
    shared = predict.Shared(model, 1)
    before = predict.predict(base, shared)
    after, alone = predict.predict(other, shared), predict.predict(other, predict.Shared(model, 1))
    assert before.star_sigma != alone.star_sigma  # it makes a difference
    assert (after.star_fixes, after.star_sigma) == (alone.star_fixes, alone.star_sigma)
    for mine, theirs in zip((*after.errors, *after.largest), (*alone.errors, *alone.largest), strict=True):
        assert mine.what == theirs.what
        for P, Q in zip(mine[2:], theirs[2:], strict=True):
            np.testing.assert_array_equal(P, Q)


def test_an_attitude_that_is_hardly_known_for_some_seconds_is_a_doubt():
    """Spin in the boost makes 5.6 deg of 3 % of the rate, of which GPS and thrust leave 4.2 within 5 s."""
    scenario = load.load(NAME, ["imu.gyro.scale_factor_roll=3 %", "star_tracker.enabled=false"])
    world = prepare.build_world(scenario, 1)
    attitude_b = over_bound.bounds(scenario, world, [])[0].attitude_b
    widest = np.degrees(np.sqrt(np.einsum("kii->ki", attitude_b).max()))
    assert widest > 5.5  # the bound, twice a second
    assert predict.predict(scenario, predict.Shared(None, 1)).doubtful


LATE = "gps.clock_offset=50 ms"  # 100 m at 2 km/s


def test_stamps_that_are_late_are_refused():
    with pytest.raises(predict.NoPredictionError, match=r"gps\.clock_offset \(it takes the stamps"):
        predict.predict(load.load("no_star_tracker", [LATE]), predict.Shared(None, 1))
    for told in ("clock_offset=50 ms", "latency=0.2 s"):
        assert not over_bound.left_out(load.load("no_star_tracker", [LATE, f"navigation.told.gps.{told}"]))


def test_stamps_that_are_late_as_the_computer_is_told_change_nothing():
    short = ["mission.time_limit=100 s", "star_tracker.off=100 s", "star_tracker.enabled=false"]
    told = load.load("night_sky", [*short, LATE, "navigation.told.gps.clock_offset=50 ms"])
    flight = over_bound.flight_of(told, prepare.build_world(told, 1), [])
    on_time = prepare.build_world(load.load("night_sky", short), 1).gps_fixes
    assert [one.t_valid_s for one in flight.gps_fixes] == pytest.approx([one.t_valid_s for one in on_time])
