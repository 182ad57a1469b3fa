"""Replay scenario file -> `ReplayScenario` and the paths of its data; all errors at once, each placed."""

import os
from functools import partial

from shefex_nav.replay.schema import CsvData, ReplayScenario, Static
from shefex_nav.scenario import barometer, kind
from shefex_nav.scenario import load as missions
from shefex_nav.scenario.checks import states_that_clash

SHORTEST_S = 1.0  # of a replay
NAMES = ("imu", "gnss", "barometer", "truth")  # of the files


def load(path, overrides=(), folder=None):
    """ReplayScenario of the YAML file at `path` after the `overrides`, and the paths of its data.

    path : may be the bare name of one that the package brings
    folder: where the data are, in place of what the file says

    Returns
    -------
    scenario : ReplayScenario
    files : {'imu', 'gnss', 'barometer', 'truth'} -> path, or None of what is not given

    Raises ScenarioError.
    """
    path = missions.file_of(path)
    found_in = partial(_folder, os.path.dirname(path), folder)
    scenario, _, source = missions.load_as(
        ReplayScenario,
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
    scenario, _, source = missions.load_text_as(ReplayScenario, text, name, overrides, parts=PARTS)
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
    for name in NAMES:
        given = _name(scenario.data, name)
        file = given and os.path.join(found_in(scenario), given)
        if given and not os.path.isfile(file):
            words = "; --data says in which folder the files are" if hint else ""
            yield ("data", name, *(["file"] * is_csv)), f"there is no file {file}{words}"


def _name(data, name):
    """File name of one of NAMES; None if it is not given, or is wrong."""
    part = getattr(data, name, None)
    return part if part is None or isinstance(part, str) else getattr(part, "file", None)


def _names(data):
    """Name of NAMES -> file name or None."""
    return {name: _name(data, name) for name in NAMES}


def _times(scenario):
    """The end well after the start."""
    mission = scenario.mission
    if mission.end is not None and mission.end < mission.start + SHORTEST_S:
        yield ("mission", "end"), f"must be at least {SHORTEST_S:g} s after mission.start"


def _heading(scenario):
    """A heading that is given, with how well it is known."""
    alignment = scenario.alignment
    if isinstance(alignment, Static) and (alignment.heading is None) != (alignment.azimuth is None):
        yield ("alignment",), ("heading and azimuth, its 1 sigma, go together; give both or none of them")


def _reference(scenario):
    """A reference to start from."""
    if scenario.alignment.method == "reference" and scenario.data.truth is None:
        yield ("alignment", "method"), "'reference' needs data.truth; give it, or choose static"


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


def _barometer(scenario):
    """A barometer that is described where there is one, with one column to read."""
    columns = getattr(scenario.data, "barometer", None)
    if (columns is None) != (scenario.barometer is None):
        words = "data.barometer says where its file is, barometer what to assume of it: give both or none"
        yield ("data" if columns is None else "barometer",), words
    if columns is not None and (columns.pressure is None) == (columns.height is None):
        yield ("data", "barometer"), "give one of pressure and height, the column to read"
    yield from barometer.of_sensor(scenario)


PARTS = (_times, _heading, _reference, _states, _imu_units, _sigmas, _without_height, _barometer)
