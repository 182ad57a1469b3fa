"""A receiver that says the same position for a long time while the vehicle moves.

The filter notices that fix by fix (`onboard.navigation.integrity_gps`); here it is said of the data as a
whole, by what the inertial sensors sense meanwhile.
"""

import numpy as np

from shefex_nav.replay.dataset import NONSENSE

LONG_S = 5.0  # [E] shorter repetitions are common and harmless
SHAKEN = 1.0  # [E] m/s^2, standard deviation of the specific force that a vehicle at rest does not have


def longest(imu, fixes):
    """First and last time [s] and number of the fixes of the longest repetition in motion; None without one.

    imu : Increments;  fixes : GpsFix
    """
    found, begin = None, 0
    places = [fix.r_ea_e.tolist() if fix.valid else None for fix in fixes]
    said = [k for k, place in enumerate(places) if place is not None]
    for i, k in enumerate(said):
        if places[k] != places[said[begin]]:
            begin = i
        first_s, last_s = fixes[said[begin]].t_valid_s, fixes[k].t_valid_s
        if last_s - first_s > max(LONG_S, found[1] - found[0] if found else 0.0):
            found = first_s, last_s, i - begin + 1
    if found is None:
        return None
    inside = (imu.t_s > found[0]) & (imu.t_s <= found[1])
    dt_s = np.diff(imu.t_s, prepend=imu.t_s[0] - 1.0)[inside, None]
    felt = imu.dv_b[inside] / dt_s
    return found if len(felt) > 1 and np.linalg.norm(felt.std(axis=0)) > SHAKEN else None


def oddities(imu, fixes):
    """(field, text) to warn of."""
    found = longest(imu, fixes)
    if found is not None:
        first_s, last_s, count = found
        yield (
            "data.gnss",
            f"the position repeats itself to the last digit for {last_s - first_s:.1f} s, from "
            f"T{first_s:+.1f} s to T{last_s:+.1f} s ({count} fixes), while the IMU senses motion; "
            "the filter leaves it out",
        )
    strange = [fix for fix in fixes if fix.n_satellites == NONSENSE]
    if strange:
        text = f"the number of satellites of {len(strange)} fixes is none that there can be"
        yield "data.gnss.satellites", f"{text}; they count as fixes all the same"
