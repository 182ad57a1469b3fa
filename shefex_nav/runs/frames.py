"""The pictures of a run, with what was found in them and what they really show."""

from typing import NamedTuple

import numpy as np

from shefex_nav.log import pixels
from shefex_nav.log.topics import epoch_ns, log_time_ns
from shefex_nav.records import FrameTruth, Reason, StarFix

MOST_AWAY_S = 1.0  # between the time asked for and the one that there is
_TRIED = 200  # frames from the middle outwards, for one whose pixels were kept


class SeenFrame(NamedTuple):
    """One frame of the star camera, what came out of it and what it really looked at."""

    number: int
    t_s: float  # middle of the exposure
    exposure_s: float
    gain_db: float
    image_dn: np.ndarray | None  # (rows, columns) grey values; None where the log keeps none
    is_full: bool  # as read out; otherwise the background of the sky is zero
    fix: StarFix | None  # of the star tracker; None if the run ended before
    truth: FrameTruth | None

    def __repr__(self):
        shape = "no pixels, the log keeps none of it (log.frames in the scenario)"
        if self.image_dn is not None:
            rows, columns = self.image_dn.shape
            shape = f"{columns} x {rows} pixels{'' if self.is_full else ', the sky cut off'}"
        answer = "no answer" if self.fix is None else Reason(self.fix.reason).name.lower().replace("_", " ")
        answer = "attitude" if answer == "none" else answer
        return f"<SeenFrame {self.number} of T{self.t_s:+.2f} s, {shape}, star tracker: {answer}>"

    def plot(self):
        """Figure of the frame with what was found in it and what it really looked at."""
        from shefex_nav.report.figures import frame

        if self.image_dn is None:
            raise LookupError(f"the log keeps no pixels of frame {self.number} (log.frames in the scenario)")
        return frame.frame(self)


class Frames:
    """The frames of a run; their pixels are read from its log when they are asked for."""

    def __init__(self, data, log):
        self._data, self._log = data, log
        self._fixes = {fix.number: fix for fix in data.star_fixes}
        self._truths = {truth.number: truth for truth in data.frame_truths}
        self.t_s = data.frames.t_valid_s  # (N,) middles of the exposures

    def __repr__(self):
        if not len(self):
            return "<Frames: none>"
        return f"<Frames: {len(self)}, T{self.t_s[0]:+.2f} to {self.t_s[-1]:+.2f} s; [t_s] gives the nearest>"

    def __len__(self):
        return len(self.t_s)

    def __getitem__(self, t_s):
        """SeenFrame nearest to a mission time [s]; LookupError before the first and after the last frame."""
        return self._frame(nearest(self.t_s, t_s, "frame of the star camera"))

    def __iter__(self):
        return (self._frame(k) for k in range(len(self)))

    def middle(self):
        """SeenFrame with pixels, from the middle of the frames that gave an attitude; None without any."""
        solved = [fix.number for fix in self._data.star_fixes if fix.reason == Reason.NONE]
        rows = np.flatnonzero(np.isin(self._data.frames.number, solved))
        outward = np.argsort(np.abs(np.arange(len(rows)) - len(rows) // 2), kind="stable")
        for k in rows[outward[:_TRIED]].tolist():
            seen = self._frame(k)
            if seen.image_dn is not None:
                return seen
        return None

    def _frame(self, k):
        frames = self._data.frames
        number, ns = int(frames.number[k]), log_time_ns(epoch_ns(self._data.mission.epoch_utc), self.t_s[k])
        found = pixels.at(self._log, int(ns))
        return SeenFrame(
            number,
            float(self.t_s[k]),
            float(frames.exposure_s[k]),
            float(frames.gain_db[k]),
            found.image_dn if found else None,
            bool(found and found.is_full),
            self._fixes.get(number),
            self._truths.get(number),
        )


def nearest(times_s, t_s, what):
    """Index of the time nearest to t_s, at most a second off; LookupError."""
    k = int(np.argmin(np.abs(times_s - t_s))) if len(times_s) else -1
    if k < 0 or not abs(times_s[k] - t_s) <= MOST_AWAY_S:
        covered = f"T{times_s[0]:+.1f} to {times_s[-1]:+.1f} s" if k >= 0 else "no time"
        raise LookupError(f"no {what} at T{t_s:+.1f} s; the run has them for {covered}")
    return k
