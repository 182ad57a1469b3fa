"""What a log says, looked at before anything is computed of it: `LogError` names topic, message and field.

A log of ours holds finite numbers where it says that there are some, unit quaternions, and times that
increase; elsewhere NaN for what is not known, but nothing infinite. One that somebody has changed may hold
anything; then no figure of it means what it says. What the instrument of a plug-in reads, but for its times,
is its author's own.
"""

from collections.abc import Callable
from datetime import datetime
from functools import cache
from math import prod
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from shefex_nav import possible
from shefex_nav.fields import EQUAL, LARGEST, UNIT
from shefex_nav.files import from_json
from shefex_nav.instruments import BUILT_IN, TABLE
from shefex_nav.log import topics
from shefex_nav.log.topics import LogError, Mission, Timing, of_record
from shefex_nav.records import (
    Alignment,
    CameraCommand,
    ControlSample,
    Event,
    Frame,
    FrameTruth,
    GateResult,
    GpsFix,
    GpsRanges,
    ImuBlock,
    NavCovariance,
    NavHealth,
    NavSolution,
    Reason,
    StarFix,
    TruthSample,
)

TEXTS = "scenario", "seed", "version", "epoch_utc"  # keys that each log has
MOST_DIGITS = 30  # of a seed
FIRST_YEAR, LAST_YEAR = 1973, 2100  # of UTC, as the tables of the Earth's rotation know it
ITEMS = {"plugins": (str, str), "software": (str, str, str)}  # an item of these lists: names, SHA-256
LENSES = 0, 5  # numbers of a distortion
LEAST_RADIUS = 6.3e6  # m, of the ground
LEAST_STEP = 1e-9  # s, or of a number
LATEST_S = 2e9  # of a mission; as nanoseconds since 1970 a log can hold it
MOST_SAMPLES = 1000  # of the IMU in a message


def mission(path, numbers, raw):
    """Mission of the constants in a log and its texts; LogError names the key and what it says.

    path : of the log, for messages;  numbers : Mission without texts;  raw : content of the log
    """
    metadata = raw.metadata
    if topics.ATTACHMENT not in raw.attachments:
        raise LogError(f"{path}: the log has no attachment {topics.ATTACHMENT}, the scenario as flown")
    for key in TEXTS:
        if key not in metadata:
            raise LogError(f"{path}: metadata '{topics.METADATA}': {key} is missing")
    seed = metadata["seed"]
    if not (seed.isascii() and seed.isdigit() and len(seed) <= MOST_DIGITS):
        raise _unexpected(path, metadata, "seed", f"a whole number of {MOST_DIGITS} digits at most")
    if not _is_instant(metadata["epoch_utc"]):
        expected = f"an instant of {FIRST_YEAR} to {LAST_YEAR} as ISO 8601 has it"
        raise _unexpected(path, metadata, "epoch_utc", expected)
    return numbers._replace(
        scenario=metadata["scenario"],
        scenario_text=raw.attachments[topics.ATTACHMENT].decode(errors="replace"),
        seed=int(seed),
        version=metadata["version"],
        epoch_utc=metadata["epoch_utc"],
        distortion=_distortion(path, metadata),
        **{key: own(path, metadata, key) for key in ITEMS},
    )


def own(path, metadata, key):
    """Mission.plugins or Mission.software of the metadata."""
    found = _json(metadata, key)
    kinds = ITEMS[key]
    if not isinstance(found, list) or any(_kinds(item) != kinds for item in found):
        raise _unexpected(path, metadata, key, f"a list of lists of {len(kinds)} texts")
    return tuple(map(tuple, found))


def _distortion(path, metadata):
    """Mission.distortion of the metadata."""
    found = _json(metadata, "distortion")
    are_numbers = isinstance(found, list) and all(type(one) in (int, float) for one in found)
    if not are_numbers or len(found) not in LENSES or not all(abs(one) < LARGEST for one in found):
        raise _unexpected(path, metadata, "distortion", f"a list of {LENSES[1]} numbers")
    return tuple(found)


def _json(metadata, key):
    """What a text of the metadata holds, [] where there is none; None of what is no JSON."""
    try:
        return from_json(metadata.get(key, "[]"))
    except ValueError:
        return None


def _kinds(item):
    return tuple(map(type, item)) if isinstance(item, list) else ()


def _is_instant(text):
    try:
        return FIRST_YEAR <= datetime.fromisoformat(text).year <= LAST_YEAR
    except ValueError:
        return False


def _unexpected(path, metadata, key, expected):
    """LogError of an impossible text."""
    got = repr(metadata[key])
    got = got if len(got) <= 60 else f"{got[:57]}..."
    return LogError(f"{path}: metadata '{topics.METADATA}': {key}: got {got}, expected {expected}")


class Rule(NamedTuple):
    """What holds for the records of a type."""

    finite: tuple[str, ...]  # fields
    unless_nan: tuple[str, ...] = ()  # likewise, or NaN: not known, as of truth that others have measured
    increases: str = ""  # field that does from record to record
    where: Callable = lambda record: True  # record of arrays, or one -> where there are such numbers
    far: str = ""  # position that is not near the Earth's centre, if it is known
    rows: str = ""  # array with a row for each sample


MOTION = ("r_i", "v_i", "q_ib")
EARTH = ("earth.rate", "earth.angle_0", "earth.C_iq", "earth.C_re")
PLACE = ("start_s", "launch_latitude", "launch_longitude", "launch_height")
CAMERA = ("camera.focal_length_px", "camera.cx_px", "camera.cy_px", "C_bc")
RULES = {
    Mission: Rule((*EARTH, *PLACE, *CAMERA)),
    TruthSample: Rule(("t_s", *MOTION), ("omega_ib_b", "f_b"), "t_s", far="r_i"),
    NavSolution: Rule(("t_s", *MOTION, "r_e", "v_e"), increases="t_s"),
    NavCovariance: Rule(("t_s",), increases="t_s"),
    ImuBlock: Rule(
        ("t_valid_s", "dt_s", "dtheta_b", "dv_b"),
        increases="t_valid_s",
        where=lambda one: one.valid,
        rows="dtheta_b",
    ),
    Frame: Rule(("t_start_s", "t_valid_s", "t_available_s", "exposure_s", "gain_db"), increases="number"),
    CameraCommand: Rule(("t_s", "exposure_s", "gain_db")),
    ControlSample: Rule(("t_s", "torque_b", "propellant_kg"), increases="t_s"),
    Event: Rule(("t_s", "altitude_m")),
    GateResult: Rule(("t_s", "t_valid_s")),
    NavHealth: Rule(("t_s",)),
    Timing: Rule(("t_s",)),
    Alignment: Rule((*MOTION, "sigma_r", "sigma_v", "P_theta_b", "omega_i"), far="r_i"),
    FrameTruth: Rule(("t_valid_s", "q_ic"), increases="t_valid_s"),
    GpsFix: Rule(("t_valid_s", "r_ea_e", "R_r_e"), where=lambda one: one.valid),
    GpsRanges: Rule(("t_valid_s", "pseudorange", "range_rate", "r_es_e", "v_es_e", "sigma_range")),
    StarFix: Rule(("t_valid_s", "q_ic", "P_c"), where=lambda one: one.reason == Reason.NONE),
}
READING = Rule(("t_valid_s", "t_available_s"))  # of an instrument


def check(path, topic, record, given):
    """LogError if a record of a topic is impossible.

    path, topic : for the message;  record : their type;  given : list of them, or one of arrays
    """
    place = f"{path}: {topic}"
    rule, are_arrays = RULES.get(record, READING), not isinstance(given, list)
    where = rule.where(given) if are_arrays else np.array([rule.where(one) for one in given], dtype=bool)
    for name in rule.finite if _is_of_plug_in(record) else _numbers(record):
        values = _of_arrays(attrgetter(name)(given)) if are_arrays else _of_list(given, name)
        if name in rule.finite:
            most = LATEST_S if name.startswith("t_") else LARGEST
            bad, expected = _bad(name, values, most) & where, f"numbers below {most:g}"
        elif name in rule.unless_nan:
            bad = _bad(name, values) & where & ~np.isnan(values).all(axis=1)
            expected = f"numbers below {LARGEST:g}"
        else:
            unknown = name.startswith(("sigma", "protection"))  # which own software may say by infinity
            bad = ((np.abs(values) > possible.LARGEST_OTHER) & ~(unknown & np.isposinf(values))).any(axis=1)
            expected = f"numbers below {possible.LARGEST_OTHER:g}, or NaN"
        if bad.any():
            k = int(bad.argmax())
            expected = "a unit quaternion" if name.startswith("q_") else expected
            raise _impossible(f"{place}: message {k + 1}: {name}", values[k], expected)
    for field in of_record(record).fields if record in RULES else ():
        _possible(place, field, given)
    if rule.far:
        _far(place, rule.far, np.reshape(_each(given, rule.far), (-1, 3)))
    if rule.rows:
        _rows(place, rule.rows, _each(given, rule.rows))
    if rule.increases:
        _increases(place, rule.increases, np.asarray(_each(given, rule.increases)))


def _each(given, name):
    """A field of each record. given : as of `check`"""
    return [getattr(one, name) for one in given] if isinstance(given, list) else getattr(given, name)


def _possible(place, field, given):
    """LogError if a value of a field is none that it can be (`possible`). given : as of `check`"""
    if (isinstance(given, list) and not given) or (rule := possible.rule(field)) is None:
        return
    of, (wrong, words) = attrgetter(field.source), rule
    if not isinstance(given, list):
        values = _of_arrays(of(given))
        numbers = np.arange(len(values))
    elif not field.shape:
        values = np.array(list(map(of, given)))[:, None]
        numbers = np.arange(len(values))
    else:
        size = prod(one for one in field.shape if one not in (-1, EQUAL))
        parts = [np.reshape(of(one), (-1, size)) for one in given]
        numbers = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        values = np.concatenate(parts)
    bad = wrong(values) if len(values) else np.zeros(0, dtype=bool)
    if bad.any():
        k = int(bad.argmax())
        raise _impossible(f"{place}: message {numbers[k] + 1}: {field.source}", values[k], words)


def _impossible(where, value, expected):
    """LogError of a value (n,)"""
    got = np.array2string(value, precision=4, threshold=12)
    return LogError(f"{where}: got {got}, expected {expected}")


def _far(place, name, r):
    """LogError of a position that is nearer to the centre of the Earth than any ground. r : (N, 3) m"""
    near = np.linalg.norm(r, axis=1) < LEAST_RADIUS
    if near.any():
        k = int(near.argmax())
        words = f"got {np.linalg.norm(r[k]):.4g} m from the centre of the Earth"
        words = f"{words}, expected {LEAST_RADIUS:g} m at least"
        raise LogError(f"{place}: message {k + 1}: {name}: {words}")


def _rows(place, name, arrays):
    """LogError of a message without samples, or with more than a tick has. arrays : list of (n, 3)"""
    for k, one in enumerate(arrays):
        if not 1 <= len(one) <= MOST_SAMPLES:
            words = f"got {len(one)} samples, expected 1 to {MOST_SAMPLES}"
            raise LogError(f"{place}: message {k + 1}: {name}: {words}")


@cache
def _numbers(record):
    """Attributes of a record that hold numbers which need not be whole, dotted where nested: tuple."""
    return tuple(field.source for field in of_record(record).fields if field.kind == "double")


def _is_of_plug_in(record):
    """Whether a record is what the instrument of a plug-in reads."""
    return any(one.record is record for name, one in TABLE.items() if name not in BUILT_IN)


def _of_arrays(values):
    """Values of a field of N records: (N, n)"""
    return values.reshape(len(values), values.size // max(len(values), 1))


def _of_list(given, name):
    """The same of a list of records; of lists that are not of one length the largest size alone, (N, 1)."""
    rows = list(map(attrgetter(name), given))
    if rows and not np.ndim(rows[0]):
        return np.array(rows, dtype=float)[:, None]
    rows = [np.ravel(row) for row in rows]
    if len({len(row) for row in rows}) > 1:
        rows = [[np.abs(row).max(initial=0.0)] for row in rows]
    return np.array(rows, dtype=float).reshape(len(rows), -1 if rows else 0)


def _bad(name, values, most=LARGEST):
    """Impossible rows: (N, n) -> (N,) bool"""
    bad = ~(np.abs(values) < most).all(axis=1)
    if name.startswith("q_"):
        bad |= ~(np.abs(np.linalg.norm(np.where(bad[:, None], 0.0, values), axis=1) - 1.0) < UNIT)
    return bad


def _increases(place, name, values):
    """LogError unless the values increase."""
    back = ~(np.diff(values) > LEAST_STEP)
    if back.any():
        k = int(back.argmax()) + 1
        words = f"got {values[k]:.10g} after {values[k - 1]:.10g}, expected a larger number"
        raise LogError(f"{place}: message {k + 1}: {name}: {words}")
    if name != "number" and len(values) and values[-1] - values[0] > possible.LONGEST_S:
        words = f"{values[0]:.10g} to {values[-1]:.10g} s, expected {possible.LONGEST_S:g} s at most"
        raise LogError(f"{place}: {name}: goes from {words}")
