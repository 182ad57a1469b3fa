"""Normalised innovations squared (NIS) of each sensor: their mean, and where it should lie.

If the filter is right, innovations are white and each NIS is chi-square distributed with as many degrees of
freedom as the measurement has rows; so is their sum. All that met the gate count, refused ones too.
"""

from functools import lru_cache

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.instruments import TABLE
from shefex_nav.report import sensor_use
from shefex_nav.report.navigation_errors import chi2_bounds
from shefex_nav.report.sizes import number
from shefex_nav.scenario import document

FIXES = "gps_position", "gps_velocity"
LEVEL = 99.0  # %, of the interval in which the mean should lie


def summarise(gates, begin_s=-np.inf, text=""):
    """{sensor: NIS} of a sequence of GateResult from a mission time on; None of a sensor without any.

    text : the scenario of the run, YAML; "" if it is not known
    NIS: mean, dof (of the first), per_dof (sum over the sum of degrees of freedom), samples, rejected,
    interval of the mean, level_percent, and whether errors of the sensor last (`errors_last`, `fixes_last`).
    """
    met = {name: [] for name in sorted({gate.sensor for gate in gates})}
    for gate in gates:
        if gate.dof and np.isfinite(gate.nis) and gate.t_valid_s >= begin_s - SAME_S:
            met[gate.sensor].append(gate)
    fixes = fixes_last(text)
    return {name: _of_sensor(some, errors_last(name) or name in fixes) for name, some in met.items()}


@lru_cache(maxsize=4)
def fixes_last(text):
    """Measurements of GPS whose errors last and are noise to the filter: names, () if there are none.

    text : YAML of a scenario, or of a replay
    """
    try:
        tree = document.parse(text, "").tree
    except document.BadText:
        return ()
    said = [tree.get(name) for name in ("navigation", "gps", "gnss")]
    navigation, gps, gnss = (section if isinstance(section, dict) else {} for section in said)
    if navigation.get("gps", "loose") != "loose":
        return ()
    share = str(gnss.get("lasting_share") or 0).split()[0]
    return FIXES if any((gps.get("errors") or {}).values()) or share.strip("0.") else ()


def _of_sensor(met, lasts):
    if not met:
        return None
    total, dof, n = float(sum(gate.nis for gate in met)), int(sum(gate.dof for gate in met)), len(met)
    low, high = chi2_bounds(dof, LEVEL / 100.0)
    return {
        "mean": total / n,
        "dof": int(met[0].dof),
        "per_dof": total / dof,
        "samples": n,
        "rejected": sum(not gate.accepted for gate in met),
        "interval": [float(low / n), float(high / n)],
        "level_percent": LEVEL,
        "errors_last": lasts,
    }


def expected_per_dof(get, sensor):
    """Interval of `per_dof` if the sigmas are right: low, high; None where nothing is known.

    get : function that gives the value at a dotted path of a summary
    """
    mean, per_dof, interval = (
        get(f"navigation.nis.{sensor}.{key}") for key in ("mean", "per_dof", "interval")
    )
    if not mean or not interval or None in interval:
        return None
    return tuple(end * per_dof / mean for end in interval)


def errors_last(sensor):
    """Whether the errors of a sensor last from one measurement to the next: its NIS is below what is said."""
    return sensor in TABLE and bool(TABLE[sensor].errors_last)


def rows(found):
    """(name, text) of `summarise`, for the table."""
    for sensor, nis in found.items():
        if not nis:
            continue
        low, high = nis["interval"]
        words = f"{low:.2f} to {high:.2f} expected if the sigmas are right"
        if nis.get("errors_last") and sensor in FIXES:  # one does not show what it shares with the next
            words = f"up to {high:.2f} expected if the sigmas are right, less for its errors that last"
        elif errors_last(sensor):
            words = f"below {nis['dof']} where its sigmas are right, for its errors last"
        name = f"NIS, {sensor_use.named(sensor)}"
        yield name, f"{number(nis['mean'], 2)}, mean of {nis['samples']}; {words}"
