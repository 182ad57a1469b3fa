"""Software of a user's own on the command line: consent, refusals, exit codes, replay and campaigns."""

import json
import re

import pytest
from own_flights import CLASS, reckoning

from shefex_nav import plugins
from shefex_nav.scenario.load import ScenarioError, load, load_text
from shefex_nav.scenario.software import NotBuiltIn, refuse_own


def test_a_failing_flight_ends_with_exit_code_3_and_a_log(tmp_path, command):
    path, log = reckoning(tmp_path, "if self.ticks == 150: 1 / 0"), tmp_path / "run.mcap"
    run = command(
        "run", "night_sky", "--trust", "--set", f"navigation.software={path}:Reckoning", "--out", str(log),
        "--json",
    )  # fmt: skip
    assert run.code == 3, run.err
    told = json.loads(run.out)  # what `report --json` says of the log
    assert told == json.loads(command("report", str(log), "--json").out)
    assert "T+1.50 s: failed in step" in told["failure"] and told["ended_early"]
    assert "T+1.50 s: failed in step" in run.err and "1 / 0" in run.err
    assert "shefex_nav/" not in run.err.partition("failed in step")[2]  # their frames alone
    table = command("report", str(log))
    assert table.code == 0 and "own.py:Reckoning, sha256" in table.out


def test_software_is_run_with_consent_only_and_is_that_of_the_log(tmp_path):
    path = reckoning(tmp_path, "pass  # of this test")
    scenario = tmp_path / "mine.yaml"
    scenario.write_text("extends: night_sky\nnavigation: {software: own.py:Reckoning}\n")
    with pytest.raises(ScenarioError, match=r"mine.yaml:2:24: navigation.software: .*give --trust"):
        load(str(scenario))
    loaded = load(str(scenario), trust=True)
    assert json.dumps(loaded.navigation.software.python).endswith('own.py:Reckoning"')
    again = load_text(loaded.source, "the log")  # without a look at the file
    path.write_text(path.read_text() + "\n# another\n")
    with pytest.raises(plugins.PluginError, match="is another file than the one that was flown"):
        plugins.software(again.navigation.software.python, again.navigation.software.sha256)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("own.py:Reckonin", "has no class Reckonin; it has: Reckoning"),
        ("own.py:rotation", "has no class rotation"),
        ("own.py", "names no class; write such as my_navigation.py:MyFilter"),
        ("other.py:Reckoning", "cannot be read: No such file"),
        ("no.such.module:Filter", "there is no module 'no.such.module' installed"),
        ("{command: ./nothing}", "there is no such program, or it may not be run"),
        ("{connect: 127.0.0.1:5005}", "navigation.software.connect: '127.0.0.1:5005' is no address"),
        (
            "{connect: tcp://127.0.0.1:99999}",
            "PORT from 1 to 65535, such as tcp://127.0.0.1:5005; one on this",
        ),
        ("{connect: tcp://127.0.0.1:0}", "needs no consent"),
        ("tcp://127.0.0.1:5005", "is an address; write {connect: tcp://127.0.0.1:5005}"),
        ("{connect: tcp://192.0.2.7:5005}", "is a program elsewhere, which would be told of the flight"),
        ("{connect: tcp://192.0.2.7:5005}", "give --trust"),
    ],
)
def test_software_that_cannot_fly_is_one_line(tmp_path, value, words):
    reckoning(tmp_path)
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(f"extends: night_sky\nnavigation:\n  software: {value}\n")
    trust = "192" not in value
    with pytest.raises(ScenarioError, match=re.escape(words)) as told:
        load(str(scenario), trust=trust)
    assert re.match(r".*mine.yaml:3:\d+: navigation.software", str(told.value))


@pytest.mark.parametrize(
    ("of", "into", "words"),
    [
        ("own.py:Reckoning", "own.py:Reckonin", "has no class Reckonin; it has: Reckoning"),
        ("own.py:Reckoning", "other.py:Reckoning", "cannot be read: No such file"),
        ("sha256: ", "sha256: 0", "is another file than the one that was flown"),
    ],
)
def test_check_looks_at_software_whose_content_is_named(tmp_path, command, of, into, words):
    path = reckoning(tmp_path)
    digest = plugins.software(f"{path}:Reckoning", None, trust=True)[0].sha256
    value = f"{{python: own.py:Reckoning, sha256: {digest}}}"
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(f"extends: night_sky\nnavigation:\n  software: {value}\n")
    assert command("check", scenario).code == 0
    value = value.replace(of, into).replace(f"{digest}}}", f"{digest[: 64 - (of == 'sha256: ')]}}}")
    scenario.write_text(f"extends: night_sky\nnavigation:\n  software: {value}\n")
    done = command("check", scenario)
    assert done.code == 2 and words in done.err
    assert re.search(r"mine.yaml:3:\d+: navigation.software", done.err)


def test_a_class_that_wants_arguments_is_told_before_the_flight(tmp_path):
    path = reckoning(tmp_path)
    text = path.read_text()
    for wanted, good in (("self, gain=1.0, *more", True), ("self, gain", False), ("self, *, gain", False)):
        path.write_text(text + f"\n    def __init__({wanted}):\n        pass\n")
        given = [f"navigation.software={path}:Reckoning"]
        if good:
            load("night_sky", given, trust=True)
            continue
        with pytest.raises(ScenarioError, match=r"is made without arguments.*missing a required .*gain"):
            load("night_sky", given, trust=True)


@pytest.mark.parametrize("value", ["127.0.0.1:99999", "192.0.2.7", "tcp://192.0.2.7:70000"])
def test_what_is_no_address_is_not_asked_consent_for(value):
    with pytest.raises(
        ScenarioError, match=r"software\.connect: .* is no address; expected tcp://HOST:PORT"
    ) as told:
        load("night_sky", [f"navigation.software={{connect: '{value}'}}"])
    assert "--trust" not in str(told.value)
    for port in (1, 65535):
        load("night_sky", [f"navigation.software={{connect: 'tcp://localhost:{port}'}}"])


def test_what_is_about_the_built_in_filter_refuses_another(tmp_path):
    path = reckoning(tmp_path)
    loaded = load("night_sky", [f"navigation.software={path}:Reckoning"], trust=True)
    with pytest.raises(NotBuiltIn, match=r"the bound is about the built-in software, not own\.py:"):
        refuse_own(loaded, "the bound")
    refuse_own(loaded, "characterise", "star_tracker")


def test_a_log_is_replayed_with_other_software(tmp_path, command):
    """The built-in filter's flight, once more by the class: the same numbers; and by another: others."""
    log, path = tmp_path / "run.mcap", reckoning(tmp_path)
    assert command("run", "night_sky", "--until", "3s", "--out", str(log)).code == 0

    def errors(*overrides):
        run = command("replay", str(log), "--json", "--trust", *overrides)
        assert run.code == 0, run.err
        return json.loads(run.out)["navigation"]["attitude_error_deg"], json.loads(run.out)["software"]

    assert errors("--set", f"navigation.software={CLASS}")[0] == errors()[0]
    own, name = errors("--set", f"navigation.software={path}:Reckoning")
    assert own != errors()[0] and name["navigation"].startswith("own.py:Reckoning, sha256 ")


@pytest.mark.slow
def test_the_built_in_filter_as_a_class_in_a_campaign(tmp_path, command):
    """The same figures as without."""
    tables = []
    for software in ("built_in", CLASS):
        how = ("--runs", "2", "--workers", "1", "--out", str(tmp_path / software[:5]), "--trust", "--json")
        sets = ("mission.time_limit=3 s", "star_tracker.enabled=false", "star_tracker.off=3 s")
        more = [word for one in (f"navigation.software={software}", *sets) for word in ("--set", one)]
        run = command("campaign", "night_sky", *more, *how)
        assert run.code == 0, run.err
        tables.append(json.loads(run.out))
    assert tables[0]["failed"] == tables[1]["failed"] == 0
    differ = {key for key in tables[0] if tables[0][key] != tables[1][key]}
    assert differ <= {"folder", "results_digest", "scenario_sha256", "timing", "wall_s"}, differ


def test_a_program_that_is_running_flies_in_no_campaign(tmp_path, command):
    how = ("--set", "navigation.software={connect: 'tcp://127.0.0.1:5005'}", "--runs", "2")
    run = command("campaign", "night_sky", *how, "--out", str(tmp_path / "none"))
    assert run.code == 2 and "is one program, which flies once" in run.err


def test_a_campaign_flies_it_in_its_workers_and_keeps_failed_runs(tmp_path, command):
    here = "if self.ticks == 50 and self.mission.sheets['imu'].gyro.bias > 6e-6: 1 / 0"
    reckoning(tmp_path, here)
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(
        "extends: night_sky\nmission: {name: mine, time_limit: 3 s}\n"
        "star_tracker: {enabled: false, off: 3 s}\n"
        "navigation: {software: own.py:Reckoning}\n"
        "dispersions: {imu.gyro.bias: {uniform: [0.1 deg/h, 1.5 deg/h]}}\n"
    )
    how = ("--runs", "8", "--workers", "2", "--out", str(tmp_path / "flown"), "--trust", "--json")
    run = command("campaign", str(scenario), *how)
    assert run.code in (0, 1), run.err
    campaign = json.loads(run.out)
    assert (campaign["runs"], 0 < campaign["failed"] < 8) == (8, True), sorted(campaign)
