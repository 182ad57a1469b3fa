"""Spoilt answers of navigation software, spoilt command lines, and a picture, for `fuzz`."""

import contextlib
import io
import os
import shlex
import sys

import mutations
import numpy as np
import typer

from shefex_nav.errors import UserError
from shefex_nav.scenario import load

FLOWN_S = 0.3  # with the answers
ODD_WORDS = (
    "", " ", "-", "--", "-1", "0", "nan", "1e308", "99999999999999999999", "T+1s", "[bold]", "[/]",
    "\x1b[31m", "ü", "x" * 300, "a=b", "=", "imu", "imu.gyro.bias", "seed=", "..", "/", "/dev/null",
    "/etc/passwd", "nowhere.yaml", "night_sky", "{", "[", "--json", "--seed", "--set", "--out",
    "--until", "--help",
)  # fmt: skip
COMMANDS = (  # which end in a second or two; what they write goes into the folder of the case
    "run night_sky --until 1s --seed 3 --set gps.rate='5 Hz' --out out.mcap --force",
    "check night_sky --set gps.rate='5 Hz' --json",
    "report whole.mcap --json",
    "report whole.mcap --html page.html --force",
    "export whole.mcap --csv tables --force",
    "export whole.mcap --kml track.kml --force",
    "export whole.mcap --parquet tables --force",
    "scenarios --json",
    "instruments",
    "schema",
    "new scenario mine.yaml",
    "solve picture.png --fov 20deg --json",
    "vehicle shefex2_andoya --json",
    "compare whole.mcap whole.mcap --json",
)


class Playback:
    """A program that answers what it is made of, whatever it is asked: in the place of channels.Pipe."""

    def __init__(self, answers):
        from shefex_nav.software import channels

        self._buffer, self._answers, self._gone = channels.Buffer(), answers, channels.Silent

    def send(self, data, until_s):
        """Nobody listens."""

    def receive(self, until_s):
        """The next message; some bytes come at once, as they do from a program."""
        while (message := self._buffer.next()) is None:
            if not self._answers:
                raise self._gone("it ended with exit code 0")
            self._buffer.add(self._answers[:4096])
            self._answers = self._answers[4096:]
        return message

    def close(self):
        """Nothing is open."""


class _Recorded:
    """A program whose answers are kept."""

    def __init__(self, pipe):
        self._pipe, self.send, self.close = pipe, pipe.send, pipe.close
        self.bytes = b""

    def receive(self, until_s):
        from shefex_nav.software.messages import HEAD

        name, body = self._pipe.receive(until_s)
        head = name.encode("ascii")
        self.bytes += HEAD.pack(1 + len(head) + len(body), len(head)) + head + body
        return name, body


def software_scenario():
    """The scenario whose navigation is a program: the built-in filter in a process of its own."""
    words = f"{sys.executable} -m shefex_nav.software.built_in"
    return load.load("night_sky", [f"navigation.software={{command: {words}}}"], trust=True)


def answers(scenario):
    """Bytes that the program of a scenario answers in a flight."""
    from shefex_nav.software import channels

    programs, start = [], channels.Pipe

    def begun(words):
        programs.append(_Recorded(start(words)))
        return programs[-1]

    fly(scenario, begun)
    return programs[-1].bytes


def fly(scenario, begun):
    """RunData of a short flight. begun : function of the words of a command that gives its channel"""
    from shefex_nav import runs
    from shefex_nav.software import channels

    before, channels.Pipe = channels.Pipe, begun
    try:
        return runs.fly(scenario, 1, until_s=scenario.mission.start + FLOWN_S).data
    finally:
        channels.Pipe = before


def command_line(rng):
    """Words of a command, of which one to three are changed."""
    words = shlex.split(COMMANDS[rng.integers(len(COMMANDS))])
    for _ in range(1 + rng.integers(mutations.MOST)):
        at, way = int(rng.integers(len(words) + 1)), rng.integers(5)
        odd = ODD_WORDS[rng.integers(len(ODD_WORDS))]
        if way == 0:
            words.insert(at, odd)
        elif way == 1:
            words[at : at + 1] = [odd]
        elif way == 2:
            del words[at : at + 1]
        elif way == 3 and at < len(words):
            words.append(words[at])
        elif at < len(words):
            words[at] = mutations.data(rng, words[at].encode()).decode(errors="replace").replace("\0", "")
    return words


def carry_out(words, folder):
    """Carry out a command in a folder: what it prints on stdout; UserError where it is refused."""
    from shefex_nav.commands.app import app

    before = os.getcwd()
    os.chdir(folder)
    try:
        printed, said = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
            code = _code(app, words)
    finally:
        os.chdir(before)
    if code:
        raise UserError(said.getvalue())
    return printed.getvalue()


def _code(app, words):
    """Exit code of a command line."""
    try:
        app(words)
    except SystemExit as ended:
        return 0 if ended.code is None else ended.code
    except typer.Exit as ended:
        return ended.exit_code
    return 0


def picture(path):
    """Bytes of a picture that is written to a path, whose suffix says the format."""
    from astropy.io import fits
    from PIL import Image

    rng = np.random.default_rng(0)
    grey = rng.normal(20.0, 2.0, (240, 320))
    y, x = np.mgrid[:240, :320]
    for u, v, light in zip(
        rng.uniform(5, 315, 40), rng.uniform(5, 235, 40), rng.uniform(40, 200, 40), strict=True
    ):
        grey += light * np.exp(-0.5 * ((x - u) ** 2 + (y - v) ** 2) / 1.2**2)
    grey = np.clip(grey, 0, 255).astype(np.uint8)
    if path.suffix == ".fits":
        fits.writeto(path, grey)
    else:
        Image.fromarray(grey).save(path)
    return path.read_bytes()
