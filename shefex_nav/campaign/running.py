"""A campaign from plan to table."""

import time

from shefex_nav import workers as machine
from shefex_nav.campaign import draws, engine, progress
from shefex_nav.campaign.plan import Plan


def plan_of(scenario, seed, runs):
    """Plan of a campaign of a scenario."""
    return Plan(scenario.mission.name, scenario.source, seed, runs, "random", 1.0, None)


def run(scenario, plan, store, workers, say):
    """Fly what is missing, keep it, and make the table. -> the object of `campaign --json`"""
    began = time.perf_counter()
    done = store.done()
    missing = [k for k in range(plan.runs) if k not in done]
    tally = progress.Tally(plan.runs)
    for record in store.records(plan.runs):
        tally.take(record, flown=False)
    if missing:
        from shefex_nav import simulate

        simulate.warm_up(scenario)  # compiles; workers that compiled together would get into each other's way
        lanes = [engine.ProcessLane(plan) for _ in range(min(workers or machine.cores(), len(missing)))]
        note = progress.lines(tally, say)

        def take(flown):
            store.keep(flown)
            tally.take(flown.record)
            note()

        engine.fly((draws.job(plan, k) for k in missing), lanes, take)
    wall_s = store.took(time.perf_counter() - began)
    rows, digest = store.tabulate(plan.runs)
    failed = sum(row["status"] == "failed" for row in rows)
    return {
        "runs": len(rows),
        "succeeded": len(rows) - failed,
        "failed": failed,
        "requirements": [],
        "wall_s": wall_s,
        "results_digest": digest,
    }
