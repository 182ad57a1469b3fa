"""Software of your own on board: what it is told, and what it gives.

    from shefex_nav.software import Estimate

    class MyFilter:
        def start(self, alignment, mission): ...
        def step(self, imu, arrived): return Estimate(r_i, v_i, q_ib, P)

`navigation.software: my_navigation.py:MyFilter` in a scenario flies it; docs/how-to/software.md explains.
"""

from typing import Any, NamedTuple

import numpy as np

from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.onboard.own_navigation import Estimate as Estimate
from shefex_nav.onboard.own_navigation import Navigation as Navigation
from shefex_nav.onboard.own_navigation import OwnNavigation
from shefex_nav.onboard.own_tracker import OwnTracker
from shefex_nav.onboard.own_tracker import Solved as Solved
from shefex_nav.onboard.own_tracker import StarTracker as StarTracker

SHEETS = "imu", "gps", "star_camera", "star_tracker"


class MissionData(NamedTuple):
    """What software on board is told before the flight."""

    epoch_utc: str  # ISO 8601, t = 0
    start_s: float  # mission time at which it is switched on
    earth: EarthRotation  # for `geometry.frames`
    sun_i: np.ndarray  # (3,) unit vector to the Sun
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre
    camera: Pinhole  # as calibrated
    C_bc: np.ndarray  # (3, 3) nominal mounting, camera to body axes
    sigma_mounting: float  # rad, each axis
    l_ba_b: np.ndarray  # (3,) m, IMU to GPS antenna
    sheets: dict  # name of a section -> its settings, SI, as the computer is told them: imu, gps ...
    settings: dict[str, Any]  # what the scenario gives under `software.settings`


def mission_data(scenario, params, earth, own):
    """MissionData of a Scenario for software of a user's own.

    params : onboard.computer.ComputerParams;  earth : EarthRotation;  own : scenario.software.Own
    """
    from shefex_nav.scenario import aboard, params_onboard
    from shefex_nav.scenario.of_settings import settings
    from shefex_nav.scenario.told import as_told

    told = as_told(scenario)
    sheets = {name: settings(getattr(told, name)) for name in SHEETS}
    sheets |= {one.name: settings(given) for one, given in aboard.instruments(told)}
    return MissionData(
        epoch_utc=scenario.mission.epoch,
        start_s=scenario.mission.start,
        earth=earth,
        sun_i=params.sun_i,
        earth_velocity_i=params.tracker.earth_velocity_i,
        camera=params_onboard.nominal_camera(told),
        C_bc=params.nav.C_bc,
        sigma_mounting=told.star_camera.mounting.error,
        l_ba_b=params.nav.l_ba_b,
        sheets=sheets,
        settings=dict(own.settings),
    )


def navigation(scenario, params, alignment, earth):
    """OwnNavigation of a Scenario at the alignment; None: the built-in filter navigates."""
    from shefex_nav.scenario import software

    own = software.own(scenario.navigation)
    if own is None:
        return None
    made, name = software.made(own)
    return OwnNavigation(made, name, alignment, mission_data(scenario, params, earth, own))


def tracker(scenario, params, earth):
    """OwnTracker of a Scenario; None: the built-in chain searches the pictures."""
    from shefex_nav.scenario import software

    own = software.own(scenario.star_tracker)
    if own is None:
        return None
    made, name = software.made(own)
    return OwnTracker(made, name, mission_data(scenario, params, earth, own))
