"""What is told with a picture: keywords for a FITS header, and for the texts of a PNG.

Of these `solve` reads DATE-OBS, EXPTIME and VELX to VELZ alone (`solve/header.py`). Attitude and lens are the
true ones, for whoever wants to compare; so is what the keywords of the WCS say.
"""

import math
from datetime import UTC, datetime, timedelta

import numpy as np

from shefex_nav import __version__
from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.log.topics import epoch_ns, log_time_ns
from shefex_nav.solve import solution
from shefex_nav.solve.camera import pinhole_of, undistorted

MJD_1970 = 40587  # modified Julian date of 1970-01-01
SIP_ORDER, SIP_GRID = 5, 25


def utc(epoch_utc, t_s):
    """ISO 8601 text in UTC, to the microsecond, of a mission time [s]."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=round(_ns(epoch_utc, t_s) / 1000))
    return moment.replace(tzinfo=None).isoformat(timespec="microseconds")


def _ns(epoch_utc, t_s):
    """Nanoseconds since 1970 of a mission time [s]."""
    return int(log_time_ns(epoch_ns(epoch_utc), np.array([t_s]))[0])


def keywords(shot, mission, seed):
    """{keyword: (value, comment)} of a Shot.

    mission : scenario.Mission, whose name and epoch are told
    """
    frame, truth, v_i = shot.frame, shot.truth, shot.v_i
    return {
        "ORIGIN": (f"shefex_nav {__version__}", "rendered, no photograph"),
        "SCENARIO": (mission.name, ""),
        "SEED": (seed, "of all randomness"),
        "FRAME": (frame.number, "number of the frame"),
        "MISSTIME": (frame.t_valid_s, "[s] since lift-off, middle of the exposure"),
        "DATE-OBS": (utc(mission.epoch, frame.t_valid_s), "UTC, middle of the exposure"),
        "MJD-OBS": (MJD_1970 + _ns(mission.epoch, frame.t_valid_s) / 86400e9, "UTC, the same"),
        "EXPTIME": (frame.exposure_s, "[s] of every row"),
        "GAIN": (frame.gain_db, "[dB] of the amplifier"),
        "BITS": (frame.bits, "of a grey value, DN as read"),
        "LINETIME": (frame.line_s, "[s] from row to row; 0: global shutter"),
        **{
            f"VEL{axis}": (float(v), "[m/s] from Earth centre, ICRS")
            for axis, v in zip("XYZ", v_i, strict=True)
        },
        **{
            f"Q_{part}": (float(v), "true q_ic, camera to ICRS")
            for part, v in zip("WXYZ", truth.q_ic, strict=True)
        },
    }


def angles(q_ic, camera):
    """{keyword: (value, comment)} of where the middle of the picture of a solve.Camera points."""
    marks_px = solution.marks((camera.width_px, camera.height_px))
    seen = unit_vectors(pinhole_of(camera), undistorted(camera, marks_px)) @ dcm_from_quat(q_ic).T
    ra, dec, roll = solution.angles(seen)[:3]
    return {
        "RA": (ra, "[deg] true, of the middle of the picture"),
        "DEC": (dec, "[deg]"),
        "ROLL": (roll, "[deg] position angle of up, north through east"),
    }


def wcs(q_ic, camera):
    """{keyword: (value, comment)} of the tangential projection of a solve.Camera at an attitude.

    It is of directions as catalogues give them; the stars of the picture are displaced by aberration. A
    distortion is in the polynomials of `sip`.
    """
    C_ic = dcm_from_quat(q_ic)
    z = C_ic[:, 2]
    ra, dec = math.atan2(z[1], z[0]), math.asin(max(-1.0, min(1.0, z[2])))
    east = np.array([-math.sin(ra), math.cos(ra), 0.0])
    north = np.cross(z, east)
    CD = np.degrees(np.array([east, north]) @ C_ic[:, :2] / camera.focal_length_px)
    bent = "" if camera.distortion is None else "-SIP"
    cx, cy = camera.principal_point_px
    return {
        "CTYPE1": (f"RA---TAN{bent}", "of the camera as it is, without aberration"),
        "CTYPE2": (f"DEC--TAN{bent}", ""),
        "CUNIT1": ("deg", ""),
        "CUNIT2": ("deg", ""),
        "RADESYS": ("ICRS", ""),
        "CRPIX1": (cx + 1.0, "of the optical axis; the first pixel is 1"),
        "CRPIX2": (cy + 1.0, "rows as in the file, the first is the top"),
        "CRVAL1": (math.degrees(ra) % 360.0, "[deg]"),
        "CRVAL2": (math.degrees(dec), "[deg]"),
        **{f"CD{i + 1}_{j + 1}": (float(CD[i, j]), "[deg]") for i in range(2) for j in range(2)},
        **({} if camera.distortion is None else sip(camera)),
    }


def sip(camera):
    """{keyword: (value, comment)} of the polynomials from pixels to those of the pinhole, and their misfit.

    Shupe et al., ASP Conf. Ser. 347 (2005) 491: u, v from CRPIX become u + sum A_pq u^p v^q, v + sum B_pq
    u^p v^q. Fitted to SIP_GRID^2 places of the detector, in which the distortion is taken out exactly.
    """
    axis = [np.linspace(-0.5, n - 0.5, SIP_GRID) for n in (camera.width_px, camera.height_px)]
    seen_px = np.stack(np.meshgrid(*axis), axis=-1).reshape(-1, 2)
    scale = max(camera.width_px, camera.height_px)
    u, v = ((seen_px - camera.principal_point_px) / scale).T
    powers = [(p, n - p) for n in range(2, SIP_ORDER + 1) for p in range(n, -1, -1)]
    terms = np.column_stack([u**p * v**q for p, q in powers])
    more_px = undistorted(camera, seen_px) - seen_px
    found, *_ = np.linalg.lstsq(terms, more_px, rcond=None)
    worst_px = float(np.hypot(*(more_px - terms @ found).T).max())
    out = {"A_ORDER": (SIP_ORDER, f"distortion, to {worst_px:.1g} pixels"), "B_ORDER": (SIP_ORDER, "")}
    for k, name in enumerate("AB"):
        out |= {
            f"{name}_{p}_{q}": (float(found[n, k]) / scale ** (p + q), "") for n, (p, q) in enumerate(powers)
        }
    return out
