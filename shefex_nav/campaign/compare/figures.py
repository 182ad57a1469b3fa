"""Pictures of a comparison. Each `draw_*` gives a matplotlib Figure, None where there is nothing to draw."""

import numpy as np

from shefex_nav.campaign.compare import paired, parts, series
from shefex_nav.report.figures import style
from shefex_nav.report.figures.style import BLUE, GREY, RED

MOST_COURSES = 20  # runs of a side that are drawn
FAINT = "0.87"
COLUMNS = 3
VERDICTS = {paired.A_BETTER: RED, paired.B_BETTER: BLUE}


@style.styled
def draw_differences(one):
    """Difference of each pair, with the mean and its interval."""
    rows = [row for row in one.rows if row.difference is not None]
    if not rows:
        return None
    lines = -(-len(rows) // COLUMNS)
    figure = style.constrained(13.0, 0.7 + 2.3 * lines)
    axes = figure.subplots(lines, COLUMNS, squeeze=False).ravel()
    for axis in axes[len(rows) :]:
        axis.remove()
    for axis, row in zip(axes, rows, strict=False):
        _of_row(axis, row, one)
    text = f"{one.b.letter} - {one.a.letter}, pair by pair; line: mean, band: its 95 % interval"
    figure.suptitle(text, x=0.01, ha="left", fontsize=14, fontweight="bold")
    return figure


def _of_row(axis, row, one):
    """The panel of a Row."""
    found = row.difference
    colour = VERDICTS.get(found.verdict, GREY)
    place = np.arange(1, len(row.each) + 1)
    if found.low is not None and found.high > found.low:
        axis.axhspan(found.low, found.high, color=colour, alpha=0.2, lw=0)
    axis.axhline(found.mean, color=colour, lw=1.2)
    axis.axhline(0.0, color="0.2", lw=0.8)
    axis.plot(place, row.each, "o", color=colour, ms=4)
    axis.set_xlim(0.4, len(place) + 0.6)
    axis.xaxis.get_major_locator().set_params(integer=True)
    unit = f" [{row.quantity.unit}]" if row.quantity.unit else ""
    axis.set_title(f"{row.quantity.name}{unit}\n{parts.verdict(found, one)}", loc="left", fontsize=9)


@style.styled
def draw_sigmas(sides, seeds):
    """Sizes of the errors over time beside three sigma of each side's filter."""
    found = [(side, series.courses(side, seeds[:MOST_COURSES])) for side in sides]
    found = [(side, courses) for side, courses in found if courses]
    if not found:
        return None
    figure = style.constrained(5.5 * len(found) + 1.0, 8.5)
    axes = figure.subplots(len(style.QUANTITIES), len(found), sharex=True, sharey="row", squeeze=False)
    for column, (side, courses) in zip(axes.T, found, strict=True):
        for axis, (name, unit, factor) in zip(column, style.QUANTITIES, strict=True):
            _course(axis, courses, name, factor)
            axis.set_ylabel(f"{name} [{unit}]")
            axis.set_yscale("log")
        column[0].set_title(f"{side.letter}: {side.label}", loc="left", fontsize=10)
        column[-1].set_xlabel("time from lift-off [s]")
    axes[0, 0].legend(loc="best", fontsize=9)
    text = "Errors of the runs (size of the vector) and 3 sigma of each filter"
    figure.suptitle(text, x=0.01, ha="left", fontsize=14, fontweight="bold")
    return figure


def _course(axis, courses, name, factor):
    """Errors of all runs, and 3 sigma where the software gives any."""
    for k, one in enumerate(courses):
        label = "error of each run" if k == 0 else None
        axis.plot(one.t_s, factor * _above_zero(one.error[name]), color=BLUE, lw=0.5, alpha=0.6, label=label)
    known = [one for one in courses if np.isfinite(one.sigma[name]).any()]
    for k, one in enumerate(known):
        sigma, label = 3.0 * factor * _above_zero(one.sigma[name]), "3 sigma" if k == 0 else None
        axis.plot(one.t_s, sigma, color=RED, lw=0.7, alpha=0.7, label=label)
    if not known:
        axis.text(0.02, 0.95, "gives no covariance", transform=axis.transAxes, va="top", fontsize=9)


def _above_zero(values):
    """The same with NaN where a logarithmic axis has no place."""
    return np.where(values > 0.0, values, np.nan)
