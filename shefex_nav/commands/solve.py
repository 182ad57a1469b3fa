"""`shefex-nav solve`: attitude, field of view and stars of pictures of the night sky.

Exit codes: 0 solved, 1 a picture could not be solved (the result says why), 2 a file that cannot be read (of
several the others are solved) or bad input.
"""

import re
from math import pi
from pathlib import Path

import typer

from shefex_nav.commands.options import Json, argument, bad, mission_time, number, option
from shefex_nav.commands.output_files import (
    check_apart,
    check_picture,
    check_place,
    check_writable,
    make_folder,
)
from shefex_nav.commands.printing import print_json, say, stdout
from shefex_nav.files import named
from shefex_nav.log.mcap_file import is_log

NAMED = "6-names"  # the last of the pictures of --stages
EXIT = {"ok": 0, "failed": 1, "refused": 2}  # by the status of a picture
NEAR_S = 0.1  # a frame that is farther from the time asked for is told
DEGREES = {"": 1.0, "deg": 1.0, "°": 1.0, "degrees": 1.0, "rad": 180.0 / pi, "arcmin": 1.0 / 60.0}


Camera = option(
    str | None,
    "Camera file (the export of frames writes one) or scenario. The star tracker on board "
    "then solves the pictures, with covariance. Pixels are taken as stored, whatever EXIF "
    "says.",
    metavar="FILE",
)

Fov = option(
    str | None,
    "Horizontal field of view to within 20 %, e.g. '11.4 deg' (a number alone is degrees), "
    "from 2 to 70 deg. Without it 5 to 70 deg are tried. For a picture that EXIF turns on its "
    "side, of either side.",
)
Mirrored = option(
    bool,
    "The pictures are mirrored, as through a telescope with a diagonal. So is a file whose "
    "first row is the lowest, unless its ROWORDER says so: the first row is read as the top "
    "one, in FITS too.",
    "--mirrored",
)
Stages = option(
    Path | None,
    "Draw every step of one picture into a folder, to see why it is not solved. For a frame "
    "of a log: objects, centroids, names by its star tracker.",
    metavar="DIR",
)
Epoch = option(
    str | None,
    "Date of the sky, 2012-06-22, or Julian year, 2012.47. Default: the date of the picture. "
    "Without one: with --camera that of its file, else today.",
)
FrameTime = option(
    str | None,
    "Solve the frame of a log that is nearest to this mission time, e.g. 240s.",
    metavar="TIME",
)


def solve(
    images: argument(
        list[Path],
        "Pictures of the night sky (PNG, JPEG, TIFF, FITS; with --camera also .raw and .bin), "
        "turned by their EXIF orientation. Or a log.",
        metavar="IMAGE...",
    ),
    camera: Camera = None,
    fov: Fov = None,
    epoch: Epoch = None,
    frame: FrameTime = None,
    overlay: option(Path | None, "Draw detections and names into a .png file.") = None,
    mirrored: Mirrored = False,
    stages: Stages = None,
    force: option(bool, "Overwrite the file given with --overlay.", "--force") = False,
    json: Json = False,
):
    """Find where pictures of the night sky look, without prior knowledge or with a known camera.

    Several pictures give one row each; with --json one object a line.
    A picture that cannot be read is reported in its row, and the others are solved.
    --frame solves a frame of a log with the camera of its scenario, and compares it with flight and truth.
    """
    _check(images, (camera, fov, frame, mirrored, stages), overlay, force)
    epoch = None if epoch is None else julian_year(epoch)
    if frame is not None or is_log(images[0]):
        raise typer.Exit(_frame_of_log(images, frame, (camera, fov, epoch), (overlay, stages), json))
    fov_deg = None if fov is None else field_of_view(fov)
    options = {"fov_deg": fov_deg, "epoch": epoch, "mirrored": mirrored}
    found = _each(images, _told(camera, epoch) if camera else _blind(options, stages), json)
    if not json:
        _show(found, told=camera is not None, fov_deg=fov_deg)
    if overlay is not None:
        _draw(images[0], found[0][1], camera, overlay)
    raise typer.Exit(max(EXIT[one.status] for _, one in found))


def _each(images, solve_one, json):
    """(path, ImageSolution or Refused) of every picture: list; with json each is printed when it is there."""
    from shefex_nav.solve import table
    from shefex_nav.solve.picture import PictureError

    found = []
    for image in images:
        try:
            one = solve_one(image)
        except PictureError as error:
            if len(images) == 1:
                raise
            one = table.refused(image, error)
        found.append((image, one))
        if json:
            print_json({"file": str(image)} | table.as_numbers(one))
    return found


def _draw(image, solution, camera, overlay):
    """Draw what was found, over the picture whose pixels the solution has."""
    from shefex_nav.solve import picture
    from shefex_nav.solve.stages import draw_overlay

    if camera is None:
        grey = picture.read(image).grey
    else:
        from shefex_nav.frames import camera_file
        from shefex_nav.solve.image import as_stored

        grey = picture.grey(as_stored(image, camera_file.read(camera))[0])
    draw_overlay(grey, solution, overlay)
    say(f"wrote {overlay}")


def _frame_of_log(logs, frame, of_pictures, drawn, json):
    """Solve a frame of a log -> exit code.

    of_pictures : values of the options that belong to pictures;  drawn : overlay, stages
    """
    overlay, stages = drawn
    log = logs[0]
    if frame is None:
        raise typer.BadParameter(f"{log} is a log; --frame 240s solves its frame of that time")
    if len(logs) > 1 or not is_log(log):
        raise bad("--frame", f"goes with one log, got {', '.join(map(str, logs))}")
    if any(value is not None for value in of_pictures):
        words = "not together with --camera, --fov or --epoch: the log says them"
        raise bad("--frame", words)
    t_s = mission_time(frame, "--frame", "240s")
    from shefex_nav.frames import of_log
    from shefex_nav.solve import table
    from shefex_nav.solve.image import Record
    from shefex_nav.solve.stages import draw_overlay

    record = Record()
    again = of_log.solve(log, t_s, record)
    if abs(again.t_s - t_s) > NEAR_S:
        say(f"{log}: the nearest frame that is kept whole is that of T{again.t_s:+.2f} s")
    if json:
        print_json({"file": str(log)} | table.as_numbers(again.solution) | table.again_as_numbers(again))
    else:
        name = f"{log}, frame {again.number}, T{again.t_s:+.2f} s"
        _show([(name, again.solution)], told=True)
        if again.solution.status == "ok":
            stdout(100).print(table.again(again))
    grey = again.image_dn.astype("f4")
    if stages is not None:
        from shefex_nav.solve import stages as steps

        _write_stages(grey, record, again.solution, stages, steps.OF_TRACKER)
    if overlay is not None:
        draw_overlay(grey, again.solution, overlay)
        say(f"wrote {overlay}")
    return 0 if again.solution.status == "ok" else 1


def _check(images, options, overlay, force):
    """Refuse options that are wrong, or do not go together. options : camera, fov, frame, mirrored, stages"""
    camera, fov, frame, mirrored, stages = options
    check_apart({"--stages": stages, "--overlay": overlay}, {"--stages": (".png",)})
    if stages is not None:
        _check_stages(stages, len(images), camera)
    if mirrored and (camera is not None or frame is not None):
        words = "not together with --camera or --frame: their pictures are as they are"
        raise bad("--mirrored", words)
    if fov is not None and camera is not None:
        raise bad("--fov", "not together with --camera, which says it")
    if overlay is not None:
        check_picture(overlay, "--overlay", force=force, endings=(".png",), given=images)
        if len(images) > 1:
            raise bad("--overlay", "is of one picture; give one")


def _check_stages(folder, n_images, told):
    """Refuse a folder for the steps where there are none to draw, or that has some."""
    from shefex_nav.solve.stages import NAMES

    if told is not None:
        raise bad("--stages", "not together with --camera")
    if n_images > 1:
        raise bad("--stages", "is of one picture; give one")
    make_folder(folder, "--stages")
    check_writable(folder, "--stages")
    for name in (*NAMES, NAMED):
        check_place(folder / f"{name}.png", "--stages", instead="choose another folder")


def _blind(options, stages):
    """Function of a path that gives its ImageSolution, of any camera. options : of `solve_picture`"""
    from shefex_nav.solve import picture
    from shefex_nav.solve.image import Record, solve_picture

    if stages is None:
        return lambda path: solve_picture(picture.read(path), **options)

    def draw(path):
        seen, record = picture.read(path), Record()
        found = solve_picture(seen, **options, record=record)
        grey = seen.grey[:, ::-1] if options["mirrored"] else seen.grey  # as it was solved
        _write_stages(grey, record, found, stages, shown=seen.grey)
        return found

    return draw


def _write_stages(grey, record, found, folder, steps=None, shown=None):
    """Draw the steps to an ImageSolution. steps : of `stages.draw`;  shown : of the names, if not grey"""
    from shefex_nav.solve import stages

    with named(folder):
        written = stages.draw(grey, record, found, folder, steps)
        if found.status == "ok":
            stages.draw_overlay(grey if shown is None else shown, found, folder / f"{NAMED}.png")
            written.append(f"{NAMED}.png")
    say(f"wrote {', '.join(written)} to {folder}")


def _told(camera, epoch):
    """The same of a camera that is told."""
    from shefex_nav.frames import camera_file
    from shefex_nav.solve.image import solve_image

    told = camera_file.read(camera)
    return lambda path: solve_image(path, camera=told, epoch=epoch)


def julian_year(text):
    """Julian year of a date such as 2012-06-22, or of a number that is one."""
    from shefex_nav.solve.header import FIRST_YEAR, LAST_YEAR, year_of_date

    try:
        year = number(text)
    except ValueError:
        try:
            return year_of_date(text)
        except ValueError as error:
            raise bad("--epoch", str(error)) from None
    if not FIRST_YEAR < year < LAST_YEAR:
        words = f"expected a year between {FIRST_YEAR} and {LAST_YEAR}, got {text!r}"
        raise bad("--epoch", words)
    return year


def field_of_view(text):
    """Degrees from an angle such as '11.4 deg' or '0.2 rad'; a plain number is degrees."""
    from shefex_nav.solve.image import FOV_DEG, NARROWEST_DEG

    low, high = NARROWEST_DEG, FOV_DEG[1]
    fov_deg = _degrees(text)
    if fov_deg is None:
        words = f"expected an angle such as '11.4 deg', or a number of degrees, got {text!r}"
        with_point = text.replace(",", ".")
        if _degrees(with_point) is not None:
            words += f"; decimals follow a point: '{with_point}'"
        raise bad("--fov", words)
    if not low <= fov_deg <= high:
        words = f"expected {low:g} to {high:g} deg, got {text!r}, which is {fov_deg:.3g} deg"
        raise bad("--fov", words)
    return fov_deg


def _degrees(text):
    """Degrees of an angle; None if the text is none."""
    parts = re.fullmatch(r"\s*([0-9]*\.?[0-9]+(?:e[-+]?[0-9]+)?)\s*([a-z°]*)\s*", text.lower())
    if parts is None or parts[2] not in DEGREES:
        return None
    return float(parts[1]) * DEGREES[parts[2]]


def _show(found, *, told, fov_deg=None):
    """The results as people read them. found : list of (path, ImageSolution)"""
    from shefex_nav.solve import table

    console = stdout(100, highlight=False)
    if len(found) > 1:
        console.print(table.brief(found))
        for words in table.notes(found, told):
            console.print(words, markup=False)
    for name, solution in found:
        if solution.status == "failed":
            console.print(f"{name}: not solved, {table.why(solution, told, fov_deg)}", markup=False)
            if len(found) == 1:
                console.print(f"{len(solution.xy_px)} objects, {table.duration(solution.wall_ms)}")
        elif len(found) == 1:
            console.print(table.field(solution, name, told=told))
            console.print(table.stars(solution))
