"""Ratios of RMS of missions with common draws, against samples whose ratio and correlation are known."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PAIRS, FURTHER, TRUE = 300, 700, np.array([1.0, 0.9, 1.3])
SAMPLES, DRAWS = 150, 200
SHARED = 0.8  # correlation of the errors; of their squares it is the square of that
NAMES = ("independent", "paired", "controlled")


@pytest.fixture(scope="module")
def module():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        yield SimpleNamespace(
            ratios=importlib.import_module("paired_ratios"), compare=importlib.import_module("statistical")
        )


def sample(rng, shared, n=PAIRS, m=FURTHER):
    """Errors a, b of pairs and further a; normal, of a the RMS is TRUE times that of b."""
    cause = shared**0.5 * rng.normal(size=(n, 3))
    a, b = (cause + (1.0 - shared) ** 0.5 * rng.normal(size=(n, 3)) for _ in range(2))
    return TRUE * a, b, TRUE * rng.normal(size=(m, 3))


def estimates(ratios, a, b, further, rng, draws=DRAWS):
    return (
        ratios.independent(np.concatenate([a, further]), b, rng, draws),
        ratios.paired(a, b, rng, draws),
        ratios.controlled(a, b, further, rng, draws),
    )


@pytest.fixture(scope="module")
def many(module):
    """(samples, estimators, 3 axes) of ln ratio over the true one, of coverage, of width."""
    rng, rows = np.random.default_rng(20), []
    for _ in range(SAMPLES):
        found = estimates(module.ratios, *sample(rng, SHARED), rng)
        rows.append(
            [[np.log(one.ratio / TRUE), (one.low <= TRUE) & (one.high >= TRUE), one.width] for one in found]
        )
    return [np.array([[one[k] * np.ones(3) for one in row] for row in rows], float) for k in range(3)]


@pytest.mark.slow
def test_ratios_scatter_by_the_formulas_of_their_docstring(many):
    """var ln R^2 of normal errors, whose squares have v = 2 and rho = SHARED^2; 450 samples: 3.3 %."""
    v, rho, n, total = 2.0, SHARED**2, PAIRS, PAIRS + FURTHER
    together = -2.0 * v * rho / total  # what independent samples would not have
    wanted = [
        v / total + v / n + together,
        2.0 * v * (1.0 - rho) / n,
        v * (1.0 - rho**2) / n + v * (1.0 - rho) ** 2 / total,
    ]
    scatter = np.sqrt((4.0 * many[0] ** 2).mean(axis=(0, 2)))
    np.testing.assert_allclose(scatter, np.sqrt(wanted), rtol=0.1)
    assert wanted[2] < wanted[1] < wanted[0]
    assert np.all(np.abs(many[0].mean(axis=(0, 2))) < 0.007)


@pytest.mark.slow
def test_intervals_of_pairs_hold_the_true_ratio_as_often_as_they_say(many):
    """0.95 with a standard error of 1.0 %; independent ones of such samples are too wide."""
    independent, paired, controlled = many[1].mean(axis=(0, 2))
    assert independent > 0.96
    for share in (paired, controlled):
        assert 0.915 < share < 0.98
    widths, scatter = many[2].mean(axis=(0, 2)), many[0].std(axis=(0, 2))
    assert widths[2] < widths[1] < widths[0]
    np.testing.assert_allclose(widths[1:] / scatter[1:], 2.0 * 1.96, rtol=0.1)
    assert widths[0] / scatter[0] > 2.0 * 1.96 * 1.1


@pytest.mark.slow
def test_without_correlation_independent_intervals_hold_as_often_as_they_say(module):
    rng, held = np.random.default_rng(3), []
    for _ in range(SAMPLES):
        a, b, further = sample(rng, 0.0)
        one = module.ratios.independent(np.concatenate([a, further]), b, rng, DRAWS)
        held.append((one.low <= TRUE) & (one.high >= TRUE))
    assert 0.915 < np.mean(held) < 0.98


def test_errors_that_are_the_same_have_no_interval_but_those_of_independent_samples(module):
    """A tracker that changes nothing: the pairs show it exactly."""
    rng = np.random.default_rng(1)
    errors = rng.normal(size=(50, 3))
    independent, paired, controlled = estimates(module.ratios, errors, errors, rng.normal(size=(80, 3)), rng)
    for one in (paired, controlled):
        np.testing.assert_allclose([one.ratio, one.low, one.high], 1.0, rtol=1e-12)
    assert np.all(independent.low < 0.95) and np.all(independent.high > 1.05)
    np.testing.assert_allclose(module.ratios.correlation(errors, errors), 1.0)


# ---- what the benchmark makes of two campaigns -------------------------------------------------------------


class Campaign(SimpleNamespace):
    """What the benchmark reads of a campaign, its columns by name as of results.Campaign."""

    def __getitem__(self, name):
        return {"seed": self.runs * 1000 + self.root}[name]


def flown(errors, root=1):
    """A campaign with a root seed; an error of NaN is of a run that did not come to entry."""
    runs = np.arange(len(errors))
    columns = {f"summary.navigation.at_entry.attitude_error_deg.{axis}": errors[:, axis] for axis in range(3)}
    drawn = np.array([np.random.default_rng([root, run]).normal() for run in runs])
    draws = {"wind.speed": drawn, "launch.elevation": np.round(drawn, 2)}
    return Campaign(root=root, runs=runs.astype(float), draws=draws, numbers=columns.__getitem__)


def test_campaigns_of_one_seed_share_their_draws_and_the_smallest_interval_judges(module):
    rng = np.random.default_rng(5)
    a, b, further = sample(rng, SHARED)
    a, b = a / TRUE, b.copy()
    further = further / TRUE
    b[7] = np.nan  # no entry: no pair, and its statistical run is none of the further ones
    result = module.compare.compared(flown(b), flown(np.concatenate([a, further])), rng)
    assert result["shared"] == [PAIRS, PAIRS] and result["judged_by"] == "controlled"
    assert result["samples"] == {
        "rendered": PAIRS - 1,
        "statistical": 1000,
        "pairs": PAIRS - 1,
        "further": 700,
    }
    assert [one.name for one in result["estimates"]] == list(NAMES)
    np.testing.assert_allclose(result["correlation"], SHARED**2, atol=0.12)


def test_of_campaigns_of_two_seeds_there_is_the_independent_estimate_alone(module):
    rng = np.random.default_rng(6)
    result = module.compare.compared(
        flown(rng.normal(size=(60, 3))), flown(rng.normal(size=(90, 3)), root=2), rng
    )
    assert result["shared"] == [0, 60] and result["judged_by"] == "independent"
    assert [one.name for one in result["estimates"]] == ["independent"] and result["correlation"] is None
    lone = module.ratios.independent(np.ones((90, 3)), np.ones((60, 3)), rng, 10)
    assert lone.ratio == pytest.approx(np.ones(3))


def test_pairs_without_further_runs_have_no_control_variate(module):
    rng = np.random.default_rng(7)
    a, b, _ = sample(rng, SHARED)
    result = module.compare.compared(flown(b), flown(a), rng)
    assert [one.name for one in result["estimates"]] == ["independent", "paired"]
    assert result["judged_by"] == "paired"
