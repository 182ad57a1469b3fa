"""An air that is too far from the standard atmosphere for a filter that uses a barometer.

On board a day is one about the standard (`measure_barometer`): where the model of the air is another one, the
day of `barometer.day` comes on top of how far that lies off, and readings contradict what the filter counts
with.
"""

import math
from dataclasses import replace

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.geometry.elementary import exp
from shefex_nav.onboard.navigation import measure_barometer
from shefex_nav.report import sensor_limits
from shefex_nav.scenario import surroundings
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.software import BUILT_IN
from shefex_nav.scenario.told import as_told

STEP_M = 250.0
HOTTEST = 60.0  # K, of a Day at most
WARNED = 1.5  # [E] sigmas of a day on board: the mean square of what it meets is three times the variance


def words(scenario, flown):
    """How far the air lies from the standard, in sigmas of a day on board; "" if not far.

    scenario : of a mission;  flown : programme.Flown
    """
    told = as_told(scenario)
    use = scenario.navigation.barometer
    if told.barometer is None or not use.used or scenario.navigation.software != BUILT_IN:
        return ""
    table = surroundings.air(scenario, _begins_at(scenario, flown))
    if not len(table):
        return ""
    day = settings(told.barometer.day)
    heights, off = offsets(table, _reached(use, flown))
    sigma = np.array([_sigma(day, height) for height in heights])
    k = int(np.argmax(np.abs(off) / sigma)) if len(off) else 0
    if not len(off) or abs(off[k]) <= WARNED * sigma[k]:
        return ""
    where, times = "above" if off[k] > 0.0 else "below", abs(off[k]) / sigma[k]
    wider, name, height_km = covering(day, heights, off), scenario.atmosphere.model, 1e-3 * heights[k]
    told_of = (
        f"pressure: {math.ceil(1e-2 * wider.pressure)} hPa, temperature: {wider.temperature:g} K, "
        f"depth: {1e-3 * day.depth:g} km"
    )
    return (
        f"on board a day is one about the standard atmosphere; at {height_km:.1f} km the air of {name} lies "
        f"{abs(off[k]):.0f} m {where} that, {times:.2g} sigma of such a day, and the filter is too sure of "
        f"the height; tell it of a day that covers both, navigation.told.barometer.day: {{{told_of}}}"
    )


def offsets(table, highest):
    """How much higher pressures lie in an air than in the standard atmosphere.

    table : of `surroundings.air`;  highest : m -> heights (n,) m, offsets (n,) m
    """
    heights = np.arange(max(0.0, table[0, 0]), min(highest, table[-1, 0]), STEP_M)
    off = heights - atmosphere.pressure_height(exp(np.interp(heights, table[:, 0], table[:, 2])))
    good = np.isfinite(off)
    return heights[good], off[good]


def covering(day, heights, off):
    """Day whose variances cover those of a Day and the squares of offsets, in the mean over the heights.

    Pressure and warmth of a day have nothing to do with each other; in one air both go the same way. So what
    the air is off by at the ground counts twice. The temperature is in whole K.
    """
    pressure = math.hypot(day.pressure, math.sqrt(2.0) * measure_barometer.SURFACE_WEIGHT * float(off[0]))
    variance = np.array([_sigma(day, height) ** 2 for height in heights]) + off**2
    for temperature in range(math.ceil(day.temperature), round(HOTTEST) + 1):
        wider = replace(day, pressure=pressure, temperature=float(temperature))
        if np.mean(variance / np.array([_sigma(wider, height) ** 2 for height in heights])) <= 1.0:
            break
    return wider


def _sigma(day, height):
    """Of how much higher a pressure lies on a Day, m."""
    parts, level = measure_barometer.thicknesses(height), day.pressure / measure_barometer.SURFACE_WEIGHT
    return math.sqrt(level**2 + float(parts @ measure_barometer.of_layers(day) @ parts))


def _reached(use, flown):
    """Height up to which readings are used, m."""
    if flown.track is None:
        return use.up_to
    return min(use.up_to, float(sensor_limits.heights(flown.track).max()))


def _begins_at(scenario, flown):
    """Latitude and longitude of the start where only the flight says it; None: the scenario does."""
    if scenario.trajectory is None or flown.track is None:
        return None
    from shefex_nav import prepare
    from shefex_nav.trajectory import flight

    return flight.begins_at(flown.track, prepare.earth_rotation(scenario))
