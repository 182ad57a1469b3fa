"""CCSDS ephemeris and attitude messages, KVN: OEM (502.0-B) and AEM (504.0-B).

Positions are in km. EME2000 differs from the inertial axes of this program by the bias of the frames, 23 mas;
ICRF and GCRF do not. ITRF and TEME are turned by the orientation of the Earth that the scenario has: TEME by
the Greenwich mean sidereal time of 1982. A quaternion from A to B turns the axes of A into those of B.
"""

import warnings
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import frames
from shefex_nav.geometry.rotation import quat_from_dcm
from shefex_nav.numerals import number
from shefex_nav.scenario.data_table import DataError, Table
from shefex_nav.scenario.files import LARGEST_DATA, Unreadable, read_text
from shefex_nav.trajectory import placing
from shefex_nav.trajectory.rows import Attitudes, Rows, ascending, rounding, unit_quaternions

KM = 1e3
EME2000, GCRS, EARTH_FIXED, TEME = "EME2000", "GCRF", "ITRF", "TEME"
ALIASES = {"EME2000": EME2000, "J2000": EME2000, "ICRF": GCRS, "GCRF": GCRS, "GCRS": GCRS, "TEME": TEME}
SCALES = {"UTC": "utc", "TAI": "tai", "TT": "tt", "TDB": "tdb", "GPS": "tai"}
GPS_BEHIND_TAI_S = 19.0
BEGINS = {"META_START": "META_STOP", "COVARIANCE_START": "COVARIANCE_STOP"}
OF_ALL = {  # keys that all segments must have alike, and what a missing one stands for
    "CENTER_NAME": "", "REF_FRAME": "", "REF_FRAME_A": "", "REF_FRAME_B": "", "TIME_SYSTEM": "UTC",
    "ATTITUDE_TYPE": "", "ATTITUDE_DIR": "A2B", "QUATERNION_TYPE": "LAST",
}  # fmt: skip


class Epoch(NamedTuple):
    """The mission time zero."""

    utc: str  # ISO 8601
    ut1_minus_utc: float  # s


class _Segment(NamedTuple):
    """A segment of a message as it is written."""

    line: int  # of META_START
    meta: dict  # key: (line, value)
    rows: list  # (line, words)


class _Message(NamedTuple):
    """The rows of a message after one another, and what holds for all of them."""

    table: Table  # numbers of the rows
    epochs: list  # (N,) of str
    begins: np.ndarray  # (N,) bool: the first row of a segment
    meta: dict  # key: (line, value)


def oem(given, earth, epoch):
    """Rows of a scenario.trajectory.Oem; epoch : Epoch"""
    message = _read(given.file, "CCSDS_OEM_VERS", "X", (6, 9))
    file, meta = message.table.file, message.meta
    _same(file, meta, "CENTER_NAME", ("EARTH",))
    frame = _frame(file, *_needed(file, meta, "REF_FRAME"))
    table, t_s = _once(message, epoch)
    ascending(table, t_s)
    values = KM * table.stack(tuple(table.columns))
    here = placing.place(earth, t_s)
    r_i, v_i = _inertial(here, t_s, values[:, :3], values[:, 3:6], frame, epoch)
    digits = [KM * rounding(table.stack(names)) for names in (("X0", "X1", "X2"), ("X3", "X4", "X5"))]
    return Rows(table, t_s, r_i, v_i, None, *digits, None)


def aem(given, earth, epoch):
    """Attitudes of a scenario.trajectory.AemFile."""
    message = _read(given.aem, "CCSDS_AEM_VERS", "Q", (4, 8))
    file, meta = message.table.file, message.meta
    _same(file, meta, "ATTITUDE_TYPE", ("QUATERNION", "QUATERNION/DERIVATIVE"))
    scalar_last = _same(file, meta, "QUATERNION_TYPE", ("LAST", "FIRST")) == "LAST"
    a_to_b = _same(file, meta, "ATTITUDE_DIR", ("A2B", "B2A")) == "A2B"
    table, t_s = _once(message, epoch)
    ascending(table, t_s)
    q = table.stack(("Q0", "Q1", "Q2", "Q3"))
    digit = 2.0 * rounding(q)
    if scalar_last:
        q = q[:, [3, 0, 1, 2]]
    frame, body_is_b = _of_body(file, meta)
    sense = "body_to_frame" if a_to_b == body_is_b else "frame_to_body"
    C_fb = placing.body_axes(placing.of_quaternions(unit_quaternions(table, q), sense), given.axes)
    C_ib = _axes_in_i(placing.place(earth, t_s), t_s, frame, epoch) @ C_fb
    q_ib = np.array([quat_from_dcm(np.ascontiguousarray(one)) for one in C_ib])
    return Attitudes(table, t_s, q_ib, digit)


def _read(path, version, letter, widths):
    """_Message in the file at `path`, its numbers named by `letter`.

    version : key of its first line
    widths : how many numbers a row may have; the first is how many are read
    """
    segments = _segments(path, _lines(path, version))
    _alike(path, segments)
    rows = [row for one in segments for row in one.rows]
    if not rows:
        raise DataError(f"{path}: has no segment with META_START, META_STOP and data; expected one")
    values = np.array([_row(path, n, words, widths)[: widths[0]] for n, words in rows])
    columns = {f"{letter}{k}": values[:, k].copy() for k in range(widths[0])}
    table = Table(path, columns, np.array([n for n, _ in rows]))
    begins = np.array([k == 0 for one in segments for k in range(len(one.rows))])
    return _Message(table, [words[0] for _, words in rows], begins, segments[0].meta)


def _lines(path, version):
    """[(number, text)] of the lines below the first that are no comment."""
    try:
        text = read_text(path, f"a CCSDS message ({version})", LARGEST_DATA)
    except Unreadable as error:
        raise DataError(f"{path} {error}") from None
    lines = [(n, line.strip()) for n, line in enumerate(text.splitlines(), 1)]
    lines = [(n, line) for n, line in lines if line and not line.startswith("COMMENT")]
    if not lines or not lines[0][1].startswith(version):
        begins = lines[0][1][:40] if lines else "nothing"
        more = "; XML is not read, write it as KVN" if begins.startswith("<") else ""
        raise DataError(f"{path}:1: expected '{version} = ...', got '{begins}'{more}")
    return lines[1:]


def _segments(path, lines):
    """[_Segment] of lines; no line is passed by but those of the header and of covariances."""
    segments, inside, since = [], None, 0
    for n, line in lines:
        if inside is not None and line == BEGINS[inside]:
            inside = None
        elif inside == "META_START" or (inside is None and not segments and line not in BEGINS):
            key, equals, value = line.partition("=")
            if not equals:
                wanted = "'KEY = value' or META_STOP" if inside else "'KEY = value' or META_START"
                raise DataError(f"{path}:{n}: expected {wanted}, got '{line[:40]}'")
            if inside:
                segments[-1].meta[key.strip()] = (n, value.strip())
        elif line in BEGINS:
            if inside is not None:
                raise DataError(
                    f"{path}:{since}: {inside}: expected {BEGINS[inside]} before {line} in line {n}"
                )
            inside, since = line, n
            if line == "META_START":
                segments.append(_Segment(n, {}, []))
        elif inside is None and line not in ("DATA_START", "DATA_STOP"):
            segments[-1].rows.append((n, line.split()))
    if inside is not None:
        raise DataError(f"{path}:{since}: {inside}: expected {BEGINS[inside]} before the end of the file")
    return segments


def _alike(path, segments):
    """Refuse segments that differ in what is read from the first, and frames of a fixed epoch."""
    for one in segments:
        if "REF_FRAME_EPOCH" in one.meta:
            n, value = one.meta["REF_FRAME_EPOCH"]
            words = f"a frame of a fixed epoch is not read, got '{value}'; expected a frame without this key"
            raise DataError(f"{path}:{n}: REF_FRAME_EPOCH: {words}")
        for key, otherwise in OF_ALL.items():
            first = segments[0].meta.get(key, (0, otherwise))[1]
            n, value = one.meta.get(key, (one.line, otherwise))
            if value.upper() != first.upper():
                words = f"all segments must have that of the first, '{first}', got '{value}'"
                raise DataError(f"{path}:{n}: {key}: {words}")


def _row(path, n, words, widths):
    """Numbers of a row after its epoch: list."""
    if len(words) - 1 not in widths:
        many = " or ".join(map(str, widths))
        raise DataError(f"{path}:{n}: expected an epoch and {many} numbers, got {len(words)} words")
    try:
        return [number(word) for word in words[1:]]
    except ValueError as error:
        raise DataError(f"{path}:{n}: expected an epoch and {len(words) - 1} numbers: {error}") from None


def _once(message, epoch):
    """Table and mission times (N,) s; the first row of a segment may repeat the last of the one before."""
    table, t_s = message.table, _mission_times(message, epoch)
    values = table.stack(tuple(table.columns))
    again = message.begins & np.concatenate([[False], np.diff(t_s) == 0.0])
    other = again & np.concatenate([[False], np.any(np.diff(values, axis=0) != 0.0, axis=1)])
    if np.any(other):
        words = "is at the epoch of the last row of the segment before, with other numbers; expected the same"
        raise DataError(f"{table.place(int(np.argmax(other)))}: {words}")
    kept = {name: column[~again] for name, column in table.columns.items()}
    return table._replace(columns=kept, lines=table.lines[~again]), t_s[~again]


def _needed(path, meta, key):
    """(line, value) of a key that the message must have."""
    if key not in meta:
        raise DataError(f"{path}: {key} is missing; expected such as '{key} = EME2000'")
    return meta[key]


def _same(path, meta, key, wanted):
    """The value of a key, which must be one of the `wanted` words."""
    n, value = meta.get(key, (1, OF_ALL[key]))
    if value.upper() not in wanted:
        raise DataError(f"{path}:{n}: {key}: expected {' or '.join(wanted)}, got '{value}'")
    return value.upper()


def _mission_times(message, epoch):
    """Mission times (N,) s of the epochs, in the time system of the message."""
    from astropy.time import Time
    from erfa import ErfaWarning

    table, when = message.table, message.epochs
    n, system = message.meta.get("TIME_SYSTEM", (1, OF_ALL["TIME_SYSTEM"]))
    if system not in SCALES:
        raise DataError(f"{table.file}:{n}: TIME_SYSTEM: '{system}' is not read; one of: {', '.join(SCALES)}")
    texts = [one.rstrip("Z").replace("T", ":", 1) if _is_of_day(one) else one.rstrip("Z") for one in when]
    form = {"format": "yday" if _is_of_day(when[0]) else "isot", "scale": SCALES[system]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ErfaWarning)  # leap seconds of years to come are not known
        try:
            times = Time(texts, **form)
        except ValueError:
            row = next(k for k, text in enumerate(texts) if not _is_epoch(text, form))
            words = "expected an epoch such as 2026-06-26T12:00:00 or, in all rows, 2026-177T12:00:00"
            raise DataError(f"{table.place(row)}: {words}, got '{when[row][:40]}'") from None
        since = (times - Time(epoch.utc, format="isot", scale="utc")).to_value("s")
    return np.atleast_1d(since) + (GPS_BEHIND_TAI_S if system == "GPS" else 0.0)


def _is_epoch(text, form):
    """Whether astropy.time.Time reads a text; form : its format and scale."""
    from astropy.time import Time

    try:
        Time(text, **form)
    except ValueError:
        return False
    return True


def _is_of_day(text):
    """Whether an epoch has the day of the year: 2026-177T12:00:00."""
    return len(text.partition("T")[0]) == 8


def _frame(path, n, name):
    """One of the four frames of a name."""
    plain = name.upper().replace("-", "").replace("_", "")
    if plain.startswith("ITRF"):
        return EARTH_FIXED
    if plain not in ALIASES:
        raise DataError(f"{path}:{n}: frame '{name}' is not read; one of: {', '.join(ALIASES)}, ITRF...")
    return ALIASES[plain]


def _of_body(path, meta):
    """The frame that is not of the body, and whether REF_FRAME_B is of the body."""
    both = [_needed(path, meta, key) for key in ("REF_FRAME_A", "REF_FRAME_B")]
    bodies = [name.upper().startswith("SC_") for _, name in both]
    if sum(bodies) != 1:
        words = "expected one of REF_FRAME_A and REF_FRAME_B to be of the body, such as SC_BODY_1"
        raise DataError(f"{path}:{both[0][0]}: {words}")
    return _frame(path, *both[0 if bodies[1] else 1]), bodies[1]


def _axes_in_i(here, t_s, frame, epoch):
    """C_if of the axes of a frame at the rows (N, 3, 3)."""
    import erfa

    if frame == EARTH_FIXED:
        return here.C_ie
    if frame == TEME:
        return here.C_ie @ _teme_to_e(here.earth, t_s, epoch)
    fixed = np.eye(3)
    if frame == EME2000:
        fixed = erfa.bp00(erfa.DJ00, 0.0)[0].T  # GCRS to the mean equator and equinox of J2000
    return np.broadcast_to(fixed, (len(t_s), 3, 3))


def _teme_to_e(earth, t_s, epoch):
    """(N, 3, 3): TEME to frame e, by UT1 and polar motion of the scenario."""
    import erfa
    from astropy.time import Time

    utc = Time(epoch.utc, format="isot", scale="utc")
    with ephemeris.quiet():
        day, part = erfa.utcut1(utc.jd1, utc.jd2, epoch.ut1_minus_utc)  # of a day that may be a second longer
    sidereal = erfa.gmst82(day, part + np.asarray(t_s) / 86400.0)
    c, s = np.cos(sidereal), np.sin(sidereal)
    C = np.zeros((len(t_s), 3, 3))
    C[:, 0, 0], C[:, 0, 1], C[:, 1, 0], C[:, 1, 1], C[:, 2, 2] = c, s, -s, c, 1.0
    return earth.C_re.T @ C


def _inertial(here, t_s, r, v, frame, epoch):
    """Inertial positions and velocities (N, 3) of those in a frame of a message."""
    C_if = _axes_in_i(here, t_s, frame, epoch)
    r_i, v_i = placing.rotated(C_if, r), placing.rotated(C_if, v)
    if frame == EARTH_FIXED:
        v_i = v_i + np.cross(frames.omega_ie_i(here.earth), r_i)
    return r_i, v_i
