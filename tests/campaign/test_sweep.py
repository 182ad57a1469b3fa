"""`shefex-nav campaign --sweep`: combinations of settings under the same draws, compared in pairs."""

import json

import pytest
from short_campaign import HereLane

from shefex_nav.campaign import progress
from shefex_nav.campaign.compare import sides, sweep
from shefex_nav.campaign.compare.given import CompareError
from shefex_nav.report.requirements import Judged
from shefex_nav.scenario import sweeps
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.sweeps import SweepError

SHORT = """# Two seconds at rest.
extends: night_sky
mission: {name: short, time_limit: 2 s}
star_tracker: {enabled: false, off: 2 s}
requirements: {misleading: 0 %}
"""


@pytest.mark.parametrize(
    ("text", "key", "values"),
    [
        ("imu=stim300, adis16505_1", "imu.use", ("stim300", "adis16505_1")),
        ("gps.use=a,b", "gps.use", ("a", "b")),
        ("gps.range_noise=1 m,1.5 m", "gps.range_noise", ("1 m", "1.5 m")),
        ("a=[[1, 2], [3]],[[4]]", "a", ("[[1, 2], [3]]", "[[4]]")),
        ("gps.antenna=[0 m, 1 m], [2 m]", "gps.antenna", ("[0 m, 1 m]", "[2 m]")),
    ],
)
def test_what_is_swept(text, key, values):
    assert sweeps.axis(text) == (key, values)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("imu", "expected KEY=A,B,C"),
        ("imu=stim300", "there is one value; expected two or more"),
        ("imu=a,b,a", "a stands there twice"),
        ("imu=a,,b", "expected KEY=A,B,C"),
    ],
)
def test_what_is_no_sweep(text, words):
    with pytest.raises(SweepError, match=words):
        sweeps.axis(text)


def test_each_side_has_a_letter_of_its_own():
    assert len(set(sides.LETTERS)) == len(sides.LETTERS) == sides.MOST
    assert sides.LETTERS[0] == "A" and sides.LETTERS[25:28] == ("Z", "AA", "AB")


def test_combinations_that_are_too_many_or_told_twice(tmp_path):
    axes = [sweeps.axis(f"{key}={','.join(f'{n} m' for n in range(1, 16))}") for key in ("a.b", "c.d")]
    with pytest.raises(SweepError, match="225 combinations; expected 200 at most"):
        sweep.planned("night_sky", axes, (), tmp_path)
    with pytest.raises(SweepError, match=r"a\.b: is given twice"):
        sweep.planned("night_sky", [axes[0], axes[0]], (), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["imu=stim300,adis16505"], "--sweep imu.use=adis16505: there is no file 'adis16505', and"),
        (["imu.gyro.bias=1 deg/h,1"], "--sweep imu.gyro.bias=1: 1 has no unit"),
        (["star_camera.detector.bits=8,12"],
         "quarter of 4095 DN, .* (with --sweep star_camera.detector.bits=12)"),
        (["star_camera.detector.bits=8,12", "gps.rate=1 Hz,2 Hz"],
         "quarter of 4095 DN, .* (with --sweep star_camera.detector.bits=12, gps.rate=1 Hz)"),
        (["mission.time_limit=2 s,300 s", "star_tracker.off=2 s,300 s"],
         "--sweep star_tracker.off=300 s: .* (with --sweep mission.time_limit=2 s, star_tracker.off=300 s)"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_combination_names_it(texts, said, tmp_path):
    """And --sweep, which has given the value, not --set."""
    axes = [sweeps.axis(text) for text in texts]
    with pytest.raises(ScenarioError) as error:
        sweep.planned("night_sky", axes, ("star_tracker.detection.saturation=255 DN",), tmp_path)
    begin, _, end = said.partition(" .* ")
    (line,) = error.value.messages
    assert begin in line and line.endswith(end) and "--set" not in line.replace(f"--set {SATURATION}", "")


SATURATION = "star_tracker.detection.saturation"


def test_other_refusals_name_the_combination(tmp_path):
    """A program that is running flies once."""
    axes = [sweeps.axis("gps.rate=1 Hz,2 Hz")]
    told = ("navigation.software={connect: tcp://127.0.0.1:5005}",)
    with pytest.raises(SweepError, match=r"its command.* \(with --sweep gps\.rate=1 Hz\)"):
        sweep.planned("night_sky", axes, told, tmp_path)


def test_a_campaign_tells_what_a_unit_takes_away(tmp_path, monkeypatch, command):
    """Once for each unit that is not the scenario's own."""
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    own = "imu: {use: stim300, accelerometer: {range: 80 gee}}\n"
    (tmp_path / "short.yaml").write_text(SHORT + own)
    words = "campaign", tmp_path / "short.yaml", "--runs", "1", "--out", tmp_path / "out"
    done = command(*words, "--sweep", "imu=stim300,ln_200s", "--sweep", "gps.rate=1 Hz,2 Hz")
    assert done.code == 0, done.err
    (line,) = [one for one in done.err.splitlines() if one.startswith("warning: ")]
    assert "--sweep imu.use=ln_200s: " in line and "stim300: accelerometer.range 80 gee" in line


def test_a_noisier_receiver_is_worse_in_every_pair(tmp_path, monkeypatch, command):
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    (tmp_path / "short.yaml").write_text(SHORT)
    words = "campaign", tmp_path / "short.yaml", "--runs", "4", "--out", tmp_path / "out"
    words += (
        "--sweep",
        "gps.range_noise=30 m,1 m",
        "--sweep",
        "gps.antenna.lever_arm=[0 m, 0 m, 0 m],[1 m, 0 m, 0 m]",
    )
    done = command(*words, "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    settings = [one["settings"] for one in found["combinations"]]
    assert [one["gps.range_noise"] for one in settings] == ["30 m", "30 m", "1 m", "1 m"]
    assert settings[1]["gps.antenna.lever_arm"] == "[1 m, 0 m, 0 m]"
    figures = [
        next(row for row in one["figures"] if row["name"] == "position, rms of the run")
        for one in found["comparisons"]
    ]
    assert [row["difference"]["n"] for row in figures] == [4, 4, 4]
    assert [row["difference"]["better"] for row in figures[1:]] == [4, 4]
    assert [row["difference"]["low"] < 0.0 <= row["difference"]["high"] for row in figures] == [
        True,
        False,
        False,
    ]
    assert all(row["difference"]["verdict"] is None and row["why"] == "only 4 pairs" for row in figures)
    assert all(one["met"] == one["runs"] == 4 for one in found["combinations"])
    assert len(list((tmp_path / "out").iterdir())) == 4

    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", None)  # all has flown
    again = command(*words)
    assert again.code == 0, again.err
    lines = [line.split() for line in again.out.splitlines()]
    ranked = [line[0] for line in lines if line[-4:-3] and "of" in line and line[0] in "ABCD"]
    assert set(ranked[:2]) == {"C", "D"}


def test_runs_that_fail_are_told(tmp_path, monkeypatch, command):
    """Every run fails, and nothing is required."""
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    failing = SHORT.replace("requirements: {misleading: 0 %}\n", "")
    (tmp_path / "short.yaml").write_text(failing)

    def fail(*given):
        raise ValueError("no flight")

    monkeypatch.setattr("shefex_nav.campaign.flight._records", fail)
    words = "campaign", tmp_path / "short.yaml", "--runs", "1", "--out", tmp_path / "out"
    done = command(*words, "--sweep", "gps.range_noise=30 m,1 m")
    assert done.code == 1, done.err
    rows = [line.split() for line in done.out.splitlines() if line.split()[:1] in (["A"], ["B"])]
    assert [row[3:] for row in rows] == [["-", "0", "of", "1", "-", "-", "-"]] * 2
    assert "as nothing is required" in done.out


def test_values_that_are_one_scenario(tmp_path):
    with pytest.raises(CompareError, match="are the same scenario"):
        sweep.planned("night_sky", [sweeps.axis("gps.range_noise=10 m,10.0 m")], (), tmp_path)


@pytest.mark.parametrize("more", [("--engine", "dask://a:1"), ("--keep", "failed"), ("--dry-run",)])
def test_what_does_not_go_with_it(more, command):
    done = command("campaign", "night_sky", "--runs", "2", "--sweep", "imu=a,b", *more)
    assert done.code == 2 and done.err.strip().endswith("does not go with --sweep")


def side(letter, found, rms_deg):
    """A Side of two runs that both miss or meet a requirement."""
    judged = (Judged("attitude", 0.1, found, "deg", found <= 0.1),)
    figures = {"navigation.attitude_error_deg.rms": 2.45, "navigation.star_aided.attitude_deg.rms": rms_deg}
    runs = {seed: sides.Flown(seed, seed, "", figures.get, judged, {}) for seed in (1, 2)}
    return sides.Side(letter, letter, None, "campaign", "", {}, {}, runs)


def test_that_no_run_met_what_is_required_is_not_that_nothing_is():
    every = [side("A", 0.2, 0.3), side("B", 0.3, 0.01)]
    part = sweep._combinations(every, [{"x": "1"}, {"x": "2"}])
    assert [row[2] for row in part.rows] == ["0 of 2", "0 of 2"]
    assert "the runs that met all that is required, then the attitude" in part.lines[0]


def test_combinations_are_told_apart_by_what_the_stars_give():
    """The errors before the first star fix are the same 2.45 deg in all of them."""
    part = sweep._combinations([side("A", 0.2, 0.3), side("B", 0.3, 0.01)], [{"x": "1"}, {"x": "2"}])
    assert part.heads[-1] == ">attitude, rms after two star fixes [deg]"
    assert [(row[0], row[-1]) for row in part.rows] == [("B", "0.01"), ("A", "0.3")]


def test_progress_counts_what_misses_a_requirement():
    tally = progress.Tally(3, clock=lambda: 0.0)
    for run, bad in enumerate([(0.4, 1.0), (2.1, 1.0)]):
        tally.take({"run": run, "status": "succeeded"}, bad)
    assert tally.words().startswith("100.0 % flew to their end, 1 misses a requirement, worst run 1")
    tally.take({"run": 2, "status": "failed"})
    assert tally.words().startswith("66.7 % flew to their end, 1 misses")
