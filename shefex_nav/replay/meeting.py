"""Do fixes and IMU meet in time? A GNSS whose times are in another unit would be used by nobody."""

import numpy as np

from shefex_nav.replay import dataset
from shefex_nav.scenario.data_table import DataError

FEWEST = 5  # valid fixes, of which something can be said
FEW = 2  # fixes within the times of the IMU that are next to none
MOST = 0.5  # [E] of the fixes, that meet the IMU if another unit is right
UNITS = {**dataset.UNITS, 60.0: "min"}  # factor to seconds: name


def check(scenario, data):
    """(field, text) to warn of, a list; DataError if another unit fits. ReplayScenario, Dataset"""
    t_s = np.array([fix.t_valid_s for fix in data.fixes if fix.valid])
    begin_s, end_s = float(data.imu.t_s[0]), float(data.imu.t_s[-1])
    if len(t_s) < FEWEST or _within(t_s, begin_s, end_s) >= FEW:
        return []
    words = (
        f"{_within(t_s, begin_s, end_s)} of {len(t_s)} valid fixes lie within the times of the IMU, "
        f"{begin_s:.6g} to {end_s:.6g} s; they are from {t_s.min():.6g} to {t_s.max():.6g} s"
    )
    columns = scenario.data.gnss if scenario.data.format == "csv" else None
    told = 1.0 if columns is None else columns.time_unit.factor
    for factor, name in UNITS.items():
        ratio = factor / told
        if ratio != 1.0 and _within(t_s * ratio, begin_s, end_s) >= max(MOST * len(t_s), FEW):
            field = "data.gnss" if columns is None else "data.gnss.time_unit"
            raise DataError(f"{field}: {words}; they fit as {name}")
    return [("data.gnss", f"{words}. The others are not used: check times and units")]


def _within(t_s, begin_s, end_s):
    return int(((t_s >= begin_s) & (t_s <= end_s)).sum())
