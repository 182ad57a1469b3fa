"""What was found in a picture: as an object for other programs, as tables for people."""

from math import isnan

from rich.table import Table

WHY = {
    "too_few_stars": "fewer than five point-like objects were found",
    "no_match": "the objects found fit no stars of the catalogue, for any field of view that was looked for",
    "ambiguous": "more than one identification of the stars fits",
    "mirrored": "the stars fit only when the picture is mirrored; undo the mirroring",
}
SHOWN = 25  # rows of the table of stars


def as_numbers(solution):
    """An ImageSolution as a dictionary for JSON; what is not known is None."""
    numbers = {name: getattr(solution, name) for name in ("status", "reason")}
    for name in ("ra_deg", "dec_deg", "roll_deg", "fov_x_deg", "fov_y_deg"):
        value = getattr(solution, name)
        numbers[name] = None if isnan(value) else value
    numbers["matched"] = [match._asdict() for match in solution.matched]
    numbers["false_probability"] = solution.false_probability
    numbers["wall_ms"] = solution.wall_ms
    return numbers


def field(solution, name):
    """rich Table of where a picture looks, by an ImageSolution; `name` is the picture's."""
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
    return table


def stars(solution):
    """rich Table of the brightest stars of an ImageSolution."""
    table = Table(title="brightest stars")
    for title in ("HIP", "V", "x [px]", "y [px]"):
        table.add_column(title, justify="right")
    for star in sorted(solution.matched, key=lambda star: star.vmag)[:SHOWN]:
        table.add_row(str(star.hip), f"{star.vmag:.2f}", f"{star.x_px:.2f}", f"{star.y_px:.2f}")
    return table
