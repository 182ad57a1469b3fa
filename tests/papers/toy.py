"""Experiments for the tests of the engine: small, and known in advance."""

import os
import time
from pathlib import Path

import numpy as np

from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.verdict import Verdict
from shefex_nav.report import intervals


def draw_normal(samples, seed):
    """(process, values)."""
    return os.getpid(), np.random.default_rng(seed).standard_normal(samples)


def conclude(results):
    values = np.concatenate([values for _, values in results])
    interval = intervals.mean(values) if len(values) > 1 else None
    return [
        Row("mean", "of a standard normal", 0.0, float(values.mean()), interval, Verdict.REPRODUCED, 0.1),
        Row(
            "impossible",
            "never measured",
            1.0,
            float("nan"),
            None,
            Verdict.OPEN,
            None,
            "there is nothing to measure it with",
        ),
    ]


def draw(figure, results, rows):
    axis = figure.subplots()
    axis.hist(np.concatenate([values for _, values in results]))


NORMAL = Experiment(1000, "numbers", 40, draw_normal, conclude, draw, title="a standard normal")


def fail(samples, seed):
    """The parent's first sample is good; what follows is not."""
    if samples > 1:
        raise ArithmeticError("no result")


def wait_long(samples, seed):
    """Leave a sign of life with this process' number, then wait for ever."""
    if samples > 1:
        Path(os.environ["SIGN_OF_LIFE"], str(os.getpid())).touch()
        time.sleep(600.0)
