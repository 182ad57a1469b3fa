"""A star tracker by statistics beside one that searches pictures: the same sensors, as good a navigation."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav import prepare, simulate, statistical
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, rotvec_between
from shefex_nav.records import NO_STARS, ComputeTime, Frame, FrameTruth, GateResult, Reason, StarFix
from shefex_nav.scenario.load import load
from shefex_nav.world.camera.sightings import Sighting

DEFAULT = Path(__file__).parent.parent / "scenarios" / "shefex2_andoya.yaml"
SEED, UNTIL_S = 5, 252.0
OVERRIDE = "star_tracker.frames=statistical"


@pytest.fixture(scope="module")
def scenarios():
    return load(DEFAULT), load(DEFAULT, [OVERRIDE])


@pytest.fixture(scope="module")
def worlds(scenarios):
    return tuple(prepare.build_world(scenario, SEED) for scenario in scenarios)


@pytest.fixture(scope="module")
def runs(scenarios, worlds):
    """Records of both, from the pad until some seconds after the first fixes."""
    return tuple(
        list(simulate.route(world, scenario, SEED, until_s=UNTIL_S))
        for world, scenario in zip(worlds, scenarios, strict=True)
    )


def of(records, kind):
    return [record for record in records if type(record) is kind]


def test_other_sensors_are_the_same_to_the_bit(worlds, runs):
    rendered, drawn = worlds
    for name in ("dtheta_b", "dv_b", "t_s"):
        np.testing.assert_array_equal(getattr(rendered.imu, name), getattr(drawn.imu, name))
    for one, other in zip(rendered.gps_fixes, drawn.gps_fixes, strict=True):
        np.testing.assert_array_equal(one.r_ea_e, other.r_ea_e)
    np.testing.assert_array_equal(rendered.alignment.q_ib, drawn.alignment.q_ib)
    np.testing.assert_array_equal(rendered.flight.trajectory.q_ib, drawn.flight.trajectory.q_ib)
    np.testing.assert_array_equal(rendered.camera.q_bc, drawn.camera.q_bc)
    assert rendered.camera.pinhole == drawn.camera.pinhole
    first = [of(records, StarFix)[0].t_valid_s for records in runs]
    for kind in ("NavSolution", "GateResult"):  # so all is the same until the first fix
        before = [[r for r in records if type(r).__name__ == kind and r.t_s < min(first)] for records in runs]
        assert len(before[0]) == len(before[1]) > 100
        assert all(np.array_equal(a[1], b[1]) for a, b in zip(*before, strict=True))


def test_frames_and_fixes_come_at_the_same_times_with_the_same_outcome(runs):
    rendered, drawn = runs
    assert of(rendered, Frame) and not of(drawn, Frame) and not of(drawn, ComputeTime)
    one, other = of(rendered, FrameTruth), of(drawn, FrameTruth)
    assert [truth.number for truth in one] == [truth.number for truth in other]
    a, b = of(rendered, StarFix), of(drawn, StarFix)
    assert len(a) == len(b) > 150
    reasons = np.array([[fix.reason for fix in fixes] for fixes in (a, b)])
    assert (reasons[0] == reasons[1]).mean() > 0.97
    good = (reasons == Reason.NONE).all(axis=0)
    assert good.sum() > 25
    same = [(x, y) for x, y in zip(a, b, strict=True) if x.exposure_s == y.exposure_s]
    assert len(same) > 25
    for x, y in same:
        assert (x.t_valid_s, x.t_available_s) == (y.t_valid_s, y.t_available_s)
    for fix in b:
        late_s = fix.t_available_s - fix.t_valid_s
        assert late_s == pytest.approx(0.5 * fix.exposure_s + 0.015 + 0.020, abs=1e-9)


def test_fixes_scatter_as_they_say(runs):
    """Whole frames: errors about the constant of the run, normalised with the covariance of each fix."""
    drawn = runs[1]
    truths = {truth.number: truth.q_ic for truth in of(drawn, FrameTruth)}
    good = [fix for fix in of(drawn, StarFix) if fix.reason == Reason.NONE]
    error = rotvec_between(
        np.array([fix.q_ic for fix in good]), np.array([truths[fix.number] for fix in good])
    )
    error -= error.mean(axis=0)
    sigma = np.sqrt(np.array([np.diag(fix.P_c) for fix in good]))
    assert 0.6 < (error / sigma).std() < 1.3
    assert np.abs(error[:, :2]).max() < np.radians(10.0 / 3600.0)


def test_the_navigation_is_as_good_as_with_pictures(runs):
    ends = []
    for records in runs:
        solution = [r for r in records if type(r).__name__ == "NavSolution"][-1]
        truth = [r for r in records if type(r).__name__ == "TruthSample"][-1]
        assert solution.t_s == pytest.approx(truth.t_s) and solution.star_aided
        error = rotvec_between(solution.q_ib[None], truth.q_ib[None])[0]
        ends.append((error, solution.sigma_theta_b))
    (one, sigma), (other, sigma_other) = ends
    np.testing.assert_allclose(sigma_other, sigma, rtol=0.1)
    assert np.all(np.abs(one - other) < 4.0 * sigma)
    assert np.all(np.abs(other) < 4.5 * sigma_other)


def test_the_same_seed_gives_the_same_fixes(scenarios, worlds, runs):
    again = simulate.route(worlds[1], scenarios[1], SEED, until_s=249.0)
    fixes = of(again, StarFix)
    for one, other in zip(fixes, of(runs[1], StarFix), strict=False):
        np.testing.assert_array_equal(one.q_ic, other.q_ic)
        np.testing.assert_array_equal(one.P_c, other.P_c)


@pytest.mark.slow
def test_ticks_one_by_one_give_the_same_fixes(scenarios, worlds, runs, monkeypatch):
    """What is seen is drawn at the exposure, what is found at the arrival: from one generator, in turn."""
    monkeypatch.setattr(simulate.Shutter, "ahead", lambda self, n, tick, ends_s: n + 1)
    again = list(simulate.route(worlds[1], scenarios[1], SEED, until_s=249.0))
    for kind, names in (
        (StarFix, ("t_available_s", "reason", "q_ic", "P_c")),
        (GateResult, ("sensor", "nis")),
    ):
        few = of(again, kind)
        assert len(few) > 100
        for one, other in zip(few, of(runs[1], kind), strict=False):
            for name in names:
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


# ---- what lies outside ---------------------------------------------------------------------------------


def tracker(track=True):
    stars = SimpleNamespace(hip=np.array([30, 10, 20, 40]))
    identification = SimpleNamespace(tracking=track, fewest_stars=4)
    params = SimpleNamespace(settings=SimpleNamespace(identification=identification))
    return SimpleNamespace(params=params, pairs=SimpleNamespace(stars=stars))


def chain(**search):
    """Statistical with a table of shares alone."""
    model = statistical.IdentificationModel(
        stars=np.array([3, 5]),
        first=np.array([0.0, 0.6]),
        later=np.array([0.5, 1.0]),
        wrong=np.array([0.2, 0.0]),
        named=1.0,
        wrong_turns=np.array([[0.1, 0.0, 0.0]]),
        fastest=0.03,
    )._replace(**search)
    one = statistical.Statistical.__new__(statistical.Statistical)
    one.search, one.rng, one.highest_rate, one.fixed_s = model, np.random.default_rng(1), 0.04, -np.inf
    hip = tracker().pairs.stars.hip
    one.by_hip = np.argsort(hip)
    one.sorted_hip, one.known = hip[one.by_hip], model.stars.tolist()
    return one


def identified(one, n, times, t_s=100.0, rate=0.01):
    frame, context = SimpleNamespace(t_valid_s=t_s), SimpleNamespace(rate=rate)
    sighting = Sighting(None, np.array([10, 20, 30, 40, 10, 20])[:n], 20.0)
    return [one._identification(tracker(), sighting, frame, context) for _ in range(times)]


def test_shares_of_identified_frames_are_those_of_the_table():
    one, n = chain(), 4000
    for stars, share, wrong in ((3, 0.0, 0.2), (4, 0.0, 0.2), (5, 0.6, 0.0), (6, 0.6, 0.0)):
        found = identified(one, stars, n)
        good = np.mean([result[0].reason == Reason.NONE for result in found])
        assert abs(good - share) < 4.5 * np.sqrt(share * (1 - share) / n) + 1e-12
        assert all(result[2] == wrong for result in found if result[0].reason == Reason.NONE)
    one.fixed_s = 99.5
    good = np.mean([result[0].reason == Reason.NONE for result in identified(one, 3, n)])
    assert abs(good - 0.5) < 4.5 * np.sqrt(0.25 / n)
    result = identified(one, 5, 1)[0][0]
    assert tracker().pairs.stars.hip[result.star].tolist() == [10, 20, 30, 40, 10]


def test_a_wrong_fix_is_wrong_for_single_stars_as_well():
    """Attitude and directions are turned together: each star still lies where the attitude says."""
    one, rng = chain(wrong_turns=np.array([[0.1, -0.2, 0.3]])), np.random.default_rng(2)
    q_ic = quat_from_rotvec(np.array([0.4, 1.1, -0.7]))
    u_c = rng.standard_normal((5, 3))
    u_c /= np.linalg.norm(u_c, axis=1, keepdims=True)
    stars = NO_STARS._replace(u_c=u_c, u_i=u_c @ dcm_from_quat(q_ic).T)
    _, reason, (wrong_ic, P_c, residual), turned = one._misled(None, 0, (q_ic, np.eye(3), 0.1), stars)
    np.testing.assert_allclose(rotvec_between(wrong_ic[None], q_ic[None])[0], [0.1, -0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(turned.u_i, u_c @ dcm_from_quat(wrong_ic).T, atol=1e-12)
    np.testing.assert_array_equal(turned.u_c, u_c)
    assert np.linalg.norm(turned.u_i - stars.u_i, axis=1).min() > 1e-3
    assert (reason, residual) == (0, 0.1) and np.array_equal(P_c, np.eye(3))


def test_fewer_stars_than_a_fix_needs_give_none():
    one = chain(stars=np.array([1, 5]))
    assert {result[0].reason for result in identified(one, 2, 50)} == {Reason.TOO_FEW_STARS}


def test_fewer_stars_than_were_characterised_and_faster_rates_are_refused():
    one = chain(stars=np.array([4, 5]))
    with pytest.raises(statistical.OutsideModelError, match=r"shows 3 stars .* begin at 4"):
        identified(one, 3, 1)
    assert identified(one, 3, 1, rate=0.05)[0][0].reason == Reason.NO_MATCH  # too fast for a fix in any case
    truth = SimpleNamespace(rate=0.035, t_valid_s=250.0)
    with pytest.raises(statistical.OutsideModelError, match=r"turns at 2.01 deg/s .* reach to 1.72 deg/s"):
        one._check_rate(truth)
    for rate in (0.02, 0.03, 0.041):
        one._check_rate(SimpleNamespace(rate=rate, t_valid_s=250.0))
