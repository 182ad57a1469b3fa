"""What the filter begins with: errors of position and velocity that an alignment on the ground ties."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS

from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.state import POS, VEL
from shefex_nav.records import Alignment, GpsFix, ImuBlock

SIGMA_R, SIGMA_V = 1000.0, 0.01
PLACES = pytest.mark.parametrize(("latitude", "longitude"), [(69.3, 16.0), (0.0, 180.0), (-90.0, 0.0)])
UNKNOWN = np.full(3, np.nan)


def surveyed(r_e, error_r, error_v):
    """Alignment of a vehicle that stands at r_e, as a survey with errors in Earth-fixed axes says it."""
    r_i, v_i = frames.inertial_from_ecef(EARTH, 0.0, r_e - error_r, -error_v)
    q_ib = rotation.quat_from_dcm(frames.dcm_ie(EARTH, 0.0))
    omega_i = frames.omega_ie_i(EARTH)
    return Alignment(0.0, r_i, v_i, q_ib, SIGMA_R, SIGMA_V, 1e-6 * np.eye(3), omega_i=omega_i)


@PLACES
def test_errors_at_the_start_are_those_of_a_survey_on_a_turning_earth(latitude, longitude):
    """Covariance of 20 000 surveys, within five sigma of its estimate."""
    rng, r_e = np.random.default_rng(3), wgs84.ecef_from_geodetic(*np.radians([latitude, longitude]), 300.0)
    found = np.empty((20_000, 6))
    truth = np.concatenate(frames.inertial_from_ecef(EARTH, 0.0, r_e, np.zeros(3)))
    for error in found:
        drawn = rng.standard_normal((2, 3))
        said = surveyed(r_e, SIGMA_R * drawn[0], SIGMA_V * drawn[1])
        error[:] = truth - np.concatenate([said.r_i, said.v_i])
    nav = fusion.start(PARAMS, surveyed(r_e, np.zeros(3), np.zeros(3)), EARTH)
    P = nav.history.P[:6, :6]
    root = np.linalg.cholesky(P)
    whitened = np.linalg.solve(root, found.T)
    within = 5.0 * np.sqrt(2.0 / len(found))
    np.testing.assert_allclose(whitened @ whitened.T / len(found), np.eye(6), atol=within)


@PLACES
def test_a_place_that_is_found_again_brings_the_velocity_along(latitude, longitude):
    """A pad that is 1 km off in each axis: a position without velocity corrects both."""
    r_e = wgs84.ecef_from_geodetic(*np.radians([latitude, longitude]), 300.0)
    said = surveyed(r_e, np.array([1000.0, -1200.0, 800.0]), np.zeros(3))
    nav = fusion.start(PARAMS._replace(l_ba_b=np.zeros(3), gate_probability=1e-12), said, EARTH)
    standing(nav, r_e)
    R = np.full((3, 3), np.nan)
    fix = GpsFix(0.01, 0.01, True, r_e, UNKNOWN, 0.01 * np.eye(3), R, 8, 2.0, "")
    assert all(result.accepted for result in fusion.fuse(nav, [("gps", fix)]))
    state, P = nav.history[-1].state, nav.history[-1].P
    _, v_e = frames.ecef_from_inertial(EARTH, 0.01, state.r_i, state.v_i)
    assert np.linalg.norm(v_e) < 2e-4  # was 0.1
    assert np.sqrt(np.diag(P)[VEL]).max() < 1.05 * SIGMA_V


def standing(nav, r_e):
    """A tick in which the vehicle stands, without errors."""
    omega_e, h = np.array([0.0, 0.0, EARTH.rate]), 0.0025
    f_e = np.cross(omega_e, np.cross(omega_e, r_e)) - gravity_j2_e(r_e)
    increments = np.tile(omega_e * h, (4, 1)), np.tile(f_e * h, (4, 1))
    fusion.advance(nav, ImuBlock(0.01, 0.01, h, *increments, False))


def test_in_orbit_the_errors_have_nothing_to_do_with_each_other():
    high = surveyed(np.array([wgs84.A + 4e5, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    high = high._replace(omega_i=np.zeros(3))
    P = fusion.start(PARAMS, high, EARTH).history.P
    assert not P[POS, VEL].any()
    np.testing.assert_allclose(P[VEL, VEL], SIGMA_V**2 * np.eye(3))
