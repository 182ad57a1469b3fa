"""The scenario: every section of a scenario file, in the order of a mission.

The models check single values; `checks` compares values with each other, `params` turns sections into the
parameters of the stages. Once loaded, a quantity is a float in SI and radians.
"""

from pydantic import PrivateAttr

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.camera import StarCamera
from shefex_nav.scenario.mission import Earth, Launch, Mission, Programme
from shefex_nav.scenario.onboard import Log, Navigation, StarTracker
from shefex_nav.scenario.sensors import Gps, Imu, PadAlignment
from shefex_nav.scenario.vehicle import Vehicle


class Scenario(Block):
    """A mission to simulate."""

    mission: Mission
    earth: Earth
    launch: Launch
    vehicle: Vehicle
    programme: Programme
    imu: Imu
    gps: Gps
    pad_alignment: PadAlignment
    star_camera: StarCamera
    star_tracker: StarTracker
    navigation: Navigation
    log: Log

    _source: str = PrivateAttr("")
    _files: tuple[tuple[str, str], ...] = PrivateAttr(())

    @property
    def source(self):
        """YAML text with `extends` and overrides carried out; it loads to the same scenario."""
        return self._source

    @property
    def files(self):
        """(name, text) of each file it was read from, as it was written; the file itself first."""
        return self._files

    def keep_text(self, source, files):
        """Remember where the scenario came from."""
        self._source, self._files = source, tuple(files.items())
