"""Sections of a scenario about the inertial measurement unit and the alignment on the pad.

Values are floats in SI and radians once loaded; the text in the file carries its unit.
"""

from pydantic import Field

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Quantity
from shefex_nav.scenario.use import Use

UNLIMITED = (("unlimited", float("inf")),)
OFF = (("off", 0.0),)
OF_IMU = (
    "name of an instrument, or of its file, whose gyro and accelerometer these are; "
    "what stands beside it comes on top"
)


class Gyro(Block):
    """Gyro triad; every error is one standard deviation of what is drawn per run and axis."""

    bias: Quantity("rad/s", "0.5 deg/h", "turn-on bias", non_negative=True)
    in_run_bias: Quantity("rad/s", "0.1 deg/h", "bias that wanders during the run", non_negative=True)
    in_run_bias_time: Quantity("s", "300 s", "correlation time of the in-run bias", positive=True)
    random_walk: Quantity("rad/sqrt(s)", "0.02 deg/sqrt(h)", "angular random walk", non_negative=True)
    scale_factor_roll: Quantity("", "30 ppm", "scale factor error of the roll (x) gyro", non_negative=True)
    scale_factor: Quantity("", "100 ppm", "scale factor error of the y and z gyros", non_negative=True)
    misalignment: Quantity("rad", "0.1 mrad", "each axis towards each other", non_negative=True)
    g_sensitivity: Quantity("rad s/m", "0.5 deg/h/gee", "rate error per specific force", non_negative=True)
    vibration_rectification: Quantity(
        "rad s3/m2", "0.03 deg/h/gee2", "bias per square of the vibration level", non_negative=True
    )
    range: Quantity("rad/s", "1000 deg/s", "largest rate measured", positive=True, words=UNLIMITED)
    quantum: Quantity("rad", "0.1 arcsec", "angle of one count", positive=True, words=OFF)


class Accelerometer(Block):
    """Accelerometer triad; every error is one standard deviation of what is drawn per run and axis."""

    bias: Quantity("m/s2", "0.3 mgee", "turn-on bias", non_negative=True)
    in_run_bias: Quantity("m/s2", "20 ugee", "bias that wanders during the run", non_negative=True)
    in_run_bias_time: Quantity("s", "300 s", "correlation time of the in-run bias", positive=True)
    random_walk: Quantity("m/s(3/2)", "0.03 m/s/sqrt(h)", "velocity random walk", non_negative=True)
    scale_factor: Quantity("", "300 ppm", "scale factor error", non_negative=True)
    misalignment: Quantity("rad", "0.1 mrad", "each axis towards each other", non_negative=True)
    vibration_rectification: Quantity(
        "s2/m", "20 ugee/gee2", "bias per square of the vibration level", non_negative=True
    )
    range: Quantity("m/s2", "20 gee", "largest specific force measured", positive=True, words=UNLIMITED)
    quantum: Quantity("m/s", "0.1 mm/s", "velocity of one count", positive=True, words=OFF)


class Vibration(Block):
    """Random vibration at the IMU, root mean square on each axis."""

    boost: list[Quantity("m/s2", "7 gee", "", non_negative=True)] = Field(
        description="while a motor burns, one value for each stage"
    )
    coast: Quantity("m/s2", "0.02 gee", "at all other times", non_negative=True)
    angular: Quantity("rad s/m", "0.1 deg/s/gee", "rms rate per rms acceleration", non_negative=True)
    lowest_frequency: Quantity("Hz", "20 Hz", "lower end of the flat spectrum", positive=True)
    highest_frequency: Quantity("Hz", "2 kHz", "upper end of the flat spectrum", positive=True)


class Imu(Block):
    """Strapdown inertial measurement unit, 400 samples a second of integrated rate and specific force."""

    use: Use = Field(None, description=OF_IMU)
    gyro: Gyro
    accelerometer: Accelerometer
    vibration: Vibration


class PadAlignment(Block):
    """What is known about position, velocity and attitude when navigation starts, 1 sigma.

    For a rocket that is what the launch crew knows about it on the pad.
    """

    level: Quantity("rad", "0.05 deg", "about north and about east", positive=True)
    azimuth: Quantity("rad", "0.3 deg", "about the vertical", positive=True)
    position: Quantity("m", "1 m", "each axis", positive=True)
    velocity: Quantity("m/s", "0.01 m/s", "each axis", positive=True)
