"""A filter that went wrong, and receivers that say little: when they are believed after all."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, antenna_of, fly, gps_fix, state_at
from unpacked import felt, window

from shefex_nav.geometry import frames
from shefex_nav.onboard.navigation import fusion, measure_ranges
from shefex_nav.onboard.navigation.state import layout
from shefex_nav.records import GpsRanges

BLOCKS, STATES = fly(9.0)
TIGHT = PARAMS._replace(
    states=("gyro_roll_column", "mounting", "clock"),
    sigma_blocks=PARAMS.sigma_blocks | {"clock": np.array([10.0, 1.0])},
    clock_white=0.1,
    clock_walk=0.1,
    gps="tight",
)
ORDER = layout(TIGHT.states)


def run(arrivals, start, params=PARAMS):
    """Results of a filter that gets (arrival, fix) in time, and its error of position at the end."""
    nav, waiting, results = fusion.start(params, start, EARTH), sorted(arrivals, key=when)[::-1], []
    for block in BLOCKS:
        fusion.advance(nav, block)
        while waiting and when(waiting[-1]) <= block.t_valid_s + 1e-6:
            results += fusion.fuse(nav, [waiting.pop()])
    return results, np.linalg.norm(nav.history[-1].state.r_i - STATES[-1].r_i)


def when(arrival):
    return arrival[1].t_available_s


def displaced(metres):
    start = alignment(STATES[0])
    return start._replace(r_i=start.r_i + np.asarray(metres))


def without_velocity(fix):
    return fix._replace(v_ea_e=np.full(3, np.nan), R_v_e=np.full((3, 3), np.nan))


def test_a_receiver_without_velocity_is_believed_in_the_end():
    """3 km off: four positions that move as the filter does."""
    fixes = [("gps", without_velocity(gps_fix(BLOCKS, STATES, float(t), 0.2))) for t in range(1, 9)]
    results, error = run(fixes, displaced([0.0, 3000.0, 0.0]))
    assert [r.note for r in results] == ["rejected"] * 3 + ["reset after timeout"] + [""] * 4
    assert error < 5.0


def test_positions_that_jump_about_are_never_believed():
    rng = np.random.default_rng(1)
    fixes = [without_velocity(gps_fix(BLOCKS, STATES, float(t), 0.2)) for t in range(1, 9)]
    fixes = [fix._replace(r_ea_e=fix.r_ea_e + 3000.0 * rng.standard_normal(3)) for fix in fixes]
    results, error = run([("gps", fix) for fix in fixes], alignment(STATES[0]))
    assert {r.note for r in results} == {"rejected"} and error < 1.0


def ranges(t_s, sight_i, wrong=None):
    """GpsRanges without noise of satellites at rest in the directions (n, 3); wrong : (n,) m on top."""
    n, far = len(sight_i), 2.2e7
    state, _ = state_at(BLOCKS, STATES, t_s)
    places = [frames.ecef_from_inertial(EARTH, t_s, STATES[0].r_i + far * u, np.zeros(3)) for u in sight_i]
    r_e, v_e = (np.array(column) for column in zip(*places, strict=True))
    nothing, one = np.zeros(n), np.ones(n)
    message = GpsRanges(
        t_s, t_s + 0.2, np.arange(1, n + 1), nothing, nothing, r_e, v_e, 1.5 * one, 0.05 * one
    )
    k = max(int(np.ceil(t_s * 100.0 - 1e-9)) - 1, 0)
    imu = window(BLOCKS[k], window(BLOCKS[k - 1]))
    motion = felt(STATES[k], imu, imu.length_s)
    args = ORDER, state, message, antenna_of(ORDER, state, EARTH, PARAMS.l_ba_b, *motion, 0.0)
    # what is innovation of a range of nothing is what the range should be, but for its sign
    pseudorange, rate = -measure_ranges.pseudoranges(*args)[0], -measure_ranges.range_rates(*args)[0]
    return message._replace(pseudorange=pseudorange + (nothing if wrong is None else wrong), range_rate=rate)


SIGHT = np.random.default_rng(3).standard_normal((6, 3))
SIGHT /= np.linalg.norm(SIGHT, axis=1, keepdims=True)


def test_one_satellite_that_fits_by_chance_does_not_speak_for_all():
    """2 km off across the line to the first of six satellites, which therefore sees nothing of it."""
    across = np.cross(SIGHT[0], [1.0, 0.0, 0.0])
    off = 2000.0 * across / np.linalg.norm(across)
    sets = [("gps_ranges", ranges(float(t), SIGHT)) for t in range(1, 9)]
    assert np.sum(np.abs(SIGHT @ off) > 50.0) >= 4  # the most of the others do
    results, error = run(sets, displaced(off), TIGHT)
    notes = [r.note for r in results if r.sensor == "gps_range"]
    assert notes[:4] == ["rejected"] * 3 + ["reset after timeout"]
    assert error < 20.0


@pytest.mark.parametrize("number", [1, 2])
def test_one_or_two_wrong_satellites_are_left_out(number):
    wrong = np.where(np.arange(6) < number, 400.0, 0.0)
    sets = [("gps_ranges", ranges(float(t), SIGHT, wrong)) for t in range(1, 9)]
    results, error = run(sets, alignment(STATES[0]), TIGHT)
    found = [r for r in results if r.sensor == "gps_range"]
    names = ", ".join(f"prn {prn}" for prn in range(1, number + 1))
    assert {r.note for r in found} == {f"rejected: {names}"} and all(r.accepted for r in found)
    assert error < 1.0
