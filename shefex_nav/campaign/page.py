"""The report of a campaign to hand over: one HTML page with everything in it, made as that of a run is."""

from shefex_nav.campaign import figures
from shefex_nav.campaign.parts import parts
from shefex_nav.campaign.tables import Bold, Command
from shefex_nav.files import put
from shefex_nav.report import html
from shefex_nav.report.figures import style
from shefex_nav.report.html import element

CAPTIONS = {
    "errors": "Errors over time: median and middle 95 % of the runs; 3 sigma as the filter reports it.",
    "nees": "Normalised squared errors and innovations over their degrees of freedom, mean of the runs. "
    "Grey: 95 % of such means at one instant, if the covariance is right.",
    "containment": "Share of the runs whose error lies inside 3 sigma. Grey: 99 % of such shares at one "
    "instant, if the covariance is right.",
    "ellipses": "Dispersion of the true flights, and the ellipse that holds the next run with 95 %.",
    "convergence": "Success rates and 95th percentiles of errors against the number of runs, 95 % intervals.",
    "sensitivity": "Regression of results on all draws: change in sigmas of the result per sigma of a draw, "
    "with 95 % intervals; coloured where the interval does not hold zero. |x|: distance from the median.",
}


def write(path, campaign, series):
    """Write the page of a Campaign in one piece. series : over_time.Series or None"""
    put(path, page(campaign, series))


def page(campaign, series):
    """The page: str."""
    first, *others = parts(campaign, series)
    sections = [("summary", "Summary", [_table(first)])]
    sections += [(f"part-{k}", part.title, content(part)) for k, part in enumerate(others)]
    drawn = figures.draw(campaign, series)
    sections.append(
        ("figures", "Figures", [style.picture(figure, name, CAPTIONS[name]) for name, figure in drawn])
    )
    sections.append(("scenario", "Scenario", [element("pre", campaign.head["source"])]))
    versions = ", ".join(f"{name} {version}" for name, version in campaign.head["versions"].items())
    return html.page(
        f"{first.title}: report of a campaign",
        header=[element("h1", f"Campaign {first.title}")],
        sections=sections,
        footer=f"Results of {campaign.folder}, digest {campaign.digest}. Flown with {versions}.",
    )


def content(part):
    """Table and lines of a Part."""
    content = [_table(part)] if part.rows else []
    return content + [
        element("pre", line) if isinstance(line, Command) else element("p", line) for line in part.lines
    ]


def _table(part):
    numbers = [k for k, name in enumerate(part.heads) if name.startswith(">")]
    rows = [[_cell(cell) for cell in row] for row in part.rows]
    return html.table("", [name.lstrip(">") for name in part.heads], rows, numbers)


def _cell(cell):
    return element("strong", cell) if isinstance(cell, Bold) else cell
