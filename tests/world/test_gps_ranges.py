"""Ranges of the channels: light time, clock, errors that last, and that the fixes are made of them."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_trajectory as synthetic
from range_solution import solved_position, solved_velocity
from scipy import stats

from shefex_nav.environment import gnss
from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import frames, wgs84
from shefex_nav.settings import changed
from shefex_nav.world import gps, gps_errors, gps_receiver, gps_settings, noise

GPS_START_S = 500_000.0
CONSTELLATION = gnss.nominal_24("2012-06-22T19:18:00Z")
C = SPEED_OF_LIGHT


def oscillator(sigma_bias=0.0, sigma_drift=0.0, white=0.0, walk=0.0):
    """Clock of sigmas at the start in m, m/s, and densities in m^2/s, m^2/s^3."""
    return gps_settings.Clock(
        bias=sigma_bias / C,
        drift=sigma_drift / C,
        h_0=2.0 * white / C**2,
        h_minus_2=walk / (2.0 * np.pi**2 * C**2),
    )


NO_ERRORS = gps_settings.RangeErrors(satellite=None, ionosphere=None, troposphere=None, multipath=None)
CLOCK = oscillator(300.0, 30.0, 0.009, 0.036)
PARAMS = gps_settings.Gps(
    rate=1.0,
    fix="full",
    latency=0.2,
    clock_offset=0.0,
    range_noise=1.5,
    range_rate_noise=0.05,
    elevation_mask=np.deg2rad(5.0),
    lowest_ray_height=50e3,
    max_pdop=10.0,
    highest_speed=np.inf,
    highest_height=np.inf,
    antenna=gps_settings.Antenna(lever_arm=(0.6, 0.05, -0.03), blind_nose=0.0, blind_tail=0.0),
    spin=gps_settings.Spin(threshold=np.deg2rad(90.0), loss=0.2, noise_factor=2.0),
    outages=(gps_settings.GpsOutage(event="burn_out_1", shortest=6.0, longest=6.0),),
    clock=CLOCK,
    errors=NO_ERRORS,
    only=(),
    reacquisition=None,
)
ERRORS = gps_settings.RangeErrors(
    satellite=gps_settings.SatelliteErrors(range=0.8, rate=2e-3),
    ionosphere=gps_settings.Ionosphere(
        alpha=(1.2e-8, 1.5e-8, -6e-8, -1.2e-7), beta=(9e4, 1.0e5, -6.6e4, -5.2e5), residual=0.3
    ),
    troposphere=gps_settings.Troposphere(residual=0.05),
    multipath=gps_settings.Multipath(range=0.5, time=30.0),
)
IONOSPHERE = replace(NO_ERRORS, ionosphere=ERRORS.ionosphere)


@pytest.fixture(scope="module")
def flight():
    return synthetic.fly()


def limited(settings, start, end, satellites, prn=None):
    only = gps_settings.Only(start=start, end=end, satellites=satellites, prn=prn)
    return replace(settings, only=(only,))


def measure(params, flight, seed=1):
    rngs = noise.generator(seed, "gps"), noise.generator(seed, "gps_errors")
    return gps.measure(params, flight, synthetic.EVENTS, synthetic.EARTH, CONSTELLATION, GPS_START_S, *rngs)


def test_light_time_in_inertial_axes():
    """The published form: both places in axes that do not turn, and the Earth turned by hand, to 0.1 mm."""
    earth = synthetic.EARTH._replace(C_re=np.eye(3), rate=wgs84.OMEGA)
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 100e3)
    rho, _, r_es_e, _ = gps_receiver.geometry(CONSTELLATION, np.array([50.0]), r_e[None], np.zeros((1, 3)))
    for k in range(24):
        tau = rho[0, k] / SPEED_OF_LIGHT
        sent = gnss.positions_e(CONSTELLATION, np.array([50.0 - tau]))[0, k]
        r_s_i, r_a_i = frames.dcm_ie(earth, 50.0 - tau) @ sent, frames.dcm_ie(earth, 50.0) @ r_e
        assert rho[0, k] == pytest.approx(np.linalg.norm(r_s_i - r_a_i), abs=1e-4)
        np.testing.assert_allclose(frames.dcm_ie(earth, 50.0) @ r_es_e[0, k], r_s_i, atol=1e-3)
    still = np.linalg.norm(gnss.positions_e(CONSTELLATION, np.array([50.0]))[0] - r_e, axis=1)
    sagnac = wgs84.OMEGA / SPEED_OF_LIGHT * (r_es_e[0, :, 0] * r_e[1] - r_es_e[0, :, 1] * r_e[0])
    moved = np.abs(rho[0] - still)
    assert moved.max() > 30.0  # what is lost without it
    assert np.abs(sagnac).max() > 10.0


def test_range_rate_is_the_derivative_of_the_range():
    """Central differences over 20 ms of ranges with light time, receiver at 3 km/s: 0.1 mm/s."""
    v_e = np.array([1500.0, -2000.0, 1700.0])
    r_0 = wgs84.ecef_from_geodetic(1.2, 0.3, 150e3)
    h = 0.01
    t_s = 20.0 + np.array([-h, 0.0, h])
    r_e = r_0 + (t_s - 20.0)[:, None] * v_e
    rho, rate, r_s, v_s = gps_receiver.geometry(CONSTELLATION, t_s, r_e, np.tile(v_e, (3, 1)))
    np.testing.assert_allclose(rate[1], (rho[2] - rho[0]) / (2.0 * h), atol=1e-4)
    u = (r_s[1] - r_e[1]) / rho[1][:, None]
    earth_rate = np.array([0.0, 0.0, wgs84.OMEGA])
    naive = np.sum(u * (v_s[1] + np.cross(earth_rate, r_s[1]) - v_e - np.cross(earth_rate, r_e[1])), axis=1)
    assert np.abs(naive - rate[1]).max() > 2e-3  # the denominator counts


@pytest.mark.parametrize("errors", [None, ERRORS])
def test_fixes_are_the_solution_of_the_ranges(flight, errors):
    """Solved from scratch, 42 km off, out of pseudoranges with the clock in them: the fix to 2 mm.

    The velocity is solved at the true place: lines of sight from one that is wrong by metres turn a
    satellite's 4 km/s into millimetres per second.
    """
    antenna = gps.antenna_states(flight, synthetic.EARTH, PARAMS.antenna.lever_arm)
    data = measure(replace(PARAMS, errors=errors or NO_ERRORS), flight)
    solved = 0
    for k, (fix, ranges) in enumerate(zip(data.fixes, data.ranges, strict=True)):
        assert (fix.t_valid_s, fix.t_available_s) == (ranges.t_valid_s, ranges.t_available_s)
        if not fix.valid:
            continue
        assert fix.n_satellites == len(ranges.prn) and ranges.reason == ""
        np.testing.assert_allclose(solved_position(ranges, fix.r_ea_e + 3e4), fix.r_ea_e, atol=2e-3)
        velocity = solved_velocity(ranges, antenna.r_ea_e[k])
        np.testing.assert_allclose(velocity, fix.v_ea_e, atol=2e-5)
        solved += 1
    assert solved > 40
    lost = [r for r in data.ranges if r.reason]
    assert lost and all(len(r.prn) == 0 and "burn_out_1" in r.reason for r in lost)


def test_clock_and_lasting_errors_leave_the_white_ones_alone(flight):
    plain, full = measure(PARAMS, flight), measure(replace(PARAMS, errors=ERRORS), flight)
    for a, b in zip(plain.ranges, full.ranges, strict=True):
        np.testing.assert_array_equal(a.prn, b.prn)
        np.testing.assert_array_equal(a.r_es_e, b.r_es_e)
        assert np.all(np.abs(a.pseudorange - b.pseudorange) < 15.0)
    perfect = replace(PARAMS, clock=oscillator())
    for a, b in zip(plain.fixes, measure(perfect, flight).fixes, strict=True):
        np.testing.assert_array_equal(a.r_ea_e, b.r_ea_e)  # the fix solves for the clock


def test_clock_grows_as_its_densities_say():
    """600 clocks over 50 s: variances of bias and drift, chi-square at 99.9 %, and their correlation."""
    params = oscillator(0.0, 0.0, 0.009, 0.036)
    rng, t_s = np.random.default_rng(3), np.arange(0.0, 51.0)
    runs = np.array([[c[-1] for c in gps_errors.clock(params, t_s, rng)] for _ in range(600)])
    T = 50.0
    expected = np.array([0.009 * T + 0.036 * T**3 / 3.0, 0.036 * T])
    low, high = stats.chi2.interval(0.999, 600)
    for k in range(2):
        assert low < np.sum(runs[:, k] ** 2) / expected[k] < high
    tie = 0.036 * T**2 / 2.0 / np.sqrt(expected.prod())
    assert np.corrcoef(runs.T)[0, 1] == pytest.approx(tie, abs=0.03)
    steps = gps_errors.clock(oscillator(0.0, 7.0, 0.0, 0.0), t_s, rng)
    np.testing.assert_allclose(steps[0], steps[1][0] * t_s)


def of_satellites(params, seed=1, height=0.0, seconds=300):
    """RangeErrors above Andoya, and the lines of sight."""
    t_s = np.arange(float(seconds))
    r_e = np.tile(wgs84.ecef_from_geodetic(np.deg2rad(69.3), np.deg2rad(16.0), height), (seconds, 1))
    u_e = gnss.lines_of_sight_e(r_e, gnss.positions_e(CONSTELLATION, t_s))
    errors = gps_errors.range_errors(params, GPS_START_S, t_s, r_e, u_e, np.random.default_rng(seed))
    return errors, gnss.elevation(r_e, u_e)


@pytest.mark.slow
def test_lasting_errors_have_the_variance_that_is_reported():
    """Standardised errors of visible satellites, mean square over 300 draws: one, at 99.9 %."""
    squares = []
    for seed in range(300):
        errors, elevation = of_satellites(ERRORS, seed, seconds=3)
        up = elevation[1] > 0.1
        squares.append(np.mean(errors.error[0, 1, up] ** 2 / errors.variance[0, 1, up]))
    # satellites share half the variance of the ionosphere: the mean of one draw scatters by about 0.6
    assert np.mean(squares) == pytest.approx(1.0, abs=3.3 * np.std(squares) / np.sqrt(300))
    assert np.std(squares) < 1.2


def test_multipath_forgets_in_its_time_and_the_satellites_do_not():
    only = replace(NO_ERRORS, multipath=ERRORS.multipath)
    e = np.concatenate([of_satellites(only, seed)[0].error[0].T for seed in range(20)])  # (480, 300)
    for lag in (1, 30):
        got = np.mean(e[:, lag:] * e[:, :-lag]) / np.mean(e**2)
        assert got == pytest.approx(np.exp(-lag / 30.0), abs=0.03)
    assert np.std(e) == pytest.approx(0.5, rel=0.05)
    slow, _ = of_satellites(
        replace(NO_ERRORS, satellite=gps_settings.SatelliteErrors(range=1.0, rate=1e-2)), 2
    )
    between = 0.5 * (slow.error[1][1:] + slow.error[1][:-1])
    np.testing.assert_allclose(np.diff(slow.error[0], axis=0), between, atol=5e-7)


def test_air_is_felt_on_the_ground_and_not_in_space():
    air = replace(NO_ERRORS, troposphere=gps_settings.Troposphere(residual=1.0))
    for params, ground in ((air, (2.0, 25.0)), (IONOSPHERE, (0.3, 12.0))):
        low, elevation = of_satellites(params)
        up = elevation[0] > 0.1
        sigma = np.sqrt(low.variance[0, 0, up])
        assert ground[0] < sigma.min() and sigma.max() < ground[1]
    high, elevation = of_satellites(air, height=177e3)
    assert np.abs(high.error[0, 0, elevation[0] > 0.05]).max() < 1e-6
    inside, elevation = of_satellites(IONOSPHERE, height=177e3)
    above, _ = of_satellites(IONOSPHERE, height=1500e3)
    up = elevation[0] > 0.3
    ratio = np.sqrt(inside.variance[0, 0, up] / of_satellites(IONOSPHERE)[0].variance[0, 0, up])
    assert np.all((ratio > 0.9) & (ratio < 1.15))  # the F layer is still overhead
    assert np.sqrt(above.variance[0, 0, up]).max() < 0.02


def test_code_and_carrier_feel_the_ionosphere_with_opposite_signs():
    errors, elevation = of_satellites(IONOSPHERE)
    up = elevation[0] > 0.1
    np.testing.assert_allclose(
        np.diff(errors.error[0], axis=0)[100, up], -errors.error[1][100, up], rtol=0.05, atol=1e-6
    )


def test_limits_name_or_count_satellites(flight):
    calm = changed(PARAMS, {"outages": (), "spin.threshold": np.inf})
    whole = measure(calm, flight).ranges
    seen = set(whole[20].prn.tolist())
    two = measure(limited(calm, 5.0, 20.0, 2), flight)
    for k, ranges in enumerate(two.ranges):
        during = 5.0 <= ranges.t_valid_s < 20.0
        assert len(ranges.prn) == (2 if during else len(whole[k].prn))
        assert two.fixes[k].valid != during
    chosen = next(r for r in two.ranges if r.t_valid_s == 10.0)
    everything = next(r for r in whole if r.t_valid_s == 10.0)
    u = everything.r_es_e - gps.antenna_states(flight, synthetic.EARTH, calm.antenna.lever_arm).r_ea_e[20]
    u /= np.linalg.norm(u, axis=1)[:, None]
    pair = u[np.isin(everything.prn, chosen.prn)]
    others = np.sort((u @ u.T)[np.triu_indices(len(u), 1)])
    assert pair[0] @ pair[1] <= np.median(others)  # far apart
    named = tuple(sorted(seen))[1:4]
    some = measure(limited(calm, 5.0, 20.0, None, named), flight).ranges
    assert all(tuple(r.prn) == named for r in some if 5.0 <= r.t_valid_s < 20.0)
    none = measure(limited(calm, 5.0, 20.0, 0), flight)
    assert all(r.reason == "0 satellites tracked" for r in none.ranges if 5.0 <= r.t_valid_s < 20.0)
    assert all(f.reason == "0 satellites tracked" for f in none.fixes if 5.0 <= f.t_valid_s < 20.0)


def test_reacquisition_takes_its_time_for_each_satellite(flight):
    """After the outage from 20 s to 26 s the satellites come back one by one, 2 s to 9 s later."""
    calm = changed(PARAMS, {"spin.threshold": np.inf})
    at_once = measure(calm, flight).ranges
    slow = measure(
        replace(calm, reacquisition=gps_settings.Reacquisition(shortest=2.0, longest=9.0)), flight
    ).ranges
    numbers = {r.t_valid_s: len(r.prn) for r in slow}
    before, after = numbers[19.0], numbers[36.0]
    assert [numbers[t] for t in (20.0, 25.0, 26.0, 27.0)] == [0, 0, 0, 0]
    assert 0 < numbers[31.0] < after and after >= before - 2
    for a, b in zip(at_once, slow, strict=True):
        assert set(b.prn) <= set(a.prn)
        if not 20.0 <= a.t_valid_s < 35.0:
            assert len(set(a.prn) - set(b.prn)) <= 2  # those that have just risen
    flags = np.array([[True, False, True, True, True, True]]).T
    t_s = np.arange(6.0)
    got = gps_receiver.reacquired(
        flags, t_s, gps_settings.Reacquisition(shortest=2.0, longest=2.0), np.zeros((6, 1))
    )
    assert got[:, 0].tolist() == [True, False, False, False, True, True]


@pytest.mark.parametrize("span", [(900.0, 950.0), (-50.0, -20.0), (5.2, 5.8)])
def test_limits_without_an_epoch_inside_change_nothing(flight, span):
    """Before the flight, after it, and between two fixes; NumPy warns of means of nothing."""
    calm = changed(PARAMS, {"outages": (), "spin.threshold": np.inf})
    whole = measure(calm, flight).ranges
    fewer = measure(limited(calm, *span, 2), flight).ranges
    assert [r.prn.tolist() for r in fewer] == [r.prn.tolist() for r in whole]
