"""The covering design of `verify robustness`: what its table has, and that its levels can be flown."""

import importlib
import subprocess
import sys
from itertools import combinations, product
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from shefex_nav.scenario import load, sensors
from shefex_nav.scenario.told import as_told
from shefex_nav.verify.robustness import design, factors, flight, happenings, random_faults

ROOT = Path(__file__).parents[2]


@pytest.fixture
def possible(monkeypatch):
    """Function of the generator that says whether levels can meet."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return importlib.import_module("robustness_design").possible


def test_every_pair_of_levels_that_can_meet_does(possible):
    """Counted here again, without the generator."""
    cells, names = design.cells(), list(design.FACTORS)
    assert len(cells) == 400 and [cell.number for cell in cells] == list(range(400))
    met = {
        (one, getattr(cell, one), other, getattr(cell, other))
        for cell in cells
        for one, other in combinations(names, 2)
    }
    for one, other in combinations(names, 2):
        for levels in product(design.FACTORS[one], design.FACTORS[other]):
            if possible(dict(zip((one, other), levels, strict=True))):
                assert (one, levels[0], other, levels[1]) in met
    assert all(possible({name: getattr(cell, name) for name in names}) for cell in cells)


def test_what_cannot_meet_is_what_a_star_tracker_is_missing_for(possible):
    never = [
        (one, other, levels)
        for one, other in combinations(design.FACTORS, 2)
        for levels in product(design.FACTORS[one], design.FACTORS[other])
        if not possible(dict(zip((one, other), levels, strict=True)))
    ]
    stars = {name for name, one in happenings.HAPPENS.items() if one.device == happenings.STARS}
    stars |= {name for name, one in factors.TOLD.items() if one.needs_stars}
    assert never and all(stars & set(levels) for _, _, levels in never)


def test_the_committed_table_is_that_of_the_generator():
    script = ROOT / "benchmarks" / "robustness_design.py"
    assert subprocess.run([sys.executable, script, "--check"], cwd=ROOT, check=False).returncode == 0


def test_the_generator_says_if_there_are_too_few_rows(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    cover = importlib.import_module("covering_array")
    levels = {"a": (1, 2, 3), "b": (1, 2, 3), "c": (1, 2)}
    table = cover.array(levels, lambda row: row.get("a") != 3 or row.get("c") != 1, 12, seed=1)
    assert len(table) == 12
    with pytest.raises(ValueError, match="9 rows are needed"):
        cover.array(levels, lambda row: True, 8, seed=1)


def test_first_cells_are_spread_over_all_levels():
    cells = design.cells()[:60]
    for name, levels in design.FACTORS.items():
        assert {getattr(cell, name) for cell in cells} == set(levels)


@pytest.mark.parametrize("name", design.ROCKETS)
def test_every_level_makes_a_scenario(name):
    """What is told and what happens are values that a scenario takes."""
    job = flight.Job(name, (), design.Cell(0, name, "tactical", "right", "nothing", "quiet"), 0, 1)
    base = flight.overrides(job)
    true, rng = load.load(name, base), np.random.default_rng(1)
    window = happenings.Window(100.0, 110.0)
    for one in factors.TOLD.values():
        if one.settings is not None and (true.star_tracker.enabled or not one.needs_stars):
            load.load(name, (*base, *one.settings(true)))
    for one in happenings.HAPPENS.values():
        if true.star_tracker.enabled or one.device != happenings.STARS:
            load.load(name, (*base, *happenings.settings(one, true, window, rng)))


def test_a_scale_of_what_is_told_is_that_of_the_truth():
    """The world keeps what is true."""
    true = load.load("shefex2_andoya")
    told = load.load("shefex2_andoya", factors.TOLD["scale_0.5"].settings(true))
    assert told.imu == true.imu
    heard = as_told(told)
    assert heard.imu.gyro.scale_factor_roll == pytest.approx(0.5 * true.imu.gyro.scale_factor_roll)
    assert heard.imu.gyro.bias == true.imu.gyro.bias
    heard = as_told(load.load("shefex2_andoya", factors.TOLD["mounting_10"].settings(true)))
    one, other = (np.array(one.star_camera.mounting.boresight) for one in (true, heard))
    turned = np.arccos(one @ other / np.linalg.norm(other))
    assert turned == pytest.approx(10.0 * true.star_camera.mounting.error)


def test_random_faults_are_of_every_kind_that_a_scenario_takes():
    kinds = set()
    for section in ("imu", "gps", "star_tracker"):
        union = sensors.Faults.model_fields[section].annotation
        for model in _models(union):
            kinds |= set(get_args(model.model_fields["fault"].annotation))
    assert kinds == set(random_faults.KINDS)


def _models(annotation):
    """Classes with a field `fault` in an annotation."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def test_random_faults_can_be_flown_and_are_of_the_asked_sizes():
    """Every kind is drawn, sizes are log-uniform from 1 to 1000, begins are spread over the flight."""
    true, kinds, sizes, begins, counts = load.load("shefex2_andoya"), set(), [], [], []
    for seed in range(300):
        found = random_faults.drawn(true, -10.0, 456.0, seed)
        if seed < 60:
            load.load("shefex2_andoya", found.settings)
        kinds |= set(found.kinds)
        sizes += found.sizes
        begins += [one.start_s for one in found.windows]
        counts.append(len(found.kinds))
    assert kinds == set(random_faults.KINDS)
    logs = np.log10(sizes)
    assert logs.min() >= 0.0 and logs.max() <= 3.0
    for values, low, high in ((logs, 0.0, 3.0), (np.array(begins), -10.0, 455.0)):
        spread = (high - low) / np.sqrt(12.0 * len(values))
        assert abs(values.mean() - 0.5 * (low + high)) < 4.0 * spread
    assert abs(np.mean(counts) - 1.5) < 4.0 * 0.5 / np.sqrt(300)
