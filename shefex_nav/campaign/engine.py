"""Runs to workers and back: in any order, none lost.

A lane is a `concurrent.futures.Executor` and how many runs it may have at a time. On this machine a worker is
a lane: a pool of one new process (spawn), which takes with it, if it is killed, the one run that it had; a
new process takes its place, and the run is flown again. A cluster is one lane, its scheduler sees to the
rest.

A run whose worker is killed, or has no memory or disk left, is tried again, and lost after some attempts: it
is told: the fault need not be its own.
"""

from collections import deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, ThreadPoolExecutor, wait
from typing import NamedTuple

from shefex_nav.campaign import flight
from shefex_nav.compiled.target import ONE_THREAD
from shefex_nav.errors import UserError
from shefex_nav.workers import Pool, environment, undisturbed

ATTEMPTS = 3  # of a run whose worker is killed or in trouble
DEATHS = 8  # such attempts, one after the other, with nothing flown in between: then something else is wrong
KILLED = "its worker was killed"
POLL_S = 0.2  # between two looks at whether to stop


class EngineError(UserError):
    """Workers that cannot be used; the message says why."""


class Interrupted(Exception):
    """Somebody asked for an end; what is done is kept."""


class Lost(NamedTuple):
    """A run that no worker brought to an end."""

    run: int
    reason: str
    deadly: bool = False  # its worker was killed in each attempt


class Trial(NamedTuple):
    """A run in the hands of a worker."""

    job: object
    troubles: tuple  # of the attempts before this one, as texts
    lane: object


class ProcessLane:
    """One worker process on this machine."""

    capacity = 1

    def __init__(self, plan, function=flight.fly, prepare=flight.prepare_worker):
        """function : of a job, in the worker; prepare : of the plan, the first thing that the worker does."""
        self._plan, self._function, self._prepare = plan, function, prepare
        self._pool = None

    def submit(self, job):
        """Future of a run."""
        if self._pool is None:
            self._pool = Pool(1, self._prepare, self._plan)
        try:
            with environment(dict.fromkeys(ONE_THREAD, "1")):  # of a new process, whatever the user set
                return self._pool.submit(self._function, job)
        except BrokenExecutor:  # killed while it had nothing to do
            self.renew()
            return self.submit(job)

    def renew(self):
        """After the death of the worker: the next run gets a new one."""
        self._pool.abandon()
        self._pool = None

    def stop(self, at_once=False):
        """End the worker; at once: whatever it is doing."""
        if self._pool is not None:
            self._pool.stop(at_once=at_once)
        self._pool = None


def fly(jobs, lanes, take, stopped=lambda: False, suspects=frozenset()):
    """Fly jobs.

    Parameters
    ----------
    jobs : iterable of Job, asked for one at a time
    lanes : list of lanes, such as ProcessLane
    take : called with the result of each run (Flown), in the order in which they end
    stopped : called between them; True ends the work with Interrupted, after what is over has been taken
    suspects : numbers of runs that killed their workers before; if they do again, it says nothing of these

    Returns
    -------
    list of Lost
    """
    if not lanes:
        raise ValueError("no lanes to fly in")
    try:
        lost = _fly(iter(jobs), lanes, take, stopped, suspects)
    except BaseException:
        with undisturbed():
            for lane in lanes:
                lane.stop(at_once=True)
        raise
    if len(lanes) == 1:  # not in a thread: a cluster may not answer, and Ctrl-C has to get away from it
        lanes[0].stop()
    else:  # a worker's libraries take some tenths of a second to go
        with ThreadPoolExecutor(len(lanes)) as together:
            list(together.map(lambda lane: lane.stop(), lanes))
    return lost


def _fly(jobs, lanes, take, stopped, suspects):
    again, flying, lost, deaths = deque(), {}, [], 0
    while True:
        for lane in lanes:
            used = sum(trial.lane is lane for trial in flying.values())
            for _ in range(lane.capacity - used):
                job, troubles = again.popleft() if again else (next(jobs, None), ())
                if job is None:
                    break
                flying[lane.submit(job)] = Trial(job, troubles, lane)
        if not flying:
            return lost
        over, _ = wait(flying, timeout=POLL_S, return_when=FIRST_COMPLETED)
        for future in over:
            trial = flying.pop(future)
            trouble = _trouble(future, trial.job)
            if trouble is None:
                take(future.result())
                deaths = 0
                continue
            deaths += trial.job.run not in suspects
            if deaths > max(DEATHS, ATTEMPTS * len(lanes)):
                raise EngineError(f"{deaths} attempts one after the other without a result; last: {trouble}")
            trial.lane.renew()
            troubles = (*trial.troubles, trouble)
            if len(troubles) < ATTEMPTS:
                again.append((trial.job, troubles))
            else:
                lost.append(_lost(trial.job.run, troubles))
        if stopped():
            raise Interrupted


def _lost(run, troubles):
    """Lost after as many troubles as a run has attempts."""
    first, deadly = troubles[0], set(troubles) == {KILLED}
    each = f"{first}, in each of {len(troubles)} attempts"
    several = f"{len(troubles)} attempts: " + "; ".join(troubles)
    return Lost(run, each if len(set(troubles)) == 1 else several, deadly)


def _trouble(future, job):
    """What happened to the worker of a run that is over, None if nothing did: text."""
    if future.cancelled():  # nobody here does that: the scheduler is gone, or was started anew
        raise EngineError(
            f"the Dask scheduler gave up run {job.run}: it ended, or was restarted; what is done is kept, "
            "the same command goes on"
        )
    error = future.exception()
    if isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker":
        return KILLED
    return str(error) if isinstance(error, flight.MachineError) else None
