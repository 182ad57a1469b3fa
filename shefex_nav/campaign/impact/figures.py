"""Figures of where a rocket lands: a map of everything, and each body's landings with their ellipses."""

import math

import numpy as np

from shefex_nav.campaign.impact import ellipses as ellipsing
from shefex_nav.geometry import wgs84
from shefex_nav.report.figures import style
from shefex_nav.report.figures.flight import base_map, equidistant, legend_below, middle_of

COLOURS = style.BLUE, style.RED, style.GREEN, style.PURPLE, style.ORANGE
MARKERS = "osD^v"


@style.styled
def chart(result):
    """Map of paths, impact points, landings and ellipses. outputs.Result -> Figure"""
    ways = [np.array([wgs84.geodetic_from_ecef(r)[:2] for r in way.r_e]) for way in result.landed[0].paths]
    points = [
        places[np.isfinite(places).all(axis=1)] for places in (result.points.vacuum, result.points.drag)
    ]
    landings = [
        (n, k, one) for n, landed in enumerate(result.landed) for k, one in enumerate(landed.landings)
    ]
    outlines = [(k, one, one.outline(n)) for k, one in enumerate(result.ellipses) for n in ellipsing.SIGMAS]
    at = np.array([[one.latitude, one.longitude] for _, _, one in landings])
    runs = {} if result.scattered is None else result.scattered.landings
    shown = np.concatenate([[result.site], *ways, at, *runs.values(), *(line for _, _, line in outlines)])
    middle = middle_of(*shown.T)

    def project(places):
        return equidistant(*np.asarray(places).T, middle)

    rows = math.ceil((5 + 4 * len(result.landed[0].landings)) / 3)  # of the legend, in three columns
    figure, axes = style.single(6.9, f"{result.name}: where it lands", 0.1 + 0.21 * rows)
    base_map(axes, middle, project(shown))
    for k, (way, places) in enumerate(zip(result.landed[0].paths, ways, strict=True)):
        axes.plot(*project(places).T, color=COLOURS[k % 5], lw=1.8, label=f"ground track, {way.body}")
    for places, dash, name in zip(points, ("--", ":"), ("vacuum", "drag, nose first"), strict=True):
        if len(places):
            words = f"instantaneous impact point, {name}"
            axes.plot(*project(places).T, color=style.BLACK, lw=1.1, ls=dash, label=words)
    for n, (_, one, outline) in enumerate(outlines):
        words = None if n % len(ellipsing.SIGMAS) else f"1, 2, 3 σ, {one.body}{_odd(one)}"
        colour = COLOURS[_number(result, one.body) % 5]
        axes.plot(*project(outline).T, color=colour, lw=1.1, ls="-.", label=words)
    for body, places in runs.items():
        colour = COLOURS[_number(result, body) % 5]
        words = f"{body}, {len(places)} run{'s' * (len(places) > 1)}"
        style.dots(axes, *project(places).T, color=colour, ms=7, alpha=0.6, mew=0, label=words, zorder=3)
    for n, k, one in landings:
        name = None if n else f"{one.body}, {_undispersed(result)}"
        _mark_landing(axes, *project([[one.latitude, one.longitude]])[0], k, name)
    axes.plot(
        *project([result.site]).T, "*", color=style.YELLOW, mec="black", ms=13, label="launcher", zorder=5
    )
    axes.set_xlabel("east of the middle of the map [km]")
    axes.set_ylabel("north [km]")
    legend_below(axes)
    return figure


def _odd(one):
    """What follows where landings are not normal: what the ellipses hold."""
    inside = ", ".join(map(str, one.inside))
    return f": not normal, hold {inside} of {len(one.offsets)}" if one.not_normal else ""


def _undispersed(result):
    """What the landings are that are not those of runs."""
    one = "nominal" if result.scattered is None else "without dispersions"
    return one + ", in each wind" * (len(result.cases) > 1)


def _mark_landing(axes, x, y, k, name):
    """Where the body of number k lands in the flight without dispersions: the same mark in every figure."""
    axes.plot(x, y, MARKERS[k % 5], color=COLOURS[k % 5], mec="black", ms=7, label=name, zorder=4)


def _number(result, body):
    return [one.body for one in result.landed[0].landings].index(body)


@style.styled
def landings(result):
    """Landings of the runs about their centre, with ellipses of 1, 2, 3 sigma, a panel for each body.

    outputs.Result -> Figure, or None without ellipses
    """
    if not result.ellipses:
        return None
    figure = style.constrained(max(6.4, 5.6 * len(result.ellipses)), 6.3)
    for axes, one in zip(
        np.atleast_1d(figure.subplots(1, len(result.ellipses))), result.ellipses, strict=True
    ):
        _panel(axes, result, one)
    return figure


def _panel(axes, result, one):
    scale, unit = (1e3, "km") if one.axes[0] > 300.0 else (1.0, "m")
    colour = COLOURS[_number(result, one.body) % 5]
    north, east = one.offsets.T / scale
    style.dots(axes, east, north, color=colour, ms=7, alpha=0.5, mew=0)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    c, s = np.cos(one.azimuth), np.sin(one.azimuth)
    for k, n, dash in zip(ellipsing.SIGMAS, one.inside, ("-", "--", ":"), strict=True):
        along, across = (
            k * axis / scale * f(angle) for axis, f in zip(one.axes, (np.cos, np.sin), strict=True)
        )
        share = f"{k} σ: {n} of {len(north)} inside"
        if not one.not_normal:
            share += f"; {100 * one.holds(k):.1f} % of a normal distribution"
        axes.plot(
            s * along + c * across, c * along - s * across, color=style.BLACK, lw=1.2, ls=dash, label=share
        )
    axes.plot(0.0, 0.0, "+", color=style.BLACK, ms=12)
    for k, landed in enumerate(result.landed):
        spot = next(x for x in landed.landings if x.body == one.body)
        there = wgs84.ecef_from_geodetic(spot.latitude, spot.longitude, 0.0)
        centre = wgs84.ecef_from_geodetic(one.latitude, one.longitude, 0.0)
        at = (there - centre) @ wgs84.dcm_en(one.latitude, one.longitude) / scale
        _mark_landing(axes, at[1], at[0], _number(result, one.body), None if k else _undispersed(result))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"east of the centre [{unit}]")
    axes.set_ylabel(f"north [{unit}]")
    axes.set_title(f"{one.body}: {len(north)} landings" + ", not normal" * one.not_normal)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), frameon=False, fontsize=9)


def draw(result):
    """{name: Figure} of what there is."""
    found = {"map": chart(result), "landings": landings(result)}
    return {name: figure for name, figure in found.items() if figure is not None}
