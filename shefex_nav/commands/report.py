"""`shefex-nav report`: the results of a run, or of a campaign, also of one that is not finished."""

from pathlib import Path

from shefex_nav.commands.flights import say_if_cut, say_missing_plugins, show_campaign, show_run
from shefex_nav.commands.options import Json, argument, option
from shefex_nav.commands.output_files import (
    check_apart,
    check_file,
    check_pictures,
    make_folder,
    take_away_pictures,
)
from shefex_nav.commands.printing import print_json, say


def report(
    log: argument(Path, "Log of a run (MCAP), or folder of a campaign."),
    html: option(Path | None, "Write one page with every figure, to hand over.") = None,
    force: option(bool, "Overwrite the files of --html and --figures.", "--force") = False,
    figures: option(Path | None, "Folder for the figures, as PNG.") = None,
    json: Json = False,
):
    """Print the results of a run from its log, or of a campaign from its folder."""
    check_apart({"--html": html, "--figures": figures}, {"--figures": (".png",)})
    if html is not None:
        check_file(html, "--html", force=force, given=[log])
    if figures is not None:
        check_pictures(figures, _picture_names(log), "--figures", force=force)
    if log.is_dir():
        _of_campaign(log, html, figures, json)
    else:
        _of_run(log, html, figures, json)


def _picture_names(log):
    """Names of the pictures that a report may write: of a campaign's folder, or of a run's log."""
    if log.is_dir():
        from shefex_nav.campaign import figures

        return figures.NAMES
    from shefex_nav.report import figures

    return ["glance", *(entry.name for entry in figures.catalogue())]


def _say_written(figures, log, written):
    """Say which pictures have been written; others in their folder would be taken for those of this log."""
    take_away_pictures(figures, _picture_names(log), written)
    for path in written:
        say(f"wrote {path}")


def _glance(run):
    """The run in one Figure; None where its log keeps no pixels or no truth."""
    try:
        return run.glance()
    except LookupError:
        return None


def _of_run(log, html, figures, as_json):
    """The report of a run; html, figures : paths, or None of what is not wanted."""
    from shefex_nav.report import metrics
    from shefex_nav.runs import open_run

    run = open_run(log)
    data = run.data
    say_if_cut(log, data)
    say_missing_plugins(log, data.mission.plugins)
    if figures is not None:
        make_folder(figures, "--figures")
    glance = _glance(run) if html is not None or figures is not None else None
    if html is not None:
        from shefex_nav.report import page

        say("Drawing; the first page on a machine takes longer.")
        page.write(html, data, log, glance)
        say(f"wrote {html}")
    if figures is not None:
        from shefex_nav.report import figures as pictures

        _say_written(figures, log, pictures.save_all(data, figures, glance=glance))
    show_run(metrics.summarise(data, log=log), as_json, data)


def _of_campaign(folder, html, figures, as_json):
    """The report of a campaign's folder; one that is none is bad input. Arguments as of `_of_run`."""
    from shefex_nav.campaign import over_time, summary
    from shefex_nav.campaign.results import open_campaign

    campaign = open_campaign(folder)
    say_missing_plugins(folder, campaign.plugins)
    if figures is not None:
        make_folder(figures, "--figures")
    wanted = html is not None or figures is not None or not as_json
    series = over_time.read(campaign) if wanted else None
    if as_json:
        print_json(summary.summary_object(campaign))
    else:
        show_campaign(campaign, series)
    if html is not None:
        from shefex_nav.campaign import page

        page.write(html, campaign, series)
        say(f"wrote {html}")
    if figures is not None:
        from shefex_nav.campaign import figures as pictures

        _say_written(figures, folder, pictures.save_all(campaign, series, figures))
