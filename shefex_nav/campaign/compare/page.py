"""A comparison to hand over: one HTML page with everything in it, made as that of a campaign is."""

from shefex_nav.campaign import page as campaign_page
from shefex_nav.campaign.compare import figures, parts
from shefex_nav.files import put
from shefex_nav.report import html
from shefex_nav.report.figures import style
from shefex_nav.report.html import element


def write(path, sides, found):
    """Write the page of sides and of the Comparisons with the first of them, in one piece."""
    put(path, page(sides, found))


def page(sides, found):
    """The page: str."""
    sections = [
        (f"part-{k}", part.title, campaign_page.content(part))
        for k, part in enumerate(parts.parts(sides, found))
    ]
    for k, one in enumerate(found):
        caption = (
            "Difference of each pair of runs of one seed, in the order of the seeds; coloured where the "
        )
        caption += "verdict is for one of the two."
        drawn = _picture(f"differences-{k}", figures.draw_differences(one), caption)
        sections.append((f"differences-{k}", f"Differences: {parts.title(one)}", drawn))
    caption = "Sizes of the error vectors of each run, and three times the root of the sum of the variances "
    caption += "that the filter gives for its axes."
    drawn = _picture("sigmas", figures.draw_sigmas(sides, found[0].seeds), caption)
    sections.append(("sigmas", "Errors over time", drawn))
    title = " and ".join(side.label for side in sides)
    return html.page(
        f"Comparison of {title}",
        header=[element("h1", f"Comparison of {title}")],
        sections=[section for section in sections if section[2]],
        footer=f"Runs of {', '.join(str(side.where) for side in sides)}, made by shefex_nav {_version()}.",
    )


def _version():
    from shefex_nav import __version__

    return __version__


def _picture(name, figure, caption):
    """List of the one picture; empty without one."""
    if figure is None:
        return []
    return [html.picture(style.svg(figure), name, caption, caption, figure.get_size_inches())]
