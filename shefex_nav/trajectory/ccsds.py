"""CCSDS ephemeris and attitude messages, KVN: OEM (502.0-B) and AEM (504.0-B).

Positions are in km. EME2000 differs from the inertial axes of this program by the bias of the frames, 23 mas;
ICRF and GCRF do not. ITRF and TEME are turned by the orientation of the Earth that the scenario has: TEME by
the Greenwich mean sidereal time of 1982. A quaternion from A to B turns the axes of A into those of B.
"""

import warnings
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import frames
from shefex_nav.geometry.rotation import quat_from_dcm
from shefex_nav.scenario.data_table import DataError, Table
from shefex_nav.scenario.files import Unreadable, read_text
from shefex_nav.trajectory import placing
from shefex_nav.trajectory.rows import Attitudes, Rows, ascending, rounding, unit_quaternions

KM = 1e3
EME2000, GCRS, EARTH_FIXED, TEME = "EME2000", "GCRF", "ITRF", "TEME"
ALIASES = {"EME2000": EME2000, "J2000": EME2000, "ICRF": GCRS, "GCRF": GCRS, "GCRS": GCRS, "TEME": TEME}
SCALES = {"UTC": "utc", "TAI": "tai", "TT": "tt", "TDB": "tdb", "GPS": "tai"}
GPS_BEHIND_TAI_S = 19.0
BEGINS = {"META_START": "META_STOP", "COVARIANCE_START": "COVARIANCE_STOP"}


class Epoch(NamedTuple):
    """The mission time zero."""

    utc: str  # ISO 8601
    ut1_minus_utc: float  # s


class _Message(NamedTuple):
    """A message as it is written."""

    file: str
    version: float
    segments: list  # (metadata {key: (line, value)}, rows [(line, words)])


def oem(given, earth, epoch):
    """Rows of a scenario.trajectory.Oem; epoch : Epoch"""
    message = _read(given.file, "CCSDS_OEM_VERS")
    table, when, meta = _numbers(message, "X", (6, 9))
    _same(message.file, meta, "CENTER_NAME", ("EARTH",))
    frame, t_s = _frame(message.file, *meta["REF_FRAME"]), _mission_times(message, when, meta, epoch)
    table, t_s = _once(table, t_s)
    ascending(table, t_s)
    values = KM * table.stack(tuple(table.columns))
    here = placing.place(earth, t_s)
    r_i, v_i = _inertial(here, t_s, values[:, :3], values[:, 3:6], frame, epoch)
    digits = [KM * rounding(table.stack(names)) for names in (("X0", "X1", "X2"), ("X3", "X4", "X5"))]
    return Rows(table, t_s, r_i, v_i, None, *digits, None)


def aem(given, earth, epoch):
    """Attitudes of a scenario.trajectory.AemFile."""
    message = _read(given.aem, "CCSDS_AEM_VERS")
    table, when, meta = _numbers(message, "Q", (4, 8))
    _same(message.file, meta, "ATTITUDE_TYPE", ("QUATERNION", "QUATERNION/DERIVATIVE"))
    t_s = _mission_times(message, when, meta, epoch)
    table, t_s = _once(table, t_s)
    ascending(table, t_s)
    q = table.stack(("Q0", "Q1", "Q2", "Q3"))
    digit = 2.0 * rounding(q)
    if _told(meta, "QUATERNION_TYPE", "LAST") != "FIRST":
        q = q[:, [3, 0, 1, 2]]
    frame, body_is_b = _of_body(message.file, meta)
    a_to_b = _told(meta, "ATTITUDE_DIR", "A2B") == "A2B"
    sense = "body_to_frame" if a_to_b == body_is_b else "frame_to_body"
    C_fb = placing.body_axes(placing.of_quaternions(unit_quaternions(table, q), sense), given.axes)
    C_ib = _axes_in_i(placing.place(earth, t_s), t_s, frame, epoch) @ C_fb
    q_ib = np.array([quat_from_dcm(np.ascontiguousarray(one)) for one in C_ib])
    return Attitudes(table, t_s, q_ib, digit)


def _read(path, version):
    """_Message in the file at `path`; `version` is the key of its first line."""
    try:
        text = read_text(path, f"a CCSDS message ({version})")
    except Unreadable as error:
        raise DataError(f"{path} {error}") from None
    lines = [(n, line.strip()) for n, line in enumerate(text.splitlines(), 1)]
    lines = [(n, line) for n, line in lines if line and not line.startswith("COMMENT")]
    if not lines or not lines[0][1].startswith(version):
        begins = lines[0][1][:40] if lines else "nothing"
        more = "; XML is not read, write it as KVN" if begins.startswith("<") else ""
        raise DataError(f"{path}:1: expected '{version} = ...', got '{begins}'{more}")
    segments, inside = [], None
    for n, line in lines[1:]:
        if inside is None and line in BEGINS:
            inside = line
            if line == "META_START":
                segments.append(({}, []))
        elif inside is not None and line == BEGINS[inside]:
            inside = None
        elif inside == "META_START":
            key, _, value = line.partition("=")
            segments[-1][0][key.strip()] = (n, value.strip())
        elif inside is None and segments and "=" not in line and line not in ("DATA_START", "DATA_STOP"):
            segments[-1][1].append((n, line.split()))
    if not any(rows for _, rows in segments):
        raise DataError(f"{path}: has no segment with META_START, META_STOP and data; expected one")
    number = lines[0][1].partition("=")[2].strip()
    return _Message(path, float(number) if number.replace(".", "").isdigit() else 0.0, segments)


def _numbers(message, letter, widths):
    """Table of the numbers of all segments, named by `letter`, their epochs, and the metadata.

    widths : how many numbers a row may have; the first is how many are read
    """
    first, found, lines, when = message.segments[0][0], [], [], []
    for meta, rows in message.segments:
        for key in ("REF_FRAME", "REF_FRAME_A", "REF_FRAME_B", "TIME_SYSTEM", "ATTITUDE_TYPE"):
            if key in first and meta.get(key, (0, ""))[1] != first[key][1]:
                n = meta.get(key, next(iter(meta.values())))[0]
                raise DataError(f"{message.file}:{n}: {key}: all segments must have that of the first")
        for n, words in rows:
            found.append(_row(message.file, n, words, widths))
            lines.append(n)
            when.append(words[0])
    width = widths[0]
    values = np.array([row[:width] for row in found])
    columns = {f"{letter}{k}": values[:, k].copy() for k in range(width)}
    return Table(message.file, columns, np.array(lines)), when, first


def _row(path, n, words, widths):
    """Numbers of a row after its epoch: list."""
    if len(words) - 1 not in widths:
        many = " or ".join(map(str, widths))
        raise DataError(f"{path}:{n}: expected an epoch and {many} numbers, got {len(words)} words")
    try:
        row = [float(word) for word in words[1:]]
    except ValueError:
        raise DataError(f"{path}:{n}: expected an epoch and numbers, got '{' '.join(words)[:60]}'") from None
    if not np.all(np.isfinite(row)):
        raise DataError(f"{path}:{n}: must be finite numbers")
    return row


def _once(table, t_s):
    """Rows of which the first of a segment does not repeat the last of the one before: Table, times."""
    rows = np.concatenate([[True], np.diff(t_s) != 0.0])
    kept = {name: column[rows] for name, column in table.columns.items()}
    return table._replace(columns=kept, lines=table.lines[rows]), t_s[rows]


def _told(meta, key, otherwise):
    return meta[key][1].upper() if key in meta else otherwise


def _same(path, meta, key, wanted):
    """Refuse a message that does not say one of the `wanted` words."""
    n, value = meta.get(key, (1, ""))
    if value.upper() not in wanted:
        raise DataError(f"{path}:{n}: {key}: expected {' or '.join(wanted)}, got '{value}'")


def _mission_times(message, when, meta, epoch):
    """Mission times (N,) s of epochs in the time system of the message."""
    from astropy.time import Time
    from erfa import ErfaWarning

    n, system = meta.get("TIME_SYSTEM", (1, "UTC"))
    if system not in SCALES:
        raise DataError(
            f"{message.file}:{n}: TIME_SYSTEM: '{system}' is not read; one of: {', '.join(SCALES)}"
        )
    texts = [one.rstrip("Z").replace("T", ":", 1) if _is_of_day(one) else one.rstrip("Z") for one in when]
    kind = "yday" if _is_of_day(when[0]) else "isot"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ErfaWarning)  # leap seconds of years to come are not known
        try:
            told = Time(texts, format=kind, scale=SCALES[system])
        except ValueError as error:
            line = message.segments[0][1][0][0]
            raise DataError(f"{message.file}:{line}: an epoch cannot be read: {str(error)[:80]}") from None
        since = (told - Time(epoch.utc, format="isot", scale="utc")).to_value("s")
    return np.atleast_1d(since) + (GPS_BEHIND_TAI_S if system == "GPS" else 0.0)


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
    for key in ("REF_FRAME_A", "REF_FRAME_B"):
        if key not in meta:
            raise DataError(f"{path}: {key} is missing; expected such as '{key} = EME2000'")
    bodies = [meta[key][1].upper().startswith("SC_") for key in ("REF_FRAME_A", "REF_FRAME_B")]
    if sum(bodies) != 1:
        words = "expected one of REF_FRAME_A and REF_FRAME_B to be of the body, such as SC_BODY_1"
        raise DataError(f"{path}:{meta['REF_FRAME_A'][0]}: {words}")
    return _frame(path, *meta["REF_FRAME_A" if bodies[1] else "REF_FRAME_B"]), bodies[1]


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
    ut1 = utc.jd2 + (epoch.ut1_minus_utc + np.asarray(t_s)) / 86400.0
    sidereal = erfa.gmst82(utc.jd1, ut1)
    c, s = np.cos(sidereal), np.sin(sidereal)
    C = np.zeros((len(t_s), 3, 3))
    C[:, 0, 0], C[:, 0, 1], C[:, 1, 0], C[:, 1, 1], C[:, 2, 2] = c, s, -s, c, 1.0
    return earth.C_re.T @ C


def _inertial(here, t_s, r, v, frame, epoch):
    """Inertial positions and velocities (N, 3) of those in a frame of a message."""
    C_if = _axes_in_i(here, t_s, frame, epoch)
    r_i, v_i = placing.turned(C_if, r), placing.turned(C_if, v)
    if frame == EARTH_FIXED:
        v_i = v_i + np.cross(frames.omega_ie_i(here.earth), r_i)
    return r_i, v_i
