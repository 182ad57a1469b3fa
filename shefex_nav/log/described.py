"""The texts of a log's metadata and attachment, which may be anybody's, as the fields of a Mission."""

from datetime import datetime

from shefex_nav.fields import LARGEST
from shefex_nav.files import from_json
from shefex_nav.log import topics
from shefex_nav.log.topics import LogError

TEXTS = "scenario", "seed", "version", "epoch_utc"  # keys that each log has
MOST_DIGITS = 30  # of a seed
FIRST_YEAR, LAST_YEAR = 1973, 2100  # of UTC, as the tables of the Earth's rotation know it
ITEMS = {"plugins": (str, str), "software": (str, str, str)}  # an item of these lists: names, SHA-256
LENSES = 0, 5  # numbers of a distortion


def mission(path, numbers, raw):
    """Mission of the constants in a log and its texts; LogError names the key and what it says.

    path : of the log, for messages;  numbers : Mission without texts;  raw : content of the log
    """
    metadata = raw.metadata
    if topics.ATTACHMENT not in raw.attachments:
        raise LogError(f"{path}: the log has no attachment {topics.ATTACHMENT}, the scenario as flown")
    for key in TEXTS:
        if key not in metadata:
            raise LogError(f"{path}: metadata '{topics.METADATA}': {key} is missing")
    seed = metadata["seed"]
    if not (seed.isascii() and seed.isdigit() and len(seed) <= MOST_DIGITS):
        raise _unexpected(path, metadata, "seed", f"a whole number of {MOST_DIGITS} digits at most")
    if not _is_instant(metadata["epoch_utc"]):
        expected = f"an instant of {FIRST_YEAR} to {LAST_YEAR} as ISO 8601 has it"
        raise _unexpected(path, metadata, "epoch_utc", expected)
    return numbers._replace(
        scenario=metadata["scenario"],
        scenario_text=raw.attachments[topics.ATTACHMENT].decode(errors="replace"),
        seed=int(seed),
        version=metadata["version"],
        epoch_utc=metadata["epoch_utc"],
        distortion=_distortion(path, metadata),
        **{key: own(path, metadata, key) for key in ITEMS},
    )


def own(path, metadata, key):
    """Mission.plugins or Mission.software of the metadata."""
    found = _json(metadata, key)
    kinds = ITEMS[key]
    if not isinstance(found, list) or any(_kinds(item) != kinds for item in found):
        raise _unexpected(path, metadata, key, f"a list of lists of {len(kinds)} texts")
    return tuple(map(tuple, found))


def _distortion(path, metadata):
    """Mission.distortion of the metadata."""
    found = _json(metadata, "distortion")
    are_numbers = isinstance(found, list) and all(type(one) in (int, float) for one in found)
    if not are_numbers or len(found) not in LENSES or not all(abs(one) < LARGEST for one in found):
        raise _unexpected(path, metadata, "distortion", f"a list of {LENSES[1]} numbers")
    return tuple(found)


def _json(metadata, key):
    """What a text of the metadata holds, [] where there is none; None of what is no JSON."""
    try:
        return from_json(metadata.get(key, "[]"))
    except ValueError:
        return None


def _kinds(item):
    return tuple(map(type, item)) if isinstance(item, list) else ()


def _is_instant(text):
    try:
        return FIRST_YEAR <= datetime.fromisoformat(text).year <= LAST_YEAR
    except ValueError:
        return False


def _unexpected(path, metadata, key, expected):
    """LogError of an impossible text."""
    got = repr(metadata[key])
    got = got if len(got) <= 60 else f"{got[:57]}..."
    return LogError(f"{path}: metadata '{topics.METADATA}': {key}: got {got}, expected {expected}")
