"""`shefex-nav verify bound`, without flying."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from shefex_nav import prepare, warmup
from shefex_nav.commands.verify import app
from shefex_nav.verify import flown, over_bound

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"


def verify(*arguments):
    return CliRunner().invoke(app, ["bound", *map(str, arguments)])


@pytest.mark.parametrize(
    ("arguments", "words"), [(["--seeds", 0], "seeds"), (["--out", "no/such.png"], "no folder no")]
)
def test_bad_input_is_refused_before_anything_flies(arguments, words):
    done = verify(SCENARIO, *arguments)
    assert done.exit_code == 2
    assert words in done.output


def test_scenarios_with_errors_that_are_no_states_are_refused():
    for name, words in (("tight", "gps.errors.multipath"), ("frozen_gps", "faults.gps")):
        done = CliRunner().invoke(app, ["bound", str(SCENARIO.with_name(f"{name}.yaml"))])
        assert done.exit_code == 2
        assert words in done.output.replace("\n", "").replace(" ", "").replace("│", "")


def test_what_is_printed_is_what_was_found(monkeypatch):
    """Flights and bounds are stood in for; the seeds asked for are the seeds flown."""
    seeds, ready = [], []
    three = np.array([1.0, 2.0, np.radians(3.0)])
    ratios = {"boost": {key: three for key in ("error", "sigma", "bound", "ratio", "ratio_known")}}
    monkeypatch.setattr(warmup, "get_ready", ready.append)
    monkeypatch.setattr(prepare, "build_world", lambda scenario, seed: seeds.append(seed))
    monkeypatch.setattr(flown, "fly", lambda scenario, seed: [])
    monkeypatch.setattr(flown, "filter_run", lambda scenario, seed, fixes, world: seed)
    monkeypatch.setattr(over_bound, "bounds", lambda scenario, world, fixes: None)
    monkeypatch.setattr(over_bound, "curves", lambda runs, pairs: runs)
    monkeypatch.setattr(over_bound, "ratios", lambda found: ratios)
    done = verify(SCENARIO, "--first", 4, "--seeds", 2, "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert seeds == [4, 5] and "command=run" in ready[0]
    assert done.stderr == "seed 4\nseed 5\n"  # nothing about compiling, which says itself that it does
    assert result["phases"]["boost"]["bound"] == pytest.approx(three.tolist())
    table = verify(SCENARIO, "--seeds", 1)
    assert table.exit_code == 0
    assert "boost" in table.stdout
    assert "attitude, deg" in table.stdout
