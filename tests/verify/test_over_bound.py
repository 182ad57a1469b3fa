"""Errors over the bound: runs and bounds of known sizes."""

import numpy as np
import pytest

from shefex_nav.verify import consistency_figures, over_bound
from shefex_nav.verify.bound import Bound
from shefex_nav.verify.flown import PAD, PHASES, Run

T_S = 0.5 * np.arange(1, 401)  # 200 s
PHASE = np.repeat([PAD, 0, 1, 0, 2, 3], [20, 80, 60, 60, 120, 60])


def of(sizes, rng, number=300):
    """Runs with errors of these sigmas on each axis (position, velocity, attitude), and bounds of 1."""
    runs, pairs = [], []
    unit = np.tile(np.eye(3), (len(T_S), 1, 1))
    for seed in range(number):
        errors = rng.standard_normal((len(T_S), 15))
        for k, size in enumerate(sizes):
            errors[:, 3 * k : 3 * k + 3] *= size
        runs.append(Run(seed, T_S, PHASE, errors, np.tile(4.0 * np.eye(15), (len(T_S), 1, 1)), {}, {}, {}))
        pairs.append((Bound(T_S, unit, unit, unit), Bound(T_S, 0.25 * unit, unit, unit)))
    return runs, pairs


def test_ratio_of_errors_that_are_known():
    """Errors of 1, 1.5 and 2 over a bound of 1; 300 runs, seed 0."""
    found = over_bound.curves(*of((1.0, 1.5, 2.0), np.random.default_rng(0)))
    result = over_bound.ratios(found)
    assert tuple(result) == PHASES[:4]
    for values in result.values():
        assert values["ratio"] == pytest.approx([1.0, 1.5, 2.0], rel=0.02)
        assert values["ratio_known"] == pytest.approx([2.0, 1.5, 2.0], rel=0.02)
        assert values["sigma"] == pytest.approx(np.full(3, np.sqrt(12.0)), rel=1e-9)


def test_the_first_seconds_of_each_stretch_do_not_count():
    """Errors a hundred times larger in them change nothing, in any of the two stretches of the boost."""
    runs, pairs = of((1.0, 1.0, 1.0), np.random.default_rng(1), number=20)
    before = over_bound.ratios(over_bound.curves(runs, pairs))
    for run in runs:
        for begin in (20, 100, 160, 220, 340):
            run.errors[begin : begin + 20] *= 100.0
    after = over_bound.ratios(over_bound.curves(runs, pairs))
    for name in before:
        assert after[name]["ratio"] == pytest.approx(before[name]["ratio"])


def test_other_epochs_are_refused():
    runs, pairs = of((1.0, 1.0, 1.0), np.random.default_rng(2), number=1)
    moved = [(pairs[0][0]._replace(t_s=T_S + 0.25), pairs[0][1])]
    with pytest.raises(ValueError, match="other epochs"):
        over_bound.curves(runs, moved)


def test_pictures_are_drawn(tmp_path):
    runs, pairs = of((1.0, 1.0, 1.0), np.random.default_rng(3), number=4)
    found = {"one": over_bound.curves(runs, pairs), "two": over_bound.curves(runs[:2], pairs[:2])}
    consistency_figures.draw_bound(found, tmp_path / "bound.png", runs=4)
    consistency_figures.draw_nees(runs, tmp_path / "nees.png")
    assert (tmp_path / "bound.png").stat().st_size > 20000
    assert (tmp_path / "nees.png").stat().st_size > 20000
