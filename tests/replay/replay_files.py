"""Small data sets and replay scenarios, written as files."""

import numpy as np
from turntable import HEIGHT, LATITUDE, LONGITUDE

from shefex_nav.environment import ephemeris

EPOCH = "2020-06-01T12:00:00"
RATE = ephemeris.ERA_RATE
SCENARIO = """
mission: {{name: small, epoch: 2020-06-01T12:00:00Z}}
data:
  {data}
gnss: {gnss}
alignment: {alignment}
imu:
  gyro: {{bias: 0.01 deg/h, in_run_bias: 0 deg/h, in_run_bias_time: 300 s, random_walk: 0.001 deg/sqrt(h)}}
  accelerometer:
    {{bias: 10 ugee, in_run_bias: 0 ugee, in_run_bias_time: 300 s, random_walk: 0.001 m/s/sqrt(h)}}
"""
CSV = """format: csv
  imu:
    file: imu.csv
    rate: {rate:g} Hz
    time: t
    gyro: [wx, wy, wz]
    gyro_unit: rad/s
    accelerometer: [fx, fy, fz]
    accelerometer_unit: m/s2
  gnss: {{file: gnss.csv, time: t, position: [lat, lon, h], velocity: [vn, ve, vd]}}
  truth:
    file: truth.csv
    time: t
    position: [lat, lon, h]
    velocity: [vn, ve, vd]
    attitude: [roll, pitch, heading]
"""
REFERENCE = "{method: reference, level: 0.1 deg, azimuth: 0.1 deg, position: 1 m, velocity: 0.01 m/s}"
NOISE = "{position_noise: [1 m, 1 m, 1 m], velocity_noise: [0.01 m/s, 0.01 m/s, 0.01 m/s]}"


def write_csv(path, columns, rows):
    """A CSV with full precision."""
    lines = [",".join(columns), *(",".join(f"{value:.17g}" for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def scenario(folder, data, gnss=NOISE, alignment=REFERENCE):
    """Path of a replay scenario."""
    path = folder / "small.yaml"
    path.write_text(SCENARIO.format(data=data, gnss=gnss, alignment=alignment), encoding="utf-8")
    return path


def turntable_folder(folder, table, make_increments, rate_hz, length_s):
    """CSVs of a turntable with ideal sensors, and their scenario. -> path of the scenario"""
    t_s = np.arange(round(length_s * rate_hz) + 1) / rate_hz
    turn, gain = make_increments(table, t_s, RATE)
    rows = np.column_stack([t_s[1:], turn * rate_hz, gain * rate_hz])
    first = np.concatenate([[t_s[0]], rows[0, 1:]])  # before the start; its content does not matter
    write_csv(folder / "imu.csv", ("t", "wx", "wy", "wz", "fx", "fy", "fz"), [first, *rows])
    place = (np.degrees(LATITUDE), np.degrees(LONGITUDE), HEIGHT)
    times_s = np.arange(0.5, length_s, 1.0)  # heights a micrometre apart: a fix to the last bit is no new fix
    fixes = [(t, *place[:2], HEIGHT + 1e-6 * k, 0.0, 0.0, 0.0) for k, t in enumerate(times_s)]
    write_csv(folder / "gnss.csv", ("t", "lat", "lon", "h", "vn", "ve", "vd"), fixes)
    coarse_s = np.arange(round(length_s * 20.0) + 1) / 20.0
    angles = np.degrees(table.angles(coarse_s))
    truth = [(t, *place, 0.0, 0.0, 0.0, *angle) for t, angle in zip(coarse_s, angles, strict=True)]
    columns = ("t", "lat", "lon", "h", "vn", "ve", "vd", "roll", "pitch", "heading")
    write_csv(folder / "truth.csv", columns, truth)
    return scenario(folder, CSV.format(rate=rate_hz))
