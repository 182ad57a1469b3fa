"""The truth in a log of this program, with its phases and events."""

import re

import numpy as np

from shefex_nav.geometry import frames, rotation
from shefex_nav.log import reader
from shefex_nav.scenario.data_table import DataError, Table
from shefex_nav.trajectory import placing
from shefex_nav.trajectory.rows import Attitudes, Rows, ascending
from shefex_nav.world.flight.given import KnownPhases

OF_FLIGHT = re.compile(
    r"lift_off|rail_exit|max_dynamic_pressure|apogee|entry|altitude_\d+km|impact|parachute"
    r"|(ignition|burn_out|separation)_\d+"
)
ULP_M, ULP_M_S = 1e-9, 1e-12  # rounding of what a log holds


def read(given, earth):
    """Rows of a scenario.trajectory.Log."""
    data = reader.read(given.file)
    truth = data.truth
    table = Table(given.file, {}, None)
    if not len(truth.t_s):
        raise DataError(f"{given.file}: the log has no truth; expected that of a simulated flight")
    ascending(table, truth.t_s)
    r_i, v_i, q_ib = truth.r_i, truth.v_i, truth.q_ib
    if not _same(data.mission.earth, earth):  # the place over the Earth is kept
        C_ii = frames.dcms_ie(earth, truth.t_s) @ frames.dcms_ie(data.mission.earth, truth.t_s).transpose(
            0, 2, 1
        )
        over = v_i - np.cross(frames.omega_ie_i(data.mission.earth), r_i)
        r_i = placing.rotated(C_ii, r_i)
        v_i = placing.rotated(C_ii, over) + np.cross(frames.omega_ie_i(earth), r_i)
        C_ib = C_ii @ placing.of_quaternions(q_ib)
        q_ib = np.array([rotation.quat_from_dcm(np.ascontiguousarray(one)) for one in C_ib])
    events = {one.name: one.t_s for one in data.events if OF_FLIGHT.fullmatch(one.name)}
    known = KnownPhases(truth.t_s, np.asarray(truth.phase), events)
    attitudes = Attitudes(table, truth.t_s, q_ib, 0.0)
    return Rows(table, truth.t_s, r_i, v_i, None, ULP_M, ULP_M_S, attitudes, known)


def _same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
