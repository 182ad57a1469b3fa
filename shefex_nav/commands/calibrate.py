"""`shefex-nav calibrate`: lens and detector of a star camera from its own pictures of the night sky.

Exit codes: 0 calibrated, 1 the pictures do not tell it (the message says why), 2 a file that cannot be read
or bad input.
"""

from math import atan, degrees
from os.path import realpath
from pathlib import Path

import typer

from shefex_nav.commands.options import Json, argument, bad, option
from shefex_nav.commands.output_files import check_file
from shefex_nav.commands.printing import counter, print_json, say, stdout
from shefex_nav.commands.solve import field_of_view, julian_year

Camera = option(
    str | None,
    "Camera file or scenario: what the pictures do not tell (pixel size, black level, gain of the "
    "amplifier), and a focal length right to 20 %.",
    metavar="FILE",
)

Fov = option(
    str | None,
    "Horizontal field of view of the pixels as stored, right to 20 %, e.g. '11.4 deg' (a number "
    "alone is degrees); 2 to 70 deg, not told 5 to 70.",
)
Epoch = option(
    str | None,
    "Date of all pictures, 2012-06-22, or Julian year, 2012.47; default the date of each picture, "
    "else that of the file of --camera; pictures without a date are refused.",
)


def calibrate(
    images: argument(
        list[Path],
        "Pictures of one camera, as its detector gives them: PNG, TIFF, FITS, JPEG; "
        "with --camera .raw and .bin.",
        metavar="IMAGE...",
    ),
    camera: Camera = None,
    fov: Fov = None,
    epoch: Epoch = None,
    output: option(Path | None, "Write the camera file; needs --camera.", metavar="FILE") = None,
    force: option(bool, "Overwrite the file given with --output.", "--force") = False,
    json: Json = False,
):
    """Calibrate a star camera: focal length, principal point, distortion, width of the spots, noise, hot
    pixels, each with its sigma.

    The pictures may look anywhere; ten in different directions and exposures tell more than a hundred alike.
    """
    _check(images, camera, fov, output)
    from shefex_nav.solve.calibration import calibrate as calibration
    from shefex_nav.solve.calibration import pictures

    year = None if epoch is None else _day(epoch)
    base, given = _given(camera, None if fov is None else field_of_view(fov), year)
    _check_output(output, force, images, base)
    seen = []
    with counter(len(images), lambda done, words: say(f"{done} of {len(images)}: {words}")) as count:
        for image in images:
            values, taken = pictures.read(image, given)
            if year is not None:
                taken = taken._replace(julian_year=year)
            seen.append(pictures.look(str(image), values, taken, given))
            calibration.check_together([one for one in seen if isinstance(one, pictures.Seen)])
            count(_words(seen[-1], given.fov_deg, "leave --fov out" if base is None else "correct --camera"))
    found = calibration.of_seen(seen, *(() if base is None else [_known(base)]))
    if isinstance(found, str):
        say(found)
        raise typer.Exit(1)
    _show(found, json)
    if output is not None:
        from shefex_nav.files import put
        from shefex_nav.frames import calibrated

        put(output, calibrated.written(found, base))
        say(f"wrote {output}")


def _day(epoch):
    """Julian year of an --epoch that tells a day."""
    from shefex_nav.solve.calibration.pictures import NO_DAY
    from shefex_nav.solve.header import says_day

    year = julian_year(epoch)
    if not says_day(year):
        words = f"{epoch} {NO_DAY}; expected a date such as 2012-06-22, or 2012.473"
        raise bad("--epoch", words)
    return year


def _check(images, camera, fov, output):
    """Refuse options that do not go together."""
    if camera is not None and fov is not None:
        raise bad("--fov", "not together with --camera, which says it")
    firsts = {}
    for one in images:
        first = firsts.setdefault(realpath(one), one)
        if first is not one:
            again = "" if first == one else f", as {first} and as {one}"
            raise bad("IMAGE...", f"{first} is given twice{again}")
    if output is not None and camera is None:
        words = "needs --camera: pixel size, black level and amplifier are not in pictures"
        raise bad("--output", words)


def _check_output(output, force, images, base):
    """Refuse an output that exists, or is one of the files that are read. base : camera_file.Base or None"""
    if output is not None:
        check_file(output, "--output", force=force, given=(*images, *base.files))


def _given(camera, fov_deg, year):
    """camera_file.Base or None, and pictures.Told."""
    from shefex_nav.solve.calibration.pictures import Told

    if camera is None:
        return None, Told(fov_deg, year)
    from shefex_nav.frames import calibrated, camera_file
    from shefex_nav.solve.image import FOV_DEG, NARROWEST_DEG

    base = camera_file.base(camera)
    hole = base.camera.params.camera.pinhole
    fov_deg = degrees(2.0 * atan(0.5 * hole.width_px / hole.focal_length_px))
    low, high = NARROWEST_DEG, FOV_DEG[1]
    if not low <= fov_deg <= high:
        words = f"{camera}: the field of view is {fov_deg:.3g} deg wide; expected {low:g} to {high:g} deg"
        raise bad("--camera", words)
    return base, calibrated.told(base, fov_deg, year)


def _known(base):
    from shefex_nav.frames import calibrated

    return calibrated.known(base)


def _words(one, fov_deg, without):
    """What is said of a picture that has been looked at. fov_deg, without : as of table.why"""
    from shefex_nav.solve.calibration.pictures import Unsolved
    from shefex_nav.solve.table import why

    if isinstance(one, Unsolved):
        return f"{one.name} is not solved and not used, {why(one, False, fov_deg, without=without)}"
    return f"{one.name}, {len(one.sights.u_i)} stars"


def _show(found, json):
    """Print a Calibration."""
    from shefex_nav.solve.calibration import table

    if json:
        print_json(table.as_numbers(found))
        return
    console = stdout(110, highlight=False)
    console.print(table.lens(found))
    console.print(table.detector(found))
    for one in found.unsolved:
        console.print(f"{one.name}: not solved, {one.reason}; not used")
