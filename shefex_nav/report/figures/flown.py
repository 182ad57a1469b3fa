"""The path of a log, truth where there is one of all of it and the estimate otherwise, and what draws it."""

from typing import NamedTuple

import numpy as np

from shefex_nav import event_words
from shefex_nav.clock import SAME_S
from shefex_nav.report.figures import style
from shefex_nav.report.pairing import at_rows, is_partly_true
from shefex_nav.report.track import Track, earth_fixed, ground_distance

PATH_POINTS = 1500  # of a drawn path


class Path(NamedTuple):
    """A path over m instants."""

    name: str  # 'truth' or 'estimate'
    t_s: np.ndarray  # (m,)
    track: Track


def path(data, most=PATH_POINTS):
    """Path of a RunData at about so many instants, first and last among them; None without any."""
    known = (("truth", data.truth), ("estimate", data.nav))
    for name, states in known[::-1] if is_partly_true(data) else known:
        if len(states.t_s):
            return of_states(name, data, states, most)
    return None


def estimate(data, most=PATH_POINTS):
    """The estimated path; None without a solution."""
    return of_states("estimate", data, data.nav, most) if len(data.nav.t_s) else None


def of_states(name, data, states, most):
    """Path of records of arrays with t_s, r_i and v_i."""
    rows = np.unique(np.linspace(0, len(states.t_s) - 1, min(most, len(states.t_s))).astype(int))
    chosen = at_rows(states, rows)
    return Path(name, chosen.t_s, earth_fixed(data.mission.earth, chosen))


def by_phase(path, truth):
    """(phase, rows of a Path) of each stretch of one phase, as far as the next. TruthSample of arrays"""
    last = len(truth.t_s) - 1
    for phase, piece in style.phase_pieces(truth):
        start_s, end_s = truth.t_s[piece.start] - SAME_S, truth.t_s[min(piece.stop, last)] + SAME_S
        rows = np.flatnonzero((path.t_s >= start_s) & (path.t_s <= end_s))
        if len(rows):
            yield phase, np.arange(rows[0], min(rows[-1] + 2, len(path.t_s)))


def along_ground(track, still=None):
    """Distance along the ground track since its first point: (m,) m on the ellipsoid.

    still : m/s, a step between two places at which it is no faster is none: noise of an estimate on the pad
    would add up to kilometres; None: all count
    """
    steps, moves = [0.0], np.ones(len(track.latitude), dtype=bool)
    if still is not None:
        moves = np.linalg.norm(track.v_e, axis=1) > still
    latitude, longitude = track.latitude.tolist(), track.longitude.tolist()
    for k in range(1, len(latitude)):
        length = ground_distance(latitude[k - 1], longitude[k - 1], latitude[k], longitude[k])
        steps.append(length if moves[k - 1] or moves[k] else 0.0)
    return np.cumsum(steps)


def event_names(events):
    """Events of one instant together: list of (t_s, altitude_m, 'name, name')."""
    out = []
    for event in events:
        name = event_words.in_words(event.name)
        if out and abs(out[-1][0] - event.t_s) < 0.05:
            out[-1] = (*out[-1][:2], f"{out[-1][2]}, {name}")
        else:
            out.append((event.t_s, event.altitude_m, name))
    return out
