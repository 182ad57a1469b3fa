"""Text files as KF-GINS (i2Nav, Wuhan University) reads and writes them.

Columns, from the project's README, section 2.2: IMU time of week [s], increments of angle [rad] and of
velocity [m/s], forward-right-down; GNSS time, latitude, longitude [deg], height [m], sigmas north, east, down
[m], or, in files of thirteen columns, velocity north, east, down [m/s] before the sigmas of position and
velocity; truth week, time, latitude, longitude [deg], height [m], velocity north, east, down [m/s], roll,
pitch, heading [deg].
"""

import numpy as np

from shefex_nav.replay import series
from shefex_nav.replay.series import ImuSeries, TruthSeries
from shefex_nav.scenario.data_table import DataError, read_columns

PLACE = ("latitude", "longitude", "height")
VELOCITY = ("north velocity", "east velocity", "down velocity")
ANGLES = ("roll", "pitch", "heading")
TURN = ("x angle", "y angle", "z angle")
GAIN = ("x velocity", "y velocity", "z velocity")
SIGMA_R = ("north sigma", "east sigma", "down sigma")
SIGMA_V = ("north velocity sigma", "east velocity sigma", "down velocity sigma")
DEGREE = np.pi / 180.0
LAST_WEEK = 10_000  # of GPS, in the year 2171


def read(_, files):
    """(ImuSeries, GnssSeries, TruthSeries or None) of the paths of the files."""
    table = read_columns(files["imu"], ("time", *TURN, *GAIN), torn_end=True)
    imu = ImuSeries(table, table.columns["time"], table.stack(TURN), table.stack(GAIN), "increment")
    return imu, _gnss(files["gnss"]), _truth(files["truth"])


def _gnss(path):
    long = ("time", *PLACE, *VELOCITY, *SIGMA_R, *SIGMA_V)
    table = read_columns(path, ("time", *PLACE, *SIGMA_R), (long,), torn_end=True)
    r_e = series.positions(table, PLACE, "geodetic", DEGREE)
    has_velocity = VELOCITY[0] in table.columns
    return series.gnss(
        table,
        table.columns["time"],
        r_e,
        series.velocities(table, VELOCITY, "ned", r_e) if has_velocity else None,
        table.stack(SIGMA_R),
        table.stack(SIGMA_V) if has_velocity else None,
    )


def _truth(path):
    if path is None:
        return None
    table = read_columns(path, ("week", "time", *PLACE, *VELOCITY, *ANGLES), torn_end=True)
    week = table.columns["week"]
    bad = np.flatnonzero(~((week >= 0.0) & (week <= LAST_WEEK) & (week == np.rint(week))))
    if len(bad):
        words = f"expected a whole number of 0 to {LAST_WEEK}, got {week[bad[0]]:g}"
        raise DataError(f"{table.place(bad[0])}: week: {words}")
    r_e = series.positions(table, PLACE, "geodetic", DEGREE)
    velocity = series.velocities(table, VELOCITY, "ned", r_e)
    return TruthSeries(table, table.columns["time"], r_e, velocity, table.stack(ANGLES) * DEGREE)
