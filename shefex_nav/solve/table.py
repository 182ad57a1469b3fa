"""What was found in a picture: as an object for other programs, as tables for people."""

from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table
from rich.text import Text

from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.solve.header import AS_STORED, date_of
from shefex_nav.solve.image import FOV_DEG
from shefex_nav.solve.names import PROPER_NAMES, designation_of, name_of
from shefex_nav.solve.solution import direction

ARCSEC = np.degrees(1.0) * 3600.0
WHY = {
    "too_few_stars": "fewer than five point-like objects were found",
    "too_few_stars_told": "fewer objects were found than an attitude needs",
    "no_match": "the objects found fit no stars of the catalogue, for any field of view {looked}; perhaps "
    "they are no stars; where a landscape hides stars among its lights, crop the picture to the sky or tell "
    "--camera",
    "no_match_told": "the objects found fit no stars of the catalogue with the camera that is told: is its "
    "focal length another, or its lens bent (distortion)? Without --camera both are found as well",
    "focal_length": "the stars contradict the focal length of the camera that is told, or its distortion: a "
    "lens that is bent and told as a pinhole looks like another focal length",
    "residuals": "the identified stars do not fit one attitude; are focal length and distortion of the "
    "camera right?",
    "rolling": "rows are exposed one after the other; without the rate of the camera there is no attitude",
    "saturated": "half of the picture or more is at the largest grey value: too bright, or exposed too long",
    "saturated_told": "the picture is too bright for the star tracker of the camera that is told",
    "smeared": "the spots are no points: the camera turned faster than star_tracker.highest_rate, or the "
    "picture was compressed or blurred",
    "ambiguous": "more than one identification of the stars fits",
    "mirrored": "the stars fit only when the picture is mirrored; --mirrored solves it so. A FITS file whose "
    "first row is the lowest looks mirrored, too: ROWORDER = 'BOTTOM-UP' in its header tells it",
    "mirrored_told": "the stars fit only when the picture is mirrored; undo the mirroring (of FITS whose "
    "first row is the lowest, by ROWORDER = 'BOTTOM-UP' in the header)",
    "not_mirrored": "the stars fit the picture as it is; it is not mirrored",
}
NO_FIT = "no_match", "mirrored"  # reasons that a wrong field of view may have
SHOWN = 25  # rows of the table of stars
SHOWN_NAMES = 3  # of pictures in a line


class Refused(NamedTuple):
    """One of several pictures that cannot be read, or is none of the camera."""

    reason: str  # in words
    status: str = "refused"


def refused(path, error):
    """Refused of a PictureError about the file at a path."""
    return Refused(str(error).removeprefix(f"{path}: "))


def as_numbers(solution):
    """An ImageSolution, or Refused, as a dictionary for JSON; what is not known is None.

    RA, Dec and roll are of the middle of the picture, `axis_ra_deg` and `axis_dec_deg` of the z of `q_ic`, of
    `sigma_arcsec` and of the covariances: the axis of the lens of a camera that is told, else the middle.
    """
    if isinstance(solution, Refused):
        return {"status": solution.status, "reason": solution.reason}
    numbers = {name: getattr(solution, name) for name in ("status", "reason")}
    for name in ("ra_deg", "dec_deg", "roll_deg", "fov_x_deg", "fov_y_deg"):
        value = getattr(solution, name)
        numbers[name] = None if isnan(value) else value
    numbers["matched"] = [
        match._asdict() | {"name": name_of(match.hip), "designation": designation_of(match.hip) or None}
        for match in solution.matched
    ]
    numbers["false_probability"] = solution.false_probability
    numbers["wall_ms"] = solution.wall_ms
    if solution.covariance is not None:
        x, y, z = sigmas(solution.covariance)
        numbers["axis_ra_deg"], numbers["axis_dec_deg"] = axis_of(solution)
        numbers["q_ic"] = (solution.q_ci * [1.0, -1.0, -1.0, -1.0]).tolist()
        numbers["sigma_arcsec"] = {"about_x": x, "about_y": y, "about_boresight": z}
        numbers["covariance_rad2"] = solution.covariance.tolist()
        if solution.noise_covariance is not None:
            numbers["noise_covariance_rad2"] = solution.noise_covariance.tolist()
        numbers["residual_px"] = solution.residual_px
        numbers["aberration_removed"] = solution.aberration_removed
        numbers["julian_year"] = solution.julian_year
        numbers["date_from"] = solution.date_from
    if solution.covariance is not None and solution.noise_covariance is None:  # no StarCamera was told
        numbers["camera"] = asdict(solution.camera)
        numbers["camera_q_ci"] = solution.camera_q_ci.tolist()
        numbers["camera_covariance_rad2"] = solution.camera_covariance.tolist()
    if solution.fov_sigma_deg is not None:
        numbers["fov_x_sigma_deg"] = solution.fov_sigma_deg
    if solution.mirrored:
        numbers["mirrored"] = True
    if solution.orientation != AS_STORED:
        numbers["exif_orientation"] = solution.orientation
        numbers["pixels"] = "as stored" if solution.as_stored else "as displayed"
    return numbers


def axis_of(solution):
    """Right ascension and declination of the axis of the lens of an ImageSolution: 2 floats [deg]."""
    return direction(dcm_from_quat(solution.q_ci)[2])


def sigmas(P):
    """Standard deviations of a covariance (3, 3) [rad^2] about the axes of the camera: 3 floats, arcsec."""
    return tuple((ARCSEC * np.sqrt(np.diag(P))).tolist())


def why(solution, told, fov_deg=None, *, without="leave --fov out"):
    """Words for a picture without solution.

    told : with a StarCamera;  fov_deg : that is told, or None;  without : what may help if it is wrong
    """
    text = WHY.get(f"{solution.reason}_told") if told else None
    low, high = FOV_DEG
    looked = f"from {low:g} to {high:g} deg across" if fov_deg is None else f"within 20 % of {fov_deg:g} deg"
    text = (text or WHY[solution.reason]).format(looked=looked)
    if fov_deg is not None and solution.reason in NO_FIT:
        text += f"; if the field of view that is told is wrong by more, {without}"
    return f"{solution.reason}: {text}"


OF_CAMERA = ", the date in the camera file: the picture says none"


def _accuracy(solution):
    """Rows of the table about the covariance."""
    if solution.covariance is None:
        return ()
    rows = [("1 sigma about x, y, boresight", _arcsec(solution.covariance))]
    if solution.noise_covariance is not None:
        rows.append(("of it noise of the picture", _arcsec(solution.noise_covariance)))
    if not solution.aberration_removed:
        rows.append(("aberration", "is in it, up to 20.5 arcsec: the day is not known"))
    elif solution.julian_year is not None:
        day = f"removed, as of {date_of(solution.julian_year):%Y-%m-%d}"
        rows.append(("aberration", f"{day}{OF_CAMERA if solution.date_from == 'camera' else ''}"))
    return (*rows, ("stars off the attitude", f"{solution.residual_px:.2f} px rms"))


def _turn(solution):
    """Row of the table about a picture that is displayed in another way than it is stored."""
    if solution.orientation == AS_STORED:
        return ()
    words = "not applied, pixels as stored" if solution.as_stored else "applied, pixels as displayed"
    return ((f"EXIF orientation {solution.orientation}", words),)


def duration(wall_ms):
    """Milliseconds, or seconds, for people."""
    return f"{wall_ms:.3g} ms" if wall_ms < 1000.0 else f"{1e-3 * wall_ms:.1f} s"


def _arcsec(P):
    """Standard deviations of a covariance as text."""
    return f"{', '.join(f'{sigma:.1f}' for sigma in sigmas(P))} arcsec"


def brief(found):
    """rich Table with a row for each picture. found : list of (name, ImageSolution)"""
    table = Table()
    # not of the roll, which is counted from north: near a pole an error of the axis turns it, too
    sigma = "sigma about x, y, boresight [arcsec]"
    for title in ("picture", "RA [deg]", "Dec [deg]", "roll [deg]", "stars", sigma):
        table.add_column(title, justify="left" if title == "picture" else "right", overflow="fold")
    names = [Path(name).name for name, _ in found]
    if len(set(names)) < len(names):
        names = [str(name) for name, _ in found]
    for name, (_, one) in zip(names, found, strict=True):
        if one.status == "refused":
            table.add_row(name, *["-"] * 4, Text(one.reason, justify="left"))
            continue
        if one.status != "ok":
            table.add_row(name, *["-"] * 3, str(len(one.matched)), f"not solved: {one.reason}")
            continue
        sigma = "" if one.covariance is None else ", ".join(f"{v:.1f}" for v in sigmas(one.covariance))
        angles = f"{one.ra_deg:.5f}", f"{one.dec_deg:+.5f}", f"{one.roll_deg:.4f}"
        table.add_row(name, *angles, str(len(one.matched)), sigma)
    return table


MIDDLE = (
    "the middle of the picture; the axis of the lens may be off it by a principal point that a narrow field "
    "does not tell (`calibrate` measures it, --camera tells it)"
)


def notes(found, told):
    """Lines below a table with a row for each picture. found : as of `brief`;  told : with a StarCamera"""
    solved = [(Path(name).name, one) for name, one in found if one.status == "ok"]
    if solved and told:
        yield f"RA, Dec and roll are of {AXIS}"
    elif any(one.covariance is not None for _, one in solved):
        yield f"attitudes are of {MIDDLE}"
    left = [name for name, one in solved if one.covariance is not None and not one.aberration_removed]
    if left:
        yield f"aberration, up to 20.5 arcsec, is left in{_of(left, solved)}: the day is not known"
    lent = [name for name, one in solved if one.aberration_removed and one.date_from == "camera"]
    if lent:
        year = next(one.julian_year for _, one in solved if one.date_from == "camera")
        yield f"aberration is removed as of {date_of(year):%Y-%m-%d}{OF_CAMERA}{_of(lent, solved)}"


def _of(names, solved):
    """Which of the pictures that are solved, if not all."""
    if len(names) == len(solved):
        return ""
    more = len(names) - SHOWN_NAMES
    return f" (of {', '.join(names[:SHOWN_NAMES])}{f' and {more} more' if more > 0 else ''})"


AXIS = (
    "the middle of the picture; sigma and, in --json, q_ic and covariances are of the axis of the lens "
    "(axis_ra_deg, axis_dec_deg)"
)


def field(solution, name, *, told=False):
    """rich Table of where a picture looks, by an ImageSolution.

    RA, Dec and roll are of the middle of the picture; the sigmas are of the axes of the camera, whose z is
    the axis of the lens: with a StarCamera the two may be apart by its principal point.

    name : of the picture;  told : with a StarCamera
    """
    table = Table(title=str(name), show_header=False)
    rows = (
        ("right ascension", f"{solution.ra_deg:.4f} deg"),
        ("declination", f"{solution.dec_deg:+.4f} deg"),
        ("roll (up, from north through east)", f"{solution.roll_deg:.3f} deg"),
        *_attitude_of(solution, told),
        *_accuracy(solution),
        *_turn(solution),
        ("field of view", f"{solution.fov_x_deg:.3f} x {solution.fov_y_deg:.3f} deg"),
        ("stars identified", f"{len(solution.matched)} of {len(solution.xy_px)} objects"),
        ("probability of chance, below", f"{max(solution.false_probability, 1e-99):.0e}"),
        ("time", duration(solution.wall_ms)),
    )
    for row in rows:
        table.add_row(*row)
    return table


def _attitude_of(solution, told):
    """Row of the table about which direction of the camera is meant."""
    if solution.covariance is None:
        return ()
    if not told:
        return (("attitude of", MIDDLE),)
    ra, dec = axis_of(solution)
    return (("attitude of", f"{AXIS}, here at {ra:.4f}, {dec:+.4f} deg"),)


def stars(solution):
    """rich Table of the brightest stars of an ImageSolution."""
    table = Table(title="brightest stars")
    # those of a star tracker are in the band of its catalogue, star_tracker.catalogue.system
    magnitude = "V" if solution.noise_covariance is None else "mag"
    for title in ("HIP", "name", "designation", magnitude, "x [px]", "y [px]"):
        table.add_column(title, justify="left" if title in ("name", "designation") else "right")
    for star in sorted(solution.matched, key=lambda star: star.vmag)[:SHOWN]:
        places = f"{star.x_px:.2f}", f"{star.y_px:.2f}"
        names = PROPER_NAMES.get(star.hip, ""), designation_of(star.hip)
        table.add_row(str(star.hip), *names, f"{star.vmag:.2f}", *places)
    return table


def again_as_numbers(found):
    """What is known besides of a frame of a log that was solved again: dict. frames.of_log.Again"""
    angles = {"from_flight_arcsec": found.from_flight, "from_truth_arcsec": found.from_truth}
    return {"frame": found.number, "t_s": found.t_s} | {
        name: None if angle is None else ARCSEC * angle for name, angle in angles.items()
    }


def again(found):
    """rich Table of how far a frame of a log, solved again, is from flight and truth. frames.of_log.Again"""
    table = Table(title="the attitude differs by", show_header=False)
    for words, angle in (("from that in flight", found.from_flight), ("from the truth", found.from_truth)):
        table.add_row(words, "-" if angle is None else f"{ARCSEC * angle:.1f} arcsec")
    return table
