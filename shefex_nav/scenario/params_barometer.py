"""Section `barometer` of a scenario -> the simulated sensor, and what the filter assumes of it, in SI."""

import numpy as np


def barometer_params(scenario, air_table):
    """world.barometer.BarometerParams of a scenario with a barometer. air_table : (n, 4) of the flight"""
    from shefex_nav.world.barometer import BarometerParams

    section = scenario.barometer
    mach, coefficient, error = _port(section)
    return BarometerParams(
        rate=section.rate,
        latency_s=section.latency,
        bias=section.bias,
        drift=section.drift,
        drift_time_s=section.drift_time,
        noise=section.noise,
        lag_s=section.lag,
        quantum=section.quantum,
        lowest=section.lowest,
        highest=section.highest,
        port_mach=mach,
        port_coefficient=coefficient,
        port_error=error,
        day_pressure=section.day.pressure,
        day_temperature=section.day.temperature,
        day_depth=section.day.depth,
        air=air_table,
    )


def _port(section):
    """Mach numbers, coefficients, error of a port; none adds nothing."""
    if section.port is None:
        return np.zeros(1), np.zeros(1), 0.0
    return np.array(section.port.mach), np.array(section.port.coefficient), section.port.error


def model(scenario):
    """measure_barometer.BarometerModel of a scenario or a replay; None if no barometer is used."""
    from shefex_nav.onboard.navigation import measure_barometer

    section, use = scenario.barometer, scenario.navigation.barometer
    if section is None or not use.used:
        return None
    mach, coefficient, error = _port(section)
    return measure_barometer.BarometerModel(
        noise=float(np.hypot(section.noise, section.quantum / np.sqrt(12.0))),
        lag_s=section.lag,
        lag_error=use.lag_error,
        port_mach=mach,
        port_coefficient=coefficient,
        port_error=error,
        flow_error=use.flow_error,
        flow_memory_s=use.flow_memory,
        layer_error=use.layer_error,
        P_scale=measure_barometer.of_layers(section.day.temperature, section.day.depth),
        up_to=use.up_to,
        unused_mach=tuple(use.unused_mach),
        release=(use.release.rejections, use.release.duration),
    )


def sigmas(scenario):
    """What is known at the start of the blocks of the barometer: name -> tuple of sigmas."""
    from shefex_nav.onboard.navigation import measure_barometer

    section = scenario.barometer
    if section is None:
        return {}
    metres = section.day.pressure / measure_barometer.SURFACE_WEIGHT
    layers = measure_barometer.of_layers(section.day.temperature, section.day.depth)
    return {
        "baro_bias": (float(np.hypot(section.bias, section.drift)), metres),
        "baro_scale": tuple(np.sqrt(np.diag(layers)).tolist()),
    }


def bias_walk(scenario):
    """Random walk that a bias which wanders starts out as, Pa/sqrt(s); 0 without a barometer."""
    section = scenario.barometer
    return 0.0 if section is None else float(section.drift * np.sqrt(2.0 / section.drift_time))
