"""By how much a flight with fewer star fixes may differ: against filters of which one really gets fewer."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
FIXES, WANTED, TRIALS = 200, np.arange(200) % 10 != 0, 300


@pytest.fixture(scope="module")
def faults():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(BENCHMARKS)
        yield importlib.import_module("faults")


def flight(measured, used):
    """Mean so far of a constant angle about three axes from the fixes that are used: error and sigma."""
    weight = np.cumsum(used)[:, None].clip(1)
    error = np.zeros((FIXES, 9))
    error[:, 6:] = -np.cumsum(measured * used[:, None], axis=0) / weight
    sigma = np.ones((FIXES, 9))
    sigma[:, 6:] = 1e-4 / np.sqrt(weight)
    t_s = np.arange(FIXES, dtype=float)
    return SimpleNamespace(
        error=error,
        sigma=sigma,
        entry_s=FIXES,
        during=lambda begin_s, end_s: (t_s >= begin_s) & (t_s < end_s),
    )


def test_what_fewer_fixes_explain_passes_and_a_wrong_fix_that_is_used_does_not(faults):
    rng, above, found = np.random.default_rng(3), 0, 0
    for _ in range(TRIALS):
        measured = 1e-4 * rng.standard_normal((FIXES, 3))
        more = flight(measured, np.ones(FIXES, dtype=bool))
        moved, chance = faults.difference(flight(measured, WANTED), more, 11.0)
        above += moved > chance
        wrong = measured.copy()
        wrong[101] += 0.01  # half a degree
        moved, chance = faults.difference(flight(wrong, WANTED), more, 11.0)
        found += moved > chance
    assert above <= 2  # once in 1000 flights is meant
    assert found == TRIALS


def test_the_ratio_over_flights_is_that_of_their_rms(faults):
    rng = np.random.default_rng(4)
    clean = np.abs(rng.standard_normal(40)) + 0.1
    rows = [{"attitude, deg": 1.05 * one, "without wrong ones, deg": one} for one in clean]
    text, kept = faults.blinded_over_all(rows)
    assert "1.050, 99 %: 1.050 to 1.050; 0 of 40 flights above 1.1" in text and kept == {"1.1 over all": True}
    rows[0]["attitude, deg"] = 8.0 * clean.max()
    text, kept = faults.blinded_over_all(rows)
    assert "1 of 40 flights above 1.1" in text and kept == {"1.1 over all": False}
