"""Navigation software of a user's own, a class: what it is given, what comes of it, its mistakes."""

import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from own_flights import CLASS, STATISTICAL, flown, reckoning, same, template

from shefex_nav import plugins, prepare, runs
from shefex_nav.errors import SoftwareError
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.log.topics import LogError
from shefex_nav.onboard import own_navigation
from shefex_nav.onboard.own_navigation import Estimate
from shefex_nav.onboard.own_software import OwnSoftware, covariance_fault
from shefex_nav.records import Doubt, NavCovariance, NavSolution, StarFix, rows
from shefex_nav.scenario.load import ScenarioError, load
from shefex_nav.software.mission import mission_data
from shefex_nav.world import imu


@pytest.mark.parametrize(
    ("name", "more", "until_s"),
    [
        pytest.param("night_sky", (), 3.0, marks=pytest.mark.slow),
        pytest.param("shefex2_andoya", (STATISTICAL,), 60.0, marks=pytest.mark.slow),
        ("tight", (STATISTICAL,), 20.0),
    ],
)
def test_the_built_in_filter_as_a_class_gives_the_built_in_records(name, more, until_s):
    built_in = flown(name, *more, until_s=until_s)
    own = flown(name, *more, f"navigation.software={CLASS}", until_s=until_s)
    assert any(isinstance(one, NavSolution) for one in own)
    assert same(own, built_in)


def test_what_follows_from_an_estimate():
    """Numbers against differences; sigmas against a sample drawn from P."""
    scenario = load("shefex2_andoya", [STATISTICAL])
    earth, rng, t_s = prepare.earth_rotation(scenario), np.random.default_rng(4), 100.0
    r_i = frames.dcm_ie(earth, t_s) @ wgs84.ecef_from_geodetic(1.2, 0.3, 60e3)
    v_i = np.array([900.0, 700.0, 1200.0])
    q_ib = rotation.quat_normalise(np.array([0.6, 0.3, -0.5, 0.4]))
    A = rng.standard_normal((9, 9)) * np.repeat([2.0, 0.05, 1e-4], 3)[:, None]
    estimate = Estimate(r_i, v_i, q_ib, A @ A.T, usable=(True, False, True))
    told = own_navigation.solution(estimate, t_s, np.zeros(3), earth)
    r_e, v_e = frames.ecef_from_inertial(earth, t_s, r_i, v_i)
    assert np.allclose(told.r_e, r_e) and np.allclose(told.v_e, v_e)
    assert (told.do_not_use_position, told.do_not_use_velocity, told.do_not_use_attitude) == (0, 1, 0)
    assert told.doubt_velocity == Doubt.SOFTWARE and np.isnan(told.protection_position).all()
    drawn = []
    for error in (A @ rng.standard_normal((9, 4000))).T:
        turned = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(error[6:]))
        one = own_navigation.solution(
            Estimate(r_i + error[:3], v_i + error[3:6], turned), t_s, np.zeros(3), earth
        )
        drawn.append([*one.r_e, *one.v_e, one.flight_path_angle, one.angle_of_attack, one.sideslip])
    found = np.std(drawn, axis=0)
    sigmas = [*told.sigma_r_e, *told.sigma_v_e, told.sigma_flight_path_angle]
    sigmas += [told.sigma_angle_of_attack, told.sigma_sideslip]
    assert np.allclose(found, sigmas, rtol=0.05)  # 4000 draws: 1.1 %, one sigma
    assert np.allclose(told.sigma_theta_b, np.sqrt(estimate.P.diagonal()[6:]))
    without = own_navigation.solution(estimate._replace(P=None), t_s, np.zeros(3), earth)
    assert np.isnan(without.sigma_r_e).all() and without.flight_path_angle == told.flight_path_angle


@pytest.mark.slow  # the same algorithm in C flies the same mission in test_own_program.py
def test_the_filter_to_start_from_meets_what_the_mission_requires(tmp_path):
    path = template("filter.py", tmp_path)
    records = flown("shefex2_andoya", STATISTICAL, f"navigation.software={path}:MyFilter", until_s=399.0)
    truth = [one for one in records if type(one).__name__ == "TruthSample"]
    told = [one for one in records if isinstance(one, NavSolution)]
    k = next(n for n, one in enumerate(told) if one.t_s > 398.0)
    errors = np.concatenate([truth[k].r_i - told[k].r_i, truth[k].v_i - told[k].v_i])
    turn = rotation.rotvec_between(told[k].q_ib, truth[k].q_ib)
    assert np.linalg.norm(errors[:3]) < 10.0 and np.linalg.norm(errors[3:]) < 0.3
    assert np.degrees(np.abs(turn)).max() < 0.17
    covariance = [one for one in records if isinstance(one, NavCovariance)][-1]
    error = np.concatenate([errors, turn])
    assert error @ np.linalg.solve(covariance.P, error) < 28.0  # 99.9 % of nine degrees of freedom


def test_the_star_tracker_is_told_what_the_software_knows(tmp_path):
    """Lost in space and by prediction: a filter that says nothing of its errors has its stars found too."""
    path = reckoning(tmp_path)
    records = flown("night_sky", f"navigation.software={path}:Reckoning", until_s=3.0)
    fixes = [one for one in records if isinstance(one, StarFix)]
    assert len(fixes) > 15 and all(one.reason == 0 for one in fixes)


NAV_SOLUTION = (
    "from numpy import inf, nan, zeros; from shefex_nav.onboard.own_navigation import solution; return "
    "[solution(Estimate(self.r, self.v, self.q), imu.t_valid_s, zeros(3), self.mission.earth)._replace"
)
GATE_RESULT = (
    "from numpy import zeros; from shefex_nav.records import GateResult; t = imu.t_valid_s; return "
    "[GateResult(t, t, 'mine', 3, 1.0, 9.0, True, '', zeros(3))._replace"
)
WRONG = (
    (
        "if self.ticks == 50: 1 / 0",
        r"T\+0.50 s: failed in step \(own.py:15\): ZeroDivisionError: (.|\n)*own.py.*line 15",
    ),
    ("if self.ticks == 50: raise SystemExit(0)", r"T\+0.50 s: failed in step \(own.py:15\): SystemExit: 0"),
    ("raise GeneratorExit", r"failed in step \(own.py:15\): GeneratorExit"),
    ("raise type('Own', (BaseException,), {})('x')", r"failed in step \(own.py:15\): Own: x"),
    (
        "raise type('Own', (Exception,), {'__str__': lambda self: 1 / 0})",
        r"failed in step \(own.py:15\): Own: a Own whose __str__ raises ZeroDivisionError",
    ),
    (
        "return type('Own', (), {'__repr__': lambda self: 1 / 0})()",
        "must give an Estimate, a list or None, got a Own whose __repr__ raises ZeroDivisionError",
    ),
    (
        "from shefex_nav.records import NavHealth; return [NavHealth(imu.t_valid_s, '\\udcff', True, '')]",
        r"source of its NavHealth must be a text of Unicode, got '\\udcff'",
    ),
    (
        "from shefex_nav.records import NavHealth; return [NavHealth(imu.t_valid_s, 'a', True, 7)]",
        "reason of its NavHealth must be a text, got 7",
    ),
    ("if self.ticks == 50: self.r = 0.0 * self.r", "r_i of its Estimate is the centre of the Earth"),
    (f"{NAV_SOLUTION}(r_i=zeros(3))]", "r_i of its NavSolution is the centre of the Earth"),
    ("if self.ticks == 50: return 7", r"T\+0.50 s: must give an Estimate, a list or None, got 7"),
    ("if self.ticks == 50: return [7]", r"gave int; it may give Estimate, NavSolution"),
    ("if self.ticks == 50: self.r = self.r[:2]", r"r_i of its Estimate must be finite, shape \(3,\)"),
    ("if self.ticks == 50: self.v = self.v * float('nan')", r"v_i of its Estimate must be finite"),
    (
        "if self.ticks == 50: self.v = 0.0 * self.v + 1e15",
        r"v_i of its Estimate must be below 1e\+15, got 1e\+15",
    ),
    ("if self.ticks == 50: self.q = 2.0 * self.q", r"must be a unit quaternion, its norm is 2"),
    (f"{NAV_SOLUTION}(v_e=None)]", "v_e of its NavSolution must be numbers, got None"),
    (f"{NAV_SOLUTION}(sigma_r_e=1.0)]", r"sigma_r_e of its NavSolution must be of shape \(3,\), got 1.0"),
    (f"{NAV_SOLUTION}(t_s=None)]", "t_s of its NavSolution must be numbers, got None"),
    (f"{NAV_SOLUTION}(t_s=nan)]", r"t_s of its NavSolution must be finite, shape \(\), got NaN"),
    (f"{NAV_SOLUTION}(doubt_attitude=9)]", "doubt_attitude of its NavSolution must be one of 0 to 4, got 9"),
    (f"{NAV_SOLUTION}(star_aided=2)]", "star_aided of its NavSolution must be true or false, got 2"),
    (f"{GATE_RESULT}(dof=2.5)]", "dof of its GateResult must be whole, 2147483647 at most, got 2.5"),
    (f"{GATE_RESULT}(dof=2**31)]", "dof of its GateResult must be whole, 2147483647 at most, got 2147483648"),
    (f"{GATE_RESULT}(dof=-1)]", "dof of its GateResult must be 0 to"),
    (f"{GATE_RESULT}(nis=-1.0)]", "nis of its GateResult must be at least 0, got -1"),
    (f"{GATE_RESULT}(sensor=None)]", "sensor of its GateResult must be a text, got None"),
    (f"{GATE_RESULT}(innovation=zeros((2, 2)))]", r"innovation of .* must be of shape \(n,\), got array"),
    (f"{NAV_SOLUTION}(v_i=[nan, 0, 0])]", r"v_i of its NavSolution must be finite, shape \(3,\)"),
    (f"{NAV_SOLUTION}(heading=inf)]", r"heading of its NavSolution must be finite"),
    (
        f"{NAV_SOLUTION}(sigma_r_e=zeros(3) - 1)]",
        r"sigma_r_e of its NavSolution must be none below 0, got",
    ),
    (f"{NAV_SOLUTION}(sigma_r_e=['a', 'b', 'c'])]", r"sigma_r_e of its NavSolution must be numbers, got"),
    (f"{NAV_SOLUTION}(sigma_r_e=['1', '2', '3'])]", r"sigma_r_e of its NavSolution must be numbers, got"),
    (f"{NAV_SOLUTION}(sigma_r_e=[10**400, 0, 0])]", r"sigma_r_e of its NavSolution must be numbers, got"),
    (f"{NAV_SOLUTION}(r_i=['1', '2', '3'])]", r"r_i of its NavSolution must be numbers, got"),
    (f"{NAV_SOLUTION}(protection_attitude=zeros(3))]", r"protection_attitude of .* must be all above 0"),
    (
        f"{NAV_SOLUTION}(sigma_v_e=zeros(3) + 1e200)]",
        r"sigma_v_e of .* must be below 1e\+30, infinite or NaN",
    ),
    (f"{NAV_SOLUTION}(protection_attitude=[[1, 2], [3]])]", r"protection_attitude of .* must be numbers"),
    (f"{NAV_SOLUTION}(sigma_v_e=zeros(3) + 1e-3j)]", r"sigma_v_e of its NavSolution must be numbers, got"),
    (
        "from shefex_nav.records import NavHealth; return [NavHealth(0.49, 'a', True, '')]",
        r"gave a NavHealth of T\+0.490000 s, of another tick",
    ),
)


RECORDS = """import numpy as np; from shefex_nav.onboard.own_navigation import covariance, solution
        from shefex_nav.records import GateResult, NavHealth; t = imu.t_valid_s
        known = Estimate(self.r, self.v, self.q, np.eye(9)); cov = covariance(known, t)
        sol = solution(known, t, np.zeros(3), self.mission.earth)
        gate = GateResult(t, t, "gps_position", 3, 2.0, 9.0, True, "", np.zeros(3))
        return """
ODD = (  # what the reader of a log refuses, and what no log can hold
    ("[cov._replace(P=np.full((9, 9), np.inf))]", r"P of its NavCovariance must be below 1e\+30 or NaN"),
    ("[cov._replace(P=np.diag([np.nan, *[-1.0] * 8]))]", "P of its NavCovariance must be a covariance"),
    ("[cov._replace(P=np.eye(3))]", r"P of its NavCovariance must be of shape \(9, 9\)"),
    ("[cov._replace(P=None)]", "P of its NavCovariance must be numbers, got None"),
    ("[cov._replace(sigma=-np.ones(12))]", "sigma of its NavCovariance must be none below 0"),
    ("[cov, cov]", "gave 2 covariances for one tick"),
    ("[sol._replace(doubt_position=9)]", "doubt_position of its NavSolution must be one of 0 to 4, got 9"),
    ("[sol._replace(star_aided=2)]", "star_aided of its NavSolution must be true or false, got 2"),
    ("[gate._replace(t_s='x')]", "t_s of its GateResult must be numbers, got 'x'"),
    ("[gate._replace(t_valid_s=np.nan)]", "t_valid_s of its GateResult must be finite"),
    ("[gate._replace(nis=np.inf)]", r"nis of its GateResult must be below 1e\+30 or NaN, got inf"),
    ("[gate._replace(dof=2**40)]", "dof of its GateResult must be whole, 2147483647 at most"),
    ("[NavHealth(np.nan, 'gps', True, '')]", "t_s of its NavHealth must be finite"),
)


@pytest.mark.parametrize(("given", "words"), ODD)
def test_a_record_that_no_reader_takes_is_told_in_flight(given, words, tmp_path):
    path = reckoning(tmp_path, RECORDS + given)
    with pytest.raises(SoftwareError, match=rf"T-9.99 s: {words}"):
        flown("tight", STATISTICAL, f"navigation.software={path}:Reckoning", until_s=-9.9)


def test_what_records_may_leave_open_can_be_read_again(tmp_path):
    """Lists for arrays, infinite sigmas, a covariance of nothing, a sum of squares of 1e20."""
    given = (
        "[sol._replace(sigma_r_e=[np.inf] * 3, sigma_theta_b=[1, 1, 1], protection_position=[np.inf, 1]), "
        "cov._replace(P=np.full((9, 9), np.nan)), gate._replace(nis=1e20, limit=np.nan, accepted=0)]"
    )
    path, log = reckoning(tmp_path, RECORDS + given), tmp_path / "own.mcap"
    scenario = load("tight", [STATISTICAL, f"navigation.software={path}:Reckoning"], trust=True)
    runs.fly(scenario, until_s=-9.9, log=log)
    again = runs.open_run(log).data
    assert np.isposinf(again.nav.sigma_r_e).all() and np.isnan(again.covariance.P).all()
    assert again.gates[0].nis == 1e20


def test_an_interrupt_stays_one(tmp_path):
    path = reckoning(tmp_path, "raise KeyboardInterrupt")
    with pytest.raises(KeyboardInterrupt):
        flown("night_sky", f"navigation.software={path}:Reckoning", until_s=1.0)


def test_a_log_that_the_software_deletes_is_told(tmp_path):
    log = tmp_path / "run.mcap"
    path = reckoning(tmp_path, f"if self.ticks == 50: import os; os.remove({str(log)!r})")
    scenario = load("night_sky", [f"navigation.software={path}:Reckoning"], trust=True)
    with pytest.raises(LogError, match=r"run\.mcap: was flown .* deleted the log"):
        runs.fly(scenario, until_s=0.6, log=log)


def test_what_means_a_number_is_one():
    software = OwnSoftware(None, "navigation software")
    objects = np.array([1.0, 2.0, 3], dtype=object)
    others = [Fraction(n) for n in (1, 2, 3)], [*map(Decimal, "123")]
    for given in ([1, 2, 3], [True, 2, 3.0], objects, *others):
        assert software.real(0.0, "it", given).tolist() == [1.0, 2.0, 3.0]
    assert software.real(0.0, "it", [10**20, 0, 0]).tolist() == [1e20, 0.0, 0.0]


@pytest.mark.parametrize(
    "given",
    [
        ["1", "2", "3"], [1, None, 3], [1, "2", 3.5], [1, 2, 10**400], [1, 2, 3j], [[1, 2], [3]], None,
        np.full(3, "2026-01-01", "M8[D]"), [b"1", None, 3], object(), np.array([1j, None], dtype=object),
    ],
)  # fmt: skip
def test_what_means_none_is_told(given):
    with pytest.raises(SoftwareError, match="it must be numbers, got"):
        OwnSoftware(None, "navigation software").real(0.0, "it", given)


@pytest.mark.parametrize(("here", "words"), WRONG)
def test_mistakes_of_the_software_are_told_with_the_mission_time(tmp_path, here, words):
    path = reckoning(tmp_path, here)
    with pytest.raises(SoftwareError, match=r"navigation software own\.py:Reckoning, ") as told:
        flown("night_sky", f"navigation.software={path}:Reckoning", until_s=1.0)
    assert re.search(words, str(told.value)), told.value


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            "self.r, self.v, self.q[[1, 2, 3, 0]]",
            "its first q_ib is the attitude of the alignment with",
        ),
        ("self.r, self.v, self.q * [1, -1, -1, -1]", "the attitude of the alignment the other way round"),
        (
            "self.r, self.v, (self.q * [1, -1, -1, -1])[[1, 2, 3, 0]]",
            "(its conjugate) and with the scalar last",
        ),
        (
            "self.r / 1e3, self.v, self.q",
            "its first r_i is the position of the alignment in kilometres",
        ),
        ("C_ie.T @ self.r, self.v, self.q", "the position of the alignment in Earth-fixed axes"),
    ],
)
def test_what_is_right_in_another_convention_is_told_at_once(tmp_path, given, words):
    axes = "from shefex_nav.geometry import frames; C_ie = frames.dcm_ie(self.mission.earth, imu.t_valid_s)"
    path = reckoning(tmp_path, f"{axes}; return Estimate({given})")
    with pytest.raises(SoftwareError, match=re.escape(words)) as told:
        flown("rexus_like", f"navigation.software={path}:Reckoning", until_s=0.5)
    assert re.search(r"Reckoning, T-\d\.\d\d s: ", str(told.value))


@pytest.mark.parametrize(
    "given",
    [
        "self.r, self.v, (0.5, 0.5, 0.5, 0.5)",
        "self.r, self.v, self.q[[1, 2, 3, 0]], usable=(True, True, False)",
        "self.r / 1e3, self.v, self.q, usable=(False, True, True)",
    ],
)
def test_what_is_nowhere_near_or_not_to_be_used_is_the_softwares_own(tmp_path, given):
    path = reckoning(tmp_path, f"return Estimate({given})")
    assert flown("rexus_like", f"navigation.software={path}:Reckoning", until_s=-9.0)


def test_a_first_solution_in_another_convention_is_told(tmp_path):
    given = (
        "from shefex_nav.onboard.own_navigation import solution; import numpy as np; "
        "e = Estimate(self.r, self.v, self.q[[1, 2, 3, 0]]); "
        "return [solution(e, imu.t_valid_s, np.zeros(3), self.mission.earth)]"
    )
    path = reckoning(tmp_path, given)
    with pytest.raises(
        SoftwareError, match="its first q_ib is the attitude of the alignment with the scalar"
    ):
        flown("rexus_like", f"navigation.software={path}:Reckoning", until_s=-9.0)


INDEFINITE = "import numpy as np; P = np.eye(9); P[0, 4] = P[4, 0] = 2.0; P *= 1e-6"
SINGULAR = "import numpy as np; P = np.eye(9); P[0, 4] = P[4, 0] = 1.0; P *= 1e-6"
GIVES = "; return Estimate(self.r, self.v, self.q, P if self.ticks == 50 else None)"


@pytest.mark.parametrize(
    ("here", "words"),
    [
        (INDEFINITE + GIVES, r"T\+0.50 s: P of its Estimate is not positive definite"),
        (SINGULAR + GIVES, r"T\+0.50 s: P of its Estimate is not positive definite"),
        (
            "import numpy as np; P = np.diag([0.0, *[1.0] * 8])" + GIVES,
            r"T\+0.50 s: P of its Estimate has a variance below 1e-60",
        ),
        (
            "import numpy as np; P = -np.eye(9)" + GIVES,
            r"T\+0.50 s: P of its Estimate has a negative variance",
        ),
        (
            "import numpy as np; P = np.eye(9); P[0, 4] = 0.1" + GIVES,
            r"T\+0.50 s: P of its Estimate is not symmetric",
        ),
        (
            f"{INDEFINITE}; from shefex_nav.records import NavCovariance as N; z = np.zeros(3); "
            "return [N(imu.t_valid_s, P, z, z, z, z, np.ones(12))]",
            r"T\+0.01 s: P of its NavCovariance is not positive definite",
        ),
    ],
)
def test_a_matrix_that_is_no_covariance_is_told_when_it_comes(tmp_path, here, words):
    path = reckoning(tmp_path, here)
    with pytest.raises(SoftwareError, match=words):
        flown("night_sky", f"navigation.software={path}:Reckoning", until_s=0.6)


def test_a_covariance_of_different_units_and_strong_correlations_is_one():
    """Nine states of 1e-6 to 1e6, of which each pair is correlated to 0.999999."""
    correlation = np.full((9, 9), 0.999999) + 1e-6 * np.eye(9)
    sigma = np.logspace(-6, 6, 9)
    assert covariance_fault(correlation * np.outer(sigma, sigma)) == ""
    assert covariance_fault(1e-58 * np.eye(9)) == ""
    assert covariance_fault(1e-62 * np.eye(9)) == "has a variance below 1e-60, 1e-62 at [0, 0]"


def test_what_flies_cannot_change_what_is_logged(tmp_path):
    for here in ("imu.dtheta_b[:] = 7.0", "self.r += 30.0", "self.mission.C_bc[0, 0] = 2.0"):
        path = reckoning(tmp_path, f"{here}  # of this test")
        with pytest.raises(SoftwareError, match="read-only"):
            flown("night_sky", f"navigation.software={path}:Reckoning", until_s=0.1)


def test_what_the_software_says_of_a_picture_is_checked(tmp_path):
    path = reckoning(tmp_path)
    path.write_text(path.read_text() + "\n    def context(self, frame, sky, predicts):\n        return 7\n")
    with pytest.raises(SoftwareError, match="context must give a Context, got 7"):
        flown("night_sky", f"navigation.software={path}:Reckoning", until_s=2.0)


def test_a_module_that_is_not_installed_is_not_imported(tmp_path, monkeypatch):
    (tmp_path / "evil_software.py").write_text("raise SystemExit('it ran')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("evil_software:F", "evil_software.more:F"):
        with pytest.raises(ScenarioError, match=r"name its file, which ends in \.py"):
            load("night_sky", [f"navigation.software={name}"])


def test_late_measurements_are_counted_once(tmp_path):
    """MyFilter on the ground, begun 30 m off; fixes without errors, 0.2 s old, ten a second.

    Each takes away its share of what is left. Counted twice, they would throw it to the other side.
    """
    _, cls = plugins.software(f"{template('filter.py', tmp_path)}:MyFilter", trust=True)
    scenario = prepare.settled(load("night_sky"))
    world = prepare.build_world(scenario, 1, brief=True)
    trajectory, software, left = world.flight.trajectory, cls(), []
    software.start(
        world.alignment._replace(r_i=trajectory.r_i[0] + [30.0, 0.0, 0.0], sigma_r=30.0),
        mission_data(scenario, world.computer, world.earth, {}),
    )

    def fix(k):
        """Of sample k of the truth."""
        r_a = trajectory.r_i[k] + rotation.dcm_from_quat(trajectory.q_ib[k]) @ world.computer.nav.l_ba_b
        t_s = trajectory.t_s[k]
        r_e, v_e = frames.ecef_from_inertial(world.earth, t_s, r_a, trajectory.v_i[k])
        covariances = 15.0**2 * np.eye(3), 1e6 * np.eye(3)
        return world.gps_fixes[0]._replace(
            t_valid_s=t_s, r_ea_e=r_e, v_ea_e=v_e, R_r_e=covariances[0], R_v_e=covariances[1]
        )

    for k, block in zip(range(1, 300), rows(imu.stacked(world.imu)), strict=False):
        estimate, *_ = software.step(block, [fix(4 * (k - 20))] if k >= 20 and k % 10 == 0 else [])
        left.append((estimate.r_i - trajectory.r_i[4 * k])[0])
    assert left[0] > 29.0 and min(left) > -0.5, min(left)
    assert 0.0 < left[-1] < 3.0  # 28 fixes of 15 m each, after 30 m: 30 / (1 + 28 * 4) and what P adds
