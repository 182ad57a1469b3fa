"""What a campaign of a million runs costs beside flying: keeping runs, going on, the table, the report.

uv run python benchmarks/million_runs.py [SCENARIO] [--runs 100000] [--times 10] [--folder DIR] [--json]

Flies a few statistical runs of the scenario and keeps them, altered, as so many runs through the store of
campaigns. Records are as large as real ones; series are real ones of the first runs, which a report reads,
and a few epochs of the others, because those of a million take 140 GB. Each step is a process of its own:

fill      runs kept in batches, and then some of real size one by one, as a campaign keeps them
resume    from the command's first look into the folder until it would hand out the first run
tabulate  results.parquet of the records
report    `shefex-nav report DIR`, and with --json, of the finished table
multiply  rows of runs, records and table as many times over as is wanted, under numbers of their own; a
          record's own number is that of the first one, which neither going on nor a report reads. Then
          going on and reports of these

Exit code 1 if going on takes more than 10 s, or a report more than 3 minutes or 1 GB.
"""

import argparse
import contextlib
import io
import json
import subprocess
import sys
import tempfile
import time
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from missions import SCENARIOS

SEED, TEMPLATES, BATCH, ONE_BY_ONE = 1, 4, 200, 200
EPOCHS = 4  # of the series that no report reads
FAILED = 0.002  # of the runs
FAST = ("star_tracker.frames=statistical",)
MOST = {"resume": (10.0, None), "report": (180.0, 1000.0), "report --json": (180.0, 1000.0)}  # s, MB


def scenario_of(path):
    """The scenario of a path."""
    from shefex_nav.scenario import load

    return load.load(path, FAST)


def altered(tree, factors):
    """A tree of results, list or dict, each number but shares times the next of endless factors."""
    kind = type(tree)
    if kind is float:
        return tree * next(factors)
    if kind is dict:
        return {
            name: value if name.endswith("share") or name == "doubts" else altered(value, factors)
            for name, value in tree.items()
        }
    return [altered(value, factors) for value in tree] if kind is list else tree


def brief(series):
    """A few epochs of the bytes of a series."""
    from shefex_nav import files
    from shefex_nav.campaign.flight import _npz

    return _npz({name: values[:EPOCHS] for name, values in files.arrays_of(io.BytesIO(series)).items()})


def made(runs, templates):
    """(Flown, badness) of so many runs: iterator."""
    from shefex_nav.campaign import flight
    from shefex_nav.campaign.over_time import MOST_SERIES

    rng, short = np.random.default_rng(SEED), [brief(one.series) for one in templates]
    for run in range(runs):
        k, factors = run % len(templates), cycle((1.0 + 0.001 * rng.standard_normal(61)).tolist())
        own = {"run": run, "seed": run, "draws": altered(templates[k].record["draws"], factors)}
        if rng.random() < FAILED:
            reason = {"status": "failed", "reason": f"FlightError: at T+{run} s", "summary": {}}
            yield flight.Flown(templates[k].record | own | reason, None), None
            continue
        record = templates[k].record | own | {"summary": altered(templates[k].record["summary"], factors)}
        yield (
            flight.Flown(record, templates[k].series if run < MOST_SERIES else short[k]),
            (0.5, rng.random()),
        )


def fill(path, folder, runs):
    """Keep the runs. -> dict of figures"""
    from shefex_nav.campaign import flight, running
    from shefex_nav.campaign.store import Store

    scenario = scenario_of(path)
    plan, sampler = running.prepared(scenario, runs, SEED)
    pilot = flight.Pilot(plan)
    templates = [pilot.fly(sampler.job(run)) for run in range(TEMPLATES)]
    every, kept_s = made(runs, templates), 0.0
    with Store(folder) as store:
        store.begin(plan, running.described(scenario))
        while batch := list(islice(every, BATCH)):
            began_s = time.perf_counter()
            store.runs.keep(batch)
            kept_s += time.perf_counter() - began_s
    with tempfile.TemporaryDirectory(dir=folder.parent) as other, Store(other) as store:
        began_s = time.perf_counter()
        for run in range(ONE_BY_ONE):
            store.keep(templates[run % TEMPLATES]._replace(record=templates[0].record | {"run": run}))
        one_by_one_s = time.perf_counter() - began_s
    return {
        "kept_per_s": runs / kept_s,
        "one_by_one_per_s": ONE_BY_ONE / one_by_one_s,
        "series_kb": len(templates[0].series) / 1e3,
        "record_kb": len(json.dumps(templates[0].record)) / 1e3,
        "file_mb": (folder / "runs.sqlite").stat().st_size / 1e6,
    }


def resume(path, folder, runs):
    """Go on with one run more until a lane would be asked to fly. -> dict of figures"""
    from shefex_nav.campaign import running
    from shefex_nav.campaign.progress import Show
    from shefex_nav.campaign.store import Store

    class Ready(Exception):
        """A lane was asked for."""

    def crew(plan, count):
        raise Ready(count)

    scenario = scenario_of(path)
    request = running.Request(scenario, runs + 1, SEED, 1, None, ())
    began_s = time.perf_counter()
    try:
        with Store(folder) as store:
            running.fly(request, store, Show(lambda text: None), crew=crew)
    except Ready as ready:
        assert ready.args == (1,)
    return {"ready_s": time.perf_counter() - began_s}


def tabulate(path, folder, runs):
    """Make the table. -> dict of figures"""
    from shefex_nav.campaign.store import Store

    (folder / "results.parquet").unlink(missing_ok=True)
    with Store(folder) as store:
        made = store.tabulate()
    size = (folder / "results.parquet").stat().st_size
    return {"rows": made.runs, "table_mb": size / 1e6, "digest": made.digest}


def report(path, folder, runs, *more):
    """The command. -> dict of figures"""
    from shefex_nav.commands.app import app

    with contextlib.redirect_stdout(io.StringIO()) as said:
        app(["report", str(folder), *more], standalone_mode=False)
    return {"characters": len(said.getvalue())}


def report_json(path, folder, runs):
    """The command, for programs. -> dict of figures"""
    return report(path, folder, runs, "--json")


def multiply(path, folder, runs):
    """As many runs by copying those that are there. -> dict of figures"""
    from shefex_nav.campaign import running
    from shefex_nav.campaign.store import Store

    scenario = scenario_of(path)
    with Store(folder) as store:
        there = len(store.runs.done())
        store.begin(running.prepared(scenario, runs, SEED)[0], running.described(scenario))
        say = store.runs._db.execute
        say("PRAGMA synchronous = OFF")
        for first in range(there, runs, BATCH):
            some = "WHERE run BETWEEN ? AND ?"
            which = first // there * there, first % there, first % there + BATCH - 1
            say("BEGIN")
            say(f"INSERT INTO runs SELECT run + ?, failed, severity, rms_deg FROM runs {some}", which)
            say(f"INSERT INTO records SELECT run + ?, record FROM records {some}", which)
            say("COMMIT")
        state = store.runs.state()
    multiply_table(folder / "results.parquet", there, runs // there, state)
    return {"file_mb": (folder / "runs.sqlite").stat().st_size / 1e6}


def multiply_table(path, runs, times, state):
    """Rows of a table several times over, of that state of the store; its digest stays that of the first."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    from shefex_nav import files
    from shefex_nav.campaign import table

    digest = table.made(path).digest
    with pq.ParquetFile(path) as file, files.whole(path) as part:
        schema = file.schema_arrow
        with pq.ParquetWriter(part, schema, compression="zstd") as writer:
            for k in range(times):
                for number in range(file.num_row_groups):
                    group = file.read_row_group(number)
                    writer.write_table(group.set_column(0, schema.field(0), pc.add(group["run"], k * runs)))
            writer.add_key_value_metadata({table.DIGEST: digest, table.STATE: state})


STEPS = {
    "fill": fill, "resume": resume, "tabulate": tabulate, "report": report, "report --json": report_json,
    "multiply": multiply,
}  # fmt: skip
AGAIN = ("multiply", "resume", "report", "report --json")


def step(name, path, folder, runs):
    """Do one step in this process and print its figures as JSON."""
    from shefex_nav.campaign.flight import _peak_memory_mb

    began_s, cpu_s = time.perf_counter(), time.process_time()
    found = STEPS[name](path, folder, runs)
    found |= {"wall_s": time.perf_counter() - began_s, "cpu_s": time.process_time() - cpu_s}
    print(json.dumps(found | {"peak_mb": _peak_memory_mb()}))


def measured(path, folder, runs, steps):
    """Every step in a process of its own: {step: dict of figures}."""
    found = {}
    for name in steps:
        print(f"{name}, {runs} runs", file=sys.stderr)
        words = [sys.executable, __file__, path, "--runs", str(runs), "--folder", str(folder), "--step", name]
        done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True)
        found[name] = json.loads(done.stdout.splitlines()[-1])
    return found


def kept_within(found):
    """Whether each limit is kept: {step: bool}."""
    result = {}
    for name in found.keys() & MOST.keys():
        most_s, most_mb = MOST[name]
        seconds = found[name].get("ready_s", found[name]["wall_s"])
        result[name] = seconds <= most_s and (most_mb is None or found[name]["peak_mb"] <= most_mb)
    return result


def main():
    """Measure and print. -> exit code"""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default=str(SCENARIOS / "shefex2_dispersed.yaml"))
    parser.add_argument("--runs", type=int, default=100_000, help="a multiple of 200, if multiplied")
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--folder", type=Path, help="made, and left; else one that is deleted")
    parser.add_argument("--step", choices=STEPS, help=argparse.SUPPRESS)
    parser.add_argument("--json", action="store_true")
    wanted = parser.parse_args()
    if wanted.step:
        step(wanted.step, wanted.scenario, wanted.folder, wanted.runs)
        return 0
    with tempfile.TemporaryDirectory() as place:
        folder = wanted.folder or Path(place) / "campaign"
        steps = [name for name in STEPS if name != "multiply"]
        found = {wanted.runs: measured(wanted.scenario, folder, wanted.runs, steps)}
        if wanted.times > 1:
            many = wanted.runs * wanted.times
            found[many] = measured(wanted.scenario, folder, many, AGAIN)
    good = {runs: kept_within(steps) for runs, steps in found.items()}
    if wanted.json:
        print(json.dumps({"steps": found, "within": good}))
    else:
        show(found, good)
    return 0 if all(all(one.values()) for one in good.values()) else 1


def show(found, good):
    """Print the figures of each step."""
    for runs, steps in found.items():
        for name, figures in steps.items():
            words = {True: ": within its limits", False: ": NOT WITHIN ITS LIMITS"}.get(
                good[runs].get(name), ""
            )
            print(f"{name}, {runs:,} runs{words}")
            for figure, value in figures.items():
                print(f"  {figure:<18}{value if isinstance(value, str) else f'{value:,.4g}'}")


if __name__ == "__main__":
    sys.exit(main())
