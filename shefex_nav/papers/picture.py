"""The figure of an experiment as a PNG file; matplotlib is imported when a figure is drawn, not before."""

import numpy as np

from shefex_nav.report.figures import style

COLOURS = ("#1f5fa8", "#d1622b", "#5f9e3f", "#9c4f96", "#8c6d31")


def tidy(axis):
    """The look of all figures."""
    axis.grid(True, color="0.9", lw=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def legend_below(figure, axis, ncols, **look):
    """Legend of what one of the axes has, below all of them."""
    look = {"frameon": False, "fontsize": 9} | look
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=ncols, **look)


def points(axis, at, rows, style, scale=1.0, **look):
    """What rows have measured, with their intervals: at (n,) of the axis; scale: 100 for per cent."""
    values = scale * np.array([row.measured for row in rows])
    ends = scale * np.array([row.ci95 or (row.measured, row.measured) for row in rows]).reshape(-1, 2)
    axis.errorbar(at, values, np.abs(ends - values[:, None]).T, fmt=style, **look)


def draw(experiment, outcome, path):
    """Draw an experiment into a file, over an older figure of the same name."""
    figure = style.constrained(9.0, 6.0)
    experiment.draw(figure, outcome.results, outcome.rows)
    style.write(figure, path, 120, metadata={"Software": None})  # no version: same figure, same bytes
