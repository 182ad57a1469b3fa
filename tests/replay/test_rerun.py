"""The filter again over a log: the same with the same configuration, refused where data are missing."""

import numpy as np
import pytest
from better_field import more_in_field
from flown_log import Options, write
from navigation_flight import fly
from unpacked import integrate, propagate, window

from shefex_nav.commands.replay import replay
from shefex_nav.environment import gravity
from shefex_nav.geometry import frames
from shefex_nav.log import reader
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.topics import LogError
from shefex_nav.records import GateResult, NavSolution, TruthSample, row
from shefex_nav.replay import rerun
from shefex_nav.report import metrics
from shefex_nav.scenario.load import ScenarioError


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return write(tmp_path_factory.mktemp("flown") / "run.mcap")


def again(log, overrides=()):
    """RunData of a rerun."""
    recording = rerun.open_log(log, overrides)
    builder = RunDataBuilder(recording.data.mission)
    for record in rerun.records(recording):
        builder.add(record)
    return builder.build()


def same(one, two):
    """Whether two records of arrays are the same to the last bit, NaN included."""
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(one, two, strict=True))


def test_the_same_configuration_gives_the_logged_solution(log):
    flown, rerun_ = reader.read(log), again(log)
    assert len(flown.nav.t_s) == 3000 and flown.nav.star_aided[-1]
    assert same(flown.nav, rerun_.nav)
    assert same(flown.covariance, rerun_.covariance)
    assert same(flown.truth, rerun_.truth) and same(flown.imu, rerun_.imu)
    assert len(flown.gates) == len(rerun_.gates) > 100
    for a, b in zip(flown.gates, rerun_.gates, strict=True):
        assert a[:4] == b[:4] and a.accepted == b.accepted and a.note == b.note
        assert np.array_equal(a.innovation, b.innovation)
    assert metrics.summarise(rerun_._replace(summary=flown.summary)) == metrics.summarise(flown)


def test_another_configuration_gives_what_would_have_been(log, tmp_path):
    """A flight with that configuration and the same fixes is the reference."""
    change = "navigation.star_fix_floor=60 arcsec"
    expected = reader.read(write(tmp_path / "other.mcap", Options(overrides=(change,))))
    changed = again(log, [change])
    assert same(changed.nav, expected.nav)
    assert not np.array_equal(changed.nav.q_ib, reader.read(log).nav.q_ib)


def test_tight_instead_of_loose_coupling(log, tmp_path):
    """The log has both, fixes and ranges."""
    changes = ("navigation.gps=tight", "navigation.states=[gyro_roll_column, mounting, clock]")
    expected = reader.read(write(tmp_path / "tight.mcap", Options(overrides=changes)))
    used = [gate for gate in expected.gates if gate.sensor == "gps_range" and gate.accepted]
    assert len(used) == 29 and all(gate.dof == 8 for gate in used)
    changed = again(log, changes)
    assert same(changed.nav, expected.nav)
    assert same(changed.covariance, expected.covariance)


def test_stars_by_themselves_instead_of_attitudes(log, tmp_path):
    """The log holds the stars of every frame; a flight that uses them is the reference."""
    change = ("navigation.stars=vectors",)
    path = write(tmp_path / "vectors.mcap", Options(overrides=change))
    expected = reader.read(path)
    used = [gate for gate in expected.gates if gate.sensor == "star_vectors" and gate.accepted]
    assert {gate.dof for gate in used} >= {2, 16}  # frames without attitude, too
    assert len(used) > 50
    for repeated in (again(log, change), again(path)):
        assert same(repeated.nav, expected.nav) and same(repeated.covariance, expected.covariance)
    before = again(path, ["navigation.stars=attitude"])
    assert same(before.nav, reader.read(log).nav)
    flown = reader.read(log).star_fixes
    for one, two in zip(expected.star_fixes, flown, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one.stars, two.stars, strict=True))


def test_a_log_without_single_stars_cannot_be_run_with_them(tmp_path):
    path = write(tmp_path / "older.mcap", Options(vectors=False))
    with pytest.raises(LogError, match=r"older.mcap: cannot be run again with navigation.stars=vectors: its"):
        rerun.open_log(path, ["navigation.stars=vectors"])
    assert rerun.open_log(path).params.stars == "attitude"


def test_a_better_field_of_the_earth_reaches_the_integration(log):
    """One tick with J2 and increments that hold the rest, against the strapdown under the field itself."""
    recording = rerun.open_log(log)
    field = gravity.load("egm96", 12)
    blocks, states = fly(0.1)
    state, earth = states[5], recording.data.mission.earth
    more_dv = more_in_field(field, earth, state, blocks[5].dt_s, blocks[5].dtheta_b)
    felt = blocks[5]._replace(dv_b=blocks[5].dv_b + more_dv)
    C_ie = frames.dcm_ie(earth, state.t_s + 0.005)
    g_i = C_ie @ gravity.gravity_e(field, C_ie.T @ (state.r_i + 0.005 * state.v_i))
    before = window(blocks[4])
    r_i, v_i, *_ = integrate(state, window(blocks[5], before), 0.0, 0.01, g_i)
    without = propagate(state, window(blocks[5], before), 0.0, 0.01, earth)
    found = propagate(state, window(felt, before), 0.0, 0.01, earth)
    missing = np.linalg.norm(v_i - without[1])
    assert missing > 1e-7  # m/s in a tick: 1e-5 m/s^2 at least
    assert np.linalg.norm(v_i - found[1]) < 1e-3 * missing
    rounding = 4.0 * np.spacing(np.linalg.norm(r_i))  # 4e-9 m; without the rest of the field it is 3e-8 m
    assert np.linalg.norm(r_i - found[0]) < rounding < 0.2 * np.linalg.norm(r_i - without[0])


def test_records_come_in_order(log):
    records = list(rerun.run(log))
    kinds = [type(record) for record in records if type(record) in (TruthSample, NavSolution)]
    assert kinds == [TruthSample, NavSolution] * 3000
    times = [record.t_s for record in records if type(record) in (TruthSample, GateResult)]
    assert np.all(np.diff(times) >= 0.0)


def test_only_the_navigation_can_be_changed(log):
    with pytest.raises(ScenarioError, match=r"^--set gps\.rate: the flight of a log is over"):
        rerun.open_log(log, ["gps.rate=2 Hz"])
    with pytest.raises(ScenarioError, match=r"^--set navigation\.histori: unknown key"):
        rerun.open_log(log, ["navigation.histori=1 s"])


def test_a_thinned_log_is_refused(tmp_path):
    path = write(tmp_path / "thin.mcap", Options(rate_hz=20.0))
    with pytest.raises(LogError, match=r"20 IMU blocks a second of the 100 .* log\.rate='100 Hz'"):
        rerun.open_log(path)


def test_a_log_without_imu_is_refused(log, tmp_path):
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.writer import LogWriter

    data = reader.read(log)
    for name, records, message in (
        ("empty", [data.alignment], "no IMU samples"),
        ("lost", [data.gps[0]], "no alignment"),
        (
            "gap",
            [data.alignment, *(row(data.imu, k) for k in (*range(9), 12))],
            r"T\+0\.09 s to T\+0\.13",
        ),
    ):
        path = tmp_path / f"{name}.mcap"
        with LogWriter(path, data.mission, FramePolicy(0, "none", 4.0)) as writer:
            for record in records:
                writer.write(record)
        with pytest.raises(LogError, match=message):
            rerun.open_log(path)


def test_a_log_that_was_cut_off_is_run_to_its_end(log, tmp_path):
    """The writer was killed: what is left is run again and agrees."""
    path = tmp_path / "cut.mcap"
    path.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    cut, rerun_ = reader.read(path), again(path)
    n = min(len(cut.nav.t_s), len(rerun_.nav.t_s))
    assert cut.ended_early and 500 < n < 2900
    assert abs(len(cut.imu.t_valid_s) - len(rerun_.nav.t_s)) == 0
    assert np.array_equal(cut.nav.q_ib[:n], rerun_.nav.q_ib[:n])
    assert np.array_equal(cut.nav.r_i[:n], rerun_.nav.r_i[:n])


def test_a_log_made_of_one_that_was_cut_off_says_where(log, tmp_path):
    path, whole, part = (tmp_path / f"{name}.mcap" for name in ("cut", "whole", "part"))
    path.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    replay(log, log=whole)
    replay(path, log=part)
    assert reader.read(whole).until_s is None
    made = reader.read(part)
    assert not made.ended_early
    assert made.until_s == reader.read(path).last_t_s == pytest.approx(made.last_t_s, abs=0.02)


def test_a_log_is_judged_by_another_limit_of_the_attitude(log):
    """The limit belongs to the requirements; the computer on board that is run again takes it."""
    found = rerun.open_log(log, ["requirements.attitude.limit=0.4 deg"])
    assert found.params.integrity.wanted.limits[2] == pytest.approx(np.radians(0.4))
    with pytest.raises(ScenarioError, match=r"'navigation\.' or 'requirements\.position\.'"):
        rerun.open_log(log, ["requirements.apogee=1 km"])
