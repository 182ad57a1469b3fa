"""What is told of the cost of campaigns: a worker's memory is its own, times add up."""

import importlib
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.campaign import flight

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def peak_mb(megabytes):
    """Of a worker that holds so much for a moment."""
    held = np.ones(megabytes * 125_000)
    return flight._peak_memory_mb() if held.any() else None


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="elsewhere the peak may begin with the parent's"
)
def test_the_peak_of_a_worker_is_not_that_of_the_process_that_started_it():
    """This one has had 1 GB, the worker 200 MB beside what Python and NumPy take."""
    held = np.ones(125_000_000)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        found = pool.submit(peak_mb, 200).result()
    assert held.any() and 200.0 < found < 700.0
    assert flight._peak_memory_mb() > 1000.0


def test_times_of_a_campaign_add_up(monkeypatch):
    """Two workers from 3 s on, runs of 10 s, 0.1 s between two; the campaign itself needs 0.05 s for each."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    campaign = importlib.import_module("campaign")
    ends = [
        [campaign.End(13.0 + late + 10.1 * k, 10.0, 5.0 + 0.1 * k) for k in range(6)] for late in (0.0, 0.5)
    ]
    found = campaign.times(ends, 0.0, 65.0, 12)
    assert found["until_the_first_run_s"] == pytest.approx(3.0)
    assert found["after_the_last_run_s"] == pytest.approx(1.0)
    assert found["per_hour"] == pytest.approx(3600.0 * 12 / 65.0)
    assert found["per_hour_in_between"] == pytest.approx(2 * 3600.0 / 10.1)
    assert found["idle_percent"] == pytest.approx(100.0 * 0.1 / 10.1)
    assert found["own_processor_percent"] == pytest.approx(100.0 * 0.5 / (2 * 51.0))
    assert found["overhead_percent"] == pytest.approx(found["idle_percent"] + found["own_processor_percent"])
    alone = campaign.times([ends[0][:1], ends[1][:1]], 0.0, 15.0, 2)
    assert alone["overhead_percent"] is None and alone["per_hour"] == pytest.approx(480.0)
