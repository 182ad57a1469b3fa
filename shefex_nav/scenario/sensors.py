"""Sections of a scenario about the IMU, the alignment on the pad and the star camera."""

from typing import Annotated, Any

from pydantic import Field

from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.use import Instrument, Use
from shefex_nav.world import camera_settings, settings
from shefex_nav.world.settings import OFF, UNLIMITED

__all__ = [
    "OFF",
    "OF_IMU",
    "UNLIMITED",
    "Accelerometer",
    "Gyro",
    "Imu",
    "PadAlignment",
    "StarCamera",
    "Vibration",
]
OF_IMU = (
    "name of an instrument, or of its file, whose gyro and accelerometer these are; "
    "what stands beside it comes on top"
)
Gyro, Accelerometer, Vibration, PadAlignment = (
    section(one) for one in (settings.Gyro, settings.Accelerometer, settings.Vibration, settings.PadAlignment)
)


class StarCamera(section(camera_settings.StarCamera)):
    """Star camera, in the world."""

    use: Annotated[Any, Instrument("prosilica_ec655")] = Field(
        None,
        description="name of an instrument, or of its file, whose optics and detector these are; "
        "what stands beside it comes on top",
    )


class Imu(section(settings.Imu)):
    """Strapdown inertial measurement unit, 400 samples a second of integrated rate and specific force."""

    use: Use = Field(None, description=OF_IMU)
