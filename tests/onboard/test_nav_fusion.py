"""The filter in time (delayed measurements), in trouble (outliers, resets), and its consistency."""

import numpy as np
import pytest
from navigation_flight import DEG, DT, EARTH, PARAMS, alignment, fly, gps_fix, star_fix, state_at
from scipy.stats import chi2
from unpacked import correct

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import covariance, fusion, solution
from shefex_nav.onboard.navigation.state import ATT, OPTIONAL, POS, PVA, VEL, layout, pack

BLOCKS, STATES = fly(30.0)
LAYOUT = layout()
MOUNT = LAYOUT.places["mounting"]


def run(fixes, until_s, start=None, params=PARAMS, blocks=BLOCKS):
    """Fly the filter with (sensor, fix) pairs, handed over when available. -> Filter, [GateResult]"""
    nav = fusion.start(params, start or alignment(STATES[0]), EARTH)
    waiting = sorted(fixes, key=lambda pair: pair[1].t_available_s)
    results = []
    for block in blocks[: round(until_s * 100)]:
        fusion.advance(nav, block)
        due = [pair for pair in waiting if pair[1].t_available_s <= block.t_valid_s + 1e-9]
        waiting = waiting[len(due) :]
        if due:
            results += fusion.fuse(nav, due)
    return nav, results


def test_stars_have_their_turn_last_whatever_arrives_first():
    """What is refused is told in the order in which it is taken."""
    gps = [gps_fix(BLOCKS, STATES, t, 0.0) for t in (3.5, 3.0)]
    stars = [star_fix(BLOCKS, STATES, t, 0.0) for t in (3.2, 2.9, 3.1)]

    def told(arrived):
        nav, _ = run([], 2.0)
        return [(one.sensor, one.t_valid_s, one.note) for one in fusion.take(nav, arrived)]

    wanted = told([*gps, *stars])
    assert [name for name, *_ in wanted] == ["gps_position", "gps_velocity"] * 2 + ["star_tracker"] * 3
    assert [t_s for _, t_s, _ in wanted[4:]] == [3.2, 2.9, 3.1] and wanted[0][1] == 3.5
    assert all(note == "from the future" for *_, note in wanted)
    assert told([stars[0], gps[0], stars[1], gps[1], stars[2]]) == wanted


def error(nav, truth):
    """Error of the estimate at the last tick, position, velocity, attitude (9,)."""
    state = nav.history[-1].state
    attitude = rotation.rotvec_between(state.q_ib, truth.q_ib)
    return np.concatenate([truth.r_i - state.r_i, truth.v_i - state.v_i, attitude])


def apart(one, two):
    """Largest difference of two filters in units of sigma: estimates, and relative of the covariance."""
    a, b = one.history[-1], two.history[-1]
    sigma = np.sqrt(np.diag(a.P))
    dx = np.concatenate(
        [
            b.state.r_i - a.state.r_i,
            b.state.v_i - a.state.v_i,
            rotation.rotvec_between(a.state.q_ib, b.state.q_ib),
            (b.x - a.x)[one.layout.nominal],
        ]
    )
    return max(np.abs(dx / sigma).max(), np.abs((a.P - b.P) / np.outer(sigma, sigma)).max())


def fixes_of(latency, rng):
    """GPS every second from 5 s, stars from 22.0304 s: instants between ticks and between samples."""
    gps = [("gps", gps_fix(BLOCKS, STATES, t, latency["gps"], rng)) for t in (5.0, 6.0, 7.0012, 22.0, 23.0)]
    stars = [
        ("star_tracker", star_fix(BLOCKS, STATES, 22.0304 + 0.1 * k, latency["star"], rng)) for k in range(12)
    ]
    return gps + stars


def test_without_errors_the_estimate_stays_on_the_truth():
    nav, results = run(fixes_of({"gps": 0.2, "star": 0.1}, None), 24.0)
    held = [result for result in results if not result.accepted]
    assert len(results) == 22 and [result.t_valid_s for result in held] == [22.0304]  # the first star fix
    dx = error(nav, STATES[2400])
    assert np.linalg.norm(dx[POS]) < 1e-3
    assert np.linalg.norm(dx[VEL]) < 1e-3
    assert np.linalg.norm(dx[ATT]) < 1e-6


@pytest.mark.compiled
@pytest.mark.parametrize(
    "latency", [{"gps": 0.2, "star": 0.1}, {"gps": 0.05, "star": 0.3}, {"gps": 0.55, "star": 0.0}]
)
def test_a_delayed_measurement_counts_as_if_it_had_come_in_time(latency):
    """Also when star fixes overtake GPS fixes, with the same noise. In time is a sample late: the rate at the
    instant is the mean about it."""
    start = alignment(STATES[0], np.random.default_rng(1))
    at_once, in_time, delayed = (
        run(fixes_of(late, np.random.default_rng(2)), 24.0, start)[0]
        for late in ({"gps": 0.0, "star": 0.0}, {"gps": DT, "star": 0.0}, latency)
    )
    assert apart(in_time, delayed) < 1e-6 < apart(at_once, delayed) < 1e-2


@pytest.mark.compiled
def test_a_delay_changes_nothing_with_every_block_on():
    """Out of order, between samples, several fixes at one instant, all blocks, errors of positions that last
    and one that is refused: 1e-6 of sigma, from a sample on."""
    names = tuple(OPTIONAL)[1:]
    sigmas = {name: np.full(size, SIGMAS.get(name, 1e-4)) for name, size in OPTIONAL.items()}
    clock = {"clock_white": 0.1, "clock_walk": 0.2, "range_bias_sigma": 3.0, "range_bias_time_s": 100.0}
    params = PARAMS._replace(states=names, sigma_blocks=sigmas, lasting_share=0.4, **clock)
    start = alignment(STATES[0], np.random.default_rng(1))
    runs = []
    for late in (False, True):
        rng = np.random.default_rng(2)
        fixes = fixes_of({"gps": 0.0, "star": 0.0}, rng)
        fixes += [
            ("star_tracker", star_fix(BLOCKS, STATES, t, 0.0, rng)) for t in (5.0, 5.5, 6.9988, 7.0012, 22.5)
        ]
        more = [gps_fix(BLOCKS, STATES, t, 0.0, rng) for t in (5.2, 5.4, 6.1, 6.3, 22.2, 22.4)]
        more[4] = more[4]._replace(r_ea_e=more[4].r_ea_e + 1000.0)
        fixes += [("gps", fix) for fix in more]
        delays = np.maximum(np.random.default_rng(3).uniform(0.0, 0.55, len(fixes)) * late, DT)
        fixes = [
            (name, fix._replace(t_available_s=fix.t_valid_s + delay))
            for (name, fix), delay in zip(fixes, delays, strict=True)
        ]
        runs.append(run(fixes, 24.0, start, params))
    (in_time, decided), (delayed, decided_late) = runs
    assert in_time.layout.n == 15 + sum(OPTIONAL[name] for name in names)
    used = [
        sorted((r.t_valid_s, r.sensor, r.accepted) for r in results) for results in (decided, decided_late)
    ]
    assert used[0] == used[1] and sum(accepted for *_, accepted in used[0]) >= 35
    assert (22.2, "gps_position", False) in used[0]
    assert apart(in_time, delayed) < 1e-6


SIGMAS = {
    "gyro_g_sensitivity": 1e-6,
    "lever_arm": 0.1,
    "clock": 100.0,
    "gps_latency": 1e-3,
    "range_bias": 3.0,
}


def test_ignoring_the_delay_would_be_seen():
    """The same fixes stamped 0.1 s late: many sigma."""
    start = alignment(STATES[0], np.random.default_rng(1))
    fix = gps_fix(BLOCKS, STATES, 7.0, 0.0)
    in_time, _ = run([("gps", fix)], 7.2, start)
    late, results = run([("gps", fix._replace(t_valid_s=7.1, t_available_s=7.1))], 7.2, start)
    assert not results[0].accepted and apart(in_time, late) > 1.0


def test_measurements_out_of_reach_are_refused_with_a_note():
    old, early = gps_fix(BLOCKS, STATES, 5.0, 0.7), gps_fix(BLOCKS, STATES, 5.5, -0.3)
    nav, results = run([("gps", old), ("gps", early)], 7.0)
    untouched, _ = run([], 7.0)
    notes = {result.t_valid_s: result.note for result in results}
    assert notes == {5.0: "older than the history", 5.5: "from the future"}
    assert not any(result.accepted for result in results)
    assert apart(nav, untouched) == 0.0


def test_a_fix_of_the_alignment_or_before_is_not_called_old():
    """The filter starts at 0 s; nothing has been thrown away from its history yet."""
    fixes = [gps_fix(BLOCKS, STATES, 0.0, 0.2), gps_fix(BLOCKS, STATES, 0.0, 0.2)._replace(t_valid_s=-0.5)]
    _, results = run([("gps", fix) for fix in fixes], 0.3)
    assert {result.note for result in results} == {"not after the start of the filter"}


def test_a_fix_without_solution_is_skipped_and_says_why():
    fix = gps_fix(BLOCKS, STATES, 5.0, 0.1)._replace(
        valid=False, reason="3 satellites", r_ea_e=np.full(3, np.nan)
    )
    nav, (result,) = run([("gps", fix)], 6.0)
    assert result.note == "no fix: 3 satellites" and not result.accepted and result.dof == 0
    assert np.isfinite(nav.history[-1].P).all()


def test_imu_blocks_must_follow_on_each_other():
    nav = fusion.start(PARAMS, alignment(STATES[0]), EARTH)
    fusion.advance(nav, BLOCKS[0])
    with pytest.raises(ValueError, match="does not follow"):
        fusion.advance(nav, BLOCKS[2])


def moved(fix, metres):
    return fix._replace(r_ea_e=fix.r_ea_e + np.array([metres, 0.0, 0.0]))


def test_an_outlier_is_rejected_and_leaves_no_trace():
    good = [("gps", gps_fix(BLOCKS, STATES, t, 0.2)) for t in (2.0, 3.0, 5.0)]
    outlier = moved(gps_fix(BLOCKS, STATES, 4.0, 0.2), 400.0)
    nav, results = run([*good, ("gps", outlier)], 6.0)
    rejected = [result for result in results if not result.accepted]
    assert [(r.sensor, r.t_valid_s, r.note) for r in rejected] == [("gps_position", 4.0, "rejected")]
    assert rejected[0].nis > rejected[0].limit and np.isclose(
        np.abs(rejected[0].innovation).max(), 400.0, atol=1.0
    )
    assert np.linalg.norm(error(nav, STATES[600])[POS]) < 1.0


def test_a_filter_that_went_wrong_believes_gps_in_the_end():
    """The alignment is 3 km off: four fixes in three seconds that agree with each other bring it back."""
    start = alignment(STATES[0])
    start = start._replace(r_i=start.r_i + np.array([0.0, 3000.0, 0.0]))
    nav, results = run([("gps", gps_fix(BLOCKS, STATES, float(t), 0.2)) for t in range(1, 8)], 8.0, start)
    notes = [result.note for result in results if result.sensor == "gps_position"]
    assert notes == ["rejected"] * 3 + ["reset after timeout"] + [""] * 3
    dx = error(nav, STATES[800])
    assert np.linalg.norm(dx[POS]) < 1.0  # half a sigma of GPS: the velocity has suffered a little
    assert np.sqrt(nav.history[-1].P[0, 0]) < 2.0


def test_a_receiver_that_repeats_itself_is_never_believed():
    frozen = gps_fix(BLOCKS, STATES, 5.0, 0.2)
    fixes = [("gps", frozen)]
    fixes += [("gps", frozen._replace(t_valid_s=5.0 + k, t_available_s=5.2 + k)) for k in range(1, 20)]
    _, results = run(fixes, 26.0)
    notes = {result.note for result in results if result.t_valid_s > 5.0}
    assert notes == {"frozen: position of T+5.0 s"}
    assert [result.accepted for result in results] == [True, True] + [False] * 38


LOST = np.deg2rad([15.0, -4.0, 6.0])  # attitude of the alignment, far outside its covariance


def lost_alignment():
    start = alignment(STATES[0])
    return start._replace(q_ib=rotation.quat_multiply(start.q_ib, rotation.quat_from_rotvec(-LOST)))


def coast(start_attitude_error):
    """Truth and blocks from 24 s on, so that the wrong attitude has not spoilt the velocity by thrust."""
    first = 2400
    blocks, states = BLOCKS[first:], STATES[first:]
    q_ib = rotation.quat_multiply(states[0].q_ib, rotation.quat_from_rotvec(-start_attitude_error))
    start = alignment(states[0])._replace(q_ib=q_ib)
    return (
        start,
        blocks,
        lambda t, wrong=None: ("star_tracker", star_fix(BLOCKS, STATES, t, 0.1, None, wrong)),
    )


def test_two_star_fixes_that_agree_reset_a_lost_attitude():
    start, blocks, fix = coast(LOST)
    nav, results = run([fix(25.0), fix(25.1), fix(25.2)], 2.0, start, blocks=blocks)
    assert [result.note for result in results] == ["rejected", "attitude reset", ""]
    assert np.linalg.norm(error(nav, STATES[2600])[ATT]) < 1e-6
    P = nav.history[-1].P
    # what is left is the fix and the mounting, which the two share with opposite sign
    expected = PARAMS.sigma_blocks["mounting"] ** 2 + np.array([20.0, 100.0, 20.0]) ** 2 * (DEG / 3600) ** 2
    assert np.all(np.diag(P)[ATT] < 1.01 * expected) and np.all(np.diag(P)[ATT] > 0.5 * expected)
    assert np.all(np.diag(P[ATT, MOUNT]) < 0.0)


def test_one_wrong_star_fix_is_never_taken():
    """Alone; between good ones; and two that disagree."""
    start, blocks, fix = coast(np.zeros(3))
    wrong, other = np.deg2rad([40.0, 20.0, -10.0]), np.deg2rad([-5.0, 60.0, 8.0])
    for fixes in (
        [fix(25.0, wrong)],
        [fix(25.0), fix(25.1, wrong), fix(25.2)],
        [fix(25.0, wrong), fix(25.1, other), fix(25.2, wrong)],
    ):
        nav, results = run(fixes, 2.0, start, blocks=blocks)
        assert all("reset" not in result.note for result in results)
        assert np.linalg.norm(error(nav, STATES[2600])[ATT]) < 1e-4


def test_two_agreeing_fixes_are_not_enough_once_stars_have_been_used():
    start, blocks, fix = coast(np.zeros(3))
    wrong = np.deg2rad([40.0, 20.0, -10.0])
    inertial = rotation.dcm_from_quat(state_at(BLOCKS, STATES, 25.1)[0].q_ib) @ wrong

    def twisted(t):
        """The same wrong rotation in inertial axes, so that successive fixes agree through the gyros."""
        q_ib = state_at(BLOCKS, STATES, t)[0].q_ib
        return fix(t, rotation.dcm_from_quat(q_ib).T @ inertial)

    good = [fix(24.9), fix(25.0)]
    nav, results = run([*good, *(twisted(25.1 + 0.1 * k) for k in range(10))], 2.5, start, blocks=blocks)
    assert [result.note for result in results[1:]] == [""] + ["rejected"] * 10
    assert np.linalg.norm(error(nav, STATES[2650])[ATT]) < 1e-4
    nav, results = run([*good, *(twisted(25.1 + 0.1 * k) for k in range(25))], 4.0, start, blocks=blocks)
    assert [result.note for result in results].count("attitude reset") == 1


def faulty(rng):
    """Blocks with the sensor errors of PARAMS, and the errors: what the filter assumes is what is drawn."""
    model = PARAMS.imu
    bias = PARAMS.sigma_gyro_bias * rng.standard_normal(3)
    accel = PARAMS.sigma_accel_bias * rng.standard_normal(3)
    column = PARAMS.sigma_blocks["gyro_roll_column"] * rng.standard_normal(3)
    blocks = []
    for block in BLOCKS:
        noise = rng.standard_normal((2, 4, 3)) * np.sqrt(DT)
        dtheta_b = block.dtheta_b + np.outer(block.dtheta_b[:, 0], column) + bias * DT
        blocks.append(
            block._replace(
                dtheta_b=dtheta_b + model.gyro_random_walk * noise[0],
                dv_b=block.dv_b + accel * DT + model.accel_random_walk * noise[1],
            )
        )
    return blocks


@pytest.mark.slow
@pytest.mark.compiled
def test_errors_have_the_size_that_the_covariance_says():
    """NEES of position, velocity and attitude at 29 s over 30 runs, chi-square bounds at 99.9 %."""
    exact = PARAMS._replace(
        imu=PARAMS.imu._replace(
            gravity=0.0,
            accel_scale=0.0,
            accel_misalignment=0.0,
            gyro_cross=0.0,
            gyro_g_sensitivity=0.0,
            accel_bias_walk=0.0,
            gyro_bias_walk=0.0,
        )
    )
    nees = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        mounting = PARAMS.sigma_blocks["mounting"] * rng.standard_normal(3)
        fixes = [("gps", gps_fix(BLOCKS, STATES, float(t), 0.2, rng)) for t in range(1, 29)]
        fixes += [
            ("star_tracker", star_fix(BLOCKS, STATES, 25.0031 + 0.1 * k, 0.1, rng, mounting))
            for k in range(30)
        ]
        nav, _ = run(fixes, 29.0, alignment(STATES[0], rng), exact, faulty(rng))
        dx = error(nav, STATES[2900])
        nees.append(dx @ np.linalg.solve(nav.history[-1].P[PVA, PVA], dx))
    low, high = chi2.interval(0.999, 9 * len(nees))
    assert low < np.sum(nees) < high


def test_solution_against_plain_geometry():
    nav, _ = run([("gps", gps_fix(BLOCKS, STATES, 5.0, 0.2))], 6.0)
    out, state = solution.solution(nav), nav.history[-1].state
    r_e, v_e = frames.ecef_from_inertial(EARTH, 6.0, state.r_i, state.v_i)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    north, east, down = wgs84.dcm_en(latitude, longitude).T @ v_e
    assert np.allclose(out.r_e, r_e) and np.allclose(out.v_e, v_e)
    assert out.flight_path_angle == pytest.approx(-np.arcsin(down / np.linalg.norm(v_e)))
    assert out.heading == pytest.approx(np.arctan2(east, north))
    C_be = rotation.dcm_from_quat(state.q_ib).T @ frames.dcm_ie(EARTH, 6.0)
    v_b = C_be @ v_e
    assert out.angle_of_attack == pytest.approx(np.arctan2(v_b[2], v_b[0]))
    assert out.sideslip == pytest.approx(np.arcsin(v_b[1] / np.linalg.norm(v_e)))
    assert not out.star_aided
    told = covariance.covariance(nav)
    assert told.P.shape == (9, 9) and told.sigma.shape == (12,)


def test_sigmas_of_the_solution_are_those_of_samples():
    """4000 samples of the error; standard deviations within 6 % (five sigma of their estimate)."""
    nav, _ = run([("gps", gps_fix(BLOCKS, STATES, 5.0, 0.2))], 6.0)
    tick, out = nav.history[-1], solution.solution(nav)
    rng = np.random.default_rng(3)
    samples = np.linalg.cholesky(tick.P) @ rng.standard_normal((LAYOUT.n, 4000))
    rows, derived = [], ("r_e", "v_e", "omega_ib_b", "flight_path_angle", "angle_of_attack", "sideslip")
    for dx in samples.T:
        nav.history.xs[nav.history.place(-1)] = pack(correct(LAYOUT, tick.state, dx))
        found = solution.solution(nav)
        rows.append(np.concatenate([np.ravel(getattr(found, name)) for name in derived]))
    deviation = np.std(rows, axis=0)
    expected = np.concatenate([out.sigma_r_e, out.sigma_v_e])
    assert np.allclose(deviation[:6], expected, rtol=0.06)
    angles = [out.sigma_flight_path_angle, out.sigma_angle_of_attack, out.sigma_sideslip]
    assert np.allclose(deviation[9:12], angles, rtol=0.06)
    rate = np.sqrt(out.sigma_omega_b**2 - PARAMS.imu.gyro_random_walk**2 / DT)
    assert np.allclose(deviation[6:9], rate, rtol=0.06)
    assert np.allclose(out.sigma_theta_b, np.sqrt(np.diag(tick.P)[ATT]))
