"""Each term of the error model against its equation, noise by statistics, counting and clipping."""

import numpy as np
import pytest
import synthetic_trajectory as synthetic
from imu_settings import PERFECT, TRIADS, imu_with
from scipy import signal, stats
from scipy_bits import assert_as_scipy

from shefex_nav.records import rows
from shefex_nav.settings import changed
from shefex_nav.verify import bound
from shefex_nav.world import imu, noise, vibration

DT_S = 1.0 / synthetic.RATE_HZ
G = 9.80665  # m/s^2
REAL = imu_with(
    PERFECT,
    gyro_bias=2.4e-6,
    gyro_in_run_bias=4.8e-7,
    gyro_random_walk=8.7e-6,
    gyro_scale_factor_roll=30e-6,
    gyro_scale_factor=100e-6,
    gyro_misalignment=5e-5,
    gyro_g_sensitivity=2.5e-7,
    gyro_vibration_rectification=1e-9,
    gyro_range=17.5,
    gyro_quantum=4.8e-7,
    accel_bias=4.9e-3,
    accel_in_run_bias=4.9e-4,
    accel_random_walk=5e-4,
    accel_scale_factor=300e-6,
    accel_misalignment=1e-4,
    accel_vibration_rectification=2e-6,
    accel_range=40 * G,
    accel_quantum=5e-5,
    vibration_boost=(7 * G, 3.5 * G),
    vibration_coast=0.02 * G,
    vibration_angular=5.3e-4,
)


SHAKEN = imu_with(PERFECT, vibration_boost=(7 * G,))


@pytest.fixture(scope="module")
def flight():
    return synthetic.fly()


def measure(params, trajectory, seed=1):
    return imu.measure(params, trajectory, noise.generator(seed, "imu"))


def true_sigma(name):
    """What REAL says of an error of `ImuErrors`."""
    triad, _, setting = name.partition("_")
    return getattr(getattr(REAL, TRIADS[triad]), setting)


def variance_is(samples, variance, confidence=0.999):
    """Whether zero-mean independent normal samples have this variance."""
    low, high = stats.chi2.interval(confidence, samples.size)
    return low < np.sum(samples**2) / variance < high


def test_a_perfect_instrument_reports_the_truth(flight):
    data = measure(PERFECT, flight)
    np.testing.assert_array_equal(data.dtheta_b, flight.dtheta_b)
    np.testing.assert_array_equal(data.dv_b, flight.dv_b)
    assert not data.saturated.any()


def test_constant_errors_follow_their_equation(flight):
    """Every constant term at once, against the equation written for one sample."""
    params = imu_with(REAL, 
        gyro_in_run_bias=0, gyro_random_walk=0, gyro_quantum=0, accel_in_run_bias=0, accel_random_walk=0,
        accel_quantum=0, vibration_angular=0, vibration_coast=0, vibration_boost=(0.0,),
    )  # fmt: skip
    data = measure(params, flight)
    e = data.errors
    for k in (1, 4001, 9000, 20000):
        dtheta, dv = flight.dtheta_b[k], flight.dv_b[k]
        rate = dtheta * (1 + e.gyro_scale_factor) + e.gyro_misalignment @ dtheta + e.gyro_g_sensitivity @ dv
        np.testing.assert_allclose(data.dtheta_b[k], rate + e.gyro_bias * DT_S, atol=1e-15)
        force = dv * (1 + e.accel_scale_factor) + e.accel_misalignment @ dv
        np.testing.assert_allclose(data.dv_b[k], force + e.accel_bias * DT_S, atol=1e-15)
    assert np.all(np.diag(e.gyro_misalignment) == 0.0) and np.all(np.diag(e.accel_misalignment) == 0.0)
    assert np.count_nonzero(e.gyro_g_sensitivity) == 9


def test_drawn_errors_have_their_sigmas():
    """400 runs, chi-square at 99.9 % per kind; the roll axis of the gyros has a scale factor of its own."""
    runs = [imu.draw_errors(REAL, noise.generator(seed, "imu")) for seed in range(400)]
    roll = np.array([run.gyro_scale_factor[0] for run in runs])
    across = np.array([run.gyro_scale_factor[1:] for run in runs])
    assert variance_is(roll, REAL.gyro.scale_factor_roll**2)
    assert variance_is(across, REAL.gyro.scale_factor**2)
    off_diagonal = ~np.eye(3, dtype=bool)
    for name in ("gyro_bias", "gyro_g_sensitivity", "accel_bias", "accel_scale_factor"):
        assert variance_is(np.array([getattr(run, name) for run in runs]), true_sigma(name) ** 2)
    for name in ("gyro_misalignment", "accel_misalignment"):
        sample = np.array([getattr(run, name)[off_diagonal] for run in runs])
        assert variance_is(sample, true_sigma(name) ** 2)
    for name in ("gyro_vibration_rectification", "accel_vibration_rectification"):
        assert variance_is(np.array([getattr(run, name) for run in runs]), true_sigma(name) ** 2)


@pytest.mark.parametrize("window", [1, 40, 1600])
def test_random_walks_grow_with_the_root_of_time(window):
    """Sums over windows have variance sigma^2 t; 120 000 samples, three axes, chi-square at 99.9 %."""
    params = imu_with(PERFECT, gyro_random_walk=8.7e-6, accel_random_walk=5e-4)
    data = measure(params, synthetic.still(120_001))
    for increments, sigma in ((data.dtheta_b, 8.7e-6), (data.dv_b, 5e-4)):
        sums = increments[1:].reshape(-1, window, 3).sum(axis=1)
        assert variance_is(sums, sigma**2 * window * DT_S)


def test_in_run_bias_wanders_within_its_sigma():
    """300 runs of 10 s with tau 5 s: bias at both ends has the variance asked for, chi-square at 99.9 %."""
    params = imu_with(
        PERFECT,
        gyro_in_run_bias=1e-3,
        gyro_in_run_bias_time=5.0,
        accel_in_run_bias=2.0,
        accel_in_run_bias_time=5.0,
    )
    still = synthetic.still(4001)
    runs = [measure(params, still, seed) for seed in range(300)]
    for k in (1, 4000):
        assert variance_is(np.array([run.dtheta_b[k] for run in runs]) / DT_S, 1e-3**2)
        assert variance_is(np.array([run.dv_b[k] for run in runs]) / DT_S, 2.0**2)
    first, last = (np.array([run.dv_b[k] for run in runs]).ravel() for k in (1, 4000))
    fisher = np.arctanh(np.corrcoef(first, last)[0, 1]) - np.arctanh(np.exp(-10.0 / 5.0))
    assert abs(fisher) < stats.norm.ppf(0.9995) / np.sqrt(first.size - 3)


def band(weight, rms):
    """Integral of the flat vibration spectrum times weight(f) over 20 to 2000 Hz."""
    f = np.linspace(20.0, 2000.0, 400_001)
    return np.trapezoid(weight(f), f) * rms**2 / (2000.0 - 20.0)


def test_vibration_has_the_size_of_its_spectrum():
    """60 s at 7 g rms: increments and accumulated velocity against the integrals of the spectrum, within 4 %.

    An increment is acceleration through |H| = sin(pi f dt)/(pi f), the velocity through 1/(2 pi f). The
    3 axes have 70 000 samples, scatter about 1 %; the filter's edge and the part above 2 kHz are the rest.
    """
    data = measure(SHAKEN, synthetic.still(24_001, burning=1))
    increment = np.sqrt(band(lambda f: (np.sin(np.pi * f * DT_S) / (np.pi * f)) ** 2, 7 * G))
    velocity = np.sqrt(band(lambda f: 1.0 / (2.0 * np.pi * f) ** 2, 7 * G))
    assert increment == pytest.approx(0.051, abs=0.001)  # the figures of the module's docstring
    assert velocity == pytest.approx(0.055, abs=0.001)
    assert np.std(data.dv_b[1:]) == pytest.approx(increment, rel=0.04)
    assert np.std(np.cumsum(data.dv_b, axis=0)) == pytest.approx(velocity, rel=0.04)


BANDS = [(20, 2000), (5, 2000), (20, 500), (20, 200), (20, 100), (20, 60), (20, 30), (60, 2000), (150, 2000),
         (190, 2000), (2, 20), (100, 20_000)]  # fmt: skip


@pytest.mark.parametrize(("low", "high"), BANDS)
def test_vibration_of_any_band_has_the_size_of_its_spectrum(low, high):
    """Increments and accumulated velocity against integrals of the spectrum, within 6 %: the filters' edges.

    So is what the filter on board and the bound count with.
    """
    params = changed(SHAKEN, {"vibration.lowest_frequency": low, "vibration.highest_frequency": high})
    made, n = np.zeros((80_001, 3)), 80_001
    imu.add_vibration(made, params, np.full(n, 7 * G), DT_S, np.random.default_rng(7))
    f = np.linspace(low, high, 400_001)
    density = (7 * G) ** 2 / (high - low)
    over = [T * np.sqrt(density * np.trapezoid(np.sinc(f * T) ** 2, f)) for T in (DT_S, 2.0 * DT_S)]
    velocity = np.sqrt(density * np.trapezoid(1.0 / (2.0 * np.pi * f) ** 2, f))
    assert made.std() == pytest.approx(over[0], rel=0.06)
    # two samples have next to nothing about 200 Hz, but of what leaks through a filter at 150 Hz
    assert (made[1:] + made[:-1]).std() == pytest.approx(over[1], rel=0.12 if low == 150 else 0.06)
    assert np.cumsum(made, axis=0).std() == pytest.approx(velocity, rel=0.06)
    assert bound.swing(params, 7 * G, DT_S) == pytest.approx(velocity, rel=0.06)
    if (low, high) not in ((20, 2000), (5, 2000)):  # of which they count all as white
        told = np.sqrt(0.5 * density * DT_S * vibration.share(params.vibration, DT_S))
        assert told == pytest.approx(over[0], rel=0.02)


def test_spectrum_of_a_narrow_band_ends_where_it_is_told_to():
    """20 to 100 Hz of 200, by averaged periodograms: next to nothing beyond its ends."""
    params = changed(SHAKEN, {"vibration.lowest_frequency": 20.0, "vibration.highest_frequency": 100.0})
    made = np.zeros((200_001, 3))
    imu.add_vibration(made, params, np.full(200_001, 1.0), DT_S, np.random.default_rng(8))
    f, density = signal.welch(made[1:, 0] / DT_S, 400.0, nperseg=4000)
    inside = density[(f > 35.0) & (f < 60.0)].mean()
    assert inside == pytest.approx(1.0 / 80.0 * np.sinc(47.5 * DT_S) ** 2, rel=0.05)
    assert density[f < 8.0].max() < 0.01 * inside and density[f > 180.0].max() < 0.02 * inside


def test_band_of_the_vibration_changes_no_other_number():
    """Turn-on bias, walk and all else that is drawn of a seed is the same beside any band."""
    still = synthetic.still(2001)  # no motor burns, and no vibration without
    narrow = changed(REAL, {"vibration.highest_frequency": 100.0, "vibration.coast": 0.0})
    wide = changed(REAL, {"vibration.coast": 0.0})
    np.testing.assert_array_equal(measure(narrow, still).dv_b, measure(wide, still).dv_b)


@pytest.mark.parametrize("cycles", [0.001, 0.05, 0.2, 0.45])
@pytest.mark.parametrize("kind", ["highpass", "lowpass"])
def test_filter_of_the_vibration_is_a_butterworth(cycles, kind):
    _, expected = signal.sosfreqz(signal.butter(4, 2.0 * cycles, kind, output="sos"))
    _, response = signal.sosfreqz(imu._butterworth(cycles, high=kind == "highpass"))
    np.testing.assert_allclose(response, expected, atol=1e-10)


def test_filter_of_the_vibration_in_pieces_is_that_of_scipy():
    white, sections = np.random.default_rng(4).standard_normal((3, 500)).T, imu._butterworth(0.05)
    expected, state = signal.sosfilt(sections, white, axis=0), np.zeros((2, 2, 3))
    pieces = [np.ascontiguousarray(one) for one in (white[:123], white[123:])]
    for one in pieces:
        imu._filter(sections, one, state)
    assert_as_scipy(np.concatenate(pieces), expected)


def test_vibration_leaves_no_velocity_behind_even_in_spin():
    """Summed over 60 s at 7 g rms, in body axes or turned at 1.5 Hz, it stays within 5 sigma."""
    data = measure(SHAKEN, synthetic.still(24_001, burning=1))
    angle = synthetic.SPIN * data.t_s
    turned = data.dv_b[:, 1] * np.cos(angle) - data.dv_b[:, 2] * np.sin(angle)
    assert np.abs(np.cumsum(turned)).max() < 5 * 0.055
    assert np.abs(np.cumsum(data.dv_b, axis=0)).max() < 5 * 0.055


def test_vibration_follows_the_motor(flight):
    params = imu_with(SHAKEN, vibration_coast=0.02 * G, vibration_angular=5.3e-4)
    data = measure(params, flight)
    noisy_v, noisy_theta = data.dv_b - flight.dv_b, data.dtheta_b - flight.dtheta_b
    boost = flight.burning == 1
    coast = flight.t_s > synthetic.BURN_S + 1.0
    for increments in (noisy_v, noisy_theta):
        assert np.std(increments[boost]) / np.std(increments[coast]) == pytest.approx(350.0, rel=0.05)
    assert np.std(noisy_theta[boost]) / np.std(noisy_v[boost]) == pytest.approx(5.3e-4, rel=0.03)
    level = imu.vibration_rms(REAL, np.array([0, 1, 2, 0], np.int8))
    np.testing.assert_allclose(level / G, [0.02, 7.0, 3.5, 0.02])
    no_stages = imu_with(REAL, vibration_boost=())
    np.testing.assert_allclose(imu.vibration_rms(no_stages, np.zeros(2, np.int8)) / G, 0.02)


def test_rectification_is_a_bias_that_grows_with_the_square_of_the_vibration(flight):
    params = imu_with(SHAKEN, accel_vibration_rectification=2e-6, gyro_vibration_rectification=1e-9)
    with_it = measure(params, flight)
    without = measure(
        imu_with(params, accel_vibration_rectification=0, gyro_vibration_rectification=0), flight
    )
    boost = (flight.burning == 1)[:, None]
    e = with_it.errors
    expected_v = np.where(boost, e.accel_vibration_rectification * (7 * G) ** 2 * DT_S, 0.0)
    expected_theta = np.where(boost, e.gyro_vibration_rectification * (7 * G) ** 2 * DT_S, 0.0)
    np.testing.assert_allclose(with_it.dv_b - without.dv_b, expected_v, atol=1e-15)
    np.testing.assert_allclose(with_it.dtheta_b - without.dtheta_b, expected_theta, atol=1e-15)


def test_quantised_increments_are_whole_quanta_and_do_not_drift(flight):
    data = measure(imu_with(PERFECT, gyro_quantum=1e-4, accel_quantum=0.01), flight)
    for counted, ideal, quantum in ((data.dtheta_b, flight.dtheta_b, 1e-4), (data.dv_b, flight.dv_b, 0.01)):
        counts = counted / quantum
        np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
        drift = np.abs(np.cumsum(counted, axis=0) - np.cumsum(ideal, axis=0))
        assert drift.max() <= 0.5 * quantum * (1 + 1e-6)


def test_quantise_against_counting_with_a_remainder():
    increments = np.random.default_rng(3).normal(0.3, 1.0, (200, 3))
    remainder = np.zeros(3)
    counted = increments.copy()
    imu.quantise(counted, 0.25)
    for k in range(200):
        counts = np.rint((increments[k] + remainder) / 0.25)
        remainder += increments[k] - counts * 0.25
        np.testing.assert_allclose(counted[k], counts * 0.25, atol=1e-12)


def test_samples_at_the_range_are_flagged_and_held():
    still = synthetic.still(100)
    dv_b, dtheta_b = np.zeros((100, 3)), np.zeros((100, 3))
    dv_b[40:45, 0] = 50 * G * DT_S
    dv_b[60, 1] = -41 * G * DT_S
    dtheta_b[80, 2] = -20.0 * DT_S
    dv_b[90, 0] = 39 * G * DT_S
    data = measure(
        imu_with(PERFECT, accel_range=40 * G, gyro_range=17.5), still._replace(dv_b=dv_b, dtheta_b=dtheta_b)
    )
    assert np.flatnonzero(data.saturated).tolist() == [40, 41, 42, 43, 44, 60, 80]
    assert data.dv_b[42, 0] == pytest.approx(40 * G * DT_S)
    assert data.dv_b[60, 1] == pytest.approx(-40 * G * DT_S)
    assert data.dtheta_b[80, 2] == pytest.approx(-17.5 * DT_S)
    assert data.dv_b[90, 0] == pytest.approx(39 * G * DT_S)


def test_blocks_are_views_of_four_samples_ending_at_the_tick(flight):
    data = measure(REAL, flight)
    saturated = data.saturated.copy()
    saturated[4 * 7 - 3] = True  # oldest sample of the seventh block
    data = data._replace(saturated=saturated)
    all_blocks = rows(imu.stacked(data))
    assert len(all_blocks) == 6000
    for n in (1, 7, 6000):
        block = all_blocks[n - 1]
        assert block.t_valid_s == -10.0 + n / 100
        assert block.dt_s == pytest.approx(DT_S)
        np.testing.assert_array_equal(block.dtheta_b, data.dtheta_b[4 * n - 3 : 4 * n + 1])
        np.testing.assert_array_equal(block.dv_b, data.dv_b[4 * n - 3 : 4 * n + 1])
        assert np.shares_memory(block.dv_b, data.dv_b) and block.dv_b.flags.c_contiguous
        assert block.saturated == (n == 7)


def test_pieces_leave_no_trace(flight, monkeypatch):
    """Filters, biases and sums go on from piece to piece, and the same numbers are drawn."""
    whole = measure(REAL, flight)
    monkeypatch.setattr(imu, "PIECE", 777)
    pieces = measure(REAL, flight)
    assert len(flight.t_s) > 777
    np.testing.assert_array_equal(pieces.dtheta_b, whole.dtheta_b)
    np.testing.assert_array_equal(pieces.dv_b, whole.dv_b)
    np.testing.assert_array_equal(pieces.saturated, whole.saturated)


def test_same_seed_same_bytes_and_one_sensor_does_not_disturb_the_other(flight):
    data, again = measure(REAL, flight), measure(REAL, flight)
    assert data.dtheta_b.tobytes() == again.dtheta_b.tobytes()
    assert data.dv_b.tobytes() == again.dv_b.tobytes()
    coarse = measure(imu_with(REAL, gyro_scale_factor_roll=300e-6, gyro_in_run_bias=0.0), flight)
    assert data.dv_b.tobytes() == coarse.dv_b.tobytes()
    np.testing.assert_allclose(coarse.errors.gyro_scale_factor[0], 10 * data.errors.gyro_scale_factor[0])
    np.testing.assert_array_equal(coarse.errors.gyro_scale_factor[1:], data.errors.gyro_scale_factor[1:])
