"""What an experiment is: how it samples, what it concludes, what it draws.

An experiment does not know how many processes run it. Its samples come in chunks of a fixed size with a seed
each, so the outcome depends on the seed and the number of samples alone. Results that are to be kept from run
to run (`keep`) are dictionaries of arrays.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from shefex_nav.papers.verdict import Verdict


class Row(NamedTuple):
    """One published figure beside the measured one."""

    quantity: str
    condition: str
    published: float | None  # None where the paper gives no figure
    measured: float
    ci95: tuple[float, float] | None = None  # None where the measurement has no sampling error (a count)
    verdict: Verdict = Verdict.NONE
    tolerance: float | None = None  # difference up to which the two are the same; None: no such comparison
    why: str = ""  # of a difference or of a verdict that was left open
    run: str = ""  # experiment/variant, the run that explains a difference


class Experiment(NamedTuple):
    """One experiment of a paper."""

    samples: int  # as in the paper
    unit: str  # what a sample is, e.g. 'attitudes'
    chunk: int  # samples a worker draws at a time
    measure: Callable[[int, Any], Any]  # (samples, numpy.random.SeedSequence) -> anything that can be pickled
    conclude: Callable[[list], list[Row]]  # results of `measure`, in the order of the chunks -> rows
    draw: Callable[
        [Any, list, list[Row]], None
    ]  # (matplotlib Figure, results, rows): a figure like the paper's
    timed: bool = False  # measures time: one process, nothing beside it
    designed: bool = False  # sample number k is laid down: measure(samples, seed, number of the first)
    kept: tuple = ()  # modules or folders of `papers` that make the results; empty: they cannot be kept
    title: str = ""  # one line, with the paper's table, figure or section: that of the registry
    brief: int | None = None  # samples where the experiment is one of all; None: as many as alone
