"""A trade as a map over two settings. matplotlib is imported when a picture is drawn, not before."""

import math

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.report.figures import style
from shefex_nav.verify.trade.predict import END, ENTRY
from shefex_nav.verify.trade.table import UNITS, sigma

LONGEST = 22  # letters of a value on an axis


class PictureError(UserError):
    """A map that cannot be drawn; the message says why."""


@style.styled
def draw(study, asked, path, quantity="attitude"):
    """Draw the predicted sigma of one quantity over the first two settings, the others at their first values.

    At entry if all that is shown have one, else at the end. PictureError where nothing is predicted of them.

    study, asked : plan.Study, plan.Asked;  path : its ending decides on the format;  quantity : of UNITS
    """
    across, *rest = asked.axes
    down, others = (rest[0], rest[1:]) if rest else (None, ())
    fixed = {one.key: one.values[0] for one in others}
    shown = [one for one in study.combinations if fixed.items() <= one.settings.items()]
    predictions = [one.prediction for one in shown if one.prediction]
    if not predictions:
        raise PictureError(f"{path}: nothing is predicted of the combinations with {_fixed(fixed)}")
    what = ENTRY if all(one.at(ENTRY) for one in predictions) else END
    _, field, unit, factor = next(one for one in UNITS if one[0] == quantity)
    rows = ("",) if down is None else down.values
    values, met, doubtful = np.full((3, len(rows), len(across.values)), np.nan)
    for one in shown:
        row = 0 if down is None else rows.index(one.settings[down.key])
        place = row, across.values.index(one.settings[across.key])
        if one.prediction is not None:
            values[place] = factor * sigma(one.prediction.at(what), field)
            met[place] = np.nan if one.met is None else one.met
            doubtful[place] = one.prediction.doubtful
    figure, axis = _sheet(values, across, down, rows)
    _cells(figure, axis, (values, met, doubtful), f"{quantity} [{unit}]")
    if study.cheapest in shown:
        _mark(axis, study.cheapest, across, down)
    lines = [f"{study.name}: predicted {quantity} error at {what}, 1 sigma [{unit}]"]
    if fixed:
        lines.append(f"with {_fixed(fixed)}")
    lines += _key(met, study)
    figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=11)
    style.write(figure, path, 110)


def _fixed(settings):
    return ", ".join(f"{key} {value}" for key, value in settings.items())


def _sheet(values, across, down, rows):
    """(Figure, Axes) with the values of the settings along its sides."""
    n, m = values.shape
    figure = style.constrained(max(8.0, 2.8 + 0.95 * m), max(4.4, 2.4 + 0.5 * n))
    axis, tilted = figure.subplots(), m > 4
    look = {"rotation": 30, "ha": "right"} if tilted else {}
    axis.set_xticks(range(m), [_short(value) for value in across.values], **look)
    axis.set_yticks(range(n), [_short(value) for value in rows])
    axis.set_xlabel(across.key)
    axis.set_ylabel("" if down is None else down.key)
    axis.grid(False)
    axis.tick_params(length=0)
    for side in axis.spines.values():
        side.set_visible(False)
    return figure, axis


def _cells(figure, axis, arrays, label):
    """Colours by the logarithm, numbers, and a line between what meets the requirements and what does not."""
    values, met, doubtful = arrays
    from matplotlib.colors import LogNorm

    known = values[np.isfinite(values)]
    low, high = known.min(), known.max()
    norm = LogNorm(low / 1.02, high * 1.02)
    drawn = axis.imshow(values, cmap="cividis_r", norm=norm, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        if math.isnan(value):
            axis.text(column, row, "none", ha="center", va="center", color=style.GREY, fontsize=9)
            continue
        dark = norm(value) > 0.55
        marks = [
            mark for mark, is_on in ((" x", met[row, column] == 0.0), (" ?", doubtful[row, column])) if is_on
        ]
        text = f"{value:.3g}{''.join(marks)}"
        axis.text(
            column, row, text, ha="center", va="center", color="white" if dark else "black", fontsize=10
        )
    bar = figure.colorbar(drawn, ax=axis, pad=0.02)
    bar.set_label(label)
    bar.ax.minorticks_off()
    ticks = np.geomspace(low, high, 4) if high > 1.05 * low else [low]
    bar.set_ticks(ticks, labels=[f"{tick:.2g}" for tick in ticks])
    for start, end in _borders(met):
        axis.plot(*zip(start, end, strict=True), color=style.RED, lw=3.0, solid_capstyle="round")


def _borders(met):
    """Edges between cells that meet the requirements and cells that do not: ((x, y), (x, y))."""
    n, m = met.shape
    for row in range(n):
        for column in range(m):
            if column + 1 < m and _differ(met[row, column], met[row, column + 1]):
                yield (column + 0.5, row - 0.5), (column + 0.5, row + 0.5)
            if row + 1 < n and _differ(met[row, column], met[row + 1, column]):
                yield (column - 0.5, row + 0.5), (column + 0.5, row + 0.5)


def _differ(a, b):
    return not math.isnan(a) and not math.isnan(b) and a != b


def _mark(axis, one, across, down):
    """A frame around the cheapest that meets all."""
    from matplotlib.patches import Rectangle

    column = across.values.index(one.settings[across.key])
    row = 0 if down is None else down.values.index(one.settings[down.key])
    axis.add_patch(
        Rectangle((column - 0.44, row - 0.4), 0.88, 0.8, fill=False, ec=style.GREEN, lw=3.0, zorder=5)
    )


def _key(met, study):
    """What the marks mean: list of lines."""
    found, share = [], f"{100.0 * study.probability:.6g} %"
    if (met == 0.0).any():
        border = "; red line: between these and the others" if (met == 1.0).any() else ""
        found.append(f"x: less than {share} of flights meet what is required{border}")
    elif (met == 1.0).any():
        found.append(f"in all of them {share} of flights meet what is required")
    if study.cheapest is not None:
        found.append("green frame: the cheapest that meets all that is predicted")
    if any(one.prediction is not None and one.prediction.doubtful for one in study.combinations):
        found.append("?: in doubt, the IMU at the end of its range or the attitude worse than 5 deg before")
    return found


def _short(text):
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
