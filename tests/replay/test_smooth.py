"""The smoothed flight: against RTS over the same steps, better than the filter, and honest."""

import numpy as np
import pytest
from flown_log import Options, write
from scipy.stats import chi2

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import ATT, layout
from shefex_nav.replay import compare, rerun, smooth, smoother
from shefex_nav.report import metrics

SEEDS = range(1, 9)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return rerun.open_log(write(tmp_path_factory.mktemp("smooth") / "run.mcap"))


@pytest.fixture(scope="module")
def result(recording):
    return smooth.run(recording)


def rts(recording):
    """Rauch-Tung-Striebel over the steps of the final pass. -> {t_s: (e, P_s, state)} at ticks

    e: smoothed error of the filter's estimate, closed loop: the filter's own mean is zero everywhere.
    """
    steps, recording = [], smooth.knowing_the_field(recording)
    nav = rerun.start(recording)._replace(recorder=steps.append)
    for k in range(len(recording.data.imu.t_valid_s)):
        rerun.tick(recording, nav, k)
    fusion.finish(nav)
    e, P_s, found = None, None, {}
    for step in steps[::-1]:
        if e is None:
            e, P_s = np.zeros(len(step.P)), step.P_after
        if type(step) is fusion.Interval:
            if step.t_end_s == step.imu.t_end_s:
                found[step.t_end_s] = e, P_s, step.state_after
            known = np.diag(step.P_after) == 0.0  # the field
            scale = np.sqrt(np.where(known, 1.0, np.diag(step.P_after)))
            C = step.P @ step.Phi.T
            within = step.P_after / np.outer(scale, scale) + np.diag(known.astype(float))
            C = np.linalg.solve(within, (C / scale).T).T / scale
            e, P_s = C @ e, step.P + C @ (P_s - step.P_after) @ C.T
        else:
            back = np.eye(len(e))
            back[ATT, ATT] = np.linalg.inv(step.G)
            e, P_s = step.dx + back @ e, back @ P_s @ back.T
    return found


def test_equals_rts_over_the_same_steps(recording, result):
    """Another recursion, with inverses, over what the filter did."""
    nav, covariance = result.smoothed.nav, result.smoothed.covariance
    assert len(nav.t_s) == 3000 and len(covariance.t_s) == 300
    expected = rts(recording)
    for k in range(0, 300, 7):
        t_s = covariance.t_s[k]
        e, P_s, state = expected[t_s]
        sigma = np.sqrt(np.diag(P_s))
        j = np.searchsorted(nav.t_s, t_s)
        assert nav.t_s[j] == t_s
        turn = rotation.rotvec_between(state.q_ib, nav.q_ib[j])
        apart = np.concatenate([nav.r_i[j] - state.r_i, nav.v_i[j] - state.v_i, turn]) - e[:9]
        assert np.abs(apart / sigma[:9]).max() < 1e-5
        if t_s > 20.0:  # before, vibration is added to what is reported
            assert np.abs((covariance.P[k] - P_s[:9, :9]) / np.outer(sigma[:9], sigma[:9])).max() < 1e-5


def test_segments_of_any_length_give_the_same(recording, result, monkeypatch):
    monkeypatch.setattr(smooth, "SEGMENT_TICKS", 137)
    again = smooth.run(recording)
    for one, two in ((result.smoothed.nav, again.smoothed.nav), (result.filtered.nav, again.filtered.nav)):
        assert np.array_equal(one.t_s, two.t_s)
        assert np.array_equal(one.r_i, two.r_i) and np.array_equal(one.q_ib, two.q_ib)
        assert np.array_equal(one.sigma_theta_b, two.sigma_theta_b)


def test_the_end_is_the_filters(result):
    """Nothing comes later; the filter has its last GPS fix 0.2 s late, at 29 s, and no other since."""
    filtered, smoothed = result.filtered.nav, result.smoothed.nav
    assert np.allclose(filtered.r_i[-1], smoothed.r_i[-1], rtol=0.0, atol=1e-6)
    assert np.allclose(filtered.sigma_r_e[-1], smoothed.sigma_r_e[-1], rtol=1e-9)


def test_never_less_certain_than_the_filter(result):
    filtered, smoothed = result.filtered.nav, result.smoothed.nav
    for name in ("sigma_r_e", "sigma_v_e", "sigma_theta_b"):
        assert np.all(getattr(smoothed, name) <= getattr(filtered, name) * (1.0 + 1e-6)), name


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Smoothed flights of several seeds: list of smooth.Smoothed."""
    folder = tmp_path_factory.mktemp("seeds")
    paths = [write(folder / f"{seed}.mcap", Options(seed=seed)) for seed in SEEDS]
    return [smooth.run(rerun.open_log(path)) for path in paths]


def test_errors_are_smaller_and_as_large_as_said(flights):
    """8 flights: RMS ratios (the covariances say 0.35, 0.84, 0.76), and NEES at four instants."""
    rows = [{row["part"]: row for row in compare.compare(*flight)} for flight in flights]
    for part, quantity, limit in (
        ("boost", "attitude_deg", 0.5),
        ("middle of the stars", "position_m", 0.9),
        ("stars", "velocity_m_s", 0.9),
    ):
        before, after = (
            np.mean([row[part][which][quantity] ** 2 for row in rows]) for which in ("filtered", "smoothed")
        )
        assert np.sqrt(after / before) < limit, (part, quantity)
    for t_s in (10.0, 20.5, 25.0, 29.0):
        nees = []
        for flight in flights:
            times, values, _ = metrics.normalised_errors(
                flight.smoothed, metrics.navigation_errors(flight.smoothed)
            )
            nees.append(values[np.argmin(np.abs(times - t_s))])
        low, high = chi2.ppf([5e-4, 0.9995], 9 * len(nees)) / len(nees)
        assert low < np.mean(nees) < high, (t_s, np.mean(nees))


def test_a_reset_does_not_leak_into_what_was_before(tmp_path):
    """A camera bent by 2 deg is believed in the end; the attitude of the boost stays that of the pad."""
    path = write(tmp_path / "bent.mcap", Options(stars_turned=np.radians(2.0)))
    flight = smooth.run(rerun.open_log(path))
    assert any("reset" in gate.note for gate in flight.filtered.gates if gate.sensor == "star_tracker")
    errors = metrics.navigation_errors(flight.smoothed)
    attitude_deg = np.degrees(np.linalg.norm(errors.attitude_b, axis=1))
    assert attitude_deg[errors.t_s < 21.0].max() < 0.6
    assert np.linalg.norm(errors.position_i, axis=1).max() < 10.0
    assert np.isfinite(flight.smoothed.nav.sigma_theta_b).all()


def test_what_is_only_doubted_is_noise():
    """P grows and nothing is measured: the past is what it was."""
    order = layout()
    rng = np.random.default_rng(1)
    step = fusion.Correction(*[None] * len(fusion.Correction._fields))._replace(fate=Fate.DOUBTED)
    root = rng.standard_normal((order.n, order.n))
    adjoint = smoother.Adjoint(rng.standard_normal(order.n), root @ root.T)
    assert smooth._before(step, adjoint, order) is adjoint


def test_parts_of_the_flight(result):
    rows = compare.compare(result.filtered, result.filtered)
    assert [row["part"] for row in rows] == [
        "boost",
        "before stars",
        "stars",
        "middle of the stars",
        "after stars",
    ]
    assert all(ratio == 1.0 for row in rows for ratio in row["ratio"].values())
    middle = rows[3]
    assert 23.5 < middle["from_s"] < middle["to_s"] < 26.5
    errors = metrics.navigation_errors(result.filtered)
    inside = (errors.t_s >= middle["from_s"]) & (errors.t_s <= middle["to_s"])
    by_hand = np.sqrt((errors.position_i[inside] ** 2).sum(axis=1).mean())
    assert np.isclose(middle["filtered"]["position_m"], by_hand, rtol=1e-12)
