"""Settings of the inertial measurement unit and of the alignment, for scenario and world alike."""

from math import inf

from shefex_nav.settings import Settings, quantity, section

UNLIMITED = (("unlimited", inf),)
OFF = (("off", 0.0),)
NOT_KNOWN = (("unknown", inf),)


class Gyro(Settings):
    """Gyro triad; every error is one standard deviation of what is drawn per run and axis."""

    bias: float = quantity("rad/s", "0.5 deg/h", "turn-on bias", non_negative=True)
    in_run_bias: float = quantity("rad/s", "0.1 deg/h", "bias that wanders during the run", non_negative=True)
    in_run_bias_time: float = quantity("s", "300 s", "correlation time of the in-run bias", positive=True)
    random_walk: float = quantity("rad/sqrt(s)", "0.02 deg/sqrt(h)", "angular random walk", non_negative=True)
    scale_factor_roll: float = quantity(
        "", "30 ppm", "scale factor error of the roll (x) gyro", non_negative=True, at_most="100 %"
    )
    scale_factor: float = quantity(
        "", "100 ppm", "scale factor error of the y and z gyros", non_negative=True, at_most="100 %"
    )
    misalignment: float = quantity(
        "rad", "0.1 mrad", "each axis towards each other", non_negative=True, at_most="1 rad"
    )
    g_sensitivity: float = quantity(
        "rad s/m", "0.5 deg/h/gee", "rate error per specific force", non_negative=True
    )
    vibration_rectification: float = quantity(
        "rad s3/m2", "0.03 deg/h/gee2", "bias per square of the vibration level", non_negative=True
    )
    range: float = quantity("rad/s", "1000 deg/s", "largest rate measured", positive=True, words=UNLIMITED)
    quantum: float = quantity(
        "rad", "0.1 arcsec", "angle of one count", positive=True, at_most="360 deg", words=OFF
    )


class Accelerometer(Settings):
    """Accelerometer triad; every error is one standard deviation of what is drawn per run and axis."""

    bias: float = quantity("m/s2", "0.3 mgee", "turn-on bias", non_negative=True)
    in_run_bias: float = quantity("m/s2", "20 ugee", "bias that wanders during the run", non_negative=True)
    in_run_bias_time: float = quantity("s", "300 s", "correlation time of the in-run bias", positive=True)
    random_walk: float = quantity("m/s(3/2)", "0.03 m/s/sqrt(h)", "velocity random walk", non_negative=True)
    scale_factor: float = quantity("", "300 ppm", "scale factor error", non_negative=True, at_most="100 %")
    misalignment: float = quantity(
        "rad", "0.1 mrad", "each axis towards each other", non_negative=True, at_most="1 rad"
    )
    vibration_rectification: float = quantity(
        "s2/m", "20 ugee/gee2", "bias per square of the vibration level", non_negative=True
    )
    range: float = quantity(
        "m/s2", "20 gee", "largest specific force measured", positive=True, words=UNLIMITED
    )
    quantum: float = quantity(
        "m/s", "0.1 mm/s", "velocity of one count", positive=True, at_most="1 km/s", words=OFF
    )


class Vibration(Settings):
    """Random vibration at the IMU, root mean square on each axis."""

    boost: tuple[float, ...] = quantity(
        "m/s2", "7 gee", "while a motor burns, one value for each stage", non_negative=True
    )
    coast: float = quantity("m/s2", "0.02 gee", "at all other times", non_negative=True)
    angular: float = quantity("rad s/m", "0.1 deg/s/gee", "rms rate per rms acceleration", non_negative=True)
    lowest_frequency: float = quantity("Hz", "20 Hz", "lower end of the flat spectrum", positive=True)
    highest_frequency: float = quantity("Hz", "2 kHz", "upper end of the flat spectrum", positive=True)


class Imu(Settings):
    """Strapdown inertial measurement unit, 400 samples a second of integrated rate and specific force."""

    gyro: Gyro = section("")
    accelerometer: Accelerometer = section("")
    vibration: Vibration = section("")


class PadAlignment(Settings):
    """What is known about position, velocity and attitude when navigation starts, 1 sigma.

    For a rocket that is what the launch crew knows about it on the pad.
    """

    level: float = quantity("rad", "0.05 deg", "about north and about east", positive=True, at_most="20 deg")
    azimuth: float = quantity(
        "rad", "0.3 deg", "about the vertical", positive=True, words=NOT_KNOWN, at_most="180 deg"
    )
    position: float = quantity("m", "1 m", "each axis", positive=True, at_most="10000 km")
    velocity: float = quantity("m/s", "0.01 m/s", "each axis", positive=True)
