"""Section `magnetometer` of a scenario -> the simulated sensor, and what the filter assumes of it, in SI."""

import numpy as np


def _year(scenario):
    from shefex_nav.environment import magnetic_field

    return magnetic_field.decimal_year(scenario.mission.epoch)


def magnetometer_params(scenario):
    """world.magnetometer.MagnetometerParams of a scenario with a magnetometer."""
    from shefex_nav.world.magnetometer import MagnetometerParams

    section = scenario.magnetometer
    return MagnetometerParams(
        rate=section.rate,
        latency_s=section.latency,
        hard_iron=section.hard_iron,
        soft_iron=section.soft_iron,
        noise=section.noise,
        quantum=section.quantum,
        range=section.range,
        year=_year(scenario),
    )


def model(scenario):
    """measure_magnetometer.MagnetometerModel of a scenario or a replay; None if no magnetometer is used."""
    from shefex_nav.environment import magnetic_field
    from shefex_nav.onboard.navigation import measure_magnetometer

    section, use = scenario.magnetometer, scenario.navigation.magnetometer
    if section is None or not use.used:
        return None
    return measure_magnetometer.MagnetometerModel(
        harmonics=magnetic_field.load(_year(scenario)),
        sigma_n=magnetic_field.sigma_n(_year(scenario)),
        noise=float(np.hypot(section.noise, section.quantum / np.sqrt(12.0))),
        soft_iron=float(np.hypot(section.soft_iron, use.model_error)),
        memory_s=use.memory,
        heading=use.rows == "heading",
        release=(use.release.rejections, use.release.duration),
    )


def sigmas(scenario):
    """What is known at the start of the block of the magnetometer: name -> tuple of sigmas."""
    section = scenario.magnetometer
    return {} if section is None else {"hard_iron": (section.hard_iron,) * 3}
