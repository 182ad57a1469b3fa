"""Replay scenario file -> `ReplayScenario` and the paths of its data; all errors at once, each placed."""

import os

from shefex_nav.replay.schema import CsvData, ReplayScenario, Static
from shefex_nav.scenario import kind
from shefex_nav.scenario import load as missions
from shefex_nav.scenario.checks import states_that_clash
from shefex_nav.scenario.document import dotted
from shefex_nav.scenario.load import ScenarioError

SHORTEST_S = 1.0  # of a replay


def load(path, overrides=(), folder=None):
    """ReplayScenario of the YAML file at `path` after the `overrides`, and the paths of its data.

    folder: where the data are, in place of what the file says

    Returns
    -------
    scenario : ReplayScenario
    files : {'imu', 'gnss', 'truth'} -> path, or None for a truth that is not given

    Raises ScenarioError.
    """
    scenario, places, source = missions.load_as(
        ReplayScenario, path, overrides, instead=kind.instead_of_replay
    )
    found = _complaints(scenario, places)
    base = os.path.join(os.path.dirname(path), scenario.data.folder) if folder is None else os.fspath(folder)
    files = {}
    for name, given in _names(scenario.data).items():
        files[name] = given and os.path.join(base, given)
        if given and not os.path.isfile(files[name]):
            where = ("data", name, "file") if isinstance(scenario.data, CsvData) else ("data", name)
            hint = "; --data says in which folder the files are" if folder is None else ""
            found.append(f"{places.value(where)}: {dotted(where)}: there is no file {files[name]}{hint}")
    if found:
        raise ScenarioError(found)
    scenario.keep_text(source)
    return scenario, files


def load_text(text, name, overrides=()):
    """ReplayScenario of a text, such as a log keeps; complaints call it `name`. Raises ScenarioError."""
    scenario, places, source = missions.load_text_as(ReplayScenario, text, name, overrides)
    found = _complaints(scenario, places)
    if found:
        raise ScenarioError(found)
    scenario.keep_text(source)
    return scenario


def _complaints(scenario, places):
    """Lines about values that do not go together."""
    return [f"{places.value(where)}: {dotted(where)}: {words}" for where, words in _contradictions(scenario)]


def _names(data):
    """{'imu', 'gnss', 'truth'} -> file name or None."""
    parts = {"imu": data.imu, "gnss": data.gnss, "truth": data.truth}
    return {name: part.file if hasattr(part, "file") else part for name, part in parts.items()}


def _contradictions(scenario):
    """(path, words) of values that do not go together."""
    mission, alignment, data = scenario.mission, scenario.alignment, scenario.data
    if mission.end is not None and mission.end < mission.start + SHORTEST_S:
        yield ("mission", "end"), f"must be at least {SHORTEST_S:g} s after mission.start"
    if isinstance(alignment, Static) and (alignment.heading is None) != (alignment.azimuth is None):
        yield ("alignment",), ("heading and azimuth, its 1 sigma, go together; give both or none of them")
    if alignment.method == "reference" and data.truth is None:
        yield (
            ("alignment", "method"),
            "'reference' needs data.truth; give it, or choose static",
        )
    yield from states_that_clash(scenario.navigation.states)
    if isinstance(data, CsvData) and data.imu.gyro_unit.kind != data.imu.accelerometer_unit.kind:
        kinds = f"the gyros give {data.imu.gyro_unit.kind}s"
        words = f"{kinds}, the accelerometers {data.imu.accelerometer_unit.kind}s; both must be of one kind"
        yield ("data", "imu", "accelerometer_unit"), words
    if isinstance(data, CsvData) and data.gnss.velocity is None and data.gnss.velocity_sigma is not None:
        yield ("data", "gnss", "velocity_sigma"), "goes with data.gnss.velocity, which is not given"
