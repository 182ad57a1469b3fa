"""Pictures of the statistics of runs. matplotlib is imported when a picture is drawn, not before."""

import numpy as np

from shefex_nav.report.figures import style
from shefex_nav.report.navigation_errors import nees as normalised
from shefex_nav.verify import nees
from shefex_nav.verify.flown import BLOCKS, PHASES

COLOURS = ("#d1622b", "#8c6d31", "#1f5fa8", "#5f9e3f", "#7b5aa6")  # of the phases


def _tidy(axis, t_s, phase):
    """Grid, and a bar of the phases along the bottom."""
    axis.grid(True, color="0.93", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_xlim(t_s[0], t_s[-1])
    for p, colour in enumerate(COLOURS):
        axis.fill_between(
            t_s, 0.0, 0.025, where=phase == p, transform=axis.get_xaxis_transform(), color=colour, lw=0
        )


def _phase_legend(figure, handles, phase):
    """A legend of curves and of the phases that there are. phase : (m,) as of flown.Run"""
    from matplotlib.patches import Patch

    handles = [*handles, *(Patch(color=COLOURS[p], label=PHASES[p]) for p in np.unique(phase[phase >= 0]))]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, frameon=False)


def draw_nees(runs, path):
    """Mean NEES over the runs at each epoch, per degree of freedom, with the bounds of one epoch."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure = style.constrained(11.0, 11.5)
    m = min(len(run.t_s) for run in runs)
    t_s, phase = runs[0].t_s[:m], runs[0].phase[:m]
    low, high = nees.nis_interval(3 * len(runs), 0.95)
    for axis, (name, block) in zip(figure.subplots(len(BLOCKS), 1, sharex=True), BLOCKS.items(), strict=True):
        mean = np.mean([normalised(run.errors[:m, block], run.P[:m, block, block]) for run in runs], axis=0)
        axis.axhspan(low, high, color="0.88", lw=0)
        axis.plot(t_s, mean / 3.0, color="#1f5fa8", lw=1.0)
        axis.axhline(1.0, color="0.4", lw=0.8)
        axis.set_ylim(0.0, max(2.0, 1.1 * np.nanpercentile(mean / 3.0, 99.5)))
        axis.set_ylabel("NEES / 3")
        axis.set_title(style.TITLES.get(name, name), loc="left", fontsize=11)
        _tidy(axis, t_s, phase)
    axis.set_xlabel("time from lift-off [s]")
    figure.suptitle(f"Normalised squared error, mean of {len(runs)} runs", x=0.01, ha="left", fontsize=13)
    band = Patch(color="0.86", label="95 % of means at one epoch")
    _phase_legend(figure, [Line2D([], [], color="#1f5fa8", label="measured"), band], phase)
    style.write(figure, path, 110)


def draw_bound(found, path, *, runs):
    """The bound and the filters' errors over time, and their ratio.

    found : dict name of a filter -> over_bound.Curves, the first with its reported sigma;  runs : how many
    """
    figure = style.constrained(14.0, 9.0)
    axes = figure.subplots(2, 3, sharex=True, height_ratios=(2, 1))
    colours = ("#1f5fa8", "#d1622b", "#9c4f96")
    first = next(iter(found.values()))
    t_s = first.t_s
    for q, (name, unit, factor) in enumerate(style.QUANTITIES):
        top, bottom = axes[0, q], axes[1, q]
        bound = first.bound[:, q]
        top.fill_between(t_s, 1e-9, factor * bound, color="0.87", lw=0)
        top.plot(t_s, factor * bound, color="0.3", lw=1.2, label="bound")
        top.plot(t_s, factor * first.sigma[:, q], color="0.1", lw=0.9, ls=":", label="reported sigma")
        for (label, one), colour in zip(found.items(), colours, strict=False):
            m = min(len(one.t_s), len(t_s))
            top.plot(t_s[:m], factor * one.error[:m, q], color=colour, lw=0.9, label=f"rms error, {label}")
            bottom.plot(t_s[:m], one.error[:m, q] / bound[:m], color=colour, lw=0.9)
        shown = factor * np.concatenate([bound, *(one.error[:, q] for one in found.values())])
        top.set_yscale("log")
        top.set_ylim(0.6 * np.percentile(shown, 0.5), 1.8 * shown.max())
        top.set_ylabel(f"{name} [{unit}]")
        bottom.axhline(1.0, color="0.4", lw=0.8)
        bottom.axhline(1.15, color="0.4", lw=0.8, ls=":")
        bottom.annotate("1.15", (t_s[0], 1.17), color="0.4", fontsize=8)
        bottom.set_ylim(0.5, 3.0)
        bottom.set_ylabel("rms error / bound")
        bottom.set_xlabel("time from lift-off [s]")
        for axis in (top, bottom):
            _tidy(axis, t_s, first.phase)
    handles, _ = axes[0, 0].get_legend_handles_labels()
    what = "one run" if runs == 1 else f"{runs} runs"
    title = f"Errors of {what} and the posterior Cramér-Rao bound"
    figure.suptitle(title, x=0.01, ha="left", fontsize=13)
    _phase_legend(figure, handles, first.phase)
    style.write(figure, path, 110)
