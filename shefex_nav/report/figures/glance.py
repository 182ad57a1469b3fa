"""One picture of a run: what the star camera saw, the flight, and the attitude error inside 3 sigma."""

import numpy as np

from shefex_nav import event_words
from shefex_nav.report import local_level
from shefex_nav.report.figures import errors, flown, frame, labels, style
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors

_HEIGHT = 5.0  # inches
_EVENTS = {"lift_off", "burn_out_1", "burn_out_2", "apogee", "entry", "landing", "impact"}
_DEG = np.degrees(1.0)


@style.styled
def glance(data, seen):
    """A frame with its stars named, height over time by phase, and the attitude errors since the first fix.

    data : RunData with truth;  seen : runs.SeenFrame with pixels. Returns Figure.
    """
    figure = style.figure(_HEIGHT)
    sky = figure.add_gridspec(1, 1, left=0.01, right=0.49, top=0.86, bottom=0.02)
    flight = figure.add_gridspec(1, 1, left=0.57, right=0.985, top=0.86, bottom=0.62)
    attitude = figure.add_gridspec(3, 1, left=0.57, right=0.985, top=0.475, bottom=0.11, hspace=0.25)
    _sky(figure.add_subplot(sky[0]), seen)
    _flight(figure.add_subplot(flight[0]), data, seen.t_s)
    _attitude([figure.add_subplot(attitude[k]) for k in range(3)], data, seen.t_s)
    style.title(figure, local_level.title(data))
    return figure


def _sky(axes, seen):
    """The frame with the names of its stars."""
    frame.picture(axes, seen)
    axes.set(xticks=[], yticks=[], anchor="NW")
    found = int((seen.fix.hip > 0).sum()) if seen.fix is not None else 0
    axes.set_title(f"star camera at T{seen.t_s:+.0f} s: {found} stars identified")


def _flight(axes, data, t_s):
    """Height over time in the colours of the phases."""
    path = flown.path(data)
    for phase, rows in flown.by_phase(path, data.truth):
        axes.plot(path.t_s[rows], path.track.height[rows] / 1e3, color=style.PHASES[phase], lw=2.6)
    _mark(axes, t_s)
    axes.set_title("height [km]; colours are the phases of the mission")
    axes.set_xlim(*style.whole(data))
    axes.margins(y=0.25)
    axes.autoscale_view()  # names are placed by the limits
    style.no_narrower(axes, style.STILL_KM)
    principal = [event for event in data.events if event.name in _EVENTS]
    at_s = [event.t_s for event in principal]
    xy = np.column_stack([at_s, np.interp(at_s, path.t_s, path.track.height / 1e3)])
    avoid = np.column_stack([path.t_s, path.track.height / 1e3])[::8]
    labels.place(axes, xy, [event_words.in_words(event.name) for event in principal], avoid=avoid)


def _attitude(panels, data, t_s):
    """Errors about the axes of the body with 3 sigma, since the first star fix or of the whole log."""
    found = navigation_errors(data)
    sigma_t_s, _, sigma = normalised_errors(data, found)
    (first_s, last_s), since_s = style.whole(data), errors.part_since(data)
    words = "attitude error [deg] in ±3 σ"
    panels[0].set_title(words if since_s is None else f"{words} since the first star fix")
    since_s = first_s if since_s is None else since_s
    late, late_sigma = found.t_s > since_s, sigma_t_s > since_s
    for k, axes in enumerate(panels):
        style.band(axes, sigma_t_s[late_sigma], sigma[late_sigma, 6 + k] * _DEG)
        style.curve(axes, found.t_s[late], found.attitude_b[late, k] * _DEG, color=style.AXES["xyz"[k]])
        _mark(axes, t_s)
        three = 3.0 * sigma[late_sigma, 6 + k] * _DEG
        errors.cut_by_stars(axes, data, (sigma_t_s[late_sigma], three), found.attitude_b[late, k] * _DEG)
        axes.set_xlim(since_s, last_s)
        axes.set_ylabel("xyz"[k], rotation=0)
        axes.tick_params(labelbottom=k == 2)
    panels[-1].set_xlabel(style.time_label(data))


def _mark(axes, t_s):
    """The instant of the frame."""
    axes.axvline(t_s, color=style.GREY, lw=0.8, ls="--")
