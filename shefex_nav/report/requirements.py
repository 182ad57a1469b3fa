"""Whether a run kept what its scenario requires: the section `requirements` against the summary of the run.

A requirement whose figure a run does not have (no entry, no frame in the window) is not met by it: nothing
counts as passed that was not measured. A star camera that never left the air has measured nothing either:
what it would see there is not modelled. One that is judged by protection levels cannot be judged of software
of a user's own that gives none: it is neither met nor missed.
"""

import math
from typing import NamedTuple

from shefex_nav.records import QUANTITIES

AIR_KM = 100.0  # height of the event `entry`; the camera needs to be above it, and cold gas rules there


class Judged(NamedTuple):
    """One requirement and what a run made of it."""

    name: str
    required: float | bool  # the limit, in `unit`
    found: float | bool | None  # None: the run has no such figure
    unit: str  # "" for counts and what is true or not
    passed: bool
    note: str = ""  # what the figure is made of, or why there is none
    judgeable: bool = True  # False: the software does not give what it is judged by


OF_LIMIT = {  # requirement: the section with its limit, the key that says whether it is required
    **{f"{quantity}_at_entry": (quantity, "at_entry") for quantity in QUANTITIES},
    **{f"{quantity}_protection_at_entry": (quantity, "protection_at_entry") for quantity in QUANTITIES},
    **{f"{quantity}_while_pointing": (quantity, "while_pointing") for quantity in QUANTITIES},
}
WHILE_POINTING, SOLVED = "navigation.while_pointing", 0.99  # of the ticks: less is not measured
ONCE, GROWS, MOVES = "once", "grows", "moves"  # nothing; make it larger; make it larger or smaller


class _Measure(NamedTuple):
    """How a requirement is measured."""

    figure: object  # function of `get`, which gives the value at a dotted path of the summary
    unit: str
    factor: float  # from the scenario's SI to `unit`
    word: str  # how the limit is meant
    further: str = ONCE  # what the rest of a mission may do to the figure of a part of it
    note: object = lambda get: ""  # function of `get`: Judged.note
    by_levels: bool = False  # whether only software with protection levels can be judged


def _at(path):
    return lambda get: get(path)


def _largest(path):
    """Largest size of the elements of a vector."""

    def figure(get):
        values = get(path)
        return None if not values or None in values else max(abs(value) for value in values)

    return figure


def together(path):
    """Root of the sum of squares: the whole of what is horizontal and vertical."""

    def figure(get):
        values = get(path)
        return None if not values or None in values else math.hypot(*values)

    return figure


def _of_axes(path):
    """Note about the largest element of a vector, or why there is none."""
    return lambda get: "about the worst axis" if _largest(path)(get) is not None else _no_entry(get)


def _no_entry(get):
    """Note where there is no figure at entry because there was no entry."""
    top_km, entry_s = get("flight.apogee_km"), get("flight.at_entry.t_s")
    if entry_s is not None:
        return ""
    if top_km is not None and top_km < AIR_KM:
        return f"no entry, its apogee is {top_km:.1f} km"
    return f"it did not come down through {AIR_KM:.0f} km"


def _no_control(get):
    return "" if get("attitude_control.propellant_kg") is not None else "no attitude control that is flown"


def _no_frames(get):
    return "no frame taken" if get("star_tracker.frames") == 0 else ""


def _percent(path):
    return lambda get: None if get(path) is None else 100.0 * get(path)


def _star_fixes(get):
    solved, frames = get("star_tracker.solved"), get("star_tracker.in_window")
    return 100.0 * solved / frames if frames and not _in_air(get) else None


def _wrong_fixes(get):
    return None if get("star_tracker.frames") == 0 else get("star_tracker.wrong")


def _in_air(get):
    """Whether a vehicle flew, and never above the air."""
    apogee_km = get("flight.apogee_km")
    return apogee_km is not None and apogee_km < AIR_KM


def _frames(get):
    """What the share of star fixes is made of, or why it is none."""
    frames = get("star_tracker.in_window")
    if not frames:
        return "no frame in the window"
    if _in_air(get):
        return f"the camera stayed in the air, below {AIR_KM:.0f} km"
    return f"of {frames:.0f} frame{'s' if frames > 1 else ''}"


def _pointing(figure):
    """Note about the largest error while pointing: when it was, or why there is none."""

    def note(get):
        keys = ("from_s", "to_s", "solution_share", f"{figure}.max_at_s")
        first_s, last_s, share, at_s = (get(f"{WHILE_POINTING}.{key}") for key in keys)
        if first_s is None:
            return "it never pointed, or had no solution then"
        if share < SOLVED:
            return f"a solution for {100.0 * share:.0f} % of the pointing alone"
        whole = f"T{first_s:+.0f} to {last_s:+.0f} s"
        if at_s is None:  # a campaign of an earlier version does not say
            return f"at most, {whole}"
        stars_s = get("navigation.star_aided.from_s") if figure == "attitude_deg" else None
        early = stars_s is not None and at_s < stars_s
        early = ", before the second star fix" if early else ""
        return f"at T{at_s:+.1f} s{early}; the largest of {whole}"

    return note


def _while_pointing(figure):
    """The largest error while pointing, if there was a solution all the time."""

    def largest(get):
        share = get(f"{WHILE_POINTING}.solution_share")
        return None if share is None or share < SOLVED else get(f"{WHILE_POINTING}.{figure}.max")

    return largest


def _which(get):
    """What of the solution was misleading."""
    names = [q for q in QUANTITIES if get(f"navigation.integrity.{q}.misleading_share")]
    return f"of the time: {', '.join(names)}" if names else ""


DEG = math.degrees(1.0)
NO_LEVELS = "the software gives no protection level"
UNJUDGED = "not judged"
UNREACHED = "not reached"  # verdict of what a mission that was seen in part may still do
MEASURES = {
    "attitude_at_entry": _Measure(
        _largest("navigation.at_entry.attitude_error_deg"),
        "deg",
        DEG,
        "at most",
        note=_of_axes("navigation.at_entry.attitude_error_deg"),
    ),
    "position_at_entry": _Measure(
        _at("navigation.at_entry.position_error_m"), "m", 1.0, "at most", note=_no_entry
    ),
    "velocity_at_entry": _Measure(
        _at("navigation.at_entry.velocity_error_m_s"), "m/s", 1.0, "at most", note=_no_entry
    ),
    **{
        f"{quantity}_while_pointing": _Measure(
            _while_pointing(figure), unit, factor, "at most", GROWS, _pointing(figure)
        )
        for quantity, figure, unit, factor in (
            ("attitude", "attitude_deg", "deg", DEG),
            ("position", "position_m", "m", 1.0),
            ("velocity", "velocity_m_s", "m/s", 1.0),
        )
    },
    "usable_at_entry": _Measure(
        _at("navigation.integrity.at_entry.usable"), "", 1.0, "is", note=_no_entry, by_levels=True
    ),
    "position_protection_at_entry": _Measure(
        together("navigation.integrity.position.at_entry.protection_m"),
        "m",
        1.0,
        "at most",
        note=_no_entry,
        by_levels=True,
    ),
    "velocity_protection_at_entry": _Measure(
        together("navigation.integrity.velocity.at_entry.protection_m_s"),
        "m/s",
        1.0,
        "at most",
        note=_no_entry,
        by_levels=True,
    ),
    "attitude_protection_at_entry": _Measure(
        _largest("navigation.integrity.attitude.at_entry.protection_deg"),
        "deg",
        DEG,
        "at most",
        note=_no_entry,
        by_levels=True,
    ),
    "misleading": _Measure(
        _percent("navigation.integrity.misleading_share"),
        "%",
        100.0,
        "at most",
        MOVES,
        _which,
        by_levels=True,
    ),
    "wrong_star_fixes": _Measure(_wrong_fixes, "", 1.0, "at most", GROWS, _no_frames),
    "star_fixes": _Measure(_star_fixes, "%", 100.0, "at least", MOVES, _frames),
    "pointing_error": _Measure(
        _at("attitude_control.pointing_error_deg.max"), "deg", DEG, "at most", GROWS, _no_control
    ),
    "cold_gas": _Measure(_at("attitude_control.propellant_kg"), "kg", 1.0, "at most", GROWS, _no_control),
    "apogee": _Measure(_at("flight.apogee_km"), "km", 1e-3, "at least"),
}


def judge(requirements, summary):
    """Requirements of a scenario against the summary of one run.

    requirements : scenario.requirements.Requirements;  summary : object of `metrics.summarise`
    -> list of Judged, of those that are required, in the order of MEASURES
    """

    return judge_figures(limits(requirements), figures_of(summary))


def figures_of(summary):
    """Function that gives the value at a dotted path of a summary, None if there is none."""

    def get(path):
        value = summary
        for key in path.split("."):
            value = value.get(key) if isinstance(value, dict) else None
        return value

    return get


def limits(requirements):
    """{name: limit in its unit} of what is required."""
    wanted = {name: _wanted(requirements, name) for name in MEASURES}
    return {
        name: _limit(value, MEASURES[name])
        for name, value in wanted.items()
        if value is not None and value is not False
    }


def _wanted(requirements, name):
    """The limit of a requirement in SI; None or False where it is not required."""
    if name not in OF_LIMIT:
        return getattr(requirements, name)
    section, required = OF_LIMIT[name]
    block = getattr(requirements, section)
    return block.limit if getattr(block, required) else None


def _limit(value, measure):
    """A limit in the unit in which it is shown, without the last digits of a conversion there and back."""
    if isinstance(value, bool | int):
        return value
    return float(f"{value * measure.factor:.12g}")


def judge_figures(required, get):
    """The same of limits and of a function that gives the figure at a dotted path, None if there is none."""
    result = []
    for name, limit in required.items():
        measure = MEASURES[name]
        found = measure.figure(get)
        kept = _kept(found, limit, measure.word)
        judgeable = found is not None or not (measure.by_levels and _without_levels(get))
        note = measure.note(get) if judgeable else NO_LEVELS
        result.append(Judged(name, limit, found, measure.unit, kept, note, judgeable))
    return result


def _without_levels(get):
    """Whether software of a user's own navigated, and gave no protection levels."""
    is_own = any(get(f"software.{section}") is not None for section in ("navigation", "computer"))
    return is_own and get("navigation.integrity.attitude.usable_share") is None


def _kept(found, limit, word):
    if found is None:
        return False
    if word == "is":
        return found is limit
    return bool(found <= limit if word == "at most" else found >= limit)


def name_of(name):
    """A requirement in words."""
    return name.replace("_", " ")


def words(name, limit, unit):
    """A requirement for people: `at most 0.17 deg`."""
    word = MEASURES[name].word
    return "yes" if word == "is" else f"{word} {limit:g}{' ' if unit else ''}{unit}"


def in_words(one):
    """What a Judged found, for people."""
    if not one.judgeable:
        return f"cannot be judged: {one.note}"
    if one.found is None:
        return f"not measured: {one.note}" if one.note else "not measured"
    if isinstance(one.found, bool):
        return "yes" if one.found else "no"
    return f"{one.found:.4g}{' ' if one.unit else ''}{one.unit}{' ' if one.note else ''}{one.note}"


def verdict(one, is_part):
    """met, not met, not judged, and of a mission that was seen in part: so far, or not reached yet.

    one : Judged;  is_part : whether the mission was not seen to its end
    """
    if not one.judgeable:
        return UNJUDGED
    if one.found is None:
        return UNREACHED if is_part else "not met"
    words, further = "met" if one.passed else "not met", MEASURES[one.name].further
    is_final = further == ONCE or (further == GROWS and not one.passed)
    return words if is_final or not is_part else f"{words} so far"


def objects(judged, is_part):
    """What `--json` says of requirements: list of dicts. list of Judged; is_part : as of `verdict`

    name; bound: at most, at least or is; required and value in `unit`, value None where it was not measured;
    met, None where that is open; verdict and note, the words of the table
    """
    result = []
    for one in judged:
        words = verdict(one, is_part)
        is_open = one.found is None or words == UNJUDGED
        result.append(
            {
                "name": one.name,
                "bound": MEASURES[one.name].word,
                "required": one.required,
                "value": one.found,
                "unit": one.unit,
                "met": None if is_open else one.passed,
                "verdict": words,
                "note": one.note,
            }
        )
    return result


def severity(judged):
    """How bad a run is, to put runs in order: the number of requirements not met, then how near the limits.

    list of Judged -> float; its whole part counts what is not met, the rest grows with the largest share of
    a limit that was used up.
    """
    used = max((_used(one) for one in judged), default=0.0)
    return sum(one.judgeable and not one.passed for one in judged) + min(
        used / (1.0 + used) if math.isfinite(used) else 1.0, 0.999
    )


def _used(one):
    """Share of a limit that was used up: 1 at the limit; infinite where any is too much, 0 without shares."""
    if one.found is None or isinstance(one.required, bool):
        return 0.0
    if MEASURES[one.name].word == "at most":
        return abs(one.found / one.required) if one.required else math.inf if one.found else 0.0
    if one.unit == "%":  # of what may be missing
        return (100.0 - one.found) / max(100.0 - one.required, 1e-9)
    return one.required / one.found if one.found else math.inf
