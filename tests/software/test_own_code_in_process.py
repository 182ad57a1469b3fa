"""Python software of a user's own that hangs, ends the process or prints: what the command makes of it."""

import json
import signal
import subprocess
import sys
import time

import pytest

from shefex_nav import plugins
from shefex_nav.errors import SoftwareError
from shefex_nav.scenario import software
from shefex_nav.scenario.load import Scenario, ScenarioError
from shefex_nav.software import flown

SHORT = [part for one in ("star_tracker.off=3 s", "mission.time_limit=4 s") for part in ("--set", one)]
BUILT_IN = "from shefex_nav.software.built_in import BuiltIn\n"
RUN = [sys.executable, "-m", "shefex_nav", "run", "night_sky", *SHORT]


def words(folder, code):
    """Words of a command that flies a class `Own` of this code."""
    (folder / "own.py").write_text(code)
    own = ["--set", f"navigation.software={folder / 'own.py'}:Own", "--trust"]
    return [*RUN, *own, "--out", str(folder / "own.mcap")]


def test_code_that_hangs_is_ended_by_the_second_signal(tmp_path):
    """It never gives the next record, between two of which the first one would end the flight."""
    code = f"import time\n{BUILT_IN}class Own(BuiltIn):\n    def step(self, imu, arrived):\n        "
    code += "print('hangs', flush=True)\n        time.sleep(600.0)\n"
    flying = subprocess.Popen(words(tmp_path, code), stderr=subprocess.PIPE, text=True)
    try:
        for line in flying.stderr:
            if line == "hangs\n":
                break
        flying.send_signal(signal.SIGTERM)
        time.sleep(0.5)
        assert flying.poll() is None
        flying.send_signal(signal.SIGTERM)
        _, said = flying.communicate(timeout=60)
    finally:
        flying.kill()
    assert flying.returncode == 130 and said.splitlines()[-1] == "interrupted"


@pytest.mark.parametrize("code", [0, 3])
def test_code_that_ends_the_process_when_it_is_read_is_named(code, tmp_path):
    ends = words(tmp_path, f"raise SystemExit({code})\n")
    done = subprocess.run(ends, capture_output=True, text=True, timeout=100)
    assert done.returncode == 2 and f"own.py:1: SystemExit: {code}" in done.stderr


def test_code_that_ends_the_process_when_it_is_made_has_failed(monkeypatch):
    """The command would end with exit code 0 and say nothing."""
    own = software.Own(python="mine.py:Ends")
    monkeypatch.setattr(plugins, "software", lambda *_: (None, Ends))
    with pytest.raises(SoftwareError, match=r"cannot be made.*SystemExit: 0"):
        flown._made(own)


class Ends:
    def __init__(self):
        sys.exit(0)


def test_what_is_printed_when_code_is_read_is_no_result(tmp_path):
    prints = words(tmp_path, f"print('words')\n{BUILT_IN}class Own(BuiltIn):\n    pass\n")
    done = subprocess.run([*prints, "--json"], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0 and "words" in done.stderr.splitlines()
    assert json.loads(done.stdout)["scenario"] == "night_sky"


@pytest.mark.skipif(sys.platform == "win32", reason="a shell closes the streams")
@pytest.mark.parametrize("command, closed, code", [("check night_sky", ">&-", 2), ("check none", "2>&-", 2)])
def test_a_stream_that_is_closed_takes_nothing_unsaid(command, closed, code):
    whole = f"'{sys.executable}' -m shefex_nav {command} {closed}"
    done = subprocess.run(["sh", "-c", whole], capture_output=True, text=True, timeout=100)
    assert done.returncode == code and "Traceback" not in done.stderr


@pytest.mark.parametrize("number", [1, 2])
def test_a_stream_that_own_code_closes_is_told_in_words(tmp_path, number):
    step = f"    def step(self, imu, arrivals):\n        os.close({number})\n"
    closes = words(tmp_path, f"import os\n{BUILT_IN}class Own(BuiltIn):\n{step}")
    done = subprocess.run(closes, capture_output=True, text=True, timeout=100)
    said = f"has closed file descriptor {number}, a stream of the program"
    assert done.returncode == 3 and said in done.stderr and "Traceback" not in done.stderr


def test_own_code_that_goes_to_another_folder_takes_the_log_nowhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    step = "    def step(self, *given):\n        os.chdir('/')\n        return super().step(*given)\n"
    goes = words(tmp_path, f"import os\n{BUILT_IN}class Own(BuiltIn):\n{step}")
    done = subprocess.run([*goes[:-1], "here.mcap"], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0 and (tmp_path / "here.mcap").stat().st_size > 1000, done.stderr


def test_a_quote_without_its_other_half_is_told(tmp_path):
    (tmp_path / "own.yaml").write_text(
        'extends: night_sky\nnavigation:\n  software: {command: "python \'own.py"}\n'
    )
    with pytest.raises(ScenarioError, match=r"own\.yaml:3:.* python 'own\.py cannot be split into words"):
        Scenario.load(tmp_path / "own.yaml")
