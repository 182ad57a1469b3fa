"""Replay scenario file -> `ReplayScenario` and the paths of its data; all errors at once, each placed."""

import math
import os
import stat
from functools import partial

from shefex_nav.files import irregular
from shefex_nav.instruments import TABLE
from shefex_nav.replay import schema
from shefex_nav.replay.schema import Static
from shefex_nav.replay.schema_data import CsvData
from shefex_nav.scenario import aboard, kind
from shefex_nav.scenario import load as missions
from shefex_nav.scenario.checks import band_without_width, states_that_clash
from shefex_nav.scenario.columns import named_twice

SHORTEST_S = 1.0  # of a replay


def load(path, overrides=(), folder=None):
    """ReplayScenario of the YAML file at `path` after the `overrides`, and the paths of its data.

    path : may be the bare name of one that the package brings
    folder: where the data are, in place of what the file says

    Returns
    -------
    scenario : ReplayScenario
    files : {'imu', 'gnss', 'truth' or an instrument: path, or None of what is not given}

    Raises ScenarioError.
    """
    path = missions.file_of(path)
    found_in = partial(_folder, os.path.dirname(path), folder)
    scenario, _, source = missions.load_as(
        schema.model,
        path,
        overrides,
        parts=(*PARTS, partial(_files, found_in, folder is None)),
        instead=kind.instead_of_replay,
    )
    scenario.keep_text(source)
    base, names = found_in(scenario), _names(scenario.data)
    return scenario, {name: given and os.path.join(base, given) for name, given in names.items()}


def load_text(text, name, overrides=()):
    """ReplayScenario of a text, such as a log keeps; complaints call it `name`. Raises ScenarioError."""
    scenario, _, source = missions.load_text_as(schema.model, text, name, overrides, parts=PARTS)
    scenario.keep_text(source)
    return scenario


def _folder(beside, given, scenario):
    """Folder of the data: the one that is given, else as the scenario says, from where its file is."""
    return os.path.join(beside, scenario.data.folder) if given is None else os.fspath(given)


def _files(found_in, hint, scenario):
    """(path, words) of files that are not there.

    found_in : function of a scenario, `_folder`;  hint : whether --data is worth a word
    """
    is_csv = isinstance(scenario.data, CsvData)
    for name in _parts():
        given = _name(scenario.data, name)
        file = given and os.path.join(found_in(scenario), given)
        if given and (words := _not_a_file(file, hint)):
            yield ("data", name, *(["file"] * is_csv)), words


def _not_a_file(path, hint):
    """What a path is in place of a file that can be read, '' of one. hint : as of `_files`"""
    try:
        found = os.stat(path)
    except OSError as error:
        if not isinstance(error, FileNotFoundError | NotADirectoryError):
            return f"{path} cannot be read: {error.strerror}"
    except ValueError:  # a null character
        pass
    else:
        what = "a folder" if stat.S_ISDIR(found.st_mode) else irregular(found)
        return what and f"{path} is {what}, expected a file"
    words = "; --data says in which folder the files are" if hint else ""
    return f"there is no file {path}{words}"


def _name(data, name):
    """File name of one of the parts; None if it is not given, or is wrong."""
    part = getattr(data, name, None)
    return part if part is None or isinstance(part, str) else getattr(part, "file", None)


def _names(data):
    """Name of each part -> file name or None."""
    return {name: _name(data, name) for name in _parts()}


def _parts():
    """Names of what there may be a file of."""
    return "imu", "gnss", *TABLE, "truth"


def _times(scenario):
    """The end well after the start."""
    mission = scenario.mission
    if mission.end is not None and mission.end < mission.start + SHORTEST_S:
        yield ("mission", "end"), f"must be at least {SHORTEST_S:g} s after mission.start"


def _heading(scenario):
    """A heading that is given, with how well it is known."""
    alignment = scenario.alignment
    if not isinstance(alignment, Static):
        return
    if alignment.heading == math.inf:
        if alignment.azimuth is not None:
            yield ("alignment", "azimuth"), "has no meaning with 'heading: unknown'; leave it out"
    elif (alignment.heading is None) != (alignment.azimuth is None):
        yield ("alignment",), ("heading and azimuth, its 1 sigma, go together; give both or none of them")
    if alignment.heading is None and alignment.gyro_bias == "at_rest":
        words = "the rate at rest cannot say both north and the bias; give heading and azimuth"
        yield ("alignment", "gyro_bias"), f"{words}, or 'heading: unknown'"


def _reference(scenario):
    """A reference to start from."""
    if scenario.alignment.method == "reference" and scenario.data.truth is None:
        yield ("alignment", "method"), "'reference' needs data.truth; give it, or choose static"


def _vibration(scenario):
    """A band that has a width."""
    yield from band_without_width(scenario.imu.vibration)


def _states(scenario):
    """Blocks of states that go together."""
    yield from states_that_clash(scenario.navigation.states)


def _imu_units(scenario):
    """Gyros and accelerometers that give the same kind of thing."""
    data = scenario.data
    if isinstance(data, CsvData) and data.imu.gyro_unit.kind != data.imu.accelerometer_unit.kind:
        kinds = f"the gyros give {data.imu.gyro_unit.kind}s"
        words = f"{kinds}, the accelerometers {data.imu.accelerometer_unit.kind}s; both must be of one kind"
        yield ("data", "imu", "accelerometer_unit"), words


def _sigmas(scenario):
    """No sigma of what is not there."""
    data = scenario.data
    if isinstance(data, CsvData) and data.gnss.velocity is None and data.gnss.velocity_sigma is not None:
        yield ("data", "gnss", "velocity_sigma"), "goes with data.gnss.velocity, which is not given"


# fields whose columns differ; sigmas may share one, of all axes, and `valid` may be that of `satellites`
QUANTITIES = "time", "position", "velocity", "attitude", "gyro", "accelerometer"


def _columns_once(scenario):
    """A column of a file for each quantity of it."""
    data = scenario.data
    for name in _parts() if isinstance(data, CsvData) else ():
        section = getattr(data, name, None)
        own = (one.key for one in TABLE[name].data if one.vector) if name in TABLE else ()
        given = {("data", name, key): getattr(section, key, None) for key in (*QUANTITIES, *own)}
        yield from named_twice(given)


def _without_height(scenario):
    """Latitude and longitude alone: nothing of a third axis, and a height to start from."""
    data = scenario.data
    if not isinstance(data, CsvData):
        return
    gnss, path = data.gnss, ("data", "gnss")
    n = len(gnss.position)
    if n == 2 and gnss.position_frame == "ecef":
        yield (*path, "position"), "ecef has three columns x, y, z; two are latitude and longitude"
    if n == 2 and gnss.velocity is not None:
        yield (*path, "velocity"), "fixes without height are used without velocity; leave it out"
    if n == 2 and gnss.height is None:
        yield (*path, "height"), "fixes say no height; give that of the start above the ellipsoid"
    if n == 3 and gnss.height is not None:
        yield (*path, "height"), "data.gnss.position has a height; leave this one out"
    if gnss.position_sigma is not None and len(gnss.position_sigma) != n:
        words = f"{len(gnss.position_sigma)} columns for a position of {n}; give one for each"
        yield (*path, "position_sigma"), words


def _both_or_none(scenario):
    """Sensors that are described where there are data of them."""
    for name in TABLE:
        columns = getattr(scenario.data, name, None)
        if (columns is None) != (getattr(scenario, name, None) is None):
            words = f"data.{name} says where its file is, {name} what to assume of it: give both or none"
            yield ("data" if columns is None else name,), words


def _instruments(scenario):
    """Instruments with one column to read for each field, and their states."""
    for name, one in TABLE.items():
        columns, of_field = getattr(scenario.data, name, None), {}
        for column in one.data if columns is not None else ():
            of_field.setdefault(column.field, []).append(column.key)
        for keys in of_field.values():
            if sum(getattr(columns, key) is not None for key in keys) != 1:
                yield ("data", name), f"give one of {' and '.join(keys)}, the column to read"
    yield from aboard.of_sensors(scenario)


PARTS = (
    _times,
    _heading,
    _reference,
    _vibration,
    _states,
    _imu_units,
    _sigmas,
    _columns_once,
    _without_height,
    _both_or_none,
    _instruments,
)
