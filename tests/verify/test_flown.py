"""Runs kept by their star fixes, and the statistics of a filter whose errors are known."""

from pathlib import Path

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.onboard.navigation.fusion import Correction, Interval
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.records import Detections, StarFix, Trajectory
from shefex_nav.report.navigation_errors import nees as normalised
from shefex_nav.scenario import load, params_onboard
from shefex_nav.scenario.of_settings import settings
from shefex_nav.verify import consistency, flown, linear, nees
from shefex_nav.verify.flown import PHASES, Run
from shefex_nav.world import imu, noise

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
N = 15


def star_fix(rng, number, n_stars):
    seen = Detections(rng.random((n_stars, 2)) * 600, *[np.zeros(n_stars)] * 3, np.zeros((n_stars, 2, 2)))
    return StarFix(
        number, 250.0 + 0.1 * number, 250.08 + 0.1 * number, 0, rng.random(4), rng.random((3, 3)), seen,
        rng.integers(0, 9, n_stars), 0.1, 20.0, 0.05 + 0.001 * number, False, False,
        straight=number % 2 == 0,
    )  # fmt: skip


@pytest.mark.parametrize("counts", [(4, 0, 7), ()])
def test_kept_fixes_come_back(tmp_path, counts):
    rng = np.random.default_rng(0)
    fixes = [star_fix(rng, k, count) for k, count in enumerate(counts)]
    flown.save(tmp_path / "fixes.npz", fixes, {"code": "abc"})
    assert flown.made_by(tmp_path / "fixes.npz") == {"code": "abc"}
    again = flown.load(tmp_path / "fixes.npz", {"code": "abc"})
    assert len(again) == len(fixes)
    for one, other in zip(fixes, again, strict=True):
        assert (one.number, one.t_valid_s, one.t_available_s) == (
            other.number,
            other.t_valid_s,
            other.t_available_s,
        )
        assert one.exposure_s == other.exposure_s  # by which the filter straightens a fix
        assert one.straight == other.straight  # where the star tracker has not done so
        for name in ("q_ic", "P_c", "hip"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
        assert np.array_equal(one.detections.xy_px, other.detections.xy_px)
    with pytest.raises(flown.FlownError, match="are those of code abc, not of code another"):
        flown.load(tmp_path / "fixes.npz", {"code": "another"})


def test_files_that_lack_what_the_filter_uses_are_refused(tmp_path):
    """Of fixes that were straightened already the motion within the exposure was taken out once more."""
    path = tmp_path / "fixes.npz"
    flown.save(path, [star_fix(np.random.default_rng(0), 1, 4)], {"code": "abc"})
    kept = dict(np.load(path))
    del kept["straight"]
    np.savez(path, **kept)
    with pytest.raises(flown.FlownError, match=r"fixes\.npz: an older version kept less .*; remove it"):
        flown.load(path)


def test_fixes_of_another_scenario_or_with_other_overrides_are_refused(tmp_path):
    """What differs is named; another version of the code alone is only told of."""
    path = tmp_path / "fixes.npz"
    flown.save(path, [], {"code": "abc", "scenario": "a.yaml", "set": ["gps.rate=2 Hz"]})
    assert flown.load(path, {"scenario": "a.yaml", "set": ["gps.rate=2 Hz"]}) == []
    with pytest.raises(
        flown.FlownError, match=r"are those of scenario a\.yaml, not of scenario b\.yaml; keep"
    ):
        flown.load(path, {"scenario": "b.yaml", "set": ["gps.rate=2 Hz"]})
    with pytest.raises(flown.FlownError, match=r"those of set \['gps\.rate=2 Hz'\], not of set \[\]"):
        flown.load(path, {"scenario": "a.yaml", "set": []})
    assert flown.provenance([path, path]) == "code abc, scenario a.yaml, set ['gps.rate=2 Hz']"


def test_a_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "fixes-0001.npz"
    for content in (b"", b"star fixes", b"PK\x03\x04 cut off"):
        path.write_bytes(content)
        with pytest.raises(
            flown.FlownError, match=r"fixes-0001\.npz: no file of star fixes, or a damaged one"
        ):
            flown.load(path)
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(flown.FlownError, match="no file of star fixes"):
        flown.load(path)
    np.savez(path, number=np.zeros(3))
    with pytest.raises(flown.FlownError, match="no file of star fixes"):
        flown.load(path)


def at_rest(seconds):
    """Trajectory that stands still for some seconds and burns in between."""
    n = seconds * 400 + 1
    ones, zeros = np.ones(n), np.zeros((n, 3))
    burning = np.zeros(n, dtype=np.int8)
    burning[400:800] = 1
    return Trajectory(
        np.arange(n) / 400.0, burning, zeros, zeros, np.tile([1.0, 0, 0, 0], (n, 1)), zeros, zeros, zeros,
        zeros, ones, ones, ones, ones, burning, ones,
    )  # fmt: skip


def test_true_biases_are_those_of_the_instrument():
    """An instrument without random walk and vibration reads its biases, and nothing else, at rest."""
    off = [f"imu.gyro.{name}" for name in ("random_walk=0 deg/sqrt(h)", "quantum=off")]
    off += [f"imu.accelerometer.{name}" for name in ("random_walk=0 m/s/sqrt(h)", "quantum=off")]
    off += ["imu.vibration.boost=[0 gee, 0 gee]", "imu.vibration.coast=0 gee"]
    trajectory = at_rest(5)
    scenario = load.load(str(SCENARIO), off)
    read = imu.measure(settings(scenario.imu), trajectory, noise.generator(7, "imu"))
    true = prepare.true_biases(load.load(str(SCENARIO)), 7, trajectory)
    assert true[1:, :3] == pytest.approx(read.dtheta_b[1:] * 400.0, rel=1e-9)
    assert true[1:, 3:] == pytest.approx(read.dv_b[1:] * 400.0, rel=1e-9)


def test_phases_of_a_run():
    t_s = np.array([0.5, 1.5, 2.5, 3.0, 4.0, 4.5])
    assert flown.phases(t_s, at_rest(5), [2.9, 4.0]).tolist() == [1, 0, 1, 2, 2, 3]
    assert flown.phases(t_s, at_rest(5), []).tolist() == [1, 0, 1, 1, 1, 1]
    assert flown.phases(np.array([-1.0]), at_rest(5), []).tolist() == [flown.PAD]


def test_without_stars_the_descent_begins_at_the_apogee():
    t_s, still = np.array([0.5, 1.5, 2.5, 3.5, 4.5]), at_rest(5)
    over = still._replace(r_i=np.outer(6.4e6 - 1e3 * (still.t_s - 3.0) ** 2, [0.6, 0.0, 0.8]))
    assert flown.phases(t_s, over, []).tolist() == [1, 0, 1, 4, 4]
    assert flown.phases(t_s, over, [2.4, 3.6]).tolist() == [1, 0, 2, 2, 3]
    low = still._replace(r_i=np.outer(6.4e6 - 10.0 * (still.t_s - 3.0) ** 2, [0.6, 0.0, 0.8]))
    assert flown.phases(t_s, low, []).tolist() == [1, 0, 1, 1, 1]


def test_recorder_joins_the_ticks_between_updates_and_epochs():
    """100 ticks with one update: the product of all, cut at the update and at each half second."""

    class Imu:
        vibration = 0.25

    class Fix:
        t_available_s = 0.33

    rng = np.random.default_rng(1)
    recorder, product, noise_sum = flown.Recorder(0.0), np.eye(2), np.zeros((2, 2))
    for n in range(1, 101):
        t_s = n / 100.0
        Phi = np.eye(2) + 0.01 * rng.standard_normal((2, 2))
        Q = np.diag(rng.random(2))
        product, noise_sum = Phi @ product, Phi @ noise_sum @ Phi.T + Q
        none = [None] * 9
        recorder(Interval(t_s - 0.01, t_s, None, None, Phi, Q, None, None, Imu))
        if n == 20:
            H, R = np.ones((1, 2)), np.ones((1, 1))
            recorder(Correction(t_s, "gps_position", Fix, Fate.USED, *none[:4], H, R, *none[:4]))
    kinds = [type(step).__name__ for step in recorder.steps]
    assert kinds == ["Interval", "Update", "Interval", "Interval"]
    assert [step.t_s for step in recorder.steps] == pytest.approx([0.2, 0.2, 0.5, 1.0])
    assert recorder.steps[1].available_s == 0.33
    intervals = [step for step in recorder.steps if isinstance(step, linear.Interval)]
    joined = intervals[2].Phi @ intervals[1].Phi @ intervals[0].Phi
    assert joined == pytest.approx(product, rel=1e-12)
    assert recorder.vibration(np.array([0.5, 1.0])).tolist() == [0.25, 0.25]
    part = type("Imu", (), {"vibration": 0.75})
    recorder(Interval(1.0, 1.003, None, None, np.eye(2), np.eye(2), None, None, part))
    assert recorder.vibration(np.array([1.0])).tolist() == [0.25]  # a part of the next tick changes nothing
    P, more = np.eye(2), np.diag([3.0, 0.0])
    doubt = Correction(1.003, "gps_position", Fix, Fate.DOUBTED, None, P, P + more, *none[:7])
    recorder(doubt)
    assert np.array_equal(recorder.steps[-1].Q, more) and np.array_equal(recorder.steps[-1].Phi, np.eye(2))
    with pytest.raises(flown.FlownError, match="choose another seed"):
        recorder(Correction(1.0, "star_tracker", Fix, Fate.RESET, *none[:4], H, R, *none[:4]))


def steps_and_times():
    """Fifteen errors that wander, with measurements of all of them; 60 s."""
    steps, times_s = [], 0.5 * np.arange(1, 121)
    for k, t_s in enumerate(times_s):
        steps.append(linear.Interval(t_s, 0.99 * np.eye(N), 0.02 * np.eye(N)))
        if k % 4 == 3:
            steps.append(linear.Update(t_s, t_s + 0.2, "gps", np.eye(N)[:6], 0.5 * np.eye(6)))
    return steps, times_s


def runs_of(steps, times_s, phase, rng, number, factor=1.0):
    """Runs whose errors obey the steps but for a factor on what the filter says of them."""
    found = list(linear.outputs(np.eye(N), steps, times_s, rng=rng, number=number))
    P = np.array([output.P for output in found]) * factor
    errors = np.array([output.errors for output in found])
    nis = rng.chisquare(6, (number, 40)) / factor
    dof, refused = {"gps": np.full(40, 6)}, {"gps": 0}
    return [
        Run(seed, times_s, phase, errors[:, :, seed], P, {"gps": nis[seed]}, dof, refused)
        for seed in range(number)
    ]


@pytest.mark.parametrize("number", [20, 100])
def test_a_right_filter_has_all_errors_inside_3_sigma_as_often_as_needed(number):
    """Sixty axes and phases at once: each at 99 %, 7 and 14 % of the studies left one by chance."""
    rng, tries, left = np.random.default_rng(9), 400, 0
    times_s, phase = np.arange(4.0), np.arange(4)
    P = np.tile(np.eye(N), (4, 1, 1))
    for _ in range(tries):
        errors = rng.standard_normal((number, 4, N))
        runs = [Run(seed, times_s, phase, one, P, {}, {}, {}) for seed, one in enumerate(errors)]
        verdicts = consistency.judge_containment(runs)
        assert len(verdicts) == 60
        left += not all(one.good for one in verdicts)
    assert left / tries < 0.03
    small = [run._replace(P=P / 4.0) for run in runs]
    assert sum(not one.good for one in consistency.judge_containment(small)) > 15


def test_a_consistent_filter_passes_and_one_that_says_too_little_does_not():
    """100 runs of known statistics; then the same with covariances of a quarter, and of 1.5 times."""
    rng = np.random.default_rng(6)
    steps, times_s = steps_and_times()
    phase = np.repeat(np.arange(4), 30)
    none = consistency.Extra(np.zeros(120), np.zeros(120), 0.0)
    histories = consistency.simulate(np.eye(N), steps, times_s, phase, none, number=1000, rng=rng)
    verdicts = consistency.judge(runs_of(steps, times_s, phase, rng, 100), histories, rng)
    assert len(verdicts) == 5 * 4 + 1 + 15 * 4
    assert [one.what for one in verdicts if not one.good] == []
    for factor, too in ((0.25, "much"), (1.5, "little")):
        wrong = runs_of(steps, times_s, phase, rng, 100, factor)
        judged = consistency.judge(wrong, histories, rng)
        of_nees = [one for one in judged if one.what.startswith("NEES")]
        assert not any(one.good for one in of_nees), factor
        assert all((one.value > one.high) == (too == "much") for one in of_nees)
        assert not next(one for one in judged if one.what.startswith("NIS")).good


def test_what_is_reported_beyond_the_filter_is_in_the_histories():
    """Swing and gravity: the mean NEES of the histories stays what it is for three degrees of freedom."""
    rng = np.random.default_rng(6)
    steps, times_s = steps_and_times()
    extra = consistency.Extra(np.full(120, 2.0), np.full(120, 0.5), 3.0)
    phase = np.zeros(120, dtype=int)
    histories = consistency.simulate(np.eye(N), steps, times_s, phase, extra, number=1000, rng=rng)
    for (block, p), values in histories.averages.items():
        scatter = values.std() / np.sqrt(1000)
        assert values.mean() == pytest.approx(3.0, abs=4.5 * scatter), (block, PHASES[p])
    assert histories.P[50][3, 3] > 4.0


def test_what_is_reported_besides_is_that_of_the_filter():
    """Rounding always, vibration by whether a motor burns."""
    params = params_onboard.nav_params(prepare.settled(load.load("night_sky")))
    model = params.imu._replace(
        gyro_quantum=2e-5, accel_quantum=6e-4, gyro_vibration=1e-5, accel_vibration=0.3, gravity=1e-4
    )
    params = params._replace(imu=model, swing_at_rest=np.array([3e-6, 2e-4]))
    found = consistency.reported_besides(params, np.array([0.0, 0.5]))
    attitude2, velocity2 = (2e-5) ** 2 / 12.0, (6e-4) ** 2 / 12.0
    np.testing.assert_allclose(found.velocity**2, [velocity2 + 4e-8, velocity2 + 0.15**2])
    np.testing.assert_allclose(found.attitude**2, [attitude2 + 9e-12, attitude2 + 25e-12])
    assert found.gravity == 1e-4


def field_of_gravity():
    """Fifteen errors and a slow field that drives the last three of them; 60 s."""
    n, steps, times_s = N + 3, [], 0.5 * np.arange(1, 121)
    Phi = 0.9 * np.eye(n)
    Phi[N:, N:], Phi[N - 3 : N, N:] = 0.99 * np.eye(3), 0.1 * np.eye(3)
    Q = 0.1 * np.eye(n)
    Q[N:, N:] = 0.02 * np.eye(3)
    H = np.eye(n)[N - 3 : N]
    for t_s in times_s:
        steps.append(linear.Interval(t_s, Phi, Q))
        steps.append(linear.Update(t_s, t_s, "gps", H, 25.0 * np.eye(3)))
    return np.eye(n), steps, times_s


def test_runs_in_one_field_scatter_more_and_by_what_the_interval_says():
    """40 groups of 25 runs with a field in common, against the interval; only one block senses it."""
    rng = np.random.default_rng(7)
    P, steps, times_s = field_of_gravity()
    phase = np.zeros(120, dtype=int)
    none = consistency.Extra(np.zeros(120), np.zeros(120), 0.0)
    common = consistency.in_one_field(P, steps, times_s, phase, none, slice(N, N + 3), number=400, rng=rng)
    histories = consistency.simulate(P, steps, times_s, phase, none, number=400, rng=rng)
    for name in ("accel_bias", "gyro_bias"):
        parts = common[name, 0]
        whole = parts.own + 2.0 * np.diag(parts.cross) + parts.same  # histories like any others
        expected = histories.averages[name, 0]
        scatter = np.hypot(whole.std(), expected.std()) / np.sqrt(400)
        assert whole.mean() == pytest.approx(expected.mean(), abs=4.5 * scatter), name
        assert whole.std() == pytest.approx(expected.std(), rel=0.25), name
        low, high = nees.one_draw_interval(parts, 25, 0.9, rng)
        alone = 3.0 * np.array(nees.mean_interval(expected / 3.0, 25, 0.9))
        wider = (high - low) / (alone[1] - alone[0])
        assert wider > 1.5 if name == "accel_bias" else 0.8 < wider < 1.25, (name, wider)
    means = [group_in_one_field(P, steps, times_s, 25, rng) for _ in range(40)]
    low, high = nees.one_draw_interval(common["accel_bias", 0], 25, 0.9, rng)
    inside = np.mean([low < mean < high for mean in means])
    assert 0.75 <= inside <= 1.0  # 0.9 of 40; 99 % of them within


def group_in_one_field(P, steps, times_s, number, rng):
    """Mean NEES of the accelerometer biases of runs whose field is the same, step by step."""
    errors = rng.standard_normal((len(P), number))
    errors[N:] = rng.standard_normal((3, 1))
    total = 0.0
    for interval, update, known in zip(
        steps[::2], steps[1::2], linear.outputs(P, steps, times_s), strict=True
    ):
        errors = interval.Phi @ errors
        errors[:N] += np.sqrt(0.1) * rng.standard_normal((N, number))
        errors[N:] += np.sqrt(0.02) * rng.standard_normal((3, 1))
        P = interval.Phi @ P @ interval.Phi.T + interval.Q
        K = np.linalg.solve(update.H @ P @ update.H.T + update.R, update.H @ P).T
        errors -= K @ (update.H @ errors + 5.0 * rng.standard_normal((3, number)))
        P = known.P
        total += normalised(errors[N - 3 : N].T, P[N - 3 : N, N - 3 : N][None]).mean()
    return total / len(times_s)
