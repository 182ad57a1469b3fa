"""What IMU, GPS receiver and instruments said."""

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.report.figures import style
from shefex_nav.report.track import earth_fixed


@style.styled
def imu(data):
    """Specific force and rate as measured, each block averaged, and blocks at the end of the range or silent.

    RunData -> Figure; None without IMU samples.
    """
    blocks = data.imu
    if not len(blocks.t_valid_s):
        return None
    duration = blocks.dt_s * blocks.dtheta_b.shape[1]
    force = blocks.dv_b.sum(axis=1) / duration[:, None] / STANDARD_GRAVITY
    rate = np.degrees(blocks.dtheta_b.sum(axis=1) / duration[:, None])
    words = "IMU as measured: specific force and rates, means of each block"
    figure, rows = style.panels(data, 4, words, height=1.5)
    _along_and_across(rows[0, 0], rows[1, 0], blocks.t_valid_s, force)
    _along_and_across(rows[2, 0], rows[3, 0], blocks.t_valid_s, rate)
    rows[0, 0].set_ylabel("force, x\n[gee]")
    rows[1, 0].set_ylabel("force, y z\n[gee]")
    rows[2, 0].set_ylabel("rate, x\n[deg/s]")
    rows[3, 0].set_ylabel("rate, y z\n[deg/s]")
    for flags, colour, name in (
        (blocks.saturated, style.ORANGE, "saturated"),
        (~blocks.valid, style.RED, "silent"),
    ):
        _shade(rows, blocks.t_valid_s, flags, color=colour, alpha=0.4, label=name)
    style.legend_above(rows[0, 0])
    style.legend_above(rows[1, 0])
    return figure


def _shade(rows, t_s, flags, **look):
    """Intervals of flagged samples in all panels; the first one has the label."""
    for start, length in style.spans(t_s, flags):
        for axes in rows[:, 0]:
            axes.axvspan(start, start + length, lw=0, **look)
            look["label"] = None


def _along_and_across(along, across, t_s, values):
    style.curve(along, t_s, values[:, 0], color=style.BLUE, lw=0.9)
    for k, axis in ((1, "y"), (2, "z")):
        style.curve(
            across, t_s, values[:, k], color=style.AXES[axis], lw=0.8,
            ls=style.DASHES[axis] if k == 1 else "-", alpha=0.85, label=axis,
        )  # fmt: skip


@style.styled
def gps(data):
    """Satellites, dilution of precision, accuracy and loss of the fix. RunData -> Figure; None without GPS.

    Recorded data may say neither satellites nor dilution: a fix with no satellite is one of which they are
    not known.
    """
    fixes = data.gps
    if not fixes:
        return None
    t_s = np.array([fix.t_valid_s for fix in fixes])
    valid = np.array([fix.valid for fix in fixes])
    shown = _of_fixes(fixes, valid)
    words = f"GPS: {', '.join(words for words, _, _, _ in shown)}"
    figure, rows = style.panels(data, len(shown), words, height=1.5)
    for axes, (_, label, values, look) in zip(rows[:, 0], shown, strict=True):
        style.curve(axes, t_s, values, color=style.BLUE, **look)
        axes.set_ylabel(label)
        axes.set_ylim(0.0, 1.1 * float(np.nanmax(values, initial=0.0)) or 1.0)
    _shade(rows, t_s, ~valid, color=style.ORANGE, alpha=0.3, label="no fix")
    style.legend_above(rows[0, 0])
    return figure


def _of_fixes(fixes, valid):
    """(words, label, values (n,), look) of each panel that has something to show; the accuracy always."""
    count = np.array([fix.n_satellites for fix in fixes], dtype=float)
    count[(valid & (count < 1.0)) | (count < 0.0)] = np.nan
    pdop = np.where(valid, [fix.pdop for fix in fixes], np.nan)
    trace = np.array([float(np.trace(fix.R_r_e)) if fix.valid else np.nan for fix in fixes])
    sigma, dots = np.sqrt(np.maximum(trace, 0.0)), {"marker": ".", "ms": 3, "lw": 0.8}
    panels = [
        ("satellites", "satellites\nused", count, {"drawstyle": "steps-mid"}),
        ("geometry", "PDOP", pdop, dots),
    ]
    known = [one for one in panels if np.isfinite(one[2][valid]).any() or not valid.any()]
    return [*known, ("the accuracy the receiver claims", "position\nσ, 3D [m]", sigma, dots)]


@style.styled
def barometer(data):
    """Pressure altitude of the readings, and how far it is from the true height; which readings were used.

    RunData -> Figure; None without a barometer. Without truth the height is that of the solution.
    """
    said = data.readings["barometer"]
    if not len(said.t_valid_s):
        return None
    height = atmosphere.pressure_height(said.pressure)
    used_s = [gate.t_valid_s for gate in data.gates if gate.sensor == "barometer" and gate.accepted]
    used = np.isin(said.t_valid_s, used_s)
    flown = data.truth if len(data.truth.t_s) else data.nav
    at_s, true = flown.t_s, earth_fixed(data.mission.earth, flown).height
    off = height - np.interp(said.t_valid_s, at_s, true, left=np.nan, right=np.nan)
    whose = "true height" if len(data.truth.t_s) else "height of the solution"
    figure, rows = style.panels(data, 2, f"Barometer: pressure altitude against the {whose}", height=1.9)
    style.curve(rows[0, 0], at_s, 1e-3 * true, color=style.BLACK, lw=0.9, label=whose)
    for chosen, colour, name in ((used, style.BLUE, "used"), (~used, style.ORANGE, "not used")):
        if chosen.any():
            style.dots(rows[0, 0], said.t_valid_s[chosen], 1e-3 * height[chosen], color=colour, label=name)
            style.dots(rows[1, 0], said.t_valid_s[chosen], off[chosen], color=colour)
    rows[0, 0].set_ylabel("pressure\naltitude [km]")
    rows[1, 0].set_ylabel("less height\n[m]")
    known = np.abs(off[used & np.isfinite(off)])
    if len(known):
        rows[1, 0].set_ylim(*(1.3 * np.array([-1.0, 1.0]) * max(float(known.max()), 1.0)))
    style.legend_above(rows[0, 0])
    return figure


@style.styled
def instrument(data, one):
    """The plots of an Instrument, one below the other. RunData -> Figure; None without readings."""
    said = data.readings[one.name]
    if not len(said.t_valid_s) or not one.plots:
        return None
    words = f"{one.name.replace('_', ' ').capitalize()} as measured"
    figure, rows = style.panels(data, len(one.plots), words, height=1.9)
    for panel, plot in zip(rows[:, 0], one.plots, strict=True):
        values = plot.values(said)
        if values.ndim == 1:
            style.curve(panel, said.t_valid_s, values, color=style.BLUE, lw=0.9)
        else:
            for k, axis in enumerate("xyz"):
                colour = style.AXES[axis]
                style.curve(panel, said.t_valid_s, values[:, k], color=colour, lw=0.8, label=axis)
            style.legend_above(panel)
        panel.set_ylabel(f"{plot.name.replace('_', ' ')}\n[{plot.unit}]" if plot.unit else plot.name)
    return figure
