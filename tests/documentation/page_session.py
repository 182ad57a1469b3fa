"""Runs the blocks of a page one after the other, as a reader would, in a folder that looks like the project.

Commands and flights run in this process; flights end after seconds.
"""

import contextlib
import io
import itertools
import json
import shlex
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
from short_campaign import HereLane

from shefex_nav import simulate
from shefex_nav.campaign import engine
from shefex_nav.commands.app import main
from shefex_nav.scenario import load, shipped

ROOT = Path(__file__).parents[2]
HERE = ("mkdir", "cp", "ls", "cat")  # programs of the shell that are run as they are
BRIEF = {  # frames within the seconds that are flown
    "scenarios/shefex2_andoya.yaml": {"  on: 234 s": "  on: 1 s", "  off: 385 s": "  off: 3 s"},
}
CAMPAIGN = """# two seconds on the ground in place of the real one
extends: night_sky.yaml
mission: {name: shefex2_dispersed, time_limit: 2 s}
star_tracker: {enabled: false, off: 2 s}
dispersions:
  ground.latitude: {uniform: [-1 deg, 1 deg]}
  imu.gyro.bias: {log_normal: 20 %}
"""


class BlockError(AssertionError):
    """A block did not do what a reader would expect of it."""


class Session:
    """A reader: a folder with the scenarios, and the names that Python knows by now."""

    def __init__(self, folder, monkeypatch):
        self.folder, self.names, self.count = folder, {"__name__": "page"}, itertools.count(1)
        self.end_s = np.inf
        shutil.copytree(ROOT / "scenarios", folder / "scenarios")
        for name, changes in BRIEF.items():
            _replace(folder / name, changes)
        (folder / "scenarios" / "shefex2_dispersed.yaml").write_text(CAMPAIGN)
        monkeypatch.chdir(folder)
        monkeypatch.syspath_prepend(folder)  # files of a page import each other
        monkeypatch.setattr(shipped, "folder", lambda: str(folder / "scenarios"))
        monkeypatch.setattr(engine, "ProcessLane", HereLane)
        monkeypatch.setattr(simulate, "route", self._brief(simulate.route))

    def _brief(self, route):
        """`simulate.route` that ends where the page wants it."""

        def brief(*given, until_s=np.inf, **named):
            return route(*given, until_s=min(until_s, self.end_s), **named)

        return brief

    def run(self, block, name):
        """Run one block of page `name`; BlockError if it fails."""
        if block.reason:
            return
        self.end_s = block.end_s
        where = f"{name}:{block.line}"
        try:
            getattr(self, f"_{block.kind}")(block, where)
        except BlockError as error:
            raise BlockError(f"{where}: {error}") from error
        except Exception as error:
            raise BlockError(f"{where}: {type(error).__name__}: {error}") from error

    def _text(self, block, where):
        """Shown, not run."""

    def _file(self, block, where):
        path = self.folder / block.file
        if not path.parent.is_dir():
            raise BlockError(f"the page has not made the folder of {block.file}")
        path.write_text(block.text)

    def _json(self, block, where):
        json.loads(block.text)

    def _yaml(self, block, where):
        """A whole scenario, or a fragment that is added to one."""
        whole = any(line.startswith("extends:") for line in block.text.splitlines())
        head = "" if whole else f"extends: {block.base}\n"
        path = self.folder / f"fragment{next(self.count)}.yaml"
        path.write_text(head + block.text)
        load.load(path)

    def _python(self, block, where):
        code = compile("\n" * block.line + block.text, where, "exec")
        with contextlib.redirect_stdout(io.StringIO()):
            exec(code, self.names)

    def _sh(self, block, where):
        lines = block.text.replace("\\\n", " ").splitlines()
        for line in lines:
            words = shlex.split(line, comments=True)
            if words:
                self._command(words, line)

    def _command(self, words, line):
        target = None
        if ">" in words:
            target = words[words.index(">") + 1]
            words = words[: words.index(">")]
        if words[:2] == ["uv", "run"]:
            words = words[2:]
        if words[0] in HERE:
            subprocess.run(words, check=True, cwd=self.folder)
        elif words[0] == "shefex-nav":
            code, out, err = self.shefex_nav(words[1:])
            if code != 0:
                raise BlockError(f"{line!r} ends with exit code {code}: {err[-1500:]}")
            if target:
                (self.folder / target).write_text(out)
        else:
            raise BlockError(f"{line!r} is not known here; run by hand? then say '<!-- not run: why -->'")

    def shefex_nav(self, arguments):
        """The command line in this process. -> (exit code, stdout, stderr)"""
        arguments = list(arguments)
        shown = {"--save", "--screenshot", "--web"} & set(arguments)
        if arguments[0] == "view" and not shown:  # would open a window: its recording is written
            arguments += ["--save", f"view{next(self.count)}.rrd"]
        out, err, before, code = io.StringIO(), io.StringIO(), sys.argv, 0
        sys.argv = ["shefex-nav", *arguments]
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
                main()
        except SystemExit as end:
            code = end.code or 0
        finally:
            sys.argv = before
        return code, out.getvalue(), err.getvalue()


def _replace(path, changes):
    text = path.read_text()
    for old, new in changes.items():
        if old not in text:
            raise BlockError(f"{path.name}: {old!r} is not there any more")
        text = text.replace(old, new)
    path.write_text(text)


__all__ = ["ROOT", "BlockError", "Session"]
