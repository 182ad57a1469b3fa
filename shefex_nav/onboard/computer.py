"""The executive of the on-board computer: a navigation and a star tracker, which take their turns.

Order within a tick: strapdown and prediction with the IMU block, star tracker chain on the frames that have
arrived, fusion of the GPS fixes and star fixes that are due, solution. A StarFix enters the filter at the
first tick not earlier than its `t_available_s`.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.navigation.state import NavParams
from shefex_nav.onboard.navigator import Sky
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import Frame, Reason


class ComputerParams(NamedTuple):
    """Parameters of the on-board computer."""

    nav: NavParams
    tracker: star_tracker.TrackerParams
    sun_i: np.ndarray  # (3,) unit vector to the Sun, constant within the mission


class Computer:
    """The computer of one mission, a `driving.Software`.

    params : ComputerParams
    navigation : `navigator.Navigator`, or what stands for it
    tracker : star_tracker.Tracker
    chain : `star_tracker.step`, or something that wraps it or stands for it
    predicts : False if the chain does not search by the predicted attitude
    end : function that is called when there are no more ticks
    """

    def __init__(self, params, navigation, tracker, chain=star_tracker.step, predicts=True, end=lambda: None):
        self.params, self.navigation, self.tracker = params, navigation, tracker
        self._chain, self._predicts, self._end = chain, predicts, end
        self._sky = Sky(params.sun_i, params.tracker.earth_velocity_i)
        self._tracker_state = None  # star_tracker.TrackerState while switched on
        self.waiting = ()  # StarFix that are not available yet
        self.now_s = None  # end of the tick that has been reached

    def advance(self, blocks, first, last):
        """As of `driving.Software`."""
        due_s = min([self._switch_s(blocks.t_valid_s[first]), *(fix.t_available_s for fix in self.waiting)])
        if due_s < blocks.t_valid_s[last - 1]:
            last = first + int(np.searchsorted(blocks.t_valid_s[first:last], due_s - SAME_S)) + 1
        done, outputs = self.navigation.advance(blocks, first, last)
        self.now_s = float(blocks.t_valid_s[first + done - 1])
        return done, outputs

    def update(self, arrived):
        """As of `driving.Software`, of Frame and of what the navigation takes.

        -> list of records in the order in which they came about: CameraCommand (the first when the tracker is
        switched on, then one with each frame), StarFix, and those of the navigation
        """
        now_s, outputs = self.now_s, []
        frames, received = [], []
        for one in arrived:
            (frames if isinstance(one, Frame) else received).append(one)
        if is_on(self.params, now_s) != self._is_on:
            outputs += self._switch(now_s)
        if self._is_on:
            for frame in frames:
                outputs += self._track_stars(frame)
        due = [fix for fix in self.waiting if fix.t_available_s <= now_s + SAME_S]
        if due:
            self.waiting = tuple(fix for fix in self.waiting if fix.t_available_s > now_s + SAME_S)
        return outputs + self.navigation.update([*received, *due])

    def close(self):
        """There are no more ticks."""
        try:
            self.navigation.close()
        finally:
            self._end()

    @property
    def _is_on(self):
        """Whether camera and star tracker are switched on."""
        return self._tracker_state is not None

    def _switch_s(self, now_s):
        """When the star tracker is switched next, from a tick that ends at now_s on; inf: not any more."""
        settings = self.params.tracker.settings
        if self._is_on:
            return settings.off
        return settings.on if settings.enabled and now_s + SAME_S < settings.off else np.inf

    def _switch(self, now_s):
        """Switch the star tracker on or off. -> list of CameraCommand"""
        if self._is_on:
            self._tracker_state = None
            return []
        self._tracker_state, command = star_tracker.start(self.tracker, now_s)
        return [command]

    def _track_stars(self, frame):
        """Run the chain on a frame; keep its fix until it is available. -> StarFix, CameraCommand"""
        context = self.navigation.context(frame, self._sky, self._predicts)
        self._tracker_state, fix, command = self._chain(self.tracker, self._tracker_state, frame, context)
        if fix.reason == Reason.NONE or len(fix.stars.hip):
            self.waiting += (fix,)
        return [fix, command]


def is_on(params, now_s):
    """Whether camera and star tracker are on at the ticks that end at now_s: this alone decides it.

    ComputerParams; s, scalar or (n,) -> bool, likewise
    """
    settings, late_s = params.tracker.settings, now_s + SAME_S
    return settings.enabled & (settings.on <= late_s) & (late_s < settings.off)


def last_on_s(params, ends_s):
    """End of the last tick at which a picture can be taken in. ComputerParams; (n,) s -> s, -inf without"""
    ends_on_s = ends_s[is_on(params, ends_s)]
    return float(ends_on_s[-1]) if len(ends_on_s) else -np.inf
