"""Random numbers: one independent stream per sensor, and the coloured noise that sensors share.

The key of a stream never changes, so a new sensor or a draw more in one sensor changes no other's noise.
"""

from zlib import crc32

import numpy as np

from shefex_nav.compiled import kernel

STREAMS = {
    "imu": 1,
    "gps": 2,
    "pad": 3,
    "camera_errors": 4,  # mounting, calibration, defects, false objects: drawn once per run
    "camera_noise": 5,  # shot, dark and read noise of every frame
    "attitude_control": 6,  # errors of the reference by which the cold-gas system steers
    "gps_errors": 7,  # of ranges, as far as they last; receiver clock, reacquisition
    "faults": 8,  # wrong star fixes
    "sightings": 9,  # what a star tracker finds in pictures that are not drawn
}
FIRST_BY_NAME = 1000  # keys of streams that follow from a name


def generator(seed, stream):
    """Generator of one stream of the run with this seed. stream : of `STREAMS`, or its key"""
    key = STREAMS[stream] if isinstance(stream, str) else stream
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, key)))


def key_of(name):
    """Key of a stream that is not in `STREAMS`, by its name."""
    return FIRST_BY_NAME + crc32(name.encode())


def gauss_markov(correlation, white, before=None):
    """First-order Gauss-Markov processes of unit variance, stationary from their first sample.

    x[k] = correlation * x[k-1] + sqrt(1 - correlation^2) * white[k],   x[0] = white[0]

    The exact discrete form of dx/dt = -x/tau + noise for correlation = exp(-dt/tau).

    Parameters
    ----------
    correlation : float
    white : (N, m) independent standard normal numbers, time along the first axis
    before : (m,) the last sample of a piece which this one goes on from; None: this is the first

    Returns
    -------
    (N, m)
    """
    drive, out = np.sqrt(1.0 - correlation**2) * white, np.empty(white.shape)
    if before is None:
        drive[0], before = white[0], np.zeros(white.shape[1])
    _recursion(correlation, drive, before, out)
    return out


@kernel
def _recursion(correlation, drive, before, out):
    """out[k] = correlation out[k-1] + drive[k], out[-1] = before. (N, m), (m,) -> (N, m) is written"""
    for j in range(drive.shape[1]):
        last = before[j]
        for k in range(drive.shape[0]):
            last = correlation * last + drive[k, j]
            out[k, j] = last
