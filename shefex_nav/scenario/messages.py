"""What pydantic found wrong -> one plain line per error: the place in the file, what would be right."""

import difflib
import re
from typing import Annotated, Literal, get_args, get_origin

from pydantic import BaseModel, Tag

from shefex_nav.scenario import suggest
from shefex_nav.scenario.block import BAD_KEY, is_tag
from shefex_nav.scenario.document import Mark, dotted
from shefex_nav.scenario.kind import of_the_other
from shefex_nav.scenario.quantity import describe, quoted

WITHOUT = {  # how to fly without what a section describes, which has to be there
    ("gps",): "without GPS a mission is flown with an outage of its whole time, such as "
    "'faults: {gps: [{fault: outage, from: 0 s, until: 1000 s}]}'",
    **dict.fromkeys(
        (("star_tracker",), ("star_camera",)),
        "without stars a mission is flown with star_tracker.enabled: false",
    ),
}
TIMES = "from", "until"  # an outage at given times is a fault
FAULT = (
    "an outage at given times is a fault: 'faults: {gps: [{fault: outage, from: 100 s, until: 130 s}]}'; "
    "gps.outages follow events of the flight, each of a duration that is drawn"
)
MANY, MOST = 3, 6  # sections that are missing, from which on they are said in one line; said alone
MOST_TOLD = 50  # errors of a scenario


class Places:
    """Where each key and value of a merged scenario was written."""

    def __init__(self, root):
        self.keys = {(): root}
        self.values = {(): root}
        self.made = set()  # paths of sections that are there because `--set` has put a value into them
        self.replaced = set()  # of those in whose place `--set` has put another whole one

    def copy(self):
        """The same places, to be changed."""
        other = Places(None)
        other.keys, other.values = dict(self.keys), dict(self.values)
        other.made, other.replaced = set(self.made), set(self.replaced)
        return other

    def key(self, path):
        """Mark of the key at `path`, or of the nearest section around it."""
        return self._nearest(self.keys, path)

    def value(self, path):
        """Mark of the value at `path`, or of the nearest section around it."""
        return self.values[path] if path in self.values else self._nearest(self.keys, path)

    def wrong(self, path, words):
        """(Mark, text) of what is wrong about the value at `path`."""
        return self.value(path), f"{dotted(path)}: {words}"

    def put(self, path, keys, values):
        """Replace everything known at and below `path`; `keys` and `values` are relative to it."""
        n = len(path)
        for marks in (self.keys, self.values):
            for old in [known for known in marks if len(known) >= max(n, 1) and known[:n] == path]:
                del marks[old]
        self.made = {known for known in self.made if known[:n] != path}
        self.replaced = {known for known in self.replaced if known[:n] != path}
        self.keys.update({(*path, *inner): mark for inner, mark in keys.items()})
        self.values.update({(*path, *inner): mark for inner, mark in values.items()})

    def take(self, paths, keys, values):
        """Replace what is known at and below each of a set of paths by what `keys` and `values` have there.

        In one pass: a file may have some ten thousand values.
        """
        for mine, others in ((self.keys, keys), (self.values, values)):
            for old in [known for known in mine if _is_within(known, paths)]:
                del mine[old]
            mine.update({known: mark for known, mark in others.items() if _is_within(known, paths)})
        self.made = {known for known in self.made if not _is_within(known, paths)}
        self.replaced = {known for known in self.replaced if not _is_within(known, paths)}

    @staticmethod
    def _nearest(marks, path):
        while path not in marks:
            path = path[:-1]
        return marks[path]


def _is_within(path, paths):
    """Whether a path is one of a set, or below one."""
    return any(path[:n] in paths for n in range(1, len(path) + 1))


def field_at(model, location):
    """(annotation, metadata) at a pydantic location inside `model`, (None, ()) if there is nothing."""
    annotation, metadata = model, ()
    for part in location:
        annotation, metadata = step(annotation, part)
    return bare(annotation, metadata)


def bare(annotation, metadata=()):
    """An annotation without Annotated and without `| None`, and what was annotated."""
    if get_origin(annotation) is Annotated:
        inner, *more = get_args(annotation)
        return bare(inner, (*metadata, *more))
    others = [option for option in get_args(annotation) if option is not type(None)]
    if len(others) < len(get_args(annotation)) and len(others) == 1:
        return bare(others[0], metadata)
    return annotation, metadata


def step(annotation, part):
    """One step of a location: a key, the number of an item, or the form of a section."""
    annotation, _ = bare(annotation)
    if is_tag(part):
        return next((option for option in get_args(annotation) if Tag(part) in bare(option)[1]), None), ()
    if is_model(annotation):
        field = annotation.keys().get(part)
        return (field.annotation, tuple(field.metadata)) if field else (None, ())
    if get_origin(annotation) is dict:
        return get_args(annotation)[1], ()
    if isinstance(part, int) and get_origin(annotation) in (list, tuple):
        return get_args(annotation)[0], ()
    return None, ()


def is_model(annotation):
    """Whether an annotation is a section of its own."""
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def is_section(annotation):
    """Whether an annotation is a section, in one form or in several."""
    annotation, _ = bare(annotation)
    return is_model(annotation) or any(is_model(bare(option)[0]) for option in get_args(annotation))


def _meant(model, error):
    """suggest.Meant of the unknown key of an error."""
    location = error["loc"]
    known = field_at(model, location[:-1])[0].keys()
    return suggest.meant(model, known, plain(location), error["input"])


def lines(model, validation_error, places):
    """(Mark, text) of each error in a pydantic ValidationError about `model`."""
    found, errors = [], validation_error.errors(include_url=False)
    absent = _absent(model, errors)
    if len(absent[()]) >= MANY:
        found.append((places.key(()), _all_absent(model, absent[()])))
        absent = dict.fromkeys(absent, ()) if len(absent[()]) >= MOST else absent | {(): ()}
    timed = dict.fromkeys(one["loc"][:-1] for one in errors if _is_timed_outage(one))
    for section in timed:
        found.append((places.key(plain(section)), f"{dotted(plain(section))}: {FAULT}"))
    errors = [one for one in errors if one["loc"][:-1] not in timed]
    for section in [one for one in absent if absent[one] and plain(one) in places.made]:
        found.append((places.key(plain(section)), _all_required(model, section)))
        absent[section] = ()
    for section in [one for one in absent if len(absent[one]) > 1 and plain(one) in places.replaced]:
        found.append((places.key(plain(section)), _incomplete(plain(section), absent[section], errors)))
        absent[section] = ()
    for error in errors:
        location = error["loc"]
        if len(found) >= MOST_TOLD:
            found.append((places.key(()), "more errors are told when these are mended"))
            break
        if error["type"] == "missing" and location[-1] not in absent[location[:-1]]:
            continue  # another message says it
        if error["type"] == "missing" and isinstance(location[-1], int):
            location = location[:-1]
            if any(text.startswith(f"{dotted(plain(location))}:") for _, text in found):
                continue  # one message for a list that lacks several values
        mark, words = _explain(model, error, location, places)
        found.append((mark, f"{dotted(plain(location))}: {words}"))
    return found


def paths(validation_error):
    """Path of each error in a pydantic ValidationError."""
    return [plain(error["loc"]) for error in validation_error.errors(include_url=False)]


def _absent(model, errors):
    """Keys that are missing in each section, without those that were given under a misspelt name."""
    absent = {error["loc"][:-1]: [] for error in errors} | {(): []}
    for error in errors:
        if error["type"] == "missing":
            absent[error["loc"][:-1]].append(error["loc"][-1])
    unknown = [one for one in errors if one["type"] == "extra_forbidden" and absent[one["loc"][:-1]]]
    for error in unknown[:MOST_TOLD]:  # of more, what was meant is not told
        section, meant = absent[error["loc"][:-1]], _meant(model, error)
        if meant.is_sibling and meant.path[-1] in section:
            section.remove(meant.path[-1])
    return absent


def _all_absent(model, absent):
    """About a file without many of its sections: one that was to extend another, most often."""
    return (
        f"{', '.join(absent)}: are missing; these sections are required. A file that gives only what differs "
        f"begins with the name of the one that has the rest, such as 'extends: {model.EXAMPLE}'"
    )


def _all_required(model, section):
    """About a section that is there for one value of it, which the user has set."""
    name, keys = dotted(plain(section)), field_at(model, section)[0].keys()
    required = [_line(model, (*section, key)) for key, field in keys.items() if field.is_required()]
    return (
        f"{name}: the scenario has no {name} yet; a section needs all of its required fields, for example "
        f"'{name.split('.')[-1]}: {{{', '.join(required)}}}'"
    )


def _is_timed_outage(error):
    """Whether an error is about a time of an outage of the receiver, which has none."""
    return plain(error["loc"])[:2] == ("gps", "outages") and error["loc"][-1] in TIMES


def _incomplete(section, absent, errors):
    """About a section that was given anew with a part of its fields."""
    name = dotted(section)
    given = next(one["input"] for one in errors if plain(one["loc"]) == (*section, absent[0]))
    return (
        f"{name}: this replaces the whole section, and {', '.join(absent)} are missing; to change single "
        f"values give each by its own path, as in '{name}.{next(iter(given), absent[0])}'"
    )


def plain(location):
    """Path of the scenario out of a pydantic location."""
    return tuple(part for part in location if not is_tag(part) and part != BAD_KEY)


def _explain(model, error, location, places) -> tuple[Mark, str]:
    kind, value, path = error["type"], error["input"], plain(location)
    if kind == "missing" and location == error["loc"]:
        return places.key(path[:-1]), f"is missing{_example(model, location)}"
    if kind == "extra_forbidden":
        return places.key(path), _unknown(model, error)
    if location[-1] == BAD_KEY:
        return places.key(path), f"{quoted(value)} must be one word of letters, digits, '-' and '_'"
    mark = places.value(path)
    if kind in ("missing", "too_short", "too_long", "tuple_type", "list_type"):
        shown = _example_list(field_at(model, location)[0])
        return mark, f"expected {_list_words(model, error, location)}, got {_length(value)}{shown}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        words = f"expected a section with keys of its own, got {describe(value)}"
        return mark, f"{words}{_keys(field_at(model, location)[0])}"
    if kind == "literal_error":
        return mark, f"{describe(value)} is not known; choose from: {_choices(model, error)}"
    if kind == "string_type":
        return mark, f"expected a text, got {describe(value)}"
    if kind == "string_too_short":
        return mark, "must not be empty"
    if kind == "string_too_long":
        return mark, f"has {len(value)} characters, expected {error['ctx']['max_length']} at most"
    if kind == "string_pattern_mismatch":
        return mark, f"{quoted(value)} must be one word of letters, digits, '.', '-' and '_'"
    if kind == "bool_type":
        return mark, f"expected true or false, got {describe(value)}"
    return mark, error["msg"]


def close(value, options):
    """`; did you mean 'x'?` if one of the options is like the value, else nothing."""
    found = difflib.get_close_matches(str(value), list(options), n=1, cutoff=0.6)
    return f"; did you mean '{found[0]}'?" if found else ""


def _choices(model, error):
    """`random, latin_hypercube`: what may stand there, and which of that was perhaps meant."""
    options = re.findall(r"'([^']*)'", error["ctx"]["expected"])
    items = _items_instead(model, error["loc"])
    several = f", or give a list of: {', '.join(items)}" if items else ""
    return f"{', '.join(options)}{several}{close(error['input'], [*options, *(f'[{one}]' for one in items)])}"


def _items_instead(model, location):
    """Words of which a list may be made in the place of the one word that is wrong, () if none may."""
    if not is_tag(location[-1]):
        return ()
    forms = [bare(option)[0] for option in get_args(field_at(model, location[:-1])[0])]
    lists = [get_args(form)[0] for form in forms if get_origin(form) is list]
    return next((get_args(one) for one in lists if get_origin(one) is Literal), ())


def _unknown(model, error):
    """Words about a key that is not known, or not in this form of the section."""
    location = error["loc"]
    known = field_at(model, location[:-1])[0].keys()
    if said := suggest.moved(plain(location), error["input"]):
        return said
    given = error["input"]
    if plain(location) == ("gps", "outage") and isinstance(given, dict) and set(TIMES) & set(given):
        return f"unknown key; {FAULT}"
    if is_tag(location[-2] if len(location) > 1 else ""):
        forms = [bare(option)[0] for option in get_args(field_at(model, location[:-2])[0])]
        if any(is_model(form) and location[-1] in form.keys() for form in forms):
            chosen = location[-2].strip("<>")
            how = "take one of the two away (null does, where a file extends another)"
            return f"does not go with {chosen}; {how}"
    meant = _meant(model, error)
    if len(location) == 1 and (said := of_the_other(location[0], known)):
        return f"{said}; {meant.words}" if meant.is_sibling else said
    return f"unknown key; {meant.words or 'known here: ' + ', '.join(known)}"


def _example(model, location):
    """`; expected for example '10 Hz'`, `; choose from: global, rolling` for a field that is missing."""
    annotation, metadata = field_at(model, location)
    if get_origin(annotation) is Literal:
        return f"; choose from: {', '.join(map(str, get_args(annotation)))}"
    if any(hasattr(one, "example") for one in metadata):
        return f"; expected for example '{_line(model, location)}'"
    if shown := _example_list(annotation):
        return f"; expected a list of {len(get_args(annotation))} values{shown}"
    if get_origin(annotation) is list:
        (item,) = get_args(annotation)
        examples = [one.example for one in bare(item)[1] if hasattr(one, "example")]
        if examples:
            return f"; expected a list, for example '{location[-1]}: [{', '.join(2 * examples[:1])}]'"
        if not any(getattr(one, "min_length", 0) for one in metadata):
            return f"; expected a list, '{location[-1]}: []' is one without any"
    if is_section(annotation) or get_origin(annotation) is dict:
        how = WITHOUT.get(plain(location))
        return f"; this section is required{f'; {how}' if how else ''}"
    return ""


def _line(model, location):
    """`rate: 10 Hz`, an example of a field as one writes it; dots where nothing is known of it."""
    annotation, metadata = field_at(model, location)
    examples = [one.example for one in metadata if hasattr(one, "example")]
    if get_origin(annotation) is Literal:
        examples += get_args(annotation)
    return f"{location[-1]}: {examples[0] if examples else '...'}"


def _list_words(model, error, location):
    annotation, _ = field_at(model, location)
    arguments = get_args(annotation)
    if get_origin(annotation) is tuple and arguments and arguments[-1] is not Ellipsis:
        return f"a list of {len(arguments)} values"
    fewest = error.get("ctx", {}).get("min_length", 0)
    return f"a list of at least {fewest} values" if fewest > 1 else "a list"


def _keys(annotation):
    """`; its keys are latitude, longitude, height` of a section in one form, else nothing."""
    section, _ = bare(annotation)
    return f"; its keys are {', '.join(section.keys())}" if is_model(section) else ""


def _example_list(annotation):
    """`; for example [0.3 m, 0.3 m, 0.3 m]` of a list with a fixed number of values, else nothing."""
    items = get_args(annotation)
    examples = [one.example for item in items for one in bare(item)[1] if hasattr(one, "example")]
    whole = get_origin(annotation) is tuple and len(examples) == len(items)
    return f"; for example [{', '.join(examples)}]" if whole else ""


def _length(value):
    return f"{len(value)} values" if isinstance(value, list | tuple) else describe(value)
