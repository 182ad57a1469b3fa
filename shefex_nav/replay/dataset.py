"""The series of the files on one time axis: t = 0 at the first IMU sample, body axes forward-right-down.

IMU samples become increments, one after the other without holes; fixes become records of the project.
"""

from itertools import chain
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S, sample_s
from shefex_nav.geometry import wgs84
from shefex_nav.instruments import TABLE
from shefex_nav.records import GpsFix
from shefex_nav.replay import csv_folder, kf_gins, navego, series
from shefex_nav.replay.series import TruthSeries
from shefex_nav.scenario.data_table import DataError

READERS = {"csv": csv_folder.read, "kf_gins": kf_gins.read, "navego": navego.read}
RATE_TOLERANCE = 0.02  # of the sampling rate that a scenario states
LONGEST_ARM = 1000.0  # m, of the IMU to the antenna
NONSENSE = -1  # number of satellites that cannot be
READING_RATE_TOLERANCE = 0.1  # likewise of an instrument, which need not keep time


class Increments(NamedTuple):
    """The IMU: sample k, k >= 1, is what happened from t_s[k - 1] to t_s[k]; row 0 is empty."""

    t_s: np.ndarray  # (N,)
    dtheta_b: np.ndarray  # (N, 3) rad
    dv_b: np.ndarray  # (N, 3) m/s
    bridged: np.ndarray  # (N,) bool, interpolated: the file has no such sample


class Dataset(NamedTuple):
    """Everything that is replayed."""

    imu: Increments
    fixes: list  # of GpsFix, in order of time
    truth: TruthSeries | None
    readings: dict = {}  # noqa: RUF012 a default is not changed; instrument -> its readings, in order of time
    oddities: tuple = ()  # (field, text) of what the files are to be warned of

    @property
    def received(self):
        """Fixes and readings, in no order: list."""
        return [*self.fixes, *chain.from_iterable(self.readings.values())]


def read(scenario, files):
    """Dataset of a ReplayScenario and the paths of its files; DataError with what is wrong in them."""
    imu, gnss, truth, *others = READERS[scenario.data.format](scenario.data, files)
    said = others[0] if others else {}
    if scenario.data.format == "navego":
        _same_lever_arm(scenario, files["gnss"])
    torn = []
    for name, one in {"imu": imu, "gnss": gnss, "truth": truth, **said}.items():
        if one is not None:
            check_times(one, getattr(scenario.data, name))
            torn += [(f"data.{name}", one.table.torn)] if one.table.torn else []
    check_imu(imu, scenario.imu, scenario.data.imu)
    if truth is not None:
        check_way(truth)
    start_s = imu.t_s[0]
    imu, gnss, truth = (one and one._replace(t_s=one.t_s - start_s) for one in (imu, gnss, truth))
    said = {name: one._replace(t_s=one.t_s - start_s) for name, one in said.items()}
    end_s = imu.t_s[-1]
    for one in (gnss, truth, *said.values()):
        if one is not None and (one.t_s[0] > end_s or one.t_s[-1] < 0.0):
            words = f"covers {one.t_s[0]:g} s to {one.t_s[-1]:g} s after the first sample of the IMU"
            raise DataError(f"{one.table.file}: {words}, which ends at {end_s:g} s; are the clocks the same?")
    return Dataset(
        imu=increments(imu, scenario.data),
        fixes=fixes(gnss, scenario.gnss),
        truth=truth,
        readings={name: readings(TABLE[name], one, scenario) for name, one in said.items()},
        oddities=(*torn, *late_rows(imu), *still_axes(imu, scenario.data.imu)),
    )


def _same_lever_arm(scenario, path):
    """A file that states a lever arm must not be contradicted."""
    stated = navego.lever_arm(path)
    if stated is None:
        return
    if stated.shape != (3,) or not (np.abs(stated) <= LONGEST_ARM).all():
        got = np.array2string(stated, precision=4, threshold=6)
        raise DataError(f"{path}: field larm: got {got}, expected three lengths of {LONGEST_ARM:g} m at most")
    if not np.allclose(stated, scenario.gnss.lever_arm, atol=1e-3):
        arm = ", ".join(f"{value:g} m" for value in stated)
        raise DataError(f"{path}: field larm says [{arm}]; write gnss.lever_arm: [{arm}]")


def _check_sample_rate(imu, dt_s, stated):
    """Refuse samples at another rate than is stated, Hz, or None. dt_s : (N - 1,) of an ImuSeries"""
    step_s = float(np.median(dt_s))
    if stated is None or abs(step_s * stated - 1.0) <= RATE_TOLERANCE:
        return
    words = f"has {1.0 / step_s:.4g} samples a second, data.imu.rate says {stated:g}"
    if abs(sample_s(imu.t_s) * stated - 1.0) > RATE_TOLERANCE:
        raise DataError(f"{imu.table.file}: {words}; check it and data.imu.time_unit")
    steps = f"{dt_s.min():.4g} s to {dt_s.max():.4g} s (median {step_s:.4g} s)"
    words = f"has {stated:g} samples a second on average, as data.imu.rate says, but steps of {steps}"
    raise DataError(f"{imu.table.file}: {words}; give the times at which they were measured, not received")


def increments(imu, data):
    """Increments of an ImuSeries, in body axes.

    data : schema_data.DataBlock: axes, kind of the samples, gaps that are bridged by interpolation
    """
    turn, gain = (body_axes(values, data.axes) for values in (imu.gyro, imu.accelerometer))
    dt_s = np.diff(imu.t_s)
    step_s = float(np.median(dt_s))
    _check_sample_rate(imu, dt_s, getattr(data.imu, "rate", None))
    longest = int(np.argmax(dt_s))
    if dt_s[longest] > max(data.longest_gap, 1.5 * step_s):
        words = f"no sample for {dt_s[longest]:.4g} s before this row; data.longest_gap allows"
        raise DataError(f"{imu.table.place(longest + 1)}: {words} {data.longest_gap:g} s")
    t_s, turn, gain, bridged = _without_holes(imu.t_s, turn, gain, missing(imu.t_s)[0])
    if imu.kind == "rate" and data.samples == "instant":
        turn[1:], gain[1:] = 0.5 * (turn[1:] + turn[:-1]), 0.5 * (gain[1:] + gain[:-1])
    length_s = np.diff(t_s)[:, None] if imu.kind == "rate" else 1.0  # an increment is of its own sample
    dtheta_b, dv_b = np.zeros_like(turn), np.zeros_like(gain)
    dtheta_b[1:], dv_b[1:] = turn[1:] * length_s, gain[1:] * length_s
    return Increments(t_s, dtheta_b, dv_b, bridged)


def body_axes(values, axes):
    """Vectors (N, 3) of a file in axes forward, right, down; `axes` names them, such as ('x', '-y', '-z')."""
    signs = np.array([-1.0 if axis[0] == "-" else 1.0 for axis in axes])
    return values[:, ["xyz".index(axis[-1]) for axis in axes]] * signs


def file_axes(values, axes):
    """Vectors (N, 3) in axes forward, right, down in those of the file: the inverse of `body_axes`."""
    out = np.empty_like(values)
    for k, axis in enumerate(axes):
        out[:, "xyz".index(axis[-1])] = -values[:, k] if axis[0] == "-" else values[:, k]
    return out


def missing(t_s):
    """How many samples are missing before each row but the first, (N - 1,), and how many rows are late alone.

    A row that is late, with others around it that come as much early, was stamped when it was received: all
    samples are there.
    """
    dt_s = np.diff(t_s) / np.median(np.diff(t_s))
    lost, late = np.maximum(np.rint(dt_s).astype(int) - 1, 0), 0
    for k in np.flatnonzero(lost):
        around = dt_s[max(k - lost[k] - 1, 0) : k + lost[k] + 2]
        if around.sum() - len(around) < 0.5 * lost[k]:
            lost[k], late = 0, late + 1
    return lost, late


def late_rows(imu):
    """(field, text) about rows of an ImuSeries that come late while no sample is missing."""
    late, n = missing(imu.t_s)[1], len(imu.t_s)
    if late:
        words = f"{late} of {n} rows come late, and others next to them as much early: no sample is missing"
        yield "data.imu", f"{words}; give the times at which they were measured, not received"


def _without_holes(t_s, turn, gain, lost):
    """Readings with interpolated samples where some are missing. lost : of `missing`

    -> times, (N, 3), (N, 3), (N,) bool
    """
    if not lost.any():
        return t_s, turn.copy(), gain.copy(), np.zeros(len(t_s), dtype=bool)
    ends = np.concatenate([[0], np.cumsum(lost + 1)])  # where the samples of the file go
    places = np.arange(ends[-1] + 1)
    filled = [np.interp(places, ends, column) for column in (t_s, *turn.T, *gain.T)]
    bridged = ~np.isin(places, ends)
    return filled[0], np.column_stack(filled[1:4]), np.column_stack(filled[4:]), bridged


def fixes(gnss, settings):
    """GpsFix of a GnssSeries, thinned as schema.ReplayGnss says; DataError without any measure of noise."""
    sigma_r_n = _noise(gnss, gnss.sigma_r_n, settings.position_noise, "position")
    sigma_v_n = (
        None if gnss.v_e is None else _noise(gnss, gnss.sigma_v_n, settings.velocity_noise, "velocity")
    )
    count, out = np.zeros(len(gnss.t_s)) if gnss.satellites is None else gnss.satellites, []
    for k in _chosen(gnss.t_s, settings).tolist():
        has_velocity, reason = gnss.v_e is not None, _unusable(gnss, k, settings.fewest_satellites)
        valid = not reason
        C_en = wgs84.level_axes(gnss.r_e[k]) if valid else None
        nothing, unknown = np.full(3, np.nan), np.full((3, 3), np.nan)
        out.append(
            GpsFix(
                t_valid_s=float(gnss.t_s[k]),
                t_available_s=float(gnss.t_s[k]) + settings.latency,
                valid=valid,
                r_ea_e=gnss.r_e[k] if valid else nothing,
                v_ea_e=gnss.v_e[k] if valid and has_velocity else nothing,
                R_r_e=C_en * sigma_r_n[k] ** 2 @ C_en.T if valid else unknown,
                R_v_e=C_en * sigma_v_n[k] ** 2 @ C_en.T if valid and has_velocity else unknown,
                n_satellites=NONSENSE if np.isnan(count[k]) else int(count[k]),
                pdop=np.nan,
                reason=reason,
                horizontal=gnss.horizontal,
            )
        )
    return out


def _unusable(gnss, k, fewest):
    """Why fix k is none; '' if it is one. A number of satellites that is nonsense says nothing against it."""
    if not gnss.valid[k]:
        return "marked as not valid"
    if gnss.satellites is not None and gnss.satellites[k] < fewest:
        return f"fewer than {fewest} satellites"
    return ""


def readings(instrument, series, scenario):
    """Records of a ReadingSeries of an instrument of a ReplayScenario: tuple."""
    settings = getattr(scenario, instrument.name)
    _check_rate(series, settings.rate, instrument.name)
    axes, values = getattr(scenario.data, instrument.name).axes or scenario.data.axes, dict(series.fields)
    for one in instrument.data:
        if one.vector:
            values[one.field] = body_axes(values[one.field], axes)
    if instrument.at_limit is not None:
        values["at_limit"] = instrument.at_limit(settings, *values.values())
    columns = [column.tolist() if column.ndim == 1 else column for column in values.values()]
    return tuple(
        instrument.record(t_s, t_s + settings.latency, **dict(zip(values, said, strict=True)))
        for t_s, *said in zip(series.t_s.tolist(), *columns, strict=True)
    )


def _check_rate(series, rate, section):
    """DataError unless readings come about as often as a scenario says."""
    step_s = float(np.median(np.diff(series.t_s)))
    if abs(step_s * rate - 1.0) > READING_RATE_TOLERANCE:
        words = f"has {1.0 / step_s:.4g} readings a second, {section}.rate says {rate:g}"
        raise DataError(f"{series.table.file}: {words}")


def _noise(gnss, stated, wanted, name):
    """(M, 3) sigmas north, east, down: what the scenario wants, else what the file states."""
    if wanted is not None:
        sigma = np.tile(np.array(wanted), (len(gnss.t_s), 1))
        if gnss.horizontal and name == "position":
            sigma[:, 2] = 0.0
        return sigma
    if stated is None:
        words = f"says nothing about the noise of the {name}; give gnss.{name}_noise"
        raise DataError(f"{gnss.table.file}: {words}, north, east, down, 1 sigma")
    return stated


def _chosen(t_s, settings):
    """Rows of the fixes that are taken: all, or those nearest to first, first + every, ..."""
    if settings.every is None:
        return np.flatnonzero(t_s >= settings.first - SAME_S)
    turns = np.rint((t_s - settings.first) / settings.every).astype(int)
    away = np.abs(t_s - settings.first - turns * settings.every)
    order = np.lexsort((away, turns))
    nearest = order[np.unique(turns[order], return_index=True)[1]]
    near = away[nearest] <= 0.5 * np.median(np.diff(t_s)) + SAME_S
    return np.sort(nearest[near & (turns[nearest] >= 0)])


# ----------------------------------------------------------------------------------------------------------
# Values in the files that no instrument gives, and times that run backwards: refused with their place.
#
# A reading beyond what the sensor measures is no reading, but a broken cell. Where the scenario tells no
# range, a bound stands that no sensor reaches.


BEYOND = 2.0  # [E] times the range that is told: a sensor that clips gives its range and little more
TURNS = 3000.0  # [E] rad/s, faster than shells spin (300 turns a second)
PULLS = 1e5  # [E] m/s^2, 10 000 gee: no vehicle that is navigated pulls as much
JUMP = 1000.0  # [E] m, between two rows of truth, however near in time
FEWEST_ROWS = 20  # [E] of an IMU, from which on a value that never changes is no chance
NO_READING = 1e300  # in SI: what is larger is told as this
COUNTERS = (32, 31, 24, 16)  # bits
UNITS = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns"}
SPANS = {"week": 604800.0, "day": 86400.0}  # s, after which times of GNSS and of clocks begin anew
NEAR = 50.0  # [E] steps, within which a time after a wrap follows on the one before


def check_imu(imu, settings, columns):
    """Refuse readings far beyond the ranges of the sensors.

    imu : ImuSeries;  settings : schema.ReplayImu;  columns : schema_data.ImuColumns, or the name of a file
    """
    step_s = float(np.median(np.diff(imu.t_s))) if imu.kind == "increment" else 1.0
    for values, told, name, most, unit in (
        (imu.gyro, settings.gyro.range, "gyro", TURNS, ("deg/s", np.degrees(1.0))),
        (imu.accelerometer, settings.accelerometer.range, "accelerometer", PULLS, ("m/s2", 1.0)),
    ):
        limit = min(BEYOND * told, most)
        with np.errstate(over="ignore"):
            size = np.minimum(np.abs(values) / step_s, NO_READING)
        bad = np.argwhere(~(size <= limit))
        if len(bad):
            row, k = bad[0]
            named = getattr(columns, name, None) or [f"{name} {axis}" for axis in "xyz"]
            words = f"{size[row, k] * unit[1]:.4g} {unit[0]} is no reading of a sensor"
            if limit < most:
                words += f" whose range is {told * unit[1]:.4g} {unit[0]} (imu.{name}.range)"
            more = f"; {len(bad) - 1} more likewise" if len(bad) > 1 else ""
            raise DataError(f"{imu.table.place(row)}: {named[k]}: {words}{more}; check cell and unit")


def still_axes(imu, columns):
    """(field, text) about axes that say the same from the first row to the last, a sensor each.

    imu : ImuSeries;  columns : as of `check_imu`
    """
    n = len(imu.t_s)
    for name, values in (("gyro", imu.gyro), ("accelerometer", imu.accelerometer)):
        names = getattr(columns, name, None) or [f"{name} {axis}" for axis in "xyz"]
        still = [named for named, column in zip(names, values.T, strict=True) if (column == column[0]).all()]
        if still and n >= FEWEST_ROWS:
            field = f"data.imu.{name}" if hasattr(columns, name) else "data.imu"
            words = f"{', '.join(still)}: the same value in all {n} rows, to the last digit"
            yield field, f"{words}; what senses no noise measures no motion"


def check_way(truth):
    """Refuse a row of truth that no vehicle reaches from the one before. truth : TruthSeries"""
    dt_s, way = np.diff(truth.t_s), np.linalg.norm(np.diff(truth.r_e, axis=0), axis=1)
    bad = np.flatnonzero(way > JUMP + series.FAST * dt_s)
    if len(bad):
        k = int(bad[0])
        words = f"the position is {way[k]:.4g} m from that of the row before, {dt_s[k]:.4g} s earlier"
        fastest = f"expected {series.FAST:g} m/s at most"
        raise DataError(f"{truth.table.place(k + 1)}: {words}; {fastest}: check both rows")


def check_times(one, columns):
    """Refuse times that do not increase from row to row, and a single row.

    one : series with `table` and `t_s`;  columns : its section of `data`, or the name of a file
    """
    back = np.flatnonzero(~(np.diff(one.t_s) > 0.0))
    if len(back):
        row, name = int(back[0]) + 1, getattr(columns, "time", None)
        told = one.t_s if name is None else one.table.columns[name]
        factor = 1.0 if name is None else columns.time_unit.factor
        unit = UNITS.get(factor, "")
        now, before = (f"{value:.15g} {unit}".rstrip() for value in (told[row], told[row - 1]))
        wrap = _wrap(one.t_s, row, factor)
        raise DataError(
            f"{one.table.place(row)}: time {now} does not follow on {before} in the row before{wrap}"
        )
    if len(one.t_s) < 2:
        raise DataError(f"{one.table.file}: one row alone cannot be replayed")


def _wrap(t_s, row, factor):
    """Words about a counter that has begun anew at a row; nothing if it is none. factor : s, of its unit"""
    steps_s = np.diff(t_s[: row + 1])
    step_s = float(np.median(steps_s[steps_s > 0.0])) if (steps_s > 0.0).any() else 0.0
    lost_s = t_s[row - 1] + step_s - t_s[row]
    spans = {f"2^{bits} {unit}": 2.0**bits * tick for tick, unit in UNITS.items() for bits in COUNTERS}
    spans |= {f"the end of the {name}": span_s for name, span_s in SPANS.items()}
    for words, span_s in spans.items():
        if abs(lost_s - span_s) <= NEAR * step_s < 0.1 * span_s:
            added = f"{span_s / factor:.15g} {UNITS.get(factor, '')}".rstrip()
            return f": the clock wraps around at {words}; add {added} to the times from this line on"
    return ""
