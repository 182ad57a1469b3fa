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
    table = read_csv(path, (columns.time, *columns.gyro, *columns.accelerometer), torn_end=True)
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
    names += tuple(filter(None, (columns.valid, columns.satellites)))
    table = read_csv(path, names, flag=columns.valid, torn_end=True)
    valid = table.columns[columns.valid] != 0.0 if columns.valid else None
    if valid is not None:
        kept = _in_time(table.columns[columns.time], valid)
        table, valid = table.only(kept), valid[kept]
    angle, height = columns.angle_unit.factor, columns.height
    r_e = series.positions(table, columns.position, columns.position_frame, angle, height, valid)
    said = series.gnss(
        table,
        table.columns[columns.time] * columns.time_unit.factor,
        r_e,
        series.velocities(table, columns.velocity, columns.velocity_frame, r_e, valid)
        if columns.velocity
        else None,
        table.stack(columns.position_sigma) if columns.position_sigma else None,
        table.stack(columns.velocity_sigma) if columns.velocity_sigma else None,
        valid,
        horizontal=len(columns.position) == 2,
    )
    if columns.satellites is None:
        return said
    count = table.columns[columns.satellites]
    count = np.where(~said.valid & ~np.isfinite(count), 0.0, count)  # no fix: nothing need be said of them
    return said._replace(satellites=np.where((count >= 0) & (count <= MOST_SATELLITES), count, np.nan))


def _in_time(t, valid):
    """Rows to be read: all fixes, and of the others those whose time lies between the rows around them.

    A receiver without a fix may not know the time. t : (M,);  valid : (M,) bool -> (M,) bool
    """
    kept, before = valid.copy(), -np.inf
    after = np.minimum.accumulate(np.where(valid, t, np.inf)[::-1])[::-1]
    for k in range(len(t)):
        kept[k] = valid[k] or before < t[k] < after[k]
        before = t[k] if kept[k] else before
    return kept


def _readings(instrument, columns, path):
    """ReadingSeries of an instrument and the section of its columns."""
    given = [one for one in instrument.data if getattr(columns, one.key) is not None]
    names = {one.key: _listed(getattr(columns, one.key)) for one in given}
    table = read_csv(
        path, (columns.time, *(name for listed in names.values() for name in listed)), torn_end=True
    )
    fields = {}
    for one in given:
        told = table.stack(names[one.key])
        values = told * getattr(columns, f"{one.key}_unit").factor
        values = values if one.vector else values[:, 0]
        values = values if one.convert is None else one.convert(values)
        good = np.ones(len(told), bool) if one.is_valid is None else one.is_valid(values)
        bad = np.argwhere(~good.reshape(len(told), -1))
        if len(bad):
            words = f"{names[one.key][bad[0, 1]]}: {one.wanted}, got {told[tuple(bad[0])]:g}"
            raise DataError(f"{table.place(bad[0, 0])}: {words}")
        fields[one.field] = values
    return ReadingSeries(table, table.columns[columns.time] * columns.time_unit.factor, fields)


def _listed(names):
    return (names,) if isinstance(names, str) else names


def _truth(columns, path):
    if columns is None:
        return None
    table = read_csv(
        path, (columns.time, *columns.position, *columns.velocity, *columns.attitude), torn_end=True
    )
    angle = columns.angle_unit.factor
    r_e = series.positions(table, columns.position, columns.position_frame, angle)
    return TruthSeries(
        table,
        table.columns[columns.time] * columns.time_unit.factor,
        r_e,
        series.velocities(table, columns.velocity, columns.velocity_frame, r_e),
        table.stack(columns.attitude) * angle,
    )
