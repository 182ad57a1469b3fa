"""Every registered experiment exists and yields rows at the smallest samples."""

import pytest

from shefex_nav.papers import engine, picture, registry
from shefex_nav.papers.experiment import Experiment, Row


def test_names_are_those_of_their_modules():
    for name in registry.EXPERIMENTS:
        assert isinstance(registry.load(name), Experiment)


@pytest.mark.slow
@pytest.mark.parametrize("name", registry.EXPERIMENTS)
@pytest.mark.parametrize("samples", [1, 3])
def test_every_experiment_has_rows_and_a_figure(name, samples, tmp_path):
    experiment = registry.load(name)
    outcome = engine.run(experiment, samples=samples, seed=2, workers=1)
    assert outcome.rows
    for row in outcome.rows:
        assert isinstance(row, Row) and row.quantity and isinstance(row.condition, str)
        assert row.agrees is not False or row.why, f"{row.quantity}: a disagreement without a reason"
    picture.draw(experiment, outcome, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
