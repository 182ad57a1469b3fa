"""The command line as users meet it: exit codes, messages, killed and interrupted runs."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest


def test_help_is_quick():
    """CPU of the child, the best of five: imports of simulation or viewer at start-up would cost seconds."""
    best = float("inf")
    for _ in range(5):
        before = os.times()
        subprocess.run([sys.executable, "-m", "shefex_nav", "--help"], capture_output=True, check=True)
        after = os.times()
        best = min(
            best,
            after.children_user + after.children_system - before.children_user - before.children_system,
        )
    assert best < 0.5


def test_each_command_is_a_file_of_its_name():
    import typer

    from shefex_nav import commands
    from shefex_nav.commands.app import app

    def names(group, before=""):
        for name, command in group.commands.items():
            yield before + name
            yield from names(command, f"{name}_") if hasattr(command, "commands") else ()

    shared = {
        "__init__",
        "app",
        "main",
        "options",
        "output_files",
        "printing",
        "flights",
        "refusal",
        "shell",
    }
    files = {path.stem for path in Path(commands.__file__).parent.glob("*.py")}
    assert files - shared == set(names(typer.main.get_command(app)))


def test_check_of_a_good_scenario(command, default_scenario):
    result = command("check", default_scenario)
    assert result.code == 0
    assert "good" in result.out


def test_check_as_an_object(command, tmp_path):
    """Errors and warnings by file, line, column, field; what is printed without --json stays as it was."""
    bad = tmp_path / "bad.yaml"
    bad.write_text("extends: night_sky\nimu: {gyro: {bias: 3 metres}}\nstar_camera: {fuu: 3}\n")
    plain, told = command("check", bad), command("check", bad, "--json")
    assert (plain.code, plain.out) == (2, "") and (told.code, told.err) == (2, plain.err)
    found = json.loads(told.out)
    first, second = found["errors"]
    text = "'metres' is not a unit; expected one as in '0.5 deg/h'"
    assert first == {"file": str(bad), "line": 2, "column": 20, "field": "imu.gyro.bias", "text": text}
    assert (second["line"], second["field"], found["good"]) == (3, "star_camera.fuu", False)
    for override in ("imu.gyro.bias=3", "nowhere=3"):
        (said,) = json.loads(command("check", "night_sky", "--json", "--set", override).out)["errors"]
        assert said["file"] is None and said["field"] == override.partition("=")[0]
    good = tmp_path / "good.yaml"
    good.write_text("extends: night_sky\nnavigation:\n  told: {imu: {gyro: {bias: 3 deg/h}}}\n")
    plain, told = (
        command("check", good, "--against", "night_sky"),
        command("check", good, "--against", "night_sky", "--json"),
    )
    found = json.loads(told.out)
    (said,) = found["told_otherwise"]
    assert said["line"] == 3 and said["field"] == "navigation.told.imu.gyro.bias" and found["good"]
    assert plain.out == "\n".join([f"{good}: good", *found["differences"]]) + "\n"
    assert found["differences"] and plain.code == told.code == 0


def test_a_warning_of_check_as_an_object(command):
    plain, told = command("check", "bright_four_star"), command("check", "bright_four_star", "--json")
    (said,) = json.loads(told.out)["warnings"]
    assert plain.err.startswith(told.err) and plain.out == "bright_four_star: good, with 1 warning\n"
    assert plain.err.removeprefix(told.err).splitlines() == json.loads(told.out)["notes"]
    place = f"{said['file']}:{said['line']}:{said['column']}"
    assert f"warning: {place}: {said['field']}: {said['text']}\n" == told.err


@pytest.mark.parametrize(("end_s", "part"), [(901, "; flown until T+900 s of 901 s"), (900, "")])
def test_check_says_how_much_of_an_orbit_it_has_flown(command, end_s, part):
    given = ("cubesat", "--set", f"mission.time_limit={end_s} s", "--set", "star_tracker.off=100 s")
    last = ("--set", "programme.pointing.until=900 s")
    plain, told = command("check", *given, *last), command("check", *given, *last, "--json")
    assert plain.code == 0, plain.err
    assert plain.out.startswith("cubesat: good") and plain.out.endswith(f"{part or 'good'}\n")
    assert json.loads(told.out)["flown_until_s"] == (900.0 if part else None)


def test_a_process_says_the_same_and_ends_with_its_code(command, process, default_scenario):
    """The other tests of messages run the command line in this process, which is the same and quicker."""
    for arguments in (("check", default_scenario), ("check", default_scenario, "--set", "gps.latency=nan s")):
        assert process(*arguments) == command(*arguments)


def test_schema_is_json(command):
    schema = json.loads(command("schema").out)
    assert "mission" in schema["$defs"]["Scenario"]["properties"]


def test_schema_of_replay_is_that_of_the_files_that_come_with_the_program(command):
    import jsonschema
    import yaml

    validator = jsonschema.Draft202012Validator(json.loads(command("schema", "--replay").out))
    files = sorted((Path(__file__).parent.parent / "scenarios" / "replay").glob("*.yaml"))
    assert len(files) >= 3
    for file in files:
        content = json.loads(json.dumps(yaml.safe_load(file.read_text()), default=str))  # times are text
        assert not list(validator.iter_errors(content)), file
        content["gnss"] = {"lever_arm": 3}
        assert list(validator.iter_errors(content)), file


BROKEN = {
    "wrong unit": ("imu.gyro.range=5 m", "range"),
    "no unit": ("star_tracker.latency=0.03", "unit"),
    "negative rate": ("star_tracker.rate=-10 Hz", "rate"),
    "not a number": ("gps.latency=nan s", "finite"),
    "unknown key": ("star_tracker.rat=10 Hz", "rate"),
    "unknown catalogue": ("star_tracker.catalogue.kind=combinde", "combined"),
}


@pytest.mark.parametrize("kind", BROKEN)
@pytest.mark.parametrize("verb", ["run", "check"])
def test_broken_scenario_is_one_message_and_exit_code_2(kind, verb, command, default_scenario, tmp_path):
    override, hint = BROKEN[kind]
    out = tmp_path / "run.mcap"
    extra = ("--out", out) if verb == "run" else ()
    result = command(verb, default_scenario, "--set", override, *extra)
    assert result.code == 2
    assert result.out == ""
    lines = [line for line in result.err.splitlines() if line.strip()]
    assert len(lines) == 1 and hint in lines[0] and override.split("=")[0] in lines[0], result.err
    assert not out.exists()


@pytest.mark.parametrize("override", ["catalogue.faintest=7 mag", "identification.deepest=7 mag"])
def test_a_star_tracker_without_a_catalogue_replaces_no_log(override, command, tmp_path):
    """The table of stars is whole to 6.5 in silicon: said before the log of an earlier run is touched."""
    log = tmp_path / "earlier.mcap"
    log.write_bytes(b"an earlier run")
    given = ("--set", "star_tracker.catalogue.system=silicon", "--set", f"star_tracker.{override}")
    result = command("run", "night_sky", "--until", "2s", *given, "--out", log, "--force")
    assert (result.code, result.out) == (2, "")
    assert f"star_tracker.{override.split('=')[0]}: the table of stars ends at V 8" in result.err
    assert log.read_bytes() == b"an earlier run"


@pytest.mark.parametrize("verb", ["run", "check", "campaign", "compare", "replay"])
def test_a_key_that_is_set_twice_is_refused(verb, command, default_scenario):
    """The last would be taken without a word; keys of one section are none of this."""
    given = [word for text in ("a.b=1", "a.c=2", "a.b = 3") for word in ("--set", text)]
    result = command(verb, default_scenario, *given)
    assert (result.code, result.out) == (2, "")
    assert result.err == "--set: a.b is given twice: 'a.b=1' and 'a.b = 3'; leave one out\n"


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("run", "nowhere.yaml"), "no such file"),
        (("check", "scenarios"), "directory"),
        (("report", "nowhere.mcap"), "nowhere.mcap"),
        (("report", "README.md"), "README.md"),
        (("view", "nowhere.mcap"), "nowhere.mcap"),
    ],
)
def test_wrong_files(arguments, hint, command):
    result = command(*arguments)
    assert result.code == 2
    assert hint in result.err
    assert "Traceback" not in result.err


def test_verify_without_data_is_one_message(command, tmp_path):
    result = command("verify", "nesc", "--data", tmp_path)
    assert result.code == 2
    assert str(tmp_path) in result.err
    assert "Traceback" not in result.err


def test_impossible_flight_is_one_message(command, default_scenario, tmp_path):
    """A rocket that cannot be known to fail before it flies: still in the air at the time limit."""
    out = tmp_path / "run.mcap"
    result = command("run", default_scenario, "--set", "mission.time_limit=450 s", "--out", out)
    assert result.code == 2
    assert "at the time limit, 450 s; mission.time_limit has to allow for all of its descent" in result.err
    assert "Traceback" not in result.err
    assert not out.exists()


def test_flight_into_the_ground_is_one_message(command, default_scenario, tmp_path):
    out = tmp_path / "run.mcap"
    result = command("run", default_scenario, "--set", "vehicle.payload.mass=3000 kg", "--out", out)
    assert result.code == 2
    assert "hits the ground" in result.err
    assert not out.exists()


def test_view_never_overwrites(command, default_run):
    before = default_run.log.read_bytes()
    for arguments in (("--save", default_run.log), ("--screenshot", default_run.log, "--at", "300s")):
        result = command("view", default_run.log, *arguments)
        assert result.code == 2
        assert "is the log itself" in result.err
    assert default_run.log.read_bytes() == before


def test_time_of_a_picture_that_is_not_asked_for(command, default_run):
    result = command("view", default_run.log, "--at", "300s")
    assert result.code == 2
    assert "--screenshot" in result.err


def test_a_log_that_another_process_makes_meanwhile(command, tmp_path, monkeypatch):
    """Two runs at once to one file: the second is refused in the words of one that comes later."""
    from shefex_nav.commands import run

    path = tmp_path / "run.mcap"
    path.write_text("of another run")
    late = command("run", "night_sky", "--until", "1s", "--out", path)
    monkeypatch.setattr(run, "check_file", lambda *given, **how: None)  # it was not there then
    told = command("run", "night_sky", "--until", "1s", "--out", path)
    assert told.code == late.code == 2 and told.err.splitlines()[-1] == late.err.splitlines()[-1]
    assert "add --force" in told.err and path.read_text() == "of another run"


def test_an_existing_log_is_not_overwritten(command, default_scenario, tmp_path):
    out = tmp_path / "run.mcap"
    out.write_bytes(b"precious")
    result = command("run", default_scenario, "--out", out)
    assert result.code == 2
    assert "exists already" in result.err
    assert out.read_bytes() == b"precious"


def start_run(scenario, out):
    return subprocess.Popen(
        [sys.executable, "-m", "shefex_nav", "run", str(scenario), "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def wait_for_bytes(out, size, process):
    deadline = time.monotonic() + 300.0
    while not out.exists() or out.stat().st_size < size:
        assert process.poll() is None, "the run ended before it could be stopped"
        assert time.monotonic() < deadline, "the run does not write its log"
        time.sleep(0.02)


SIZES = 1_000_000, 25_000_000  # bytes: before the frames and among them


@pytest.fixture(scope="module")
def killed(default_scenario, tmp_path_factory):
    """{size: what a run leaves behind, killed with kill -9 when its log has grown to that size}.

    One run: a process that stands still has written as much as one that is killed there.
    """
    folder = tmp_path_factory.mktemp("killed")
    out = folder / "run.mcap"
    run, left = start_run(default_scenario, out), {}
    try:
        for size in SIZES:
            wait_for_bytes(out, size, run)
            run.send_signal(signal.SIGSTOP)
            os.waitpid(run.pid, os.WUNTRACED)
            if size == SIZES[-1]:
                run.kill()
                run.wait()
            left[size] = shutil.copy(out, folder / f"{size}.mcap")
            run.send_signal(signal.SIGCONT)
    finally:
        run.kill()
        run.communicate()
    return left


@pytest.mark.parametrize("size", [pytest.param(SIZES[0], marks=pytest.mark.slow), SIZES[1]])
def test_killed_run_is_readable_to_its_last_second(size, killed, default_data, command, process, tmp_path):
    """No gap before its end, and every command can read it."""
    out = killed[size]

    from shefex_nav.log import reader

    data = reader.read(out)
    assert data.ended_early
    n = len(data.nav.t_s)
    assert (data.nav.r_i == default_data.nav.r_i[:n]).all()  # complete: no gap before the end
    assert data.truth.t_s[-1] - data.nav.t_s[-1] < 0.5
    result = command("report", out, "--json")
    assert result.code == 0, result.err
    assert json.loads(result.out)["ended_early"] is True
    assert "ended early" in result.err
    recording = tmp_path / "view.rrd"
    result = process("view", out, "--save", recording)
    assert result.code == 0, result.err
    assert result.err.splitlines() == [  # nothing of what the reader of the recording has to say of the end
        f"{out}: the run ended early, at T{data.last_t_s:+.2f} s; this is about what there is",
        f"wrote {recording}",
    ]
    assert recording.stat().st_size > 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_run_closes_its_log_which_says_so(number, default_scenario, command, tmp_path):
    out = tmp_path / "run.mcap"
    process = start_run(default_scenario, out)
    wait_for_bytes(out, 2e6, process)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.decode().splitlines()[-2:] == [f"{out}: what was flown until now", "interrupted"]

    from shefex_nav.log import reader

    data = reader.read(out)
    assert data.ended_early and data.last_t_s > 0.0
    summary = json.loads(command("report", out, "--json").out)
    assert summary["ended_early"] is True and summary["flight"]["apogee_km"] is None


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("vehicle.spin_motors.torque=1e12 N m", "grows without bound"),
        ("vehicle.spin_motors.torque=1e6 N m", "too fast"),
        ("vehicle.yo_yo.cord_length=60 m", "cords of the yo-yo are too long"),
    ],
)
def test_flights_that_cannot_be_are_one_message(command, default_scenario, tmp_path, override, words):
    out = tmp_path / "run.mcap"
    result = command("run", default_scenario, "--set", override, "--out", out)
    assert result.code == 2
    assert words in result.err
    assert "Traceback" not in result.err
    assert not out.exists()


def test_names_are_shown_as_they_are(tmp_path, process):
    """Brackets are no markup, and letters that the terminal does not know are shown as ?."""
    log = tmp_path / "[red]é[bold].mcap"
    flown = process("run", "night_sky", "--until", "1s", "--out", log, PYTHONIOENCODING="ascii")
    assert flown.code == 0, flown.err
    assert "Traceback" not in flown.err
    assert "[red]?[bold].mcap" in re.sub(r"[|\s]", "", flown.out)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize("json_too", [(), ("--json",)])
def test_a_full_disk_is_one_message(json_too):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "shefex_nav", "scenarios", *json_too],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "the output cannot be written: No space left on device\n"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize("to", [("/dev/full", "w"), (os.devnull, "r")])
def test_bad_input_ends_with_its_code_where_nothing_can_be_said(to, tmp_path):
    (tmp_path / "empty.yaml").touch()
    with open(*to) as nowhere:
        done = subprocess.run(
            [sys.executable, "-m", "shefex_nav", "check", tmp_path / "empty.yaml"],
            stderr=nowhere,
            check=False,
        )
    assert done.returncode == 2


@pytest.mark.parametrize("written", [False, True])
def test_an_old_log_is_not_called_what_was_flown(tmp_path, written, capsys):
    """Interrupted before the flight begins, with --force: the log of somebody else is as it was."""
    from shefex_nav.commands.flights import kept

    log = tmp_path / "old.mcap"
    log.write_bytes(b"somebody's")
    os.utime(log, (1e9, 1e9))
    with pytest.raises(KeyboardInterrupt), kept(log, "flown"):
        if written:
            log.write_bytes(b"what was flown")
        raise KeyboardInterrupt
    assert ("what was flown until now" in capsys.readouterr().err) == written


@pytest.mark.parametrize("name", ["run", "show"])
def test_a_seed_that_no_reader_of_logs_takes_is_refused_before_the_flight(command, name):
    """It was flown, and its log could not be read."""
    result = command(name, "rexus_like", "--seed", "1" + 30 * "0")
    assert (result.code, result.out) == (2, "")
    assert "--seed" in result.err and "30 digits at most" in result.err


def test_version_is_told(command):
    from shefex_nav import __version__

    result = command("--version")
    assert (result.code, result.out) == (0, f"shefex-nav {__version__}\n")


def test_an_earlier_run_keeps_its_name(tmp_path, monkeypatch):
    from shefex_nav.commands import run as run_command

    monkeypatch.chdir(tmp_path)
    names = [tmp_path / "logs" / f"one-seed1{n}.mcap" for n in ("", "-2", "-3")]
    assert run_command._free_name("one", 1) == (names[0].relative_to(tmp_path), None)
    for earlier, later in pairwise(names):
        earlier.touch()
        found = run_command._free_name("one", 1)
        assert found == (later.relative_to(tmp_path), earlier.relative_to(tmp_path))


def test_threads_that_python_waits_for_at_the_end_are_named(capsys):
    from shefex_nav.commands import app

    end = threading.Event()
    thread = threading.Thread(target=end.wait, name="pump")
    thread.start()
    app._tell_threads()
    end.set()
    thread.join()
    app._tell_threads()
    assert capsys.readouterr().err == "done; waiting for threads that own software has not ended: pump\n"
