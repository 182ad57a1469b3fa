"""The filter of the default mission against its own statistics, small enough for every day.

IMU, GPS and truth are those of the mission; star fixes are drawn from the true attitude and mounting with a
known noise, so that no frames are needed. A study over 100 seeds with rendered frames, with the time averages
of all blocks, is `benchmarks/consistency.py`.
"""

from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.geometry.rotation import quat_from_rotvec, quat_multiply
from shefex_nav.records import Detections, StarFix
from shefex_nav.scenario import load
from shefex_nav.verify import consistency, flown

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
SEEDS = (0, 1)
ARCSEC = np.pi / 180.0 / 3600.0
SIGMA_C = np.array([0.9, 0.9, 8.0]) * ARCSEC  # as of the star tracker in this mission
BEGIN_S, END_S = 252.0, 372.0
NOTHING = Detections(
    np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros((0, 2, 2))
)


def fixes(world, rng):
    """Ten star fixes a second, with noise of SIGMA_C about the truth."""
    trajectory, found = world.flight.trajectory, []
    for number, t_s in enumerate(np.arange(BEGIN_S, END_S, 0.1)):
        k = int(np.searchsorted(trajectory.t_s, t_s - 1e-6))
        q_ic = quat_multiply(trajectory.q_ib[k], world.camera.q_bc)
        q_ic = quat_multiply(q_ic, quat_from_rotvec(SIGMA_C * rng.standard_normal(3)))
        at_s = float(trajectory.t_s[k])
        values = 0.1, 20.0, 0.05, False, False
        none = np.zeros(0, dtype=int)
        found.append(StarFix(number, at_s, at_s + 0.06, 0, q_ic, np.diag(SIGMA_C**2), NOTHING, none, *values))
    return found


@pytest.fixture(scope="module")
def runs():
    """Factor on the sigma of star fixes in the filter -> list of flown.Run."""
    scenario, found = load.load(str(SCENARIO)), {1.0: [], 0.5: []}
    for seed in SEEDS:
        world = prepare.build_world(scenario, seed)
        drawn = fixes(world, np.random.default_rng(seed))
        for factor, done in found.items():
            done.append(flown.filter_run(scenario, seed, drawn, star_factor=factor, world=world))
    return found


@pytest.mark.slow
def test_innovations_are_as_large_as_the_filter_says(runs):
    """NIS of all sensors, 2 seeds, within the 99.9 % of chi-square; refused by the gate: hardly any."""
    verdicts = consistency.judge_nis(runs[1.0])
    assert [one.what for one in verdicts] == ["NIS gps_position", "NIS gps_velocity", "NIS star_tracker"]
    assert [one for one in verdicts if not one.good] == []
    assert all(sum(run.rejected.values()) <= 3 for run in runs[1.0])


@pytest.mark.slow
def test_errors_at_the_ends_of_the_phases_are_within_three_sigma(runs):
    """15 errors at the ends of 4 phases in 2 runs: 120, of which 0.3 are expected outside; 99.9 %: 3."""
    outside = 0
    for run in runs[1.0]:
        for p in range(4):  # a flight with stars has no phase of descent
            k = np.flatnonzero(run.phase == p)[-1]
            outside += int((np.abs(run.errors[k]) > 3.0 * np.sqrt(np.diag(run.P[k]))).sum())
    assert outside <= 3


@pytest.mark.slow
def test_half_the_star_noise_in_the_filter_is_noticed(runs):
    """The same statistic, far outside of the same interval."""
    (star,) = [one for one in consistency.judge_nis(runs[0.5]) if one.what == "NIS star_tracker"]
    assert star.value > 2.0 * star.high
