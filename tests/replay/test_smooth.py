"""The smoothed flight: against RTS over the same steps, better than the filter, and honest."""

import numpy as np
import pytest
import slow_relinear
import slow_smoother
from better_field import more_in_field
from flown_log import Options, write
from scipy.stats import chi2

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import adaptation, integrity_readings
from shefex_nav.onboard.navigation.blocks import Block
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.history import Moment
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.integrity_drift import Followed
from shefex_nav.onboard.navigation.state import N_NOMINAL, unpack
from shefex_nav.records import Phase
from shefex_nav.replay import final_pass, relinear, rerun, smooth, smoothed, smoother
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors
from shefex_nav.scenario import load, params_onboard

SEEDS = range(1, 9)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return rerun.open_log(write(tmp_path_factory.mktemp("smooth") / "run.mcap"))


@pytest.fixture(scope="module")
def result(recording):
    return smooth.run(recording)


def prepared(recording):
    """What `smooth.backward` works on: Recording, fusion.Filter, Final, Nodes, Whole."""
    _, flown, final = smooth.forward(recording)
    after = smooth.after_the_flight(recording)
    nav = rerun.start(after)
    whole = final_pass.Whole(final, nav.history.P)
    return after, nav, final, final_pass.nodes(flown, final, nav.layout), whole


@pytest.mark.parametrize("kind", [Grown, Followed])
def test_what_has_grown_on_board_grows_in_the_order_of_the_smoother(recording, kind):
    """A fix before which the covariance grew, where the smoother has states that the filter had not."""
    _, flown, final = smooth.forward(recording)
    after = smooth.after_the_flight(recording)
    assert rerun.start(after).layout.n > flown.layout.n
    grows = kind(np.linspace(1.0, 4.0, flown.layout.n))
    k = next(k for k in range(100, len(final.measurements)) if final.measurements[k])
    first, *others = final.measurements[k]
    final.measurements[k] = (first._replace(fate=Fate.RESET, admitted=grows), *others)
    solution, covariance = smooth.backward(after, flown, final, True)
    assert np.isfinite(solution.r_i).all() and np.isfinite(covariance.P).all()
    given = grows.into(flown.layout, rerun.start(after).layout)[0]
    for name, place in rerun.start(after).layout.places.items():
        if place is not None:
            own = flown.layout.places[name]
            wanted = (1.0 if kind is Grown else 0.0) if own is None else grows[0][own]
            np.testing.assert_array_equal(given[place], wanted)


def slow_steps(recording, nav, final, nodes, xs):
    """Way and Seen of the reference over the nodes, field and measurements about xs: list of (node, step)."""
    whole, steps = final_pass.Whole(final, nav.history.P), []
    running = nav._replace(history=whole)
    for j, (k, part) in enumerate(zip(nodes.ticks.tolist(), nodes.parts_s.tolist(), strict=True)):
        imu = whole.imu(k)
        begin_s, end_s = (imu.t_end_s - imu.length_s + at_s for at_s in part)
        if recording.field is not None:  # as increments of velocity, not as gravity
            at_tick = nodes.ends[k - 1]
            state = unpack(imu.t_end_s - imu.length_s, xs[at_tick])
            imu.increments[2:, 3:] += more_in_field(
                recording.field, running.earth, state, imu.dt_s, imu.dtheta_b
            )
        steps.append((j + 1, slow_relinear.Way(begin_s, end_s, imu, xs[j + 1])))
        for seen in nodes.seen.get(j + 1, ()):
            whole.x[:] = xs[j + 1]
            one, now = seen.measurement, Moment(whole, seen.tick, seen.at_s)
            assert one.fate == Fate.USED  # so nothing is forgotten in this flight
            z, H, R = running.sensors[one.sensor].linearise(running, now, one.fix)
            steps.append((j + 1, slow_relinear.Seen(xs[j + 1], z, H, R, None, (), None, xs[j + 1])))
    return steps


def with_a_block_from_outside(recording):
    """The Recording with one that drives increments and has a law of its own; smoothed with these states."""

    def drives(felt):
        return np.vstack([np.outer(felt.omega_b, [1.0, 0.0]), np.outer(felt.f_b, [0.3, 1.0])])

    F = np.array([[-0.1, 0.05], [0.0, -0.02]])
    outer = Block("outer", 1e-8 * np.eye(2), np.array([1e-5, 2e-5]), F, drives)
    params = recording.params
    params = params._replace(states=(*params.states, "outer"), own_blocks=(outer,))
    return recording._replace(params=params, gravity=None)


@pytest.mark.parametrize("outside", [False, True], ids=["of the program", "from outside"])
def test_equals_the_slow_reference_and_rts(recording, outside):
    """Dense matrices, step by step, over the same nodes: the adjoint, and RTS with inverses."""
    recording = with_a_block_from_outside(recording) if outside else recording
    after, nav, final, nodes, whole = prepared(recording)
    xs, n = nodes.xs, nav.layout.n
    trajectory = relinear.Trajectory(xs, smooth.known_field(after, nodes, final, xs))
    room = relinear.room(len(nodes.ticks), n)
    e, found = smooth.smoothed_about(nav, whole, nodes, nav.history[0], room, trajectory, second=True)
    steps = slow_steps(after, nav, final, nodes, xs)
    start = nav.history[0]
    x, filtered = slow_relinear.origin(nav, start, slow_relinear.difference(nav.layout, start.x, xs[0]))
    reached = [filtered]
    for _, step in steps:
        filtered, x = slow_relinear.follow(nav, filtered, x, step), step.x
        reached.append(filtered)
    adjoint, mean, P_rts = slow_smoother.at_the_end(n), reached[-1].mean, reached[-1].P
    rows = set(nodes.ends[10::70].tolist())
    for (node, step), before, now in zip(steps[::-1], reached[-2::-1], reached[:0:-1], strict=True):
        last = nodes.seen.get(node) is None or type(step) is slow_relinear.Seen
        if node in rows and last:
            rows.discard(node)
            e_slow, P_slow = slow_smoother.smoothed(adjoint, now.P, now.mean)
            sigma = np.sqrt(np.diag(P_slow))
            sigma[sigma == 0.0] = 1.0
            assert np.abs((e[node] - e_slow) / sigma).max() < 1e-4
            assert np.abs((mean - e_slow) / sigma).max() < 1e-4
            nine = np.outer(sigma, sigma)[:9, :9]
            assert np.abs((found.nine[node] - P_slow[:9, :9]) / nine).max() < 1e-5
            assert np.abs((P_rts - P_slow) / np.outer(sigma, sigma)).max() < 1e-4
            if found.rows[node] >= 0:
                both = found.whole[found.rows[node]] - P_slow
                assert np.abs(both / np.outer(sigma, sigma)).max() < 1e-5
        adjoint = slow_relinear.back(adjoint, now)
        if type(step) is slow_relinear.Way:
            known = np.diag(now.P) == 0.0
            scale = np.sqrt(np.where(known, 1.0, np.diag(now.P)))
            within = now.P / np.outer(scale, scale) + np.diag(known.astype(float))
            C = before.P @ now.Phi.T
            C = np.linalg.solve(within, (C / scale).T).T / scale
            mean, P_rts = before.mean + C @ (mean - now.mean), before.P + C @ (P_rts - now.P) @ C.T
    assert not rows


def test_the_covariance_is_carried_on_again_as_it_was(recording):
    """With noise that counts ten times from the middle on: another row of the model."""
    _, nav, final, nodes, whole = prepared(recording)
    count, middle_s = 400, final.numbers[200, 0]
    nav = adaptation.replayed(nav, [(middle_s, 10.0, (1.0, 1.0))])
    trajectory = relinear.Trajectory(nodes.xs, np.zeros((len(nodes.xs), 3)))
    n, room = nav.layout.n, relinear.room(len(nodes.ticks), nav.layout.n)
    P, found = [], np.empty((count, relinear.TOP, n))
    for m in (0, count - 1):
        cut = nodes._replace(ticks=nodes.ticks[:m], parts_s=nodes.parts_s[:m], seen={})
        passed = relinear.forward(nav, whole, cut, trajectory, nav.history[0], room, second=True)
        P.append(passed.covariances[m])
    durations = nodes.parts_s[:, 1] - nodes.parts_s[:, 0]
    nothing = np.empty((0, relinear.TOP, relinear.TOP)), np.full(count, -1), np.empty((0, n, n))
    wanted = smoother.Wanted(np.zeros(count, dtype=bool), *nothing)
    smoother._filtered(nav.constants, room, durations, (0, count), P[0].copy(), found, wanted)
    sigma = np.sqrt(np.diag(P[1]))
    scale = np.outer(sigma[: relinear.TOP], np.where(sigma > 0.0, sigma, 1.0))
    assert np.abs((found[-1] - P[1][: relinear.TOP]) / scale).max() < 1e-9
    assert np.isclose(room.walks[count - 2, 0], 100.0 * room.walks[0, 0]) and room.walks[0, 0] > 0.0


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
        after, nav, final, nodes, whole = prepared(misaligned(recording, error_deg))
        trajectory = relinear.Trajectory(nodes.xs, smooth.known_field(after, nodes, final, nodes.xs))
        room = relinear.room(len(nodes.ticks), nav.layout.n)
        e, _ = smooth.smoothed_about(nav, whole, nodes, nav.history[0], room, trajectory)
        once.append(smoother.moved(nodes.xs, e, nav.layout.nominal)[nodes.ends[1:], :10])
        twice.append(smooth.run(misaligned(recording, error_deg)).smoothed.nav)
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


def test_chunks_of_any_length_give_the_same(recording, result, monkeypatch):
    monkeypatch.setattr(smooth, "CHUNK_TICKS", 137)
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


@pytest.mark.slow
def test_errors_are_smaller_and_as_large_as_said(flights):
    """8 flights: RMS ratios (the covariances say 0.35, 0.84, 0.76), and NEES at four instants."""
    rows = [{row["part"]: row for row in smoothed.compare(*flight)} for flight in flights]
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
            times, values, _ = normalised_errors(flight.smoothed, navigation_errors(flight.smoothed))
            nees.append(values[np.argmin(np.abs(times - t_s))])
        low, high = chi2.ppf([5e-4, 0.9995], 9 * len(nees)) / len(nees)
        assert low < np.mean(nees) < high, (t_s, np.mean(nees))


def test_a_reset_does_not_leak_into_what_was_before(tmp_path):
    """A camera bent by 2 deg is believed in the end; the attitude of the boost stays that of the pad."""
    path = write(tmp_path / "bent.mcap", Options(stars_turned=np.radians(2.0)))
    flight = smooth.run(rerun.open_log(path))
    assert any("reset" in gate.note for gate in flight.filtered.gates if gate.sensor == "star_tracker")
    errors = navigation_errors(flight.smoothed)
    attitude_deg = np.degrees(np.linalg.norm(errors.attitude_b, axis=1))
    assert attitude_deg[errors.t_s < 21.0].max() < 0.6
    assert np.linalg.norm(errors.position_i, axis=1).max() < 10.0
    assert np.isfinite(flight.smoothed.nav.sigma_theta_b).all()


def test_parts_of_the_flight(result):
    rows = smoothed.compare(result.filtered, result.filtered)
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
    errors = navigation_errors(result.filtered)
    inside = (errors.t_s >= middle["from_s"]) & (errors.t_s <= middle["to_s"])
    by_hand = np.sqrt((errors.position_i[inside] ** 2).sum(axis=1).mean())
    assert np.isclose(middle["filtered"]["position_m"], by_hand, rtol=1e-12)


def test_a_log_that_ends_before_the_motor_does_is_of_the_boost(result):
    data = result.filtered
    early = [event for event in data.events if not event.name.startswith("burn_out")]
    phase = np.where(data.truth.t_s >= 0.0, Phase.BOOST, Phase.PAD)
    cut = data._replace(events=early, gates=[], truth=data.truth._replace(phase=phase))
    assert [part.name for part in smoothed.parts(cut) if part.from_s < part.to_s] == ["boost"]


def test_readings_at_the_end_of_their_range_are_wrong_and_those_after_them_are_not():
    """Two ticks in a row and one alone, of an axis that counts as saturated throughout; a stuck one stays."""
    ticks, n = 30, 4
    numbers = np.column_stack([0.01 * np.arange(ticks + 1), *np.full((3, ticks + 1), [[0.0025], [n], [0.0]])])
    increments = np.full((ticks + 1, 2 + n, 6), 1e-4)
    increments[[5, 6, 20], 3, 3] = 0.25, -0.26, 0.25  # of 100 m/s^2
    extra = np.full((ticks + 1, 2, 3), 7.0)
    states = np.zeros((ticks + 1, 6), dtype=int)
    states[5:, 3], states[8:, 1] = integrity_readings.SATURATED, integrity_readings.STUCK
    rules = np.array([[np.inf, np.inf], [10.0, 100.0], [1.0, 7.0], [0.5, 50.0], [10.0, 50.0]])
    xs, drives = np.zeros((ticks + 1, N_NOMINAL)), np.zeros((ticks + 1, 6, 0))
    final = final_pass.Final(numbers, increments, extra, xs, [()] * (ticks + 1), drives)
    found = smooth.without_hedging(final, states, np.zeros(ticks, dtype=bool), rules).extra
    variance = 0.01 * found[:, 1, 0]
    assert np.isclose(variance[5] + variance[6], (50.0 * 0.02) ** 2)  # the same sign for 20 ms
    assert np.isclose(variance[5], (50.0 * 0.01) ** 2) and np.isclose(variance[20], variance[5])
    assert not np.delete(found[5:, 1, 0], [0, 1, 15]).any()
    others = found[:, [0, 0, 0, 1, 1], [0, 1, 2, 1, 2]]
    assert np.all(others == 7.0) and np.all(found[:5] == 7.0) and np.all(extra == 7.0)
    unnamed = np.arange(1, ticks + 1) == 12  # the unit says so of a tick in which no reading shows it
    assert smooth.without_hedging(final, states, unnamed, rules).extra[12, 1, 0] > 0.0
