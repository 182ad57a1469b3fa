"""Every registered experiment exists and yields rows at the smallest samples."""

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from shefex_nav.papers import engine, picture, registry
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.verdict import DIFFERS, Verdict
from shefex_nav.report.figures import style


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
        assert row.verdict not in DIFFERS or row.why, f"{row.quantity}: a difference without a reason"
        assert row.verdict != Verdict.EXPLAINED or row.run
        if name != "impa-centroids":  # which counts clusters, of which a frame has many
            assert row.verdict not in (Verdict.REPRODUCED, Verdict.BETTER) or row.ci95 is None, "of so few"
    picture.draw(experiment, outcome, tmp_path / "figure.png")
    figure = style.constrained(9.0, 6.0)
    experiment.draw(figure, outcome.results, outcome.rows)
    if samples > 1:
        assert_panels_are_filled(figure)


def assert_panels_are_filled(figure):
    """Every pair of axes has something in it that lies within its limits."""
    figure.draw_without_rendering()
    for k, axis in enumerate(figure.axes):
        window, seen = axis.get_window_extent(), 0
        for artist in [*axis.lines, *axis.collections, *axis.patches, *axis.images]:
            seen += inside(artist, axis, window)
        assert seen, f"panel {k} of the figure is empty"


def inside(artist, axis, window):
    """Whether a part of what an artist has drawn from data lies within the axes."""
    if isinstance(artist, AxesImage):
        return True
    if isinstance(artist, Line2D):
        if artist.get_transform() is not axis.transData:
            return False  # a line across the axes has no data
        points = axis.transData.transform(np.column_stack(artist.get_data()).astype(float))
    elif isinstance(artist, PathCollection):
        points = axis.transData.transform(np.ma.filled(artist.get_offsets().astype(float), np.nan))
    elif isinstance(artist, Patch) and all(artist.get_transform().contains_branch_seperately(axis.transData)):
        if isinstance(artist, Rectangle) and not artist.get_height():
            return False  # a bar of nothing
        points = artist.get_transform().transform(artist.get_path().vertices)
    else:
        return False
    good = np.isfinite(points).all(axis=1)
    return bool(
        np.any(good & (points >= window.min - 1.0).all(axis=1) & (points <= window.max + 1.0).all(axis=1))
    )


def test_an_empty_panel_is_noticed():
    figure = style.constrained(4.0, 3.0)
    full, empty = figure.subplots(1, 2)
    full.plot([0.0, 1.0], [2.0, 3.0])
    empty.axhline(1.0)
    empty.axvspan(0.2, 0.4)
    with pytest.raises(AssertionError, match="panel 1"):
        assert_panels_are_filled(figure)
    empty.plot([5.0], [5.0], "o")
    empty.set_xlim(0.0, 1.0)
    with pytest.raises(AssertionError, match="panel 1"):
        assert_panels_are_filled(figure)
    empty.set_xlim(0.0, 9.0)
    assert_panels_are_filled(figure)
