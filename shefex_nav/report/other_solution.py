"""What another filter says of a flight, as arrays or CSV, made the records of a solution."""

import csv
import io
from typing import NamedTuple

import numpy as np

from shefex_nav import numerals
from shefex_nav.clock import SAME_S, TICK_HZ
from shefex_nav.errors import UserError
from shefex_nav.fields import LARGEST, UNIT
from shefex_nav.geometry import frames, rotation
from shefex_nav.log.other_solutions import Other, check_name
from shefex_nav.log.run_data import stack
from shefex_nav.onboard import own_navigation
from shefex_nav.onboard.own_navigation import Estimate
from shefex_nav.onboard.own_software import covariance_fault
from shefex_nav.possible import LARGEST_OTHER
from shefex_nav.records import NavCovariance, NavSolution
from shefex_nav.report.pairing import same_times
from shefex_nav.scenario.files import LARGEST_DATA, Unreadable, read_text

FRAMES = "i", "e"
_SHAPES = {"r": (3,), "v": (3,), "q": (4,), "P": (9, 9)}


class Given(NamedTuple):
    """Arrays over N times; P is None where the filter gives none."""

    t_s: np.ndarray  # (N,)
    r: np.ndarray  # (N, 3) m
    v: np.ndarray  # (N, 3) m/s
    q: np.ndarray  # (N, 4) body axes to those of r
    P: np.ndarray | None  # (N, 9, 9) position [m], velocity [m/s], attitude in body axes [rad]


def other(data, given, frame, name):
    """log.other_solutions.Other of a Given about the flight of a RunData. frame : of r, v, q: 'i' or 'e'

    Raises ValueError.
    """
    check_name(name)
    if frame not in FRAMES:
        raise ValueError(f"frame {frame!r}: expected 'i', inertial axes, or 'e', Earth-fixed ones")
    given = _checked(given)
    paired = len(same_times(data.truth.t_s, given.t_s)[0])
    if len(data.truth.t_s) and 2 * paired < len(given.t_s):
        raise ValueError(_unpaired(data.truth.t_s, given.t_s, paired))
    if frame == "e":
        given = _inertial(data.mission.earth, given)
    earth = data.mission.earth
    solutions, covariances, unknown = [], [], np.full(3, np.nan)
    for k, t_s in enumerate(given.t_s.tolist()):
        P = None if given.P is None else given.P[k]
        estimate = Estimate(given.r[k], given.v[k], given.q[k], P)
        solutions.append(own_navigation.solution(estimate, t_s, unknown, earth))
        if P is not None:
            covariances.append(own_navigation.covariance(estimate, t_s))
    return Other(stack(NavSolution, solutions), stack(NavCovariance, covariances))


COLUMNS = (  # of a CSV, those of the table `nav`; P_1_1 to P_9_9 may follow
    "t_s", *(f"r_i_m_{k}" for k in "xyz"), *(f"v_i_m_s_{k}" for k in "xyz"), *(f"q_ib_{k}" for k in "wxyz"),
)  # fmt: skip
COVARIANCE = tuple(f"P_{i}_{j}" for i in range(1, 10) for j in range(1, 10))


class BadTable(UserError):
    """A table that cannot be read; the message names file, line and column."""


def read_csv(path):
    """Given of a CSV with the COLUMNS, and perhaps COVARIANCE, among others; BadTable."""
    try:
        with io.StringIO(read_text(path, "a table", LARGEST_DATA)) as file:
            lines = csv.DictReader(file)
            names = list(lines.fieldnames or [])
            while names and not names[-1].strip():  # separators at the end of the line
                names.pop()
            lines.fieldnames = names
            if missing := [name for name in COLUMNS if name not in names]:
                raise BadTable(f"{path}:1: has no column {missing[0]}; expected {', '.join(COLUMNS)}")
            wanted = COLUMNS + (COVARIANCE if COVARIANCE[0] in names else ())
            if missing := [name for name in wanted if name not in names]:
                raise BadTable(
                    f"{path}:1: has no column {missing[0]}; expected P_1_1 to P_9_9, or none of them"
                )
            if twice := [name for name in wanted if names.count(name) > 1]:
                raise BadTable(f"{path}:1: {twice[0]}: two columns have this name; keep one of them")
            rows = [_numbers(path, lines.line_num, line, wanted) for line in lines]
    except (Unreadable, csv.Error) as error:
        raise BadTable(f"{path}: {error}") from None
    if not rows:
        raise BadTable(f"{path}:2: has no row; expected one for each time")
    t_s, r, v, q, P = np.split(np.array(rows), [1, 4, 7, 11], axis=1)
    return Given(t_s[:, 0], r, v, q, P.reshape(-1, 9, 9) if P.shape[1] else None)


def _numbers(path, number, line, names):
    """Numbers of a line of a CSV; BadTable."""
    more, cells = line.pop(None, ()), list(line.values())  # as csv has what is too much
    if any(cell.strip() for cell in more) or None in cells:  # whose value is which is not known
        count = len(cells) + len(more) - cells.count(None)
        raise BadTable(f"{path}:{number}: {count} values, but {len(cells)} names of columns")
    found = []
    for name in names:
        try:
            found.append(numerals.number(line[name]))
        except ValueError as error:
            raise BadTable(f"{path}:{number}: {name}: {error}") from None
    return found


def _checked(given):
    """The same as arrays of numbers of the right shape; ValueError."""
    t_s = np.asarray(given.t_s, dtype=float)
    if t_s.ndim != 1 or not len(t_s) or not (np.diff(t_s) > SAME_S).all() or not np.isfinite(t_s).all():
        raise ValueError("t_s: expected increasing times, shape (N,)")
    found = {}
    for name, shape in _SHAPES.items():
        if (value := getattr(given, name)) is None and name == "P":
            continue
        array = np.asarray(value, dtype=float)
        if array.shape != (len(t_s), *shape):
            raise ValueError(
                f"{name}: shape {array.shape}; expected {(len(t_s), *shape)}, a row for each time"
            )
        most = LARGEST_OTHER if name == "P" else LARGEST
        if bad := np.flatnonzero(~(np.abs(array) < most).reshape(len(t_s), -1).all(axis=1)).tolist():
            what = f"NaN or a number beyond {most:g}"
            raise ValueError(f"{name}: {what} at T{t_s[bad[0]]:+.2f} s; leave such times out")
        found[name] = array
    norm = np.linalg.norm(found["q"], axis=1)
    if (off := np.abs(norm - 1.0)).max() > UNIT:
        k = int(np.argmax(off))
        raise ValueError(
            f"q: norm {norm[k]:.6g} at T{t_s[k]:+.2f} s; expected unit quaternions, scalar first"
        )
    found["q"] = found["q"] / norm[:, None]
    if "P" in found:
        _check_covariances(t_s, found["P"])
    return Given(t_s, **({"P": None} | found))


def _check_covariances(t_s, P):
    for time, one in zip(t_s.tolist(), P, strict=True):
        if fault := covariance_fault(one):
            words = f"P: no covariance at T{time:+.2f} s, it {fault}"
            raise ValueError(f"{words}; expected symmetric, positive definite")


def _unpaired(truth_s, t_s, paired):
    few = f"only {paired} of the {len(t_s)} times" if paired else "none of the times"
    span = f"T{truth_s[0]:+.2f} to T{truth_s[-1]:+.2f} s"
    return (
        f"t_s: {few}, T{t_s[0]:+.4f} to T{t_s[-1]:+.4f} s, is one of the log's: {span}, "
        f"{TICK_HZ} a second at most (run.truth.t_s)"
    )


def _inertial(earth, given):
    """A Given in Earth-fixed axes in inertial ones."""
    C = np.array([frames.dcm_ie(earth, t_s) for t_s in given.t_s.tolist()])
    pairs = zip(given.t_s.tolist(), given.r, given.v, strict=True)
    moved = [frames.inertial_from_ecef(earth, *one) for one in pairs]
    q = np.array(
        [
            rotation.quat_multiply(rotation.quat_from_dcm(C_ie), q_eb)
            for C_ie, q_eb in zip(C, given.q, strict=True)
        ]
    )
    P = None if given.P is None else _rotated(earth, given.P, C)
    return Given(given.t_s, np.array([r for r, _ in moved]), np.array([v for _, v in moved]), q, P)


def _rotated(earth, P, C):
    """Covariances (N, 9, 9) of errors in Earth-fixed axes, of those in inertial axes. C (N, 3, 3) C_ie"""
    T = np.zeros_like(P)
    T[:, :3, :3] = T[:, 3:6, 3:6] = C
    T[:, 3:6, :3] = rotation.skew(frames.omega_ie_i(earth)) @ C  # of a velocity relative to the turning Earth
    T[:, 6:, 6:] = np.eye(3)
    return T @ P @ np.swapaxes(T, 1, 2)
