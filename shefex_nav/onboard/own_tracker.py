"""Star tracker software of somebody's own in the place of the built-in chain: a frame in, a `Solved` out."""

from math import ceil
from typing import NamedTuple, Protocol

import numpy as np

from shefex_nav.errors import shown
from shefex_nav.fields import integer, matrix, member, number, vector
from shefex_nav.onboard import own_software
from shefex_nav.onboard.own_software import MOST_WHOLE, OwnSoftware, covariance_fault, sealed
from shefex_nav.onboard.startracker.tracker import NO_ATTITUDE, NO_COVARIANCE, TrackerState
from shefex_nav.records import CameraCommand, Detections, Reason, StarFix

MOST_DB = 60.0  # gain of the camera


class Solved(NamedTuple):
    """What came out of one frame, with an attitude or without."""

    q_ic: vector("", "attitude, camera to inertial axes, at the middle of the exposure", 4) = None
    P_c: matrix("rad^2", "covariance of its error, a rotation vector in camera axes") = None
    reason: member(Reason, "why there is no attitude") = int(Reason.NO_MATCH)
    exposure_s: number("s", "of the next picture") = None  # None: as before
    gain_db: number("dB", "of the next picture") = None  # likewise
    xy_px: number("px", "objects found, x, y of each", (-1, 2)) = np.empty((0, 2))
    flux_dn: number("DN", "their light above the background", (-1,)) = np.empty(0)
    hip: integer("their Hipparcos numbers, 0 where unidentified", (-1,)) = None
    number: integer("of the picture; a computer says it") = None


class StarTracker(Protocol):
    """Star tracker software, as a user writes it."""

    def start(self, mission):
        """Before the first frame. software.MissionData"""

    def step(self, frame, context):
        """One frame. records.Frame, tracker.Context (what the navigation knows of it) -> Solved"""


class OwnTracker:
    """Star tracker software of somebody's own. Its `step` stands for `tracker.step`.

    software : StarTracker, not started;  name : of it, for messages;  mission : software.MissionData
    """

    def __init__(self, software, name, mission):
        self._own = OwnSoftware(software, f"star tracker software {name}")
        self._answers = Answers(self._own, mission.sheets["star_tracker"])
        self._own.ask(mission.start_s, "start", sealed(mission))

    def step(self, tracker, state, frame, context):
        """As of `tracker.step`."""
        solved = self._own.ask(frame.t_available_s, "step", sealed(frame), sealed(context))
        if not isinstance(solved, Solved):
            raise self._own.error(frame.t_available_s, f"must give a Solved, got {shown(solved)}")
        available_s = frame.t_available_s + tracker.params.settings.latency
        fix = self._answers.fix(solved, frame, frame.t_available_s, available_s)
        self._check_convention(fix, context)
        command = self._answers.command(solved, state.exposure_s, frame.t_available_s, available_s)
        return TrackerState(command.exposure_s), fix, command

    def _check_convention(self, fix, context):
        """SoftwareError for an attitude that is what the navigation predicts in another convention."""
        is_known = context.P_c is not None and np.sqrt(np.trace(context.P_c)) < own_software.KNOWN
        if fix.reason == Reason.NONE and is_known:
            if words := own_software.of_attitude(fix.q_ic, context.q_ic):
                raise self._own.error(
                    fix.t_available_s, f"q_ic is the attitude that the navigation predicts {words}"
                )

    def close(self):
        """There are no more frames."""
        if self._own.has("close"):
            self._own.ask(np.nan, "close")


class Answers:
    """What a `Solved` means; its values are looked at.

    own : OwnSoftware, which gave it;  settings : of star_tracker
    """

    def __init__(self, own, settings):
        self._own, self._settings = own, settings
        self._gain_db = settings.exposure.gain  # that was asked for last

    def command(self, solved, exposure_s, now_s, valid_s):
        """CameraCommand. exposure_s : that was asked for before; valid_s : from when on"""
        asked = {"exposure_s": exposure_s, "gain_db": self._gain_db}
        for name in asked:
            if (value := getattr(solved, name)) is not None:
                asked[name] = float(self._own.numbers(now_s, f"{name} of its Solved", value))
        return self.checked(CameraCommand(valid_s, **asked), now_s)

    def checked(self, command, now_s):
        """A CameraCommand that the camera can follow."""
        period_s = 1.0 / self._settings.rate
        if not 0.0 < command.exposure_s < period_s:
            words = f"asked for an exposure of {command.exposure_s:g} s; frames come every {period_s:g} s"
            raise self._own.error(now_s, words)
        if not 0.0 <= command.gain_db <= MOST_DB:
            raise self._own.error(now_s, f"asked for a gain of {command.gain_db} dB; 0 to 60 dB")
        self._gain_db = command.gain_db
        return command

    def fix(self, solved, frame, now_s, available_s):
        """StarFix of a frame. available_s : when the navigation may have it"""
        n, reason = ceil(self._own.real(now_s, "xy_px", solved.xy_px).size / 2), Reason.NONE
        xy_px = self._own.numbers(now_s, "xy_px", solved.xy_px, n, 2) if n else np.empty((0, 2))
        flux_dn = np.full(n, np.nan)
        if self._own.real(now_s, "flux_dn", solved.flux_dn).size:
            flux_dn = self._own.numbers(now_s, "flux_dn", solved.flux_dn, n)
        hip = np.zeros(n) if solved.hip is None else self._own.numbers(now_s, "hip", solved.hip, n)
        if (np.abs(hip) > MOST_WHOLE).any():
            raise self._own.error(now_s, f"hip must be {MOST_WHOLE} at most, got {shown(solved.hip)}")
        q_ic, P_c = NO_ATTITUDE, NO_COVARIANCE
        if solved.q_ic is None:
            if solved.reason not in list(Reason)[1:]:
                raise self._own.error(
                    now_s, f"gave no attitude and no reason of records.Reason: {shown(solved.reason)}"
                )
            reason = solved.reason
        else:
            q_ic = self._own.quaternion(now_s, "q_ic", solved.q_ic)
            P_c = self._own.numbers(now_s, "P_c", solved.P_c, 3, 3)
            if covariance_fault(P_c):
                raise self._own.error(now_s, "P_c must be positive definite: how wrong may the attitude be?")
        return StarFix(
            number=frame.number,
            t_valid_s=frame.t_valid_s,
            t_available_s=available_s,
            reason=int(reason),
            q_ic=q_ic,
            P_c=P_c,
            detections=Detections(
                xy_px,
                flux_dn,
                np.zeros(n, dtype=np.int64),
                np.zeros(n, dtype=np.int64),
                np.full((n, 2, 2), np.nan),
            ),
            hip=hip.astype(np.int64),
            residual_px=np.nan,
            background_dn=float(frame.image_dn.mean()),
            exposure_s=frame.exposure_s,
            flag_saturated=False,
            flag_no_stars=n == 0,
        )
