"""Errors of the world that do not happen, although everything on board counts with them.

Flights with and without one of them, of the same seed, show what it does: all else that is drawn stays as it
is, and so does all that the computer is told (settings, covariances of fixes and of the alignment).
"""

import numpy as np

from shefex_nav.settings import changed

IMU = {  # name: settings that are zero
    "gyro_bias": ("gyro.bias",),
    "gyro_in_run_bias": ("gyro.in_run_bias",),
    "gyro_random_walk": ("gyro.random_walk",),
    "gyro_scale_factor": ("gyro.scale_factor_roll", "gyro.scale_factor"),
    "gyro_misalignment": ("gyro.misalignment",),
    "gyro_g_sensitivity": ("gyro.g_sensitivity",),
    "gyro_vibration_rectification": ("gyro.vibration_rectification",),
    "gyro_quantum": ("gyro.quantum",),
    "accelerometer_bias": ("accelerometer.bias",),
    "accelerometer_in_run_bias": ("accelerometer.in_run_bias",),
    "accelerometer_random_walk": ("accelerometer.random_walk",),
    "accelerometer_scale_factor": ("accelerometer.scale_factor",),
    "accelerometer_misalignment": ("accelerometer.misalignment",),
    "accelerometer_vibration_rectification": ("accelerometer.vibration_rectification",),
    "accelerometer_quantum": ("accelerometer.quantum",),
}
CAMERA = {
    "camera_mounting": ("mounting.error",),
    "camera_focal_length": ("optics.focal_length_error",),
    "camera_principal_point": ("optics.principal_point_error",),
}
VIBRATION = "vibration"  # as noise of gyros and accelerometers; rectification is of the same level still
GPS_NOISE, GPS_LASTING, STAR_NOISE = "gps_noise", "gps_lasting", "star_noise"
LEVEL, AZIMUTH, PLACE = "alignment_level", "alignment_azimuth", "alignment_position"
NAMES = (*IMU, VIBRATION, LEVEL, AZIMUTH, PLACE, GPS_NOISE, GPS_LASTING, *CAMERA, STAR_NOISE)


def of_imu(settings, absent):
    """settings.Imu of the unit that is flown. absent : collection of NAMES"""
    return _zeroed(settings, IMU, absent)


def of_camera(settings, absent):
    """camera_settings.StarCamera of the camera that is flown."""
    return _zeroed(settings, CAMERA, absent)


def _zeroed(settings, table, absent):
    keys = [key for name in table if name in absent for key in table[name]]
    return changed(settings, dict.fromkeys(keys, 0.0)) if keys else settings


def of_alignment(absent):
    """Factors of the errors of position and velocity, and of the attitude about north, east, down (3,)."""
    level, azimuth = (float(name not in absent) for name in (LEVEL, AZIMUTH))
    return float(PLACE not in absent), np.array([level, level, azimuth])
