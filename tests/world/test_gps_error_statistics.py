"""Errors of the ranges against the covariance that their physics gives, entry by entry.

Range and range-rate errors of all satellites and epochs are one Gaussian vector. Its covariance follows from
what each error is: a slow swing of each satellite, a share of a delay whose factor is drawn once,
a first-order Gauss-Markov process, two integrated white noises of a clock. Sample covariances are held
against it within five of their own standard deviations.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg
from test_gps_ranges import CONSTELLATION, ERRORS, GPS_START_S, NO_ERRORS, oscillator

from shefex_nav.environment import gnss
from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import wgs84
from shefex_nav.world import gps, gps_errors, gps_settings

T_S = 700.0 + 4.0 * np.arange(3)  # s; errors count from the first
ELAPSED_S = T_S - T_S[0]
SATELLITES = 2
# delays that grow evenly, m and m/s, so that their differences over time are exact
IONOSPHERE_M, IONOSPHERE_M_S = np.array([6.0, 9.0]), np.array([0.3, -0.5])
TROPOSPHERE_M, TROPOSPHERE_M_S = np.array([20.0, 50.0]), np.array([-0.7, 1.1])
DRAWS = 600


def delays(at_start, change):
    """(m, n) m"""
    return at_start + np.outer(ELAPSED_S, change)


def assert_covariance(samples, expected):
    """Sample covariance of N draws (N, d) of mean zero: every entry within five standard deviations."""
    got = samples.T @ samples / len(samples)
    variance = np.diag(expected)
    sigma = np.sqrt((np.outer(variance, variance) + expected**2) / len(samples))
    assert np.all(np.abs(got - expected) <= 5.0 * sigma + 1e-12)


def covariance(settings):
    """Covariance of (error or rate, epoch, satellite), flattened, from the definition of each error."""
    m, n = len(T_S), SATELLITES
    same, all_alike = np.eye(n), np.ones((n, n))
    total = np.zeros((2, m, n, 2, m, n))

    def add(a, b, between):
        """between satellites (n, n) of a product of factors (2, m, n)"""
        total[...] += np.einsum("amn,bkp,np->amnbkp", a, b, between)

    if settings.satellite:
        sigmas = np.array([settings.satellite.range, settings.satellite.rate])[:, None, None]
        angle = np.tile((sigmas[1] / sigmas[0] * ELAPSED_S[:, None]), (1, n))
        for shape in ([np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]):
            add(sigmas * np.stack(shape), sigmas * np.stack(shape), same)
    if settings.ionosphere:  # advances the carrier by what it delays the code
        code, carrier = delays(IONOSPHERE_M, IONOSPHERE_M_S), -np.tile(IONOSPHERE_M_S, (m, 1))
        left = settings.ionosphere.residual * np.stack([code, carrier])
        add(left, left, 0.5 * same + 0.5 * all_alike)
    if settings.troposphere:
        left = settings.troposphere.residual * np.stack(
            [delays(TROPOSPHERE_M, TROPOSPHERE_M_S), np.tile(TROPOSPHERE_M_S, (m, 1))]
        )
        add(left, left, all_alike)
    if settings.multipath:
        decay = np.exp(-np.abs(np.subtract.outer(T_S, T_S)) / settings.multipath.time)
        total[0, :, :, 0] += settings.multipath.range**2 * np.einsum("mk,np->mnkp", decay, same)
    return total.reshape(2 * m * n, 2 * m * n)


CASES = {
    "satellite": replace(NO_ERRORS, satellite=gps_settings.SatelliteErrors(range=0.8, rate=0.3)),
    "ionosphere": replace(NO_ERRORS, ionosphere=ERRORS.ionosphere),
    "troposphere": replace(NO_ERRORS, troposphere=ERRORS.troposphere),
    "multipath": replace(NO_ERRORS, multipath=gps_settings.Multipath(range=0.5, time=7.0)),
    "none": NO_ERRORS,
}
CASES["all"] = replace(ERRORS, satellite=CASES["satellite"].satellite, multipath=CASES["multipath"].multipath)


@pytest.fixture
def given_delays(monkeypatch):
    """Delays that are known, in place of those of the models."""
    ionosphere, troposphere = delays(IONOSPHERE_M, IONOSPHERE_M_S), delays(TROPOSPHERE_M, TROPOSPHERE_M_S)

    def ionospheric(settings, gps_s, r_ea_e, u_e):
        np.testing.assert_allclose(gps_s, GPS_START_S + T_S)  # mission time zero is the start's GPS time
        return ionosphere

    monkeypatch.setattr(gps_errors, "ionospheric_delay", ionospheric)
    monkeypatch.setattr(gps_errors, "tropospheric_delay", lambda r_ea_e, u_e: troposphere)


@pytest.mark.parametrize("case", CASES)
def test_errors_have_the_covariance_of_their_physics(given_delays, case):
    settings, rng = CASES[case], np.random.default_rng(5)
    r_e, u_e = np.zeros((len(T_S), 3)), np.zeros((len(T_S), SATELLITES, 3))
    draws = [
        gps_errors.range_errors(settings, GPS_START_S, T_S, r_e, u_e, rng)
        for _ in range(DRAWS if case != "none" else 1)
    ]
    expected = covariance(settings)
    assert_covariance(np.array([one.error.ravel() for one in draws]), expected)
    for one in draws[:2]:  # what is reported is the diagonal, draw by draw
        np.testing.assert_allclose(one.variance.ravel(), np.diag(expected), rtol=1e-9, atol=1e-15)
    shape = 2, len(T_S), SATELLITES, 2, len(T_S), SATELLITES
    between = np.einsum("amnamp->amnp", expected.reshape(shape))[..., 0, 1]  # two satellites, one epoch
    shared = np.einsum("kamn,kamp->amnp", draws[0].shared, draws[0].shared)[..., 0, 1]
    np.testing.assert_allclose(shared, between, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("height", [0.0, 300e3, 500e3])
def test_fixes_scatter_as_their_covariance_says(height):
    """From low orbit rays lead down through the whole layer: what all satellites share moves the height."""
    settings = replace(CASES["ionosphere"], troposphere=ERRORS.troposphere)
    t_s, rng = T_S[:2], np.random.default_rng(8)
    r_e = np.tile(wgs84.ecef_from_geodetic(0.5, 0.3, height), (2, 1))
    u_e = gnss.lines_of_sight_e(r_e, gnss.positions_e(CONSTELLATION, t_s))
    tracked = gnss.elevation(r_e, u_e) > (np.radians(5.0) if height == 0.0 else np.radians(-12.0))
    given = settings, GPS_START_S, t_s, r_e, u_e, rng
    draws = [gps_errors.range_errors(*given) for _ in range(DRAWS)]
    errors = np.array([gps.solve(u_e, tracked, one.error)[2][0, 0] for one in draws])
    R = gps.spread(u_e, tracked, draws[0].variance, draws[0].shared)[0, 0]
    assert_covariance(errors, R)
    alone = gps.spread(u_e, tracked, draws[0].variance, 0.0 * draws[0].shared)[0, 0]
    up = wgs84.dcm_en(0.5, 0.3)[:, 2]
    ratio = math.sqrt((up @ R @ up) / (up @ alone @ up))
    assert (ratio > 1.2) == (height > 0.0), ratio


@pytest.mark.parametrize("hours", [0.0, 0.5, 3.0, 24.0])
def test_errors_of_satellites_are_as_large_after_hours_as_at_the_start(hours):
    """0.8 m and 0.5 mm/s, of 20 000 satellites, within five sigma; the rate is what the error changes by."""
    settings = replace(NO_ERRORS, satellite=gps_settings.SatelliteErrors(range=0.8, rate=0.5e-3))
    t_s = np.array([0.0, 3600.0 * hours, 3600.0 * hours + 1.0])
    none = np.zeros((3, 3)), np.zeros((3, 20_000, 3))
    got = gps_errors.range_errors(settings, GPS_START_S, t_s, *none, np.random.default_rng(6))
    for error, variance, sigma in zip(got.error, got.variance, (0.8, 0.5e-3), strict=True):
        np.testing.assert_allclose(error.std(axis=1), sigma, rtol=5.0 / np.sqrt(40_000))
        np.testing.assert_allclose(variance, sigma**2)
    np.testing.assert_allclose(np.diff(got.error[0], axis=0)[1], got.error[1][1:].mean(axis=0), atol=1e-9)


def test_satellites_without_a_rate_keep_their_error():
    settings = replace(NO_ERRORS, satellite=gps_settings.SatelliteErrors(range=0.8, rate=0.0))
    t_s, none = 1000.0 * np.arange(5), (np.zeros((5, 3)), np.zeros((5, 30, 3)))
    error, rate = gps_errors.range_errors(settings, GPS_START_S, t_s, *none, np.random.default_rng(6)).error
    assert np.all(error == error[0]) and np.all(rate == 0.0) and error.std() > 0.5


def test_at_two_epochs_delays_change_by_their_difference(monkeypatch):
    """The range rate is what the range error changes by in a second, with the sign of a troposphere."""
    delay = delays(TROPOSPHERE_M, TROPOSPHERE_M_S)[:2]
    monkeypatch.setattr(gps_errors, "tropospheric_delay", lambda r_ea_e, u_e: delay)
    one = gps_errors.range_errors(
        CASES["troposphere"],
        GPS_START_S,
        T_S[:2],
        np.zeros((2, 3)),
        np.zeros((2, 2, 3)),
        np.random.default_rng(1),
    )
    change = np.diff(one.error[0], axis=0)[0] / (T_S[1] - T_S[0])
    assert np.all(np.abs(change) > 0.0)
    np.testing.assert_allclose(one.error[1], np.tile(change, (2, 1)), rtol=1e-9)


def test_at_two_epochs_multipath_decays_by_the_time_between_them():
    rng, settings = np.random.default_rng(7), CASES["multipath"]
    given = settings, GPS_START_S, T_S[:2], np.zeros((2, 3)), np.zeros((2, 1, 3)), rng
    drawn = np.array([gps_errors.range_errors(*given).error[0, :, 0] for _ in range(4 * DRAWS)])
    decay = np.exp(-(T_S[1] - T_S[0]) / settings.multipath.time)
    assert_covariance(drawn, settings.multipath.range**2 * np.array([[1.0, decay], [decay, 1.0]]))


def test_at_one_epoch_delays_do_not_change(monkeypatch):
    """No rate can be told from a single epoch; the range errors are as ever."""
    monkeypatch.setattr(gps_errors, "tropospheric_delay", lambda r_ea_e, u_e: np.full((1, 2), 20.0))
    settings = replace(CASES["all"], ionosphere=None)
    one = gps_errors.range_errors(
        settings, GPS_START_S, T_S[:1], np.zeros((1, 3)), np.zeros((1, 2, 3)), np.random.default_rng(1)
    )
    expected = 0.8**2 + (settings.troposphere.residual * 20.0) ** 2 + 0.5**2
    np.testing.assert_allclose(one.variance[0], expected, rtol=1e-12)
    np.testing.assert_allclose(one.variance[1], 0.3**2, rtol=1e-12)


def east_north_up(latitude, longitude, height=0.0):
    """Axes at a place, from differences of positions: (3, 3), rows."""
    h, at = 1e-7, wgs84.ecef_from_geodetic
    moved = [
        at(latitude, longitude + h, height) - at(latitude, longitude - h, height),
        at(latitude + h, longitude, height) - at(latitude - h, longitude, height),
        at(latitude, longitude, height + 1.0) - at(latitude, longitude, height - 1.0),
    ]
    return np.array([one / np.linalg.norm(one) for one in moved])


PLACES = [(1.21, 0.28), (-0.6, 2.5), (0.3, -1.9)]  # rad, latitude and longitude
ANGLES = np.deg2rad([(85.0, 10.0), (40.0, 100.0), (40.0, -80.0), (12.0, 190.0), (12.0, -5.0)])


def rays(latitude, longitude, angles=ANGLES):
    """Lines of sight (n, 3), frame e, by elevation and azimuth (n, 2) rad."""
    elevation, azimuth = np.transpose(angles)
    level = np.stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)], axis=1
    )
    return level @ east_north_up(latitude, longitude)


@pytest.mark.parametrize("place", PLACES)
def test_azimuths_count_from_north_over_east(place):
    at = np.array([[place[0]], [place[1]]])
    got = gps_errors.azimuths(at[:1], at[1:], rays(*place)[None])[0]
    np.testing.assert_allclose(np.exp(1j * got), np.exp(1j * ANGLES[:, 1]), atol=1e-6)


def broadcast_delay(alpha, beta, latitude, longitude, elevation, azimuth, gps_s):
    """IS-GPS-200, 20.3.3.5.2.5, line by line: m at L1."""
    E, A = elevation / math.pi, azimuth
    F = 1.0 + 16.0 * (0.53 - E) ** 3
    psi = 0.0137 / (E + 0.11) - 0.022
    phi_i = max(-0.416, min(0.416, latitude / math.pi + psi * math.cos(A)))
    lambda_i = longitude / math.pi + psi * math.sin(A) / math.cos(phi_i * math.pi)
    phi_m = phi_i + 0.064 * math.cos((lambda_i - 1.617) * math.pi)
    t = (4.32e4 * lambda_i + gps_s) % 86400.0
    PER = max(sum(b * phi_m**k for k, b in enumerate(beta)), 72000.0)
    AMP = max(sum(a * phi_m**k for k, a in enumerate(alpha)), 0.0)
    x = 2.0 * math.pi * (t - 50400.0) / PER
    day = AMP * (1.0 - x**2 / 2.0 + x**4 / 24.0) if abs(x) < 1.57 else 0.0
    return SPEED_OF_LIGHT * F * (5e-9 + day)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("height", [0.0, -40.0])
def test_on_the_ground_the_ionosphere_is_that_of_the_broadcast_model(place, height):
    """Seen over half a day; below sea level as at it: the model knows no height."""
    settings, gps_s = ERRORS.ionosphere, GPS_START_S + np.arange(0.0, 43200.0, 7200.0)
    r_e = np.tile(wgs84.ecef_from_geodetic(*place, height), (len(gps_s), 1))
    got = gps_errors.ionospheric_delay(settings, gps_s, r_e, np.tile(rays(*place), (len(gps_s), 1, 1)))
    for k, at_s in enumerate(gps_s):
        expected = [broadcast_delay(settings.alpha, settings.beta, *place, *ray, at_s) for ray in ANGLES]
        np.testing.assert_allclose(got[k], expected, rtol=1e-6)
    assert got.max() > 2.0 * got.min()  # day and night, high and low


def test_half_the_electrons_are_above_their_median_height():
    """To the zenith: erf(exp(-z/2)/sqrt(2)) of a Chapman layer are above z, half at 0.6745 = exp(-z/2)."""
    place, height = PLACES[0], 350e3 - 2.0 * 60e3 * math.log(0.674489750)
    r_e = wgs84.ecef_from_geodetic(*place, height)[None]
    low_e = wgs84.ecef_from_geodetic(*place, 0.0)[None]
    up_e = rays(*place, [(np.pi / 2, 0.0)])[None]
    at_s = np.array([GPS_START_S])
    high, low = (gps_errors.ionospheric_delay(ERRORS.ionosphere, at_s, one, up_e) for one in (r_e, low_e))
    np.testing.assert_allclose(high / low, 0.5, atol=5e-3)


@pytest.mark.parametrize("height", [-40.0, 0.0, 3e3, 20e3])
def test_rays_that_lead_up_pass_the_air_above(height):
    """Zenith delay times the cosecant at high elevations; at sea level 2.307 m + 0.12 m."""
    place = PLACES[0]
    r_e = wgs84.ecef_from_geodetic(*place, height)[None]
    above = max(height, 0.0)
    zenith = 2.307 * np.exp(-above / 7.5e3) + 0.12 * np.exp(-above / 2e3)
    got = gps_errors.tropospheric_delay(r_e, rays(*place, [(np.pi / 2, 0.0), (0.7, 2.0)])[None])[0]
    np.testing.assert_allclose(got, zenith / np.sin([np.pi / 2, 0.7]), rtol=2e-3)


@pytest.mark.parametrize("down", [0.02, 0.05, 0.12])
def test_rays_that_lead_down_pass_thick_air_twice(down):
    """From 20 km: the lowest point of the ray is found by trying. Below ground it counts as sea level."""
    place, height = PLACES[0], 20e3
    r_e, u_e = wgs84.ecef_from_geodetic(*place, height), rays(*place, [(-down, 1.0)])[0]
    heights = [wgs84.geodetic_from_ecef(r_e + s * u_e)[2] for s in np.linspace(0.0, 2e6, 4001)]
    lowest = max(min(heights), 0.0)
    zenith = [2.307 * np.exp(-h / 7.5e3) + 0.12 * np.exp(-h / 2e3) for h in (height, lowest)]
    at_level, upwards = 1.001 / np.sqrt(0.002001), 1.001 / np.sqrt(0.002001 + np.sin(down) ** 2)
    got = gps_errors.tropospheric_delay(r_e[None], u_e[None, None])[0, 0]
    assert got == pytest.approx(2.0 * at_level * zenith[1] - upwards * zenith[0], rel=0.02)  # of a sphere


def test_geodetic_is_one_column_a_coordinate():
    wanted = np.array([(1.2, 0.3, 1e5), (-0.4, -2.0, 50.0)])
    got = gps_errors.geodetic(np.array([wgs84.ecef_from_geodetic(*one) for one in wanted]))
    assert got.shape == (3, 2, 1)
    np.testing.assert_allclose(got[..., 0].T, wanted, rtol=1e-9)


def test_clock_noise_is_that_of_integrated_white_noise():
    """Against Van Loan's matrix exponential of db/dt = d + w_f, dd/dt = w_g."""
    white, walk, T = 0.7, 0.3, 2.5
    F, Q = np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([white, walk])
    big = linalg.expm(np.block([[-F, Q], [np.zeros((2, 2)), F.T]]) * T)
    got = gps_errors.clock_noise(white, walk, T)
    np.testing.assert_allclose(got, big[2:, 2:].T @ big[:2, 2:], rtol=1e-12)


@pytest.mark.parametrize("white, walk", [(0.0, 0.0), (0.4, 0.0), (0.0, 0.2), (0.4, 0.2), (4e-4, 2e-4)])
def test_factor_is_triangular_and_squares_to_the_covariance(white, walk):
    Q = gps_errors.clock_noise(white, walk, 3.0)
    L = gps_errors.factor(Q)
    assert L[0, 1] == 0.0
    np.testing.assert_allclose(L @ L.T, Q, rtol=1e-9, atol=1e-16)


def test_clocks_at_uneven_times_have_the_covariance_of_their_noise():
    """Bias and drift at three times: what a Wiener drift and its integral have in common between any two."""
    sigma_b, sigma_d, white, walk = 3.0, 0.4, 0.5, 0.02
    t_s, rng = np.array([10.0, 11.0, 18.0, 21.0]), np.random.default_rng(8)
    settings = oscillator(sigma_b, sigma_d, white, walk)
    runs = np.array([np.concatenate(gps_errors.clock(settings, t_s, rng)) for _ in range(DRAWS)])
    s = t_s - t_s[0]
    early, late = np.minimum.outer(s, s), np.maximum.outer(s, s)
    drifts = sigma_d**2 + walk * early
    biases = sigma_b**2 + sigma_d**2 * np.outer(s, s) + white * early
    biases += walk * early**2 * (3.0 * late - early) / 6.0
    # E[b(s) d(t)]: the drift of every instant before s has min(., t) of the walk
    tie = sigma_d**2 * s[:, None] + walk * np.array(
        [[a * t - t**2 / 2.0 if t < a else a**2 / 2.0 for t in s] for a in s]
    )
    assert_covariance(runs, np.block([[biases, tie], [tie.T, drifts]]))


def test_a_clock_without_noise_runs_evenly():
    t_s = np.array([5.0, 6.0, 9.0, 9.5])
    bias, drift = gps_errors.clock(oscillator(100.0, 7.0), t_s, np.random.default_rng(2))
    assert np.ptp(drift) == 0.0 and abs(drift[0]) > 0.0 and abs(bias[0]) > 0.0
    np.testing.assert_allclose(bias, bias[0] + drift[0] * (t_s - t_s[0]), rtol=1e-12)


def test_satellites_of_a_constellation_have_errors_of_their_own():
    """With the models themselves: the ionosphere and the air make ranges of one epoch err together."""
    r_e = np.tile(wgs84.ecef_from_geodetic(1.2, 0.3, 0.0), (2, 1))
    u_e = gnss.lines_of_sight_e(r_e, gnss.positions_e(CONSTELLATION, T_S[:2]))
    for name, apart in (("satellite", True), ("ionosphere", True), ("troposphere", False)):
        given = GPS_START_S, T_S[:2], r_e, u_e, np.random.default_rng(3)
        errors = gps_errors.range_errors(CASES[name], *given)
        standard = errors.error[0, 0] / np.sqrt(errors.variance[0, 0])
        assert (np.ptp(standard) > 0.1) == apart
