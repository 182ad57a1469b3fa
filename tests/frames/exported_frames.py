"""Short flights, exported."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.frames import export, flown
from shefex_nav.scenario import load

SEED = 5
DEEP = (  # 12 bits, with the charge of the full well in them; no margin for centroids
    "star_tracker.centroid_floor=0 pix",
    "star_camera.detector.bits=12",
    "star_camera.detector.conversion=7.5 electron/DN",
    "star_camera.detector.black_level=60 DN",
    "star_tracker.exposure.gain=0 dB",
    "star_tracker.exposure.brightest_mean=1600 DN",
    "star_tracker.detection.saturation=4000 DN",
)


class Exported(NamedTuple):
    """A folder of frames, and what they were made of."""

    folder: Path
    flight: flown.Flight
    shots: list


def exported(folder, name, overrides, seed, until_s, every=1, kind="png"):
    """Exported of a scenario."""
    flight = flown.of_scenario(load.load(name, overrides), seed)
    shots = flown.shots(flight, None, until_s=until_s, every=every)
    folder.mkdir()
    return Exported(folder, flight, list(export.write(folder, flight, shots, kind)))


def error_c(q_ci, q_ic):
    """Error of an attitude [rad], camera axes."""
    from shefex_nav.geometry.rotation import quat_conjugate, rotvec_between

    return np.asarray(rotvec_between(quat_conjugate(q_ci), q_ic))
