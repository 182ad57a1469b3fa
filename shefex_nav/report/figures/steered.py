"""Which tasks of its programme steer a vehicle in a phase of the mission."""

from itertools import pairwise

from shefex_nav.records import Phase

_LEAST_S = 0.2  # of a part of a phase


def steered(events, phase, start, end):
    """Parts of a phase by the tasks that steer in it: (name, begin, end) of each, s; its own name where none.

    The events of a task are `NAME_start` and `NAME_end`.
    """
    if phase not in (Phase.MANOEUVRE, Phase.POINTING):
        return [(phase.name.lower(), start, end)]
    at = {event.name: event.t_s for event in events}
    begun = sorted((t_s, name.removesuffix("_start")) for name, t_s in at.items() if name.endswith("_start"))
    cuts = [start, *(t_s for t_s, _ in begun if start + _LEAST_S < t_s < end - _LEAST_S), end]
    found = []
    for begin, until in pairwise(cuts):
        names = [name for t_s, name in begun if t_s < until - _LEAST_S]
        name = names[-1] if names and at.get(f"{names[-1]}_end", end) > begin + _LEAST_S else None
        found.append((phase.name.lower() if name is None else name.replace("_", " "), begin, until))
    return found
