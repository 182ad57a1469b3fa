"""From the section `trajectory` of a scenario to the rows of its file."""

from shefex_nav.errors import UserError
from shefex_nav.scenario import trajectory as section
from shefex_nav.trajectory import ccsds, csv_file, exports, log_file


class Changed(UserError):
    """A file that is not the one that the scenario has been read with."""


def rows(given, earth, epoch):
    """Rows of a scenario.trajectory.Trajectory. earth : EarthRotation; epoch : ccsds.Epoch"""
    attitude = getattr(given, "attitude", None)
    _same(given.file, given.sha256)
    if isinstance(given, section.Csv):
        found = csv_file.read(given, earth)
    elif isinstance(given, section.Oem):
        found = ccsds.oem(given, earth, epoch)
    elif isinstance(given, section.Log):
        found = log_file.read(given, earth)
    else:
        found = exports.read(given, earth)
    if isinstance(attitude, section.AemFile):
        _same(attitude.aem, attitude.sha256)
        found = found._replace(attitudes=ccsds.aem(attitude, earth, epoch))
    return found


def _same(path, sha256):
    """Refuse another content than the scenario was read with."""
    try:
        content = section.content(path)
    except OSError as error:
        raise Changed(f"{path}: cannot be read: {error.strerror}") from None
    if sha256 is not None and content != sha256:
        words = "is not the file that this scenario was read with (SHA-256)"
        raise Changed(f"{path}: {words}; take that one, or read the scenario again")
