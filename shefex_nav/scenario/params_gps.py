"""The section `gps` of a scenario -> the parameters of the simulated receiver and its satellites, in SI."""

import numpy as np


def gps_params(scenario):
    """GpsParams of a scenario."""
    from shefex_nav.world.gps import GpsParams, Outage
    from shefex_nav.world.gps_receiver import Only, Reacquisition

    gps = scenario.gps
    wait = gps.reacquisition
    return GpsParams(
        l_ba_b=np.array(gps.antenna.lever_arm),
        latency_s=gps.latency,
        rate=gps.rate,
        sigma_range=gps.range_noise,
        sigma_range_rate=gps.range_rate_noise,
        elevation_mask=gps.elevation_mask,
        lowest_height=gps.lowest_ray_height,
        blind_nose=gps.antenna.blind_nose,
        blind_tail=gps.antenna.blind_tail,
        max_pdop=gps.max_pdop,
        spin_threshold=gps.spin.threshold,
        spin_loss=gps.spin.loss,
        spin_noise_factor=gps.spin.noise_factor,
        outages=tuple(Outage(o.event, o.shortest, o.longest) for o in gps.outages),
        errors=_error_params(scenario),
        clock=_clock_params(gps.clock),
        only=tuple(Only(o.start, o.end, o.satellites or 0, tuple(o.prn or ())) for o in gps.only),
        reacquisition=None if wait is None else Reacquisition(wait.shortest, wait.longest),
    )


def clock_densities(clock):
    """S_f m^2/s and S_g m^2/s^3 of a section `gps.clock`: c^2 h_0/2 and 2 pi^2 c^2 h_-2."""
    from shefex_nav.environment.constants import SPEED_OF_LIGHT

    c2 = SPEED_OF_LIGHT**2
    return 0.5 * c2 * clock.h_0, 2.0 * np.pi**2 * c2 * clock.h_minus_2


def clock_sigmas(clock):
    """Standard deviations of bias, m, and drift, m/s, at the start, of a section `gps.clock`."""
    from shefex_nav.environment.constants import SPEED_OF_LIGHT

    return SPEED_OF_LIGHT * clock.bias, SPEED_OF_LIGHT * clock.drift


def almanac(scenario):
    """yuma.Almanac of the section `gps.almanac`."""
    from shefex_nav.environment import yuma

    section = scenario.gps.almanac
    columns = {field: getattr(section, key) for key, field in ALMANAC_KEYS.items()}
    return yuma.almanac(columns)


ALMANAC_KEYS = {  # of a scenario -> of environment.yuma
    "prn": "prn",
    "health": "health",
    "eccentricity": "eccentricity",
    "time": "time_s",
    "inclination": "inclination",
    "node_rate": "node_rate",
    "root_semi_major_axis": "root_a",
    "node": "node",
    "perigee": "perigee",
    "anomaly": "anomaly",
    "week": "week",
}
ALMANAC_UNITS = {  # of those that are quantities
    "time": "s",
    "inclination": "rad",
    "node_rate": "rad/s",
    "node": "rad",
    "perigee": "rad",
    "anomaly": "rad",
}


def _clock_params(clock):
    """gps_errors.ClockParams of a section `gps.clock`."""
    from shefex_nav.world.gps_errors import ClockParams

    return ClockParams(*clock_sigmas(clock), *clock_densities(clock))


def _error_params(scenario):
    """gps_errors.ErrorParams, or None if no error is given."""
    from shefex_nav.environment import yuma
    from shefex_nav.world.gps_errors import ErrorParams

    errors = scenario.gps.errors
    params = ErrorParams(gps_start_s=yuma.gps_seconds(scenario.mission.epoch))
    if errors.satellite is not None:
        params = params._replace(satellite=errors.satellite.range, satellite_rate=errors.satellite.rate)
    if errors.ionosphere is not None:
        air = errors.ionosphere
        params = params._replace(alpha=air.alpha, beta=air.beta, ionosphere=air.residual)
    if errors.troposphere is not None:
        params = params._replace(troposphere=errors.troposphere.residual)
    if errors.multipath is not None:
        params = params._replace(multipath=errors.multipath.range, multipath_time_s=errors.multipath.time)
    given = (errors.satellite, errors.ionosphere, errors.troposphere, errors.multipath)
    return None if given == (None,) * 4 else params
