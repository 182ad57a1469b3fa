"""The camera's electronics: commands in when they arrive, shutter open on its tick, frames out when read.

In: `CameraCommand`s of the star tracker. Out: (Frame, FrameTruth) once the frame has been read out. With a
rolling shutter a frame may start before the one before it has ended: its first row is free again by then.
"""

from bisect import bisect_left
from math import inf

from shefex_nav.clock import SAME_S
from shefex_nav.geometry.shutter import duration_s, row_times
from shefex_nav.world.camera.camera import expose


def _late_s(end_s):
    """The last instant that counts to a tick with this end."""
    return end_s + SAME_S


class Shutter:
    """A camera that is running.

    camera : Camera
    trajectory : Trajectory
    every : int, ticks from frame to frame
    last_s : s, a picture that would not have been read out by then is not taken: the computer is off after it
    rng : Generator of the noise of the frames
    take : `camera.expose`, or what stands for a picture in its place
    """

    def __init__(self, camera, trajectory, *, every, last_s, rng, take=expose):
        self.take = take
        self.camera, self.trajectory, self.rng = camera, trajectory, rng
        self.every, self.last_s = every, last_s
        self.end_s = float(trajectory.t_s[-1])
        self.commands = []  # not yet in force, oldest first
        self.command = None  # in force; none before the first: the camera is off
        self.waiting = []  # (Frame, FrameTruth) not yet read out, oldest first
        self.number = 0
        self.seen = -1  # the last tick that has been seen to
        self.is_over = False  # no picture would be read out in time any more

    def tick(self, n, now_s, commands=()):
        """Take new commands; take a picture if one is due at tick n.

        Ticks may be seen to ahead of time as far as no command can come before them; again they do nothing.
        """
        if n <= self.seen:
            if commands:
                raise ValueError(f"a command at tick {n} to a camera that has been seen to until {self.seen}")
            return
        self.commands += commands
        self.seen = n
        while self.commands and self.commands[0].t_s <= now_s + SAME_S:
            self.command = self.commands.pop(0)
        if self.command is None or n % self.every:
            return
        detector = self.camera.settings.detector
        self.is_over = now_s + detector.readout > self.last_s + SAME_S
        frame_s = duration_s(row_times(self.command.exposure_s, detector.line_s, detector.rows))
        if now_s + frame_s + detector.readout > self.last_s + SAME_S:
            return
        if now_s + frame_s <= self.end_s:
            self.waiting.append(
                self.take(self.camera, self.command, self.trajectory, self.number, now_s, self.rng)
            )
            self.number += 1

    def next_tick(self, n):
        """Number of the first tick after n in which `tick` has something to do; inf while it has not."""
        if self.is_over or (self.command is None and not self.commands):
            return inf
        return (max(n, self.seen) // self.every + 1) * self.every

    def ahead(self, n, tick, ends_s):
        """Take the pictures that begin after tick n and before anything comes to the computer.

        What commands the camera comes with a picture, or while it is off: not before that.

        Parameters
        ----------
        n : tick that has been seen to
        tick : at which something else comes
        ends_s : sequence of mission times at which the ticks end, from the first one on

        Returns
        -------
        the tick at which the first of the two comes, a picture or something else
        """
        while True:
            if self.next_s < _late_s(ends_s[tick - 1]):
                tick = bisect_left(ends_s, self.next_s, lo=n, key=_late_s) + 1
            opens = self.next_tick(n)
            if opens >= tick:
                return tick
            self.tick(opens, ends_s[opens - 1])

    @property
    def next_s(self):
        """When the next picture will have been read out; inf: none is under way."""
        return self.waiting[0][0].t_available_s if self.waiting else inf

    def arrived(self, now_s):
        """Pictures that have been read out by now: list of (Frame, FrameTruth)."""
        pictures = []
        while self.waiting and self.waiting[0][0].t_available_s <= now_s + SAME_S:
            pictures.append(self.waiting.pop(0))
        return pictures
