"""What was fitted, and how it was judged, as tables in a terminal."""

from shefex_nav.campaign.characterise.running import to_judge
from shefex_nav.report import columns


def parameters(content):
    """rich Table of what was fitted. content : of the file, as in running.Result"""
    parts = (content[part].items() for part in ("sightings", "identification"))
    rows = ((name, _shown(name, value)) for part in parts for name, value in part)
    return columns.table("Fitted", ("parameter", "value"), rows)


def tests(judged):
    """rich Table of a list of judge.Test."""
    heads = ("figure", ">value", ">1 sigma", ">limits", ">samples", "")
    return columns.table("On runs that were not fitted", heads, map(_row, judged))


def _row(test):
    limits = f"{test.low:g} ... {test.high:g}"
    return test.what, f"{test.value:.3f}", f"{test.error:.3f}", limits, str(test.samples), _verdict(test)


def _verdict(test):
    """What a test says, for people; nothing if it is inside."""
    if test.good:
        return ""
    if test.deciding is None:
        return test.verdict
    return f"{test.verdict}, --runs {to_judge(test.deciding)} would decide"


def _shown(name, value):
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
