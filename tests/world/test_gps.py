"""GPS fixes: the antenna's true state, who is visible, consistency of noise and covariance, outages, spin."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_trajectory as synthetic
from imu_settings import PERFECT, imu_with
from scipy import stats

from shefex_nav.environment import gnss
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.settings import changed
from shefex_nav.world import gps, gps_receiver, gps_settings, imu, noise

GPS_START_S = 500_000.0
CONSTELLATION = gnss.nominal_24("2012-06-22T19:18:00Z")
NO_ERRORS = gps_settings.RangeErrors(satellite=None, ionosphere=None, troposphere=None, multipath=None)
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
    antenna=gps_settings.Antenna(
        lever_arm=(0.6, 0.05, -0.03), blind_nose=np.deg2rad(30.0), blind_tail=np.deg2rad(30.0)
    ),
    spin=gps_settings.Spin(threshold=np.deg2rad(90.0), loss=0.2, noise_factor=2.0),
    outages=(
        gps_settings.GpsOutage(event="lift_off", shortest=0.0, longest=2.0),
        gps_settings.GpsOutage(event="burn_out_1", shortest=3.0, longest=20.0),
    ),
    clock=gps_settings.Clock(bias=0.0, drift=0.0, h_0=0.0, h_minus_2=0.0),
    errors=NO_ERRORS,
    only=(),
    reacquisition=None,
)
CALM = changed(PARAMS, {"outages": (), "spin.threshold": np.inf})


@pytest.fixture(scope="module")
def flight():
    return synthetic.fly()


def received(params, flight, seed=1, events=synthetic.EVENTS):
    rngs = noise.generator(seed, "gps"), noise.generator(seed, "gps_errors")
    return gps.measure(params, flight, events, synthetic.EARTH, CONSTELLATION, GPS_START_S, *rngs)


def measure(params, flight, seed=1, events=synthetic.EVENTS):
    return received(params, flight, seed, events).fixes


def numbers(fixes):
    """Everything measured in one array, to compare runs."""
    return np.array([[f.t_valid_s, f.valid, *f.r_ea_e, *f.v_ea_e, *f.R_r_e.ravel(), f.pdop] for f in fixes])


def test_one_fix_every_second_available_after_the_latency(flight):
    fixes = measure(PARAMS, flight)
    assert [fix.t_valid_s for fix in fixes] == list(np.arange(-10.0, 51.0))
    assert all(fix.t_available_s == pytest.approx(fix.t_valid_s + 0.2) for fix in fixes)


def test_a_start_between_seconds_keeps_to_whole_seconds():
    fixes = measure(CALM, synthetic.fly(start_s=-2.3, end_s=1.5))
    assert [fix.t_valid_s for fix in fixes] == [-2.0, -1.0, 0.0, 1.0]


def test_runs_of_a_flight_share_their_sky(flight):
    """A run takes nothing of it away. Without geometry there are no ranges; another antenna is refused."""
    seen = gps.sky(PARAMS, flight, synthetic.EARTH, CONSTELLATION)
    blank = gps.sky(PARAMS, flight, synthetic.EARTH, CONSTELLATION, with_ranges=False)

    def run(params, sky, seed):
        rngs = noise.generator(seed, "gps"), noise.generator(seed, "gps_errors")
        return gps.received(params, sky, synthetic.EVENTS, GPS_START_S, *rngs)

    for seed in (1, 2, 1):
        alone, shared, fixes = received(PARAMS, flight, seed), *(run(PARAMS, s, seed) for s in (seen, blank))
        np.testing.assert_array_equal(numbers(shared.fixes), numbers(alone.fixes))
        np.testing.assert_array_equal(numbers(fixes.fixes), numbers(alone.fixes))
        assert repr(shared.ranges) == repr(alone.ranges) and not fixes.ranges
    longer = changed(PARAMS, {"antenna.lever_arm": (0.7, 0.05, -0.03)})
    with pytest.raises(ValueError, match="another antenna"):
        run(longer, seen, 1)


@pytest.mark.parametrize("rate", [4.0, 20.0])
def test_a_faster_receiver_measures_in_between_too(flight, rate):
    """Every fix is of the truth at its instant; those of one receiver on whole seconds are as before."""
    antenna = gps.antenna_states(flight, synthetic.EARTH, PARAMS.antenna.lever_arm, rate)
    slow = gps.antenna_states(flight, synthetic.EARTH, PARAMS.antenna.lever_arm)
    assert len(antenna.t_s) == rate * (len(slow.t_s) - 1) + 1
    np.testing.assert_allclose(np.diff(antenna.t_s), 1.0 / rate, atol=1e-12)
    for name in ("r_ea_e", "v_ea_e", "t_s"):
        assert np.array_equal(getattr(antenna, name)[:: round(rate)], getattr(slow, name))
    step = 0.5 / rate * (antenna.v_ea_e[1:] + antenna.v_ea_e[:-1])  # trapezoidal rule
    calm = antenna.t_s[1:] < -1.0  # at rest on the pad
    np.testing.assert_allclose(np.diff(antenna.r_ea_e, axis=0)[calm], step[calm], atol=1e-6)
    fixes = measure(replace(CALM, rate=rate), flight)
    assert [fix.t_valid_s for fix in fixes] == antenna.t_s.tolist()


def test_a_truth_without_whole_seconds_is_an_error(flight):
    with pytest.raises(ValueError, match="1 times a second"):
        measure(CALM, flight._replace(t_s=flight.t_s + 0.001))


def test_antenna_velocity_is_the_derivative_of_its_position(flight):
    """Central difference over 5 ms, good to 1e-3 m/s; the lever arm makes 5 m/s in the spin."""
    l_ba_b = np.array([0.6, 0.5, -0.1])
    antenna = gps.antenna_states(flight, synthetic.EARTH, l_ba_b)
    for t_s in (-5.0, 10.0, 40.0):
        k = round((t_s + 10.0) * synthetic.RATE_HZ)
        r_e = [
            frames.dcm_ie(synthetic.EARTH, flight.t_s[j]).T
            @ (flight.r_i[j] + rotation.dcm_from_quat(flight.q_ib[j]) @ l_ba_b)
            for j in (k - 1, k, k + 1)
        ]
        n = round(t_s + 10.0)
        np.testing.assert_allclose(antenna.r_ea_e[n], r_e[1], atol=1e-6)
        velocity = (r_e[2] - r_e[0]) / (flight.t_s[k + 1] - flight.t_s[k - 1])
        np.testing.assert_allclose(antenna.v_ea_e[n], velocity, atol=1e-3)
    centre = gps.antenna_states(flight, synthetic.EARTH, np.zeros(3))
    offset = np.linalg.norm(antenna.v_ea_e[-1] - centre.v_ea_e[-1])
    assert offset == pytest.approx(synthetic.SPIN * np.hypot(0.5, 0.1), rel=1e-3)


def test_errors_are_as_large_as_the_receiver_reports(flight):
    """40 runs with spin degradation, about 2000 fixes: chi-square at 99.9 % of position and of velocity."""
    params = replace(PARAMS, outages=())
    antenna = gps.antenna_states(flight, synthetic.EARTH, params.antenna.lever_arm)
    position, velocity, n = 0.0, 0.0, 0
    for seed in range(40):
        for k, fix in enumerate(measure(params, flight, seed)):
            if fix.valid:
                dr, dv = fix.r_ea_e - antenna.r_ea_e[k], fix.v_ea_e - antenna.v_ea_e[k]
                position += dr @ np.linalg.solve(fix.R_r_e, dr)
                velocity += dv @ np.linalg.solve(fix.R_v_e, dv)
                n += 1
    low, high = stats.chi2.interval(0.999, 3 * n)
    assert n > 2000
    assert low < position < high
    assert low < velocity < high


def test_position_and_velocity_errors_are_independent_of_each_other_and_in_time(flight):
    """Correlation of errors along z over 40 runs, of one fix and from second to second: 99.9 % bounds."""
    antenna = gps.antenna_states(flight, synthetic.EARTH, CALM.antenna.lever_arm)
    runs = [measure(CALM, flight, seed) for seed in range(40)]
    dr = np.array([[fix.r_ea_e - r for fix, r in zip(run, antenna.r_ea_e, strict=True)] for run in runs])
    dv = np.array([[fix.v_ea_e - v for fix, v in zip(run, antenna.v_ea_e, strict=True)] for run in runs])
    dr, dv = dr[..., 2] / dr[..., 2].std(axis=0), dv[..., 2] / dv[..., 2].std(axis=0)
    bound = stats.norm.ppf(0.9995) / np.sqrt(dr[:, 1:].size)
    assert abs(np.mean(dr[:, 1:] * dv[:, 1:])) < bound
    assert abs(np.mean(dr[:, 1:] * dr[:, :-1])) < bound


def test_solution_against_least_squares_epoch_by_epoch():
    rng = np.random.default_rng(5)
    u_e = rng.standard_normal((20, 24, 3))
    u_e /= np.linalg.norm(u_e, axis=-1, keepdims=True)
    tracked = rng.random((20, 24)) < 0.3
    errors = rng.standard_normal((2, 20, 24))
    pdop, cofactor, per_sigma = gps.solve(u_e, tracked, errors)
    for m in range(20):
        if tracked[m].sum() < 4:
            assert np.isnan(pdop[m]) and np.isnan(per_sigma[:, m]).all()
            continue
        H = np.column_stack([-u_e[m, tracked[m]], np.ones(tracked[m].sum())])
        for a in range(2):
            expected = np.linalg.lstsq(H, errors[a, m, tracked[m]], rcond=None)[0][:3]
            np.testing.assert_allclose(per_sigma[a, m], expected, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(cofactor[m], np.linalg.inv(H.T @ H)[:3, :3], rtol=1e-6, atol=1e-9)
        assert pdop[m] == pytest.approx(np.sqrt(np.trace(cofactor[m])))


@pytest.mark.parametrize("height", [10.0, 10e3, 60e3, 177e3, 1000e3])
def test_fixes_at_all_heights(height):
    flight = synthetic.fly(start_s=-3.0, end_s=0.0, start_height=height)
    fixes = measure(CALM, flight)
    assert all(fix.valid and fix.reason == "" for fix in fixes)
    assert all(5 <= fix.n_satellites <= 17 and 0.8 < fix.pdop < 6.0 for fix in fixes)


def test_satellites_below_the_horizon_count_in_space_only():
    """Omnidirectional antenna: the dip of 13 degrees at 177 km adds satellites; at 10 m the mask holds."""
    omni = changed(CALM, {"antenna.blind_nose": 0.0, "antenna.blind_tail": 0.0})
    seen = {}
    for height in (10.0, 177e3):
        flight = synthetic.fly(start_s=-1.0, end_s=0.0, start_height=height)
        antenna = gps.antenna_states(flight, synthetic.EARTH, omni.antenna.lever_arm)
        u_e = gnss.lines_of_sight_e(antenna.r_ea_e, gnss.positions_e(CONSTELLATION, antenna.t_s))
        seen[height] = np.rad2deg(gnss.elevation(antenna.r_ea_e, u_e)[gps.visible(omni, antenna, u_e)])
    assert seen[10.0].min() >= 5.0
    assert -13.4 < seen[177e3].min() < 0.0
    assert len(seen[177e3]) > len(seen[10.0])


def test_fixes_in_orbit():
    """400 km: the Earth and its lowest 50 km of air hide what is more than 18.5 degrees down."""
    flight = synthetic.orbit(end_s=3.0)
    fixes = measure(CALM, flight, events=())
    assert all(fix.valid and 7 <= fix.n_satellites <= 17 and fix.pdop < 4.0 for fix in fixes)
    omni = changed(CALM, {"antenna.blind_nose": 0.0, "antenna.blind_tail": 0.0})
    antenna = gps.antenna_states(flight, synthetic.EARTH, omni.antenna.lever_arm)
    satellites_e = gnss.positions_e(CONSTELLATION, antenna.t_s)
    u_e = gnss.lines_of_sight_e(antenna.r_ea_e, satellites_e)
    seen = gps.visible(omni, antenna, u_e)
    # the angle at the vehicle between satellite and nadir, of the sphere of 50 km above a mean radius
    nadir = -antenna.r_ea_e / np.linalg.norm(antenna.r_ea_e, axis=1, keepdims=True)
    from_nadir = np.arccos(np.einsum("mnk,mk->mn", u_e, nadir))
    limb = [np.arcsin((r + 50e3) / (r + 400e3)) for r in (6357e3, 6378e3)]
    assert np.all(seen[from_nadir > max(limb) + 0.01])
    assert not np.any(seen[from_nadir < min(limb) - 0.01])
    assert np.rad2deg(gnss.elevation(antenna.r_ea_e, u_e)[seen]).min() < -5.0


def test_antenna_is_blind_about_nose_and_tail(flight):
    antenna = gps.antenna_states(flight, synthetic.EARTH, CALM.antenna.lever_arm)
    rng = np.random.default_rng(6)
    u_e = rng.standard_normal((len(antenna.t_s), 200, 3))
    u_e /= np.linalg.norm(u_e, axis=-1, keepdims=True)
    params = changed(
        CALM,
        {
            "antenna.blind_nose": np.deg2rad(30.0),
            "antenna.blind_tail": np.deg2rad(50.0),
            "elevation_mask": -np.pi,
        },
    )
    cosine = np.einsum("mnk,mk->mn", u_e, antenna.nose_e)
    expected = (cosine < np.cos(np.deg2rad(30.0))) & (cosine > -np.cos(np.deg2rad(50.0)))
    np.testing.assert_array_equal(gps.visible(params, antenna, u_e), expected)


def test_too_few_satellites_or_poor_geometry_give_no_fix_but_a_reason(flight):
    fixes = measure(changed(CALM, {"antenna.blind_nose": np.deg2rad(85.0)}), flight)
    assert all(not fix.valid and fix.reason == f"{fix.n_satellites} satellites tracked" for fix in fixes)
    assert all(np.isnan([*fix.r_ea_e, *fix.v_ea_e, fix.R_r_e[0, 0], fix.pdop]).all() for fix in fixes)
    fixes = measure(replace(CALM, max_pdop=0.5), flight)
    assert all(not fix.valid and fix.reason.startswith("pdop") for fix in fixes)
    assert all(np.isnan(fix.r_ea_e).all() and fix.pdop > 0.5 for fix in fixes)


def test_outages_begin_with_their_event_and_last_as_drawn(flight):
    """Over 200 runs the seconds lost fill their range evenly, Kolmogorov-Smirnov at 99.9 %."""
    lost = []
    for seed in range(200):
        fixes = measure(PARAMS, flight, seed)
        after_burn = [f.t_valid_s for f in fixes if f.reason == "signals lost at burn_out_1"]
        assert after_burn == list(np.arange(20.0, 20.0 + len(after_burn)))
        lost.append(len(after_burn))
        at_lift_off = [f for f in fixes if f.reason == "signals lost at lift_off"]
        assert [f.t_valid_s for f in at_lift_off] == list(np.arange(len(at_lift_off)))
        assert len(at_lift_off) <= 2
        assert all(not f.valid and f.n_satellites == 0 and np.isnan(f.r_ea_e).all() for f in at_lift_off)
    assert 3 <= min(lost) <= 4 and 19 <= max(lost) <= 20
    jitter = np.random.default_rng(7).random(200)
    assert stats.kstest(np.array(lost) - jitter, stats.uniform(3.0, 17.0).cdf).pvalue > 1e-3


def test_no_event_no_outage(flight):
    assert all(fix.valid for fix in measure(replace(CALM, outages=PARAMS.outages), flight, events=()))


def test_limits_of_speed_and_height_silence_fixes_and_ranges_and_nothing_else(flight):
    """Each by itself; other fixes keep every digit, and satellites stay tracked: no reacquisition begins."""
    waits = gps_settings.Reacquisition(shortest=5.0, longest=5.0)
    plain = received(replace(CALM, reacquisition=waits), flight)
    speed = np.linalg.norm(plain.antenna.v_ea_e, axis=1)
    height = np.array([wgs84.geodetic_from_ecef(r)[2] for r in plain.antenna.r_ea_e])
    valid = np.array([fix.valid for fix in plain.fixes])
    for key, values, scale, unit in (
        ("highest_speed", speed, 1.0, "m/s"),
        ("highest_height", height, 1e-3, "km"),
    ):
        limit = float(np.quantile(values, 0.6))
        limited = received(replace(CALM, reacquisition=waits, **{key: limit}), flight)
        over = values > limit
        assert over.any() and not over.all()
        assert np.array_equal([fix.valid for fix in limited.fixes], valid & ~over)
        assert {limited.fixes[k].reason for k in np.flatnonzero(over)} == {
            f"beyond its {scale * limit:g} {unit}"
        }
        assert not any(len(limited.ranges[k].prn) for k in np.flatnonzero(over))
        for k in np.flatnonzero(valid & ~over):
            np.testing.assert_array_equal(limited.fixes[k].r_ea_e, plain.fixes[k].r_ea_e)


def test_a_receiver_that_comes_back_within_its_limits_speaks_at_once():
    """Up and down again, faster and slower: silent exactly where it is beyond one of the two."""
    r_e = np.array([[6378137.0 + h, 0.0, 0.0] for h in (0.0, 60e3, 90e3, 60e3, 0.0)])
    v_e = np.array([[0.0, v, 0.0] for v in (0.0, 600.0, 400.0, 400.0, 0.0)])
    settings = replace(CALM, highest_speed=500.0, highest_height=80e3)
    assert gps_receiver.silenced(settings, r_e, v_e) == ["", "beyond its 500 m/s", "beyond its 80 km", "", ""]
    assert gps_receiver.silenced(CALM, r_e, v_e) == [""] * 5


def test_spin_costs_satellites_and_accuracy(flight):
    """One in five satellites goes missing (binomial, 99.9 %) and sigmas double; nothing before the spin."""
    spin = changed(CALM, {"spin.threshold": PARAMS.spin.threshold})
    noisy = changed(spin, {"spin.loss": 0.0})
    tracked = kept = 0
    for seed in range(20):
        for calm, lossy, coarse in zip(
            measure(CALM, flight, seed),
            measure(spin, flight, seed),
            measure(noisy, flight, seed),
            strict=True,
        ):
            spinning = synthetic.SPIN * np.clip(calm.t_valid_s, 0.0, 20.0) / 20.0 > spin.spin.threshold
            if spinning:
                tracked += calm.n_satellites
                kept += lossy.n_satellites
                np.testing.assert_allclose(coarse.R_r_e, 4.0 * calm.R_r_e)
                np.testing.assert_allclose(coarse.R_v_e, 4.0 * calm.R_v_e)
            else:
                np.testing.assert_array_equal(numbers([calm]), numbers([lossy]))
    low, high = stats.binom.interval(0.999, tracked, 0.8)
    assert low <= kept <= high


def test_reproducible_and_parameters_disturb_only_what_they_mean(flight):
    fixes = numbers(measure(PARAMS, flight))
    np.testing.assert_array_equal(fixes, numbers(measure(PARAMS, flight)))
    quiet = measure(replace(PARAMS, outages=()), flight)
    valid = fixes[:, 1] == 1.0
    np.testing.assert_array_equal(fixes[valid], numbers(quiet)[valid])


def test_gps_parameters_leave_the_imu_alone(flight):
    """The sensors draw from streams of their own, in whatever order and from whatever parameters."""
    params = imu_with(PERFECT, gyro_random_walk=1e-5, gyro_range=9.0, accel_range=1e3)
    alone = imu.measure(params, flight, noise.generator(1, "imu"))
    for gps_params in (PARAMS, replace(CALM, range_noise=10.0)):
        measure(gps_params, flight, seed=1)
        assert (
            imu.measure(params, flight, noise.generator(1, "imu")).dtheta_b.tobytes()
            == alone.dtheta_b.tobytes()
        )
