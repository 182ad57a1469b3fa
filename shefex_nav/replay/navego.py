"""Matlab files as NaveGo (R. Gonzalez) saves them: one structure each, everything in SI and radians.

Fields, from the project's example of synthetic data: imu t, wb, fb, forward-right-down; gnss t, lat, lon, h,
vel north-east-down, stdm, stdv; truth t, lat, lon, h, vel, roll, pitch, yaw. Its rates are means since the
sample before, for they are made from differences of the reference.
"""

import numpy as np

from shefex_nav.replay import matlab_file, series
from shefex_nav.replay.series import ImuSeries, TruthSeries
from shefex_nav.scenario.data_table import DataError

PLACE = ("lat", "lon", "h")
VELOCITY = ("vel.0", "vel.1", "vel.2")


def read(_, files):
    """(ImuSeries, GnssSeries, TruthSeries or None) of the paths of the files."""
    table, _ = matlab_file.read(files["imu"], ("t", "wb", "fb"), vectors=("wb", "fb"))
    gyro, accelerometer = (table.stack([f"{name}.{k}" for k in range(3)]) for name in ("wb", "fb"))
    imu = ImuSeries(table, table.columns["t"], gyro, accelerometer, "rate")
    return imu, _gnss(files["gnss"]), _truth(files["truth"])


def lever_arm(path):
    """Lever arm that the file of the GNSS receiver states, (3,) m, or None."""
    _, others = matlab_file.read(path, ("t",), ("larm",))
    return np.ravel(others["larm"]).astype(float) if "larm" in others else None


def _gnss(path):
    table, others = matlab_file.read(path, ("t", *PLACE, "vel"), ("stdm", "stdv"), ("vel",))
    r_e = series.positions(table, PLACE, "geodetic")
    n = len(r_e)
    return series.gnss(
        table,
        table.columns["t"],
        r_e,
        series.velocities(table, VELOCITY, "ned", r_e),
        _sigma(path, "stdm", others, n),
        _sigma(path, "stdv", others, n),
    )


def _sigma(path, name, others, n):
    """Sigmas that a file states for all of its n fixes, (n, 3), or None."""
    if name not in others:
        return None
    given = np.asarray(others[name])
    if given.dtype.kind not in "fiu" or given.shape != (3,):
        raise DataError(f"{path}: field {name}: expected three numbers")
    return np.tile(given.astype(float), (n, 1))


def _truth(path):
    if path is None:
        return None
    table, _ = matlab_file.read(path, ("t", *PLACE, "vel", "roll", "pitch", "yaw"), vectors=("vel",))
    r_e = series.positions(table, PLACE, "geodetic")
    velocity = series.velocities(table, VELOCITY, "ned", r_e)
    return TruthSeries(table, table.columns["t"], r_e, velocity, table.stack(("roll", "pitch", "yaw")))
