"""`shefex-nav compare`: logs, campaigns and software in pairs of one seed.

Software of a user's own that stands still in inertial axes is carried off by the turning Earth: 400 m/s, so
which of the two is better is known beforehand, and the figures follow from the files of the runs.
"""

import json
import re
import shutil

import keeping
import numpy as np
import plugin_tables
import pytest
from scipy import stats
from short_campaign import HereLane, fly, write

from shefex_nav import plugins
from shefex_nav.campaign.compare import comparison, flying, given, paired, parts, sides, summary
from shefex_nav.campaign.compare.given import CompareError
from shefex_nav.scenario import load

RUNS = 4
SIX = 6
STANDING = """
from shefex_nav.geometry import rotation
from shefex_nav.software import Estimate


class Standing:
    def start(self, alignment, mission):
        self.r, self.v, self.q, self.ticks = alignment.r_i, alignment.v_i, alignment.q_ib, 0

    def step(self, imu, arrived):
        self.ticks += 1
        HERE
        turn = rotation.quat_from_rotvec(imu.dtheta_b.sum(axis=0))
        self.q = rotation.quat_normalise(rotation.quat_multiply(self.q, turn))
        return Estimate(self.r, self.v, self.q)
"""
SHORT = """extends: night_sky
mission: {name: short, time_limit: 2 s}
star_tracker: {enabled: false, off: 2 s}
requirements: {misleading: 0 %}
"""


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Consent and tables as before; runs fly in this process."""
    (tmp_path / "config").mkdir()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    with plugin_tables.restored():
        yield


def standing(folder, here="pass", name="own.py"):
    path = folder / name
    path.write_text(STANDING.replace("HERE", here))
    return f"{path}:Standing"


def short(folder, more=""):
    path = folder / "mine.yaml"
    path.write_text(SHORT + more)
    return path


def row(found, name):
    return next(one for one in found["figures"] if one["name"] == name)


def sided(folders, kind="campaign"):
    return [sides.of(kind, folder, letter) for letter, folder in zip("ABC", folders, strict=False)]


def six(side):
    """A Side of four runs with two of them once more, of seeds of their own."""
    side.runs.update({seed + 1: one for seed, one in list(side.runs.items())[: SIX - RUNS]})
    assert len(side.runs) == SIX
    return side


# ---- campaigns -------------------------------------------------------------------------------------------


def test_a_campaign_with_itself_differs_in_nothing(whole):
    folder, _ = whole
    a, b = sided([folder, folder])
    found = comparison.compare(a, b)
    assert len(found.seeds) == RUNS and not found.different and not found.notes
    assert len(found.rows) >= 10
    for one in (*found.rows, *found.shares):
        if isinstance(one, comparison.Row) and one.quantity.wall:
            assert (one.difference.mean, one.difference.verdict) == (0.0, paired.NOT_JUDGED), one
            continue
        assert (one.difference.mean, one.difference.verdict) == (0.0, paired.NOT_SEEN), one
    text = json.dumps(
        [str(cell) for part in parts.parts([a, b], [found]) for cells in part.rows for cell in cells]
    )
    assert "better" not in re.sub(r"0 of \d", "", text)
    verdicts = {cells[-1] for part in parts.parts([a, b], [found])[1:3] for cells in part.rows}
    assert verdicts == {"the same in each pair", "not judged: flown one after the other"}


def test_wall_time_is_shown_but_not_judged(whole):
    """Side B was flown while the machine had something else to do."""
    folder, _ = whole
    a, b = sided([folder, folder])
    for k, (seed, one) in enumerate(b.runs.items()):
        wall_s = {"wall_s": (2.0 + 0.01 * k) * one.get("wall_s")}
        b.runs[seed] = one._replace(get=lambda path, one=one, told=wall_s: told.get(path, one.get(path)))
    found = comparison.compare(a, b)
    timed = next(one for one in found.rows if one.quantity.name.startswith("time per tick"))
    assert timed.b.median > 1.9 * timed.a.median and timed.difference.better == 0
    assert timed.difference.verdict == paired.NOT_JUDGED
    cells = next(cells for cells in parts.parts([a, b], [found])[1].rows if cells[0] == timed.quantity.name)
    assert cells[-1] == "not judged: flown one after the other" and cells[2] != cells[3]
    (told,) = summary.summary([a, b], [found])["comparisons"]
    one = row(told, timed.quantity.name)
    assert one["difference"]["verdict"] is None and one["why"] == "flown one after the other"


def test_few_pairs_leave_it_open_and_a_covariance_too_small_is_said_of_its_side(whole):
    """Errors of B scatter about those of A, its NEES is 159 where 9 is expected."""
    folder, _ = whole
    path = "navigation.position_error_m.rms"
    a, b = sided([folder, folder])
    for side in (a, b):
        del side.runs[next(iter(side.runs))]
    for k, (seed, one) in enumerate(b.runs.items()):
        said = {path: one.get(path) + 0.1 * (-1) ** k, "navigation.nees.mean": 159.0}
        b.runs[seed] = one._replace(get=lambda path, one=one, said=said: said.get(path, one.get(path)))
    found = comparison.compare(a, b)
    figures = parts.parts([a, b], [found])[1]
    cells = {one[0]: one[-1] for one in figures.rows}
    assert cells["position, rms of the run"] == "open: only 3 pairs"
    assert "B, NEES 159: its errors are larger than its covariances say" in figures.lines
    assert not any(line.startswith("A, NEES") for line in figures.lines)
    scatter = np.array([0.1, -0.1, 0.2, -0.2, 0.1, -0.1])
    for n, verdict, told in ((2, "open: only 2 pairs", None), (5, "open: only 5 pairs", None),
                             (6, "no difference seen", "none")):  # fmt: skip
        seen = paired.difference(np.ones(n), 1.0 + scatter[:n])
        assert parts.verdict(seen, found) == verdict and summary.VERDICTS[seen.verdict] == told


def test_who_says_nothing_when_it_is_difficult_does_not_win(whole):
    """Side B has the smaller errors, over 0.2 % or 0.05 % fewer ticks of one of its runs."""
    folder, _ = whole
    spoken = ("position, rms of the run", "velocity, largest", "attitude, largest")
    for fewer, verdict in ((0.002, paired.NOT_JUDGED), (0.0005, paired.B_BETTER)):
        a, b = map(six, sided([folder, folder]))
        for k, (seed, one) in enumerate(b.runs.items()):
            told = {"navigation.solution_share": one.get("navigation.solution_share") - fewer * (k == 2)}
            for path in ("position_error_m.rms", "velocity_error_m_s.max", "attitude_error_deg.max"):
                told[f"navigation.{path}"] = one.get(f"navigation.{path}") - 1.0 - 0.01 * k
            b.runs[seed] = one._replace(get=lambda path, one=one, told=told: told.get(path, one.get(path)))
        found = comparison.compare(a, b)
        rows = {one.quantity.name: one for one in found.rows}
        assert {rows[name].difference.verdict for name in spoken} == {verdict}, fewer
        share = rows["ticks with a solution"]
        assert share.a.median == pytest.approx(100.0) and share.difference.mean == pytest.approx(
            -100.0 / SIX * fewer
        )
        cells = {cells[0]: cells[-1] for cells in parts.parts([a, b], [found])[1].rows}
        if verdict == paired.NOT_JUDGED:
            words = "not judged: A has a solution at 100 % of the ticks, B at 99.8 %"
            assert {cells[name] for name in spoken} == {words}
        assert "not judged" not in cells["ticks with a solution"]


def test_runs_of_one_flight_are_told(whole, tmp_path):
    folder = shutil.copytree(whole[0], tmp_path / "shared")
    head = json.loads((folder / "campaign.json").read_text())
    (folder / "campaign.json").write_text(json.dumps(head | {"flight": "shared"}))
    found = comparison.compare(*sided([whole[0], folder]))
    assert found.notes == ("B: all runs have one and the same flight: what is seen is of this flight alone",)


def test_who_has_no_solution_at_entry_of_the_worst_flights_does_not_win(whole):
    """B is better by half in the pairs that are left, and has nothing to say in one of eight."""
    (a,) = sided([whole[0]])
    entry, (one, *_) = "navigation.at_entry.position_error_m", a.runs.values()

    def flown(factor, missing=()):
        errors = {k: None if k in missing else factor * (1.0 + 0.01 * k) for k in range(8)}
        return {k: one._replace(get=lambda path, k=k: errors[k] if path == entry else None) for k in errors}

    for missing, verdict in (((), paired.B_BETTER), ((6,), paired.NOT_JUDGED)):
        sides_of_both = (
            a._replace(letter=x, runs=y)
            for x, y in zip("AB", (flown(1.0), flown(0.5, missing)), strict=False)
        )
        found = comparison.compare(*sides_of_both)
        (told,) = (one for one in found.rows if one.quantity.name == "position at entry")
        assert told.difference.verdict == verdict and told.difference.n == 8 - len(missing)
        assert told.why == ("A alone has it in 1 of 8 pairs" if missing else "")


def test_campaigns_of_one_seed_are_paired_by_seed_and_what_differs_is_told(whole, scenario, tmp_path):
    """B has other fixes, five of its six runs: its figures less those of A's run of the same seed."""
    folder, _ = whole
    other = load.load(write(tmp_path), ["gps.rate=2 Hz"])
    fly(other, tmp_path / "other", SIX)
    a, b = sided([folder, tmp_path / "other"])
    found = comparison.compare(a, b)
    assert found.seeds == tuple(a.runs) == tuple(b.runs)[:RUNS]
    assert [".".join(path) for path, *_ in found.different] == ["gps.rate"]
    assert "2 runs of B have no seed in A: left out" in found.notes
    del b.runs[tuple(b.runs)[-1]]
    assert "1 run of B has no seed in A: left out" in comparison.compare(a, b).notes
    kept = [
        [keeping.record(path, k)["summary"] for k in range(RUNS)] for path in (folder, tmp_path / "other")
    ]
    x, y = (np.array([one["navigation"]["velocity_error_m_s"]["rms"] for one in side]) for side in kept)
    one = next(r for r in found.rows if r.quantity.name == "velocity, rms of the run")
    low, high = stats.ttest_rel(y, x).confidence_interval(0.95)
    assert (one.difference.mean, one.difference.low, one.difference.high) == pytest.approx(
        ((y - x).mean(), low, high)
    )
    assert one.a.median == pytest.approx(np.median(x)) and one.b.rms == pytest.approx(np.sqrt((y**2).mean()))
    assert (one.difference.verdict, one.why) == (paired.OPEN, "only 4 pairs")


def test_rounding_is_no_difference():
    a = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    found = paired.difference(a, a * (1.0 + 2e-16 * np.array([1.0, -1.0, 2.0, 1.0, -1.0, 2.0])))
    assert (found.mean, found.better, found.worse, found.verdict) == (0.0, 0, 0, paired.NOT_SEEN)
    seen = paired.difference(a, a + np.array([1e-9, 1.1e-9, 0.9e-9] * 2))
    assert (seen.worse, seen.verdict) == (6, paired.EQUAL)


def test_no_seed_in_common_is_one_line_and_exit_code_2(whole, scenario, tmp_path, command):
    folder, _ = whole
    fly(scenario, tmp_path / "other", 2, seed=2)
    run = command("compare", str(folder), str(tmp_path / "other"), "--html", str(tmp_path / "page.html"))
    assert run.code == 2 and "no seed in common: A (" in run.err and "Traceback" not in run.err
    assert "fly both with the same --seed" in run.err and not (tmp_path / "page.html").exists()


# ---- logs ------------------------------------------------------------------------------------------------


def test_two_logs_are_one_pair_without_intervals(tmp_path, command):
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for log, rate in zip(logs, ("1 Hz", "2 Hz"), strict=True):
        run = command("run", str(short(tmp_path)), "--set", f"gps.rate={rate}", "--out", str(log))
        assert run.code == 0, run.err
    run = command("compare", *map(str, logs), "--json")
    (found,) = json.loads(run.out)["comparisons"]
    assert run.code == 0 and found["pairs"] == 1 and found["seeds"] == [1]
    told = [json.loads(command("report", str(log), "--json").out)["navigation"] for log in logs]
    one = row(found, "position, rms of the run")
    a, b = (each["position_error_m"]["rms"] for each in told)
    assert (one["a"]["median"], one["b"]["median"]) == (a, b)
    assert one["difference"]["mean"] == pytest.approx(b - a) and one["difference"]["low"] is None
    judged = [one["difference"] for one in found["figures"] if one["difference"]]
    assert {(one["verdict"], one["mean"] == 0.0) for one in judged} <= {
        (None, False),
        (None, True),
        ("none", True),
    }
    assert found["scenario_differences"] == [{"path": "gps.rate", "a": "1 Hz", "b": "2 Hz"}]
    assert found["commands"] == [f"shefex-nav view {logs[0]} {logs[1]}"]
    table = command("compare", *map(str, logs))
    assert "no interval: one pair" in table.out and "better" not in table.out.replace("better in", "")
    assert f"shefex-nav view {logs[0]}" in table.out
    lines = command("compare", str(logs[0]), str(logs[0])).out.splitlines()
    rows = [line for line in lines if line.startswith(("  position", "  velocity", "  misleading met"))]
    assert len(rows) == 5 and all(line.rstrip().endswith("the same in each pair") for line in rows)


def test_a_part_of_a_mission_is_not_judged_against_more_of_it(tmp_path, command):
    """One flight, one filter, looked at until two times: neither is better, and entry is missed by none."""
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for log, until in zip(logs, ("30s", "20s"), strict=True):
        run = command("run", "shefex2_andoya", "--until", until, "--out", str(log))
        assert run.code == 0, run.err
    (found,) = json.loads(command("compare", *map(str, logs), "--json").out)["comparisons"]
    one = row(found, "position, rms of the run")
    assert one["difference"]["verdict"] is None and one["difference"]["mean"] != 0.0
    assert one["why"] == "A ends at T+30.0 s, B ends at T+20.0 s"
    assert found["notes"] == ["A: was looked at until T+30.0 s", "B: was looked at until T+20.0 s"]
    met = [one for one in found["shares"] if one["name"].endswith(" met")]
    assert {one["name"] for one in met} >= {"attitude at entry met", "misleading met"}
    assert all((one["difference"], one["why"]) == (None, "cannot be judged of A and B") for one in met)
    (same,) = json.loads(command("compare", str(logs[1]), str(logs[1]), "--json").out)["comparisons"]
    assert row(same, "position, rms of the run")["difference"]["verdict"] == "none"


def test_a_log_is_paired_with_the_run_of_its_seed(whole, tmp_path, command):
    """Figures are those of the log, at 100 Hz; how long it took is not compared with a run without a log."""
    folder, _ = whole
    log = tmp_path / "2.mcap"
    assert command("repeat", str(folder), "2", "--log", str(log)).code == 0
    run = command("compare", str(folder), str(log), "--json")
    assert run.code == 0, run.err
    (found,) = json.loads(run.out)["comparisons"]
    assert found["seeds"] == [keeping.rows(folder)[2]["seed"]]
    assert f"{RUNS - 1} runs of A have no seed in B: left out" in found["notes"]
    one = row(found, "position, rms of the run")
    assert one["b"]["median"] == pytest.approx(one["a"]["median"], rel=0.1)
    assert not any(one["name"].startswith("time per tick") for one in found["figures"])
    draws = {one["path"] for one in found["scenario_differences"]}
    assert "ground.latitude" in draws  # which the log's scenario has as drawn
    assert found["commands"][0].startswith(f"shefex-nav repeat {folder} 2 --log ")


def test_logs_of_two_seeds_are_no_pair(tmp_path, command):
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for seed, log in zip("12", logs, strict=True):
        assert command("run", str(short(tmp_path)), "--seed", seed, "--out", str(log)).code == 0
    run = command("compare", *map(str, logs))
    assert run.code == 2 and "A (" in run.err and "has seed 1" in run.err and "has seed 2" in run.err


def test_a_log_without_the_seed_of_a_run_is_told_before_anything_flies(tmp_path, command):
    log, out = tmp_path / "a.mcap", tmp_path / "out"
    assert command("run", str(short(tmp_path)), "--out", str(log)).code == 0
    for pair in ((str(log), "built-in"), ("built-in", str(log))):
        run = command("compare", *pair, "--scenario", str(short(tmp_path)), "--out", str(out))
        assert (
            run.code == 2 and "no seed in common: A (" in run.err and "shefex-nav repeat DIR RUN" in run.err
        )
        assert not out.exists()


# ---- software --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_software_is_flown_compared_and_not_flown_again(tmp_path, command):
    own, page = standing(tmp_path), tmp_path / "page.html"
    words = ("compare", "built-in", own, "--scenario", str(short(tmp_path)), "--runs", str(SIX), "--trust")
    words += ("--out", str(tmp_path / "flown"), "--workers", "1")
    run = command(*words, "--json", "--html", str(page))
    assert run.code == 0, run.err
    told = json.loads(run.out)
    (found,) = told["comparisons"]
    assert found["pairs"] == SIX and found["scenario_differences"] == []
    assert told["sides"][1]["software"]["navigation"].startswith("own.py:Standing, sha256 ")
    one = row(found, "position, rms of the run")
    assert one["difference"]["verdict"] == "a" and one["difference"]["low"] > 100.0
    assert one["difference"]["worse"] == SIX
    misleading = next(one for one in found["shares"] if one["name"] == "misleading met")
    assert misleading["a"]["n"] == SIX and misleading["b"]["n"] == 0
    assert misleading["difference"] is None and misleading["why"] == "cannot be judged of B"
    assert "B does not give it" in [one["why"] for one in found["figures"]]
    text = page.read_text()
    assert "A better" in text and text.count("<img") == 2 and "own.py:Standing" in text
    folders = sorted((tmp_path / "flown").iterdir())
    assert [re.sub("-[0-9a-f]{8}$", "", one.name) for one in folders] == ["built-in", "own.py-Standing"]
    before = {(path, run): keeping.record(path, run) for path in folders for run in range(SIX)}
    again = command(*words)
    assert again.code == 0 and "A better" in again.out
    more = command(*words, "--runs", str(SIX + 1))
    assert f"{SIX + 1} pairs" in more.out
    assert before == {(path, run): keeping.record(path, run) for path, run in before}  # timing too


def test_fewer_runs_than_flown_name_the_command_that_compares_them(tmp_path, command):
    own = standing(tmp_path)
    words = ("compare", "built-in", own, "--scenario", str(short(tmp_path)), "--trust")
    words += ("--out", str(tmp_path / "flown"), "--workers", "1")
    assert command(*words, "--runs", "2").code == 0
    folders = [str(path) for path in sorted((tmp_path / "flown").iterdir())]
    (own_folder,) = (tmp_path / "flown").glob("own*")
    keeping.forget(own_folder, 1)  # as if it had been interrupted
    fewer = command(*words, "--runs", "1")
    assert fewer.code == 2 and "was asked for 2 runs, --runs 1 would take some away" in fewer.err
    told = re.search("`shefex-nav (compare .*)` compares the runs that have flown", fewer.err).group(1)
    assert told == " ".join(["compare", *folders])
    shown = command(*told.split())
    assert shown.code == 0 and "1 run of A has no seed in B: left out" in re.sub(r"\s+", " ", shown.out)
    (tmp_path / "flown").joinpath(folders[1], "campaign.json").unlink()
    alone = command(*words, "--runs", "1")
    assert alone.code == 2 and "`shefex-nav report` reads what there is" in alone.err


def test_edited_software_flies_into_a_folder_of_its_own(tmp_path):
    how = flying.How(str(short(tmp_path)), (), 2, 1, 1, tmp_path / "flown")
    with plugins.trusting():
        names = []
        for here in ("pass", "pass  # better"):
            own = standing(tmp_path, here)
            (one,) = flying.planned([given.read(own)], how)
            names.append(one.folder.name)
    assert names[0] != names[1] and names[0][:-8] == names[1][:-8] == "own.py-Standing-"


def test_scenarios_are_flown_each_with_its_own_software(tmp_path, command):
    standing(tmp_path)
    paths = [tmp_path / "plain.yaml", tmp_path / "own.yaml"]
    for path, more in zip(paths, ("", "navigation: {software: own.py:Standing}\n"), strict=True):
        path.write_text(SHORT + more)
    words = ("--runs", "2", "--trust", "--out", str(tmp_path / "flown"), "--json")
    run = command("compare", *map(str, paths), *words)
    assert run.code == 0, run.err
    (found,) = json.loads(run.out)["comparisons"]
    assert found["pairs"] == 2 and row(found, "position, rms of the run")["difference"]["mean"] > 100.0
    assert found["scenario_differences"] == []  # but for the software, which is named with the sides


def test_failed_runs_are_counted_and_left_out_of_the_figures(tmp_path, command):
    """Of a campaign whose software fails in some of its runs; and of a log, which says so itself."""
    own = standing(tmp_path, "assert not (self.ticks == 150 and imu.dtheta_b[0, 0] > 0.0)")
    words = (
        "--scenario",
        str(short(tmp_path)),
        "--runs",
        str(SIX),
        "--trust",
        "--out",
        str(tmp_path / "flown"),
    )
    run = command("compare", "built-in", own, *words, "--json")
    assert run.code == 0, run.err
    (found,) = json.loads(run.out)["comparisons"]
    failed = found["shares"][0]
    assert failed["name"] == "failed runs" and failed["a"]["k"] == 0 and 0 < failed["b"]["k"] < SIX
    assert row(found, "position, rms of the run")["difference"]["n"] == SIX - failed["b"]["k"]
    pairs = f"{failed['b']['k']} of {SIX} pairs {'has' if failed['b']['k'] == 1 else 'have'}"
    assert f"{pairs} a failed run: figures are of the others" in found["notes"]


def test_software_that_always_fails_says_why(tmp_path, command):
    own = standing(tmp_path, "assert self.ticks < 150, 'no such mode'")
    words = ("--scenario", str(short(tmp_path)), "--runs", "2", "--trust", "--out", str(tmp_path / "flown"))
    run = command("compare", "built-in", own, *words)
    assert run.code == 1, run.err
    assert "B failed, run 0: SoftwareError: navigation software own.py:Standing, T+1.50 s" in run.out
    assert "no such mode" in re.sub(r"\s+", " ", run.out) and "better" not in run.out.replace("better in", "")


def test_pairs_that_are_not_one_flight_are_told(whole):
    folder, _ = whole
    a, b = sided([folder, folder])
    assert not comparison.compare(a, b).notes
    seed, one = next(iter(b.runs.items()))
    changed = {"flight.apogee_km": 80.0}
    b.runs[seed] = one._replace(get=lambda path: changed.get(path, one.get(path)))
    assert [note for note in comparison.compare(a, b).notes if "1 pair is not one flight: " in note]


def test_a_log_whose_flight_failed_is_a_failed_run(tmp_path, command):
    own, scenario = standing(tmp_path, "assert self.ticks < 150"), short(tmp_path)
    logs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    assert command("run", str(scenario), "--out", str(logs[0])).code == 0
    failed = ("--trust", "--set", f"navigation.software={own}", "--out", str(logs[1]))
    assert command("run", str(scenario), *failed).code == 3
    page = tmp_path / "page.html"
    run = command("compare", *map(str, logs), "--json", "--html", str(page))
    assert run.code == 1 and "A better" not in page.read_text(), run.err
    (found,) = json.loads(run.out)["comparisons"]
    assert [(one["name"], one["a"]["k"], one["b"]["k"]) for one in found["shares"][:1]] == [
        ("failed runs", 0, 1)
    ]
    assert (
        found["figures"] == []
        and "1 of 1 pairs has a failed run: figures are of the others" in found["notes"]
    )


def test_three_are_compared_with_the_first(whole):
    folder, _ = whole
    a, b, c = sided([folder] * 3)
    titles = [part.title for part in parts.parts([a, b, c], [comparison.compare(a, one) for one in (b, c)])]
    assert sum("against A" in title for title in titles) == 2 and any(
        title.startswith("C (") for title in titles
    )


# ---- words of the command line ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("built-in", given.SOFTWARE, "built_in"),
        ("built_in", given.SOFTWARE, "built_in"),
        ("my_nav.py:MyFilter", given.SOFTWARE, "my_nav.py:MyFilter"),
        ("package.module:Class", given.SOFTWARE, "package.module:Class"),
        ("command:./my_fsw --flag 'a b'", given.SOFTWARE, {"command": "./my_fsw --flag 'a b'"}),
        ("night_sky", given.SCENARIO, None),
        ("there/mine.yaml", given.SCENARIO, None),
        ("run.mcap", given.LOG, None),
    ],
)
def test_what_a_word_means(text, kind, value):
    assert given.read(text).kind == kind
    if value is not None:
        path, _, told = given.override(text).partition("=")
        assert path == "navigation.software"
        assert (json.loads(told) if isinstance(value, dict) else told) == value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("my_nav.py", r"names no class; expected my_nav\.py:MyFilter"),
        ("tcp://127.0.0.1:5005", "is one program, which flies once"),
        ("connect:tcp://127.0.0.1:5005", "is one program, which flies once"),
        ("command:", "names no program; expected 'command:"),
        (
            "nothing",
            r"there is no such thing to compare; expected a log \(\.mcap\), the folder of a campaign",
        ),
    ],
)
def test_what_cannot_be_compared_is_one_line(text, words, command):
    with pytest.raises(CompareError, match=words):
        given.read(text)
    run = command("compare", "built-in", text, "--scenario", "night_sky")
    assert run.code == 2 and run.err.count("\n") == 1, run.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("built-in",), "only built-in; expected two or more to compare"),
        (("built-in", "built-in"), "built-in: software needs a scenario to fly in; add --scenario"),
        (("night_sky", "orbit", "--scenario", "tight"), "--scenario: tight: no software is given"),
        (("built-in", "there.py:Filter", "--scenario", "night_sky"), "'there.py' cannot be read"),
        (("built-in", "built-in", "--scenario", "no_such"), "no_such"),
        (("a.mcap", "b.mcap"), "a.mcap: cannot be read"),
        ((*["built-in"] * 200, "l.mcap", "--scenario", "night_sky"), "201 to compare; expected 200 at most"),
    ],
)
def test_bad_input_is_refused_before_anything_flies(words, says, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = command("compare", *words)
    assert run.code == 2 and says in run.err and "Traceback" not in run.err, run.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config"]


def test_a_page_is_not_overwritten(whole, tmp_path, command):
    page = tmp_path / "page.html"
    page.write_text("mine")
    folder, _ = whole
    run = command("compare", str(folder), str(folder), "--html", str(page))
    assert run.code == 2 and page.read_text() == "mine" and "exists already" in run.err


ENDS_ONCE = """import pathlib, signal
        flag = pathlib.Path(__file__).with_suffix(".flag")
        if self.ticks == 5 and not flag.exists():
            flag.touch()
            signal.raise_signal(signal.SIGTERM)"""


def test_an_interrupted_comparison_shows_what_is_complete_and_goes_on(tmp_path, command):
    """Software B asks for the end in its first run, which still flies."""
    own = standing(tmp_path, ENDS_ONCE)
    words = ("compare", "built-in", own, "--scenario", short(tmp_path), "--runs", "3", "--trust")
    words += "--out", tmp_path / "out"
    ended = command(*words)
    assert ended.code == 130, ended.err
    assert "interrupted; what is flown is kept, the same command goes on from there" in ended.err
    assert f"shefex-nav compare {tmp_path}/out/built-in-" in ended.err
    assert re.search(r"against A \(built-in\), [12] pairs?\b", ended.out), ended.out
    again = command(*words)
    assert again.code == 0 and re.search(r"against A \(built-in\), 3 pairs", again.out), again.err


def test_an_interrupted_comparison_without_a_pair_says_so(tmp_path, command):
    first, second = standing(tmp_path, ENDS_ONCE), standing(tmp_path, name="two.py")
    words = ("compare", first, second, "--scenario", short(tmp_path), "--runs", "3", "--trust")
    ended = command(*words, "--out", tmp_path / "out")
    assert ended.code == 130 and not ended.out
    assert "not two of them have runs of the same seed yet" in ended.err
