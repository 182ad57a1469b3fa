"""Ctrl-C at any moment: one line on stderr, exit code 130, no traceback, no process that is left."""

import os
import signal
import subprocess
import sys
import time

import pytest

from shefex_nav.errors import UserError
from shefex_nav.stopping import handled

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
AT_AN_IMPORT = """
import os, runpy, signal, sys
wanted, *words = sys.argv[1:]
class Interrupts:
    def find_spec(name, path=None, target=None):
        if name == wanted:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupts)
sys.argv = ["shefex-nav", *words]
runpy.run_module("shefex_nav", run_name="__main__")
"""
WITH_SCHEMA = """
import atexit, os, signal, sys
from shefex_nav.commands.main import main
from shefex_nav.scenario import json_schema
sys.argv = ["shefex-nav", "schema"]
interrupt = lambda: os.kill(os.getpid(), signal.SIGINT)
{}
main()
"""


def started(code, *words, handler=signal.SIG_DFL, cwd=None):
    """(exit code, stdout, stderr) of Python code in a process of its own, with a group of its own."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)],
        capture_output=True, text=True, timeout=120, check=False, cwd=cwd, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, handler),
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    "module",
    [
        "shefex_nav.compiled",
        "shefex_nav.commands.app",
        "typer",
        "shefex_nav.commands.winds",
        "numpy",
        "numba",
    ],
)
def test_while_it_imports_what_it_needs(module, tmp_path):
    words = "run", "night_sky", "--until", "1s", "--out", tmp_path / "night.mcap"
    code, out, err = started(AT_AN_IMPORT, module, *words, cwd=tmp_path)
    assert (code, out, err.splitlines()[-1:]) == (130, "", ["interrupted"]), err
    assert "Traceback" not in err and err.count("nterrupt") == 1
    assert not list(tmp_path.iterdir())


class Lost:
    """Python cannot raise what happens in a destructor."""

    def __del__(self):
        send()
        time.sleep(1e-3)


def send():
    os.kill(os.getpid(), signal.SIGINT)


def plain():
    send()
    time.sleep(10.0)


def swallowed():
    try:
        plain()
    except KeyboardInterrupt:
        return {}


def lost():
    Lost()
    time.sleep(10.0)


def becomes(error):
    def function():
        try:
            plain()
        except KeyboardInterrupt:
            raise error from None

    return function


WAYS = {
    "plain": plain,
    "lost in a destructor": lost,
    "of compiled code": becomes(SystemError("returned NULL without setting an exception")),
    "of a library": becomes(ImportError("numpy._core.multiarray failed to import")),
    "bad input": becomes(UserError("the file cannot be read")),
    "of the disk": becomes(OSError(5, "Input/output error")),
}


@pytest.mark.parametrize("way", WAYS)
def test_whatever_becomes_of_the_exception(way, command, monkeypatch):
    monkeypatch.setattr("shefex_nav.scenario.json_schema.json_schema", WAYS[way])
    began_s = time.monotonic()
    with handled({signal.SIGINT: signal.default_int_handler}):  # a shell may have had it ignored
        done = command("schema")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert (done.code, done.out, done.err) == (130, "", "interrupted\n")
    assert time.monotonic() - began_s < 8.0


def test_not_within_the_compiler_whose_c_code_would_crash(command, monkeypatch):
    """A function whose file is one of numba's; it ends by itself, and what follows is interrupted."""
    ended, scope = [], {"plain": plain, "send": send, "time": time}
    code = "def compiles():\n    send()\n    time.sleep(0.3)\n"
    exec(compile(code, "/lib/numba/core/dispatcher.py", "exec"), scope)

    def schema():
        scope["compiles"]()
        ended.append(True)
        time.sleep(10.0)

    monkeypatch.setattr("shefex_nav.scenario.json_schema.json_schema", schema)
    began_s = time.monotonic()
    with handled({signal.SIGINT: signal.default_int_handler}):
        done = command("schema")
    assert (done.code, done.err, ended) == (130, "interrupted\n", [True])
    assert time.monotonic() - began_s < 8.0


def test_one_that_is_swallowed_leaves_no_success(command, monkeypatch):
    monkeypatch.setattr("shefex_nav.scenario.json_schema.json_schema", swallowed)
    with handled({signal.SIGINT: signal.default_int_handler}):
        done = command("schema")
    assert (done.code, done.err) == (130, "interrupted\n")


END = """
def schema():
    {}
    return {{"a": 1}}
json_schema.json_schema = schema
"""
ENDS = {
    # Python ends itself by the signal, with code -2, if nothing is done about it
    "inside of text that is run": ('exec("interrupt()\\nfor k in range(10**9): pass")', 130, ""),
    "after the work": ("atexit.register(interrupt)", 130, "{"),
}


@pytest.mark.parametrize("when", ENDS)
def test_at_its_end(when):
    what, wanted, printed = ENDS[when]
    code, out, err = started(WITH_SCHEMA.format(END.format(what)))
    assert (code, out[:1]) == (wanted, printed) and err == ("interrupted\n" if code else ""), err


def test_after_all():
    """What is registered before the process begins is called after all that it registers."""
    code, out, err = started(WITH_SCHEMA.format(f"atexit.register(interrupt)\n{END.format('pass')}"))
    assert (code, out[:1], err) == (0, "{", "")


def test_a_shell_that_has_it_ignored_keeps_it_so():
    """As with `&` in a script, whose Ctrl-C is not for what runs beside it."""
    code, out, err = started(WITH_SCHEMA.format(END.format("interrupt()")), handler=signal.SIG_IGN)
    assert (code, out[:1], err) == (0, "{", "")


GROUP = """
import os, signal, sys, time
from shefex_nav.workers import Pool
if __name__ == "__main__":
    pool = Pool(2)
    signal.signal(signal.SIGINT, lambda *_: None)  # of this one alone: spawned ones have Python's own
    futures = [pool.submit(pow, 2, k) for k in range(2)]
    for _ in range(30):  # while they start
        time.sleep(0.02)
        os.killpg(0, signal.SIGINT)
    print([future.result() for future in futures])
    pool.stop()
"""


def test_workers_leave_it_to_the_program_from_their_first_moment_on(tmp_path):
    (tmp_path / "group.py").write_text(GROUP)
    code = "import runpy, sys; sys.argv = ['group.py']; runpy.run_path('group.py', run_name='__main__')"
    assert started(code, cwd=tmp_path) == (0, "[1, 2]\n", "")
