"""Which fixes a star tracker would give along a true flight, without pictures and without navigation.

The statistics of the star tracker (`statistical`) see the true sky from the true attitude, through the camera
and the star tracker of a scenario: stars, light, streaks, noise and exposure are theirs, so another lens,
detector or catalogue gives other stars and other covariances. Fitted to pictures are the shares found and
identified, and the size of the noise against its formula; for another camera they are taken over.

One frame in `EVERY_S` is looked at and stands for those around it: its covariance is that of their mean, its
instant that at which the shutter opens.
Errors that they have in common (mounting, focal length) are states of the bound, and not divided.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav import statistical
from shefex_nav.clock import SAME_S, TICK_HZ
from shefex_nav.environment import ephemeris
from shefex_nav.onboard.startracker import catalogue, tracker
from shefex_nav.records import Reason
from shefex_nav.world import faults, noise

EVERY_S = 1.0


class _Stars:
    """What statistics need of the pairs of stars: the stars."""

    def __init__(self, stars):
        self.stars = stars


class StarFixes(NamedTuple):
    """What a star tracker gives along a flight."""

    fixes: tuple  # of StarFix, each of several frames
    frames: int  # that are taken, as far as those looked at say
    solved: int  # of these with an attitude
    sigma: float  # rad, median over the fixes, of one frame across the boresight; NaN without any

    @property
    def second_s(self):
        """Time of the second fix, s; None if there are no two. One that stands for several frames is both."""
        wanted = 2 if self.solved == len(self.fixes) else 1
        return self.fixes[wanted - 1].t_valid_s if len(self.fixes) >= wanted else None


NONE = StarFixes((), 0, 0, np.nan)


def star_fixes(scenario, world, seed, every_s=EVERY_S):
    """StarFixes of a flight.

    Parameters
    ----------
    scenario : Scenario whose star tracker has statistics
    world : prepare.World, what sensors say is not looked at
    seed : int, of the draws of the statistics
    every_s : between two frames that are looked at; 0: each is
    """
    settings = scenario.star_tracker
    period = round(TICK_HZ / settings.rate)
    stride = max(1, round(every_s * TICK_HZ / period))
    on_board = _tracker(scenario, world)
    line = faults.StarLine((), noise.generator(seed, "faults"))
    sight = statistical.Statistical(scenario, world, on_board, seed, line)
    state, command = tracker.start(on_board, settings.on)
    found, looked = [], 0
    for number, t_s in enumerate(_opens(scenario, world.flight.trajectory, period * stride)):
        frame, truth = sight.expose(None, command, world.flight.trajectory, number, t_s, None)
        context = tracker.Context(_velocity(world, frame.t_valid_s), truth.rate, np.nan, np.nan)
        state, fix, command = sight.step(on_board, state, frame, context)
        looked += 1
        if fix.reason == Reason.NONE:
            found.append(fix._replace(t_valid_s=t_s) if stride > 1 else fix)
    sigmas = [np.sqrt(fix.P_c.diagonal()[:2].mean()) for fix in found]
    grouped = tuple(fix._replace(P_c=fix.P_c / stride) for fix in found)
    sigma = float(np.median(sigmas)) if sigmas else np.nan
    return StarFixes(grouped, looked * stride, len(found) * stride, sigma)


def _tracker(scenario, world):
    """tracker.Tracker that knows its stars and no pairs of them."""
    params = world.computer.tracker
    year = round(ephemeris.julian_year(scenario.mission.epoch) * 365.25) / 365.25
    known = catalogue.build(params.settings.catalogue, world.catalogue, year)
    return tracker.Tracker(params, _Stars(known))


def _opens(scenario, trajectory, ticks):
    """Times at which the shutter opens, every so many ticks while the camera is on: list of s."""
    settings, readout_s = scenario.star_tracker, scenario.star_camera.detector.readout
    last_s = min(settings.off, float(trajectory.t_s[-1])) - settings.exposure.longest - readout_s
    numbers = np.arange(ticks, int((trajectory.t_s[-1] - trajectory.t_s[0]) * TICK_HZ) + 1, ticks)
    t_s = trajectory.t_s[0] + numbers / TICK_HZ
    return t_s[(t_s > settings.on + SAME_S) & (t_s < last_s)].tolist()


def _velocity(world, t_s):
    """Velocity of the camera relative to the barycentre, (3,) m/s."""
    trajectory = world.flight.trajectory
    k = int(np.clip(np.searchsorted(trajectory.t_s, t_s - SAME_S), 0, len(trajectory.t_s) - 1))
    return trajectory.v_i[k] + world.computer.tracker.earth_velocity_i
