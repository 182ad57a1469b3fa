"""The series of the files on one time axis: t = 0 at the first IMU sample, body axes forward-right-down.

IMU samples become increments, one after the other without holes; fixes become records of the project.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry import wgs84
from shefex_nav.records import BarometerReading, GpsFix
from shefex_nav.replay import csv_folder, kf_gins, navego
from shefex_nav.replay.series import TruthSeries
from shefex_nav.replay.table import DataError

READERS = {"csv": csv_folder.read, "kf_gins": kf_gins.read, "navego": navego.read}
RATE_TOLERANCE = 0.02  # of the sampling rate that a scenario states
READING_RATE_TOLERANCE = 0.1  # likewise of a barometer, which need not keep time


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
    readings: tuple = ()  # of BarometerReading, in order of time


def read(scenario, files):
    """Dataset of a ReplayScenario and the paths of its files; DataError with what is wrong in them."""
    imu, gnss, truth, *others = READERS[scenario.data.format](scenario.data, files)
    pressures = others[0] if others else None
    if scenario.data.format == "navego":
        _same_lever_arm(scenario, files["gnss"])
    for one in (imu, gnss, truth, pressures):
        if one is not None:
            _ascending(one)
    start_s = imu.t_s[0]
    moved = (one and one._replace(t_s=one.t_s - start_s) for one in (imu, gnss, truth, pressures))
    imu, gnss, truth, pressures = moved
    end_s = imu.t_s[-1]
    for one in (gnss, truth, pressures):
        if one is not None and (one.t_s[0] > end_s or one.t_s[-1] < 0.0):
            words = f"covers {one.t_s[0]:g} s to {one.t_s[-1]:g} s after the first sample of the IMU"
            raise DataError(f"{one.table.file}: {words}, which ends at {end_s:g} s; are the clocks the same?")
    given = () if pressures is None else readings(pressures, scenario.barometer)
    return Dataset(increments(imu, scenario.data), fixes(gnss, scenario.gnss), truth, given)


def _same_lever_arm(scenario, path):
    """A file that states a lever arm must not be contradicted."""
    stated = navego.lever_arm(path)
    if stated is not None and not np.allclose(stated, scenario.gnss.lever_arm, atol=1e-3):
        arm = ", ".join(f"{value:g} m" for value in stated)
        raise DataError(f"{path}: field larm says [{arm}]; write gnss.lever_arm: [{arm}]")


def _ascending(one):
    """Times must increase from row to row."""
    back = np.flatnonzero(np.diff(one.t_s) <= 0.0)
    if len(back):
        row = int(back[0]) + 1
        words = f"time {one.t_s[row]:.6f} s does not follow on {one.t_s[row - 1]:.6f} s in the row before"
        raise DataError(f"{one.table.place(row)}: {words}")
    if len(one.t_s) < 2:
        raise DataError(f"{one.table.file}: one row alone cannot be replayed")


def increments(imu, data):
    """Increments of an ImuSeries, in body axes.

    data : schema.DataBlock: axes, kind of the samples, gaps that are bridged by interpolation
    """
    turn, gain = (body_axes(values, data.axes) for values in (imu.gyro, imu.accelerometer))
    dt_s = np.diff(imu.t_s)
    step_s = float(np.median(dt_s))
    stated = getattr(data.imu, "rate", None)
    if stated is not None and abs(step_s * stated - 1.0) > RATE_TOLERANCE:
        raise DataError(
            f"{imu.table.file}: has {1.0 / step_s:.4g} samples a second, data.imu.rate says {stated:g}"
        )
    longest = int(np.argmax(dt_s))
    if dt_s[longest] > max(data.longest_gap, 1.5 * step_s):
        words = f"no sample for {dt_s[longest]:.4g} s before this row; data.longest_gap allows"
        raise DataError(f"{imu.table.place(longest + 1)}: {words} {data.longest_gap:g} s")
    if imu.kind == "increment":  # as rates: an increment is of its own sample, also after a gap
        own_s = np.where(dt_s > 1.5 * step_s, step_s, dt_s)
        length_s = np.concatenate([[step_s], own_s])[:, None]
        turn, gain = turn / length_s, gain / length_s
    t_s, turn, gain, bridged = _without_holes(imu.t_s, turn, gain, step_s)
    dt_s = np.diff(t_s)[:, None]
    if imu.kind == "rate" and data.samples == "instant":
        turn[1:], gain[1:] = 0.5 * (turn[1:] + turn[:-1]), 0.5 * (gain[1:] + gain[:-1])
    dtheta_b, dv_b = np.zeros_like(turn), np.zeros_like(gain)
    dtheta_b[1:], dv_b[1:] = turn[1:] * dt_s, gain[1:] * dt_s
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


def _without_holes(t_s, turn, gain, step_s):
    """Rates with interpolated samples where some are missing. -> times, (N, 3), (N, 3), (N,) bool"""
    missing = np.maximum(np.rint(np.diff(t_s) / step_s).astype(int) - 1, 0)
    if not missing.any():
        return t_s, turn.copy(), gain.copy(), np.zeros(len(t_s), dtype=bool)
    ends = np.concatenate([[0], np.cumsum(missing + 1)])  # where the samples of the file go
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
    out = []
    for k in _chosen(gnss.t_s, settings).tolist():
        latitude, longitude, _ = wgs84.geodetic_from_ecef(gnss.r_e[k])
        C_en = wgs84.dcm_en(latitude, longitude)
        has_velocity, valid = gnss.v_e is not None, bool(gnss.valid[k])
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
                n_satellites=0,
                pdop=np.nan,
                reason="" if valid else "marked as not valid",
                horizontal=gnss.horizontal,
            )
        )
    return out


def readings(pressures, settings):
    """BarometerReading of a PressureSeries; settings : scenario.barometer.Barometer. -> tuple"""
    step_s = float(np.median(np.diff(pressures.t_s)))
    if abs(step_s * settings.rate - 1.0) > READING_RATE_TOLERANCE:
        words = f"has {1.0 / step_s:.4g} readings a second, barometer.rate says {settings.rate:g}"
        raise DataError(f"{pressures.table.file}: {words}")
    at_limit = (pressures.pressure <= settings.lowest) | (pressures.pressure >= settings.highest)
    return tuple(
        BarometerReading(t_s, t_s + settings.latency, value, limit)
        for t_s, value, limit in zip(
            pressures.t_s.tolist(), pressures.pressure.tolist(), at_limit.tolist(), strict=True
        )
    )


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
