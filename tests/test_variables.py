"""Environment variables that libraries cannot read: one message that names the variable, and no traceback."""

import os
import subprocess
import sys

import pytest

from shefex_nav.commands import shell

WRONG = {
    "SOURCE_DATE_EPOCH=abc": "a whole number of seconds since 1970",
    "NUMBA_NUM_THREADS=abc": "a whole number of threads",
    "NUMBA_OPT=abc": "a value that numba can read",
    "MPLBACKEND=garbage": "a backend that matplotlib knows",
}


def checked(setting):
    """`check` of a good scenario with a variable that is set."""
    name, _, value = setting.partition("=")
    command = [sys.executable, "-m", "shefex_nav", "check", "night_sky"]
    return subprocess.run(command, env={**os.environ, name: value}, capture_output=True, text=True)


@pytest.mark.parametrize("setting", WRONG)
def test_what_a_library_cannot_read_is_one_message(setting):
    name, _, value = setting.partition("=")
    done = checked(setting)
    assert done.returncode == 2 and done.stdout == "" and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"environment variable {name}: got '{value}', expected {WRONG[setting]}")


@pytest.mark.parametrize("setting", ["SOURCE_DATE_EPOCH=0", "NUMBA_OPT=2", "MPLBACKEND=tkagg"])
def test_what_they_can_read_is_no_mistake(setting):
    assert checked(setting).returncode == 0


@pytest.mark.parametrize(
    "value", ["", " 1", "1_0", "-1", "1.5", "\u0661", "253402300800", "9" * 5000], ids=range(8)
)
def test_seconds_that_are_none(value):
    with pytest.raises(shell.VariableError, match="SOURCE_DATE_EPOCH"):
        shell.check({"SOURCE_DATE_EPOCH": value})


def test_no_library_is_loaded_for_what_the_program_sets_itself():
    code = (
        "import os, sys; from shefex_nav.commands import shell; "
        "os.environ.update(MPLBACKEND='Agg', SOURCE_DATE_EPOCH='1'); shell.check(); "
        "assert not {'numba', 'matplotlib'} & set(sys.modules)"
    )
    plain = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    subprocess.run([sys.executable, "-c", code], check=True, env=plain)


def test_threads():
    for value in ("0", "x"):
        with pytest.raises(shell.VariableError, match="NUMBA_NUM_THREADS"):
            shell.check({"NUMBA_NUM_THREADS": value})
