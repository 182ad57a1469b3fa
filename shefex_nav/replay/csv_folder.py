"""A folder of CSVs whose columns, units and frames the replay scenario describes."""

import numpy as np

from shefex_nav.instruments import TABLE
from shefex_nav.replay import series
from shefex_nav.replay.series import ImuSeries, ReadingSeries, TruthSeries
from shefex_nav.scenario.data_table import DataError, read_csv

MOST_SATELLITES = 100  # that can be in view of one antenna; more is nonsense


def read(data, files):
    """Series of a schema_data.CsvData and the paths of its files.

    -> ImuSeries, GnssSeries, TruthSeries or None, {instrument: ReadingSeries}
    """
    given = {name: getattr(data, name, None) for name in TABLE}
    return (
        _imu(data.imu, files["imu"]),
        _gnss(data.gnss, files["gnss"]),
        _truth(data.truth, files["truth"]),
        {name: _readings(TABLE[name], one, files[name]) for name, one in given.items() if one is not None},
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
    table = read_csv(path, names + tuple(filter(None, (columns.valid, columns.satellites))))
    angle, height = columns.angle_unit.factor, columns.height
    r_e = series.positions(table, columns.position, columns.position_frame, angle, height)
    said = series.gnss(
        table,
        table.columns[columns.time] * columns.time_unit.factor,
        r_e,
        series.velocities(table, columns.velocity, columns.velocity_frame, r_e) if columns.velocity else None,
        table.stack(columns.position_sigma) if columns.position_sigma else None,
        table.stack(columns.velocity_sigma) if columns.velocity_sigma else None,
        table.columns[columns.valid] != 0.0 if columns.valid else None,
        horizontal=len(columns.position) == 2,
    )
    if columns.satellites is None:
        return said
    count = table.columns[columns.satellites]
    return said._replace(satellites=np.where((count >= 0) & (count <= MOST_SATELLITES), count, np.nan))


def _readings(instrument, columns, path):
    """ReadingSeries of an instrument and the section of its columns."""
    given = [one for one in instrument.data if getattr(columns, one.key) is not None]
    names = {one.key: _listed(getattr(columns, one.key)) for one in given}
    table = read_csv(path, (columns.time, *(name for listed in names.values() for name in listed)))
    fields = {}
    for one in given:
        told = table.stack(names[one.key])
        values = told * getattr(columns, f"{one.key}_unit").factor
        values = values if one.vector else values[:, 0]
        values = values if one.convert is None else one.convert(values)
        bad = [] if one.is_valid is None else np.flatnonzero(~one.is_valid(values))
        if len(bad):
            words = f"{names[one.key][0]}: {one.wanted}, got {told[bad[0], 0]:g}"
            raise DataError(f"{table.place(bad[0])}: {words}")
        fields[one.field] = values
    return ReadingSeries(table, table.columns[columns.time] * columns.time_unit.factor, fields)


def _listed(names):
    return (names,) if isinstance(names, str) else names


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
