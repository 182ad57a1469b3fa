"""Python files that lie in the current folder are not run by the processes that a command starts."""

import os
import subprocess
import sys
import textwrap

from shefex_nav import children

TRAP = "from pathlib import Path\nPath('run').touch()\nraise SystemExit('of the current folder')\n"
NAMES = "multiprocessing", "numpy", "json", "shefex_nav", "encodings"


def trapped(folder):
    """A folder with files named like modules, which leave a file `run` there."""
    for name in NAMES:
        (folder / f"{name}.py").write_text(TRAP)
    return folder


def said(program, folder):
    """What a program prints that is started as the command line is: its folder is not looked in."""
    command = [sys.executable, "-P", "-c", textwrap.dedent(program)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


def test_workers_run_nothing_of_the_current_folder(tmp_path):
    program = """
        import sys, os
        from shefex_nav import workers

        os.environ.pop("PYTHONSAFEPATH", None)  # -P is told to children, too: as if it were not
        import multiprocessing.util
        multiprocessing.util._args_from_interpreter_flags = lambda: []
        pool = workers.Pool(1)
        print(pool.submit(os.getenv, "PYTHONSAFEPATH").result())
        pool.stop()
    """
    done = said(program, trapped(tmp_path))
    assert (done.returncode, done.stdout) == (0, "None\n"), done.stderr
    assert not (tmp_path / "run").exists()


def test_a_module_of_the_package_is_not_looked_for_in_the_current_folder(tmp_path):
    command, environment = children.of_module("shefex_nav", "--version")
    done = subprocess.run(command, env=environment, cwd=trapped(tmp_path), capture_output=True, timeout=120)
    assert done.returncode == 0 and done.stdout.startswith(b"shefex-nav "), done.stderr
    assert not (tmp_path / "run").exists()


def test_what_a_user_has_set_stays(monkeypatch):
    monkeypatch.setenv(children.SAFE, "1")
    with children.safe():
        assert os.environ[children.SAFE] == "1"
    children.begun()
    assert os.environ[children.SAFE] == "1"


def test_what_a_worker_prints_is_no_result():
    program = """
        import os
        from shefex_nav import workers

        if __name__ == "__main__":
            pool = workers.Pool(1)
            pool.submit(os.write, 1, b"said by a plug-in").result()
            pool.stop()
            print("{}")
    """
    done = said(program, None)
    assert (done.returncode, done.stdout, done.stderr) == (0, "{}\n", "said by a plug-in")
