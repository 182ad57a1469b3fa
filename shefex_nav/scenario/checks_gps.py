"""Contradictions in the section `gps` of a scenario: (path of the field, text for people)."""

from functools import partial

from shefex_nav.clock import TICK_HZ
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.checks_flight import possible_events, seconds
from shefex_nav.scenario.messages import close
from shefex_nav.scenario.partial import of_each

NOMINAL = 24  # satellites of the nominal constellation
LONGEST_AGE_DAYS = 182.0  # of an almanac; its orbits are good to some kilometres in the week it is made for


def _outages(scenario):
    """Outages after events that the flight can have, with durations the right way round."""
    events = possible_events(scenario)
    yield from of_each(scenario.gps.outages, partial(_outage, events))


def _outage(events, number, outage):
    path = ("gps", "outages", number)
    if outage.shortest > outage.longest:
        words = f"{seconds(outage.shortest)} is longer than longest, {seconds(outage.longest)}"
        yield (*path, "shortest"), words
    if not events:
        yield path, "a vehicle that stands on the ground has no events; write outages: []"
    elif outage.event not in events:
        known = f"choose from: {', '.join(events)}"
        words = f"'{outage.event}' is no event of this flight{close(outage.event, events)}; {known}"
        yield (*path, "event"), words


def _almanac(scenario):
    """Elements of one length, of satellites told apart, of about the time of the mission."""
    section, path = scenario.gps.almanac, ("gps", "almanac")
    if section is None:
        return
    n = len(section.prn)
    uneven = [key for key in type(section).keys() if len(getattr(section, key)) != n]
    if not n:
        yield (*path, "prn"), "there is no satellite; give one at least, or leave the almanac out"
    for key in uneven:
        yield (*path, key), f"{len(getattr(section, key))} values for {n} satellites; give one for each"
    if len(set(section.prn)) < n:
        twice = next(prn for prn in section.prn if section.prn.count(prn) > 1)
        yield (*path, "prn"), f"satellite {twice} is there twice; keep one of them"
        return
    if uneven or not n:
        return
    if all(section.health):
        yield (*path, "health"), "no satellite is healthy (health 0)"
    from shefex_nav.environment import yuma
    from shefex_nav.scenario.params import almanac

    age_days = max(yuma.age_s(almanac(scenario), scenario.mission.epoch) / 86400.0, key=abs)
    if abs(age_days) > LONGEST_AGE_DAYS:
        when = "before" if age_days > 0.0 else "after"
        words = (
            f"the almanac is of {abs(age_days):.0f} days {when} the mission's epoch, its orbits do not hold "
            f"for so long; take one of less than {LONGEST_AGE_DAYS:.0f} days"
        )
        yield path, words


def _spans(scenario):
    """Times the right way round, limits that say one thing, satellites that there are."""
    gps = scenario.gps
    yield from of_each(gps.only, _span)
    known = range(1, NOMINAL + 1) if gps.almanac is None else gps.almanac.prn
    yield from of_each(gps.only, partial(_satellites, known))


def _span(number, span):
    if span.start >= span.end:
        words = f"{seconds(span.end)} is not after from, {seconds(span.start)}"
        yield ("gps", "only", number, "until"), words


def _satellites(known, number, limit):
    path = ("gps", "only", number)
    if (limit.satellites is None) == (limit.prn is None):
        yield path, "give one of satellites (how many) and prn (which ones)"
    for k, prn in enumerate(limit.prn or ()):
        if prn not in known:
            numbers = ", ".join(str(one) for one in known)
            yield (*path, "prn", k), f"there is no satellite {prn}; choose from: {numbers}"


def _clock(scenario):
    """Ranges need the clock of the receiver."""
    states = scenario.navigation.states
    if scenario.navigation.gps == "tight" and states != AUTOMATIC and "clock" not in states:
        words = f"gps: tight needs the clock of the receiver; write [{', '.join([*states, 'clock'])}]"
        yield ("navigation", "states"), words


def _reacquisition(scenario):
    """Durations the right way round."""
    wait = scenario.gps.reacquisition
    if wait is not None and wait.shortest > wait.longest:
        words = f"{seconds(wait.shortest)} is longer than longest, {seconds(wait.longest)}"
        yield ("gps", "reacquisition", "shortest"), words


def _rate(scenario):
    """Fixes that the clock can trigger, those on whole seconds among them."""
    rate = scenario.gps.rate
    whole = round(rate)
    if whole < 1 or abs(rate - whole) > 1e-6 or abs(TICK_HZ / rate - round(TICK_HZ / rate)) > 1e-6:
        words = (
            f"{rate:g} Hz does not divide the on-board clock, 100 Hz; take 1, 2, 4, 5, 10, 20, 25 or 50 Hz"
        )
        yield ("gps", "rate"), words


def _satellite_errors(scenario):
    """A rate within bounds."""
    drawn = scenario.gps.errors.satellite
    if drawn is not None and drawn.rate > 0.0 and not drawn.range > 0.0:
        words = "errors swing with this rate within range, which is 0 m; give gps.errors.satellite.range"
        yield ("gps", "errors", "satellite", "rate"), words


PARTS = (_rate, _outages, _almanac, _spans, _clock, _reacquisition, _satellite_errors)
