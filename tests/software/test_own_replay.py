"""Navigation software of a user's own over external data: it navigates, and is named."""

import sys

import numpy as np
import pytest
from own_flights import reckoning, template

from shefex_nav import plugins, runs
from shefex_nav.errors import SoftwareError
from shefex_nav.geometry import rotation
from shefex_nav.log import reader
from shefex_nav.log.topics import FAILED
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.state import X_BG
from shefex_nav.records import Event
from shefex_nav.replay import external, params, replayed, rerun
from shefex_nav.replay import load as replay_load
from shefex_nav.scenario.load import load
from shefex_nav.templates.filter import MyFilter

EXAMPLE = "csv_example"
SHORT = "mission.end=18 s"
AT_REST = "alignment.heading=356 deg", "alignment.azimuth=5 deg", "alignment.gyro_bias=at_rest"
CHECKS = """
import numpy as np


class Checks:
    def start(self, alignment, mission):
        sheet = mission.sheets["imu"]
        assert np.isclose(sheet.gyro.scale_factor, 100e-6) and sheet.accelerometer.bias > 0.0
        assert np.allclose(mission.l_ba_b, [0.6, 0.05, -0.03])
        assert mission.settings == {"gain": 0.2} and "csv_example" in mission.scenario
        assert mission.start_s == alignment.t_valid_s == 12.0
        self.fixes = 0

    def step(self, imu, arrived):
        assert imu.dtheta_b.shape == imu.dv_b.shape == (4, 3)
        self.fixes += len(arrived)
        if imu.t_valid_s > 17.99:
            raise RuntimeError(f"{self.fixes} fixes")
"""


def loaded(*overrides):
    """ReplayScenario of the shipped example, and its files."""
    return replay_load.load(EXAMPLE, [SHORT, *overrides])


def flown(scenario, files):
    """Records of a replay."""
    return list(external.run(external.prepare(scenario, files), external.Clock()))


def solutions(records):
    """Those of the records."""
    return [one for one in records if type(one).__name__ == "NavSolution"]


@pytest.fixture
def dead_reckoning(tmp_path):
    """Override that names a class in a file."""
    return f"navigation.software={reckoning(tmp_path)}:Reckoning"


def trusted(override):
    """ReplayScenario and files with consent to run what it names."""
    with plugins.trusting():
        return loaded(override)


def test_it_navigates_in_place_of_the_filter(dead_reckoning):
    scenario, files = trusted(dead_reckoning)
    mine = solutions(flown(scenario, files))
    ready = external.prepare(scenario, files)
    assert len(mine) == len(ready.blocks.t_valid_s) == 300
    assert all(np.array_equal(one.r_i, ready.alignment.r_i) for one in mine)  # it stays where it is
    turned = np.concatenate(ready.blocks.dtheta_b).sum(axis=0)
    assert not np.array_equal(mine[-1].q_ib, ready.alignment.q_ib) and np.abs(turned).max() > 1e-4
    assert np.isnan(mine[-1].sigma_theta_b).all()


def test_it_is_told_of_its_sensors(tmp_path):
    (tmp_path / "checks.py").write_text(CHECKS)
    own = f"{{python: {tmp_path / 'checks.py'}:Checks, settings: {{gain: 0.2}}}}"
    scenario, files = trusted(f"navigation.software={own}")
    with pytest.raises(SoftwareError, match=r"(?s)T\+18.00 s.*5 fixes"):
        flown(scenario, files)


def test_log_and_table_name_it_and_it_runs_again_over_the_log(dead_reckoning, tmp_path):
    scenario, files = trusted(dead_reckoning)
    log = tmp_path / "own.mcap"
    replayed.of_data(scenario, files, -np.inf, log)
    data = reader.read(log)
    (section, name, sha256), *more = data.mission.software
    assert (section, name, more) == ("navigation", "own.py:Reckoning", [])
    again = solutions(rerun.run(log))
    assert np.array_equal([one.q_ib for one in again], data.nav.q_ib) and sha256
    with_filter = solutions(rerun.run(log, ["navigation.software=built_in"]))
    assert np.array_equal(with_filter[-1].r_i, solutions(flown(*loaded()))[-1].r_i)


def test_a_program_is_the_same(dead_reckoning, tmp_path):
    scenario, files = trusted(dead_reckoning)
    program = tmp_path / "program.py"
    program.write_text(
        "from own import Reckoning\nfrom shefex_nav.software import serve\n\nserve(Reckoning())\n"
    )
    told = trusted(f"navigation.software={{command: {sys.executable} {program}}}")
    ours, theirs = solutions(flown(scenario, files)), solutions(flown(*told))
    assert np.array_equal([one.q_ib for one in ours], [one.q_ib for one in theirs])


def test_the_template_is_as_good_as_the_filter(tmp_path):
    mine = trusted(f"navigation.software={template('filter.py', tmp_path)}:MyFilter")
    ours, theirs = solutions(flown(*loaded())), solutions(flown(*mine))
    apart = [np.linalg.norm(a.r_i - b.r_i) for a, b in zip(ours, theirs, strict=True)]
    assert 0.0 < max(apart) < 5.0


def test_a_failed_flight_is_replayed_without_its_failure(tmp_path):
    path, log = reckoning(tmp_path, "if self.ticks == 150: 1 / 0"), tmp_path / "run.mcap"
    scenario = load("night_sky", [f"navigation.software={path}:Reckoning"], trust=True)
    with pytest.raises(SoftwareError):
        runs.fly(scenario, until_s=3.0, log=log)
    assert "ZeroDivisionError" in reader.read(log).failure
    again = list(rerun.run(log, ["navigation.software=built_in"]))
    assert len(solutions(again)) > 140
    assert not [one for one in again if isinstance(one, Event) and one.name == FAILED]


def test_the_template_begins_as_sure_as_the_filter():
    """Ties of position and velocity, of attitude and biases, and a bias that was found, in inertial axes."""
    for at_rest in ((), AT_REST):
        scenario, files = loaded(*at_rest)
        ready = external.prepare(scenario, files)
        nav = fusion.start(params.nav_params(scenario, 0.0025), ready.alignment, ready.earth)
        mine = MyFilter()
        mine.start(ready.alignment, params.mission_data(scenario, ready.alignment, ready.earth, {}))
        turn = np.eye(15)
        turn[6:9, 6:9] = rotation.dcm_from_quat(ready.alignment.q_ib)
        expected = turn @ nav.history.P[:15, :15] @ turn.T
        sizes = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
        assert np.allclose(mine.P / sizes, expected / sizes, atol=1e-9)
        assert np.array_equal(mine.gyro_bias, nav.history.x[X_BG : X_BG + 3])
