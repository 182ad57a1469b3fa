"""Run an experiment on the cores of the machine.

The samples are cut into chunks and each chunk gets its own child of the seed, so that the results are the
same with one worker and with many. Workers are new processes (spawn): nothing of the parent leaks into them.
The parent draws one sample first, which compiles and caches the kernels; workers that compiled together
would write the same cache files at once.
"""

import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import NamedTuple

import numpy as np

WARM_UP_SEED = 0  # of the sample that compiles; its result is not used


class Outcome(NamedTuple):
    """What came out of an experiment."""

    results: list  # of `measure`, in the order of the chunks
    rows: list  # Row
    samples: int
    seed: int
    wall_s: float  # without compilation


def chunks(experiment, samples, seed):
    """(samples, SeedSequence) of each chunk: list. The last chunk may be smaller."""
    n_chunks = -(-samples // experiment.chunk)
    sizes = [min(experiment.chunk, samples - k * experiment.chunk) for k in range(n_chunks)]
    return list(zip(sizes, np.random.SeedSequence(seed).spawn(n_chunks), strict=True))


def run(experiment, *, samples, seed, workers=None, progress=lambda done: None):
    """Measure and conclude.

    Parameters
    ----------
    experiment : Experiment; `measure` must be importable (a function of a module)
    samples : int, >= 1
    seed : int
    workers : int or None for one a core; an experiment that measures time has one, whatever is asked for
    progress : called with the number of samples that each finished chunk had

    Returns
    -------
    Outcome
    """
    todo = chunks(experiment, samples, seed)
    workers = min(workers or cores(), len(todo))
    experiment.measure(1, np.random.SeedSequence(WARM_UP_SEED))
    began = time.perf_counter()
    if experiment.timed or workers == 1:
        results = []
        for size, child in todo:
            results.append(experiment.measure(size, child))
            progress(size)
    else:
        results = _parallel(experiment.measure, todo, workers, progress)
    rows = experiment.conclude(results)
    return Outcome(results, rows, samples, seed, time.perf_counter() - began)


def cores():
    """Number of cores that this process may use: int."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _parallel(measure, todo, workers, progress):
    """Results in the order of the chunks; an interruption or a fault ends the workers at once."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_prepare_worker)
    before = set(multiprocessing.active_children())
    try:
        futures = [pool.submit(measure, *chunk) for chunk in todo]
        results = []
        for future, (size, _) in zip(futures, todo, strict=True):
            results.append(future.result())
            progress(size)
    except BaseException:
        with _undisturbed():
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()
    return results


@contextmanager
def _undisturbed():
    """A second Ctrl-C must not stop the tidying up. Only the main thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


def _prepare_worker():
    """Leave Ctrl-C to the parent, and end when the parent is gone, however it ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch():
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
