"""What is wrong with what a plug-in brings: its description, or what its code does.

Instruments that come with the program are not looked at: an exception of theirs is a fault of the program.
"""

from functools import partial

import numpy as np

from shefex_nav import instruments, plugin_readings
from shefex_nav.environment import models
from shefex_nav.errors import CodeError, called, shown
from shefex_nav.instruments import faults
from shefex_nav.instruments.instrument import (
    DataColumn,
    Equation,
    Fault,
    FaultKind,
    Measured,
    Plot,
    Sampled,
    StateBlock,
)
from shefex_nav.onboard.navigation.aid import Aid, Linearised
from shefex_nav.onboard.navigation.blocks import CORE_BLOCKS, OPTIONAL, Block
from shefex_nav.settings import REQUIRED, Settings, declared

# names that mean something else: sections, topics, tables and figures, sensors and streams of the program
TAKEN = frozenset(
    "mission plugins earth atmosphere wind launch orbit ground vehicle attitude programme imu gps "
    "pad_alignment star_camera star_tracker navigation computer log faults requirements campaign "
    "without dispersions data gnss alignment truth control attitude_control events timing nav nav_states "
    "nav_covariance gates gate_innovations health frames frame_truth frame_truth_stars "
    "camera_commands star_fixes star_fix_objects star_vectors errors star_fix_errors columns "
    "trajectory history ground_track sky_map status star_errors camera velocity position biases "
    "nees nis protection position_protection velocity_protection pad camera_errors camera_noise "
    "gps_errors sightings gyro accelerometer ".split()
)
PREFIXES = ("gps", "star")  # of what the filter tells apart by it
LARGEST_GATE = 0.1  # that a healthy reading is rejected, as of navigation.gate_probability
FASTEST = 10.0  # 1/s, law of a block of states: slow against a tick
ROUNDING = 1e-9  # of a covariance, in the trace of it


def problem(one):
    """What is wrong with the description of an Instrument; '' if nothing is."""
    if not one.name.isidentifier() or not one.name.islower():
        return "its name must be lower case with underscores, such as 'radar_altimeter'"
    if one.name in instruments.BUILT_IN:
        return "there is an instrument of that name already, of the program"
    if one.name in TAKEN or one.name.startswith(PREFIXES):
        return (
            f"that name means something else, as do all that begin with {' or '.join(PREFIXES)}; take another"
        )
    if not (isinstance(one.settings, type) and issubclass(one.settings, Sampled)):
        return f"settings must be a class of Sampled, got {one.settings!r}"
    if words := plugin_readings.problem(one.record):
        return words
    if one.aid is not None and one.use is None:
        return "one with an aid needs a class of settings in `use` (instrument.Use, for example)"
    if one.use is not None and (needed := _required(one.use)):
        words = f"give it a default, for navigation.{one.name} may be left out"
        return f"setting {needed[0]} of {one.use.__name__}: {words}"
    return _problem_of_parts(one)


def _required(cls):
    """Names of settings without a default."""
    return [key for key, (_, setting) in declared(cls).items() if setting.default is REQUIRED]


def _problem_of_parts(one):
    """What is wrong with the parts of an instrument; '' if nothing is."""
    kinds = {"states": StateBlock, "data": DataColumn, "plots": Plot, "faults": FaultKind}
    for field, kind in kinds.items():
        parts = getattr(one, field)
        if not isinstance(parts, tuple) or not all(isinstance(part, kind) for part in parts):
            return f"{field} must be a tuple of {kind.__name__}, got {parts!r}"
    for block in one.states:
        if _is_taken(block.name):
            return f"there is a block of states '{block.name}' already; give yours another name"
    unknown = [key for key in one.told if key not in declared(one.settings)]
    unknown += [column.field for column in one.data if column.field not in one.record._fields]
    return f"there is no '{unknown[0]}' in it" if unknown else _problem_of_faults(one)


def _problem_of_faults(one):
    """What is wrong with the kinds of faults of an instrument; '' if nothing is."""
    taken = set(faults.GENERAL)
    for kind in one.faults:
        if not (isinstance(kind.settings, type) and issubclass(kind.settings, Fault)):
            return f"settings of a kind of fault must be a class of Fault, got {kind.settings!r}"
        if "fault" not in declared(kind.settings):
            return f'{kind.settings.__name__} needs `fault: Literal["its_name"] = choice()`'
        name = faults.name_of(kind.settings)
        if name in taken:
            return f"there is a kind of fault '{name}' already; give yours another name"
        taken.add(name)
    return ""


def _is_taken(name):
    """Whether a block of states that comes with the program has a name."""
    others = {part.name for other in instruments.BUILT_IN.values() for part in other.states}
    return name in CORE_BLOCKS or name in OPTIONAL or name in others


def problem_of_state(one):
    """What is wrong with the description of an OwnState; '' if nothing is."""
    if not one.name.isidentifier() or not one.name.islower():
        return "its name must be lower case with underscores, such as 'gyro_drift'"
    if _is_taken(one.name) or one.name in instruments.BUILT_IN:
        return "the program has that name already; take another"
    if not isinstance(one.size, int) or one.size < 1:
        return f"its size must be a number of errors, got {one.size!r}"
    if not (isinstance(one.settings, type) and issubclass(one.settings, Settings)):
        return f"settings must be a class of Settings, got {one.settings!r}"
    return "" if callable(one.block) else f"its block must be a function, got {one.block!r}"


def problem_of_model(one):
    """What is wrong with the description of a Gravity, Atmosphere or Wind; '' if nothing is."""
    if not one.name.isidentifier() or not one.name.islower():
        return "its name must be lower case with underscores, such as 'my_air'"
    if one.name in {*models.BUILT_IN[type(one)], "model", "density"}:
        return "the program has that name already; take another"
    function = one._fields[1]
    if not callable(getattr(one, function)):
        return f"its {function} must be a function, got {getattr(one, function)!r}"
    if isinstance(one, models.Gravity):
        return ""
    kind, heights = one.settings, np.asarray(one.heights)
    if kind is not None and not (isinstance(kind, type) and issubclass(kind, Settings)):
        return f"settings must be a class of Settings, got {kind!r}"
    numbers = heights.dtype.kind in "fi" and heights.ndim == 1 and len(heights) >= 2
    if not numbers or not (np.diff(heights) > 0.0).all():
        return "its heights must be two numbers or more, increasing"
    return ""


def checked_state(one):
    """An OwnState whose functions say with CodeError what is wrong with what they do."""
    return one._replace(block=partial(_block, one))


def _block(one, settings):
    """As OwnState.block."""
    words = f"block of states '{one.name}'"
    block = called(f"{words}: block", one.block, settings)
    if not isinstance(block, Block) or block.name != one.name:
        raise CodeError(f"{words}: block must give a Block of that name, got {block!r}")
    return _checked_block(words, one.size, block)


def _checked_block(words, size, block):
    """A Block of so many errors, its arrays as numbers; CodeError says what is wrong with it."""
    P, walk = _covariance(f"{words}: P", block.P, size), _numbers(f"{words}: walk", block.walk, (size,))
    F = None if block.F is None else _numbers(f"{words}: F", block.F, (size, size))
    if (walk < 0.0).any():
        raise CodeError(f"{words}: walk must not be negative, got {walk.tolist()}")
    if F is not None and np.abs(F).sum(axis=1).max() > FASTEST:
        rows = f"elements of a row of F must add up to at most {FASTEST:g} /s"
        raise CodeError(f"{words}: {rows}, got {F.tolist()}")
    block = block._replace(P=P, walk=walk, F=F)
    if block.drives is None:
        return block
    return block._replace(drives=partial(_drives, words, size, block.drives))


def _drives(words, size, drives, sensed):
    """As Block.drives."""
    words = f"{words}: drives, T{sensed.t_s:+.2f} s"
    return _numbers(words, called(words, drives, sensed), (6, size))


def _covariance(words, value, size):
    """A value of the plug-in as a covariance, which may have no rank. words : what it is"""
    P = _numbers(words, value, (size, size))
    if not _is_covariance(P):
        raise CodeError(f"{words} must be a covariance, got {P.tolist()}")
    return P


def _is_covariance(P):
    """Whether a matrix is symmetric and makes no variance below zero, but for rounding.

    Rounding is judged among errors that hang together: others may be of another unit.
    """
    left = set(range(len(P)))
    while left:
        part, new = set(), {min(left)}
        while new:
            part |= new
            new = {int(k) for k in np.flatnonzero((P[sorted(new)] != 0.0).any(axis=0))} - part
        left -= part
        one = P[np.ix_(sorted(part), sorted(part))]
        slack = ROUNDING * np.trace(one)
        if not (np.abs(one - one.T).max() <= slack and np.linalg.eigvalsh(one)[0] >= -slack):
            return False
    return True


def _numbers(words, value, shape):
    """A value of the plug-in as an array of finite numbers. words : what it is"""
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise CodeError(f"{words} must be numbers, got {value!r}") from None
    if array.shape != shape or not np.isfinite(array).all():
        got = "some that are not finite" if array.shape == shape else f"shape {array.shape}"
        raise CodeError(f"{words} must be numbers, shape {shape}, got {got}")
    return array


def checked(one):
    """An Instrument whose functions say with CodeError what is wrong with what they do."""
    more = {} if one.aid is None else {"aid": partial(_aid, one)}
    if one.equation is not None:
        more["equation"] = partial(_equation, one)
    if one.limited is not None:
        more["limited"] = partial(_reading, one, "limited", one.limited)
    kinds = [
        kind._replace(change=partial(_reading, one, f"fault '{faults.name_of(kind.settings)}'", kind.change))
        for kind in one.faults
    ]
    plots = tuple(plot._replace(values=partial(_drawn, one, plot)) for plot in one.plots)
    return one._replace(measure=partial(_measure, one), faults=tuple(kinds), plots=plots, **more)


def _drawn(one, plot, read):
    """As Plot.values."""
    words = f"instrument '{one.name}': plot '{plot.name}'"
    values, n = called(words, plot.values, read), len(read.t_valid_s)
    if np.shape(values) not in ((n,), (n, 3)) or np.asarray(values).dtype.kind not in "fiub":
        raise CodeError(f"{words} must give ({n},) or ({n}, 3) numbers, got {shown(values)}")
    return np.asarray(values)


def _equation(one, settings, truth):
    """As Instrument.equation."""
    words = f"instrument '{one.name}': equation"
    equation = called(words, one.equation, settings, truth)
    if not isinstance(equation, Equation):
        raise CodeError(f"{words} must give an Equation, got {equation!r}")
    return equation._replace(read=partial(_read, words, equation.read, len(equation.R)))


def _read(words, read, m, place, errors):
    """As Equation.read."""
    words = f"{words}: read, T{place.t_s:+.2f} s"
    return _numbers(words, called(words, read, place, errors), (m,))


def _reading(one, what, function, *given):
    """A reading that a function of the instrument gives; None stands for no reading."""
    words = f"instrument '{one.name}': {what}"
    reading = called(words, function, *given)
    if type(reading) is not one.record and (reading is not None or what == "limited"):
        raise CodeError(f"{words} must give a reading of {one.record.__name__}, got {shown(reading)}")
    if reading is not None:
        plugin_readings.checked(words, one.record, [reading])
    return reading


def _measure(one, settings, truth, rng):
    """As Instrument.measure."""
    words = f"instrument '{one.name}': measure"
    measured = _of_type(words, Measured, called(words, one.measure, settings, truth, rng))
    plugin_readings.checked(words, one.record, measured.readings)
    return measured


def _aid(one, given, use, known):
    """As Instrument.aid."""
    words = f"instrument '{one.name}'"
    aid = _of_type(f"{words}: aid", Aid, called(f"{words}: aid", one.aid, given, use, known))
    found = [(block.name, block.size) for block in aid.blocks]
    said = [(block.name, block.size) for block in one.states]
    if (aid.name, aid.record, found) != (one.name, one.record, said):
        made = f"its aid is {aid.name!r} of {aid.record.__name__} with states {found}"
        raise CodeError(f"{words}: {made}; expected the same name and record, and states {said}")
    if aid.gate_probability is not None and not 0.0 < aid.gate_probability <= LARGEST_GATE:
        chance = f"gate_probability, that a healthy reading is rejected, must be above 0 and {LARGEST_GATE:g}"
        raise CodeError(f"{words}: {chance} at most, got {aid.gate_probability!r}")
    judges = {
        key: partial(_judge, f"{words}: {key}", kinds, getattr(aid, key))
        for key, kinds in (("holds", (bool, np.bool_)), ("unfit", (str,)))
        if getattr(aid, key) is not None
    }
    blocks = tuple(
        _checked_block(f"{words}: block of states '{block.name}'", block.size, block) for block in aid.blocks
    )
    return aid._replace(expect=partial(_expect, words, aid.expect), blocks=blocks, **judges)


def _judge(words, kinds, judge, *given):
    """As Aid.holds and Aid.unfit. kinds : of answers"""
    answer = called(words, judge, *given)
    if not isinstance(answer, kinds):
        raise CodeError(f"{words} must give {kinds[0].__name__}, got {shown(answer)}")
    return answer


def _expect(words, expect, here, reading):
    """As Aid.expect."""
    words = f"{words}: expect, T{reading.t_valid_s:+.2f} s"
    seen = _of_type(words, Linearised, called(words, expect, here, reading))
    m, n = np.size(seen.z), here.rows(1).shape[1]
    shapes = [np.shape(one) for one in (seen.z, seen.H, seen.R, *(one for one, _ in seen.lasting))]
    if shapes != [(m,), (m, n), *[(m, m)] * (1 + len(seen.lasting))]:
        raise CodeError(
            f"{words}: z, H, R and what lasts have shapes {shapes}; z (m,) needs ({m}, {n}) and (m, m)"
        )
    if not (np.isfinite(seen.z).all() and np.isfinite(seen.H).all() and (np.diag(seen.R) > 0.0).all()):
        raise CodeError(
            f"{words}: z and H must be numbers and the variances in R greater than zero, got {seen}"
        )
    R = _covariance(f"{words}: R", seen.R, m)
    lasting = tuple((_covariance(f"{words}: what lasts", one, m), float(s)) for one, s in seen.lasting)
    if not all(lasts_s > 0.0 for _, lasts_s in lasting):
        raise CodeError(f"{words}: what lasts must do so for more than 0 s, got {seen.lasting}")
    return seen._replace(R=R, lasting=lasting)


def checked_gravity(one):
    """A Gravity whose function says with CodeError what is wrong with what it does."""
    return one._replace(coefficients=partial(_coefficients, one))


def _coefficients(one, degree):
    """As Gravity.coefficients."""
    words = models.words(one)
    given = _of_type(words, models.Coefficients, called(f"{words}: coefficients", one.coefficients, degree))
    gm, radius = (_numbers(f"{words}: {key}", getattr(given, key), ()) for key in ("gm", "radius"))
    n = len(np.atleast_1d(given.cosine))
    cosine, sine = (_numbers(f"{words}: {key}", getattr(given, key), (n, n)) for key in ("cosine", "sine"))
    if gm <= 0.0 or radius <= 0.0:
        raise CodeError(f"{words}: gm and radius must be greater than zero, got {gm:g} and {radius:g}")
    if n > models.HIGHEST_DEGREE + 1:
        raise CodeError(f"{words}: degree and order are at most {models.HIGHEST_DEGREE}, got {n - 1}")
    if abs(cosine[0, 0] - 1.0) > 1e-3:
        raise CodeError(f"{words}: cosine[0, 0] must be 1, got {cosine[0, 0]:g}")
    return models.Coefficients(float(gm), float(radius), cosine, sine)


def checked_atmosphere(one):
    """An Atmosphere whose function says with CodeError what is wrong with what it does."""
    return one._replace(air=partial(_air, one), heights=tuple(map(float, one.heights)))


def _air(one, heights, site):
    """As Atmosphere.air."""
    words = models.words(one)
    given = _of_type(words, models.Air, called(f"{words}: air", one.air, heights, site))
    air = {key: value for key, value in given._asdict().items() if key != "sound" or value is not None}
    for key in air:
        air[key] = _numbers(f"{words}: {key}", air[key], heights.shape)
        if (air[key] <= 0.0).any():
            k = int(np.argmax(air[key] <= 0.0))
            where = f"got {air[key][k]:g} at {1e-3 * heights[k]:g} km"
            raise CodeError(f"{words}: {key} must be greater than zero, {where}; let heights end below")
    return models.Air(**air)


def checked_wind(one):
    """A Wind whose function says with CodeError what is wrong with what it does."""
    return one._replace(wind=partial(_wind, one), heights=tuple(map(float, one.heights)))


def _wind(one, heights, t_s, site):
    """As Wind.wind."""
    words = models.words(one)
    given = called(f"{words}: wind", one.wind, heights, t_s, site)
    return _numbers(f"{words}: north and east, T{t_s:+.2f} s,", given, (2, *heights.shape))


def _of_type(words, kind, given):
    """What a function gives, of the type that it must be."""
    if not isinstance(given, kind):
        raise CodeError(f"{words}: expected {kind.__name__}({', '.join(kind._fields)}), got {shown(given)}")
    return given
