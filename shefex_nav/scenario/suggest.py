"""What was meant by a key that a scenario does not know.

Another spelling, another place, a unit too many; or it is of earlier versions and elsewhere now (`moved`).
"""

import difflib
import re
from functools import cache
from typing import Annotated, NamedTuple, get_args, get_origin

from pydantic import BaseModel

_NOW = {  # path: what to write instead of a value, and of null
    ("requirements", "attitude_at_entry"): (
        "requirements.attitude: {{limit: {value}, at_entry: true}}",
        "requirements.attitude: {at_entry: false}",
    ),
    ("requirements", "protection_at_entry"): (
        "requirements.attitude: {{limit: {value}, protection_at_entry: true}}",
        "requirements.attitude: {protection_at_entry: false}",
    ),
    ("requirements", "position_at_entry"): (
        "requirements.position: {{limit: {value}, at_entry: true}}",
        "requirements.position: {at_entry: false}",
    ),
    ("requirements", "velocity_at_entry"): (
        "requirements.velocity: {{limit: {value}, at_entry: true}}",
        "requirements.velocity: {at_entry: false}",
    ),
    ("navigation", "integrity", "risk"): (
        "requirements.integrity_risk: 1e-5 /h",  # per hour of use; the old one was per independent error
        "requirements.integrity_risk: 1e-5 /h",
    ),
    ("principal_point",): (
        "star_camera: {{optics: {{principal_point: {value}}}}}",
        "star_camera: {optics: {principal_point: null}}",
    ),
    ("distortion",): (
        "star_camera: {{optics: {{distortion: {value}}}}}",
        "star_camera: {optics: {distortion: null}}",
    ),
    ("navigation", "integrity", "attitude"): (
        "requirements.attitude: {{limit: {value}}}",
        "requirements.attitude: {limit: null}",
    ),
}
ANY = "*"  # a name that the user gives, or the number of an item
ALIKE, NEARLY = 0.6, 0.8  # of difflib: among keys of the same section, among all others
MOST = 3  # places named
APART = ("dispersions", "campaign")  # sections whose keys are no values of the mission
TOLD = ("navigation", "told")  # whose keys are those of other sections again
UNITS = set(
    "m mm cm km s ms us min h hz khz deg rad mrad arcsec arcmin kg g n kn m2 cm2 mm2 pa hpa k db dn electron "
    "px pix percent ppm mag gee mgee ugee rpm rev per sqrt s2 m3".split()
)
SAME = {  # words of other programs: ours
    "alt": "height",
    "altitude": "height",
    "begin": "from",
    "start": "from",
    "end": "until",
    "stop": "until",
    "to": "until",
    "freq": "rate",
    "frequency": "rate",
    "fps": "rate",
    "frame_rate": "rate",
    "delay": "latency",
    "duration": "time_limit",
    "algorithm": "method",
    "width": "columns",
    "height": "rows",
    "az": "azimuth",
    "el": "elevation",
    "arw": "random_walk",
    "vrw": "random_walk",
    "date": "epoch",
    "time": "epoch",
    "gnss": "gps",  # of flights and of replays
    "gps": "gnss",
}
WORDS = {"max": "highest", "maximum": "highest", "min": "lowest", "minimum": "lowest", "number": "most"}


class Meant(NamedTuple):
    """What a key was probably meant to be."""

    path: tuple  # of the key that was meant; () if nothing is like it
    is_sibling: bool  # whether it is in the section in which the unknown one stands
    words: str  # for people; '' if nothing is like it


NOTHING = Meant((), False, "")


def meant(model, known, path, value=None):
    """What was meant by the key at the end of `path`.

    model : the whole scenario's
    known : keys of the section in which it stands
    value : what was given
    """
    key = str(path[-1])
    name = spelt(key)
    nearly = difflib.get_close_matches(name, list(known), n=1, cutoff=NEARLY)
    spelt_so = _respelt(name, known) or _without_unit(name, known, value)
    for found in (spelt_so, (nearly[0], "") if nearly else None):
        if found is not None:
            sibling, more = found
            return Meant((*path[:-1], sibling), True, f"did you mean '{sibling}'?{more}")
    everywhere = [one for one in _paths(model) if not _apart(one) or (one[0] == path[0] and _apart(path))]
    elsewhere = _telling(path, [one for one in everywhere if one[-1] == name])
    if elsewhere:
        spelling = "it" if name == key else f"'{name}'"
        return Meant(elsewhere[0], False, f"{spelling} {_where(elsewhere)}")
    if (found := _holding(model, known, path, value) or _alike(name, known)) is not None:
        return Meant((*path[:-1], found), True, f"did you mean '{found}'?")
    likely = difflib.get_close_matches(name, {one[-1] for one in everywhere}, n=1, cutoff=NEARLY)
    likely = likely or [one[-1] for one in everywhere if len(one) == 1 and name in one[-1].split("_")][:1]
    found = _telling(path, [one for one in everywhere if one[-1] in likely])
    found = [one for one in found if len(one) == 1 or one[: len(path) - 1] == tuple(map(str, path[:-1]))]
    if found:  # within the same section, or a section of its own: a misspelt key stands where it belongs
        return Meant(found[0], False, f"did you mean {' or '.join('.'.join(one) for one in found)}?")
    return NOTHING


def _apart(path):
    """Whether a path is no value of the mission, or one that the computer is told in place of another."""
    return path[0] in APART or tuple(path[:2]) == TOLD


def spelt(key):
    """A key in the spelling of scenarios: focalLength and Focal-Length are focal_length."""
    return re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", key).lower()).strip("_")


def _respelt(name, known):
    """A key that differs in its spelling, number or order of words only, or is another word for it."""
    words = sorted(_singular(name).split("_"))
    for one in known:
        if one == name or _singular(one) == _singular(name) or sorted(_singular(one).split("_")) == words:
            return one, ""
    ours = "_".join(WORDS.get(word, word) for word in name.split("_"))
    return next(((one, "") for one in (SAME.get(name), ours) if one in known), None)


def _singular(name):
    return re.sub(r"s(?=_|$)", "", name)


def _without_unit(name, known, value):
    """A key that has its unit at its end: ('focal_length', ' Its unit ...')."""
    for one in known:
        unit = name.removeprefix(f"{one}_")
        if unit != name and set(unit.split("_")) <= UNITS:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            text = f"{one}: {value} {_unit(unit)}" if number else f"{one}: ... {_unit(unit)}"
            return one, f" Its unit stands beside the value: '{text}'"
    return None


def _unit(suffix):
    """`m/s` of m_s, deg/s of deg_per_s; a unit in the case in which engineers write it."""
    text = suffix.replace("_per_", "/").replace("_", "/")
    return {"hz": "Hz", "khz": "kHz", "n": "N", "nm": "N m", "pa": "Pa", "k": "K", "db": "dB"}.get(text, text)


def _holding(model, known, path, value):
    """The section beside that has the keys which were given, for a section with another name."""
    if not isinstance(value, dict) or not value:
        return None
    inner = {
        one[-2:] for one in _paths(model) if len(one) == len(path) + 1 and _shared(one, path) == len(path) - 1
    }
    found = [one for one in known if all((one, key) in inner for key in value)]
    return found[0] if len(found) == 1 else None


def _where(places):
    """`belongs under star_camera.optics`."""
    if places[0][:-1]:
        return f"belongs under {' or '.join('.'.join(one[:-1]) for one in places)}"
    return "is a section of its own, at the left margin"


def _alike(name, known):
    """The key that is most like the name, by its letters, as its abbreviation or by one of its words."""
    found = [one for one in known if len(name) > 2 and (one.startswith(name) or name in one.split("_"))]
    found = found or [one for one in known if len(one) > 3 and one in name.split("_")]
    found = found if len(found) == 1 else difflib.get_close_matches(name, list(known), n=1, cutoff=ALIKE)
    return found[0] if found else None


def _telling(path, places):
    """Those of the nearest places that can have been meant: near by, a section, the only one of such a name.

    A rate, an error or a mass is in many sections; that one of them is far away says nothing.
    """
    near = [one for one in _nearest(path, places) if _is_near(one, path)]
    if near or _apart(path):
        return near
    sections = [one for one in places if len(one) == 1]
    return _nearest(path, sections or (places if len(places) == 1 else []))


def _is_near(place, path):
    """Whether a place is in the section of a path or in the one around that, within one of the mission's."""
    above = len(TOLD) if tuple(path[:2]) == TOLD else int(path[0] in APART)
    around = len(path) - 2  # sections around the one in which the key stands
    return _shared(place, path) >= max(around, above + 1)


def _nearest(path, places):
    """Those places that share the most with a path, its own names in the stead of any."""
    placed = [_placed(one, path) for one in places]
    shared = [_shared(one, path) for one in placed]
    best = [one for one, depth in zip(placed, shared, strict=True) if depth == max(shared)]
    return best if len(best) <= MOST else []


def _placed(place, path):
    """A place of the model with the names that the user gave."""
    found = list(place)
    for k, part in enumerate(place):
        if part != ANY:
            continue
        own = k < len(path) - 1 and _shared(found, path) >= k
        found[k] = str(path[k]) if own else "NAME"
    return tuple(found)


def _shared(one, other):
    count = 0
    for a, b in zip(one, other, strict=False):
        if a != str(b):
            break
        count += 1
    return count


@cache
def _paths(model):
    """Paths of all keys of a model, each once."""
    return tuple(dict.fromkeys(_walk(model, ())))


def _walk(annotation, path):
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for key, field in annotation.keys().items():
            yield (*path, key)
            yield from _walk(field.annotation, (*path, key))
        return
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is dict:
        yield from _walk(arguments[1], (*path, ANY))
    elif origin in (list, tuple):
        yield from _walk(arguments[0], (*path, ANY))
    else:
        for option in arguments:
            yield from _walk(option, path)


def moved(path, value=None):
    """What is said of a key that has moved; "" of any other.

    path : tuple of keys;  value : as it was given, None for null
    """
    if path not in _NOW:
        return ""
    given, taken = _NOW[path]
    return f"has moved; write '{taken if value is None else given.format(value=value)}'"
