"""What the rows of a trajectory get wrong: units, frames, steps, and too few of them.

What is impossible is refused, with the unit or frame that would fit. What is only odd is warned of.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import frames, wgs84
from shefex_nav.geometry.elementary import arccos
from shefex_nav.scenario.data_table import DataError
from shefex_nav.trajectory import placing
from shefex_nav.world.flight import track

# m, height (spheres of other programs lie 7 km below the ellipsoid) and distance that can be meant
DEEPEST_M, FARTHEST_M = -20e3, 5e8
LOWEST_M = -600.0  # height, lower than any ground
FASTEST = 2e4  # m/s, inertial
STILL = 0.5  # m/s relative to the Earth, of a vehicle that stands
MISFIT, FITS = 0.3, 0.1  # share of the way by which positions and velocities differ: refused; what fits
ALIKE = 0.01  # two explanations that fit equally well
ODD = 0.02
MOVES = 5.0  # m/s, above which velocities are held against positions
STEP_M, STEP_SHARE = 1.0, 0.2  # a position that steps aside by this, and this share of the way of a row
TURN, MOST_TURN = np.radians(60.0), np.radians(150.0)  # between two rows: odd, refused
WITHIN_S = 0.1  # in which a forward along the velocity that turns so far is odd
ROUGH = 1.0  # m/s^2
COARSE_M = 1.0  # by which the curve between rows may be off
ASTRAY, FAST = np.radians(60.0), 50.0  # angle of attack of a vehicle that climbs at this speed, m/s
LATE_S = 0.5  # between lift-off and the mission time zero


class Oddity(NamedTuple):
    """Something to warn of."""

    field: tuple  # path in the scenario
    text: str


def refuse(rows, earth):
    """DataError where positions or velocities are impossible."""
    radius, speed = np.linalg.norm(rows.r_i, axis=1), np.linalg.norm(rows.v_i, axis=1)
    bad = np.flatnonzero((_heights(rows, earth) < DEEPEST_M) | (radius > FARTHEST_M))
    if len(bad):
        words = f"is {radius[bad[0]] / 1e3:.6g} km from the centre of the Earth"
        raise DataError(
            f"{rows.table.place(int(bad[0]))}: the position {words}; check position_frame and its unit"
        )
    bad = np.flatnonzero(speed > FASTEST)
    if len(bad):
        words = f"the velocity is {speed[bad[0]]:.4g} m/s in inertial axes"
        raise DataError(f"{rows.table.place(int(bad[0]))}: {words}; check velocity_frame and its unit")
    share, gap = _misfit(rows, rows.v_i, earth)
    if share > MISFIT:
        fitting = [(found[0], words) for words, v_i in rows.others if (found := _misfit(rows, v_i, earth))]
        best = [words for found, words in fitting if found < min(FITS, min(fitting)[0] + ALIKE)]
        hint = f"; they fit with {' or '.join(best)}" if best else ""
        words = f"velocities differ from the change of the positions by {gap:.3g} m/s"
        more = "" if hint else "; check units, frames and lift_off"
        raise DataError(f"{rows.table.file}: {words} ({100.0 * share:.0f} % of the way, median){hint}{more}")


def refuse_turns(attitudes):
    """DataError where an attitude turns so far between two rows that its rate is not known."""
    turned = track.turns(attitudes.q_ib)
    k = int(np.argmax(turned))
    if turned[k] > MOST_TURN:
        words = f"the attitude is {np.degrees(turned[k]):.0f} deg from that of the row before"
        raise DataError(f"{attitudes.table.place(k + 1)}: {words}; more rows are needed to tell the rate")


def refuse_moving(rows, earth):
    """DataError unless the first row stands on the Earth."""
    speed = _first_speed(rows, earth)
    if speed > STILL:
        words = f"moves with {speed:.3g} m/s; a pad is for a vehicle that stands there"
        raise DataError(f"{rows.table.place(0)}: the first row {words}")


def at_rest(rows, earth):
    """Inertial acceleration (3,) m/s^2 at the first row of what stands there; None if it moves."""
    omega_i = frames.omega_ie_i(earth)
    still = _first_speed(rows, earth) <= STILL
    return np.cross(omega_i, np.cross(omega_i, rows.r_i[0])) if still else None


def _first_speed(rows, earth):
    """Speed of the first row relative to the Earth, m/s."""
    return float(np.linalg.norm(rows.v_i[0] - np.cross(frames.omega_ie_i(earth), rows.r_i[0])))


def found(rows, flight, earth):
    """list of Oddity. flight : Flight along the rows"""
    out = [*_disagree(rows, earth), *_steps(rows, earth), *_deep(rows, earth)]
    out += list(_coarse(rows)) or list(_rough(rows))  # too few rows are rough by themselves
    out += _flips(flight) if rows.attitudes is None else _turns(rows.attitudes)
    return [*out, *_astray(rows, flight), *_late(flight)]


def _misfit(rows, v_i, earth):
    """By how much velocities differ from the change of positions: share of the way, m/s, medians."""
    dt_s = np.diff(rows.t_s)
    still_i = np.cross(frames.omega_ie_i(earth), 0.5 * (rows.r_i[1:] + rows.r_i[:-1]))
    way = np.diff(rows.r_i, axis=0) / dt_s[:, None] - still_i
    said = 0.5 * (v_i[1:] + v_i[:-1]) - still_i
    bent = np.linalg.norm(np.diff(v_i, axis=0), axis=1) / 6.0 + 2.0 * rows.rounding_m / dt_s
    length = np.maximum(np.linalg.norm(way, axis=1), np.linalg.norm(said, axis=1))
    used = length > MOVES
    if np.count_nonzero(used) < 3:
        return 0.0, 0.0
    gap = np.maximum(np.linalg.norm(way - said, axis=1) - bent, 0.0)[used]
    return float(np.median(gap / length[used])), float(np.median(gap))


def _disagree(rows, earth):
    share, gap = _misfit(rows, rows.v_i, earth)
    if share > ODD:
        words = f"velocities differ from the change of the positions by {gap:.3g} m/s"
        yield Oddity(("trajectory",), f"{words} ({100.0 * share:.0f} % of the way, median)")


def _steps(rows, earth):
    """Positions that are beside where velocity leads from one row to the next."""
    dt_s = np.diff(rows.t_s)[:, None]
    dv = np.diff(rows.v_i, axis=0)
    said = 0.5 * (rows.v_i[1:] + rows.v_i[:-1]) * dt_s
    aside = np.linalg.norm(np.diff(rows.r_i, axis=0) - said, axis=1)
    bound = STEP_M + 4.0 * rows.rounding_m + 0.25 * np.linalg.norm(dv * dt_s, axis=1)
    still_i = np.cross(frames.omega_ie_i(earth), rows.r_i[1:])
    way = np.linalg.norm(said - still_i * dt_s, axis=1)
    bad = np.flatnonzero((aside > bound) & (aside > STEP_SHARE * way))
    if len(bad):
        k = int(bad[np.argmax(aside[bad])])
        words = f"{rows.table.place(k + 1)}: the position steps by {aside[k]:.3g} m beside its velocity"
        yield Oddity(("trajectory", "file"), f"{words} ({len(bad)} such rows)")


def _heights(rows, earth):
    """Heights above the ellipsoid (N,) m."""
    r_e = placing.rotated(frames.dcms_ie(earth, rows.t_s).transpose(0, 2, 1), rows.r_i)
    return np.array([wgs84.geodetic_from_ecef(one)[2] for one in r_e])


def _deep(rows, earth):
    """Positions below all ground, as where a column counts downwards."""
    height = _heights(rows, earth)
    k = int(np.argmin(height))
    if height[k] < LOWEST_M:
        words = f"{rows.table.place(k)}: the position is {-height[k]:.0f} m below the ellipsoid"
        yield Oddity(("trajectory", "file"), f"{words}; are heights positive upwards, and the frame right?")


def _coarse(rows):
    """How far a curve through every other row is from the rows between; the whole is a sixteenth of that."""
    half = slice(None, None, 2)
    if len(rows.t_s) < 9:
        yield Oddity(("trajectory", "file"), f"has {len(rows.t_s)} rows; what is between them is a guess")
        return
    a_i = None if rows.a_i is None else rows.a_i[half]
    every_other = track.Track(
        rows.t_s[half], rows.r_i[half], rows.v_i[half], a_i, rows.rounding_m, rows.rounding_m_s
    )
    between = np.arange(1, len(rows.t_s) - 1, 2)
    off = np.linalg.norm(every_other.at(rows.t_s[between])[0] - rows.r_i[between], axis=1) / 16.0
    k = int(np.argmax(off))
    if off[k] > COARSE_M:
        row = int(between[k])
        gap_s = rows.t_s[row + 1] - rows.t_s[row]
        words = f"{rows.table.place(row)}: rows {gap_s:.3g} s apart are too coarse for this motion"
        yield Oddity(
            ("trajectory", "file"), f"{words}: positions between them are off by about {off[k]:.2g} m"
        )


def _rough(rows):
    """Positions that scatter about the way that their velocities lead: each row pushes to another side."""
    motion = rows.t_s, rows.r_i, rows.v_i, rows.a_i
    curve = track.Track(*motion, rows.rounding_m, rows.rounding_m_s)
    quarter = rows.t_s[:-1] + 0.25 * np.diff(rows.t_s)  # where a step between two rows pushes most
    push = float(np.percentile(np.linalg.norm(curve.pushes(quarter), axis=1), 90.0))
    if push > ROUGH:
        words = f"positions scatter about the way of their velocities, which pushes by {push:.2g} m/s2 "
        words += "between rows (in one of ten by more); give more digits, or fewer rows"
        yield Oddity(("trajectory", "file"), words)


def _turns(attitudes):
    turned = track.turns(attitudes.q_ib)
    k = int(np.argmax(turned))
    if turned[k] > TURN:
        words = f"{attitudes.table.place(k + 1)}: the attitude turns by {np.degrees(turned[k]):.0f} deg"
        yield Oddity(("trajectory", "attitude"), f"{words} from the row before: its rate is hardly known")


def _flips(flight):
    """Forward that turns round with the velocity it is made along, as at the top of a vertical flight."""
    trajectory = flight.trajectory
    q = trajectory.q_ib[:: round(WITHIN_S / np.diff(trajectory.t_s[:2])[0])]
    w, x, y, z = q.T
    forward_i = np.column_stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)])
    turned = arccos(np.clip(np.einsum("ki,ki->k", forward_i[1:], forward_i[:-1]), -1.0, 1.0))
    k = int(np.argmax(turned)) if len(turned) else 0
    if len(turned) and turned[k] > TURN:
        at_s = trajectory.t_s[0] + (k + 1) * WITHIN_S
        words = f"forward, along the velocity, turns by {np.degrees(turned[k]):.0f} deg in {WITHIN_S:g} s"
        yield Oddity(
            ("trajectory", "attitude"),
            f"{words} at T{at_s:+.1f} s: no vehicle does; it needs its own attitude",
        )


def _astray(rows, flight):
    """Forward that is nowhere near the velocity of a vehicle that climbs by its motor."""
    trajectory = flight.trajectory
    climbs = (trajectory.burning > 0) | (trajectory.phase == 1)
    fast = climbs & (trajectory.mach * 300.0 > FAST)
    if rows.attitudes is None or np.count_nonzero(fast) < 100:
        return
    angle = float(np.median(trajectory.angle_of_attack[fast]))
    if angle > ASTRAY:
        words = f"while a motor burns forward is {np.degrees(angle):.0f} deg from the velocity (median)"
        yield Oddity(("trajectory", "attitude"), f"{words}: check sense, frame and axes of the attitude")


def _late(flight):
    at = next((one.t_s for one in flight.events if one.name == "lift_off"), None)
    if at is not None and abs(at) > LATE_S:
        words = f"the file shows the lift-off at T{at:+.2f} s; mission times count from it: lift_off"
        yield Oddity(("trajectory",), words)
