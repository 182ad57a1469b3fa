"""Tables in files -> the same tables in the tree of a scenario, each number with its place in its file.

A section with a `file` becomes the section that gives the same values itself, as text with units. So every
check holds for tables in files too, and the text that a log keeps needs no other file.
"""

import os
from typing import NamedTuple

from pydantic import ValidationError

from shefex_nav.scenario import rasp, tables
from shefex_nav.scenario.dispersions import ColumnOfFile
from shefex_nav.scenario.document import BadText, Mark, parse
from shefex_nav.scenario.files import LARGEST_TABLE, Unreadable, read_text
from shefex_nav.scenario.quantity import describe
from shefex_nav.scenario.sensors import ALMANAC_UNITS
from shefex_nav.scenario.tables import BadTable, NoColumn

FILE = "file"
ALMANAC = "almanac"
MODEL = "model"  # of the star tracker


class Rated(NamedTuple):
    """Propellant mass of a motor file's header, kg, and where it stands."""

    mass: float
    mark: Mark


def relative_to(tree, folder):
    """Let the files that a scenario's own `tree` names be looked for in `folder`."""
    named = [(FILE, section) for section, _, _ in _sections(tree)]
    named += [(FILE, table) for _, table in _tables_of_dispersions(tree)]
    named += [(ALMANAC, _inner(tree, "gps")), (MODEL, _inner(tree, "star_tracker"))]
    for key, section in named:
        if isinstance(section.get(key), str) and section[key]:
            section[key] = os.path.join(folder, section[key])


def expand(tree, places, texts):
    """Put the tables of files into `tree` and their places into `places`; their texts go into `texts`.

    A section that gives the same values itself, too, stays as it is, for the schema to complain about.

    Returns
    -------
    errors : list of (Mark, text)
    rated : {path of a stage: Rated} of motor files
    """
    errors, rated = [], {}
    for section, path, convert in _sections(tree):
        name = section.get(FILE)
        if not isinstance(name, str) or not name:
            continue
        try:
            text = read_text(name, "a table", LARGEST_TABLE)
            values, marks = convert(text, name)
        except Unreadable as error:
            errors.append(places.wrong((*path, FILE), f"'{name}' {error}"))
            continue
        except BadTable as error:
            errors += error.errors
            continue
        texts[name] = text
        if convert is _motor:
            rated[path[:-1]] = marks.pop("rated")
        if set(values) & set(section):
            continue
        if convert is _motor:  # here, and not in the section that gives the same values itself
            section.setdefault("measured_at", "sea_level")
        del section[FILE]
        here = places.value((*path, FILE))
        places.put((*path, FILE), {}, {})
        for key, value in values.items():
            section[key] = value
            inner = {(): here} | marks.get(key, {})
            places.put((*path, key), inner, inner)
    errors += _expand_almanac(tree, places, texts) + _expand_model(tree, places, texts)
    errors += _expand_dispersions(tree, places, texts)
    return errors, rated


def not_expanded(tree):
    """Paths of what a file was to give and has not given, after `expand` with errors: list."""
    left = [path for section, path, _ in _sections(tree) if FILE in section]
    return [("gps", ALMANAC), ("star_tracker", MODEL), *left]


def _tables_of_dispersions(tree):
    """(name, table) of every dispersion whose table is a section, that is, names a file."""
    for name, one in _inner(tree, "dispersions").items():
        if isinstance(one, dict) and isinstance(one.get("table"), dict):
            yield name, one["table"]


def _expand_dispersions(tree, places, texts):
    """Put columns of files in the place of what names them. -> list of (Mark, text)"""
    errors = []
    for name, table in _tables_of_dispersions(tree):
        path = ("dispersions", name, "table")
        here = places.value(path)
        try:
            asked = ColumnOfFile.model_validate(table)
            text = read_text(asked.file, "a table", LARGEST_TABLE)
            column = tables.read_one(text, asked.file, asked.column)
        except ValidationError as error:
            errors += [places.wrong((*path, *inner), words) for inner, words in _complaints(error)]
            continue
        except Unreadable as error:
            errors.append(places.wrong((*path, FILE), f"'{asked.file}' {error}"))
            continue
        except NoColumn as error:
            errors.append(places.wrong((*path, "column"), f"'{asked.file}' {error}"))
            continue
        except BadTable as error:
            errors += error.errors
            continue
        finally:
            tree["dispersions"][name]["table"] = [0.0]  # the schema need not complain as well
        texts[asked.file] = text
        tree["dispersions"][name]["table"] = _quantities(column, asked.unit)
        places.put(path, {(): here}, {(): here} | _places(column))
    return errors


def _complaints(error):
    """(key, words) of what is wrong in a section that names a column of a file."""
    for one in error.errors(include_url=False):
        if one["type"] == "missing":
            yield one["loc"], "is missing; expected {file: runs.csv, column: elevation_deg, unit: deg}"
        elif one["type"] == "extra_forbidden":
            yield one["loc"], "unknown key; known here: file, column, unit"
        else:
            yield one["loc"], f"expected a text, got {describe(one['input'])}"


def _expand_almanac(tree, places, texts):
    """Put the elements of a YUMA file in the place of its name. -> list of (Mark, text)"""
    gps, path = _inner(tree, "gps"), ("gps", ALMANAC)
    name = gps.get(ALMANAC)
    if name is None or isinstance(name, dict):
        return []
    from shefex_nav.environment import yuma

    here = places.value(path)
    del gps[ALMANAC]  # if it cannot be read, the schema need not complain as well
    if not isinstance(name, str) or not name:
        return [places.wrong(path, f"expected the name of a YUMA file, got {describe(name)}")]
    try:
        text = read_text(name, "a YUMA almanac")
        satellites = yuma.items(text)
    except Unreadable as error:
        return [places.wrong(path, f"'{name}' {error}")]
    except yuma.BadYuma as error:
        return BadTable([(Mark(name, line, column), words) for line, column, words in error.errors]).errors
    texts[name] = text
    gps[ALMANAC], marks = {}, {(): here}
    for key in yuma.Almanac._fields:
        column = [satellite[key] for satellite in satellites]
        unit, whole = ALMANAC_UNITS.get(key), key in yuma.WHOLE
        gps[ALMANAC][key] = [
            f"{item.text} {unit}" if unit else int(item.value) if whole else item.value for item in column
        ]
        marks[key,] = here
        marks |= {(key, k): Mark(name, item.line, item.column) for k, item in enumerate(column)}
    places.put(path, {(): here}, marks)
    return []


def _expand_model(tree, places, texts):
    """Put the statistics of the star tracker in the place of their file, or nothing if they are not used.

    -> list of (Mark, text)
    """
    tracker, path = _inner(tree, "star_tracker"), ("star_tracker", MODEL)
    name = tracker.get(MODEL)
    if not isinstance(name, str):
        return []
    here = places.value(path)
    del tracker[MODEL]  # if it cannot be read, the schema need not complain as well
    if tracker.get("frames") != "statistical":  # a scenario without statistics can be carried anywhere
        return []
    try:
        text = read_text(name, "a file of `shefex-nav characterise`")
        found = parse(text, name)  # JSON is YAML
    except Unreadable as error:
        return [places.wrong(path, f"'{name}' {error}")]
    except BadText as error:
        mark, words = error.args
        ours = words if words.startswith("not valid") else "this is no file of shefex-nav characterise"
        return [(mark, ours)]
    if found.errors:
        return found.errors
    texts[name] = text
    tracker[MODEL] = found.tree
    places.put(path, {(): here} | found.keys, {(): here} | found.values)
    return []


def _sections(tree):
    """(section, path, converter) of every section that may name a file."""
    vehicle = _inner(tree, "vehicle")
    yield _inner(tree, "wind"), ("wind",), _wind
    yield (
        _inner(_inner(vehicle, "payload"), "aerodynamics"),
        ("vehicle", "payload", "aerodynamics"),
        _aerodynamics,
    )
    for name, stage in _inner(vehicle, "stages").items():
        path = ("vehicle", "stages", name)
        yield _inner(stage, "propellant"), (*path, "propellant"), _propellant
        yield _inner(stage, "motor"), (*path, "motor"), _motor
        yield _inner(stage, "aerodynamics"), (*path, "aerodynamics"), _aerodynamics


def _inner(section, key):
    """The section under a key, an empty one if there is none."""
    found = section.get(key) if isinstance(section, dict) else None
    return found if isinstance(found, dict) else {}


def _quantities(column, unit):
    """A column as texts with unit, or as numbers where `unit` is empty."""
    return [f"{cell.text} {unit}" if unit else cell.value for cell in column]


def _places(column):
    """Marks of a column's numbers by their path below the key."""
    return {(k,): cell.mark for k, cell in enumerate(column)}


def _columns(columns, units):
    """Values and marks by key. units : {key: (name of a column, unit)}"""
    values = {key: _quantities(columns[name], unit) for key, (name, unit) in units.items()}
    return values, {key: _places(columns[name]) for key, (name, _) in units.items()}


def _section(key, columns, units, **more):
    """Values and marks of a section that is under a key. columns, units : of `_columns`"""
    values, marks = _columns(columns, units)
    below = {(name, *inner): mark for name, places in marks.items() for inner, mark in places.items()}
    return {key: values}, {key: below} | more


def _wind(text, file):
    columns = tables.read(text, file, ("height_m", "speed_m_s", "from_deg"))
    units = {"height": ("height_m", "m"), "speed": ("speed_m_s", "m/s"), "from": ("from_deg", "deg")}
    return _columns(columns, units)


def _propellant(text, file):
    units = {
        "burnt": ("burnt_percent", "%"),
        "station": ("station_m", "m"),
        "inertia_roll": ("inertia_roll_kg_m2", "kg m2"),
        "inertia_pitch": ("inertia_pitch_kg_m2", "kg m2"),
    }
    return _section("table", tables.read(text, file, [name for name, _ in units.values()]), units)


def _motor(text, file):
    motor = rasp.read(text, file)
    rated = Rated(motor.propellant_kg.value, motor.propellant_kg.mark)
    units = {"time": ("t_s", "s"), "force": ("thrust_n", "N")}
    return _section("thrust", motor._asdict(), units, rated=rated)


def _aerodynamics(text, file):
    """A long table, one row for each Mach number and angle of attack, as lists by angle of lists by Mach."""
    needed = ("mach", "axial", "normal_slope", "pressure_station_m")
    columns = tables.read(text, file, needed, ("alpha_deg", "drag"))
    machs = _distinct(columns["mach"])
    alphas = _distinct(columns["alpha_deg"]) if "alpha_deg" in columns else None
    rows = _grid(columns)
    if alphas and [cell.value for cell in alphas] == [0.0]:
        alphas = None
    keys = {
        "axial": ("axial", ""),
        "normal_slope": ("normal_slope", ""),
        "pressure_station": ("pressure_station_m", "m"),
    }
    keys |= {"drag": ("drag", "")} if "drag" in columns else {}
    values, marks = {"mach": _quantities(machs, "")}, {"mach": _places(machs)}
    if alphas:
        values["angle_of_attack"], marks["angle_of_attack"] = _quantities(alphas, "deg"), _places(alphas)
    for key, (name, unit) in keys.items():
        table = [[columns[name][rows[a, m.value]] for m in machs] for a in _values(alphas)]
        lists = [_quantities(row, unit) for row in table]
        values[key] = lists if alphas else lists[0]
        marks[key] = {
            (i, k) if alphas else (k,): cell.mark for i, row in enumerate(table) for k, cell in enumerate(row)
        }
        marks[key] |= {(i,): row[0].mark for i, row in enumerate(table)} if alphas else {}
    return values, marks


def _distinct(column):
    """Different numbers of a column, ascending, each where it stands first."""
    first = {}
    for cell in column:
        first.setdefault(cell.value, cell)
    return [first[value] for value in sorted(first)]


def _values(alphas):
    return [cell.value for cell in alphas] if alphas else [0.0]


def _grid(columns):
    """{(alpha, mach): number of the row}; BadTable unless every pair is there once."""
    machs, rows = columns["mach"], {}
    alphas = columns.get("alpha_deg")
    for n, mach in enumerate(machs):
        pair = (alphas[n].value if alphas else 0.0, mach.value)
        if pair in rows:
            first = machs[rows[pair]].mark.line
            words = f"mach: {_pair(pair, alphas)} stands in line {first} already; keep one of them"
            raise BadTable([(mach.mark, words)])
        rows[pair] = n
    missing = [
        (alpha, mach)
        for alpha in sorted({pair[0] for pair in rows})
        for mach in sorted({pair[1] for pair in rows})
        if (alpha, mach) not in rows
    ]
    if missing:
        words = "every Mach number needs a row for every angle of attack"
        raise BadTable([(machs[-1].mark, f"mach: there is no row for {_pair(missing[0], alphas)}; {words}")])
    return rows


def _pair(pair, alphas):
    return f"Mach {pair[1]:g} at {pair[0]:g} deg" if alphas else f"Mach {pair[1]:g}"
