"""What goes wrong: faults of the sensors between two times.

In: what the sensors of the IMU sense and what it sends (`imu.measure` asks for both), the fixes and ranges of
`gps.measure`, pictures and star fixes on their way. Out: the same as the on-board computer gets it, and an
Event at the begin and at the end of every fault, which is truth and never seen on board. Without faults
everything passes unchanged.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S, SAMPLES_PER_TICK, sample_s
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Event, GpsRanges, Reason
from shefex_nav.world import gps_receiver
from shefex_nav.world.fault_settings import (
    AccelerometerBias,
    AccelerometerScale,
    AxisFault,
    Bias,
    Blinded,
    Dead,
    Delay,
    Dropout,
    Freeze,
    GyroBias,
    GyroScale,
    Jump,
    Outage,
    Repeat,
    Stuck,
    in_turn,
    with_fault,
    within,
)

OF_CHANNELS = (
    "prn", "pseudorange", "range_rate", "r_es_e", "v_es_e", "sigma_range", "sigma_range_rate",
    "sigma_lasting", "sigma_shared",
)  # fmt: skip


FELT = GyroBias, GyroScale, AccelerometerBias, AccelerometerScale  # of a sensor, before range and quanta
SENT = Stuck, Dead, Dropout, Repeat  # of what the unit sends


def imu_sensed(faults, t_s, dtheta_b, dv_b):
    """What the sensors of a faulty unit sense, in place: wrong bias and scale, before range and quanta.

    tuple of fault_settings.Imu; (N,) s, ends of the samples; (N, 3) rad, (N, 3) m/s, not limited, not counted
    """
    dt_s = sample_s(t_s)
    for fault, rows, increments, _ in _acting(faults, FELT, t_s, (dtheta_b, dv_b)):
        match fault:
            case GyroBias(rate=error) | AccelerometerBias(acceleration=error):
                increments[rows, fault.k] += error * dt_s
            case GyroScale() | AccelerometerScale():
                increments[rows, fault.k] *= 1.0 + fault.factor


def imu_sent(faults, t_s, dtheta_b, dv_b, at_range):
    """What a faulty unit sends, in place: what repeats, repeats readings that were really sent.

    Parameters
    ----------
    faults : tuple of fault_settings.Imu
    t_s : (N,) s, ends of the samples
    dtheta_b, dv_b : (N, 3) rad, m/s, within the range and in whole quanta
    at_range : pair of (N, 3) bool, of gyros and accelerometers: the reading is at the end of its range

    Returns
    -------
    (N,) bool, samples that are not sent; None without faults
    """
    missing = np.zeros(len(t_s), dtype=bool) if faults else None
    for fault, rows, increments, flags in _acting(in_turn(faults), SENT, t_s, (dtheta_b, dv_b), at_range):
        match fault:
            case Stuck(k=k):
                increments[rows, k], flags[rows, k] = increments[rows[0] - 1, k], flags[rows[0] - 1, k]
            case Dead(k=k):
                increments[rows, k], flags[rows, k] = 0.0, False
            case Dropout():
                missing[rows] = True
            case Repeat():
                _repeat_block(rows, dtheta_b, dv_b, *at_range)
    return missing


def _acting(faults, kinds, t_s, increments, flags=(None, None)):
    """Faults of some kinds that act on samples. Yields fault, rows, and of its triad increments and flags."""
    begin_s = t_s - sample_s(t_s)
    for fault in faults:
        rows = np.flatnonzero(within(fault, begin_s))  # samples that begin within the fault
        rows = rows[rows > 0]
        if isinstance(fault, kinds) and len(rows):
            triad = 0 if getattr(fault, "sensor", "") == "gyro" else 1
            yield fault, rows, increments[triad], flags[triad]


def _repeat_block(rows, *columns):
    """Samples of whole blocks become those of the last block before them, in place; columns : (N, 3).

    A unit sends a block anew or again, never a part of each: the last is that in which the last row lies.
    """
    first = 1 + ((rows[0] - 1) // SAMPLES_PER_TICK) * SAMPLES_PER_TICK  # row 0 belongs to no block
    if first == 1:
        return
    end = 1 + ((rows[-1] - 1) // SAMPLES_PER_TICK + 1) * SAMPLES_PER_TICK
    rows = np.arange(first, min(end, len(columns[0])))
    source = first - SAMPLES_PER_TICK + (rows - first) % SAMPLES_PER_TICK
    for column in columns:
        column[rows] = column[source]


def gps(faults, fixes):
    """The fixes with their faults. tuple of fault_settings.Gps, list of GpsFix -> list of GpsFix"""
    for fault in in_turn(faults):
        fixes = with_fault(fault, fixes, _gps_fault, lambda fix: fix.valid)
    return fixes


def gps_ranges(faults, messages, antenna):
    """The ranges with their faults.

    A jump or a drift makes them those of an antenna in another place, as a spoofer or a wrong reference
    station does: each pseudorange changes by the difference of the distances from its satellite, -u . d to
    first order, u the line of sight and d the displacement. The range rates become those of the displaced
    antenna too, so that they still say the velocity that was true; with `velocity_too` they contain the
    drift.

    Parameters
    ----------
    faults : tuple of fault_settings.Gps
    messages : list of GpsRanges
    antenna : gps.Antenna, where it was at each of them

    Returns
    -------
    list of GpsRanges
    """
    heard = [
        _Heard(message, r_e, v_e)
        for message, r_e, v_e in zip(messages, antenna.r_ea_e, antenna.v_ea_e, strict=True)
    ]
    for fault in in_turn(faults):
        heard = with_fault(fault, heard, _ranges_fault, lambda one: not one.message.reason)
    return [one.message for one in heard] if faults else messages


class _Heard(NamedTuple):
    """A GpsRanges and the state of the antenna that it tells: (3,) m, (3,) m/s, frame e."""

    message: GpsRanges
    r_ea_e: np.ndarray
    v_ea_e: np.ndarray

    @property
    def t_valid_s(self):
        """Of the message."""
        return self.message.t_valid_s


def _ranges_fault(fault, heard, last):
    """Ranges under a fault. fault_settings.Gps, _Heard, the last with ranges before it or None -> _Heard"""
    message = heard.message
    if isinstance(fault, Freeze):
        if last is None:
            return heard
        return last._replace(message=_repeated(fault, message, last.message))
    if isinstance(fault, Outage):
        message = message._replace(**{name: getattr(message, name)[:0] for name in OF_CHANNELS})
        return heard._replace(message=message._replace(reason="outage"))
    if isinstance(fault, Delay):
        return heard._replace(message=_delayed(fault, message))
    moved_e, faster_e = _moved(fault, heard.r_ea_e, message.t_valid_s)
    there = _Heard(message, heard.r_ea_e + moved_e, heard.v_ea_e + faster_e)
    rho, rho_rate = (
        now - before
        for now, before in zip(
            *(gps_receiver.between(message.r_es_e, message.v_es_e, one.r_ea_e, one.v_ea_e)
              for one in (there, heard)),
            strict=True,
        )
    )  # fmt: skip
    return there._replace(
        message=message._replace(
            pseudorange=message.pseudorange + rho, range_rate=message.range_rate + rho_rate
        )
    )


def _moved(fault, r_ea_e, t_s):
    """By how much a jump or drift changes position and velocity at a time: (3,) m, (3,) m/s, frame e."""
    C_en, none = wgs84.level_axes(r_ea_e), np.zeros(3)
    if isinstance(fault, Jump):
        return C_en @ np.array(fault.position), none
    rate_e = C_en @ np.array(fault.rate)
    return (t_s - fault.start) * rate_e, rate_e if fault.velocity_too else none


def _repeated(fault, message, last):
    """The last GpsFix or GpsRanges again in the place of a message. -> the same kind"""
    t_valid_s = last.t_valid_s if fault.time == "stands" else message.t_valid_s
    return last._replace(t_valid_s=t_valid_s, t_available_s=message.t_available_s)


def _delayed(fault, message):
    """A GpsFix or GpsRanges that comes later. -> the same kind"""
    t_valid_s = message.t_valid_s + (fault.by if fault.time == "late" else 0.0)
    return message._replace(t_valid_s=t_valid_s, t_available_s=message.t_available_s + fault.by)


def _gps_fault(fault, fix, last):
    """A fix under a fault. fault_settings.Gps, GpsFix, the last valid GpsFix without it or None -> GpsFix"""
    if isinstance(fault, Freeze):
        if last is None:
            return fix
        return _repeated(fault, fix, last)
    if isinstance(fault, Outage):
        return gps_receiver.unsolved(fix, "outage", n_satellites=0, pdop=np.nan)
    if isinstance(fault, Delay):
        return _delayed(fault, fix)
    if not fix.valid:
        return fix
    moved_e, faster_e = _moved(fault, fix.r_ea_e, fix.t_valid_s)
    return fix._replace(r_ea_e=fix.r_ea_e + moved_e, v_ea_e=fix.v_ea_e + faster_e)


class StarLine:
    """The line between star camera, star tracker and navigation, with the faults on it.

    faults : tuple of fault_settings.Stars
    rng : Generator of the wrong fixes
    """

    def __init__(self, faults, rng):
        self.faults, self.rng = faults, rng
        self.good = [0] * len(faults)  # fixes since each fault began

    def blinds(self, t_s):
        """Whether light falls into the camera at a time."""
        return any(isinstance(fault, Blinded) and within(fault, t_s) for fault in self.faults)

    def picture(self, frame):
        """A Frame as it reaches the star tracker."""
        if self.blinds(frame.t_valid_s):
            white = np.full_like(frame.image_dn, 2**frame.bits - 1)
            return frame._replace(image_dn=white)
        return frame

    def fix(self, fix):
        """A StarFix as it reaches the navigation."""
        if fix.reason != Reason.NONE and not len(fix.stars.hip):
            return fix
        for k, fault in enumerate(self.faults):
            if isinstance(fault, Blinded) or not within(fault, fix.t_valid_s):
                continue
            if isinstance(fault, Bias):
                turned_c = np.array(fault.angles)
            else:
                if fix.reason != Reason.NONE:
                    continue
                self.good[k] += 1
                if (self.good[k] - 1) % fault.every:
                    continue
                turned_c = self._wrong(fault)
            fix = _turned(fix, turned_c)
        return fix

    def _wrong(self, fault):
        """Rotation vector (3,) rad about a random axis."""
        direction = self.rng.standard_normal(3)
        angle = fault.smallest * (fault.largest / fault.smallest) ** self.rng.random()
        return angle * direction / np.sqrt(direction @ direction)


def _turned(fix, turned_c):
    """StarFix of a camera that is turned away: q_ic exp(turned_c); (3,) rad, camera axes."""
    q_ic = rotation.quat_multiply(fix.q_ic, rotation.quat_from_rotvec(turned_c))
    u_c = fix.stars.u_c @ rotation.dcm_from_rotvec(turned_c)  # row by row exp(-turned_c) u_c
    return fix._replace(q_ic=q_ic, stars=fix.stars._replace(u_c=u_c))


def events(faults, trajectory, earth, of_instruments=None):
    """Begin and end of every fault within the flight: list of Event, by time.

    faults : fault_settings.Faults
    of_instruments : {name: list of Fault}
    """
    t_s, found = trajectory.t_s, []
    others = {"gps": faults.gps, "star_tracker": faults.star_tracker, **(of_instruments or {})}
    prefixed = [(_imu_name(fault), fault) for fault in faults.imu]
    prefixed += [(f"{name}_{fault.name}", fault) for name, several in others.items() for fault in several]
    for name, fault in prefixed:
        for suffix, at_s, text in (("", fault.start, fault.words), ("_end", fault.end, "")):
            if t_s[0] <= at_s <= t_s[-1]:
                k = min(int(np.searchsorted(t_s, at_s - SAME_S)), len(t_s) - 1)
                r_e, _ = frames.ecef_from_inertial(earth, t_s[k], trajectory.r_i[k], trajectory.v_i[k])
                height = float(wgs84.geodetic_from_ecef(r_e)[2])
                found.append(Event(float(at_s), f"fault_{name}{suffix}", height, text))
    return sorted(found, key=lambda event: event.t_s)


def _imu_name(fault):
    return fault.name if isinstance(fault, AxisFault) else f"imu_{fault.name}"
