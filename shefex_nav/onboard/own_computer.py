"""A whole on-board computer of somebody's own: pictures, IMU, GPS in, solutions and camera commands out."""

from typing import Protocol

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard import own_records
from shefex_nav.onboard.own_navigation import OwnNavigation
from shefex_nav.onboard.own_tracker import Answers, Solved
from shefex_nav.records import CameraCommand, Frame

FRAMES = 50  # that are kept, for answers that come later


class Computer(Protocol):
    """A computer, as a user writes it."""

    def start(self, alignment, mission):
        """Begin at the instant of the alignment. records.Alignment, software.MissionData"""

    def step(self, imu, arrived):
        """A tick of 10 ms.

        imu : records.ImuBlock, the samples of the tick
        arrived : list of records that arrive at it: Frame, GpsFix, GpsRanges, readings of instruments
        -> list of Estimate or whole records as of `Navigation`, Solved with the number of its Frame, and
        CameraCommand: the camera takes no picture before the first one
        """


class OwnComputer(OwnNavigation):
    """A computer of somebody's own, a `driving.Software`.

    software : Computer, not started;  name, alignment, mission, wanted : as of OwnNavigation
    """

    WHAT = "computer"
    GIVES = (*OwnNavigation.GIVES, Solved, CameraCommand)

    def __init__(self, software, name, alignment, mission, wanted):
        super().__init__(software, name, alignment, mission, wanted)
        self._answers, self._exposure_s = Answers(self._own, mission.sheets["star_tracker"]), None
        self._frames = {}  # number -> Frame without an answer

    def update(self, arrived):
        """As of `driving.Software`."""
        self._frames |= {one.number: one for one in arrived if isinstance(one, Frame)}
        for number in list(self._frames)[:-FRAMES]:
            del self._frames[number]
        return super().update(arrived)

    def _recorded(self, given):
        """As of OwnNavigation."""
        if isinstance(given, CameraCommand):
            return [self._checked_command(given)]
        return self._solved(given) if isinstance(given, Solved) else super()._recorded(given)

    def _checked_command(self, command):
        """A CameraCommand of this tick."""
        command = own_records.checked(self._own, self.now_s, command)
        if abs(command.t_s - self.now_s) > SAME_S:
            raise self._error(f"gave a CameraCommand of T{command.t_s:+.6f} s, of another tick")
        self._exposure_s = command.exposure_s
        return self._answers.checked(command, self.now_s)

    def _solved(self, solved):
        """StarFix and, if something is asked of the camera, CameraCommand of a Solved."""
        is_number = isinstance(solved.number, int | np.integer)
        frame = self._frames.pop(solved.number, None) if is_number else None
        if frame is None:
            words = f"which has not come, has been answered, or came more than {FRAMES} frames ago"
            raise self._error(f"gave a Solved of frame {solved.number}, {words}")
        outputs = [self._answers.fix(solved, frame, self.now_s, self.now_s)]
        if solved.exposure_s is None and solved.gain_db is None:
            return outputs
        return [
            *outputs,
            self._checked_command(
                self._answers.command(solved, self._exposure_s or frame.exposure_s, self.now_s, self.now_s)
            ),
        ]
