"""The filter of the on-board computer while one angle of the attitude is not known: a Bank in its place.

Tick by tick all filters of the Bank get the same; the one with most weight stands for them towards the star
tracker. What is told is the mixture of all. Once they agree, one filter goes on from there.
"""

from shefex_nav.onboard.navigation import fusion, ticks
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.hypotheses import Bank, is_wide
from shefex_nav.onboard.navigation.state import BG

KNOWN = BG.stop  # errors that the mixture knows


def start(params, alignment, earth):
    """Filter of the best member, and the Bank; a filter of its own and None where one is enough.

    NavParams, Alignment, EarthRotation -> fusion.Filter, Bank or None
    """
    if not is_wide(alignment):
        return fusion.start(params, alignment, earth), None
    bank = Bank(params, alignment, earth)
    return bank.best, bank


def advance(bank, blocks, k):
    """One tick on with all filters of a Bank. blocks : ImuBlock of arrays, of which row k is meant"""
    for member in bank.members:
        ticks.advance(member.nav, blocks, k, k + 1)


def fuse(bank, arrived):
    """Give all filters what has arrived. -> list of GateResult of the one that is best afterwards"""
    results = {}
    for member in bank.members:
        results[member.number] = fusion.take(member.nav, arrived)
    bank.prune()
    return results[bank.best_member.number]


def settled(bank, params, earth):
    """Filter that goes on from a Bank whose filters agree; None if they do not."""
    mixture = bank.mixture()
    return fusion.start(params, mixture.alignment(), earth) if mixture.is_settled else None


def mixed_filter(bank):
    """Filter that holds the mixture at the last tick, to be told of; not to be advanced."""
    mixture, best = bank.mixture(), bank.best
    tick = best.history[-1]
    P = tick.P.copy()
    P[:KNOWN] = 0.0
    P[:, :KNOWN] = 0.0
    P[:KNOWN, :KNOWN] = mixture.about_best
    driving = best.history.drives.shape[2]
    return best._replace(history=History(Tick(tick.t_s, tick.x, P, tick.imu), driving=driving))
