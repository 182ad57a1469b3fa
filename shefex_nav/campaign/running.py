"""A campaign from its scenario to its table: what `shefex-nav campaign` does, without the command line."""

import time
from contextlib import contextmanager
from typing import NamedTuple

from shefex_nav import workers as machine
from shefex_nav.campaign import draws, engine, flight, progress
from shefex_nav.campaign import plan as planning
from shefex_nav.scenario import load
from shefex_nav.scenario.laws import TableLaw


class Request(NamedTuple):
    """What to fly and how."""

    scenario: object  # Scenario
    runs: int
    seed: int
    workers: int | None  # processes on this machine; None: one a core
    cluster: str | None  # HOST:PORT of a Dask scheduler; None: this machine
    keep: tuple  # of Keep


class Keep(NamedTuple):
    """Runs that get a log."""

    what: str  # worst, failed
    most: int | None = None  # of the worst


class Ended(NamedTuple):
    """A campaign that was flown, or stopped."""

    rows: list  # of the table
    digest: str  # of the results
    wall_s: float  # of all sessions so far
    interrupted: bool


class BadCampaign(Exception):
    """A campaign that cannot be flown; the message says why."""


def prepared(scenario, runs, seed):
    """(Plan, Sampler) of a campaign; BadCampaign if a table is too short for its runs."""
    plan = planning.of_scenario(scenario, seed, runs)
    dispersed = load.Pattern(plan.source, plan.name).dispersed
    for one in dispersed:
        if isinstance(one.law, TableLaw) and len(one.law.values) < runs:
            raise BadCampaign(
                f"dispersions.{one.name}.table: {len(one.law.values)} values for {runs} runs; one for each"
            )
    return plan, draws.Sampler(plan, dispersed)


def fly(request, store, show, stopped=lambda: False):
    """Fly what is missing in the store, keep it, and make the table.

    Parameters
    ----------
    request : Request
    store : Store, open
    show : progress.Show, told of what happens
    stopped : called often; True ends the campaign with what there is

    Returns
    -------
    Ended
    """
    began = time.perf_counter()
    plan, sampler = prepared(request.scenario, request.runs, request.seed)
    store.begin(plan, described(request.scenario))
    tally = progress.Tally(plan.runs, badness(request.scenario))
    for record in store.records(plan.runs):
        tally.take(record, flown=False)
    done = store.done()
    missing = [run for run in range(plan.runs) if run not in done]
    interrupted = False
    try:
        if missing:
            plan = ready(plan, store, request.scenario, show)
            with show.bar(tally) as note:

                def take(flown):
                    store.keep(flown)
                    tally.take(flown.record)
                    note()

                with lanes(request, plan, len(missing)) as crew:
                    engine.fly((sampler.job(run) for run in missing), crew, take, stopped)
        _keep_logs(request, plan, sampler, store, show, stopped)
    except engine.Interrupted:
        interrupted = True
    wall_s = store.took(time.perf_counter() - began)
    rows, digest = store.tabulate(plan.runs)
    return Ended(rows, digest, wall_s, interrupted)


def result(scenario, ended):
    """The object of `campaign --json` and of `report DIR --json`."""
    failed = sum(row["status"] == "failed" for row in ended.rows)
    return {
        "runs": len(ended.rows),
        "succeeded": len(ended.rows) - failed,
        "failed": failed,
        "requirements": [],
        "wall_s": ended.wall_s,
        "results_digest": ended.digest,
    }


def ready(plan, store, scenario, show):
    """The plan with the shared flight, if it has one; kernels compiled: workers would do so all at once."""
    from shefex_nav import prepare, simulate
    from shefex_nav.campaign import flight_file

    show.say("Getting ready; the first run on a machine compiles, which takes a few minutes.")
    simulate.warm_up(scenario)
    if not plan.shared:
        return plan

    def make():
        return flight_file.to_bytes(prepare.fly_vehicle(scenario, draws.flight_seed(plan.seed)))

    return plan._replace(flight=store.flight(make))


@contextmanager
def lanes(request, plan, runs):
    """The workers, as lanes of the engine."""
    if request.cluster is not None:
        try:
            from shefex_nav.campaign.cluster import ClusterLane
        except ModuleNotFoundError as error:
            raise BadCampaign(
                f"--engine dask needs the extra 'cluster' ({error.name} is not installed): "
                "uv sync --extra cluster, or pip install 'shefex-nav[cluster]'"
            ) from None
        yield [ClusterLane(request.cluster, plan)]
        return
    yield [engine.ProcessLane(plan) for _ in range(min(request.workers or machine.cores(), runs))]


def described(scenario):
    """The dispersions of a scenario as plain values: {path or name of a group: {...}}."""
    return {
        name: one.model_dump(exclude_none=True, mode="json") for name, one in scenario.dispersions.items()
    }


def badness(scenario):
    """Function that says how bad a run's record is, None of one that failed.

    The largest ratio of what was found to a requirement's limit; among equals, and without requirements, the
    rms attitude error.
    """
    from shefex_nav.report import requirements

    def bad(record):
        if record["status"] == "failed":
            return None
        judged = requirements.judge(scenario.requirements, record["summary"])
        rms = record["summary"]["navigation"]["attitude_error_deg"]["rms"]
        return max((_ratio(one) for one in judged), default=0.0), rms or 0.0

    return bad


def _ratio(judged):
    """How far a figure is from its limit: above 1 where it is missed."""
    if judged.found is None or isinstance(judged.required, bool):
        return 0.0 if judged.passed else float("inf")
    if judged.found == judged.required:
        return 1.0 if judged.required else 0.0
    ratio = judged.found / judged.required if judged.required else float("inf")
    at_least = judged.passed == (judged.found > judged.required)
    return (1.0 / ratio if ratio else float("inf")) if at_least else ratio


def chosen(keep, records, bad):
    """Runs that get a log, by what is to be kept: list, the worst first."""
    found = []
    for one in keep:
        if one.what == "failed":
            found += [record["run"] for record in records if record["status"] == "failed"]
        else:
            ranked = sorted(
                ((bad(record), -record["run"]) for record in records if record["status"] != "failed"),
                reverse=True,
            )
            found += [-run for _, run in ranked[: one.most]]
    return list(dict.fromkeys(found))


def _keep_logs(request, plan, sampler, store, show, stopped):
    """Fly the runs that are to be kept again, with a log each, on this machine."""
    if not request.keep:
        return
    wanted = chosen(request.keep, list(store.records(plan.runs)), badness(request.scenario))
    missing = [run for run in wanted if not store.log(run).exists()]
    if not missing:
        return
    show.say(f"flying again with a log: {', '.join(f'run {run}' for run in missing)}")
    plan = ready(plan, store, request.scenario, show)
    pilot = flight.Pilot(plan)
    for run in missing:
        if stopped():
            raise engine.Interrupted
        part = store.log(run).with_suffix(".part")
        pilot.fly(sampler.job(run), log=part)
        part.replace(store.log(run))
