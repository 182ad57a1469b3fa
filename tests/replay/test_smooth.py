"""The smoothed flight: against RTS over the same steps, better than the filter, and honest."""

import numpy as np
import pytest
from flown_log import Options, write
from scipy.stats import chi2

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import layout
from shefex_nav.records import Phase
from shefex_nav.replay import compare, relinear, rerun, smooth, smoother
from shefex_nav.report import metrics
from shefex_nav.scenario import load, params_onboard

SEEDS = range(1, 9)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return rerun.open_log(write(tmp_path_factory.mktemp("smooth") / "run.mcap"))


@pytest.fixture(scope="module")
def result(recording):
    return smooth.run(recording)


def rts(recording):
    """Rauch-Tung-Striebel over the steps, linear about what a first smoothing gave.

    -> {t_s: (packed nominal values, error of them, its covariance)} at ticks
    """
    copies, _ = smooth.forward(smooth.after_the_flight(recording))
    steps, e = smooth.backward(smooth.after_the_flight(recording), copies)
    nav = copies[0].nav
    x, filtered = relinear.origin(nav, nav.history[0], e)
    reached = [(x, filtered)]
    for step in steps:
        reached.append((step.x, relinear.follow(nav, reached[-1][1], reached[-1][0], step)))
    e, P_s = reached[-1][1].mean, reached[-1][1].P
    found = {}
    for step, (_, after), (x, before) in zip(steps[::-1], reached[:0:-1], reached[-2::-1], strict=True):
        if type(step) is relinear.Way:
            if step.t_end_s == step.imu.t_end_s:
                found[step.t_end_s] = step.x, e, P_s
            known = np.diag(after.P) == 0.0  # the field
            scale = np.sqrt(np.where(known, 1.0, np.diag(after.P)))
            C = before.P @ after.Phi.T
            within = after.P / np.outer(scale, scale) + np.diag(known.astype(float))
            C = np.linalg.solve(within, (C / scale).T).T / scale
            e, P_s = before.mean + C @ (e - after.mean), before.P + C @ (P_s - after.P) @ C.T
        else:  # what all data say is the same before and after; the trajectory is another one
            inverse = np.linalg.inv(after.Phi)
            e = inverse @ e + relinear.difference(nav.layout, x, step.x)
            P_s = inverse @ P_s @ inverse.T
    return found


def test_equals_rts_over_the_same_steps(recording, result):
    """Another recursion, with inverses, over what the filter did."""
    nav, covariance = result.smoothed.nav, result.smoothed.covariance
    assert len(nav.t_s) == 3000 and len(covariance.t_s) == 300
    expected = rts(recording)
    for k in range(0, 300, 7):
        t_s = covariance.t_s[k]
        x, e, P_s = expected[t_s]
        sigma = np.sqrt(np.diag(P_s))
        j = np.searchsorted(nav.t_s, t_s)
        assert nav.t_s[j] == t_s
        turn = rotation.rotvec_between(x[6:10], nav.q_ib[j])
        apart = np.concatenate([nav.r_i[j] - x[:3], nav.v_i[j] - x[3:6], turn]) - e[:9]
        assert np.abs(apart / sigma[:9]).max() < 1e-5
        if t_s > 20.0:  # before, vibration is added to what is reported
            assert np.abs((covariance.P[k] - P_s[:9, :9]) / np.outer(sigma[:9], sigma[:9])).max() < 1e-5


def misaligned(recording, error_deg):
    """The same flight, started with an attitude off by so much about the roll axis, and a prior to match."""
    start = recording.data.alignment
    q_ib = rotation.quat_multiply(start.q_ib, rotation.quat_from_rotvec(np.radians([error_deg, 0.0, 0.0])))
    start = start._replace(q_ib=q_ib, P_theta_b=np.radians(4.0) ** 2 * np.eye(3))
    return recording._replace(data=recording.data._replace(alignment=start))


def test_it_is_linear_about_the_flight_not_about_the_filter(recording):
    """Stars at T+22 s tell an attitude off by 4 deg from one that is right, and GPS told neither before.

    So what is smoothed must be the same, all the way back: the prior weighs (0.02/4)^2. Smoothed once, it is
    not.
    """
    once, twice = [], []
    for error_deg in (4.0, 0.0):
        flown = smooth.after_the_flight(misaligned(recording, error_deg))
        copies, _ = smooth.forward(flown)
        steps, e = smooth.backward(flown, copies)
        once.append(np.array([step.x[:10] for step in steps if smooth._at_a_tick(step)]))
        twice.append(smooth.again(copies[0].nav, steps, e, True)[0])
    boost = slice(100, 1900)
    sigma_v, sigma_theta = twice[1].sigma_v_e[boost], twice[1].sigma_theta_b[boost]
    v_i, across = (once[0] - once[1])[boost, 3:6], slice(1, 3)
    turn = rotation.rotvec_between(once[0][boost, 6:], once[1][boost, 6:])
    assert np.abs(v_i / sigma_v).max() > 0.3 and np.abs(turn / sigma_theta)[:, across].max() > 0.1
    v_i = (twice[0].v_i - twice[1].v_i)[boost]
    turn = rotation.rotvec_between(twice[0].q_ib[boost], twice[1].q_ib[boost])
    assert np.abs(v_i / sigma_v).max() < 0.01 and np.abs(turn / sigma_theta)[:, across].max() < 0.01
    assert np.abs(turn / sigma_theta).max() < 0.05


def test_errors_that_last_are_states_of_what_is_smoothed(recording):
    """Those that there are, and not noise as well; external data keep their filter."""
    given = set(recording.params.states)
    own = smooth.with_lasting_errors(recording).params
    assert set(own.states) == (given - {"gyro_roll_column"}) | {"gyro_scale", "gyro_misalignment"}
    scenario = load.load_text(
        recording.scenario_text,
        "log",
        ["imu.accelerometer.misalignment=0.2 mrad", "imu.gyro.g_sensitivity=3 deg/h/gee"],
    )
    onboard = params_onboard.nav_params(scenario)
    flown = recording._replace(params=onboard, scenario_text=scenario.source)
    more = smooth.after_the_flight(flown).params
    assert {"accel_misalignment", "gyro_g_sensitivity"} <= set(more.states)
    assert np.all(more.sigma_blocks["accel_misalignment"] == scenario.imu.accelerometer.misalignment)
    assert np.all(more.sigma_blocks["gyro_g_sensitivity"] == scenario.imu.gyro.g_sensitivity)
    assert min(onboard.imu.accel_misalignment, onboard.imu.gyro_g_sensitivity, onboard.imu.gyro_cross) > 0.0
    assert more.imu.accel_misalignment == more.imu.gyro_g_sensitivity == more.imu.gyro_cross == 0.0
    assert np.all(more.sigma_blocks["gravity"] == smooth.FIELD_ERROR)
    again = smooth.with_lasting_errors(flown._replace(params=more)).params
    assert set(again.states) == set(more.states)
    assert smooth.after_the_flight(flown._replace(gravity=None)).params == onboard


def test_segments_of_any_length_give_the_same(recording, result, monkeypatch):
    monkeypatch.setattr(smooth, "SEGMENT_TICKS", 137)
    again = smooth.run(recording)
    for one, two in ((result.smoothed.nav, again.smoothed.nav), (result.filtered.nav, again.filtered.nav)):
        assert np.array_equal(one.t_s, two.t_s)
        assert np.array_equal(one.r_i, two.r_i) and np.array_equal(one.q_ib, two.q_ib)
        assert np.array_equal(one.sigma_theta_b, two.sigma_theta_b)


def test_the_end_is_the_filters(result):
    """Nothing comes later; the filter has its last GPS fix 0.2 s late, at 29 s, and no other since.

    What is different is only about what both are linear.
    """
    filtered, smoothed = result.filtered.nav, result.smoothed.nav
    sigma = filtered.sigma_r_e[-1].min()
    assert np.allclose(filtered.r_i[-1], smoothed.r_i[-1], rtol=0.0, atol=1e-3 * sigma)
    assert np.allclose(filtered.sigma_r_e[-1], smoothed.sigma_r_e[-1], rtol=1e-3)


def test_never_less_certain_than_the_filter(result):
    filtered, smoothed = result.filtered.nav, result.smoothed.nav
    for name in ("sigma_r_e", "sigma_v_e", "sigma_theta_b"):
        assert np.all(getattr(smoothed, name) <= getattr(filtered, name) * (1.0 + 1e-6)), name


@pytest.fixture(scope="module")
def flights(result, tmp_path_factory):
    """Smoothed flights of several seeds, the first being `result`: list of smooth.Smoothed."""
    folder = tmp_path_factory.mktemp("seeds")
    paths = [write(folder / f"{seed}.mcap", Options(seed=seed)) for seed in SEEDS if seed != Options().seed]
    return [result, *(smooth.run(rerun.open_log(path)) for path in paths)]


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


def test_a_log_that_ends_before_the_motor_does_is_of_the_boost(result):
    data = result.filtered
    early = [event for event in data.events if not event.name.startswith("burn_out")]
    phase = np.where(data.truth.t_s >= 0.0, Phase.BOOST, Phase.PAD)
    cut = data._replace(events=early, gates=[], truth=data.truth._replace(phase=phase))
    assert [part.name for part in compare.parts(cut) if part.from_s < part.to_s] == ["boost"]
