"""A frame of a log, solved again as a picture: by itself, with the camera that the log's scenario describes.

The picture must be one that the log keeps as it was read out (`log.frames.full_every`). What the flight knew
besides of that instant is the time and the velocity of its solution, for the aberration.
"""

from datetime import datetime, timedelta
from typing import NamedTuple

import numpy as np

from shefex_nav import runs
from shefex_nav.frames import camera_file
from shefex_nav.geometry.rotation import quat_conjugate, rotvec_between
from shefex_nav.log.topics import ATTACHMENT, LogError
from shefex_nav.records import Reason
from shefex_nav.runs.frames import MOST_AWAY_S
from shefex_nav.scenario import load
from shefex_nav.solve import told
from shefex_nav.solve.header import Taken, julian_year
from shefex_nav.solve.solution import ImageSolution


class Again(NamedTuple):
    """A frame that was solved again; angles are None where one of the two has no attitude."""

    number: int
    t_s: float  # middle of the exposure
    image_dn: np.ndarray  # (rows, columns)
    solution: ImageSolution
    from_flight: float | None  # rad, to the attitude that the star tracker gave in flight
    from_truth: float | None  # rad


def solve(log, t_s, record=None):
    """Again, of the frame nearest to a mission time that a log keeps as it was read out.

    record : solve.image.Record, of `told.solve`

    Raises LogError, ScenarioError, PictureError.
    """
    run = runs.open_run(log)
    mission = run.data.mission
    if not len(run.data.frames.number):
        raise LogError(f"{log}: has no frame of a star camera")
    scenario = load.load_text(mission.scenario_text, f"{log}: {ATTACHMENT}")
    frame = run.frames[_nearest_full(log, run.data.frames, scenario.log.frames.full_every, t_s)]
    moment = datetime.fromisoformat(mission.epoch_utc) + timedelta(seconds=frame.t_s)
    taken = Taken(julian_year(moment), frame.exposure_s, _velocity(run.data.nav, frame.t_s))
    solution = told.solve(frame.image_dn, camera_file.of_scenario(scenario), taken, record)
    flight = None if frame.fix is None or frame.fix.reason != Reason.NONE else frame.fix.q_ic
    truth = None if frame.truth is None else frame.truth.q_ic
    return Again(
        frame.number, frame.t_s, frame.image_dn, solution, _apart(solution, flight), _apart(solution, truth)
    )


def _nearest_full(log, frames, every, t_s):
    """Time of the frame nearest to t_s of those that are kept whole."""
    kept = frames.t_valid_s[frames.number % every == 0] if every else np.zeros(0)
    if not len(kept):
        words = "keeps no frame whole; fly with --set log.frames.full_every=1"
        raise LogError(f"{log}: {words}")
    if not kept[0] - MOST_AWAY_S <= t_s <= kept[-1] + MOST_AWAY_S:
        words = f"its whole frames are of T{kept[0]:+.2f} s to T{kept[-1]:+.2f} s, none is near T{t_s:+.2f} s"
        raise LogError(f"{log}: {words}")
    return float(kept[np.argmin(np.abs(kept - t_s))])


def _velocity(nav, t_s):
    """Inertial velocity (3,) m/s of the solution nearest to t_s; None without one."""
    if not len(nav.t_s):
        return None
    return nav.v_i[np.argmin(np.abs(nav.t_s - t_s))]


def _apart(solution, q_ic):
    """Angle [rad] between a solution and an attitude; None without one of them."""
    if solution.status != "ok" or q_ic is None:
        return None
    return float(np.linalg.norm(rotvec_between(quat_conjugate(solution.q_ci), q_ic)))
