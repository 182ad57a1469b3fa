"""What a value of a run can be, by its column: records and tables may be anybody's.

The rule is what a campaign writes: SUMMARY is the tree of `report.metrics`. Of what is not in it nothing is
said but that numbers are finite. Of a value by itself `fault` tells, of a whole column `is_faulty`.
"""

from functools import lru_cache
from typing import NamedTuple

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.errors import UserError
from shefex_nav.files import from_json

LARGEST = 1e100  # squares and sums of a million squares stay finite
LONGEST = 1e16  # [E] of a distance, speed or angle in any unit: what flies is within 1e15 (`possible`)
LEAST_WHOLE, MOST_WHOLE = -(2**63), 2**64 - 1  # that a table holds
NUMBERS = frozenset((int, float))
LARGE = "large"  # kind of whole numbers that no int64 holds
ROUNDING = 1e-9  # of a share


class TableError(UserError):
    """A table whose rows a disk has spoilt."""


class WrongValueError(TableError):
    """A run with a value that no campaign writes; `run`, and `words` that say which."""

    def __init__(self, message, run=None, words=""):
        super().__init__(message)
        self.run, self.words = run, words


def wrong_value(run, column, value, expected):
    """WrongValueError of a value in a column."""
    told = repr(value) if type(value) is not int or abs(value) < LARGEST else "a huge number"
    words = f"{column}: got {told[:80]}, expected {expected}"
    return WrongValueError(f"run {run}: {words}", run, words)


class Rule(NamedTuple):
    """Types and bounds of the values of a column, and what is expected in words."""

    kinds: frozenset
    low: float
    high: float
    words: str


ANYTHING = Rule(frozenset((bool, str, int, float)), -LARGEST, LARGEST, f"a number below {LARGEST:g}")
NUMBER = Rule(NUMBERS, -LARGEST, LARGEST, f"a number below {LARGEST:g}")
POSITIVE = Rule(NUMBERS, 0.0, LARGEST, f"a number from 0 to {LARGEST:g}")
SIZE = Rule(NUMBERS, 0.0, LONGEST, f"a number from 0 to {LONGEST:g}")
COUNT = Rule(frozenset((int,)), 0, LARGEST, "a whole number, 0 or more")
POSITIVE_COUNT = COUNT._replace(low=1, words="a whole number, 1 or more")
SHARE = Rule(NUMBERS, 0.0, 1.0 + ROUNDING, "a share from 0 to 1")
TRUTH = Rule(frozenset((bool,)), 0, 1, "true or false")
NOTHING = Rule(frozenset(), 0, 0, "a number in place of a list or an object")
A_LIST = NOTHING._replace(words="a list")
OBJECTS = Rule(frozenset((str,)), 0, 0, "a list of objects with field and text")  # JSON in a table
AN_OBJECT = NOTHING._replace(words="a list or an object in place of a value")
RUN = Rule(frozenset((int,)), 0, MOST_RUNS - 1, f"the number of a run, 0 to {MOST_RUNS - 1}")

ANY = "*"  # every name: of an instrument, of a reason; or the numbers of a list
SIZES = {"rms": SIZE, "max": SIZE}
POINTING = SIZES | {"max_at_s": NUMBER}
PLACE = dict.fromkeys(("t_s", "latitude_deg", "longitude_deg", "altitude_km"), NUMBER)
FLIGHT = {
    "height_km": {"min": NUMBER, "max": NUMBER},
    **dict.fromkeys(("apogee_km", "climbs_at_km"), NUMBER),
    **dict.fromkeys(("max_speed_m_s", "range_km"), SIZE),
    **dict.fromkeys(("at_apogee", "at_entry", "at_impact"), PLACE),
    "events": A_LIST,
}
STAR_TRACKER = {
    **dict.fromkeys(("frames", "in_window", "solved", "fixes", "wrong"), COUNT),
    "outside": {ANY: COUNT},
    **{key: {ANY: COUNT} for key in ("no_fix", "no_fix_outside")},
    "full_table_share": SHARE,
    "objects_without_fix": POSITIVE,
    "saturated_dn": {ANY: NUMBER},
    "error_arcsec": {
        **dict.fromkeys(("cross_axis_rms", "boresight_rms", "max", "normalised_rms"), POSITIVE),
        "mean": {ANY: NUMBER},
    },
    "mounting_error_deg": {ANY: NUMBER},
    "by_rate": A_LIST,
}
INTEGRITY = {
    **{
        quantity: {
            f"limit_{unit}": POSITIVE,
            "limit_by_default": TRUTH,
            **dict.fromkeys(("usable_share", "misleading_share"), SHARE),
            "usable_h": POSITIVE,
            "doubts": {ANY: SHARE},
            "misleading_events": COUNT,
            "over_level": POSITIVE,
            "at_entry": {"usable": TRUTH, f"protection_{unit}": {ANY: POSITIVE}},
        }
        for quantity, unit in (("position", "m"), ("velocity", "m_s"), ("attitude", "deg"))
    },
    **dict.fromkeys(("usable_share", "misleading_share"), SHARE),
    "at_entry": {"usable": TRUTH},
    "noticed": A_LIST,
}
NAVIGATION = {
    "solution_share": SHARE,
    **dict.fromkeys(("position_error_m", "velocity_error_m_s", "attitude_error_deg"), SIZES),
    "star_phase": {
        **dict.fromkeys(("from_s", "to_s"), NUMBER),
        **dict.fromkeys(("position_rms_m", "velocity_rms_m_s", "attitude_rms_deg"), SIZE),
    },
    "star_aided": {
        "from_s": NUMBER,
        **dict.fromkeys(("position_m", "velocity_m_s", "attitude_deg"), SIZES),
    },
    "while_pointing": {
        "solution_share": SHARE,
        **dict.fromkeys(("from_s", "to_s"), NUMBER),
        **dict.fromkeys(("position_m", "velocity_m_s", "attitude_deg"), POINTING),
    },
    "at_entry": {
        **dict.fromkeys(("t_s", "altitude_km"), NUMBER),
        **dict.fromkeys(("position_error_m", "velocity_error_m_s"), SIZE),
        **dict.fromkeys(("position_sigma_m", "velocity_sigma_m_s", "nees"), POSITIVE),
        "attitude_error_deg": {ANY: NUMBER},
        "attitude_sigma_deg": {ANY: POSITIVE},
    },
    "nees": {"mean": POSITIVE, "dof": POSITIVE_COUNT, "samples": COUNT, "times_sigma": {ANY: POSITIVE}},
    **dict.fromkeys(("beyond_sigma", "errors_fit", "unknown"), A_LIST),
    "measurements": {ANY: dict.fromkeys(("delivered", "used", "refused"), COUNT)},
    "nis": {
        ANY: {
            **dict.fromkeys(("mean", "per_dof"), POSITIVE),
            **dict.fromkeys(("dof", "samples"), POSITIVE_COUNT),
            "rejected": COUNT,
            "interval": {ANY: POSITIVE},
            "level_percent": POSITIVE,
            "errors_last": TRUTH,
        }
    },
    "instruments": {ANY: {"readings": COUNT, "used": COUNT}},
    "integrity": INTEGRITY,
}
SUMMARY = {
    "ended_early": TRUTH,
    **dict.fromkeys(("until_s", "simulated_s", "simulated_from_s"), NUMBER),
    "flight": FLIGHT,
    "attitude_control": {"propellant_kg": POSITIVE, "pointing_error_deg": SIZES},
    "star_tracker": STAR_TRACKER,
    "navigation": NAVIGATION,
    **dict.fromkeys(("requirements", "told_otherwise"), A_LIST),
    "warnings": OBJECTS,
}
AT_MOST = tuple(
    (f"summary.star_tracker.{few}", f"summary.star_tracker.{many}")
    for few, many in (("solved", "in_window"), ("wrong", "fixes"), ("fixes", "frames"))
)  # not in_window and frames: a tick without a frame is in the window, too


@lru_cache(maxsize=4096)
def rule(name):
    """Rule of a column."""
    if name == "run":
        return RUN
    if not name.startswith(("summary.", "timing.")):
        return ANYTHING
    first, *parts = name.split(".")
    if first == "timing":
        return NUMBER
    node = SUMMARY
    for part in parts:
        if isinstance(node, Rule):
            return NOTHING
        node = node.get(part, node.get(ANY))
        if node is None:
            return ANYTHING
    return node if isinstance(node, Rule) else AN_OBJECT


def fault(name, value):
    """What is expected of a column, in words, if a value of it cannot be; '' if it can or is None."""
    expected = rule(name)
    if value is None:
        return ""
    kind = type(value)
    if kind not in expected.kinds:
        return expected.words
    can_be = kind not in NUMBERS or expected.low <= value <= expected.high  # NaN cannot
    if kind is int and not LEAST_WHOLE <= value <= MOST_WHOLE:
        return f"a whole number from {LEAST_WHOLE} to {MOST_WHOLE}"
    if expected is OBJECTS and not _are_objects(value):
        return expected.words
    return "" if can_be else expected.words


@lru_cache(maxsize=256)  # most runs have the same
def _are_objects(text):
    """Whether a JSON text is a list of objects with the texts `field` and `text`."""
    try:
        found = from_json(text)
        return isinstance(found, list) and all(
            isinstance(one[key], str) for one in found for key in ("field", "text")
        )
    except (ValueError, TypeError, KeyError):
        return False


def is_faulty(name, values):
    """Whether a column, an Arrow array, holds a value that cannot be."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind, expected = values.type, rule(name)
    if values.null_count == len(values):
        return False
    if expected is OBJECTS and pa.types.is_string(kind):
        return not all(_are_objects(one) for one in values.unique().to_pylist() if one is not None)
    if pa.types.is_string(kind) or pa.types.is_boolean(kind):
        return (str if pa.types.is_string(kind) else bool) not in expected.kinds
    is_float = pa.types.is_floating(kind)
    if not expected.kinds & NUMBERS or (is_float and float not in expected.kinds and not values.null_count):
        return True
    least, most = (one.as_py() for one in pc.min_max(values).values())
    if is_float and pc.any(pc.is_nan(values)).as_py():
        return True
    return not (expected.low <= least and most <= expected.high)


def row_fault(row, drawn=()):
    """(column, value, what is expected) of the first value of a row that cannot be; None of a good one.

    drawn : paths whose draws are numbers
    """
    for name, value in row.items():
        if words := fault(name, value):
            return name, value, words
    for few, many in AT_MOST:
        if None not in (row.get(few), row.get(many)) and row[few] > row[many]:
            return few, row[few], f"at most {many}, {row[many]}"
    for path in drawn:
        value = row.get(f"draw.{path}")
        if type(value) not in NUMBERS:
            return f"draw.{path}", value, "a number"
    return None


def exceeds(columns):
    """Whether one of two counts exceeds what it is a part of. columns : {name: Arrow array}"""
    import pyarrow.compute as pc

    pairs = [(columns[few], columns[many]) for few, many in AT_MOST if few in columns and many in columns]
    return any(pc.any(pc.greater(few, many)).as_py() for few, many in pairs)


def check_kinds(rows, found, drawn):
    """WrongValueError if a column holds a kind of values that it cannot. found : of `kinds`"""
    suspects = {f"draw.{path}" for path in drawn if not found.get(f"draw.{path}", set()) <= NUMBERS}
    for name, kind in found.items():
        if not {int if one == LARGE else one for one in kind} <= rule(name).kinds or LARGE in kind:
            suspects.add(name)
    if suspects:
        _check(rows, drawn)


def _check(rows, drawn):
    """WrongValueError of the first row with a value that cannot be."""
    for one in rows:
        if wrong := row_fault(one, drawn):
            raise wrong_value(one.get("run"), *wrong)


def check_columns(columns, some, drawn):
    """WrongValueError if a column of a batch holds a value that cannot be. some : its rows"""
    gaps = any(f"draw.{path}" not in columns or columns[f"draw.{path}"].null_count for path in drawn)
    wrong = any(is_faulty(name, values) for name, values in columns.items())
    if gaps or wrong or exceeds(columns):
        _check(some, drawn)


def refuse(path, runs, name, values):
    """TableError of the first value of a column that cannot be; none if it is only as Parquet has it."""
    for run, value in zip(runs.to_pylist(), values.to_pylist(), strict=True):
        if words := fault(name, value):
            error = wrong_value(run, name, value, words)
            raise TableError(f"{path}: {error}; delete it, it is made of the records again")
