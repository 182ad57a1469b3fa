"""A campaign from its scenario to its table: what `shefex-nav campaign` does, without the command line."""

import re
import time
from functools import partial
from numbers import Integral
from typing import NamedTuple

from shefex_nav import files
from shefex_nav import workers as machine
from shefex_nav.campaign import MOST_RUNS, draws, engine, flight, progress, repeating
from shefex_nav.campaign import plan as planning
from shefex_nav.campaign.flight import Flown
from shefex_nav.campaign.over_time import MOST_SERIES
from shefex_nav.campaign.results import SUCCEEDED
from shefex_nav.campaign.store import Store
from shefex_nav.errors import UserError
from shefex_nav.report import requirements
from shefex_nav.scenario import load
from shefex_nav.scenario.laws import TableLaw

GIVE_UP = 2  # sessions in which a run killed its worker in every attempt: then it has failed
CHECKED = MOST_SERIES  # the first runs, whose series a report reads: a session looks whether all is whole
BOOK_S = 10.0  # between two entries of the time taken, which a session that is killed would else not leave


class Request(NamedTuple):
    """What to fly and how."""

    scenario: object  # Scenario
    runs: int
    seed: int
    workers: int | None  # processes on this machine; None: one a core
    cluster: str | None  # HOST:PORT of a Dask scheduler; None: this machine
    keep: tuple  # of Keep
    until_verified: bool = False  # whether it is judged at its looks (`until`)


class Keep(NamedTuple):
    """Runs that get a log."""

    what: str  # worst, failed
    most: int | None = None  # of the worst


class Ended(NamedTuple):
    """A campaign that was flown, or stopped."""

    done: int  # runs in the table
    failed: int  # of these
    digest: str  # of the results
    wall_s: float  # of all sessions so far
    interrupted: bool
    lost: tuple = ()  # of engine.Lost: runs that are not in the table, flown when the campaign goes on
    unlogged: tuple = ()  # of engine.Lost: runs whose log was asked for and could not be had


class BadCampaign(UserError):
    """A campaign that cannot be flown; the message says why."""


class Session:
    """What a session has taken, entered in the store as it goes on."""

    def __init__(self, store):
        self._store, self._since, self._runs = store, time.perf_counter(), 0

    def ran(self):
        """Count a run that is over."""
        self._runs += 1
        if time.perf_counter() - self._since > BOOK_S:
            self.book()

    def book(self, *, of_runs=True):
        """Enter the time since the last entry, as that of the runs since, or of other work. -> s in all"""
        now, runs = time.perf_counter(), self._runs
        taken_s, self._since, self._runs = now - self._since, now, 0
        return self._store.took(taken_s, runs if of_runs else None)


def checked(request):
    """The request; BadCampaign if runs, workers or seed are no numbers to fly with."""
    numbers = [("runs", request.runs, 1), ("seed", request.seed, 0)]
    if request.workers is not None:
        numbers.append(("workers", request.workers, 1))
        if request.cluster is not None:
            raise BadCampaign("workers: the cluster has its own; leave workers or engine away")
    for name, value, least in numbers:
        if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
            raise BadCampaign(f"{name}: {value!r}; expected a whole number, {least} or more")
    if request.runs > MOST_RUNS:
        raise BadCampaign(f"runs: {request.runs}; expected {MOST_RUNS} at most")
    return request._replace(runs=int(request.runs), seed=int(request.seed))


def address(engine_name):
    """HOST:PORT of dask://HOST:PORT, None of None; BadCampaign."""
    if engine_name is None:
        return None
    found = re.fullmatch(r"dask://([\w.\-\[\]:]+:\d+)", engine_name)
    if found is None:
        raise BadCampaign(f"{engine_name!r}: expected dask://HOST:PORT of a scheduler")
    return found[1]


def kept(texts):
    """tuple of Keep of 'worst:K', 'failed' or 'none'; BadCampaign."""
    found = []
    for text in texts:
        match = re.fullmatch(r"worst:([1-9]\d*)|(failed)|(none)", text)
        if match is None:
            raise BadCampaign(f"{text!r}: expected worst:K, failed or none")
        if text != "none":
            found.append(Keep("worst", int(match[1])) if match[1] else Keep("failed"))
    if found and "none" in texts:
        raise BadCampaign("none does not go with others")
    return tuple(found)


def prepared(scenario, runs, seed):
    """(Plan, Sampler) of a campaign; BadCampaign if a table is too short for its runs."""
    from shefex_nav import prepare  # which needs the compiler

    plan = planning.of_scenario(prepare.settled(scenario), seed, runs)
    dispersed = load.Pattern(plan.source, plan.name).dispersed
    for one in dispersed:
        if isinstance(one.law, TableLaw) and len(one.law.values) < runs:
            words = f"{len(one.law.values)} values for {runs} runs; one for each"
            raise BadCampaign(scenario.line_about(("dispersions", one.name, "table"), words))
    return plan, draws.Sampler(plan, dispersed)


def fly(request, store, show, stopped=lambda: False, crew=None):
    """Fly what is missing in the store, keep it, and make the table.

    Parameters
    ----------
    request : Request
    store : Store, open
    show : progress.Show, told of what happens
    stopped : called often; True ends the campaign with what there is
    crew : function of Plan and number of runs that gives the lanes to fly in; None: as requested

    Returns
    -------
    Ended
    """
    session = Session(store)
    plan, sampler = prepared(request.scenario, request.runs, request.seed)
    store.begin(plan, described(request.scenario), request.scenario.place, request.until_verified)
    tally, bad = progress.Tally(plan.runs), badness(request.scenario)
    missing = _missing(plan, store, show, tally)
    lost, unlogged, interrupted, made = [], [], False, None
    try:
        if missing:
            if crew is None and request.cluster is None:
                compile_kernels(request.scenario, show)
            plan = with_flight(plan, store, request.scenario)
            lanes = (crew or partial(_lanes, request))(plan, len(missing))
            session.book(of_runs=False)  # compiling may take longer than all runs
            with show.bar(tally) as note:
                jobs = (sampler.job(run) for run in missing)
                take, suspects = partial(_take, store, tally, session, bad, note), _suspects(store)
                lost = _lost(engine.fly(jobs, lanes, take, stopped, suspects), sampler, store, take)
        made = store.tabulate()  # before logs, which nothing depends on
        session.book()
        unlogged = _keep_logs(request, plan, sampler, store, show, stopped, crew)
    except engine.Interrupted:
        interrupted = True
    wall_s, made = session.book(of_runs=made is None), made or store.tabulate()
    failed = store.runs.standing().failed
    return Ended(made.runs, failed, made.digest, wall_s, interrupted, tuple(lost), tuple(unlogged))


def _missing(plan, store, show, tally):
    """Runs that are to be flown, in order: list. What is done is counted.

    What there is of a run that is flown again stands until there is something new. Of the first CHECKED runs
    it is looked whether a disk has spoilt them; of the others when they are read (`mend`).
    """
    spoilt = store.runs.spoilt(CHECKED)
    tally.found(store.runs.standing(spoilt))
    done = store.runs.done().difference(spoilt)
    if spoilt:
        show.say(f"flying {_named(spoilt)} again: the disk has spoilt what was kept")
    return [run for run in range(plan.runs) if run not in done]


def _take(store, tally, session, badness_of, note, flown):
    """Keep a run that is over, count it, show it."""
    bad = badness_of(flown.record)
    store.keep(flown, bad)
    tally.take(flown.record, bad)
    session.ran()
    note()


def _suspects(store):
    """Numbers of the runs that killed their workers in an earlier session."""
    return {run for run, why in store.runs.lost().items() if why["deadly"]}


def _lost(lost, sampler, store, take):
    """Keep why runs were lost; one that killed its workers in GIVE_UP sessions failed. -> the others"""
    others = []
    for one in lost:
        sessions = store.runs.lose(one)
        if sessions < GIVE_UP:
            others.append(one)
        else:
            take(flight.given_up(sampler.job(one.run), f"{one.reason} of {sessions} sessions"))
    return others


def _named(runs, most=10):
    """A list of runs for people."""
    some = ", ".join(str(run) for run in runs[:most])
    more = f" and {len(runs) - most} more" if len(runs) > most else ""
    return f"run{'s' if len(runs) > 1 else ''} {some}{more}"


def compile_kernels(scenario, show):
    """Compile what is not compiled yet: workers would do so all at once and get into each other's way."""
    from shefex_nav import runs, simulate

    show.say("Getting ready")
    runs.get_ready(scenario)
    simulate.warm_up(scenario)


def with_flight(plan, store, scenario):
    """The plan with the flight that all runs share, if they do: as it is kept, else flown now."""
    from shefex_nav import prepare
    from shefex_nav.campaign import flight_file

    if not plan.shared:
        return plan

    def make():
        return flight_file.to_bytes(prepare.fly_vehicle(scenario, draws.flight_seed(plan.seed)))

    return plan._replace(flight=store.flight(make))


def _lanes(request, plan, runs):
    """The workers, as lanes of the engine."""
    if request.cluster is None:
        return _lanes_here(request, plan, runs)
    try:
        from shefex_nav.campaign.cluster import ClusterLane
    except ModuleNotFoundError as error:
        raise BadCampaign(
            f"--engine dask needs the extra 'cluster' ({error.name} is not installed): "
            "uv sync --extra cluster, or pip install 'shefex-nav[cluster]'"
        ) from None
    return [ClusterLane(request.cluster, plan)]


def _lanes_here(request, plan, runs):
    """Workers of this machine."""
    return [engine.ProcessLane(plan) for _ in range(min(request.workers or machine.cores(), runs))]


def described(scenario):
    """The dispersions of a scenario as plain values: {path or name of a group: {...}}."""
    return {
        name: one.model_dump(exclude_none=True, mode="json") for name, one in scenario.dispersions.items()
    }


def badness(scenario):
    """Function that says how bad a run's record is, None of one that failed.

    How many requirements it misses and how near it comes to the others; among equals, and without any, its
    rms attitude error.
    """

    def bad(record):
        if record["status"] == "failed":
            return None
        judged = requirements.judge(scenario.requirements, record["summary"])
        rms = record["summary"]["navigation"]["attitude_error_deg"]["rms"]
        return requirements.severity(judged), rms or 0.0

    return bad


def chosen(keep, runs):
    """Runs that get a log, by what is to be kept: list, the worst first. runs : RunsFile"""
    found = []
    for one in keep:
        found += runs.failed() if one.what == "failed" else runs.worst(one.most)
    return list(dict.fromkeys(found))


def _keep_logs(request, plan, sampler, store, show, stopped, crew):
    """Fly the runs that are to be kept again, with a log each, on this machine. -> list of engine.Lost"""
    missing = [run for run in chosen(request.keep, store.runs) if not store.log(run).exists()]
    if not missing:
        return []
    show.say(f"flying again with a log: {_named(missing)}")
    parts = {run: files.part(store.log(run)) for run in missing}
    plan = with_flight(plan, store, request.scenario)
    lanes = (crew or partial(_lanes_here, request))(plan, len(missing))
    jobs = (sampler.job(run)._replace(log=str(part)) for run, part in parts.items())
    tally, without = progress.Tally(len(missing)), []

    def take(flown):
        run = flown.record["run"]
        if different := repeating.compared(store.runs.record(run), flown.record):
            columns = ", ".join(list(different)[: repeating.MOST_WORDS])
            show.say(f"run {run}: no log, it differs from its row in {len(different)} columns: {columns}")
        elif parts[run].exists():
            store.keep_log(run)
        else:
            without.append(engine.Lost(run, f"it failed before its first record: {flown.record['reason']}"))
        tally.take(flown.record)
        note()

    with show.bar(tally) as note:
        return [*engine.fly(jobs, lanes, take, stopped), *without]


def mend(folder, run, log=None, *, lane=engine.ProcessLane):
    """Repeat a run of the campaign in `folder` and keep it. Arguments and errors as of `repeating.repeat`.

    A run of the same results keeps its record, with the times of its first flight. One that flew to its end
    and now comes out otherwise is left as it is. StoreError also if a campaign is at work in the folder, or
    if the program is not the one that flew its runs.

    -> (Repeated, whether it was kept)
    """
    head = repeating.read_head(folder, run)
    scenario = load.Pattern(head["source"], head["scenario"]).scenario
    with Store(folder) as store:
        store.begin(repeating.plan_of(head, folder), described(scenario))
        repeated = repeating.repeat(folder, run, log, lane=lane)
        if not repeated.same and repeated.kept is not None and repeated.kept["status"] == SUCCEEDED:
            return repeated, False
        record = repeated.kept if repeated.same else repeated.record
        store.keep(Flown(record, repeated.series), badness(scenario)(record))
    return repeated, True
