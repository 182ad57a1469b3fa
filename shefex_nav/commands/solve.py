"""`shefex-nav solve`: attitude, field of view and stars of a picture of the night sky.

Exit codes: 0 done, also when the picture could not be solved (the result says why), 2 a file that cannot be
read or bad input.
"""

import re
from math import pi
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands.options import Json
from shefex_nav.commands.output_files import check_picture
from shefex_nav.commands.printing import print_json, say, stdout

DEGREES = {"": 1.0, "deg": 1.0, "°": 1.0, "degrees": 1.0, "rad": 180.0 / pi, "arcmin": 1.0 / 60.0}


def solve(
    image: Annotated[Path, typer.Argument(help="Picture of the night sky: PNG, JPEG or TIFF, 8 or 16 bits.")],
    fov: Annotated[
        str | None, typer.Option(help="Horizontal field of view, right to 20 %, e.g. '11.4 deg'.")
    ] = None,
    epoch: Annotated[
        float | None,
        typer.Option(help="Julian year for proper motions; default EXIF date, else today. Pixels as stored."),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(help="Draw detections and names into a new .png file.")
    ] = None,
    json: Json = False,
):
    """Find where a picture of the night sky looks, without being told anything."""
    fov_deg = None if fov is None else _field_of_view(fov)
    if epoch is not None and not 1900.0 < epoch < 2200.0:
        raise typer.BadParameter(
            f"expected a Julian year between 1900 and 2200, got {epoch}", param_hint="--epoch"
        )
    if overlay is not None:
        check_picture(overlay, "--overlay", endings=(".png",))
    from shefex_nav.solve import picture

    seen = picture.read(image)
    from shefex_nav.solve import table
    from shefex_nav.solve.image import solve_picture

    solution = solve_picture(seen, fov_deg=fov_deg, epoch=epoch)
    if json:
        print_json(table.as_numbers(solution))
    else:
        _show(solution, image)
    if overlay is not None:
        from shefex_nav.solve import overlay as drawing

        drawing.draw(seen.grey, solution, overlay)
        say(f"wrote {overlay}")


def _field_of_view(text):
    """Degrees from an angle such as '11.4 deg' or '0.2 rad'; a plain number is degrees."""
    from shefex_nav.solve.image import FOV_DEG

    low, high = FOV_DEG
    parts = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*([a-z°]*)\s*", text.lower())
    if parts is None or parts[2] not in DEGREES:
        raise typer.BadParameter(f"expected an angle such as '11.4 deg', got {text!r}", param_hint="--fov")
    fov_deg = float(parts[1]) * DEGREES[parts[2]]
    if not low <= fov_deg <= high:
        raise typer.BadParameter(f"expected {low} to {high} deg, got {text!r}", param_hint="--fov")
    return fov_deg


def _show(solution, name):
    """The result as people read it."""
    from shefex_nav.solve import table

    console = stdout(100, highlight=False)
    if solution.status != "ok":
        why = f"{solution.reason}: {table.WHY[solution.reason]}"
        console.print(f"{name}: not solved, {why}", markup=False)
        console.print(f"{len(solution.xy_px)} objects, {solution.wall_ms:.0f} ms")
        return
    console.print(table.field(solution, name))
    console.print(table.stars(solution))
