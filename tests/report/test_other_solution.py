"""What another filter says of a flight: as a Run, in its log, as a table, in the viewer, compared."""

import csv
import importlib.util
import json
import sys

import numpy as np
import pyarrow as pa
import pytest
from recorded import chunks

import shefex_nav
from shefex_nav import runs
from shefex_nav.geometry import frames, rotation
from shefex_nav.log import other_solutions
from shefex_nav.log.topics import LogError
from shefex_nav.report import error_figures, viewer

BRIEF = {"mission.time_limit": "4 s", "star_tracker.off": "4 s"}
OFF_I = np.array([3.0, -4.0, 12.0])  # m, of which the size is 13 m


@pytest.fixture(scope="module")
def sky(default_scenario, tmp_path_factory):
    """Four seconds under the night sky, with a log."""
    scenario = shefex_nav.Scenario.load(default_scenario.with_name("night_sky.yaml"), BRIEF)
    return shefex_nav.fly(scenario, seed=3, log=tmp_path_factory.mktemp("sky") / "sky.mcap")


def _correlated(P, rho):
    """Covariances of which the third has a correlation of position and velocity."""
    P = P.copy()
    P[2, 0, 3] = P[2, 3, 0] = rho * np.sqrt(P[2, 0, 0] * P[2, 3, 3])
    return P


def covariances(n):
    """(n, 9, 9) diagonal: 2 m, 0.1 m/s, 1 mrad."""
    return np.tile(np.diag(np.repeat([2.0, 0.1, 1e-3], 3) ** 2), (n, 1, 1))


@pytest.fixture(scope="module")
def mine(sky):
    """Truth with a known error of the position, and sigmas."""
    truth = sky.truth
    args = truth.t_s, truth.r_i - OFF_I, truth.v_i, truth.q_ib
    return sky.with_solution(*args, covariances(len(truth.t_s)), name="mine")


def test_its_errors_and_its_nees_are_those_of_the_definition(sky, mine):
    errors = mine.errors()
    assert np.allclose(errors.position_i, OFF_I, atol=1e-8) and np.abs(errors.velocity_i).max() < 1e-12
    assert np.abs(errors.attitude_b).max() < 1e-12 and len(errors.t_s) == len(sky.truth.t_s)
    assert np.allclose(errors.sigma_position_i, 2.0) and np.allclose(errors.sigma_attitude_b, 1e-3)
    summary = mine.summary()["navigation"]
    assert summary["position_error_m"]["rms"] == pytest.approx(13.0)
    assert summary["nees"]["mean"] == pytest.approx(13.0**2 / 2.0**2) and summary["nees"]["samples"] >= 3
    assert summary["integrity"] is None and not mine.data.gates
    assert mine.plot.position() is not None and mine.plot.nees() is not None and ", mine, " in repr(mine)
    with pytest.raises(LookupError, match="nothing to draw for 'nis'"):
        mine.plot.nis()
    assert sky.errors().position_i.shape == errors.position_i.shape  # which stays as it was
    assert not np.allclose(sky.errors().position_i, errors.position_i)


def test_earth_fixed_axes_give_the_same(sky, mine):
    """Position, velocity, attitude and a covariance with correlations, in the axes of the Earth."""
    earth, truth, rng = sky.data.mission.earth, sky.truth, np.random.default_rng(8)
    turned = [
        frames.ecef_from_inertial(earth, *one) for one in zip(truth.t_s, truth.r_i, truth.v_i, strict=True)
    ]
    r_e, v_e = (np.array(one) for one in zip(*turned, strict=True))
    C_ei = np.array([frames.dcm_ie(earth, t_s).T for t_s in truth.t_s])
    q_eb = np.array(
        [rotation.quat_multiply(rotation.quat_from_dcm(C), q) for C, q in zip(C_ei, truth.q_ib, strict=True)]
    )
    A = rng.standard_normal((9, 9)) * np.repeat([2.0, 0.1, 1e-3], 3)[:, None]
    P_e = np.tile(A @ A.T, (len(truth.t_s), 1, 1))
    found = sky.with_solution(truth.t_s, r_e, v_e, q_eb, P_e, frame="e", name="mine")
    errors = found.errors()
    assert np.abs(errors.position_i).max() < 1e-6 and np.abs(errors.velocity_i).max() < 1e-9
    assert np.abs(errors.attitude_b).max() < 1e-9
    drawn, k = (A @ rng.standard_normal((9, 20000))).T, 10  # errors in Earth-fixed axes, moved one by one
    t_s = float(found.data.covariance.t_s[k])
    j = int(np.argmin(np.abs(truth.t_s - t_s)))
    r_i, v_i = frames.inertial_from_ecef(earth, t_s, r_e[j], v_e[j])
    moved = [frames.inertial_from_ecef(earth, t_s, r_e[j] + d[:3], v_e[j] + d[3:6]) for d in drawn]
    sample = np.hstack(
        [np.array([r - r_i for r, _ in moved]), np.array([v - v_i for _, v in moved]), drawn[:, 6:]]
    )
    scale = np.sqrt(np.diag(found.data.covariance.P[k]))
    difference = (np.cov(sample.T) - found.data.covariance.P[k]) / np.outer(scale, scale)
    assert np.abs(difference).max() < 0.05  # 20000 draws: 0.01, one sigma


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t_s": lambda t: t + 0.0005}, "none of the times, T.* is one of the log's"),
        ({"t_s": lambda t: t[::-1]}, "t_s: expected increasing times"),
        ({"r": lambda r: r[:, :2]}, r"r: shape \(\d+, 2\); expected \(\d+, 3\)"),
        ({"q": lambda q: 2.0 * q}, r"q: norm 2 at T.*; expected unit quaternions"),
        (
            {"v": lambda v: np.where(np.arange(len(v))[:, None] == 7, np.nan, v)},
            r"v: NaN or a number beyond 1e\+15 at T\+0\.08",
        ),
        ({"P": lambda P: -P}, r"P: no covariance at T\+0\.01 s, it has a negative variance"),
        (
            {"P": lambda P: _correlated(P, 2.0)},
            r"P: no covariance at T\+0\.03 s, it is not positive definite; expected",
        ),
        (
            {"P": lambda P: _correlated(P, 1.0)},
            r"P: no covariance at T\+0\.03 s, it is not positive definite",
        ),
        ({"name": lambda _: "My Filter"}, "name 'My Filter': expected lower-case letters"),
        ({"frame": lambda _: "n"}, "frame 'n': expected 'i'"),
    ],
)
def test_what_is_no_solution_is_told(sky, change, words):
    truth = sky.truth
    given = {"t_s": truth.t_s, "r": truth.r_i, "v": truth.v_i, "q": truth.q_ib}
    given |= {"P": covariances(len(truth.t_s)), "frame": "i", "name": "mine"}
    given |= {key: of(given[key]) for key, of in change.items()}
    with pytest.raises(ValueError, match=words):
        sky.with_solution(**given)


def test_it_is_written_into_a_copy_of_the_log_and_read_again(sky, mine, tmp_path):
    before, path = sky.log.read_bytes(), tmp_path / "both.mcap"
    both = sky.write_solution(mine, path)
    assert sky.log.read_bytes() == before
    assert both.summary() == sky.summary() | {"log": str(path)}  # the log's own solution is as it was
    assert len(both.frames) == len(sky.frames)
    assert np.array_equal(both.frames[2.0].image_dn, sky.frames[2.0].image_dn)
    ((name, read),) = both.others.items()
    assert name == "mine" and all(
        np.array_equal(a, b) for a, b in zip(read.errors(), mine.errors(), strict=True)
    )
    with pytest.raises(LogError, match="exists already"):
        sky.write_solution(mine, path)
    third = both.with_solution(*_truth(sky), name="third")
    again = both.write_solution(third, tmp_path / "three.mcap")
    assert list(again.others) == ["mine", "third"] and not len(again.others["third"].data.covariance.t_s)
    better = again.with_solution(*_truth(sky), name="mine")  # takes the place of the one of its name
    last = again.write_solution(better, tmp_path / "four.mcap")
    assert sorted(last.others) == ["mine", "third"]
    assert np.abs(last.others["mine"].errors().position_i).max() < 1e-8


def test_only_another_solution_of_this_flight_is_written(sky, mine, tmp_path):
    path = tmp_path / "both.mcap"
    with pytest.raises(LogError, match="has no other filter's solution; expected a Run of with_solution"):
        sky.write_solution(sky, path)
    flown = (("navigation", "my_fsw", ""),)  # a program on board, whose name would do
    own = runs.Run(sky.data._replace(mission=sky.data.mission._replace(software=flown)), sky.log)
    with pytest.raises(LogError, match=r"my_fsw.* has no other filter's solution"):
        sky.write_solution(own, path)
    for change in ({"seed": 4}, {"scenario_text": sky.data.mission.scenario_text + "\n"}):
        changed = sky.data._replace(mission=sky.data.mission._replace(**change))
        with pytest.raises(LogError, match="is not the flight that 'mine' is about"):
            runs.Run(changed, sky.log).write_solution(mine, path)
    moved = sky.data._replace(truth=sky.truth._replace(r_i=sky.truth.r_i + 1e-3))
    with pytest.raises(LogError, match="is not the flight that 'mine' is about"):
        runs.Run(moved, sky.log).write_solution(mine, path)
    with pytest.raises(ValueError, match=r"name 'my_fsw\.py:Filter': expected lower-case letters"):
        other_solutions.write(sky.log, path, sky.data.mission, {"my_fsw.py:Filter": None})
    assert not path.exists()
    assert list(runs.open_run(sky.log).write_solution(mine, path).others) == ["mine"]  # read again


def test_times_that_are_no_ticks_are_told_and_refused_if_they_are_most(sky, tmp_path, command):
    """Every third time lies between two ticks; then every second and a few more."""
    t_s, *rest = _truth(sky)
    shifted = np.where(np.arange(len(t_s)) % 3 == 1, t_s + 0.004, t_s)
    log, alone = tmp_path / "both.mcap", int((np.arange(len(t_s)) % 3 == 1).sum())
    found = sky.with_solution(shifted, *rest, name="mine")
    share = found.summary()["navigation"]["solution_share"]
    assert share == pytest.approx(1.0 - alone / len(t_s)) and share < 0.7
    sky.write_solution(found, log)
    run = command("compare", str(log), f"{log}:mine", "--json")
    assert run.code == 0, run.err
    (told,) = json.loads(run.out)["comparisons"]
    assert f"B: {alone} of its {len(t_s)} times are no tick of the log: they have no errors" in told["notes"]
    row = next(one for one in told["figures"] if one["name"] == "position, rms of the run")
    assert row["difference"]["verdict"] is None and "of the ticks, B at 66" in row["why"]
    most = np.where((np.arange(len(t_s)) % 2 == 1) | (np.arange(len(t_s)) < 9), t_s + 0.004, t_s)
    ticks = int((most == t_s).sum())
    with pytest.raises(
        ValueError, match=rf"t_s: only {ticks} of the {len(t_s)} times, T.* is one of the log's"
    ):
        sky.with_solution(most, *rest, name="mine")


def test_every_covariance_is_kept_whatever_its_times(sky):
    """Ten a second, half-way between those of the log: NEES once a second, from the first star fix."""
    t_s, *rest = _truth(sky)
    some = np.flatnonzero(np.round(t_s * 100.0) % 10 == 5)
    truth = (t_s[some], rest[0][some] - OFF_I, *(one[some] for one in rest[1:]))
    found = sky.with_solution(*truth, covariances(len(some)), name="mine")
    assert np.array_equal(found.data.covariance.t_s, t_s[some])
    told = found.summary()["navigation"]["nees"]
    assert told["mean"] == pytest.approx(13.0**2 / 2.0**2) and told["samples"] == 2  # 2.05, 3.05 s


def test_nees_is_of_whole_seconds_where_there_are_some():
    tenths = np.arange(1, 31) / 10.0
    assert tenths[error_figures.whole_seconds(tenths)].tolist() == [1.0, 2.0, 3.0]
    assert (tenths + 0.05)[error_figures.whole_seconds(tenths + 0.05)].tolist() == pytest.approx(
        [0.15, 1.05, 2.05, 3.05]
    )
    assert not len(error_figures.whole_seconds(np.zeros(0)))


def _truth(run):
    return run.truth.t_s, run.truth.r_i, run.truth.v_i, run.truth.q_ib


def test_the_viewer_shows_it_beside_the_logs_own(sky, mine, tmp_path):
    sky.write_solution(mine, tmp_path / "both.mcap")
    viewer.view(tmp_path / "both.mcap", save=tmp_path / "both.rrd")
    entities = {str(chunk.entity_path) for chunk in chunks(tmp_path / "both.rrd")}
    assert {"/plots/errors/position_x/error", "/plots/errors/position_x/mine/error"} <= entities
    assert {"/plots/errors/position_x/mine/plus", "/plots/nees/mine"} <= entities


def test_it_is_exported_and_compared(sky, mine, tmp_path, command):
    log = tmp_path / "both.mcap"
    both = sky.write_solution(mine, log)
    run = command("export", str(log), "--csv", str(tmp_path / "csv"))
    assert run.code == 0, run.err
    with (tmp_path / "csv" / "errors_mine.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[5]["position_error_i_m_z"]) == pytest.approx(12.0)
    assert {"nav_mine", "nav_covariance_mine", "errors_mine", "nav"} <= set(both.tables)
    run = command("compare", str(log), f"{log}:mine", "--json")
    assert run.code == 0, run.err
    (found,) = json.loads(run.out)["comparisons"]
    one = next(one for one in found["figures"] if one["name"] == "position, rms of the run")
    assert one["b"]["median"] == pytest.approx(13.0) and found["pairs"] == 1
    bad = command("compare", str(log), f"{log}:yours")
    assert bad.code == 2 and "the log has no solution 'yours'; it has: mine" in bad.err


@pytest.mark.slow
def test_a_table_of_another_filter_is_compared_with_the_log(sky, tmp_path, command):
    """The columns are those of the table `nav` of `export`: the log's own comes back without difference."""
    assert command("export", str(sky.log), "--csv", str(tmp_path / "csv")).code == 0
    table = tmp_path / "csv" / "nav.csv"
    run = command("compare", str(sky.log), str(table), "--json", "--html", str(tmp_path / "page.html"))
    assert run.code == 0, run.err
    (found,) = json.loads(run.out)["comparisons"]
    differences = [one["difference"]["mean"] for one in found["figures"] if one["difference"]]
    assert len(differences) >= 9 and max(map(abs, differences)) < 1e-6, found["figures"]
    assert (tmp_path / "page.html").read_text().count("<img") == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t_s,r_i_m_x\n1,2\n", "mine.csv:1: has no column r_i_m_y; expected t_s, r_i_m_x"),
        (
            "HEAD\n1,2,3,4,5,6,7,1,0,0,none\n",
            "mine.csv:2: q_ib_z: expected a number such as 12.5, got 'none'",
        ),
        ("HEAD\n1,2,3\n", "mine.csv:2: 3 values, but 11 names of columns"),
        ("HEAD\n" + "1," * 11 + "5\n", "mine.csv:2: 12 values, but 11 names of columns"),
        ("HEAD,\n1,2,3\n", "mine.csv:2: 3 values, but 11 names of columns"),
        ("HEAD,\n1,2,3,4,5,6,7,2,0,0,0\n", "mine.csv: q: norm 2 at T+1.00 s"),
        ("HEAD\n1,2,3,4,5,6,7,2,0,0,0, \n", "mine.csv: q: norm 2 at T+1.00 s"),
        ("HEAD,note,note\n1,2,3,4,5,6,7,2,0,0,0,,\n", "mine.csv: q: norm 2 at T+1.00 s"),
        ("HEAD,q_ib_x\n1,2,3,4,5,6,7,1,0,0,0,9\n", "mine.csv:1: q_ib_x: two columns have this name"),
        ("HEAD\n", "mine.csv:2: has no row"),
        ("HEAD\n1,2,3,4,5,6,7,2,0,0,0\n", "mine.csv: q: norm 2 at T+1.00 s"),
        (None, "mine.csv: there is no such file"),
    ],
)
def test_a_table_that_is_none_is_one_line(sky, text, words, tmp_path, command):
    head = "t_s,r_i_m_x,r_i_m_y,r_i_m_z,v_i_m_s_x,v_i_m_s_y,v_i_m_s_z,q_ib_w,q_ib_x,q_ib_y,q_ib_z"
    if text is not None:
        (tmp_path / "mine.csv").write_text(text.replace("HEAD", head))
    run = command("compare", str(sky.log), str(tmp_path / "mine.csv"))
    assert run.code == 2 and words in run.err and run.err.count("\n") == 1, run.err
    first = command("compare", str(tmp_path / "mine.csv"), str(sky.log))
    assert first.code == 2 and "is about the flight of a log" in first.err


# ---- tables and arrays -----------------------------------------------------------------------------------


def test_tables_are_those_of_export_and_arrays_those_of_the_records(sky):
    nav = sky.tables["nav"]
    assert nav.comments["r_i_m_x"] and len(nav) == len(sky.solution.t_s)
    assert np.array_equal(nav["r_i_m_y"], sky.solution.r_i[:, 1])
    assert isinstance(nav.arrow, pa.Table) and nav.arrow.column_names == list(nav.comments)
    assert nav.arrow.field("q_ib_w").metadata[b"comment"].decode() == nav.comments["q_ib_w"]
    assert np.array_equal(nav.arrow["t_s"].to_numpy(), sky.solution.t_s)
    with pytest.raises(KeyError, match=r"there is no table 'navi'; the run has: .*nav"):
        sky.tables["navi"]
    assert sky.tables.nav is nav and sky.table("nav") is nav and "nav" in dir(sky.tables)
    with pytest.raises(AttributeError, match=r"there is no table 'navi'; the run has: .*nav"):
        sky.tables.navi  # noqa: B018
    with pytest.raises(KeyError, match="nav has no column 'r_x'; it has: t_s"):
        nav["r_x"]
    assert sky.imu.dtheta_b.shape == (len(sky.imu.t_valid_s), 4, 3)
    assert sky.gps.r_ea_e.shape == (len(sky.data.gps), 3) and sky.gps.valid.dtype == bool
    assert np.array_equal(sky.gps.t_valid_s, [one.t_valid_s for one in sky.data.gps])


def test_pandas_is_asked_for_where_it_is_needed(sky, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        ModuleNotFoundError, match=r"needs pandas, which is not installed: `pip install pandas` or `uv pip"
    ):
        sky.tables["nav"].to_pandas()


@pytest.mark.skipif(importlib.util.find_spec("pandas") is None, reason="pandas is not installed")
def test_a_table_in_pandas(sky):
    found = sky.tables["nav"].to_pandas()
    assert list(found.columns) == list(sky.tables["nav"].comments)
    assert np.array_equal(found["v_i_m_s_z"], sky.solution.v_i[:, 2])


def test_a_log_of_a_killed_run_is_not_copied(sky, mine, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(sky.log.read_bytes()[:-5000])
    run = runs.open_run(cut)
    with pytest.raises(LogError, match="its run was killed"):
        run.write_solution(mine, tmp_path / "both.mcap")
    assert not (tmp_path / "both.mcap").exists()
