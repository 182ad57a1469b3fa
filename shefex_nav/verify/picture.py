"""The picture of a comparison: differences over time as small multiples, one row per case.

matplotlib is imported when a picture is drawn, not before.
"""

import numpy as np

from shefex_nav.report.figures import style

PANELS = (
    ("altitude", ("altitude",)),
    ("attitude", ("yaw", "pitch", "roll")),
    ("body rates", ("roll_rate", "pitch_rate", "yaw_rate")),
    ("velocity over the ground", ("velocity_north", "velocity_east", "velocity_down")),
    ("density", ("density",)),
)
SMALLEST = 1e-9  # of the largest value of a panel: the lowest end of its axis
COLOURS = {
    "01": "#8c6d31",
    "02": "#9c4f96",
    "03": "#4f8f8b",
    "04": "#1f5fa8",
    "05": "#5f9e3f",
    "06": "#d1622b",
}


def draw(flown, path):
    """Draw the cases flown into a file; its ending decides on the format."""
    height = 1.25 + 1.35 * len(flown)
    figure = style.constrained(15.0, height)
    axes = figure.subplots(len(flown), len(PANELS), squeeze=False)
    shown = set()
    for row, one in zip(axes, flown, strict=True):
        for axis, (_, names) in zip(row, PANELS, strict=True):
            shown |= _panel(axis, [one.comparisons[name] for name in names if name in one.comparisons])
        row[0].annotate(
            f"{one.number}  {one.title}", (0.0, 1.04), xycoords="axes fraction", fontsize=10, weight="bold"
        )
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    for axis, (title, _) in zip(axes[0], PANELS, strict=True):
        axis.set_title(title, fontsize=11, pad=22, loc="left")
    _legend(figure, sorted(shown))
    style.write(figure, path, 110)


def _panel(axis, comparisons):
    """One quantity, of several axes the largest difference; returns the simulators that are in it."""
    axis.tick_params(labelsize=8)
    if not comparisons:
        axis.set_axis_off()
        axis.text(0.5, 0.5, "not given", transform=axis.transAxes, ha="center", color="0.5")
        return set()
    t_s = comparisons[0].t_s
    simulators = sorted({name for c in comparisons for name in c.differences})
    lines = {s: _largest([c.differences[s] for c in comparisons if s in c.differences]) for s in simulators}
    loosest = max(comparisons, key=lambda comparison: comparison.tolerance.value)
    apart, allowed = _largest([c.apart for c in comparisons]), loosest.allowed
    low, high = _limits((*lines.values(), apart), allowed)
    axis.set_yscale("log")
    axis.set_ylim(low, high)
    axis.fill_between(t_s, low, np.maximum(apart, low), color="0.87", zorder=0, lw=0)
    for name, line in lines.items():
        axis.plot(t_s, np.maximum(line, low), lw=1.1, color=COLOURS.get(name, "0.3"))
    dots = np.isnan(allowed).any()
    look = {"ls": "none", "marker": "v", "ms": 5} if dots else {"ls": (0, (4, 3)), "lw": 0.9}
    axis.plot(t_s, allowed, color="0.25", **look)
    axis.set_ylabel(comparisons[0].quantity.unit, fontsize=8)
    axis.set_xlim(t_s[0], t_s[-1])
    axis.grid(True, color="0.93", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    return set(simulators)


def _limits(columns, allowed):
    """Ends of a logarithmic axis: above what is allowed, and below as far as there is something to see."""
    seen = np.concatenate([column[column > 0.0] for column in columns])
    top = max(np.nanmax(allowed), seen.max(initial=0.0))
    bottom = np.percentile(seen, 2.0) / 3.0 if seen.size else 0.1 * top
    return max(bottom, SMALLEST * top), 4.0 * top


def _largest(columns):
    return np.fmax.reduce([np.abs(column) for column in columns])


def _legend(figure, simulators):
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [Line2D([], [], color=COLOURS.get(s, "0.3"), label=f"from simulator {s}") for s in simulators]
    handles.append(Patch(color="0.86", label="simulators among themselves"))
    handles.append(
        Line2D([], [], color="0.25", lw=0.9, ls=(0, (4, 3)), label="allowed (triangles: at these instants)")
    )
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, frameon=False)
    figure.suptitle(
        "NESC check-cases: difference of this flight mechanics from the published trajectories",
        x=0.01,
        ha="left",
        fontsize=13,
    )
