"""A folder of CSVs whose columns, units and frames the replay scenario describes."""

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.replay import series
from shefex_nav.replay.series import ImuSeries, PressureSeries, TruthSeries
from shefex_nav.replay.table import DataError, read_csv


def read(data, files):
    """(ImuSeries, GnssSeries, TruthSeries or None, PressureSeries or None) of a schema.CsvData and the paths
    of its files."""
    return (
        _imu(data.imu, files["imu"]),
        _gnss(data.gnss, files["gnss"]),
        _truth(data.truth, files["truth"]),
        _barometer(data.barometer, files["barometer"]),
    )


def _imu(columns, path):
    table = read_csv(path, (columns.time, *columns.gyro, *columns.accelerometer))
    return ImuSeries(
        table,
        table.columns[columns.time] * columns.time_unit.factor,
        table.stack(columns.gyro) * columns.gyro_unit.factor,
        table.stack(columns.accelerometer) * columns.accelerometer_unit.factor,
        columns.gyro_unit.kind,
    )


def _gnss(columns, path):
    optional = (columns.velocity, columns.position_sigma, columns.velocity_sigma)
    names = (columns.time, *columns.position, *(name for triple in optional for name in triple or ()))
    table = read_csv(path, names + ((columns.valid,) if columns.valid else ()))
    angle, height = columns.angle_unit.factor, columns.height
    r_e = series.positions(table, columns.position, columns.position_frame, angle, height)
    return series.gnss(
        table,
        table.columns[columns.time] * columns.time_unit.factor,
        r_e,
        series.velocities(table, columns.velocity, columns.velocity_frame, r_e) if columns.velocity else None,
        table.stack(columns.position_sigma) if columns.position_sigma else None,
        table.stack(columns.velocity_sigma) if columns.velocity_sigma else None,
        table.columns[columns.valid] != 0.0 if columns.valid else None,
        horizontal=len(columns.position) == 2,
    )


def _barometer(columns, path):
    if columns is None:
        return None
    name = columns.pressure or columns.height
    table = read_csv(path, (columns.time, name))
    told = table.columns[name]
    if columns.pressure is None:
        pressure = np.array([atmosphere.us76(height)[1] for height in told])
    else:
        pressure = told * columns.pressure_unit.factor
    bad = np.flatnonzero(~(pressure > 0.0))
    if len(bad):
        words = f"{name}: a static pressure is greater than zero, got {told[bad[0]]:g}"
        raise DataError(f"{table.place(bad[0])}: {words}")
    return PressureSeries(table, table.columns[columns.time] * columns.time_unit.factor, pressure)


def _truth(columns, path):
    if columns is None:
        return None
    table = read_csv(path, (columns.time, *columns.position, *columns.velocity, *columns.attitude))
    angle = columns.angle_unit.factor
    r_e = series.positions(table, columns.position, columns.position_frame, angle)
    return TruthSeries(
        table,
        table.columns[columns.time] * columns.time_unit.factor,
        r_e,
        series.velocities(table, columns.velocity, columns.velocity_frame, r_e),
        table.stack(columns.attitude) * angle,
    )
