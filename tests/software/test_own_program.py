"""Navigation software as a program of its own: standard input and output, TCP, UDP; C; how it may end."""

import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from own_flights import CLASS, STATISTICAL, flown, reckoning, same, template

from shefex_nav import plugins
from shefex_nav.errors import CodeError, SoftwareError
from shefex_nav.log import topics, wire
from shefex_nav.onboard import own_navigation
from shefex_nav.records import Frame, ImuBlock, NavHealth, NavSolution, StarFix
from shefex_nav.scenario.load import ScenarioError, load
from shefex_nav.software import channels, messages, remote
from shefex_nav.software.built_in import BuiltIn
from shefex_nav.software.server import serve

PROGRAM = f"{sys.executable} -m shefex_nav.software.built_in"
UNTIL_S = 1.6  # of night_sky: two pictures have been used


@pytest.fixture(scope="module")
def built_in():
    """Records of the built-in filter."""
    return flown("night_sky", until_s=UNTIL_S)


def test_by_standard_input_and_output_the_records_are_the_same(built_in):
    own = flown("night_sky", f"navigation.software={{command: {PROGRAM}}}", until_s=UNTIL_S)
    assert sum(isinstance(one, StarFix) for one in own) > 3 and same(own, built_in)


@pytest.mark.parametrize("kind", ["tcp", "udp"])
def test_by_the_network_the_records_are_the_same(built_in, kind):
    """The other end is a thread of this process."""
    with socket.socket(type=socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM) as one:
        one.bind(("127.0.0.1", 0))
        address = f"{kind}://127.0.0.1:{one.getsockname()[1]}"
    other = threading.Thread(target=serve, args=(BuiltIn(), address), daemon=True)
    other.start()
    own = flown("night_sky", f"navigation.software={{connect: '{address}'}}", until_s=UNTIL_S)
    other.join(10.0)
    assert not other.is_alive() and same(own, built_in)


def test_a_program_that_fails_shows_its_traceback_once(tmp_path):
    """It has said why, and writes to the terminal of the simulator."""
    program, path = tmp_path / "program.py", reckoning(tmp_path, "if self.ticks == 5: 1 / 0")
    program.write_text(
        "from own import Reckoning\nfrom shefex_nav.software import serve\nserve(Reckoning())\n"
    )
    own = f"navigation.software={{command: {sys.executable} {program}}}"
    words = [sys.executable, "-m", "shefex_nav", "run", "night_sky", "--trust", "--set", own, "--until", "1s"]
    run = subprocess.run(words, capture_output=True, text=True, timeout=120, cwd=tmp_path, check=False)
    assert path.exists() and run.returncode == 3
    assert run.stderr.count("Traceback") == 1 and run.stderr.count("ZeroDivisionError") == 1, run.stderr


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler, cc")
@pytest.mark.parametrize("until_s", [60.0, pytest.param(398.0, marks=pytest.mark.slow)])
def test_the_program_in_c_meets_what_the_mission_requires(until_s, tmp_path):
    """Through the boost, and down to entry; attitude is required with stars alone."""
    source = template("strapdown.c", tmp_path)
    template("shefex_fsw.h", tmp_path)
    shutil.copy(tmp_path / "my_shefex_fsw.h", tmp_path / "shefex_fsw.h")
    program = tmp_path / "strapdown"
    how = ["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-o", str(program), source, "-lm"]
    built = subprocess.run(how, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    software = f"navigation.software={{command: {program}}}"
    records = flown("shefex2_andoya", STATISTICAL, software, until_s=until_s + 1.0)
    truth = [one for one in records if type(one).__name__ == "TruthSample"]
    told = [one for one in records if isinstance(one, NavSolution)]
    k = next(n for n, one in enumerate(told) if one.t_s > until_s)
    assert np.linalg.norm(truth[k].r_i - told[k].r_i) < 10.0
    assert np.linalg.norm(truth[k].v_i - told[k].v_i) < 0.5
    turn = own_navigation.rotation.rotvec_between(told[k].q_ib, truth[k].q_ib)
    assert np.degrees(np.abs(turn)).max() < (0.17 if until_s > 300.0 else 1.2)


ENDS = (  # what a program does at tick 50, and what is said
    ("sys.exit(4)", "T+0.50 s: it ended with exit code 4"),
    ("os.kill(os.getpid(), 9)", "T+0.50 s: it was killed by signal 9"),
    ("1 / 0", r"T+0.50 s: failed:"),
    pytest.param(
        "time.sleep(30)", "T+0.50 s: no answer in time (answer_within: 5 s)", marks=pytest.mark.slow
    ),
)
OTHER = """
import os, sys, time
from shefex_nav.software import Estimate, serve


class Other:
    def start(self, alignment, mission):
        self.estimate, self.ticks = Estimate(alignment.r_i, alignment.v_i, alignment.q_ib), 0

    def step(self, imu, arrived):
        self.ticks += 1
        if self.ticks == 50:
            HERE
        print("this is no message")
        return self.estimate


serve(Other())
"""


@pytest.mark.parametrize(("here", "words"), ENDS)
def test_how_a_program_ends_is_told(tmp_path, here, words):
    path = tmp_path / "other.py"
    path.write_text(OTHER.replace("HERE", here))
    software = f"{{command: {sys.executable} {path}, answer_within: 5 s}}"
    with pytest.raises(SoftwareError, match=re.escape(words)):
        flown("night_sky", f"navigation.software={software}", until_s=1.0)


def test_an_answer_without_an_end_is_told(tmp_path):
    """A tick has a few records; a program that sends more and more would fill the memory."""
    path = tmp_path / "other.py"
    path.write_text(OTHER.replace("HERE", "return [self.estimate] * 1000"))
    software = f"{{command: {sys.executable} {path}, answer_within: 60 s}}"
    words = r"T\+0\.50 s: sent 1000 messages of \d+ bytes without Done; 1000 messages and 64 MiB are the most"
    with pytest.raises(SoftwareError, match=words):
        flown("night_sky", f"navigation.software={software}", until_s=1.0)


class Endless:
    """A channel on which the next message always has come already."""

    def __init__(self, record, pause_s=0.0):
        (self._message,) = messages.split(messages.pack(record))
        self._pause_s, self.sent = pause_s, 0

    def send(self, data, until_s):
        pass

    def receive(self, until_s):
        time.sleep(self._pause_s)
        self.sent += 1
        return self._message

    def close(self):
        pass


def asked_of(channel, within_s):
    """What is said of a program that is asked for a tick."""
    wire = remote.Remote(lambda until_s: channel, within_s, within_s)
    wire._channel = channel
    block = ImuBlock(0.01, 0.01, 0.0025, np.zeros((4, 3)), np.zeros((4, 3)), False)
    with pytest.raises(CodeError) as caught:
        wire.step(block, [])
    return str(caught.value)


def test_answer_within_is_that_of_the_whole_answer():
    """Each message is there at once, or soon, and the last one never."""
    slow = Endless(NavHealth(0.0, "gps", 0, ""), pause_s=0.02)
    assert asked_of(slow, 0.1) == "no answer in time (answer_within: 0.1 s)" and slow.sent < 8
    fast = Endless(NavHealth(0.0, "gps", 0, ""))
    assert asked_of(fast, 60.0).startswith("sent 1000 messages of") and fast.sent == 1000
    long = Endless(messages.Failed("")._replace(words="x"))
    assert asked_of(long, 60.0) == "failed:\nx" and long.sent == 1


def test_an_answer_of_too_many_bytes_is_told(monkeypatch):
    monkeypatch.setattr(remote, "MOST_BYTES", 3 << 20)
    large = Endless(messages.Pixels(1, 1 << 20, bytes(1 << 20)))
    assert asked_of(large, 60.0).startswith("sent 3 messages of 31") and large.sent == 3


def test_a_message_that_comes_in_parts_has_to_be_whole_in_time():
    """Bytes that are always there are no answer yet."""
    now_s, whole = time.monotonic(), messages.pack(messages.Done(1.0))
    buffer = channels.Buffer()
    buffer.add(whole[:-1], now_s + 60.0)
    buffer.add(b"", None)
    with pytest.raises(channels.Late):
        buffer.add(b"", now_s)
    buffer.add(whole[-1:], now_s)  # which has come, late or not
    assert buffer.next()[0] == "Done" and not buffer.begun


def test_a_new_program_names_itself(tmp_path, command):
    """Its head says how it is built and flown, under the name that was given; so does what is printed."""
    path = tmp_path / "my_fsw.c"
    made = command("new", "c", path)
    assert made.code == 0, made.err
    built, flown_by = made.err.splitlines()[1:3]
    head = path.read_text()[:800]
    assert built.strip() == f"cc -O2 -o {path.with_suffix('')} {path} -lm" and built.strip() in head
    assert flown_by.strip() in head and "{command: " + str(path.with_suffix("")) + "}" in head
    assert "./strapdown" not in head and "strapdown.c" not in head


def test_a_program_that_never_is_ready_is_told(tmp_path):
    """By a time of its own: answer_within is that of a tick."""
    path = tmp_path / "silent.py"
    path.write_text("import time\ntime.sleep(60)\n")
    software = f"{{command: {sys.executable} {path}, answer_within: 60 s, start_within: 0.5 s}}"
    with pytest.raises(SoftwareError, match=r"no answer in time \(start_within: 0\.5 s\)"):
        flown("night_sky", f"navigation.software={software}", until_s=1.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("{comand: ./fsw}", "navigation.software.comand: unknown key; did you mean 'command'?"),
        (
            "{conect: 'tcp://127.0.0.1:5005'}",
            "navigation.software.conect: unknown key; did you mean 'connect'?",
        ),
        (
            "{command: ./fsw, connect: 'tcp://127.0.0.1:5005'}",
            "names command and connect; expected one of them",
        ),
    ],
)
def test_keys_that_are_none(given, words):
    with pytest.raises(ScenarioError) as caught:
        load("night_sky", [f"navigation.software={given}"])
    assert words in str(caught.value)
    assert "python" not in str(caught.value)


RAW = """
import os, sys

sys.stdin.buffer.read(5)
for k in range(40):
    ANSWER
sys.stdin.buffer.read()
"""


def test_what_is_no_message_is_told(tmp_path):
    path = tmp_path / "raw.py"
    path.write_text(RAW.replace("ANSWER", "print('hello, this is no message', flush=True)"))
    software = f"{{command: {sys.executable} {path}, answer_within: 5 s}}"
    with pytest.raises(SoftwareError, match="it wrote something that is no message: b'hello, this is no"):
        flown("night_sky", f"navigation.software={software}", until_s=1.0)


def test_an_answer_of_another_tick_is_not_taken(tmp_path):
    """Two Done for one tick would give every later tick the estimate of the one before."""
    path = tmp_path / "other.py"
    here = "from shefex_nav.software.messages import Done; return [self.estimate, Done(imu.t_valid_s)]"
    path.write_text(OTHER.replace("HERE", here))
    software = f"{{command: {sys.executable} {path}, answer_within: 5 s}}"
    with pytest.raises(SoftwareError, match=r"T\+0.51 s: said Done of T\+0.500 s where that of T\+0.510 s"):
        flown("night_sky", f"navigation.software={software}", until_s=1.0)


@pytest.mark.slow
def test_readings_of_a_plugin_reach_a_program(tmp_path):
    """The built-in filter in this process and as a program use the same measurements."""
    template("sensor.py", tmp_path)
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(
        "extends: rexus_like\nplugins: [my_sensor.py]\n"
        "radar_altimeter: {rate: 5 Hz, latency: 10 ms, bias: 1 m, noise: 2 m}\n"
        "navigation: {states: [altimeter_bias]}\n"
    )
    here = flown(str(scenario), until_s=1.0)
    own = flown(str(scenario), f"navigation.software={{command: {PROGRAM}}}", until_s=1.0)
    assert any(type(one).__name__ == "GateResult" and "altimeter" in one.sensor for one in here)
    assert same(own, here)


def test_a_program_is_run_with_consent_only_and_is_that_of_the_log(tmp_path):
    path = tmp_path / "other.py"
    path.write_text(OTHER.replace("HERE", "pass"))
    scenario = tmp_path / "mine.yaml"
    scenario.write_text(
        f"extends: night_sky\nnavigation: {{software: {{command: {sys.executable} other.py}}}}\n"
    )
    with pytest.raises(ScenarioError, match="give --trust"):
        load(str(scenario))
    software = load(str(scenario), trust=True).navigation.software
    assert software.command.endswith(str(path))
    path.write_text(path.read_text() + "\n")
    with pytest.raises(plugins.PluginError, match="is another program than the one that was flown"):
        plugins.program(software.command.split(), software.sha256)


def test_messages_come_back_as_they_were_and_are_protobuf(built_in):
    """By the codec of logs, which is google.protobuf for all that has no fixed layout, they read the same."""
    kinds = {}
    for one in built_in:
        kinds.setdefault(type(one), one)
    assert len(kinds) > 7
    for kind, one in kinds.items():
        topic = topics.of_record(kind)
        ((name, body),) = messages.split(messages.pack(one))
        assert name == topic.schema
        again = messages.unpack(name, body)
        if kind is Frame:
            one = one._replace(image_dn=None)  # which stays where it is
        assert same(again, one), kind
        read = wire.message_class(topic).FromString(body)
        for field in topic.fields:
            value, read_value = attrgetter(field.source)(one), getattr(read, field.name)
            assert np.array_equal(np.ravel(value), np.ravel(read_value), equal_nan=field.kind == "double")


def test_what_an_estimate_does_not_say_need_not_be_sent():
    """As google.protobuf writes it: three fields alone, and numbers as they are written one by one."""
    (topic,) = (one for one in messages.OWN if one.schema == "Estimate")
    message = wire.message_class(topic)()
    message.r_i_m.extend([1.0, 2.0, 3.0])
    message.v_i_m_s.extend([4.0, 5.0, 6.0])
    message.q_ib.extend([1.0, 0.0, 0.0, 0.0])
    message.do_not_use_velocity = True
    told = messages.estimate_received(messages.unpack("Estimate", message.SerializeToString()))
    assert told.P is None and told.usable == (True, False, True) and list(told.v_i) == [4.0, 5.0, 6.0]
    with pytest.raises(ValueError, match="not a message Estimate"):
        messages.unpack("Estimate", b"\x12\x18\x00")


def test_all_messages_are_in_the_proto_text():
    """The text says what the descriptors say."""
    text = messages.proto()
    for topic in (*messages.OWN, *topics.topics()):
        assert f"message {topic.schema} {{" in text
    numbers = re.search(r"message ImuBlock \{.*?\n\}", text, re.S)[0]
    assert "repeated double dtheta_b_rad = 5;" in numbers and "bool valid = 8;" in numbers


def test_built_in_by_name_and_class_are_two_ways():
    assert load("night_sky", ["navigation.software=built_in"]).navigation.software == "built_in"
    assert load("night_sky", [f"navigation.software={CLASS}"], trust=True).navigation.software.sha256


def _runs(pid):
    """Whether a process is there and not dead; nobody may have asked for its exit code yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="the system has no /proc")
def test_what_a_program_has_started_ends_with_it(tmp_path):
    noted, until_s = tmp_path / "pid", time.monotonic() + 30.0
    pipe = channels.Pipe(["sh", "-c", f"sleep 300 & echo $! > {noted}; exec cat"])
    while not (noted.exists() and noted.read_text().strip()) and time.monotonic() < until_s:
        time.sleep(0.02)
    pid = int(noted.read_text())
    assert _runs(pid)
    pipe.close()
    while _runs(pid) and time.monotonic() < until_s:
        time.sleep(0.02)
    assert not _runs(pid)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such signal")
def test_a_program_that_hangs_ends_with_the_simulator_however_that_ends():
    """`sleep` never reads its standard input, whose end others take for theirs."""
    code = (
        "from shefex_nav.software import channels\n"
        "pipe = channels.Pipe(['sleep', '300'])\nprint(pipe._process.pid, flush=True)\ninput()"
    )
    run = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    pid, until_s = int(run.stdout.readline()), time.monotonic() + 30.0
    assert _runs(pid)
    run.kill()
    run.communicate()
    while _runs(pid) and time.monotonic() < until_s:
        time.sleep(0.02)
    assert not _runs(pid)


def test_serve_is_a_function_after_it_has_served():
    """Python puts a submodule of the same name in its place when that is imported."""
    code = "import shefex_nav.software.server\nfrom shefex_nav.software import serve\nassert callable(serve)"
    subprocess.run([sys.executable, "-c", code], check=True)
