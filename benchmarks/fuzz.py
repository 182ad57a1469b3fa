"""Spoilt scenarios, logs, pictures, recorded data, answers and commands: is each read, or refused in words?

uv run python benchmarks/fuzz.py [KIND ...] [--first 0] [--cases 1000] [--minutes M] [--whole N] [--json FILE]

Case k of a kind is made from seed k alone: a file that the package or this script brings, with one to three
changes (`mutations`). It goes, in this process, to what the commands call: scenarios are loaded, and every
third that is good has its flight looked at, as `check` does; flights are scenarios of which the good ones
are flown and looked at for their first seconds, one of N to its end if that is not far; logs are read; fields
are logs with other values in them, given to a command; pictures are solved; fits are pictures with other
cards in their heads, read; winds are soundings, forecasts and tables of wind; studies are lines of `verify
robustness`, read back; models are DAVE-ML and check-cases; data (CSV), kf_gins and matlab
are recorded data, which are replayed; a second is flown with what navigation software answers in its own
process; command lines are carried out. Bad: an exception that is no UserError, more than 10 s of the
processor (of a flight a minute), more than 2 GB beside what the process had, a NaN in what a flight or a
replay logs, in a warning or in what is said of a log. Prints each bad case, then a line a kind. Exit code 1
if there was a bad one. A case that does not end ends the study with a traceback; its folder, which is printed
at first, then stays, with its number. `--first` goes on where another run has ended.
"""

import argparse
import collections
import contextlib
import faulthandler
import json
import re
import resource
import sys
import tempfile
import time
import traceback
import warnings
from functools import cache, partial
from pathlib import Path

import fuzz_logs
import fuzz_programs
import fuzz_recorded
import fuzz_texts
import mutations
import numpy as np
from fuzz_kind import Kind

from shefex_nav.errors import UserError
from shefex_nav.scenario import document, load

ROOT = Path(__file__).resolve().parent.parent
SCENARIOS = sorted((ROOT / "scenarios").glob("*.yaml"))
MOST_BYTES = 2e9
CHECKED = 3  # of how many good scenarios one has its flight looked at, as `check` does
NO_NUMBER = re.compile(r"\b(nan|inf)\b")  # in what is said
LOOKED_AT_S = 5.0  # of a flight
NUMBERS = {"covariance": ("t_s", "P", "estimates", "sigmas")}  # in which none may be NaN
SHORT_S = 1500.0  # longest time limit of a flight that is looked at to its end
STUCK = 20  # a case that takes as many times longer than it may ends the study
TOLD = 500  # after how many cases a line says how far it is
FORMATS = "png", "tif", "jpg", "webp", "fits"


class Scenarios(Kind):
    """Scenarios of the package: their trees, sometimes their text."""

    def __init__(self, folder):
        super().__init__(folder)
        (self.folder / "data").symlink_to(ROOT / "scenarios" / "data")  # which they name

    def case(self, rng):
        source = SCENARIOS[rng.integers(len(SCENARIOS))]
        text = source.read_text()
        if rng.integers(5):
            spoilt = _text(mutations.tree(rng, _whole(source))).encode()
        else:
            spoilt = mutations.data(rng, text.encode())
        (self.folder / "case.yaml").write_bytes(spoilt)

    def read(self, rng):
        from shefex_nav.commands import check

        path = str(self.folder / "case.yaml")
        if rng.integers(CHECKED):
            load.load(path)
        else:
            for one in check.checked(path, (), None).warnings:
                if NO_NUMBER.search(one.text):
                    raise ValueError(f"a warning without a number: {one.text}")


class Flights(Scenarios):
    """Scenarios that are flown if they are good, and looked at for a time."""

    longest_s = 60.0
    whole = 10  # of how many one is looked at to its end, 0: none

    def case(self, rng):
        """The first good one of many."""
        self.loaded = None
        while self.loaded is None:
            super().case(rng)
            with contextlib.suppress(UserError):
                self.loaded = load.load(str(self.folder / "case.yaml"))

    def read(self, rng):
        from shefex_nav import runs

        mission = self.loaded.mission
        far = mission.time_limit > SHORT_S or not self.whole or rng.integers(self.whole)
        run = runs.fly(
            self.loaded, int(rng.integers(1000)), until_s=mission.start + LOOKED_AT_S if far else np.inf
        )
        _check_run(run.data, ("truth", "imu", "nav", "covariance"))


class Extremes(Flights):
    """Scenarios of which one number is far too large, too small, or has the other sign, flown if good."""

    def case(self, rng):
        spoilt = mutations.extreme(rng, _whole(SCENARIOS[rng.integers(len(SCENARIOS))]))
        (self.folder / "case.yaml").write_text(_text(spoilt))
        self.loaded = None

    def read(self, rng):
        self.loaded = load.load(str(self.folder / "case.yaml"))
        super().read(rng)


def _check_run(data, names):
    """ValueError for NaN in records of a RunData."""
    for name in names:
        _check_numbers(name, getattr(data, name))


def _check_numbers(name, record, but=()):
    """ValueError for NaN in a record of arrays; the sigma of a block that is not estimated may be, and what
    a unit says that is silent.

    but : beginnings of names of fields that may
    """
    rows = record.valid if "valid" in record._fields else slice(None)
    t_s = (record.t_s if "t_s" in record._fields else record.t_valid_s)[rows]
    fields = [one for one in NUMBERS.get(name, record._fields) if not one.startswith(but)]
    for field, column in ((one, getattr(record, one)[rows]) for one in fields):
        if column.dtype.kind == "f" and not np.isfinite(column).all():
            at_s = t_s[np.argmin(np.isfinite(column).reshape(len(column), -1).all(axis=1))]
            raise ValueError(f"{name}.{field} at T{at_s:+.2f} s is NaN")


class Logs(Kind):
    """A log of three seconds."""

    def __init__(self, folder):
        super().__init__(folder)
        from shefex_nav.commands.app import app

        path = self.folder / "whole.mcap"
        app(["run", "night_sky", "--until", "3s", "--out", str(path)], standalone_mode=False)
        self.content = path.read_bytes()

    def case(self, rng):
        (self.folder / "case.mcap").write_bytes(mutations.data(rng, self.content))

    def read(self, _rng):
        from shefex_nav.log import pixels, reader

        reader.read(self.folder / "case.mcap")
        for _ in pixels.between(self.folder / "case.mcap"):
            pass


class Fields(Kind):
    """Logs whose messages say something else (`fuzz_logs`), given to a command that reads logs."""

    scenarios = "night_sky", "imu_faults", "shefex2_dispersed_sensors"

    def __init__(self, folder):
        super().__init__(folder)
        self.logs = []
        for name in self.scenarios:
            fuzz_programs.carry_out(f"run {name} --until 3s --out whole.mcap --force".split(), folder)
            self.logs.append(fuzz_logs.taken_apart(self.folder / "whole.mcap"))

    def case(self, rng):
        log = fuzz_logs.spoilt(rng, self.logs[rng.integers(len(self.logs))])
        fuzz_logs.put_together(self.folder / "case.mcap", log)

    def read(self, rng):
        words = fuzz_logs.COMMANDS[rng.integers(len(fuzz_logs.COMMANDS))].split()
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # of NumPy, of what is no number
            printed = fuzz_programs.carry_out(words, self.folder)
        if line := fuzz_logs.without_number(printed):
            raise ValueError(f"`{' '.join(words)}` prints no number: {line}")


class Pictures(Kind):
    """A picture with forty stars in five formats."""

    def __init__(self, folder):
        super().__init__(folder)
        self.content = {name: fuzz_programs.picture(self.folder / f"whole.{name}") for name in FORMATS}

    def case(self, rng):
        self.format = FORMATS[rng.integers(len(FORMATS))]
        spoilt = mutations.data(rng, self.content[self.format])
        (self.folder / f"case.{self.format}").write_bytes(spoilt)

    def read(self, _rng):
        import shefex_nav

        shefex_nav.solve_image(self.folder / f"case.{self.format}", fov_deg=20.0)


class Data(Kind):
    """Recorded data: the example of a student rocket, its tables or its description spoilt.

    form : csv, kf_gins, matlab
    """

    def __init__(self, folder, form="csv"):
        super().__init__(folder)
        self.form = form
        source = ROOT / "scenarios" / "replay" / "csv_example.yaml"
        self.example = fuzz_recorded.Example(_own(source), source.with_suffix(""))

    def case(self, rng):
        described, files = getattr(self.example, self.form)(rng)
        for name, content in files.items():
            path = self.folder / name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
        (self.folder / "case.yaml").write_text(_text(described))

    def read(self, _rng):
        from shefex_nav.log.run_data import RunDataBuilder
        from shefex_nav.replay import external
        from shefex_nav.replay import load as recorded

        ready = external.prepare(*recorded.load(str(self.folder / "case.yaml")))
        kept = RunDataBuilder(external.mission(ready))
        for record in external.run(ready, external.Clock()):
            kept.add(record)
        _check_run(kept.build(), ("nav", "covariance"))


class Answers(Kind):
    """What navigation software answers on the wire."""

    def __init__(self, folder):
        super().__init__(folder)
        self.scenario = fuzz_programs.software_scenario()
        self.content = fuzz_programs.answers(self.scenario)

    def case(self, rng):
        self.spoilt = mutations.data(rng, self.content)

    def read(self, _rng):
        nav = fuzz_programs.fly(self.scenario, lambda _: fuzz_programs.Playback(self.spoilt)).nav
        _check_numbers("nav", nav, but=("sigma", "protection"))  # which software need not say


class Commands(Kind):
    """Command lines of a second or two, in a folder with a log and a picture."""

    longest_s = 30.0

    def __init__(self, folder):
        super().__init__(folder)
        fuzz_programs.carry_out("run night_sky --until 3s --out whole.mcap".split(), folder)
        fuzz_programs.picture(self.folder / "picture.png")

    def case(self, rng):
        self.words = fuzz_programs.command_line(rng)
        (self.folder / "case.txt").write_text("\n".join(self.words))

    def read(self, _rng):
        fuzz_programs.carry_out(self.words, self.folder)


KINDS = {
    "scenarios": Scenarios,
    "flights": Flights,
    "extremes": Extremes,
    "logs": Logs,
    "fields": Fields,
    "pictures": Pictures,
    "fits": fuzz_texts.Heads,
    "winds": fuzz_texts.Winds,
    "studies": fuzz_texts.Studies,
    "models": fuzz_texts.Models,
    "data": Data,
    "kf_gins": partial(Data, form="kf_gins"),
    "matlab": partial(Data, form="matlab"),
    "answers": Answers,
    "commands": Commands,
}


def _own(path):
    """Tree of a YAML file, as the program reads it: `on` and `off` are words."""
    return document.parse(path.read_text(), str(path)).tree


def _text(tree):
    """A tree as JSON, which is YAML."""
    return json.dumps(tree, indent=1, ensure_ascii=False)


@cache
def _whole(path):
    """Tree of a scenario as a log keeps it, which needs no other file; not to be changed."""
    return document.parse(load.load(str(path)).source, str(path)).tree


def tried(kind, number):
    """What becomes of a case: (outcome, words, s). Outcomes: read, refused, traceback, slow, large."""
    rng = np.random.default_rng(number)
    kind.case(rng)
    before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    try:
        kind.read(rng)
        outcome, words = "read", ""
    except UserError as error:
        outcome, words = "refused", str(error)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        outcome, words = "traceback", f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})"
    took_s = time.process_time() - began
    grew = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    if outcome != "traceback" and took_s > kind.longest_s:
        outcome, words = "slow", f"{took_s:.1f} s"
    elif outcome != "traceback" and grew > MOST_BYTES:
        outcome, words = "large", f"{grew / 1e9:.1f} GB"
    return outcome, words, took_s


def study(name, folder, numbers, until_s):
    """Cases of a kind, as many as there is time for: {outcome: count}, list of bad ones, s of the slowest."""
    kind, count, bad, slowest_s = KINDS[name](folder), collections.Counter(), [], 0.0
    print(f"{name}: in {folder}", file=sys.stderr, flush=True)
    tried(kind, numbers[0])  # imports, and compiles
    for number in numbers:
        if time.monotonic() > until_s:
            break
        (kind.folder / "number").write_text(str(number))
        faulthandler.dump_traceback_later(STUCK * kind.longest_s, exit=True)
        outcome, words, took_s = tried(kind, number)
        faulthandler.cancel_dump_traceback_later()
        count[outcome] += 1
        if not count.total() % TOLD:
            print(f"{name}: to case {number}: {dict(count)}", file=sys.stderr, flush=True)
        slowest_s = max(slowest_s, took_s)
        if outcome not in ("read", "refused"):
            bad.append({"kind": name, "case": number, "outcome": outcome, "words": words})
            print(f"{name} {number}: {outcome}: {words}", flush=True)
    return count, bad, slowest_s


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=[], metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="at most, of each kind")
    parser.add_argument("--whole", type=int, default=Flights.whole, help="one of so many flights; 0: none")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    Flights.whole = asked.whole
    unknown = set(asked.kinds) - set(KINDS)
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: expected {', '.join(KINDS)}")
    warnings.simplefilter("ignore")
    found, every = {}, []
    for name in asked.kinds or KINDS:
        until_s = time.monotonic() + 60.0 * asked.minutes
        with tempfile.TemporaryDirectory() as folder:
            numbers = range(asked.first, asked.first + asked.cases)
            count, bad, slowest_s = study(name, folder, numbers, until_s)
        every += bad
        total = sum(count.values())
        found[name] = {"first": asked.first, "cases": total, **count, "slowest_s": round(slowest_s, 2)}
        words = ", ".join(f"{number} {outcome}" for outcome, number in count.most_common())
        print(f"{name}: cases {asked.first} to {asked.first + total - 1}: {words}; slowest {slowest_s:.1f} s")
    if asked.json:
        asked.json.write_text(json.dumps({"kinds": found, "bad": every}, indent=1))
    sys.exit(1 if every else 0)


if __name__ == "__main__":
    main()
