"""Runs of the made-up mission in memory, for the tests of figures, page and export."""

from functools import lru_cache

import numpy as np
import synthetic_run

from shefex_nav import records as rec
from shefex_nav.geometry import rotation
from shefex_nav.log.run_data import RunDataBuilder

MISSION = synthetic_run.mission()


@lru_cache(maxsize=2)
def gathered(options):
    """RunData of synthetic_run.Options."""
    return of_records(MISSION, [*synthetic_run.simulate(options), synthetic_run.summary(options)])


def of_records(mission, records):
    """RunData of some records."""
    builder = RunDataBuilder(mission)
    for record in records:
        builder.add(record)
    return builder.build()


def frame_truth(number, t_s, **changes):
    truth = rec.FrameTruth(
        number, t_s, np.array([1.0, 0, 0, 0]), 0.01, 2.0, 1.0, True, np.zeros(0, int), np.zeros((0, 2))
    )
    return truth._replace(**changes)


def star_fix(number, t_s, error_c=(0.0, 0.0, 0.0), reason=rec.Reason.NONE):
    """Fix of a frame whose true attitude is the unit quaternion: truth = estimate * exp(error)."""
    q_ic = rotation.quat_from_rotvec(-np.array(error_c, float))
    none = np.zeros(0, int)
    empty = rec.Detections(np.zeros((0, 2)), np.zeros(0), none, none, np.zeros((0, 2, 2)))
    P_c = np.diag([1e-4, 1e-4, 1e-3]) ** 2
    return rec.StarFix(
        number, t_s, t_s + 0.05, int(reason), q_ic, P_c, empty, np.zeros(0, int), 0.1, 5.0, 0.1, False, False
    )
