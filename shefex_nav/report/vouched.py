"""Why a requirement of an error is met and the same quantity is not usable: both are true, in one sentence.

The truth says how large an error is; the computer on board says what it can vouch for. A protection level is
so many sigmas as the integrity risk asks, and what a fault that nobody has noticed may add (decision 0014).
"""

from shefex_nav.records import QUANTITIES, Doubt
from shefex_nav.report import doubts, trust
from shefex_nav.report.sizes import number

SELDOM = 0.05  # share of the time; usable for less is hardly usable


def sentences(summary, judged):
    """(quantity, sentence) of each quantity with a met requirement that is not usable when it counts.

    summary : of `metrics.summarise`;  judged : of requirements.Judged
    """
    nav = summary["navigation"]
    if nav["integrity"] is None:
        return
    met = {one.name for one in judged if one.passed and one.found is not None}
    for quantity in QUANTITIES:
        one = nav["integrity"][quantity]
        entry = one["at_entry"] if f"{quantity}_at_entry" in met else None
        if entry is not None and not entry["usable"]:
            yield quantity, _sentence(quantity, one, entry, nav["at_entry"])
        elif one["usable_share"] < SELDOM and met & {f"{quantity}_at_entry", f"{quantity}_while_pointing"}:
            yield quantity, _sentence(quantity, one)


def _sentence(quantity, one, entry=None, errors=None):
    """one, entry : of the integrity, the latter where it is not usable then;  errors : at entry"""
    name = entry["doubt"] if entry else max(one["doubts"], key=one["doubts"].get)
    limit = one.get(f"limit_{trust.UNITS[quantity][0]}")
    why = doubts.words(Doubt[name.upper()], quantity, limit, one.get("limit_by_default", False))
    when = "At entry" if entry else f"For {100.0 * one['doubts'][name]:.1f} % of the time"
    said = f"both are true: the error was small, but the computer on board cannot vouch for it. {when}: {why}"
    if name != Doubt.LEVEL.name.lower():
        return said
    size = _size(quantity, entry, errors) if entry else ""
    return (
        f"{said}{size}. A level is as many sigmas as requirements.integrity_risk asks, and what an unnoticed "
        f"fault may add: make sigma smaller, or requirements.{quantity}.limit larger"
    )


def _size(quantity, entry, errors):
    """The largest protection level at entry, and of an attitude the largest sigma beside it."""
    levels, unit = entry[f"protection_{trust.UNITS[quantity][0]}"], doubts.UNITS[quantity][0]
    if None in levels:
        return ""
    sigmas = errors["attitude_sigma_deg"] if quantity == "attitude" else None
    beside = f", with a sigma of {number(max(sigmas), 3, unit)}" if sigmas else ""
    return f": {number(max(levels), 3, unit)}{beside}"
