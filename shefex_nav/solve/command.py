"""`shefex-nav solve`: attitude, field of view and stars of a picture of the night sky.

Exit codes: 0 done, also when the picture could not be solved (the result says why), 2 a file that cannot be
read or bad input.
"""

import json as json_module
import re
import sys
from math import isnan, pi
from pathlib import Path
from typing import Annotated

import typer

WHY = {
    "too_few_stars": "fewer than five point-like objects were found",
    "no_match": "the objects found fit no stars of the catalogue, for any field of view that was looked for",
    "ambiguous": "more than one identification of the stars fits",
    "mirrored": "the stars fit only when the picture is mirrored; undo the mirroring",
}
DEGREES = {"": 1.0, "deg": 1.0, "°": 1.0, "degrees": 1.0, "rad": 180.0 / pi, "arcmin": 1.0 / 60.0}
SHOWN = 25  # rows of the table of stars


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
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Find where a picture of the night sky looks, without being told anything."""
    fov_deg = None if fov is None else _field_of_view(fov)
    if epoch is not None and not 1900.0 < epoch < 2200.0:
        raise typer.BadParameter(
            f"expected a Julian year between 1900 and 2200, got {epoch}", param_hint="--epoch"
        )
    if overlay is not None:
        _writable(overlay)
    from shefex_nav.solve import picture

    seen = picture.read(image)
    from shefex_nav.solve.image import solve_picture

    solution = solve_picture(seen, fov_deg=fov_deg, epoch=epoch)
    if json:
        typer.echo(json_module.dumps(as_numbers(solution), allow_nan=False))
    else:
        _show(solution, image)
    if overlay is not None:
        from shefex_nav.solve import overlay as drawing

        drawing.draw(seen.grey, solution, overlay)
        typer.echo(f"wrote {overlay}", err=True)


def as_numbers(solution):
    """The result as a dictionary for JSON; what is not known is null."""
    numbers = {name: getattr(solution, name) for name in ("status", "reason")}
    for name in ("ra_deg", "dec_deg", "roll_deg", "fov_x_deg", "fov_y_deg"):
        value = getattr(solution, name)
        numbers[name] = None if isnan(value) else value
    numbers["matched"] = [match._asdict() for match in solution.matched]
    numbers["false_probability"] = solution.false_probability
    numbers["wall_ms"] = solution.wall_ms
    return numbers


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


def _writable(path):
    """Refuse a picture that could not be written or would overwrite a file, before anything is computed."""
    if path.suffix.lower() != ".png":
        raise typer.BadParameter(f"{path} has to end in .png", param_hint="--overlay")
    if path.exists():
        raise typer.BadParameter(f"{path} exists already; choose another name", param_hint="--overlay")
    if not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint="--overlay")


def _show(solution, name):
    """The result as people read it."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 100, highlight=False)
    if solution.status != "ok":
        console.print(f"{name}: not solved, {solution.reason}: {WHY[solution.reason]}", markup=False)
        console.print(f"{len(solution.xy_px)} objects, {solution.wall_ms:.0f} ms")
        return
    table = Table(title=str(name), show_header=False)
    rows = (
        ("right ascension", f"{solution.ra_deg:.4f} deg"),
        ("declination", f"{solution.dec_deg:+.4f} deg"),
        ("roll (up, from north through east)", f"{solution.roll_deg:.3f} deg"),
        ("field of view", f"{solution.fov_x_deg:.3f} x {solution.fov_y_deg:.3f} deg"),
        ("stars identified", f"{len(solution.matched)} of {len(solution.xy_px)} objects"),
        ("probability of chance, below", f"{max(solution.false_probability, 1e-99):.0e}"),
        ("time", f"{solution.wall_ms:.0f} ms"),
    )
    for row in rows:
        table.add_row(*row)
    console.print(table)
    stars = Table(title="brightest stars")
    for title in ("HIP", "V", "x [px]", "y [px]"):
        stars.add_column(title, justify="right")
    for star in sorted(solution.matched, key=lambda star: star.vmag)[:SHOWN]:
        stars.add_row(str(star.hip), f"{star.vmag:.2f}", f"{star.x_px:.2f}", f"{star.y_px:.2f}")
    console.print(stars)
