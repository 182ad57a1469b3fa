"""Lines of the closing table: fate of the measurements, consistency of errors and sigmas, what errors fit."""

from rich.text import Text

from shefex_nav.report import sensor_use
from shefex_nav.report.beyond_sigma import FAR
from shefex_nav.report.sizes import number

TOO_SURE = 2.0  # NEES over its degrees of freedom from which on it is said in words
ODD = "bold yellow"


def uses_stars(navigation):
    """Whether a star fix was used, as far as is known. navigation : of the summary"""
    found = (navigation.get("measurements") or {}).items()
    used = [one["used"] for name, one in found if name.startswith("star")]
    return not used or any(one != 0 for one in used)


def of_sensors(navigation):
    """(name, text) of the measurements of GPS and star tracker, of what was on board."""
    for name, words, is_odd in sensor_use.rows(navigation.get("measurements") or {}):
        yield name, Text(words, style=ODD if is_odd else "")


def rows(navigation):
    """(name, text) of the NEES, of errors far beyond their sigmas, of what the errors fit."""
    nees = navigation["nees"]
    if nees["mean"] is not None:
        yield "NEES", _nees_words(nees)
    elif nees.get("why"):
        yield "NEES", nees["why"]
    if stretches := navigation.get("beyond_sigma"):
        yield "beyond sigma", Text(_beyond(stretches), style=ODD)
    for one in navigation.get("errors_fit") or ():
        yield "errors fit", Text(fit_words(one), style=ODD)
    for words in navigation.get("unknown") or ():
        yield "not known", words


def _beyond(stretches):
    """Since when which errors are far beyond their sigmas: the first stretch of each quantity."""
    first, said = {}, []
    for one in stretches:
        first.setdefault(one["quantity"], one)
    for one in sorted(first.values(), key=lambda one: one["from_s"]):
        end = "to the end" if one["until_s"] is None else f"to T{one['until_s']:+.1f} s"
        said.append(f"{one['quantity']} from T{one['from_s']:+.1f} s {end}, up to {times(one['times'])}")
    later = len(stretches) - len(first)
    more = f"; {later} more {'stretch' if later == 1 else 'stretches'} later" if later else ""
    return f"errors above {FAR:g} times their sigma: {'; '.join(said)}{more}"


def _nees_words(nees):
    """Errors over what the filter believes of them."""
    what = f"{number(nees['mean'], 1)} for {nees['dof']} degrees of freedom, {nees['samples']} epochs"
    if nees.get("why"):
        what = f"{what} {nees['why']}"
    if nees["mean"] <= TOO_SURE * nees["dof"]:
        return what
    return Text(f"{what}: errors are larger than the filter's sigmas say{_times(nees)}", style=ODD)


def _times(nees):
    """How many times larger those of each block are."""
    said = [
        f"{name} {times(one)}" for name, one in (nees.get("times_sigma") or {}).items() if one is not None
    ]
    return f": {', '.join(said)} (1 would be right)" if said else ""


def times(ratio):
    """A ratio of errors and sigmas, for people."""
    return f"{number(ratio, 1 if ratio < 10.0 else 0)} times"


def beyond_words(one):
    """A Beyond, for people."""
    return f"{one.quantity} error up to {times(one.times)} the sigma that the solution reports"


def fit_words(one):
    """An entry of `errors_fit`, for people."""
    return f"{one['what']}; T{one['from_s']:+.1f} to {one['until_s']:+.1f} s"
