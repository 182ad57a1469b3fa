"""RASP motor file (.eng) -> its header and thrust curve, with the place of each number.

The form is that of ThrustCurve.org's description: comments start with `;`, the header gives name, diameter
[mm], length [mm], delays, propellant mass [kg], total mass [kg] and manufacturer, then follow pairs of time
[s] and thrust [N]; the last thrust is zero. Time and thrust of the ignition, both zero, may be left out.
"""

import re
from typing import NamedTuple

from shefex_nav.scenario.document import Mark
from shefex_nav.scenario.tables import BadTable, Cell, number

HEADER = ("name", "diameter_mm", "length_mm", "delays", "propellant_kg", "total_kg", "manufacturer")
MOST = {"diameter_mm": 1e5, "length_mm": 1e6, "propellant_kg": 1e7, "total_kg": 1e7}  # [E] of any motor
LEAST_SIZE = 1.0  # mm, [E] of the smallest motor
MOST_POINTS = 20_000  # [E] of a curve at 1 kHz for 20 s
NUMBERS = tuple(MOST)


class Rasp(NamedTuple):
    """A motor as its file gives it."""

    name: str
    manufacturer: str
    diameter_mm: Cell
    length_mm: Cell
    propellant_kg: Cell
    total_kg: Cell
    t_s: list  # of Cell, since ignition, increasing from 0
    thrust_n: list  # of Cell, as measured; the last is zero


def read(text, file):
    """Rasp of the `text`, which came from `file`; BadTable with every error otherwise."""
    lines = [(n, _words(line, n, file)) for n, line in enumerate(text.splitlines(), 1)]
    lines = [(n, words) for n, words in lines if words]
    if not lines:
        words = f"the file is empty; expected a header ({' '.join(HEADER)}), then pairs of time and thrust"
        raise BadTable([(Mark(file, 1, 1), words)])
    header = _header(lines[0][1])
    if len(lines) > MOST_POINTS:
        words = f"has {len(lines) - 1} points of thrust; expected at most {MOST_POINTS}"
        raise BadTable([(lines[MOST_POINTS][1][0][1], f"{words}, some hundred are enough")])
    errors, t_s, thrust_n = [], [], []
    for n, words in lines[1:]:
        try:
            _pair(words, n, file, t_s, thrust_n)
        except BadTable as bad:
            errors += bad.errors
            if thrust_n and thrust_n[-1].value == 0.0 and len(words) != 2:
                break  # all of a second motor would be wrong
    if errors:
        raise BadTable(errors)
    if not t_s:
        raise BadTable(
            [(lines[0][1][0][1], "there is no thrust below the header; expected pairs of time and thrust")]
        )
    if thrust_n[-1].value != 0.0:
        mark = thrust_n[-1].mark
        raise BadTable([(mark, f"thrust: must end with zero, ends with {thrust_n[-1].text} N")])
    if t_s[0].value > 0.0:
        t_s.insert(0, Cell("0", 0.0, t_s[0].mark))
        thrust_n.insert(0, Cell("0", 0.0, thrust_n[0].mark))
    return Rasp(**header, t_s=t_s, thrust_n=thrust_n)


def _words(line, n, file):
    """(text, Mark) of the words of a line; none if it is a comment."""
    return [(found[0], Mark(file, n, found.start() + 1)) for found in re.finditer(r"\S+", line.split(";")[0])]


def _header(words):
    """Entries of the header line by their names."""
    if len(words) < len(HEADER):
        mark = words[0][1]
        raise BadTable(
            [(mark, f"expected a header of {len(HEADER)} words, {' '.join(HEADER)}, got {len(words)}")]
        )
    entries, errors = {}, []
    for name, (word, mark) in zip(HEADER, words, strict=False):
        if name not in NUMBERS:
            entries[name] = word
            continue
        try:
            entries[name] = number(word, name, mark)
            if entries[name].value <= 0.0:
                errors.append((mark, f"{name}: must be greater than zero, got {word}"))
            elif name.endswith("_mm") and entries[name].value < LEAST_SIZE:
                errors.append((mark, f"{name}: must be at least {LEAST_SIZE:g}, got {word}"))
            if entries[name].value > MOST[name]:
                errors.append((mark, f"{name}: must be at most {MOST[name]:g}, got {word}"))
        except BadTable as bad:
            errors += bad.errors
    if not errors and entries["total_kg"].value <= entries["propellant_kg"].value:
        propellant = entries["propellant_kg"].text
        words = f"total_kg: {entries['total_kg'].text} kg must be more than the propellant, {propellant} kg"
        errors.append((entries["total_kg"].mark, words))
    if errors:
        raise BadTable(errors)
    del entries["delays"]
    return entries


def _pair(words, n, file, t_s, thrust_n):
    """Append one line of the curve; BadTable if it does not fit."""
    mark = words[0][1]
    if thrust_n and thrust_n[-1].value == 0.0 and (len(thrust_n) > 1 or t_s[-1].value > 0.0):
        raise BadTable(
            [(mark, "nothing may follow the zero thrust that ends a curve; keep one motor in a file")]
        )
    if len(words) != 2:
        raise BadTable([(mark, f"expected a pair of time and thrust, got {len(words)} words")])
    t, thrust = number(words[0][0], "time", mark), number(words[1][0], "thrust", words[1][1])
    if t_s and t.value <= t_s[-1].value:
        raise BadTable([(mark, f"time: must increase, {t.text} s follows {t_s[-1].text} s")])
    if t.value < 0.0:
        raise BadTable([(mark, f"time: must not be negative, got {t.text} s")])
    if thrust.value < 0.0:
        raise BadTable([(thrust.mark, f"thrust: must not be negative, got {thrust.text} N")])
    t_s.append(t)
    thrust_n.append(thrust)
