"""Figures of the IMPA experiments. Each `draw_*(figure, results, rows)` fills a matplotlib Figure."""

import numpy as np

from shefex_nav.papers import picture
from shefex_nav.papers.impa import tables
from shefex_nav.papers.impa.field import SHUTTERS
from shefex_nav.papers.impa.flight import CASES, SITUATIONS
from shefex_nav.papers.impa.published import ATTITUDE_MEAN_ARCSEC, IMPA
from shefex_nav.papers.picture import legend_below, tidy
from shefex_nav.report import intervals

COLOURS = dict(zip(SITUATIONS, picture.COLOURS, strict=False))
SHOWN_RATE = 3.0  # of figure 16
WHO = {"IMPA": "IMPA's chain here", "ours": "ours"}


def draw_joint(figure, results, rows):
    """As `draw_images`, of the paper's chain alone."""
    draw_images(figure, results, rows, with_own=False)


def draw_images(figure, results, _rows, with_own=True):
    """Figures 16 and 17: success against images at 3 deg/s, and against the rate; ours beside."""
    found = tables.stack(results)
    figure.set_size_inches(10.5, 8.0)
    axes = figure.subplots(2, 2, sharey=True)
    for s, shutter in enumerate(SHUTTERS):
        for c, case in enumerate(CASES):
            _success_by_images(axes[0, s], found, s, c)
            _success_by_rate(axes[1, s], found, s, c)
            _published(axes[0, s], axes[1, s], case, shutter)
        if with_own:
            _own_by_rate(axes[1, s], found, s)
        axes[0, s].set_title(f"{shutter.replace('_', ' ')}, {SHOWN_RATE:g} deg/s", loc="left", fontsize=10)
        axes[1, s].set_title(
            f"{shutter.replace('_', ' ')}, within 60 images" + "; ours: 2" * with_own, loc="left", fontsize=10
        )
        axes[0, s].set_xlabel("images")
        axes[1, s].set_xlabel("rate [deg/s]")
        for axis in axes[:, s]:
            axis.set_ylim(0.0, 102.0)
            tidy(axis)
    for axis in axes[:, 0]:
        axis.set_ylabel("successful simulations [%]")
    legend_below(figure, axes[1, 0], 4)


def _success_by_images(axis, found, s, c):
    """Measured success within each number of images."""
    here = found["published"][found["rate_deg_s"] == SHOWN_RATE][:, s, c, 0]
    if not len(here):
        return
    images = np.arange(2, max(tables.IMAGES) + 1)
    right = tables.good(here[:, 1:]) & (here[:, 0] > 0)
    share = [(right & (here[:, 0] <= n)).mean() for n in images]
    axis.plot(images, 100.0 * np.array(share), color=COLOURS[CASES[c]], lw=1.4)


def _success_by_rate(axis, found, s, c):
    """Measured success of all images against the rate, with intervals."""
    _points(axis, found, tables.RATES, lambda rows: (
        (rows["published"][:, s, c, 0, 0] > 0) & tables.good(rows["published"][:, s, c, 0, 1:])
    ), COLOURS[CASES[c]], "o-", f"IMPA's chain here, {CASES[c].replace('_', ' ')}")  # fmt: skip


def _own_by_rate(axis, found, s):
    """Ours within two images, without intervals: they would lie on one another, and the rows have them."""
    for k, situation in enumerate(SITUATIONS):
        label = f"ours, {situation.replace('_', ' ')}"
        _points(axis, found, (*tables.RATES, tables.FAST), lambda rows, k=k: (
            (rows["own"][:, s, k, :, 0] > 0) & tables.good(rows["own"][:, s, k, :, 1:4])
        ).any(axis=1), COLOURS[situation], "s:", label, with_bars=False)  # fmt: skip


def _points(axis, found, rates, which, colour, style, label, with_bars=True):
    """Shares, and their intervals, at the rates that were flown."""
    shown, shares, ends = [], [], []
    for rate in rates:
        at = found["rate_deg_s"] == rate
        if at.any():
            done = which({name: column[at] for name, column in found.items()})
            shown.append(rate)
            shares.append(done.mean())
            ends.append(intervals.proportion(int(done.sum()), len(done)))
    if shown:
        shares = np.array(shares)
        reach = 100.0 * np.abs(np.array(ends) - shares[:, None]).T
        look = {"fmt": style, "color": colour, "ms": 4, "lw": 1.2, "capsize": 2, "label": label}
        axis.errorbar(shown, 100.0 * shares, reach if with_bars else None, **look)


def _published(by_images, by_rate, case, shutter):
    """The paper's points."""
    table = IMPA["success_percent_by_images"][case][shutter]
    r = tables.RATES.index(SHOWN_RATE)
    style = {"marker": "x", "ls": "--", "lw": 0.9, "ms": 5, "color": COLOURS[case]}
    by_images.plot(tables.IMAGES, [table[n][r] for n in tables.IMAGES], **style)
    label = f"published, {case.replace('_', ' ')}"
    by_rate.plot(tables.RATES, table[max(tables.IMAGES)], label=label, **style)


def draw_attitude(figure, results, rows):
    """Standard deviations against the rate; on the right figure 15, the errors at the highest rate."""
    figure.set_size_inches(16.0, 8.5)
    left, right = figure.subfigures(1, 2, width_ratios=(1.2, 1.0))
    _deviations(left, rows)
    _distributions(right, tables.stack(results))


def _distributions(figure, found):
    """Figure 15: errors of the right attitudes of the paper's chain, best case, and the published normals."""
    rate = float(found["rate_deg_s"][found["rate_deg_s"] <= tables.RATES[-1]].max())
    axes = figure.subplots(3, 2, sharex="row")
    for s, shutter in enumerate(SHUTTERS):
        errors = tables.right_errors(found, CASES[0], shutter, rate)
        for axis, name in zip(axes[:, s], ("roll", "pitch", "yaw"), strict=True):
            r = tables.RATES.index(rate)
            sigma = IMPA["attitude_error_std_arcsec"][CASES[0]][shutter][name][r]
            mean = ATTITUDE_MEAN_ARCSEC[CASES[0]][shutter][name][r]
            _histogram(axis, errors[:, tables.AXES.index(name)], 4.0 * sigma)
            x = np.linspace(-4.0 * sigma, 4.0 * sigma, 200)
            normal = np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
            axis.plot(x, normal, "k--", lw=1.2, label="published, normal")
            words = f"{name}, {shutter.replace('_', ' ')}, {rate:g} deg/s, {len(errors)} attitudes"
            axis.set_title(words, loc="left", fontsize=9)
            axis.set_xlabel("error [arcsec]", fontsize=9)
            axis.set_yticks([])
            tidy(axis)
    legend_below(figure, axes[0, 0], 2)


def _histogram(axis, errors, reach):
    """Density of the errors within +-reach."""
    if len(errors):
        inside = errors[np.abs(errors) <= reach]
        n = max(int(np.sqrt(len(errors))), 5)
        weights = np.full(len(inside), n / (2.0 * reach * len(errors)))
        look = {"color": picture.COLOURS[0], "alpha": 0.6, "label": "simulated here"}
        axis.hist(inside, bins=n, range=(-reach, reach), weights=weights, **look)


def _deviations(figure, rows):
    """Standard deviations against the rate: one picture a case and shutter, the axes by their colour."""
    axes = figure.subplots(2, 2, sharey=True, sharex=True)
    colours = dict(zip(tables.AXES, ("#1f5fa8", "#5f9e3f", "#d1622b"), strict=True))
    for c, case in enumerate(CASES):
        for s, shutter in enumerate(SHUTTERS):
            axis, words = axes[c, s], f"{case}, {shutter}".replace("_", " ")
            for name, colour in colours.items():
                published = IMPA["attitude_error_std_arcsec"][case][shutter][name]
                axis.plot(tables.RATES, published, "x--", lw=0.9, color=colour, label=f"published, {name}")
                for who, style in (("IMPA", "o-"), ("ours", "s:")):
                    mine = [row for row in rows if row.quantity.startswith(f"{who}: std of {name}")]
                    mine = [row for row in mine if row.condition.startswith(words + ",")]
                    at = [float(row.condition.split(", ")[-1].split()[0]) for row in mine]
                    look = {"color": colour, "ms": 4, "lw": 1.2, "capsize": 2}
                    if len(at):
                        picture.points(axis, at, mine, style, label=f"{WHO[who]}, {name}", **look)
            axis.set_title(words, loc="left", fontsize=10)
            axis.set_yscale("log")
            tidy(axis)
    for axis in axes[1]:
        axis.set_xlabel("rate [deg/s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("standard deviation [arcsec]")
    legend_below(figure, axes[0, 0], 3)
