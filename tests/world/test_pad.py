"""The alignment before lift-off: error statistics, sign of the error, and a vehicle at rest on the Earth."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_trajectory as synthetic
from scipy import stats

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import state
from shefex_nav.scenario import load, params_onboard
from shefex_nav.world import noise, pad
from shefex_nav.world.settings import PadAlignment

PARAMS = PadAlignment(level=np.deg2rad(0.05), azimuth=np.deg2rad(0.3), position=3.0, velocity=0.01)


@pytest.fixture(scope="module")
def flight():
    return synthetic.fly(end_s=-9.9)


def align(flight, seed, params=PARAMS):
    return pad.align(params, flight, synthetic.EARTH, noise.generator(seed, "pad"))


def test_without_errors_it_is_the_truth(flight):
    alignment = align(flight, 1, PadAlignment(level=0.0, azimuth=0.0, position=0.0, velocity=0.0))
    assert alignment.t_valid_s == -10.0
    np.testing.assert_allclose(alignment.r_i, flight.r_i[0], atol=1e-8)
    np.testing.assert_allclose(alignment.v_i, flight.v_i[0], atol=1e-11)
    np.testing.assert_allclose(alignment.q_ib, flight.q_ib[0], atol=1e-15)


def test_errors_are_as_large_as_reported(flight):
    """600 draws: chi-square of attitude against P_theta_b, of position and velocity, each at 99.9 %."""
    n = 600
    attitude = position = velocity = 0.0
    for seed in range(n):
        alignment = align(flight, seed)
        error_b = rotation.rotvec_between(alignment.q_ib, flight.q_ib[0])
        attitude += error_b @ np.linalg.solve(alignment.P_theta_b, error_b)
        _, v_e = frames.ecef_from_inertial(synthetic.EARTH, -10.0, alignment.r_i, alignment.v_i)
        position += np.sum((alignment.r_i - flight.r_i[0]) ** 2) / alignment.sigma_r**2
        velocity += np.sum(v_e**2) / alignment.sigma_v**2  # the true one is zero
    low, high = stats.chi2.interval(0.999, 3 * n)
    for total in (attitude, position, velocity):
        assert low < total < high


def test_azimuth_and_level_errors_are_about_the_vertical_and_across_it(flight):
    """An azimuth error alone turns the vehicle about the local vertical, a level error alone tilts it."""
    C_in = frames.dcm_ie(synthetic.EARTH, -10.0) @ wgs84.dcm_en(*synthetic.SITE)
    vertical_b = rotation.dcm_from_quat(flight.q_ib[0]).T @ C_in[:, 2]
    for seed in range(5):
        turned = align(flight, seed, replace(PARAMS, level=0.0))
        error_b = rotation.rotvec_between(turned.q_ib, flight.q_ib[0])
        np.testing.assert_allclose(
            np.cross(error_b, vertical_b), 0.0, atol=1e-7 * np.linalg.norm(error_b) + 1e-12
        )
        tilted = align(flight, seed, replace(PARAMS, azimuth=0.0))
        error_b = rotation.rotvec_between(tilted.q_ib, flight.q_ib[0])
        assert abs(error_b @ vertical_b) < 1e-7 * np.linalg.norm(error_b) + 1e-12


def test_reported_covariance_has_the_axes_of_the_site(flight):
    alignment = align(flight, 3)
    variances, axes = np.linalg.eigh(alignment.P_theta_b)
    np.testing.assert_allclose(np.sqrt(variances), np.deg2rad([0.05, 0.05, 0.3]), rtol=1e-9)
    vertical_i = frames.dcm_ie(synthetic.EARTH, -10.0) @ wgs84.dcm_en(*synthetic.SITE)[:, 2]
    most_uncertain_i = rotation.dcm_from_quat(alignment.q_ib) @ axes[:, 2]
    assert abs(most_uncertain_i @ vertical_i) == pytest.approx(1.0, abs=1e-9)


def test_velocity_is_that_of_the_ground(flight):
    """Inertial velocity is the Earth's rotation, 166 m/s at the launch site at 69 degrees north."""
    alignment = align(flight, 2, replace(PARAMS, velocity=0.0))
    expected = np.cross(frames.omega_ie_i(synthetic.EARTH), alignment.r_i)
    np.testing.assert_allclose(alignment.v_i, expected, atol=1e-9)
    assert np.linalg.norm(alignment.v_i) == pytest.approx(165.0, abs=1.5)


def test_alignment_in_orbit():
    """Errors of position and velocity are independent, those of attitude are about local level."""
    flight = synthetic.orbit(end_s=0.1)
    far = replace(PARAMS, position=1e5)
    alignments = [align(flight, seed, far) for seed in range(300)]
    error_v = np.array([alignment.v_i - flight.v_i[0] for alignment in alignments])
    low, high = stats.chi2.interval(0.999, error_v.size)  # 1e5 m turning with the Earth would add 7 m/s
    assert low < np.sum(error_v**2) / PARAMS.velocity**2 < high
    error_r = np.array([alignment.r_i - flight.r_i[0] for alignment in alignments])
    assert low < np.sum(error_r**2) / far.position**2 < high
    q_true = flight.q_ib[0]  # body x ahead, y to the right, z down: level but for the ellipsoid's normal
    error_b = np.array([rotation.rotvec_between(alignment.q_ib, q_true) for alignment in alignments])
    np.testing.assert_allclose(np.rad2deg(error_b.std(axis=0)), [0.05, 0.05, 0.3], rtol=0.2)
    same = align(flight, 1, PadAlignment(level=0.0, azimuth=0.0, position=0.0, velocity=0.0))
    np.testing.assert_allclose(same.v_i, flight.v_i[0], atol=1e-12)


@pytest.mark.parametrize("where", ["ground", "orbit"])
@pytest.mark.parametrize("position", [3.0, 1e3, 1e6])
def test_the_filter_starts_with_the_covariance_of_what_is_wrong(flight, where, position):
    """300 draws against that of position and velocity at 99.9 %: at rest the velocity errs with the place.

    1 km of the Earth turns by 7 cm/s, seven times the velocity that the crew leaves open.
    """
    flown = flight if where == "ground" else synthetic.orbit(end_s=0.1)
    nav = params_onboard.nav_params(load.load("shefex2_andoya", ["navigation.states=[]"]))
    order, both, total = state.layout(nav.states), slice(state.POS.start, state.VEL.stop), 0.0
    for seed in range(300):
        alignment = align(flown, seed, replace(PARAMS, position=position))
        _, P = state.initial(nav, order, alignment)
        error = np.concatenate([flown.r_i[0] - alignment.r_i, flown.v_i[0] - alignment.v_i])
        total += error @ np.linalg.solve(P[both, both], error)
    low, high = stats.chi2.interval(0.999, 6 * 300)
    assert low < total < high


def test_same_seed_same_alignment(flight):
    first, again, other = align(flight, 5), align(flight, 5), align(flight, 6)
    assert first.q_ib.tobytes() == again.q_ib.tobytes() and first.r_i.tobytes() == again.r_i.tobytes()
    assert not np.array_equal(first.q_ib, other.q_ib)


def test_an_unknown_azimuth_is_anything_within_half_a_turn(flight):
    """400 draws: even (Kolmogorov-Smirnov), about the vertical, reported as such; level is what it was."""
    unknown = replace(PARAMS, azimuth=np.inf)
    C_in = frames.dcm_ie(synthetic.EARTH, -10.0) @ wgs84.dcm_en(*synthetic.SITE)
    down_b = rotation.dcm_from_quat(flight.q_ib[0]).T @ C_in[:, 2]
    turned = []
    for seed in range(400):
        alignment = align(flight, seed, unknown)
        turned.append(rotation.rotvec_between(alignment.q_ib, flight.q_ib[0]) @ down_b)
    assert stats.kstest(turned, stats.uniform(-np.pi, 2.0 * np.pi).cdf).pvalue > 1e-3
    sigma = np.sqrt(np.linalg.eigvalsh(alignment.P_theta_b))
    np.testing.assert_allclose(np.degrees(sigma), [0.05, 0.05, 180.0 / np.sqrt(3.0)], rtol=1e-9)
