"""Every star of a proven picture: its name, what it is worth, and the solution that all of them make.

In: a fit that is proved, all detections. Out: an ImageSolution with covariance. Faint detections, and bright
ones whose middle is saturated, are named here, when the lens is known.
"""

from dataclasses import replace

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.rotation import dcm_from_rotvec, quat_from_dcm
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS
from shefex_nav.solve import lens, steps
from shefex_nav.solve.camera import undistorted
from shefex_nav.solve.search import sky_of
from shefex_nav.solve.solution import ImageSolution, Match, angles, marks

BRIGHTNESS = 1.2  # mag, between a detection and its star: band, noise
SATURATED = 5.0  # mag, that a saturated star may look fainter
STEP = 1e-4  # of a focal length, for differences
ROUNDS = 4  # of a given camera with distortion, for its focal length


def centred(camera, xy_px):
    """Pixels of an ideal camera with its axis in the middle of the picture, from those of a given camera."""
    size_px = camera.width_px, camera.height_px
    return undistorted(camera, xy_px) - camera.principal_point_px + lens.middle(size_px)


def described(solved, found, xy_px, size_px, sky_of_day, camera, clock, record=None):
    """ImageSolution of a proven fit.

    found : Field;  xy_px : (n, 2) its detections as an ideal camera sees them, where one is given
    sky_of_day : Julian year, and barycentric velocity of the Earth [m/s] or None
    """
    year, velocity_i = sky_of_day
    fit, outcome = solved
    star, sky = all_stars(fit, found, xy_px, size_px, year)
    known = np.flatnonzero(star >= 0)
    first, u_i = fit.lens, sky.u_i[star[known]]
    seen_i = u_i if velocity_i is None else aberrate(u_i, velocity_i)
    if velocity_i is not None:
        first = first._replace(C_ci=against(first.C_ci, velocity_i))
    best = lens.adjust(first, fit.prior, seen_i, xy_px[known], found.P_px[known], size_px)
    if camera is not None:
        best, camera, xy_px = _straightened(best, fit.prior, (camera, xy_px), found, known, seen_i)
    if record is not None:
        record.adjusted, record.known, record.u_i = best, known, u_i
        record.residual_px = xy_px[known] - lens.project(best.lens, seen_i, size_px)[0]
    columns = sky.hip[star[known]], *found.xy_px[known].T, sky.vmag[star[known]]
    matched = [Match(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]
    ra, dec, roll, fov_x, fov_y = _pointing(best.lens, size_px, camera)
    told, camera = camera, lens.camera_of(best.lens, size_px) if camera is None else camera
    return ImageSolution(
        "ok", "", ra, dec, roll, fov_x, fov_y, matched, outcome.false_probability, clock.ms(),
        quat_from_dcm(best.lens.C_ci), camera, found.xy_px, best.covariance[:3, :3], None, best.residual_px,
        fov_sigma_deg=_fov_sigma(best, size_px, told), aberration_removed=velocity_i is not None,
        julian_year=year,
        camera_q_ci=quat_from_dcm(best.lens.axis_C_ci), camera_covariance=lens.of_axis(best.covariance),
    )  # fmt: skip


def _straightened(best, prior, of_told, found, known, seen_i):
    """Adjusted, camera and places of a given camera with the focal length that the stars have shown.

    Its distortion is in shares of the focal length: taken out with another one, two per cent off, the places
    at the edge of a wide field are off by half a pixel. Each round leaves of that a tenth or less.

    prior, seen_i : as of `lens.adjust`;  of_told : Camera as it was told, and its `xy_px` of `described`
    known : (k,) rows of the named detections of the Field `found`
    """
    camera, xy_px = of_told
    size_px = camera.width_px, camera.height_px
    for _ in range(ROUNDS if camera.distortion is not None else 0):
        camera = replace(camera, focal_length_px=best.lens.focal_px)
        xy_px = centred(camera, found.xy_px)
        best = lens.adjust(best.lens, prior, seen_i, xy_px[known], found.P_px[known], size_px)
    return best, replace(camera, focal_length_px=best.lens.focal_px), xy_px


def against(C_ci, velocity_i):
    """Attitude that sees the aberrated sky as C_ci (3, 3) sees the other, in the middle of the picture."""
    middle_i = C_ci[2:]
    moved_c = (aberrate(middle_i, velocity_i) - middle_i)[0] @ C_ci.T
    return dcm_from_rotvec(np.array([moved_c[1], -moved_c[0], 0.0])) @ C_ci  # by moved x z


def _fov_sigma(best, size_px, camera):
    """Standard deviation of the field of view across [deg], by differences over focal length and lens.

    camera : that was told, with the focal length found; None: the lens is that of `best`
    """
    sigma = np.sqrt(np.diag(best.covariance)[3:9])
    if camera is not None:  # nothing else of it is unknown
        found_px = best.lens.focal_px
        fovs = [
            _pointing(best.lens._replace(focal_px=one), size_px, replace(camera, focal_length_px=one))[3]
            for one in (found_px, found_px * (1.0 + STEP))
        ]
        return float(abs(fovs[1] - fovs[0]) / STEP * sigma[0])
    at, slope, before = best.lens, np.zeros(6), lens.across(best.lens, size_px)
    for n in np.flatnonzero(sigma > 0.0):
        step = 0.01 * sigma[n]
        k = tuple((np.array(at.k) + (np.arange(1, 6) == n) * step).tolist())
        moved = at._replace(focal_px=at.focal_px * float(np.exp(step if n == 0 else 0.0)), k=k)
        slope[n] = (lens.across(moved, size_px) - before) / step
    return float(np.degrees(np.sqrt(slope @ best.covariance[3:9, 3:9] @ slope)))


def all_stars(fit, found, xy_px, size_px, year):
    """Which star each detection is, faint ones included: row per detection, -1; and the stars.

    Among many faint detections and many faint stars, chance brings pairs together; those of the wrong
    brightness are left out. The zero point is that of the bright ones. A saturated star looks fainter than it
    is, and may be farther from where it is predicted, as only its blob is seen.
    """
    flux = found.flux
    sky = sky_of(fit.lens, max(2 * len(flux), MAX_DETECTIONS), size_px, year)
    predicted, _ = lens.project(fit.lens, sky.u_i, size_px)
    inside = np.flatnonzero(((predicted > -1.0) & (predicted < size_px)).all(axis=1))
    gate_px = max(steps.NOISE_GATE * fit.noise_px, steps.LEAST_GATE_PX)
    star = matched(predicted[inside], xy_px, gate_px)
    known = np.flatnonzero(star >= 0)
    star[known] = inside[star[known]]
    difference = -2.5 * np.log10(flux[known]) - sky.vmag[star[known]]
    full = found.saturated[known]
    whole = difference[~full] if (~full).sum() >= 4 else difference
    zero = np.median(whole[: max(len(whole) // 2, 4)])
    off = difference - zero
    star[known[(off < -BRIGHTNESS) | (off > np.where(full, SATURATED, BRIGHTNESS))]] = -1
    return star, sky


@kernel
def matched(seen_px, xy_px, gate_px):
    """Mutually nearest stars (m, 2) and detections (n, 2) within the gate: rows of the stars (n,), -1."""
    star = np.empty(xy_px.shape[0], dtype=np.int64)
    steps.match(seen_px, np.ones(seen_px.shape[0], dtype=np.bool_), xy_px, gate_px, star)
    return star


def _pointing(at, size_px, camera):
    """RA and Dec of the middle of the picture, position angle of up, fields of view: degrees."""
    xy_px = marks(size_px)
    if camera is not None:
        xy_px = centred(camera, xy_px)
    return angles(lens.rays(at, size_px, xy_px) @ at.axis_C_ci)
