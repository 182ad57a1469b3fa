"""Atmospheres and winds as tables for the kernels of the flight.

In: `models.Atmosphere`, `models.Wind`. Out: rows over the height, and over the time of a wind.

Between the places where a model is asked first, more are added until, at a third and at two thirds of the way
from one to the next, the line differs from the model by at most a tolerance. A smooth model is off the line
by 9/8 of that at most, one with a kink by 3/2. What is narrower than the first distance can be missed.
"""

import numpy as np

from shefex_nav.environment import models
from shefex_nav.environment.models import Air
from shefex_nav.errors import CodeError
from shefex_nav.geometry.elementary import log

AIR = np.array([1e-4, 1e-4, 0.03])  # of ln(density), ln(pressure), speed of sound m/s
WIND = 0.05  # m/s
CLOSEST_M, CLOSEST_S = 1.0, 0.1  # between two places: a jump is a slope over one to three of these
TIMES = 65  # at which a wind is asked first
MOST = 2_000_000  # numbers of a table
GAMMA = 1.4  # ratio of specific heats


def air_table(one, site):
    """Air over the height, (n, 4): height m, ln(density), ln(pressure), speed of sound m/s.

    Atmosphere, Site; (0, 4) for the one that the kernels have in closed form
    """
    if one.air is None:
        return np.zeros((0, 4))

    def values(heights):
        air = Air(*one.air(heights, site))
        sound = np.sqrt(GAMMA * air.pressure / air.density) if air.sound is None else air.sound
        return np.column_stack([log(air.density), log(air.pressure), sound])

    heights, rows = refined(values, one.heights, AIR, CLOSEST_M, models.words(one))
    return np.column_stack([heights, rows])


def wind_table(one, site, span):
    """Wind over height and time: rows (m, 1 + 2 k) and times (k,) s.

    Wind, Site, (first, last) s of the flight. A row is the height m, and the wind to north and east m/s at
    each of the times, between which it is linear; one time: always the same. (0, 3) rows: none
    """
    if one.wind is None:
        return np.zeros((0, 3)), np.zeros(1)
    words = models.words(one)

    def over_time(times):
        return np.array([np.ravel(one.wind(np.array(one.heights), float(t_s), site)) for t_s in times])

    def over_height(heights):
        return np.column_stack([row for t_s in times for row in one.wind(heights, float(t_s), site)])

    times, values = refined(over_time, np.linspace(*span, TIMES), WIND, CLOSEST_S, words)
    if not np.ptp(values, axis=0).any():
        times = times[:1]
    heights, rows = refined(over_height, one.heights, WIND, CLOSEST_M, words)
    return np.column_stack([heights, rows]), times


def refined(function, places, tolerance, closest, words):
    """Places (n,) and the values (n, k) there, between which the function is linear to a tolerance.

    Parameters
    ----------
    function : of places (n,) that gives values (n, k)
    places : (m,) ascending, to begin with
    tolerance : of each column
    closest : no more places between two that are nearer to each other than three times this
    words : what is sampled

    Raises CodeError if the table gets too long.
    """
    places = np.array(places, dtype=float)
    values = function(places)
    unseen = np.arange(len(places) - 1)  # intervals
    while len(unseen):
        length, rise = np.diff(places)[unseen, None], np.diff(values, axis=0)[unseen, None]
        parts = np.array([1.0, 2.0]) / 3.0
        between = places[unseen, None] + parts * length  # (intervals, 2)
        found = function(between.ravel()).reshape(*between.shape, -1)
        off = np.abs(found - values[unseen, None] - parts[:, None] * rise)
        rough = (off > tolerance).any(axis=(1, 2)) & (length[:, 0] >= 3.0 * closest)
        behind = np.repeat(unseen[rough] + 1, 2)
        places = np.insert(places, behind, between[rough].ravel())
        values = np.insert(values, behind, found[rough].reshape(-1, values.shape[1]), axis=0)
        if values.size > MOST:
            raise CodeError(f"{words} has too much detail for a table of {MOST} numbers; smooth it")
        first = unseen[rough] + 2 * np.arange(rough.sum())  # of the three that an interval has become
        unseen = (first[:, None] + np.arange(3)).ravel()
    return places, values
