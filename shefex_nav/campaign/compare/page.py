"""A comparison to hand over: one HTML page with everything in it, made as that of a campaign is."""

from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.campaign import page as campaign_page
from shefex_nav.campaign.compare import paired, parts
from shefex_nav.campaign.compare.given import LOG
from shefex_nav.files import put
from shefex_nav.report import html
from shefex_nav.report.figures import style
from shefex_nav.report.figures.style import BLUE, GREY, RED
from shefex_nav.report.html import element
from shefex_nav.report.navigation_errors import navigation_errors

EVERY_S = 1.0  # of a log
ERRORS = {"position": "position_error_i", "velocity": "velocity_error_i", "attitude": "attitude_error_b"}
SIGMAS = {"position": "position_sigma_i", "velocity": "velocity_sigma_i", "attitude": "attitude_sigma_b"}
MOST_COURSES = 20  # runs of a side that are drawn
VERDICTS = {paired.A_BETTER: RED, paired.B_BETTER: BLUE}


class Course(NamedTuple):
    """One run; {quantity: (N,)} in SI."""

    t_s: np.ndarray
    error: dict  # sizes
    sigma: dict  # root of the sum of the variances of the three axes; NaN where the software gives none


def courses_of(side, seeds):
    """Courses of those runs of a side that have them: list."""
    if side.kind == LOG:
        return [_of_data(side.data)]
    from shefex_nav.campaign import results

    campaign, found = results.open_campaign(side.where), []
    for seed in seeds:
        try:
            kept = campaign.series(side.runs[seed].run)
        except KeyError:  # of a failed run, or not kept
            continue
        found.append(
            _sized(kept["t_s"], *({q: kept[name] for q, name in of.items()} for of in (ERRORS, SIGMAS)))
        )
    return found


def _sized(t_s, errors, sigmas):
    """Course of errors and sigmas {quantity: (N, 3)}."""
    size = ({q: np.sqrt((one**2).sum(axis=1)) for q, one in of.items()} for of in (errors, sigmas))
    return Course(t_s, *size)


def _of_data(data):
    from shefex_nav.report.pairing import same_times

    errors, covariance = navigation_errors(data), data.covariance
    i, j = same_times(errors.t_s, covariance.t_s)
    sigma = np.sqrt(np.einsum("kii->ki", covariance.P[j]))
    if not len(i):  # software that gives no covariance at all
        i = np.arange(len(errors.t_s))
        sigma = np.full((len(i), 9), np.nan)
    step = max(round(EVERY_S / np.median(np.diff(errors.t_s[i]))), 1) if len(i) > 1 else 1
    i, sigma = i[::step], sigma[::step]
    found = (errors.position_i[i], errors.velocity_i[i], errors.attitude_b[i])
    return _sized(
        errors.t_s[i],
        dict(zip(ERRORS, found, strict=True)),
        {q: sigma[:, 3 * k : 3 * k + 3] for k, q in enumerate(SIGMAS)},
    )


@style.styled
def draw_differences(one):
    """Difference of each pair, with the mean and its interval."""
    rows = [row for row in one.rows if row.difference is not None]
    if not rows:
        return None
    figure, axes = style.small_multiples(len(rows), 3, 13.0, 2.3, 0.7)
    for axis, row in zip(axes, rows, strict=True):
        _of_row(axis, row, one)
    text = f"{one.b.letter} - {one.a.letter}, pair by pair; line: mean, band: its 95 % interval"
    style.heading(figure, text)
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
    found = [(side, courses_of(side, seeds[:MOST_COURSES])) for side in sides]
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
    style.heading(figure, text)
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


def write(path, sides, found):
    """Write the page of sides and of the Comparisons with the first of them, in one piece."""
    put(path, page(sides, found))


def page(sides, found):
    """The page: str."""
    sections = [
        (f"part-{k}", part.title, campaign_page.content(part))
        for k, part in enumerate(parts.parts(sides, found))
    ]
    for k, one in enumerate(found):
        caption = (
            "Difference of each pair of runs of one seed, in the order of the seeds; coloured where the "
        )
        caption += "verdict is for one of the two."
        drawn = _picture(f"differences-{k}", draw_differences(one), caption)
        sections.append((f"differences-{k}", f"Differences: {parts.title(one)}", drawn))
    caption = "Sizes of the error vectors of each run, and three times the root of the sum of the variances "
    caption += "that the filter gives for its axes."
    drawn = _picture("sigmas", draw_sigmas(sides, found[0].seeds), caption)
    sections.append(("sigmas", "Errors over time", drawn))
    title = " and ".join(side.label for side in sides)
    return html.page(
        f"Comparison of {title}",
        header=[element("h1", f"Comparison of {title}")],
        sections=[section for section in sections if section[2]],
        footer=f"Runs of {', '.join(str(side.where) for side in sides)}, made by shefex_nav {__version__}.",
    )


def _picture(name, figure, caption):
    """List of the one picture; empty without one."""
    return [] if figure is None else [style.picture(figure, name, caption)]
