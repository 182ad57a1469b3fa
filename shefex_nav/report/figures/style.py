"""What all figures have in common: colours, fonts, panels over mission time, and how they are written.

Figures are matplotlib `Figure` objects of their own, no state of pyplot is touched, and matplotlib is
imported when one is drawn. Colours are those of Okabe and Ito (Color Universal Design, 2008), told
apart with every kind of colour vision; where curves share a panel, they differ in their lines as well.
"""

import re
from functools import wraps
from io import BytesIO
from itertools import pairwise
from pathlib import Path

import numpy as np

from shefex_nav import files
from shefex_nav.records import Phase
from shefex_nav.report import html
from shefex_nav.report.figures.series import MOST_POINTS, cut, envelope, gapped
from shefex_nav.report.local_level import is_replay
from shefex_nav.report.pairing import stretches, whole_time

BLACK, GREY = "#000000", "#767676"
ORANGE, SKY, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#f0e442"
BLUE, RED, PURPLE = "#0072b2", "#d55e00", "#cc79a7"
BAND = "#cfe3f1"  # of sigmas and of bounds
AXES = dict(zip("xyz", (BLUE, RED, GREEN), strict=True))
DASHES = dict(zip("xyz", ("-", "--", "-."), strict=True))
PHASES = {  # lightness alone tells neighbours apart
    Phase.PAD: "#bdbdbd", Phase.BOOST: RED, Phase.COAST: SKY, Phase.MANOEUVRE: YELLOW,
    Phase.POINTING: GREEN, Phase.DESCENT: BLUE, Phase.PARACHUTE: PURPLE, Phase.ORBIT: SKY,
    Phase.GROUND: "#bdbdbd",
}  # fmt: skip
_DARK = {Phase.BOOST, Phase.POINTING, Phase.DESCENT}  # white letters on these

QUANTITIES = (("position", "m", 1.0), ("velocity", "m/s", 1.0), ("attitude", "deg", 180.0 / np.pi))
TITLES = {"gyro_bias": "gyro bias", "accel_bias": "accelerometer bias"}  # of blocks of errors
RIGHT, BOTTOM = 0.22, 0.55  # inches, margins of a figure
WIDTH = 11.0  # inches: on a page of 1280 px letters are a little larger than in print
STILL_KM = 0.2  # height that an axis shows at least
_LEAST_S = 0.2  # of a part of a phase
_FEW_DOTS = 200
_DIGITS = re.compile(rb"(\.\d\d)\d+")  # of coordinates in 1/72 inch, where two are plenty
_DPI = 160  # of pictures within figures
_NOTEBOOK_DPI = 80
STYLE = {
    "font.family": ["DejaVu Sans"],
    "font.size": 11.0,
    "axes.titlesize": 12.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 11.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "legend.fontsize": 10.0,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "#dddddd",
    "lines.linewidth": 1.3,
    "svg.fonttype": "path",
    "svg.hashsalt": "shefex_nav",
}


def styled(draw):
    """Decorator: the function draws and writes with STYLE, whatever the user's own settings are."""

    @wraps(draw)
    def wrapper(*args, **kwargs):
        from matplotlib import style

        with style.context(["default", STYLE]):
            return _shown(draw(*args, **kwargs))

    return wrapper


def _shown(drawn):
    """The same; a Figure is a picture in a notebook, which only shows those of pyplot by itself."""
    if hasattr(drawn, "savefig"):
        drawn._repr_png_ = _Png(drawn)
    return drawn


class _Png:
    """Function that gives a Figure as PNG; a Figure that has one can still be copied and pickled."""

    def __init__(self, figure):
        self._figure = figure

    def __call__(self):
        out = BytesIO()
        self._figure.savefig(out, format="png", dpi=_NOTEBOOK_DPI)
        return out.getvalue()


def figure(height, width=WIDTH):
    """An empty Figure, sizes in inches. Axes are put at fixed places: a layout engine costs half the time."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height))


def constrained(width, height):
    """An empty Figure whose axes find their places by themselves, sizes in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def small_multiples(n, columns, width, height, margin):
    """(Figure, list of its n Axes) in rows of so many. Inches: width of all, height of a row, above them"""
    rows = -(-n // columns)
    drawn = constrained(width, margin + height * rows)
    axes = drawn.subplots(rows, columns, squeeze=False).ravel().tolist()
    for unused in axes[n:]:
        unused.remove()
    return drawn, axes[:n]


def heading(figure, text):
    """The line above a `constrained` figure that says what is seen."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=14, fontweight="bold")


def title(figure, text):
    """The one line above a figure that says what is seen."""
    y = 1.0 - 0.08 / figure.get_figheight()
    figure.text(0.01, y, text, ha="left", va="top", fontsize=14, fontweight="bold")


def grid(figure, heights, *, columns=1, gap=0.24, left=1.1, top=0.5, between=0.85, below=0.0):
    """GridSpec with everything in inches: heights of the rows, gaps, margins; `below` widens the lower."""
    width, height = figure.get_size_inches()
    each = (width - left - RIGHT - (columns - 1) * between) / columns
    mean = float(np.mean(heights))
    return figure.add_gridspec(
        len(heights), columns, height_ratios=heights, hspace=gap / mean, wspace=between / each,
        left=left / width, right=1.0 - RIGHT / width, top=1.0 - top / height,
        bottom=(BOTTOM + below) / height,
    )  # fmt: skip


def single(height, text, below=0.0):
    """Figure with one Axes: (Figure, Axes). below : inches added under it, for a legend"""
    drawn = figure(height + below)
    axes = drawn.add_subplot(grid(drawn, [height - 1.05], left=0.8, below=below)[0, 0])
    title(drawn, text)
    return drawn, axes


def panels(data, n, text, *, columns=1, height=1.75, heads=None, spans_s=None):
    """Figure of n panels over mission time below a strip of the mission's phases.

    text : title;  height : inches of a panel;  heads : title of each column;  spans_s : (start, end) of the
    time axis of each column, else that of the log. Returns Figure, (n, columns) array of Axes.
    """
    spans_s = spans_s or [whole(data)] * columns
    has_phases = len(data.truth.t_s) > 0 and not is_replay(data)  # recorded data do not say them
    heights = [0.24] * has_phases + [height] * n
    gap, top = 0.24, 0.5 + (0.28 if heads else 0.0)
    drawn = figure(top + BOTTOM + sum(heights) + gap * (len(heights) - 1))
    spec = grid(drawn, heights, columns=columns, gap=gap, top=top)
    rows = np.empty((n, columns), dtype=object)
    for c in range(columns):
        for k in range(n):
            rows[k, c] = drawn.add_subplot(spec[k + has_phases, c], sharex=rows[0, c] if k else None)
            rows[k, c].tick_params(labelbottom=k == n - 1, bottom=k == n - 1)
            rows[k, c].yaxis.set_label_coords(-0.68 / _width_of(rows[k, c]), 0.5)
        if has_phases:
            strip = drawn.add_subplot(spec[0, c], sharex=rows[0, c])
            phase_strip(strip, data, spans_s[c])
        if heads:
            (strip if has_phases else rows[0, c]).set_title(heads[c], pad=7)
        rows[-1, c].set_xlabel(time_label(data))
        rows[0, c].set_xlim(*spans_s[c])
    title(drawn, text)
    return drawn, rows


def time_label(data):
    """Label of an axis of mission time."""
    flew_up = any(event.name == "lift_off" for event in data.events)
    return "time from lift-off [s]" if flew_up else "mission time [s]"


def whole(data):
    """Mission time of the first and the last sample of truth or estimate."""
    start_s, end_s = whole_time(data) or (data.mission.start_s, data.mission.start_s + 1.0)
    return start_s, max(end_s, start_s + 1e-2)


def around(t_s):
    """A span of time a little wider than sorted times."""
    margin = max(1.0, 0.02 * float(t_s[-1] - t_s[0]))
    return float(t_s[0]) - margin, float(t_s[-1]) + margin


def _width_of(axes):
    """Width of an Axes in inches."""
    return axes.get_position().width * axes.figure.get_figwidth()


def event_lines(axes, data):
    """A thin line at each event."""
    axes.vlines(
        [event.t_s for event in data.events], 0.0, 1.0, transform=axes.get_xaxis_transform(),
        colors="#999999", lw=0.5, ls=":", zorder=0,
    )  # fmt: skip


def no_narrower(axes, span):
    """A y axis that is no narrower than span: of what stays the same, rounding is not drawn as motion."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def log_scale(axes, bottom=None, top=None):
    """Logarithmic y axis with its numbers written out; linear where no curve has anything above zero."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    if not any((np.asarray(line.get_ydata(), dtype=float) > 0.0).any() for line in axes.lines):
        return
    axes.set_yscale("log")
    axes.set_ylim(bottom, top)
    low, high = axes.get_ylim()
    decades = np.log10(high / low)
    subs = (1.0,) if decades > 1.5 else (1.0, 2.0, 5.0)  # one number alone is no scale
    axes.yaxis.set_major_locator(LogLocator(10.0, subs, numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    if decades > 1.5:
        axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())


def phase_pieces(truth):
    """(Phase, slice of the samples) of every phase in turn. TruthSample of arrays -> list"""
    if not len(truth.t_s):
        return []
    bounds = [0, *(np.flatnonzero(np.diff(truth.phase)) + 1).tolist(), len(truth.t_s)]
    return [(Phase(int(truth.phase[a])), slice(a, b)) for a, b in pairwise(bounds)]


def steered(events, phase, start, end):
    """Parts of a phase by the tasks that steer in it: (name, begin, end) of each, s; its own name where none.

    The events of a task are `NAME_start` and `NAME_end`.
    """
    if phase not in (Phase.MANOEUVRE, Phase.POINTING):
        return [(phase.name.lower(), start, end)]
    at = {event.name: event.t_s for event in events}
    begun = sorted((t_s, name.removesuffix("_start")) for name, t_s in at.items() if name.endswith("_start"))
    cuts = [start, *(t_s for t_s, _ in begun if start + _LEAST_S < t_s < end - _LEAST_S), end]
    found = []
    for begin, until in pairwise(cuts):
        names = [name for t_s, name in begun if t_s < until - _LEAST_S]
        name = names[-1] if names and at.get(f"{names[-1]}_end", end) > begin + _LEAST_S else None
        found.append((phase.name.lower() if name is None else name.replace("_", " "), begin, until))
    return found


def phase_strip(axes, data, span_s):
    """Bars of the phases of the mission, named where there is room between the ends of span_s.

    Where tasks of a programme steer, these are named.
    """
    t_s = data.truth.t_s
    axes.set_ylim(0.0, 1.0)
    axes.axis("off")
    per_inch = (span_s[1] - span_s[0]) / _width_of(axes)
    for phase, piece in phase_pieces(data.truth):
        start, end = float(t_s[piece.start]), float(t_s[min(piece.stop, len(t_s) - 1)])
        axes.broken_barh([(start, end - start)], (0.0, 1.0), color=PHASES[phase], lw=0)
        colour = "white" if phase in _DARK else "black"
        for name, begin, until in steered(data.events, phase, start, end):
            if begin > start:
                axes.axvline(begin, color=colour, lw=0.8)
            begin, until = max(begin, span_s[0]), min(until, span_s[1])
            if (until - begin) / per_inch > 0.08 * len(name) + 0.05:
                middle = 0.5 * (begin + until)
                axes.text(
                    middle, 0.45, name, ha="center", va="center", fontsize=9, color=colour, clip_on=True
                )


def curve(axes, t_s, values, **kwargs):
    """Plot a curve through the samples of `envelope`, interrupted where the samples are. Line2D"""
    t_s, values = gapped(t_s, values)
    shown = envelope(values, _points(axes))
    return axes.plot(t_s[shown], values[shown], **kwargs)[0]


def _points(axes):
    """How many points a curve needs in an Axes."""
    return max(2, int(MOST_POINTS * _width_of(axes) / (WIDTH - 1.2)))


def dots(axes, x, y, **kwargs):
    """Plot points; many of them are a picture within the figure, or it would be megabytes. Line2D"""
    many = len(x) > _FEW_DOTS
    return axes.plot(x, y, ".", rasterized=many, **{"ms": 2.5, **kwargs})[0]


def band(axes, t_s, sigma, *, centre=0.0, label="±3 σ", n_sigma=3.0):
    """Band of n_sigma about a centre (number or (n,)); gaps where the sigma is NaN or the time leaps."""
    t_s, sigma, middle = gapped(t_s, sigma, np.broadcast_to(centre, np.shape(sigma)))
    shown = envelope(sigma, _points(axes) // 2)
    t_s, low, high = t_s[shown], (middle - n_sigma * sigma)[shown], (middle + n_sigma * sigma)[shown]
    axes.fill_between(t_s, low, high, color=BAND, lw=0, label=label)
    edges = np.concatenate([low, [np.nan], high])
    axes.plot(np.concatenate([t_s, [np.nan], t_s]), edges, color=BLUE, lw=0.5, alpha=0.6, label="_edges")


def legend(axes, **kwargs):
    """Legend of the labelled things, if there are any."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**{"loc": "best", "borderaxespad": 0.3, **kwargs})


def legend_above(axes, **kwargs):
    """The same in one line above the panel, where it covers nothing; between panels there is room for it."""
    handles = axes.get_legend_handles_labels()[0]
    if handles:
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": len(handles)}
        small = {"fontsize": 9, "frameon": False, "borderaxespad": 0.0, "borderpad": 0.15}
        axes.legend(**place, **small, **kwargs)


def note_above(axes, words):
    """A few words above the left end of a panel, where they cover nothing."""
    axes.text(0.005, 1.02, words, transform=axes.transAxes, ha="left", va="bottom", fontsize=9)


def limits(axes, values, *, margin=0.08, least=0.0):
    """Limits of the y axis around finite values; least : smallest height shown."""
    known = np.concatenate([np.ravel(v) for v in values])
    known = known[np.isfinite(known)]
    if not len(known):
        return
    low, high = float(known.min()), float(known.max())
    pad = margin * (high - low) + 0.5 * max(least - (high - low), 0.0) or 1.0
    axes.set_ylim(low - pad, high + pad)


def cut_off(axes, values, unit):
    """End the y axis where a few of the values, (n,) of at least zero, would flatten the others; says so."""
    found = cut(values)
    if found is not None:
        axes.set_ylim(0.0, found.top)
        words = f"{found.count} of {len(values)} lie above, up to {found.largest:.4g} {unit}"
        note_above(axes, words)


def spans(t_s, flags):
    """Intervals in which samples are flagged: list of (start, length) for broken_barh. (n,), (n,) bool"""
    step = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 0.0
    return [(float(t_s[a]), float(t_s[b - 1] - t_s[a]) + step) for a, b in stretches(flags)]


@styled
def svg(figure):
    """A figure as an SVG text: bytes, the same for the same figure. Letters are outlines: no font needed."""
    out = BytesIO()
    figure.savefig(out, format="svg", dpi=_DPI, metadata={"Date": None})
    return re.sub(rb' d="[^"]*"', lambda found: _DIGITS.sub(rb"\1", found.group()), out.getvalue())


def picture(figure, name, caption, alt=None):
    """A figure within an HTML page, alt : instead of its caption where it is not seen. -> html.Safe"""
    return html.picture(svg(figure), name, alt or caption, caption, figure.get_size_inches())


@styled
def png(figure, dpi=150):
    """A figure that was drawn with STYLE as PNG: bytes."""
    out = BytesIO()
    figure.savefig(out, format="png", dpi=dpi)
    return out.getvalue()


@styled
def save(figure, path, dpi=150):
    """Write a figure that was drawn with STYLE; the ending of the name says how (.png, .svg, .pdf)."""
    write(figure, path, dpi)


def write(figure, path, dpi, **how):
    """Write a figure as it is. how : as of `Figure.savefig`"""
    with files.whole(Path(path)) as half:
        figure.savefig(half, format=Path(path).suffix.removeprefix("."), dpi=dpi, **how)
