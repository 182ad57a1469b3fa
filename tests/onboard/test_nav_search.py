"""A mission whose azimuth on the pad nobody knows: what is told meanwhile, and that one filter goes on."""

import numpy as np
import pytest

from shefex_nav import Scenario, fly
from shefex_nav.geometry import rotation

UNKNOWN = {"pad_alignment.azimuth": "unknown"}
SEEDS = (11, 12, 13)  # of which the filters are 16 each until they agree


def flown(seed, tmp_path_factory):
    """A run cut ten seconds after lift-off."""
    log = tmp_path_factory.mktemp("search") / f"{seed}.mcap"
    return fly(Scenario.load("no_star_tracker", UNKNOWN), seed=seed, until_s=10.0, log=log)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return flown(SEEDS[0], tmp_path_factory)


@pytest.fixture(scope="module")
def flights(flight, tmp_path_factory):
    return [flight, *(flown(seed, tmp_path_factory) for seed in SEEDS[1:])]


def attitude_nees(run):
    """Times, squared normalised errors of the attitude and its largest sigma [deg], of every covariance."""
    data = run.data
    t_s, nees, sigma = [], [], []
    for k, at_s in enumerate(data.covariance.t_s):
        i, j = (int(np.argmin(np.abs(one.t_s - at_s))) for one in (data.truth, data.nav))
        q = rotation.quat_multiply(rotation.quat_conjugate(data.nav.q_ib[j]), data.truth.q_ib[i])
        e, P = rotation.rotvec_from_quat(q), data.covariance.P[k][6:, 6:]
        t_s.append(at_s)
        nees.append(e @ np.linalg.solve(P, e))
        sigma.append(np.degrees(np.sqrt(np.linalg.eigvalsh(P)[-1])))
    return np.array(t_s), np.array(nees), np.array(sigma)


@pytest.mark.slow
def test_the_azimuth_is_found_in_the_boost_and_honestly(flights):
    for run in flights:
        t_s, nees, sigma = attitude_nees(run)
        assert sigma[t_s < 0.0].min() > 75.0  # on the pad nothing shows it
        assert sigma[t_s > 8.0].max() < 5.0
        assert nees.max() < 25.0


@pytest.mark.compiled
def test_solutions_go_on_without_a_gap_and_warn(flight):
    nav = flight.data.nav
    np.testing.assert_allclose(np.diff(nav.t_s), 0.01, atol=1e-6)
    assert nav.do_not_use_attitude[nav.t_s < 0.0].all()
    speed = np.linalg.norm(np.diff(nav.v_e, axis=0), axis=1)
    assert speed.max() < 10.0  # m/s, also where one filter takes over


@pytest.mark.compiled
def test_its_filter_is_not_run_again_over_the_log(flight):
    from shefex_nav.log.topics import LogError
    from shefex_nav.replay import rerun

    with pytest.raises(LogError, match="begins with an angle of the attitude that was not known"):
        rerun.open_log(flight.log)
