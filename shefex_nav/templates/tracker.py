"""Star tracker software of your own: pictures in, attitudes out, to start from.

    shefex-nav run night_sky --set star_tracker.software=FILE:MyTracker --trust

`start` is called once; `step` with every picture, ten times a second. It gives a `Solved`: an attitude with
its covariance, or the reason for none. An attitude that is wrong and says otherwise is the worst that it can
give. SI units and radians; `C_ic` turns components in camera axes (x right, y down, z along the boresight)
into inertial ones; quaternions are Hamilton, scalar first; pixel (0, 0) is the centre of the top-left one.
"""

import numpy as np
from scipy import ndimage

import shefex_nav
from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec, quat_from_dcm
from shefex_nav.records import Reason
from shefex_nav.software import Solved

LIGHT = 299792458.0  # m/s
THRESHOLD = 4.0  # standard deviations of the background
FEWEST_PIXELS = 3  # of an object; a hot pixel is one
FEWEST = 4  # stars
MOST = 15  # objects that are looked at, the brightest
CENTROID_PX = 0.15  # error of a centroid, one standard deviation


class MyTracker:
    """Threshold, centre of mass, and the star identification of the package."""

    def start(self, mission):
        camera = mission.camera
        self.camera = shefex_nav.Camera(
            camera.width_px,
            camera.height_px,
            camera.focal_length_px,
            (camera.cx_px, camera.cy_px),
            mission.sheets["star_camera"].optics.distortion,
        )
        self.year = float(mission.epoch_utc[:4]) + 0.5

    def step(self, frame, context):
        """frame : records.Frame; context : what the navigation knows of it, NaN or None where it does not."""
        xy_px, flux_dn = objects(frame.image_dn.astype(float))
        seen = {"xy_px": xy_px, "flux_dn": flux_dn}
        if len(xy_px) < FEWEST:
            return Solved(reason=Reason.TOO_FEW_STARS, **seen)
        found = shefex_nav.solve_centroids(
            xy_px, flux_dn, camera=self.camera, epoch=self.year, centroid_sigma_px=CENTROID_PX
        )
        if found.status != "ok":
            return Solved(reason=Reason[found.reason.upper()], **seen)
        C_ic = dcm_from_quat(found.q_ci).T
        if context.velocity_i is not None:  # aberration: stars are seen where the vehicle flies to
            C_ic = dcm_from_rotvec(np.cross(C_ic[:, 2], context.velocity_i) / LIGHT) @ C_ic
        return Solved(quat_from_dcm(C_ic), found.covariance, hip=found.hip, **seen)


def objects(image):
    """Centroids (n, 2) and light (n,) of what stands out of the background, brightest first."""
    background = np.median(image)
    sigma = 1.4826 * np.median(np.abs(image - background)) + 0.5  # of a grey value
    above = np.maximum(image - background, 0.0)
    labels, n = ndimage.label(above > THRESHOLD * sigma)
    pixels = np.bincount(labels.ravel(), minlength=n + 1)[1:]
    numbers = 1 + np.flatnonzero(pixels >= FEWEST_PIXELS)
    if not len(numbers):
        return np.zeros((0, 2)), np.zeros(0)
    flux = ndimage.sum_labels(above, labels, numbers)
    yx = np.array(ndimage.center_of_mass(above, labels, numbers))
    best = np.argsort(-flux)[:MOST]
    return yx[best, ::-1], flux[best]
