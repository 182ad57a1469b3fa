"""What frames really show, and what the star tracker on board made of them, as a table (CSV).

Quaternions are q_ic, scalar first: they take components in camera axes to the ICRS.
"""

import csv

import numpy as np

from shefex_nav.files import whole
from shefex_nav.frames.header import utc
from shefex_nav.records import Reason

COLUMNS = (
    "file", "number", "t_s", "utc", "exposure_s", "gain_db",
    *(f"q_ic_{part}" for part in "wxyz"),  # true, at t_s
    *(f"q_ic_mean_{part}" for part in "wxyz"),  # true, mean of the exposure
    *(f"omega_c_{axis}_rad_s" for axis in "xyz"),  # true rate of the camera, mean of the exposure, its axes
    *(f"v_i_{axis}_m_s" for axis in "xyz"),  # relative to the centre of the Earth
    "answer",  # of the star tracker on board: fix, or the reason why there is none
    *(f"fix_q_ic_{part}" for part in "wxyz"),
    *(f"fix_sigma_{axis}_rad" for axis in "xyz"),  # 1 sigma of the noise, camera axes
    "fix_residual_px", "objects", "stars",
)  # fmt: skip


def write(path, rows):
    """Write a table of rows, each of `row`."""
    with whole(path) as half, half.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(rows)


def row(name, shot, epoch_utc):
    """Values of COLUMNS of a Shot in the file `name`; empty where there is none."""
    frame, truth, fix = shot.frame, shot.truth, shot.fix
    solved = fix.reason == Reason.NONE
    nothing = [""] * 8
    answer = [*fix.q_ic.tolist(), *np.sqrt(np.diag(fix.P_c)).tolist(), fix.residual_px] if solved else nothing
    return [
        name, frame.number, frame.t_valid_s, utc(epoch_utc, frame.t_valid_s) + "Z", frame.exposure_s,
        frame.gain_db, *truth.q_ic.tolist(), *shot.q_mean.tolist(), *shot.omega_c.tolist(),
        *shot.v_i.tolist(), "fix" if solved else Reason(fix.reason).name.lower(), *answer,
        len(fix.detections.flux_dn), int((fix.hip > 0).sum()),
    ]  # fmt: skip
