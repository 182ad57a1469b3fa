"""A log in the viewer while it is written: slice after slice of it is sent as the whole would be.

It is read by a process of its own, so that a flight in real time does not wait for the viewer. Curves keep
the last minute in sight; when the log has been closed, all of it is.
"""

import tempfile
import time
from pathlib import Path

import numpy as np

from shefex_nav.log import reader
from shefex_nav.log.run_data import join, together
from shefex_nav.log.tail import Tail
from shefex_nav.report.viewer import drawings, layout, legend, navigation, recording, sensors, stars, world
from shefex_nav.report.viewer.sender import Sender

ASKED_S = 0.1  # between two looks at the log
GROWN = 1.6  # by which the scene is larger before the eye moves back
FARTHEST = np.cos(np.radians(35.0))  # of the boresight from the middle of the map, before a new one
_KEPT_S = 0.2  # between two points of the path that is drawn again and again


def follow(log, stream, *, page=layout.OVERVIEW, old_ns=0, is_wanted=lambda: True):
    """Send a log to a rerun RecordingStream while it is written, until it is complete.

    Parameters
    ----------
    log : path, which need not be there yet
    stream : rerun RecordingStream, connected
    page : of `layout.PAGES`, open at first
    old_ns : as of `tail.Tail`
    is_wanted : function that says whether anybody looks yet

    Raises LogError
    """
    live = Live(stream, page)
    with tempfile.TemporaryDirectory() as folder, Tail(log, old_ns) as tail:
        part = Path(folder) / "slice.mcap"
        while is_wanted():
            if tail.write_slice(part):
                live.take(part)
            elif tail.is_complete:
                break
            else:
                time.sleep(ASKED_S)
    if tail.is_complete:
        live.finish(log)


def wait_for(log, stream):
    """What is shown until there is something to show."""
    import rerun as rr
    import rerun.blueprint as rrb

    words = rr.TextDocument(f"waiting for {log}", media_type=rr.MediaType.MARKDOWN)
    stream.log("summary", words, static=True)
    stream.send_blueprint(rrb.Blueprint(rrb.TextDocumentView(origin="summary", name="Flight")))
    stream.flush()


class Live:
    """What the viewer shows of a log that grows.

    stream : rerun RecordingStream;  page : of `layout.PAGES`
    """

    def __init__(self, stream, page):
        self._stream, self._page = stream, page
        self._sender = self._grey = self._C_ms = self._laid_out = None
        self._path = self._truth = None  # TruthSample of arrays: what is drawn, what has no solution yet
        self._events, self._last_fix_s, self._held = [], np.inf, None

    def take(self, part):
        """Send a slice of the log (path)."""
        data = self._completed(reader.read(part))
        if self._sender is None:
            self._begin(data)
        self._events += data.events
        if self._grey is None and len(data.frames.bits):
            self._grey = drawings.grey_values(part, data)
        drawings.send(self._stream, part, data, self._grey)
        if self._held is not None:
            data = together(self._held, data)
        self._held = None if len(data.truth.t_s) else data  # until there is a time for it
        if self._held is not None:
            return
        self._look(data, part)
        world.send_curves(self._sender, data)
        sensors.send(self._sender, data)
        self._stars(data)
        navigation.send(self._sender, data)
        self._scene(data)
        self._stream.flush()

    def finish(self, log):
        """What is known of a log that is complete."""
        data = recording.read(log)
        seen, has = self._content(data, log)
        self._send_blueprint(data, seen, has, is_over=True)
        if np.isfinite(self._last_fix_s):
            stars.switched_off(self._sender, self._last_fix_s, data)
        recording.send_summary(self._sender, data)
        self._stream.flush()

    def _begin(self, data):
        """What is known before the first tick."""
        self._sender = Sender(self._stream, data.mission.epoch_utc)
        self._stream.send_recording_name(f"{data.mission.scenario}, seed {data.mission.seed}")
        legend.send(self._sender, recording.names([data])[0])
        recording.send_text(self._sender, "the flight goes on")

    def _completed(self, data):
        """RunData of a slice; the truth of its last tick, whose solution comes later, waits for it."""
        truth = data.truth if self._truth is None else join([self._truth, data.truth])
        last_s = data.nav.t_s[-1] if len(data.nav.t_s) else -np.inf
        here = max(int(np.searchsorted(truth.t_s, last_s, side="right")), len(truth.t_s) - 1, 0)
        self._truth = truth._make(column[here:] for column in truth)
        return data._replace(truth=truth._make(column[:here] for column in truth))

    def _look(self, data, part):
        """Lay the pages out if there is more to show than before, or the scene has grown."""
        self._keep_path(data)
        seen, has = self._content(data._replace(truth=self._path), part)
        if self._laid_out is not None:
            size, before = self._laid_out
            has = _either(has, before)
            if has == before and seen.size < GROWN * size:
                return
        self._laid_out = seen.size, has
        self._send_blueprint(data, seen, has)

    def _keep_path(self, data):
        """Add to the path that is drawn."""
        every = world.thinned(
            data.truth, max(1, int(np.searchsorted(data.truth.t_s - data.truth.t_s[0], _KEPT_S)))
        )
        self._path = every if self._path is None else join([self._path, every])

    def _content(self, data, log):
        """Scene and Content of a RunData."""
        return layout.scene(world.path(data)), layout.content(data, drawings.kept_pictures(log))

    def _send_blueprint(self, data, seen, has, *, is_over=False):
        from shefex_nav.report.viewer import pages

        made = pages.blueprint(data, seen, has, page=self._page)
        self._stream.send_blueprint(made if is_over else pages.following(made))

    def _stars(self, data):
        """Marks and curves of the star tracker, and its field in a map that stays as long as it can."""
        stars.marks(self._sender, data)
        stars.settings(self._sender, data)
        stars.status(self._sender, data)
        if data.star_fixes:
            self._last_fix_s = data.star_fixes[-1].t_valid_s
        elif data.truth.t_s[-1] > self._last_fix_s + layout.FRAME_SHOWN_S:
            stars.switched_off(self._sender, self._last_fix_s, data)
            self._last_fix_s = np.inf
        if data.frame_truths:
            middle_i = stars.boresights(data.frame_truths).mean(axis=0)
            if self._C_ms is None or self._C_ms[2] @ middle_i < FARTHEST * np.linalg.norm(middle_i):
                self._C_ms = stars.map_axes(middle_i)
                stars.star_map(self._sender, self._C_ms, data.mission)
            stars.field(self._sender, self._C_ms, data)

    def _scene(self, data):
        """The path so far, and the vehicle at its end."""
        whole = data._replace(truth=self._path, events=self._events)
        _, flown = world.scenery(self._sender, whole)
        n = int(np.searchsorted(self._path.t_s, data.truth.t_s[0]))
        world.move(self._sender, data, self._path.t_s[n:], flown[n:], layout.scene(flown).size)


def _either(has, before):
    """Content of two: what either has."""
    pairs = zip(has, before, strict=True)
    return type(has)(
        *(a or b if isinstance(a, bool) else a + tuple(x for x in b if x not in a) for a, b in pairs)
    )
