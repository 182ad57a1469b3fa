"""Matlab files as NaveGo (R. Gonzalez) saves them: one structure each, everything in SI and radians.

Fields, from the project's example of synthetic data: imu t, wb, fb, forward-right-down; gnss t, lat, lon, h,
vel north-east-down, stdm, stdv; truth t, lat, lon, h, vel, roll, pitch, yaw. Its rates are means since the
sample before, for they are made from differences of the reference. A process of its own (`matlab_child`)
reads the files, which a damaged one may crash.
"""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np

from shefex_nav.files import from_json
from shefex_nav.replay import series
from shefex_nav.replay.matlab_child import FIELD, KINDS, REFUSED
from shefex_nav.replay.series import ImuSeries, TruthSeries
from shefex_nav.scenario.data_table import DataError, Table, missing, refuse_infinite
from shefex_nav.scenario.quantity import quoted

PLACE = ("lat", "lon", "h")
VELOCITY = ("vel.0", "vel.1", "vel.2")


def read(_, files):
    """(ImuSeries, GnssSeries, TruthSeries or None) of the paths of the files."""
    table, _ = read_structure(files["imu"], ("t", "wb", "fb"), vectors=("wb", "fb"))
    gyro, accelerometer = (table.stack([f"{name}.{k}" for k in range(3)]) for name in ("wb", "fb"))
    imu = ImuSeries(table, table.columns["t"], gyro, accelerometer, "rate")
    return imu, _gnss(files["gnss"]), _truth(files["truth"])


def lever_arm(path):
    """Lever arm that the file of the GNSS receiver states, (3,) m, or None."""
    _, others = read_structure(path, ("t",), ("larm",))
    return np.ravel(others["larm"]).astype(float) if "larm" in others else None


def _gnss(path):
    table, others = read_structure(path, ("t", *PLACE, "vel"), ("stdm", "stdv"), ("vel",))
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
    table, _ = read_structure(path, ("t", *PLACE, "vel", "roll", "pitch", "yaw"), vectors=("vel",))
    r_e = series.positions(table, PLACE, "geodetic")
    velocity = series.velocities(table, VELOCITY, "ned", r_e)
    return TruthSeries(table, table.columns["t"], r_e, velocity, table.stack(("roll", "pitch", "yaw")))


CHILD = Path(__file__).with_name("matlab_child.py")
LONGEST_S = 300.0


def read_structure(path, names, optional=(), vectors=()):
    """Table of the fields `names` of the one structure in a Matlab file, and its `optional` ones as they are.

    vectors : fields of N rows and three columns, which become three columns, `name.0` to `name.2`; the others
        have one

    Returns
    -------
    Table, {name: array} of the optional fields of numbers that are there
    """
    kinds, fields = _structure(path, names, optional)
    problems = [f"{path}: {missing(name, list(kinds), 'field')}" for name in names if name not in kinds]
    if problems:
        raise DataError("\n".join(problems))
    columns = {}
    for name in names:
        value = fields.get(name)
        if value is None or value.ndim not in (1, 2) or not value.size:
            raise DataError(
                f"{path}: field {name}: expected a column of numbers, got {_found(kinds[name], value)}"
            )
        if value.shape[1:] != ((3,) if name in vectors else ()):
            wanted, got = "N x 3" if name in vectors else "N", " x ".join(map(str, value.shape))
            raise DataError(f"{path}: field {name}: expected {wanted} numbers, a row a sample, got {got}")
        for k, column in enumerate([value] if value.ndim == 1 else value.T):
            columns[f"{name}.{k}" if value.ndim == 2 else name] = np.array(column)
    _same_length(path, columns)
    table = Table(path, columns, None)
    refuse_infinite(table)
    return table, {name: fields[name] for name in optional if name in fields}


def _structure(path, names, optional):
    """{field: name of its dtype}, and {field: (...) float64} of those asked for, of the one structure."""
    command = [sys.executable, "-P", str(CHILD), str(path), *names, *optional]
    try:
        how = {"capture_output": True, "check": False, "start_new_session": True}  # Ctrl-C is not for it
        done = subprocess.run(command, timeout=LONGEST_S, **how)
    except subprocess.TimeoutExpired:
        raise DataError(f"{path}: cannot be read as a Matlab file within {LONGEST_S:g} s") from None
    if done.returncode == REFUSED:
        raise DataError(f"{path}: {done.stderr.decode(errors='replace').strip().splitlines()[-1]}")
    if done.returncode:
        raise DataError(f"{path}: is damaged, or no Matlab file: the program that reads it crashed")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        kinds = from_json(str(archive[KINDS]))
        fields = {name.removeprefix(FIELD): archive[name] for name in archive.files if name != KINDS}
    if isinstance(kinds, int):
        raise DataError(f"{path}: expected one structure with {', '.join(names)}, found {kinds}")
    return kinds, fields


def _found(kind, value):
    """Words for a field that is no column of numbers."""
    if value is None:
        return quoted(kind)
    if not value.size:
        return "none"
    return "a single one" if value.ndim == 0 else f"{value.ndim} dimensions"


def _same_length(path, columns):
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError(
            f"{path}: fields differ in length: {', '.join(f'{k} {n}' for k, n in lengths.items())}"
        )
