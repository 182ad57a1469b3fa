"""Dispersions with which no run could fly: some draws are tried before anything is flown.

A draw that a run would refuse is the run's affair, as long as others fly: fields that are good by themselves
may contradict each other. Where all draws are refused, the dispersion is wrong.
"""

import copy
import random

from shefex_nav.scenario import fields
from shefex_nav.scenario.dispersions import Group
from shefex_nav.scenario.drawn import applied
from shefex_nav.scenario.laws import ChoiceLaw, TableLaw

TRIES = 8


def refused(model, tree, section, dispersed, complaint):
    """(path of the field, text for people) of dispersions that every run would refuse: list.

    Parameters
    ----------
    model, tree, section : as of `disperse.resolve`
    dispersed : what that gives, all good
    complaint : function of a tree that says what a run would say of it, '' if it would fly
    """
    if not dispersed or not _complaint(model, tree, dispersed, complaint):
        return []
    found = []
    for name, one in section.items():
        names = one.paths if isinstance(one, Group) else [name]
        alone = [one for one in dispersed if one.name in names]
        if words := _complaint(model, tree, alone, complaint):
            found.append((("dispersions", name), f"every run would refuse what is drawn: {words}"))
    return found


def _complaint(model, tree, dispersed, complaint):
    """What runs say that draw these values and no others; '' if one of them would fly."""
    words = ""
    for k in range(TRIES):
        tried, rng = copy.deepcopy(tree), random.Random(k)
        for one in dispersed:
            fields.fill(model, tried, one.path)
            fields.put(tried, one.path, applied(one, _draw(one.law, k, rng)))
        if not (said := complaint(tried)):
            return ""
        words = words or said
    return words


def _draw(law, k, rng):
    """A value that run k may draw."""
    reach = law.reach()
    if isinstance(law, ChoiceLaw | TableLaw):
        return reach[k % len(reach)]
    low, high = reach
    return low + rng.random() * (high - low)
