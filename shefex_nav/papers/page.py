"""The experiments as one HTML page: paper by paper, figure by figure, published and measured side by side.

It is made of what `reproduce` leaves in its folder: of each experiment the rows (JSON) and the figure (PNG).
"""

from pathlib import Path

from shefex_nav import __version__
from shefex_nav.errors import UserError
from shefex_nav.files import content_of, from_json, text_of
from shefex_nav.papers import registry
from shefex_nav.papers.table import number
from shefex_nav.papers.verdict import DIFFERS, Verdict
from shefex_nav.report import html

PAPERS = {  # folder -> name
    "shefex2": "SHEFEX: star tracker and hybrid navigation of SHEFEX-2 (2011)",
    "bright": "BRIGHT: identification with a brightness reference (2014)",
    "impa": "IMPA: rolling shutter and Improved Multi-Poles (2019)",
    "flown": "Their systems in flight, beside the default chain",
}
HEADS = ("quantity", "condition", "published", "measured", "95 % interval", "tolerance", "class", "why")
NUMBERS = (2, 3, 4, 5)
BAD = (*DIFFERS, Verdict.GOAL_MISSED)
GOOD = (Verdict.REPRODUCED, Verdict.BETTER, Verdict.GOAL_MET)
LEAD = (
    "Reproduced: the two differ by no more than the tolerance, the sampling error of both and the rounding "
    "of the paper. Better is no reproduction. Inputs were taken from the paper, calibrated figures were "
    "aimed at; neither says that anything was reproduced. A difference is explained where a run that is "
    "named, and has otherwise what is said beside it (one thing, or as many as are said), reaches the "
    "published figure. Where there are several such runs, the one that is used was chosen afterwards."
)
WANTED = {"experiment", "seed", "samples", "rows", "wall_s", "title", "unit"}
TEXTS, FIGURES = ("quantity", "condition", "why"), ("published", "measured", "tolerance")  # of a row
PNG = b"\x89PNG\r\n\x1a\n"  # how such a file begins


class FolderError(UserError, ValueError):
    """The folder holds nothing that a page can be made of; for the user."""


def read(folder):
    """What experiments have left in a folder: dict of name -> object of its JSON, as they are listed."""
    found = {}
    for name in registry.EXPERIMENTS:
        path = Path(folder) / f"{name}.json"
        if not path.exists():
            continue
        try:
            one = from_json(text_of(path))
            ours = one["version"] == __version__ and set(one) >= WANTED and all(map(_is_row, one["rows"]))
        except (OSError, ValueError, TypeError, KeyError):
            ours = False
        if not ours:
            raise FolderError(f"{path} is no result of this version; run 'reproduce {name}' again")
        figure = Path(folder) / f"{name}.png"
        if not (figure.is_file() and content_of(figure).startswith(PNG)):
            raise FolderError(f"the figure {name}.png is not beside {path}; run 'reproduce {name}' again")
        found[name] = one
    if not found:
        raise FolderError(f"no experiment has left its results in {folder}; 'reproduce all' does")
    return found


def _is_row(row):
    """Whether an object of JSON is a row of a table; KeyError, TypeError where it is something else."""
    ends = (None, None) if row["ci95"] is None else row["ci95"]
    numbers = [*(row[name] for name in FIGURES), *ends]
    return (
        row["verdict"] in list(Verdict)
        and len(ends) == 2
        and all(isinstance(row[name], str) for name in TEXTS)
        and all(one is None or isinstance(one, int | float) for one in numbers)
    )


def page(folder):
    """The page of a folder: str. FolderError for a folder without results."""
    found, sections = read(folder), []
    for paper, heading in PAPERS.items():
        names = [name for name in found if registry.EXPERIMENTS[name][0].split(".")[0] == paper]
        if names:
            content = [html.join(_experiment(name, found[name], Path(folder))) for name in names]
            sections.append((paper, heading, content))
    rows = [row for one in found.values() for row in one["rows"]]
    header = [
        html.element("h1", "Three papers, published and measured"),
        html.element("p", LEAD, class_="lead"),
        _counts({"all": rows} | {name: one["rows"] for name, one in found.items()}),
    ]
    footer = f"shefex_nav {__version__}, shefex-nav reproduce"
    return html.page("Three papers, published and measured", header=header, sections=sections, footer=footer)


def _counts(rows_of):
    """Table of rows per class."""
    lines = []
    for name, rows in rows_of.items():
        counts = [sum(row["verdict"] == verdict for row in rows) for verdict in Verdict]
        lines.append([name, *(str(count or "") for count in counts)])
    short = [verdict.replace("differs, ", "").replace("own ", "") for verdict in Verdict]
    heads = ("rows per class", *short)
    return html.table("", heads, lines, numbers=range(1, len(heads)))


def _experiment(name, one, folder):
    """Heading, figure and table of an experiment: list of Safe."""
    about = f"{one['samples']} {one['unit']}, seed {one['seed']}"
    png = content_of(folder / f"{name}.png")
    picture = html.picture(png, name, one["title"], about, size_inches=None, kind="png")
    lines = [_line(row) for row in one["rows"]]
    return [html.element("h3", f"{name}: {one['title']}"), picture, html.table("", HEADS, lines, NUMBERS)]


def _line(row):
    """Cells of a row."""
    ends, step = row["ci95"], None
    if ends is not None and None not in ends:
        step = ends[1] - ends[0]
    interval = "" if ends is None else " … ".join(number(end, step) for end in ends)
    tolerance = "" if row["tolerance"] is None else number(row["tolerance"], row["tolerance"])
    verdict = row["verdict"]
    look = "missed" if verdict in BAD else "met" if verdict in GOOD else "short"
    shown = "" if verdict == Verdict.NONE else html.element("span", verdict, class_=look)
    figures = (number(row["published"]), number(row["measured"], step), interval, tolerance)
    return [row["quantity"], row["condition"], *figures, shown, row["why"]]
