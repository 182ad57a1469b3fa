"""pyins over NaveGo's drive: run_feedback_filter with 15 states, its covariance every 0.2 s.

    python pyins_worker.py TASK.json     prints one JSON object: rms of the errors, error over sigma, seconds

TASK.json: the three files, first fix and step between fixes, what the filter assumes, from when to judge.
Units are pyins' own: deg for attitude and places, SI for the models of the IMU.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
from pyins import filters, inertial_sensor, measurements, strapdown, transform
from scipy.io import loadmat

COVARIANCE_S = 0.2
PLACE, VELOCITY, ATTITUDE = ["lat", "lon", "alt"], ["VN", "VE", "VD"], ["roll", "pitch", "heading"]
SIGMAS = {"position": ["north", "east", "down"], "velocity": VELOCITY, "attitude": ATTITUDE}


def main(task):
    (imu, dt_s), gnss, truth = read_imu(task["imu"]), read(task["gnss"], "gnss"), read(task["truth"], "ref")
    first = truth.iloc[0]
    increments = strapdown.compute_increments_from_imu(imu, "increment")
    fixes = gnss[(np.abs((gnss.index - task["first_s"] + 0.5) % task["every_s"] - 0.5)) < 1e-3]
    follow(task, increments.iloc[: int(3 / dt_s)], fixes.iloc[:2], first)  # it compiles
    began = time.process_time(), time.perf_counter()
    result = follow(task, increments, fixes, first)
    taken = {"process_s": time.process_time() - began[0], "wall_s": time.perf_counter() - began[1]}
    print(json.dumps({**judge(result, truth, task["from_s"]), **taken, "data_s": imu.index[-1]}))


def follow(task, increments, fixes, first):
    """The filter over increments and fixes from the state of the reference at the start."""
    gyro, accel = (inertial_sensor.EstimationModel(**task[name]) for name in ("gyro", "accelerometer"))
    seen = [
        measurements.Position(fixes[PLACE], np.array(task["position_sd_m"])),
        measurements.NedVelocity(fixes[VELOCITY], np.array(task["velocity_sd_m_s"])),
    ]
    return filters.run_feedback_filter(
        first, *task["start_sd"], increments, gyro, accel, measurements=seen, time_step=COVARIANCE_S
    )


def judge(result, truth, from_s):
    """RMS errors of position NED [m], velocity [m/s], attitude [deg], and of error over sigma, nine each."""
    error = transform.compute_state_difference(result.trajectory, truth)
    error = error[error.index > from_s]
    out = {}
    for name, columns in SIGMAS.items():
        sigma = result.trajectory_sd[columns]
        over = (error[columns] / sigma).dropna()
        out[name] = np.sqrt((error[columns] ** 2).mean()).tolist()
        out[f"{name}_over_sigma"] = np.sqrt((over**2).mean()).tolist()
    return out


def structure(path):
    """The one structure in a Matlab file."""
    return next(value for key, value in loadmat(path, simplify_cells=True).items() if key[:2] != "__")


def read_imu(path):
    """Samples as increments: NaveGo's rates are means since the sample before."""
    data = structure(path)
    t_s = np.ravel(data["t"])
    dt_s = np.diff(t_s, prepend=t_s[0] - (t_s[1] - t_s[0]))[:, None]
    values = np.hstack([data["wb"] * dt_s, data["fb"] * dt_s])
    columns = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
    return pd.DataFrame(values, index=t_s, columns=columns), float(np.median(dt_s))


def read(path, kind):
    """Place, velocity and, of the reference, attitude; index is time."""
    data = structure(path)
    place = [np.rad2deg(np.ravel(data[name])) for name in ("lat", "lon")] + [np.ravel(data["h"])]
    table = dict(zip(PLACE, place, strict=True)) | dict(zip(VELOCITY, np.asarray(data["vel"]).T, strict=True))
    if kind == "ref":
        angles = [np.rad2deg(np.ravel(data[name])) for name in ("roll", "pitch", "yaw")]
        table |= dict(zip(ATTITUDE, angles, strict=True))
    return pd.DataFrame(table, index=np.ravel(data["t"]))


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text()))
