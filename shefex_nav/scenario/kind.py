"""Which file or section a user has given where another was expected, and the command that takes it."""

import os

from shefex_nav.files import opened

MAGIC = (  # first bytes of a file, what it is
    (b"\x89MCAP0\r\n", "is a log; `shefex-nav report`, `view` and `replay` read it"),
    (b"\x89PNG", "is a picture; `shefex-nav solve` finds where one of the night sky looks"),
    (b"SIMPLE  ", "is a picture (FITS); `shefex-nav solve` finds where one of the night sky looks"),
    (b"\xff\xd8\xff", "is a picture; `shefex-nav solve` finds where one of the night sky looks"),
    (b"PAR1", "is a table (Parquet)"),
    (b"PK\x03\x04", "is an archive (zip, npz)"),
    (b"\x1f\x8b", "is compressed (gzip)"),
    (b"RRF", "is a recording of the rerun viewer"),
    (b"MATLAB", "is a file of Matlab; a replay scenario names it under data"),
)
FLIGHT = (
    "vehicle",
    "programme",
    "star_camera",
    "star_tracker",
    "pad_alignment",
    "launch",
    "gps",
    "trajectory",
)
REPLAY = ("data", "alignment", "gnss")  # sections that flights do not have
OF_FLIGHTS = (  # sections that replays do not have
    "atmosphere", "wind", "launch", "orbit", "ground", "trajectory", "vehicle", "attitude", "programme",
    "gps", "pad_alignment", "star_camera", "star_tracker", "computer", "log", "faults", "campaign",
    "without", "dispersions",
)  # fmt: skip
CAMERA = ("bad_pixels", "principal_point")  # sections that only the camera of pictures has
INSTRUMENT = ("instrument", "unit", "source")
CAMPAIGN, STATISTICS = ("digest", "source", "sampling"), ("digest", "sightings", "identification")


def of_bytes(path):
    """What a file is that holds no text, '' if it cannot be told."""
    try:
        with opened(path) as stream:
            start = stream.read(8)
    except OSError:
        return ""
    return next((words for magic, words in MAGIC if start.startswith(magic)), "")


def of_folder(path):
    """What a folder is."""
    if os.path.isfile(os.path.join(path, "campaign.json")):
        return f"is the folder of a campaign; `shefex-nav report {path}` reads it"
    return "is a directory"


def is_replay(tree):
    """Whether a tree describes data to be replayed."""
    return "data" in tree and any(key in tree for key in REPLAY[1:]) and "vehicle" not in tree


def is_flight(tree):
    """Whether a tree describes a flight."""
    return "data" not in tree and sum(key in tree for key in FLIGHT) > 1


def is_camera(tree):
    """Whether a tree describes the camera of pictures."""
    return "star_camera" in tree and any(key in tree for key in CAMERA)


def _is_instrument(tree, path):
    """Words about the file of an instrument, '' if a tree is none."""
    if not all(key in tree for key in INSTRUMENT):
        return ""
    return f"is an instrument; a scenario takes its values with `{tree['instrument']}: {{use: {path}}}`"


def instead_of_flight(tree, path):
    """What the tree of the file at `path` is if it is no scenario of a flight, '' if it is, or nearly."""
    if words := _is_instrument(tree, path):
        return words
    if is_replay(tree):
        return (
            "is a replay scenario, about data that were recorded (it has 'data', no 'vehicle'); "
            f"`shefex-nav replay {path}` runs the navigation over them"
        )
    if is_camera(tree):
        return f"is the camera of pictures; `shefex-nav solve IMAGE --camera {path}` takes it"
    if all(key in tree for key in CAMPAIGN):
        folder = os.path.dirname(path) or "."
        return f"is the head of a campaign; `shefex-nav report {folder}` reads the campaign"
    if all(key in tree for key in STATISTICS):
        return (
            "holds the statistics of a star tracker, as `shefex-nav characterise` writes them; a scenario "
            "names it with star_tracker.model"
        )
    return ""


def instead_of_replay(tree, path):
    """The same of what is no replay scenario."""
    if words := _is_instrument(tree, path):
        return words
    if is_flight(tree):
        return (
            f"is a scenario of a flight; `shefex-nav run {path}` flies it, and replay takes the log of that, "
            "or a replay scenario such as csv_example"
        )
    return ""


def of_the_other(key, known):
    """What an unknown section is if scenarios of the other kind have it, '' of any other.

    known : sections of this kind
    """
    if key in REPLAY and "vehicle" in known:
        return "is a section of replay scenarios (`shefex-nav replay`), this is one of a flight"
    if key in OF_FLIGHTS and "data" in known:
        return "is a section of scenarios of flights (`shefex-nav run`), this is one of a replay"
    return ""


def instead_of_camera(tree, path):
    """The same of what is no camera of pictures."""
    if words := _is_instrument(tree, path):
        return words
    if is_replay(tree):
        return "is a replay scenario, which has no star camera; give a camera file or a scenario of a flight"
    return ""
