"""Figures of one run: functions RunData -> matplotlib Figure, or None where a log has nothing of the kind.

    from shefex_nav.log import reader
    from shefex_nav.report import figures

    data = reader.read("run.mcap")
    figures.draw("trajectory", data).savefig("trajectory.png")

The functions are in one module for each subject; `catalogue` is their list in the order of the report.
"""

from importlib import import_module
from typing import NamedTuple

from shefex_nav.instruments import TABLE


class Entry(NamedTuple):
    """One kind of figure."""

    name: str
    place: str  # 'module.function' of this package; '': of the plots of an instrument
    section: str  # of the report
    caption: str  # how it is read


CATALOGUE = (
    Entry(
        "trajectory", "flight.trajectory", "flight",
        "Height above the ellipsoid against the distance flown over ground; dots are events, colours "
        "phases.",
    ),
    Entry(
        "history", "flight.history", "flight",
        "Speed is relative to the Earth, the angle of attack that between roll axis and air. Dotted "
        "lines are the events.",
    ),
    Entry(
        "ground_track", "flight.ground_track", "flight",
        "Where both are known, true and estimated track differ by metres and lie on each other. The legend "
        "says which islands the coast lines lack; no line says on which side land is.",
    ),
    Entry(
        "attitude_control", "flight.attitude_control", "flight",
        "Rotation from the wanted to the true attitude, body axes; no line where nothing is wanted "
        "about an axis. The phase of pointing is shaded.",
    ),
    Entry(
        "imu", "sensors.imu", "sensors",
        "With vibration and every error of the sensors, as the computer got it.",
    ),
    Entry(
        "gps", "sensors.gps", "sensors",
        "As the receiver reports; shaded where it had no fix.",
    ),
    Entry(
        "sky_map", "sky.sky_map", "star tracker",
        "True direction of the boresight at each frame. On the left the whole sky, right ascension in "
        "hours, with what the exclusion angles forbid in the middle of the fixes; on the right the part"
        " around them.",
    ),
    Entry(
        "status", "star_tracker.status", "star tracker",
        "Bars say which frames gave an attitude and why the others did not; below, the stars in them "
        "and the true conditions.",
    ),
    Entry(
        "star_errors", "star_tracker.star_errors", "star tracker",
        "True attitude of the camera less that of the fix. The mean is what is constant in a run, "
        "above all the principal point, and not in the covariance. It has no part of the mounting error.",
    ),
    Entry(
        "camera", "star_tracker.camera", "star tracker",
        "What the exposure control asked for, and how well the identified stars fit the attitude.",
    ),
    Entry(
        "attitude", "errors.attitude", "navigation",
        "Truth less estimate. The filled band is ±3 sigma of the filter: 99.7 % of the errors should "
        "lie in it.",
    ),
    Entry(
        "velocity", "errors.velocity", "navigation",
        "Relative to the Earth; bands as above.",
    ),
    Entry(
        "position", "errors.position", "navigation",
        "Bands as above.",
    ),
    Entry(
        "biases", "errors.biases", "navigation",
        "How the estimates settle, and how far the filter trusts them.",
    ),
    Entry(
        "nees", "consistency.nees", "consistency",
        "Above the band the filter is worse than it says, below it better. Neighbouring epochs are "
        "correlated: of one run not exactly 95 % lie inside.",
    ),
    Entry(
        "nis", "consistency.nis", "consistency",
        "The same of what each measurement said against what was expected. Innovations of a good filter"
        " are not correlated, so about 95 % lie inside, and the mean per degree of freedom is 1.",
    ),
    Entry(
        "health", "consistency.health", "consistency",
        "Bars: when a sensor was not used, or the solution said not to be used. Crosses: measurements "
        "refused.",
    ),
    Entry(
        "position_protection", "consistency.position_protection", "consistency",
        "The protection level bounds what a fault that nobody noticed may do to the position. Grey: the"
        " solution said not to use it. An error above the level for more than a second outside the grey is"
        " misleading. What is required is of the whole, horizontal and vertical together.",
    ),
    Entry(
        "velocity_protection", "consistency.velocity_protection", "consistency", "The same of the velocity."
    ),
    Entry(
        "protection", "consistency.protection", "consistency",
        "The same of the attitude, where what is required is about each axis.",
    ),
    Entry(
        "timing", "star_tracker.timing", "computing time",
        "Measured by the clock of the machine that simulated, not reproducible: while other programs have "
        "the processor, the clock runs on.",
    ),
)  # fmt: skip


def catalogue():
    """CATALOGUE, and a figure for each instrument that is known now."""
    own = (Entry(name, one.figure or "", "sensors", one.caption) for name, one in TABLE.items())
    before = sum(entry.section in ("flight", "sensors") for entry in CATALOGUE)
    return (*CATALOGUE[:before], *own, *CATALOGUE[before:])


def draw(name, data):
    """The Figure of a name of `catalogue` for a RunData; None where the log has nothing of the kind."""
    entries = {entry.name: entry for entry in catalogue()}
    if name not in entries:
        raise ValueError(f"there is no figure {name!r}; choose from {', '.join(entries)}")
    if not entries[name].place:
        return import_module(f"{__name__}.sensors").instrument(data, TABLE[name])
    module, _, function = entries[name].place.partition(".")
    return getattr(import_module(f"{__name__}.{module}"), function)(data)


def save_all(data, folder, kind="png", glance=None):
    """Write every figure that a log has something for; `kind` is png, svg or pdf. -> list of Path

    glance : Figure of `glance.glance`, which comes first; it needs pixels, which RunData do not hold
    """
    from pathlib import Path

    from shefex_nav.report.figures import style

    written = []
    drawn = ((entry.name, draw(entry.name, data)) for entry in catalogue())
    for name, figure in (("glance", glance), *drawn):
        if figure is not None:
            written.append(Path(folder) / f"{name}.{kind}")
            style.save(figure, written[-1])
    return written


class Plots:
    """Figures by their names: `plots.attitude()`; `dir(plots)` names them."""

    def __init__(self, names, draw, missing=None):
        """draw : function of a name that gives the Figure, or None where there is nothing to draw.

        missing : {name: why there is nothing}; of names that are not told, too
        """
        self._names, self._draw, self._missing = list(names), draw, missing or {}

    def __dir__(self):
        return self._names

    def __getattr__(self, name):
        if name.startswith("_"):  # of notebooks, such as _repr_html_; and of copies, which have no _names yet
            raise AttributeError(name)
        if name not in self._names and name not in self._missing:
            raise AttributeError(f"there is no figure {name!r}; choose from {', '.join(self._names)}")

        def drawn():
            figure = self._draw(name)
            if figure is None:
                why = self._missing.get(name, "the records it shows are missing")
                raise LookupError(f"there is nothing to draw for {name!r}: {why}")
            return figure

        return drawn
