"""A star identification of your own, as a plug-in of a scenario; `shefex-nav new` prints how it is flown.

It flies as it is: the four brightest objects of a picture are named so that all angles between them are those
of the catalogue. A bright object that is no star makes it fail, and it is slow; the methods of the project do
better. Replace `identify`.
"""

import numpy as np

from shefex_nav.onboard.startracker.identify.verify import nothing, verify
from shefex_nav.plugins import Method
from shefex_nav.records import Reason


def identify(settings, camera, pairs, u_c, flux, P_px=None):
    """Which star each detection is.

    Parameters
    ----------
    settings : section `star_tracker.identification` of the scenario
    camera : the pinhole (`camera.pinhole`) and the light of a star of magnitude 0 (`camera.zero_flux`)
    pairs : catalogue (`pairs.stars`: unit vectors `u_i`, magnitudes `vmag`) and the table of its pairs,
        sorted by angle (`pairs.cosine`, rows of their stars `pairs.first` and `pairs.second`)
    u_c : (n, 3) unit vectors of the detections in camera axes, brightest first
    flux : (n,) their light, electrons
    P_px : (n, 2, 2) covariance of each centroid, pixels squared

    Returns
    -------
    Identification: row in the catalogue of each detection, -1 where there is none, and a Reason
    """
    if len(flux) < settings.fewest_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    for rows in fours(pairs, u_c, settings.tolerance):
        star = np.full(len(flux), -1, dtype=np.int64)
        star[:4] = rows
        # a method proposes, the verification decides: it matches the whole picture, and refuses chance
        found = verify(settings, camera, pairs.stars, u_c, flux, star)
        if found.reason == Reason.NONE:
            return found
    return nothing(len(flux), Reason.NO_MATCH)


def fours(pairs, u_c, tolerance):
    """Rows of stars whose angles are those of the detections 0 to 3, within a tolerance [rad]."""
    u_i, angles = pairs.stars.u_i, np.arccos(np.clip(pairs.cosine, -1.0, 1.0))
    near = np.flatnonzero(np.abs(angles - np.arccos(u_c[0] @ u_c[1])) < tolerance)
    found = [list(pair) for k in near for pair in _both_ways(pairs.first[k], pairs.second[k])]
    for detection in (2, 3):
        wanted = np.arccos(u_c[:detection] @ u_c[detection])
        found = [[*rows, row] for rows in found for row in _third(u_i, rows, wanted, tolerance)]
    return found


def _both_ways(a, b):
    return (a, b), (b, a)


def _third(u_i, rows, wanted, tolerance):
    """Rows of stars that have the wanted angles, rad, to those of `rows`."""
    angles = np.arccos(np.clip(u_i @ u_i[rows].T, -1.0, 1.0))
    return np.flatnonzero(np.all(np.abs(angles - wanted) < tolerance, axis=1))


PROVIDES = [Method("identification", "mine", identify)]
