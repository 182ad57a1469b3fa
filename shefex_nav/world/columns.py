"""What a flight tells of its truth, as columns: at the ticks of the on-board clock, and of the control."""

import numpy as np

from shefex_nav.clock import SAME_S, SAMPLES_PER_TICK, TICK_HZ
from shefex_nav.records import ControlSample, TruthSample

CONTROL_TICKS = 10  # between two records of the attitude control


def truth_of(trajectory, every, last=None):
    """TruthSample of arrays over the ticks every, 2 every ... of a Trajectory. last : tick; None: its last"""
    end = len(trajectory.t_s) if last is None else last * SAMPLES_PER_TICK + 1
    k = np.arange(every * SAMPLES_PER_TICK, end, every * SAMPLES_PER_TICK)
    return TruthSample(
        trajectory.t_s[k],
        trajectory.phase[k].astype(np.int64),
        *(column[k] for column in (trajectory.r_i, trajectory.v_i, trajectory.q_ib)),
        *(column[k] for column in (trajectory.omega_ib_b, trajectory.f_b, trajectory.angle_of_attack)),
    )


def control_samples(control, trajectory):
    """Of every tenth tick that has one, the last sample. ControlHistory or None -> ControlSample, arrays"""
    if control is None or not len(control.t_s):
        return None
    period_s = CONTROL_TICKS / TICK_HZ
    slot = np.ceil((control.t_s - trajectory.t_s[0] - SAME_S) / period_s)
    last = np.flatnonzero(np.diff(slot, append=np.inf))  # of each interval
    columns = control.t_s, control.pointing_error, control.torque_b, control.propellant_kg
    return ControlSample(*(column[last] for column in columns))
