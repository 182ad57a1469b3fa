"""What a cell is told wrongly, and how good its inertial sensors are: the levels of these two factors.

What the computer is told differently goes into `navigation.told`. Stamps of time and the noise that a
receiver reports are no part of a data sheet: those are changed in the fixes on their way to the computer.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

RIGHT = "right"
SHOWS = "noise up to two"  # it shows in residuals
CONSTANT = "constant up to two"
BEYOND = "beyond what is required"
TO = "navigation.told."

GRADES = {  # instruments that come with the program, one of each grade
    "navigation": "hg9900",
    "tactical": "ln_200s",
    "industrial_mems": "adis16470",
    "consumer_mems": "icm_42688_p",
}


class Told(NamedTuple):
    """A way to tell the computer something that is not so."""

    words: str
    kind: str  # RIGHT, SHOWS, CONSTANT or BEYOND: which requirement holds
    settings: Callable | None = None  # of the true Scenario -> list of KEY=VALUE of what is told
    late_s: float = 0.0  # by which fixes are stamped too late: what they say was true so long before
    reported: float = 1.0  # sigma that the receiver reports, over the true one
    needs_stars: bool = False
    residuals: float = 1.0  # factor on noises that are told: the NEES is required at 0.3 to 3


NOISE = ("gyro.random_walk", "rad/sqrt(s)"), ("accelerometer.random_walk", "m/s/sqrt(s)")
BIAS = (
    ("gyro.bias", "rad/s"), ("gyro.in_run_bias", "rad/s"),
    ("accelerometer.bias", "m/s2"), ("accelerometer.in_run_bias", "m/s2"),
)  # fmt: skip
SCALE = ("gyro.scale_factor_roll", "ppm"), ("gyro.scale_factor", "ppm"), ("accelerometer.scale_factor", "ppm")


def _scaled(rows, factor):
    """Settings of the IMU and their units, told `factor` times as large."""

    def settings(scenario):
        found = []
        for path, unit in rows:
            triad, name = path.split(".")
            value = factor * getattr(getattr(scenario.imu, triad), name) * (1e6 if unit == "ppm" else 1.0)
            found.append(f"{TO}imu.{path}={value:.12g} {unit}")
        return found

    return settings


def _arm(factor):
    def settings(scenario):
        arm = ", ".join(f"{factor * metres:.9g} m" for metres in scenario.gps.antenna.lever_arm)
        return [f"{TO}gps.antenna.lever_arm=[{arm}]"]

    return settings


def _mounting(sigmas):
    """Boresight turned about the x axis of the image by so many sigmas of what is told of the mounting."""

    def settings(scenario):
        mounting = scenario.star_camera.mounting
        boresight, right = np.array(mounting.boresight), np.array(mounting.image_right)
        boresight, right = boresight / np.linalg.norm(boresight), right / np.linalg.norm(right)
        turned = boresight + np.tan(sigmas * mounting.error) * np.cross(right, boresight)
        return [f"{TO}star_camera.mounting.boresight=[{', '.join(f'{one:.12g}' for one in turned)}]"]

    return settings


TOLD = {
    "right": Told("everything rightly", RIGHT),
    "noise_0.2": Told("noise of the IMU 0.2 times", BEYOND, _scaled(NOISE, 0.2), residuals=0.2),
    "noise_0.5": Told("noise of the IMU 0.5 times", SHOWS, _scaled(NOISE, 0.5), residuals=0.5),
    "noise_2": Told("noise of the IMU 2 times", SHOWS, _scaled(NOISE, 2.0), residuals=2.0),
    "noise_10": Told("noise of the IMU 10 times", BEYOND, _scaled(NOISE, 10.0), residuals=10.0),
    "bias_0.2": Told("biases of the IMU 0.2 times", BEYOND, _scaled(BIAS, 0.2)),
    "bias_0.5": Told("biases of the IMU 0.5 times", CONSTANT, _scaled(BIAS, 0.5)),
    "bias_2": Told("biases of the IMU 2 times", CONSTANT, _scaled(BIAS, 2.0)),
    "bias_10": Told("biases of the IMU 10 times", BEYOND, _scaled(BIAS, 10.0)),
    "scale_0.2": Told("scale factors of the IMU 0.2 times", BEYOND, _scaled(SCALE, 0.2)),
    "scale_0.5": Told("scale factors of the IMU 0.5 times", CONSTANT, _scaled(SCALE, 0.5)),
    "gps_noise_0.5": Told("the receiver reports half its noise", SHOWS, reported=0.5, residuals=0.5),
    "gps_noise_3": Told("the receiver reports 3 times its noise", BEYOND, reported=3.0, residuals=3.0),
    "arm_2": Told("lever arm of the antenna 2 times", CONSTANT, _arm(2.0)),
    "arm_-1": Told("lever arm of the antenna the other way round", BEYOND, _arm(-1.0)),
    "mounting_2": Told("camera turned by 2 sigma", CONSTANT, _mounting(2.0), needs_stars=True),
    "mounting_10": Told("camera turned by 10 sigma", BEYOND, _mounting(10.0), needs_stars=True),
    "latency_20ms": Told("fixes are 20 ms older than they say", BEYOND, late_s=0.02),
    "latency_200ms": Told("fixes are 200 ms older than they say", BEYOND, late_s=0.2),
    "clock_-50ms": Told("clock of the GPS 50 ms behind that of the IMU", BEYOND, late_s=-0.05),
}


def imu_settings(grade):
    """KEY=VALUE of a grade: list. States that a scenario names are those of its own unit."""
    return [f"imu.use={GRADES[grade]}", "navigation.states=automatic"]


def shaken(scenario, factor):
    """KEY=VALUE of a world that shakes more than the computer is told: list."""
    vibration = scenario.imu.vibration
    boost = ", ".join(f"{factor * level:.9g} m/s2" for level in vibration.boost)
    return [f"imu.vibration.boost=[{boost}]", f"imu.vibration.coast={factor * vibration.coast:.9g} m/s2"]
