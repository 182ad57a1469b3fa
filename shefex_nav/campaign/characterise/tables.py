"""What was fitted, and how it was judged, as tables in a terminal."""

from rich.table import Table


def parameters(content):
    """rich Table of what was fitted. content : of the file, as in running.Result"""
    table = Table("parameter", "value", title="Fitted", title_justify="left")
    for part in ("sightings", "identification"):
        for name, value in content[part].items():
            table.add_row(name, _words(name, value))
    return table


def tests(judged):
    """rich Table of a list of judge.Test."""
    table = Table(title="On runs that were not fitted", title_justify="left")
    for name in ("figure", "value", "+-", "limits", "samples", ""):
        table.add_column(name, justify="left" if name in ("figure", "") else "right")
    for test in judged:
        limits = f"{test.low:g} ... {test.high:g}"
        table.add_row(
            test.what, f"{test.value:.3f}", f"{test.error:.3f}", limits, str(test.samples), _verdict(test)
        )
    return table


def _verdict(test):
    """What a test says, for people; nothing if it is inside."""
    if test.good:
        return ""
    return test.verdict if test.deciding is None else f"{test.verdict}, {test.deciding} would decide"


def _words(name, value):
    """A fitted parameter for people."""
    if name == "table":
        return "\n".join(
            f"{stars:2d} stars: {100 * first:.4g} % of first, {100 * later:.4g} % of later frames, "
            f"{100 * wrong:.3g} % of them wrong"
            for stars, first, later, wrong in value
        )
    return (
        ", ".join(f"{item:g}" if isinstance(item, float) else str(item) for item in value)
        if isinstance(value, list)
        else str(value)
    )
