"""The table of `winds` for people, and its picture: a compass of winds, go or no-go."""

import numpy as np

from shefex_nav.campaign.impact.winds import DIRECTIONS, most
from shefex_nav.report import columns
from shefex_nav.report.figures import style

GO, NO = "go", "NO"
MOST_FIGURES = 7  # speeds: with more there is no room for figures in the picture
COLOURS = {True: "#9ecae1", False: "#f4a582"}  # go, no-go; told apart in grey, too


def table(found):
    """rich Table of a winds.Table: a row for each speed, the farthest body of each wind."""
    from rich.text import Text

    by_wind = {(one.speed, one.whence): one for one in found.cells}
    speeds = sorted({one.speed for one in found.cells})
    heads = ("wind", *(f">from {whence}" for whence in DIRECTIONS))
    rows = [
        [f"{speed:g} m/s", *(_cell(by_wind[speed, whence], Text) for whence in DIRECTIONS)]
        for speed in speeds
    ]
    limits = (most(found, whence) for whence in DIRECTIONS)
    rows.append(["go up to", *("-" if limit is None else f"{limit:g} m/s" for limit in limits)])
    title = f"{found.name}, seed {found.seed}: go within {found.within / 1e3:g} km of its place"
    return columns.table(title, heads, rows, no_wrap=True)


def _cell(one, text):
    far = f" {max(one.off.values()) / 1e3:.1f} km" if one.off else ""
    return text(f"{NO if one.reasons else GO}{far}", style="bold yellow" if one.reasons else "")


def lines(found):
    """What one has to know to read the table."""
    yield (
        "A wind is the same at all heights (a ballistic wind), in place of the scenario's. The figure is how "
        "far off its place the farthest body lands."
    )
    if found.place is not None:
        tilts = [np.degrees(0.5 * np.pi - one.down.elevation) for one in found.cells if one.down is not None]
        if tilts:
            yield (
                f"The launcher is set anew in each wind, {min(tilts):.1f} to {max(tilts):.1f} deg from the "
                "vertical; --json has its azimuth and elevation."
            )
    for what in dict.fromkeys(reason.what for one in found.cells for reason in one.reasons):
        refused = [(one, reason) for one in found.cells for reason in one.reasons if reason.what == what]
        first, reason = min(refused, key=lambda pair: pair[0].speed)
        more = len(refused) - 1
        others = f", and in {more} more wind{'s' * (more > 1)}" if more else ""
        yield f"NO: {reason} ({first.speed:g} m/s from {first.whence}{others})"
    for name in found.unknown:
        yield f"{name} is not followed to the ground: vehicle.stages.{name}.spent gives no drag"


@style.styled
def compass(found):
    """Sectors of a compass, the wind's speed outwards: go or no-go, and how far off [km]. Figure"""
    figure = style.constrained(7.4, 7.6)
    axes = figure.add_subplot(projection="polar", theta_offset=0.5 * np.pi, theta_direction=-1)
    speeds = np.array(sorted({one.speed for one in found.cells}))
    edges = np.concatenate([[0.0], 0.5 * (speeds[1:] + speeds[:-1]), [speeds[-1]]])
    edges[-1] += speeds[-1] - edges[-2]
    for one in found.cells:
        k, angle = np.searchsorted(speeds, one.speed), 0.25 * np.pi * DIRECTIONS.index(one.whence)
        colour = COLOURS[not one.reasons]
        axes.bar(
            angle, edges[k + 1] - edges[k], width=0.25 * np.pi, bottom=edges[k], color=colour, ec="white"
        )
        if len(speeds) <= MOST_FIGURES:
            far = f"{max(one.off.values()) / 1e3:.1f}" if one.off else "not flown"
            axes.text(angle, one.speed, far, ha="center", va="center", fontsize=9)
    axes.set_xticks(0.25 * np.pi * np.arange(8), [f"from {whence}" for whence in DIRECTIONS])
    for speed in speeds[:: 1 + (len(speeds) - 1) // MOST_FIGURES]:
        box = {"fc": "white", "ec": "none", "pad": 1.0}
        axes.text(np.pi / 8.0, speed, f"{speed:g} m/s", ha="center", va="center", fontsize=8, bbox=box)
    axes.set_yticks([])
    axes.set_ylim(0.0, edges[-1])
    axes.tick_params(pad=10)
    axes.grid(False)
    for name, go in (("go", True), ("no-go", False)):
        axes.bar(0.0, 0.0, color=COLOURS[go], label=name)
    axes.legend(loc="upper left", bbox_to_anchor=(-0.12, 1.02), frameon=False)
    style.title(figure, f"{found.name}: how far off its place a body lands [km], by wind")
    return figure
