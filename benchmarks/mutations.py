"""Ways to spoil files: values and keys of a YAML tree, bytes, cells of a table, drawn from a generator."""

import copy
import re

NUMBER = re.compile(r"-?\d+(\.\d+)?([eE][-+]?\d+)?")
ODD_NUMBERS = "0", "-1", "1e9", "-1e9", "1e308", "1e-308", "nan", "inf", "007", "1_000", "0x10"
ODD_UNITS = "kg", "deg", "s", "furlong", "%", "km/h", "m m", "µm", ""
ODD_VALUES = (
    None, True, False, 0, -1, 2**63, 1e308, float("nan"), float("inf"), "", " ", "~", "no", "null", "80",
    "5 km", "-3 deg", "automatic", "off", "[", "ü", "x" * 300, "/etc/passwd", "../..", "[bold]a[/]",
    "\x1b[31m", [], {}, [[]], [None], {"a": 1}, {"file": "nowhere.csv"}, {"use": "nothing"}, ["1 m", "2 m"],
)  # fmt: skip
ODD_CELLS = "", "nan", "inf", "-1e308", "1,2", '"', "x", "0", " ", "\t", "1e400", "é", "-0"
MOST = 3  # changes of one case


def tree(rng, whole):
    """A YAML tree with one to three changes. whole : dict; it stays as it is."""
    spoilt = copy.deepcopy(whole)
    for _ in range(min(rng.geometric(0.6), MOST)):  # of a tree with many, nothing is good in the end
        holder, key = _place(rng, spoilt)
        if holder is not None:
            _spoil(rng, holder, key, whole)
    return spoilt


def _place(rng, node):
    """(list or dict, key) somewhere in a tree; (None, None) if there is nothing."""
    places, left = [], [node]
    while left:
        one = left.pop()
        found = one.items() if isinstance(one, dict) else enumerate(one)
        for key, value in found:
            places.append((one, key))
            if isinstance(value, (dict, list)):
                left.append(value)
    return places[rng.integers(len(places))] if places else (None, None)


def _spoil(rng, holder, key, whole):
    """One change at a place."""
    value, way = holder[key], rng.integers(8)
    if way == 0:
        del holder[key]
    elif way == 1 and isinstance(holder, dict):
        name = str(key)
        at = rng.integers(len(name) + 1)
        holder[name[:at] + "xé _A"[rng.integers(5)] + name[at + 1 :]] = holder.pop(key)
    elif way in (2, 3, 4) and isinstance(value, str) and NUMBER.search(value):
        holder[key] = _quantity(rng, value)
    elif way == 5:
        other, name = _place(rng, whole)
        holder[key] = copy.deepcopy(other[name])
    else:
        holder[key] = copy.deepcopy(ODD_VALUES[rng.integers(len(ODD_VALUES))])


def _quantity(rng, text):
    """A number with a unit, of which one is another."""
    number = NUMBER.search(text).group()
    way = rng.integers(5)
    if way == 0:
        return text.replace(number, ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))], 1)
    if way == 1:
        return f"{number} {ODD_UNITS[rng.integers(len(ODD_UNITS))]}"
    decades = 9.0 if way == 2 else 0.3
    return text.replace(number, f"{float(number) * 10.0 ** rng.uniform(-decades, decades):.6g}", 1)


def extreme(rng, whole):
    """A YAML tree of which one number is 1e9 times as large or as small, 0, or of the other sign."""
    spoilt = copy.deepcopy(whole)
    holder, key, number = None, None, None
    while number is None:
        holder, key = _place(rng, spoilt)
        value = holder[key]
        is_one = isinstance(value, (int, float, str)) and not isinstance(value, bool)
        number = NUMBER.match(str(value)) if is_one else None
    value, way = float(number.group()), rng.integers(4)
    other = (value * 1e9, value * 1e-9, 0.0, -value)[way]
    text = f"{other:.9g}{str(holder[key])[number.end() :]}"
    is_plain = not isinstance(holder[key], str)
    holder[key] = (int(other) if isinstance(holder[key], int) else other) if is_plain else text
    return spoilt


def data(rng, content):
    """Bytes with some of them flipped, overwritten, left out, doubled, or cut off."""
    spoilt = bytearray(content)
    for _ in range(1 + rng.integers(MOST)):
        if not spoilt:
            break
        way, at = rng.integers(6), int(rng.integers(len(spoilt)))
        length = int(rng.integers(1, 64))
        if way == 0:
            spoilt[at] ^= 1 << int(rng.integers(8))
        elif way == 1:
            spoilt[at : at + length] = rng.bytes(min(length, len(spoilt) - at))
        elif way == 2:
            del spoilt[at : at + length]
        elif way == 3:
            spoilt[at:at] = spoilt[at : at + length]
        elif way == 4:
            spoilt[at : at + 4] = b"\xff" * min(4, len(spoilt) - at)
        else:
            del spoilt[at:]
    return bytes(spoilt)


def table(rng, text):
    """A CSV with some cells, rows or separators changed."""
    rows = text.split("\n")
    for _ in range(1 + rng.integers(MOST)):
        at, way = int(rng.integers(len(rows))), rng.integers(6)
        cells = rows[at].split(",")
        if way <= 1:
            cells[rng.integers(len(cells))] = ODD_CELLS[rng.integers(len(ODD_CELLS))]
            rows[at] = ",".join(cells)
        elif way == 2:
            del rows[at : at + int(rng.integers(1, 400))]
            rows = rows or [""]
        elif way == 3:
            rows[at:at] = rows[at : at + int(rng.integers(1, 400))]
        elif way == 4:
            rows[at] = rows[at].replace(",", ";" if rng.integers(2) else "")
        else:
            rows[at] = ",".join(reversed(cells))
    return "\n".join(rows)
