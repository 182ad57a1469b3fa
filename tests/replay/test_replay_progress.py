"""How far a replay is, on stderr."""

import numpy as np

from shefex_nav import progress
from shefex_nav.commands import flights
from shefex_nav.records import ImuBlock


def block(t_s):
    return ImuBlock(t_s, t_s, 0.0025, np.zeros((4, 3)), np.zeros((4, 3)), False, True)


def test_a_replay_says_how_far_it_is(monkeypatch, capsys):
    """A line for each tenth where stderr is no terminal; what is replayed passes as it is."""
    clock = iter(np.arange(0.0, 1e6, 0.5))
    monkeypatch.setattr(progress.lines, "__defaults__", (0, lambda: next(clock)))
    given = [block(10.0 + 0.5 * k) for k in range(401)]
    assert list(flights.followed(iter(given), 10.0, 210.0)) == given
    said = capsys.readouterr().err.splitlines()
    assert said == [f"T{10 + 20 * k:+d} s of T+210 s" for k in range(1, 10)]
