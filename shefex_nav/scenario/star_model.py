"""The statistics that a scenario names for its star tracker, whatever its frames are.

A scenario of rendered frames is loaded without them (`expand`): its camera may be another one. Whoever
predicts what the star tracker would do asks here.
"""

from pydantic import ValidationError

from shefex_nav.scenario import layers, messages, overriding
from shefex_nav.scenario.document import BadText, parse
from shefex_nav.scenario.files import Unreadable, read_text
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.star_statistics import StarStatistics

MODEL = "star_tracker.model"


def named_by(path, overrides=()):
    """StarStatistics of the file that star_tracker.model of a scenario names, None without one.

    path, overrides : as of `load.load`. ScenarioError if the file cannot be read
    """
    files, path = layers.Texts(), layers.file_of(path)
    tree, places = layers.extended(path, files)
    overriding.carry_out(overrides, tree, places, files)
    section = tree.get("star_tracker")
    name = section.get("model") if isinstance(section, dict) else None
    if not isinstance(name, str):
        return None
    mark = places.value(("star_tracker", "model"))
    try:
        found = parse(read_text(name, "a file of `shefex-nav characterise`"), name)
        return StarStatistics.model_validate(found.tree)
    except (Unreadable, BadText) as error:
        raise ScenarioError([f"{mark}: {MODEL}: '{name}' {error.args[-1]}"]) from None
    except ValidationError as error:
        lines = [words for _, words in messages.lines(StarStatistics, error, places)]
        raise ScenarioError([f"{mark}: {MODEL}: '{name}': {lines[0]}"]) from None
