"""Runs of a characterisation as they are kept, of numbers that could be."""

import numpy as np

from shefex_nav.campaign.characterise import collect, records
from shefex_nav.campaign.characterise.records import Flown


def flown(run=3):
    """A Flown with the fields' names and nothing behind them."""
    rng = np.random.default_rng(run)
    parts = [
        kind(*(_column(rng, kind, name) for name in kind._fields))
        for kind in (collect.Frames, collect.Sources, collect.Searches)
    ]
    return Flown(run, collect.Collected(*parts), {"a": 1.5, "b": "x"}, "0123abcd")


def _column(rng, kind, name):
    """Four rows of an array of a run."""
    if name in records.FLAGS:
        return rng.random(4) < 0.5
    if name in records.COUNTS:
        return rng.integers(0, 4, 4)
    width = records.WIDTHS.get((kind, name))
    return np.sort(rng.random(4)) if width is None else rng.random((4, width))
