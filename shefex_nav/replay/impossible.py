"""Values in the files that no instrument gives, and times that run backwards: refused with their place.

A reading beyond what the sensor measures is no reading, but a broken cell. Where the scenario tells no range,
a bound stands that no sensor reaches.
"""

import numpy as np

from shefex_nav.scenario.data_table import DataError

BEYOND = 2.0  # [E] times the range that is told: a sensor that clips gives its range and little more
TURNS = 3000.0  # [E] rad/s, faster than shells spin (300 turns a second)
PULLS = 2e6  # [E] m/s^2, beyond what a sensor is shot with (100 000 gee)
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
        size = np.abs(values) / step_s
        bad = np.argwhere(~(size <= limit))
        if len(bad):
            row, k = bad[0]
            named = getattr(columns, name, None) or [f"{name} {axis}" for axis in "xyz"]
            words = f"{size[row, k] * unit[1]:.4g} {unit[0]} is no reading of a sensor"
            if limit < most:
                words += f" whose range is {told * unit[1]:.4g} {unit[0]} (imu.{name}.range)"
            more = f"; {len(bad) - 1} more likewise" if len(bad) > 1 else ""
            raise DataError(f"{imu.table.place(row)}: {named[k]}: {words}{more}; check cell and unit")


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
