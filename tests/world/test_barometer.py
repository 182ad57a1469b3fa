"""The simulated barometer: hydrostatics of its day, lag, port, limits, and a stream of its own."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_trajectory
from scipy import signal
from scipy_bits import assert_as_scipy

from shefex_nav.environment import atmosphere
from shefex_nav.instruments.barometer import BAROMETER, Barometer, Day, Port
from shefex_nav.instruments.instrument import Truth
from shefex_nav.world import barometer, noise

CALM = Day(pressure=0.0, temperature=0.0, depth=8e3)
GOOD = Barometer(
    rate=10.0,
    latency=0.02,
    bias=0.0,
    drift=0.0,
    drift_time=300.0,
    noise=0.0,
    lag=0.0,
    quantum=0.0,
    lowest=0.0,
    highest=120e3,
    port=None,
    day=CALM,
)


@pytest.fixture(scope="module")
def flight():
    return synthetic_trajectory.fly(end_s=30.0)


def measured(flight, seed=1, **changes):
    truth = Truth(flight, synthetic_trajectory.EARTH, 2012.5, np.zeros(3), np.zeros((0, 4)))
    return BAROMETER.measure(replace(GOOD, **changes), truth, noise.generator(seed, BAROMETER.stream))


def pressures(flight, **changes):
    return np.array([one.pressure for one in measured(flight, **changes).readings])


def height(t_s):
    """Of the synthetic flight."""
    burn = np.clip(t_s, 0.0, synthetic_trajectory.BURN_S)
    return 10.0 + 25.0 * burn**2 + 50.0 * burn * np.maximum(0.0, t_s - synthetic_trajectory.BURN_S)


def test_a_barometer_without_errors_reads_the_standard_atmosphere_ten_times_a_second(flight):
    readings = measured(flight).readings
    t_s = np.array([one.t_valid_s for one in readings])
    np.testing.assert_allclose(np.diff(t_s), 0.1, atol=1e-9)
    np.testing.assert_allclose([one.t_available_s for one in readings] - t_s, 0.02, atol=1e-12)
    expected = [atmosphere.us76(h)[1] for h in height(t_s)]
    np.testing.assert_allclose([one.pressure for one in readings], expected, rtol=1e-6)


def test_the_air_of_a_warm_day_is_in_hydrostatic_balance():
    """d ln p/dh = -g M/(R T) with the temperature of the day, T (1 + s), from where p and h are alone."""
    params = replace(GOOD, day=replace(CALM, pressure=800.0, temperature=8.0))
    errors = barometer.draw_errors(params, noise.generator(3, BAROMETER.stream))
    for level in (250.0, 3050.0, 9950.0, 15_050.0):  # in the middle of a step of the table
        layer = int(level / barometer.DAY_STEP)
        warm = errors.warmth[layer]
        lie = level + errors.level_m + barometer.DAY_STEP * errors.warmth[:layer].sum()
        lie += warm * (level - layer * barometer.DAY_STEP)
        h = np.array([lie - 10.0, lie, lie + 10.0])
        p = [atmosphere.us76(H)[1] for H in barometer.of_the_day(errors, h)]
        _, _, temperature, _ = atmosphere.us76(level)
        g = atmosphere.G_0 * (atmosphere.EARTH_RADIUS / (atmosphere.EARTH_RADIUS + level)) ** 2
        scale = atmosphere.R_STAR * temperature * (1.0 + warm) / (atmosphere.M_0 * g)
        assert np.log(p[2] / p[0]) / 20.0 == pytest.approx(-1.0 / scale, rel=2e-4)


@pytest.mark.parametrize("warmer", [None, 1.1])
def test_the_temperature_of_days_has_its_sigma_at_each_height(warmer):
    """T s of 3000 days at the ground, in the cold at 15 km and above; also in air a tenth warmer."""
    levels = np.array([50.0, 5050.0, 11_050.0, 15_050.0, 19_950.0, 47_050.0])
    standard = np.array([atmosphere.us76(level) for level in np.arange(0.0, 80e3, 100.0)])
    air = np.column_stack([np.arange(0.0, 80e3, 100.0), np.log(standard[:, :2]), standard[:, 3]])
    air[:, 1] -= np.log(warmer or 1.0)
    params = replace(GOOD, day=replace(CALM, temperature=8.0))
    rng, table = np.random.default_rng(12), () if warmer is None else (air,)
    days = [barometer.draw_errors(params, rng, *table).warmth for _ in range(3000)]
    T = np.array([atmosphere.us76(level)[2] for level in levels]) * (warmer or 1.0)
    sigma = T * np.array(days)[:, (levels / barometer.DAY_STEP).astype(int)].std(axis=0)
    np.testing.assert_allclose(sigma, 8.0, rtol=5.0 / np.sqrt(6000.0))
    weights = np.random.default_rng(13).standard_normal((3000, barometer.MODES))
    modes = barometer.modes_of_warmth(params.day, *table)
    of_modes = np.cumsum(weights @ modes, axis=1) * barometer.DAY_STEP
    drawn = np.cumsum(np.array(days), axis=1) * barometer.DAY_STEP
    np.testing.assert_allclose(of_modes.std(axis=0)[20::50], drawn.std(axis=0)[20::50], rtol=0.1)


def test_a_day_is_as_far_from_the_standard_at_5_km_as_days_are():
    """Published scatter of the height of the 540 hPa level: 50 to 250 m between days."""
    params, heights = replace(GOOD, day=replace(CALM, pressure=800.0, temperature=8.0)), np.array([5000.0])
    off = [
        5000.0
        - barometer.of_the_day(barometer.draw_errors(params, noise.generator(k, BAROMETER.stream)), heights)[
            0
        ]
        for k in range(1, 400)
    ]
    assert 100.0 < np.std(off) < 180.0


def test_the_lag_delays_a_steady_change_by_itself():
    ramp = np.linspace(0.0, 100.0, 4001)
    felt = barometer.lagged(ramp, 0.2, 1.0 / 400.0)
    late = ramp[2000:] - 0.2 * 10.0  # 10 Pa in a second
    np.testing.assert_allclose(felt[2000:], late, atol=1e-9)
    assert barometer.lagged(np.full(5, 7.0), 0.2, 0.01) == pytest.approx(np.full(5, 7.0))


def test_the_lag_is_the_filter_of_scipy():
    pressure = 1e5 + np.random.default_rng(5).standard_normal(500)
    b, a = signal.bilinear([1.0], [0.2, 1.0], fs=400.0)
    expected, _ = signal.lfilter(b, a, pressure, zi=signal.lfilter_zi(b, a) * pressure[0])
    np.testing.assert_allclose(barometer.lagged(pressure, 0.2, 1.0 / 400.0), expected, rtol=1e-14)
    b, keeps = 0.0025 / 0.4025, 0.3975 / 0.4025
    begin = [(b + keeps) * pressure[0]]
    expected, _ = signal.lfilter([b, b], [1.0, -keeps], pressure, zi=begin)
    felt = np.empty(500)
    barometer._lag(b, keeps, pressure, felt)
    assert_as_scipy(felt, expected)


def test_the_port_adds_its_part_of_the_dynamic_pressure(flight):
    flown = flight._replace(
        mach=np.full(len(flight.t_s), 0.9), dynamic_pressure_pa=np.full(len(flight.t_s), 3e4)
    )
    port = Port(mach=(0.8, 1.0), coefficient=(0.0, -0.04), error=0.0)
    np.testing.assert_allclose(pressures(flown, port=port) - pressures(flown), -0.02 * 3e4, atol=1e-6)


def test_readings_stay_in_the_range_and_say_so(flight):
    readings = measured(flight, lowest=30e3, quantum=50.0).readings
    low = [one for one in readings if one.at_limit]
    assert low
    assert {one.pressure for one in low} == {30e3}
    assert all(abs(one.pressure / 50.0 - round(one.pressure / 50.0)) < 1e-9 for one in readings)


def test_noise_and_bias_are_as_large_as_said(flight):
    errors = [pressures(flight, seed=k, bias=100.0, noise=5.0) - pressures(flight) for k in range(60)]
    means = np.mean(errors, axis=1)
    assert 75.0 < np.std(means) < 128.0  # 99.9 % of 60 draws of 100
    scatter = np.std(errors, axis=1).mean()
    assert scatter == pytest.approx(5.0, rel=0.05)


def test_what_is_drawn_does_not_depend_on_the_size_of_the_errors(flight):
    one, two = pressures(flight, noise=5.0), pressures(flight, noise=5.0, bias=100.0, drift=20.0)
    three = pressures(flight, bias=100.0, drift=20.0)
    np.testing.assert_allclose(one + three - pressures(flight), two, atol=1e-6)
