"""`shefex-nav budget`: what an error of the world does to the errors of a filter.

Software that turns with the gyros and does nothing else has an attitude error of which each part is known:
a bias is its rate times the time, whatever else there is.
"""

import json

import numpy as np
import plugin_tables
import pytest
from short_campaign import HereLane

from shefex_nav import plugins, prepare
from shefex_nav.campaign import budget, draws
from shefex_nav.campaign.budget import BudgetError
from shefex_nav.campaign.compare import flying
from shefex_nav.records import Reason
from shefex_nav.scenario import load
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.of_settings import settings
from shefex_nav.world import absent, imu, noise

TURNING = """
import numpy as np

from shefex_nav.geometry import rotation
from shefex_nav.software import Estimate

P = np.eye(9)


class Turning:
    def start(self, alignment, mission):
        self.r, self.v, self.q = alignment.r_i, alignment.v_i, alignment.q_ib

    def step(self, imu, arrived):
        turn = rotation.quat_from_rotvec(imu.dtheta_b.sum(axis=0))
        self.q = rotation.quat_normalise(rotation.quat_multiply(self.q, turn))
        return Estimate(self.r, self.v, self.q, P=P)
"""
SHORT = """extends: night_sky
mission: {name: short, time_limit: 2 s}
star_tracker: {enabled: false, off: 2 s}
campaign: {series: 10 Hz}
imu: {gyro: {bias: 100 deg/h}}
"""
RUNS, SEED = 8, 3


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Consent and tables as before; runs fly in this process."""
    (tmp_path / "config").mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    with plugin_tables.restored():
        yield


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(SHORT)
    return path


def turning(folder):
    (folder / "turning.py").write_text(TURNING)
    return f"{folder / 'turning.py'}:Turning"


# ---- the figures -----------------------------------------------------------------------------------------


def test_shares_of_known_parts():
    """Independent parts of 3, 4 and 12: 9, 16 and 144 of 169; intervals hold them 19 times of 20."""
    rng, trials, sizes = np.random.default_rng(8), 400, (3.0, 4.0, 12.0)
    held = np.zeros(3)
    for _ in range(trials):
        each = [size * rng.standard_normal((30, 3)) for size in sizes]
        found = [budget.contribution(sum(each), part) for part in each]
        true = np.array(sizes) ** 2 / 169.0
        held += [one.low <= share <= one.high for one, share in zip(found, true, strict=True)]
        assert found[2].rms == pytest.approx(np.sqrt(3.0) * 12.0, rel=0.35)
    assert np.all(held / trials > 0.90) and held.sum() / (3 * trials) < 0.99


def test_one_pair_has_no_interval():
    found = budget.contribution(np.ones((1, 3)), 0.5 * np.ones((1, 3)))
    assert (found.n, found.share, found.low, found.high) == (1, 0.25, None, None)
    assert found.rms_without == pytest.approx(0.5 * np.sqrt(3.0))


def test_flights_without_an_entry_are_told(monkeypatch):
    """Of survivors nothing is said without saying so: one of three flights never came to entry."""
    errors = dict.fromkeys(budget.QUANTITIES, np.ones(3))
    both, end = {budget.ENTRY: errors, budget.END: errors}, {budget.END: errors}
    flights = {"whole": {1: both, 2: both, 3: end}, "all": dict.fromkeys((1, 2, 3), both)}
    monkeypatch.setattr(budget, "errors_of", flights.get)
    monkeypatch.setattr(budget, "mostly_refused", lambda flight: ())
    found = budget.budget("whole", {"gyro_bias": "all"})
    assert list(found.whole) == [budget.END]
    assert found.notes == ("At entry nothing is told: 1 of 3 whole flights came to none",)
    (note,) = budget.budget("all", {"gyro_bias": "whole"}).notes
    assert note.startswith("without gyro_bias: 1 of 3 came to no entry")
    assert budget.budget("all", {"gyro_bias": "all"}).notes == ()


# ---- the world without an error --------------------------------------------------------------------------


def world(path, *names, more=()):
    scenario = load.load(path, (f"without=[{', '.join(names)}]", *more))
    return prepare.build_world(scenario, 4, brief=True)


def test_a_gyro_without_its_bias_draws_all_else_alike(path):
    whole, less = world(path), world(path, "gyro_bias")
    dt_s = whole.imu.t_s[1] - whole.imu.t_s[0]
    turned = (whole.imu.dtheta_b - less.imu.dtheta_b)[1:].sum(axis=0)
    drawn = imu.draw_errors(settings(load.load(path).imu), noise.generator(4, "imu")).gyro_bias
    quantum = load.load(path).imu.gyro.quantum
    assert np.abs(turned - drawn * dt_s * (len(whole.imu.t_s) - 1)).max() <= quantum
    assert np.array_equal(whole.imu.dv_b, less.imu.dv_b)
    assert np.array_equal(whole.gps_fixes[0].r_ea_e, less.gps_fixes[0].r_ea_e)
    assert repr(whole.computer.nav) == repr(less.computer.nav)  # told as before


def test_a_fix_without_noise_is_true_and_reports_its_covariance(path):
    whole, less = world(path), world(path, "gps_noise")
    one, other = (next(fix for fix in each.gps_fixes if fix.valid) for each in (whole, less))
    assert np.array_equal(one.R_r_e, other.R_r_e) and np.array_equal(one.R_v_e, other.R_v_e)
    assert np.linalg.norm(one.r_ea_e - other.r_ea_e) > 0.05
    assert np.linalg.norm(other.v_ea_e) < 1e-9  # the antenna stands on the Earth


def test_an_alignment_without_one_error_keeps_the_others(path):
    truth = world(path, absent.LEVEL, absent.AZIMUTH, absent.PLACE)
    whole = world(path)
    assert np.allclose(truth.alignment.r_i, truth.flight.trajectory.r_i[0], rtol=0.0, atol=1e-8)
    assert abs(truth.alignment.q_ib @ truth.flight.trajectory.q_ib[0]) == pytest.approx(1.0, abs=1e-14)
    level = world(path, absent.LEVEL)
    assert np.allclose(level.alignment.P_theta_b, whole.alignment.P_theta_b, rtol=0.1)
    assert np.array_equal(level.alignment.r_i, whole.alignment.r_i)
    assert not np.array_equal(level.alignment.q_ib, whole.alignment.q_ib)


def test_a_unit_without_vibration_still_rectifies_it(path):
    """And without the rectification the noise is still there."""
    more = ("imu.vibration.coast=2 gee", "imu.accelerometer.vibration_rectification=1 mgee/gee2")
    whole, calm = world(path, more=more), world(path, "vibration", more=more)
    assert whole.imu.dv_b.std(axis=0).min() > 20.0 * calm.imu.dv_b[1:].std(axis=0).max()
    straight = world(path, "vibration", "accelerometer_vibration_rectification", more=more)
    dt_s = whole.imu.t_s[1] - whole.imu.t_s[0]
    bent = (calm.imu.dv_b - straight.imu.dv_b)[1:].sum(axis=0) / (dt_s * (len(whole.imu.t_s) - 1))
    assert 1e-3 < np.abs(bent).max() < 0.2  # m/s^2: 1 mgee/gee2 at 2 gee, one standard deviation 0.04


def test_star_fixes_without_noise_report_the_same(tmp_path):
    """Of statistics: nearer to the truth by far, but for the mounting, which is not theirs."""
    from shefex_nav import simulate

    ends = ("star_tracker.frames=statistical", "mission.time_limit=3 s", "star_tracker.off=3 s",
            "star_camera.optics.zero_magnitude_flux=2.5e6 electron/s")  # fmt: skip
    found = []
    for names in ("", "star_noise"):
        scenario = load.load("night_sky", (*ends, f"without=[{names}]"))
        records = [one for one in simulate.run(scenario, 2) if type(one).__name__ == "StarFix"]
        found.append([one for one in records if one.reason == Reason.NONE])
    whole, less = found
    assert len(whole) == len(less) > 5
    scatter = [
        np.std([one.q_ic @ np.roll(each[0].q_ic, 1) for one in each]) for each in found
    ]  # of an element: the Earth turns both alike
    assert np.allclose(whole[0].P_c, less[0].P_c, rtol=0.05) and scatter[0] != scatter[1]
    differ = [1.0 - abs(a.q_ic @ b.q_ic) for a, b in zip(whole, less, strict=True)]
    assert 0.0 < max(differ) < 1e-6


# ---- the command -----------------------------------------------------------------------------------------


def test_what_a_bias_does_to_software_that_turns_with_the_gyros(path, tmp_path, monkeypatch, command):
    """The bias times the time, seed by seed; the alignment explains the rest."""
    words = ("budget", path, "--software", turning(tmp_path), "--runs", RUNS, "--seed", SEED, "--trust")
    words += "--out", tmp_path / "out"
    for name in ("gyro_bias", "alignment_level", "alignment_azimuth", "gps_noise"):
        words += ("--source", name)
    done = command(*words, "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    scenario = load.load(path)
    duration_s = scenario.mission.time_limit - scenario.mission.start
    drawn = [
        imu.draw_errors(
            settings(scenario.imu), noise.generator(draws.sensor_seed(SEED, run), "imu")
        ).gyro_bias
        for run in range(RUNS)
    ]
    expected = np.degrees(duration_s * np.sqrt(np.mean(np.sum(np.array(drawn) ** 2, axis=1))))
    bias = found["sources"]["gyro_bias"]["end"]["attitude"]
    assert bias["rms"] == pytest.approx(expected, rel=2e-3) and bias["n"] == RUNS
    assert found["sources"]["gps_noise"]["end"]["attitude"]["share"] == 0.0
    rest = found["not_explained"]["end"]["attitude"]
    assert rest["rms"] < 0.05 * found["whole_rms"]["end"]["attitude"]
    assert found["whole_rms"]["end"]["position"] > 100.0  # it stands in inertial axes
    assert found["not_explained"]["end"]["position"]["share"] == pytest.approx(1.0, abs=0.01)

    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", None)  # all has flown
    table = command(*words)
    assert table.code == 0, table.err
    lines = [line.split() for line in table.out.splitlines()]
    assert [line[:2] for line in lines if line[:1] == ["gyro"]] == [["gyro", "bias"]]
    assert "not explained" in table.out and "At the end" in table.out


def test_only_errors_that_are_there_are_looked_at(path):
    how = flying.How(str(path), ("imu.gyro.bias=0 deg/h", "earth.gravity=j2"), 2, 1, None, None)
    _, flights = budget.planned(how, None)
    assert "gyro_bias" not in flights and "gravity" not in flights and "star_noise" not in flights
    assert {"gyro_random_walk", "alignment_level", "gps_noise", "vibration"} <= set(flights)
    with pytest.raises(BudgetError, match=r"--source gyro_bias: is zero in this scenario; it has: gyro_"):
        budget.planned(how, None, ("gyro_bias",))
    with pytest.raises(BudgetError, match=r"--source wind: is no source; expected one of: gyro_bias, "):
        budget.planned(how, None, ("wind",))


def test_every_source_of_a_whole_mission_is_another_scenario():
    how = flying.How("shefex2_andoya", (), 2, 1, None, None)
    whole, flights = budget.planned(how, None)
    texts = {one.scenario.source for one in flights.values()}
    assert (
        set(flights) == set(budget.NAMES) - {"gps_lasting"}
        and len(texts | {whole.scenario.source}) == len(flights) + 1
    )


def test_noise_of_pictures_cannot_be_left_out():
    with pytest.raises(ScenarioError, match=r"is in the pixels of a picture; fly with star_tracker\.frames"):
        load.load("night_sky", ("without=[star_noise]",))
    with pytest.raises(ScenarioError, match="gyro_bias is there twice; keep one of them"):
        load.load("night_sky", ("without=[gyro_bias, gps_noise, gyro_bias]",))


def test_check_says_what_does_not_happen(path, command):
    done = command("check", path, "--set", "without=[gyro_bias, gps_noise]")
    words = "without: gyro_bias, gps_noise: the computer counts with them, the truth is none"
    assert done.code == 0 and words in done.out + done.err


def test_what_is_no_software(path, command):
    done = command("budget", path, "--software", "night_sky")
    assert done.code == 2 and "is no software; expected FILE.py:CLASS" in done.err


def test_software_without_a_covariance_has_a_budget_too(path, tmp_path, command):
    own, found = turning(tmp_path), []
    for text in (TURNING, TURNING.replace(", P=P", "")):
        (tmp_path / "turning.py").write_text(text)
        words = "--software", own, "--runs", 2, "--source", "gyro_bias", "--trust", "--json"
        done = command("budget", path, *words, "--out", tmp_path / "out")
        assert done.code == 0, done.err
        found.append(json.loads(done.out)["sources"])
    assert found[0] == found[1] and found[0]["gyro_bias"]["end"]["attitude"]["rms"] > 0.0


def test_flights_that_all_fail_say_so(path, tmp_path, command):
    own = turning(tmp_path)
    (tmp_path / "turning.py").write_text(TURNING.replace("return Estimate", "raise ValueError; Estimate"))
    words = "--software", own, "--runs", 1, "--source", "gyro_bias", "--trust"
    done = command("budget", path, *words, "--out", tmp_path / "out")
    assert done.code == 2 and "no run of it has errors over time" in done.err


def test_a_row_says_share_interval_and_what_is_left():
    one = budget.Given(8, 0.5, 0.25, 0.0004, 0.5, 0.9)
    assert list(budget._cells({"position": one})) == ["0.5", "25 % (0 to 50)", "0.9"]


RECORDS = "from shefex_nav.records import GateResult\n"
JUDGING = TURNING.replace("import numpy as np\n", f"import numpy as np\n\n{RECORDS}")
JUDGING = JUDGING.replace(
    "        return Estimate(self.r, self.v, self.q, P=P)",
    """        said = [Estimate(self.r, self.v, self.q, P=P)]
        for fix in (one for one in arrived if type(one).__name__ == "GpsFix"):
            self.met = getattr(self, "met", 0) + 1
            for sensor, used in (("gps_position", self.met % 4 == 0), ("gps_velocity", self.met % 4 != 0)):
                at_s = imu.t_valid_s
                said.append(GateResult(at_s, fix.t_valid_s, sensor, 3, 3.0, 9.0, used, "", np.zeros(3)))
        return said""",
)


def test_a_filter_that_refuses_most_of_a_sensor_is_told(path, tmp_path, command):
    """Of the position three fixes of four, of the velocity one of four."""
    own = turning(tmp_path)
    (tmp_path / "turning.py").write_text(JUDGING)
    words = ("budget", path, "--software", own, "--runs", 2, "--source", "gyro_bias", "--trust")
    words += "--set", "gps.rate=10 Hz", "--out", tmp_path / "out"
    done = command(*words, "--json")
    assert done.code == 0, done.err
    refused = json.loads(done.out)["mostly_refused"]
    assert set(refused) == {"gps_position"} and 0.7 < refused["gps_position"] < 0.85
    text = " ".join(command(*words).out.split())
    share = f"{100.0 * refused['gps_position']:.0f} %"
    assert f"GPS position: the filter refused {share} of them." in text
    assert "GPS velocity: the filter refused" not in text


def test_of_a_filter_that_uses_its_fixes_nothing_is_said_of_them(path, tmp_path, command):
    words = ("budget", path, "--runs", 1, "--source", "gyro_bias", "--out", tmp_path / "out", "--json")
    done = command(*words)
    assert done.code == 0 and json.loads(done.out)["mostly_refused"] == {}
