"""A reader of DAVE-ML models: ANSI/AIAA S-119-2011, Flight Dynamics Model Exchange Standard.

In: a .dml file. Out: a `Model`, whose variables can be evaluated.

Read are constants, calculations in MathML, and functions of one variable as gridded tables or as pairs of
points, with linear interpolation. What is not read (functions of several variables, splines) is refused with
a message, never guessed.
"""

import math
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.errors import UserError
from shefex_nav.files import content_of
from shefex_nav.numerals import number

FOOT = 0.3048  # m, exact
SLUG = 0.45359237 * STANDARD_GRAVITY / FOOT  # kg: pound-force s^2/ft, both pounds by definition

SI = {
    "": 1.0, "nd": 1.0, "frac": 1.0, "rad": 1.0, "_rad": 1.0, "rad_s": 1.0, "sec": 1.0, "s": 1.0,
    "deg": math.pi / 180.0, "m": 1.0, "m2": 1.0, "m_s": 1.0, "kg": 1.0, "kgm2": 1.0, "kg_s": 1.0, "N": 1.0,
    "ft": FOOT, "ft2": FOOT**2, "ft_s": FOOT, "slug": SLUG, "slugft2": SLUG * FOOT**2,
}  # fmt: skip


class DaveMlError(UserError, ValueError):
    """A model that cannot be read or evaluated."""


class Variable(NamedTuple):
    """One signal of a model."""

    identifier: str
    name: str
    units: str
    initial: float | None
    low: float  # the value never leaves low ... high
    high: float
    calculation: ElementTree.Element | None  # first child of its <math>


class Table(NamedTuple):
    """A function of one variable: straight lines between points."""

    argument: str  # varID
    points: np.ndarray  # (n,) increasing
    values: np.ndarray  # (n,)
    low: float  # limits of the argument
    high: float
    below: bool  # goes on in a straight line below the first point; else the end value holds
    above: bool


class Model(NamedTuple):
    """A DAVE-ML model."""

    path: str
    variables: dict  # varID -> Variable
    tables: dict  # varID of the result -> Table


def read(path):
    """Model of a DAVE-ML file."""
    try:
        root = ElementTree.fromstring(content_of(path))
    except (OSError, ElementTree.ParseError) as error:
        raise DaveMlError(f"{path}: cannot be read as DAVE-ML: {error}") from None
    if _tag(root) != "DAVEfunc":
        raise DaveMlError(f"{path}: no DAVE-ML, its root is <{_tag(root)}>")
    try:
        variables = {v.identifier: v for v in map(_variable, _children(root, "variableDef"))}
        shared = _shared(root)
        tables = dict(_function(f, shared) for f in _children(root, "function"))
    except KeyError as error:
        raise DaveMlError(f"{path}: {error.args[0]} is missing") from None
    except ValueError as error:
        raise DaveMlError(f"{path}: {error}") from None
    return Model(str(path), variables, tables)


def evaluate(model, wanted, **inputs):
    """Value in SI units of a variable, by its varID or name; inputs by varID in the units of the model."""
    identifier = _find(model, wanted)
    units = model.variables[identifier].units
    if units not in SI:
        raise DaveMlError(f"{model.path}: the units {units} of {wanted} are not known here")
    for name in inputs:
        if name not in model.variables:
            raise DaveMlError(f"{model.path}: no variable {name}")
    known = {name: _limited(model.variables[name], float(value)) for name, value in inputs.items()}
    return SI[units] * _value(model, identifier, known, ())


def _limited(variable, value):
    return min(max(value, variable.low), variable.high)


def _find(model, wanted):
    if wanted in model.variables:
        return wanted
    for identifier, variable in model.variables.items():
        if variable.name == wanted:
            return identifier
    raise DaveMlError(f"{model.path}: no variable {wanted}")


def _value(model, identifier, known, asked):
    """Value in the model's own units. known: varID -> value, grows; asked: who needs it, to find circles."""
    if identifier in known:
        return known[identifier]
    if identifier in asked:
        raise DaveMlError(f"{model.path}: {identifier} depends on itself")
    if identifier not in model.variables:
        raise DaveMlError(f"{model.path}: no variable {identifier}")
    variable, asked = model.variables[identifier], (*asked, identifier)

    def other(name):
        return _value(model, name, known, asked)

    if identifier in model.tables:
        table = model.tables[identifier]
        value = _interpolate(table, other(table.argument))
    elif variable.calculation is not None:
        value = _calculated(model, identifier, other)
    elif variable.initial is not None:
        value = variable.initial
    else:
        raise DaveMlError(f"{model.path}: {identifier} is an input and was not given")
    known[identifier] = _limited(variable, value)
    return known[identifier]


def _calculated(model, identifier, other):
    """Value of the expression of a variable; a number is a finite one."""
    try:
        value = float(_mathml(model.variables[identifier].calculation, other))
    except DaveMlError:
        raise
    except RecursionError:
        raise DaveMlError(f"{model.path}: {identifier} is nested too deep") from None
    except (ArithmeticError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise DaveMlError(f"{model.path}: {identifier} cannot be calculated: {error}") from None
    if not math.isfinite(value):
        raise DaveMlError(f"{model.path}: {identifier} cannot be calculated: it becomes {value}")
    return value


def _interpolate(table, x):
    x = min(max(x, table.low), table.high)
    points, values = table.points, table.values
    if (x < points[0] and table.below) or (x > points[-1] and table.above):
        k = 0 if x < points[0] else len(points) - 2
        slope = (values[k + 1] - values[k]) / (points[k + 1] - points[k])
        return float(values[k] + slope * (x - points[k]))
    return float(np.interp(x, points, values))


def _tag(element):
    """Name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def _children(element, *tags):
    return [child for child in element if _tag(child) in tags]


def _child(element, tag):
    """The one child of that name, or None."""
    found = _children(element, tag)
    return found[0] if found else None


def _numbers(element):
    """Numbers of a text, parted by commas and white space: (n,)."""
    return np.array([number(x) for x in "".join(element.itertext()).replace(",", " ").split()])


def _attribute(element, name, default):
    text = element.get(name)
    try:
        return default if text is None else number(text)
    except ValueError as error:
        raise ValueError(f"{element.get('varID')}: {name}: {error}") from None


def _variable(element):
    calculation = _child(element, "calculation")
    expression = None
    if calculation is not None:
        math_element = _child(calculation, "math")
        if math_element is None or len(math_element) != 1:
            raise ValueError(f"{element.get('varID')}: a calculation needs one expression of MathML")
        expression = math_element[0]
    return Variable(
        element.attrib["varID"],
        element.get("name", ""),
        element.get("units", ""),
        _attribute(element, "initialValue", None),
        _attribute(element, "minValue", -math.inf),
        _attribute(element, "maxValue", math.inf),
        expression,
    )


def _shared(root):
    """Break points and tables that functions refer to: {identifier: numbers or element}."""
    shared = {
        b.attrib["bpID"]: _numbers(_only(b, b.attrib["bpID"], "bpVals"))
        for b in _children(root, "breakpointDef")
    }
    shared |= {t.attrib["gtID"]: t for t in _children(root, "griddedTableDef")}
    return shared


def _function(element, shared):
    """(varID of the result, Table) of a <function>."""
    name = element.get("name", "function")
    if _child(element, "independentVarPts") is not None:  # the short form: two lists of points
        argument, result = _only(element, name, "independentVarPts"), _only(element, name, "dependentVarPts")
        points, values = _numbers(argument), _numbers(result)
    else:
        argument, result = _only(element, name, "independentVarRef"), _only(element, name, "dependentVarRef")
        definition = _only(element, name, "functionDefn")
        table = _child(definition, "griddedTableDef")
        if table is None:
            table = shared[_only(definition, name, "griddedTableRef").attrib["gtID"]]
        breakpoints = _only(_only(table, name, "breakpointRefs"), name, "bpRef")
        points, values = shared[breakpoints.attrib["bpID"]], _numbers(_only(table, name, "dataTable"))
    if argument.get("interpolate", "linear") != "linear":
        raise ValueError(f"{name}: only linear interpolation is read")
    if points.size != values.size or points.size < 2 or np.any(np.diff(points) <= 0.0):
        raise ValueError(f"{name}: needs two or more increasing points and as many values")
    beyond = argument.get("extrapolate", "neither")
    table = Table(
        argument.attrib["varID"],
        points,
        values,
        _attribute(argument, "min", -math.inf),
        _attribute(argument, "max", math.inf),
        beyond in ("min", "both"),
        beyond in ("max", "both"),
    )
    return result.attrib["varID"], table


def _only(element, name, tag):
    found = _children(element, tag)
    if len(found) != 1:
        raise ValueError(f"{name}: has {len(found)} <{tag}>, expected one, as a function of one variable has")
    return found[0]


_OPERATORS = {
    "plus": lambda *x: math.fsum(x),
    "minus": lambda *x: -x[0] if len(x) == 1 else x[0] - x[1],
    "times": lambda *x: math.prod(x),
    "divide": lambda a, b: a / b,
    "quotient": lambda a, b: math.trunc(a / b),
    "power": lambda a, b: a**b,
    "root": lambda a: math.sqrt(a),
    "abs": abs,
    "exp": math.exp,
    "ln": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "arcsin": math.asin,
    "arccos": math.acos,
    "arctan": math.atan,
    "min": min,
    "max": max,
    "gt": lambda a, b: a > b,
    "lt": lambda a, b: a < b,
    "geq": lambda a, b: a >= b,
    "leq": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "neq": lambda a, b: a != b,
    "and": lambda *x: all(x),
    "or": lambda *x: any(x),
    "not": lambda a: not a,
}


def _mathml(element, other):
    """Value of an expression; other(varID): that of a variable. Only the piece that holds is evaluated."""
    tag = _tag(element)
    if tag == "cn":
        return number(element.text or "")
    if tag == "ci":
        return other((element.text or "").strip())
    if tag == "pi":
        return math.pi
    if tag == "piecewise":
        return _piecewise(element, other)
    if tag == "apply" and len(element):
        operator = _tag(element[0])
        if operator == "piecewise" and len(element) == 1:
            return _piecewise(element[0], other)
        if operator in _OPERATORS:
            return _OPERATORS[operator](*(_mathml(child, other) for child in element[1:]))
        raise DaveMlError(f"MathML operator <{operator}> is not known here")
    raise DaveMlError(f"MathML element <{tag}> is not known here")


def _piecewise(element, other):
    for piece in _children(element, "piece"):
        if _mathml(piece[1], other):
            return _mathml(piece[0], other)
    otherwise = _child(element, "otherwise")
    if otherwise is None:
        raise DaveMlError("no piece of a <piecewise> holds, and it has no <otherwise>")
    return _mathml(otherwise[0], other)
