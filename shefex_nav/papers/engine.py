"""Run an experiment on the cores of the machine.

The samples are cut into chunks and each chunk gets its own child of the seed, so that the results are the
same with one worker and with many. The parent draws one sample first, which compiles and caches the kernels;
workers that compiled together would write the same cache files at once.
"""

import time
from contextlib import closing
from typing import NamedTuple

import numpy as np

from shefex_nav.workers import cores, each

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


def run(experiment, *, samples, seed, workers=None, progress=lambda done: None, store=None):
    """Measure and conclude.

    Parameters
    ----------
    experiment : Experiment; `measure` must be importable (a function of a module)
    samples : int, >= 1
    seed : int
    workers : int or None for one a core; an experiment that measures time has one, whatever is asked for
    progress : called with the number of samples that each finished chunk had
    store : keep.Store or None; chunks that it holds are not measured again, new ones are put into it

    Returns
    -------
    Outcome
    """
    every = chunks(experiment, samples, seed)
    results = [None if store is None else store.load(k, size) for k, (size, _) in enumerate(every)]
    todo = {}
    for k, (size, child) in enumerate(every):
        if results[k] is None:
            todo[k] = (size, child, k * experiment.chunk) if experiment.designed else (size, child)
        else:
            progress(size)
    if todo:
        first = (0,) if experiment.designed else ()
        experiment.measure(1, np.random.SeedSequence(WARM_UP_SEED), *first)
    began = time.perf_counter()
    with closing(_measured(experiment, todo, min(workers or cores(), len(todo)))) as measured:
        for k, result in measured:
            results[k] = result
            if store is not None:
                store.save(k, every[k][0], result)
            progress(every[k][0])
    rows = experiment.conclude(results)
    return Outcome(results, rows, samples, seed, time.perf_counter() - began)


def _measured(experiment, todo, workers):
    """(number, result) of each chunk as it is done: iterator."""
    if experiment.timed or workers <= 1:
        for k, chunk in todo.items():
            yield k, experiment.measure(*chunk)
    else:
        yield from each(experiment.measure, todo, workers)
