"""Curves, lanes and marks for a rerun recording, on both timelines."""

import numpy as np

from shefex_nav.log.topics import epoch_ns, log_time_ns
from shefex_nav.report.figures.series import envelope

TIMELINE = "mission_time"  # s since lift-off
UTC = "utc"
GREEN, ORANGE, RED, GREY = (64, 255, 90), (255, 140, 26), (255, 90, 80), (130, 130, 130)
BLUE, WHITE, YELLOW, VIOLET = (90, 170, 255), (240, 240, 240), (255, 200, 80), (190, 120, 255)
AXES = {"x": (255, 120, 120), "y": (120, 255, 120), "z": (120, 160, 255)}
NAMELESS = " (short)"  # of a state that is shown without its name
LANE_CHARACTERS = 65.0  # in the width of the narrowest panel of states
_PLOT_HZ = 10  # points of a curve in a second, where there are as many
_MOST_POINTS = 20_000  # of a curve


class Sender:
    """Sends to one rerun RecordingStream; mission times become both timelines.

    stream : rerun RecordingStream;  epoch_utc : ISO 8601 instant of mission time zero
    """

    def __init__(self, stream, epoch_utc):
        self.stream = stream
        self._states = {}  # of the lanes, the last ones
        self._epoch = epoch_ns(epoch_utc)

    def times(self, t_s):
        """Index columns of mission times (n,) s."""
        import rerun as rr

        t_s = np.asarray(t_s, np.float64)
        utc = log_time_ns(self._epoch, t_s).astype("datetime64[ns]")
        return [rr.TimeColumn(TIMELINE, duration=t_s), rr.TimeColumn(UTC, timestamp=utc)]

    def static(self, entity, *drawings):
        """Something that is there all the time."""
        self.stream.log(entity, *drawings, static=True)

    def columns(self, entity, t_s, columns):
        """Columns of an archetype over times."""
        if len(t_s):
            self.stream.send_columns(entity, indexes=self.times(t_s), columns=columns)

    def clear(self, entity, t_s):
        """What was drawn of an entity is gone from a time on."""
        import rerun as rr

        self.stream.send_columns(
            entity, indexes=self.times([t_s]), columns=rr.Clear.columns(is_recursive=[False])
        )

    def curve(self, entity, t_s, values, colour, name, width=1.2):
        """One curve of a plot; it has a gap where values are not finite."""
        import rerun as rr

        style = rr.SeriesLines(
            colors=[colour],
            names=[name],
            widths=[width],
            aggregation_policy="MinMax",  # the default averages and would flatter every error
        )
        self.static(entity, style)
        values = np.where(np.isfinite(values), values, np.nan)
        if not np.isnan(values).all():
            self.columns(entity, t_s, rr.Scalars.columns(scalars=values))

    def axes(self, entity, t_s, values):
        """Three curves, entity/x, /y and /z; values (n, 3)."""
        for k, (axis, colour) in enumerate(AXES.items()):
            self.curve(f"{entity}/{axis}", t_s, values[:, k], colour, axis)

    def readings(self, entity, t_s, values, colour, name):
        """A curve; marks where some values are not finite, for a line would not show one alone."""
        known = np.isfinite(values)
        if known.all():
            self.curve(entity, t_s, values, colour, name)
        else:
            self.marks(entity, np.asarray(t_s)[known], np.asarray(values)[known], colour, name)

    def marks(self, entity, t_s, values, colour, name, shape="circle", size=2.5):
        """Marks in a plot."""
        import rerun as rr

        style = rr.SeriesPoints(colors=[colour], names=[name], markers=[shape], marker_sizes=[size])
        self.static(entity, style)
        if len(t_s):
            self.columns(entity, t_s, rr.Scalars.columns(scalars=np.asarray(values, np.float64)))

    def has_lane(self, entity):
        """Whether a state of it has been sent."""
        return entity in self._states

    def lane(self, entity, t_s, states, colours, span):
        """A state timeline; only changes are sent, after those of before. {state: colour}

        span : (first, last) s of the time axis; what is too short on it for its name goes without
        """
        import rerun as rr

        before = [self._states.get(entity), *states[:-1]]
        changed = [k for k in range(len(states)) if states[k] != before[k]]
        if not changed:
            return
        self._states[entity] = states[-1]
        times = [t_s[k] for k in changed]
        ends = [*times[1:], span[1]]
        names = [
            states[k] if _fits(states[k], end - start, span) else states[k] + NAMELESS
            for k, start, end in zip(changed, times, ends, strict=True)
        ]
        labels = [state.replace("_", " ") for state in colours]
        values = [*colours, *(state + NAMELESS for state in colours)]
        look = {"labels": [*labels, *(" " for _ in labels)], "colors": [*colours.values()] * 2}
        self.static(entity, rr.StateConfiguration(values=values, **look))
        self.columns(entity, times, rr.StateChange.columns(state=names))


def _fits(state, length_s, span):
    """Whether the name of a state has room in the narrowest panel of states."""
    return length_s * LANE_CHARACTERS >= (len(state) + 1.5) * (span[1] - span[0])


def plotted(t_s, values):
    """Samples of a curve: the least and the largest of each stretch of two of `plot_step`, and both ends.

    Every so many-th alone would miss peaks. (n,), (n,) -> (m,) indices, ascending
    """
    return envelope(values, max(2, len(t_s) // plot_step(t_s)))


def plot_step(t_s):
    """Every how many samples there is a point of a curve."""
    if len(t_s) < 2:
        return 1
    rate = (len(t_s) - 1) / (t_s[-1] - t_s[0])
    return max(1, round(rate / _PLOT_HZ), -(-len(t_s) // _MOST_POINTS))
