"""What several commands say of flights: what is wrong with one, where its log ends, how well it went."""

from contextlib import contextmanager

from shefex_nav.commands.printing import print_json, say, stdout


@contextmanager
def about(scenario):
    """A flight that cannot be is told with the name of its scenario file."""
    from shefex_nav.world.flight.fly import FlightError

    try:
        yield
    except FlightError as error:
        raise FlightError(f"{scenario}: {error}") from None


def warn(scenario, warnings):
    """A line for each thing that a scenario gets wrong of its flight, with its place."""
    for one in warnings:
        say(f"warning: {scenario.line_about(one.field, one.text)}")


def tell_of_plugins(path, pins):
    """A line for each plug-in of a log or a campaign that cannot be loaded here, as its `plugins` say."""
    from shefex_nav import plugins

    for words in plugins.left_out(pins):
        say(f"{path}: without what a plug-in brought: {words}")


def tell_if_cut(log, data):
    """A line for the user of a log that was not closed, or whose mission was not flown or seen to its end."""
    if data.failure:
        first = data.failure.splitlines()[0]
        say(f"{log}: the flight failed, {first}; this is about what there is")
    elif data.ended_early:
        say(f"{log}: the run ended early, at T{data.last_t_s:+.2f} s; this is about what there is")
    elif data.until_s is not None:
        say(f"{log}: the mission was looked at until T{data.until_s:+.2f} s; this is about what there is")


def show_run(summary, as_json, data):
    """Print the summary of a RunData as one JSON object or, with what was required, as a table."""
    if as_json:
        print_json(summary)
        return
    from shefex_nav.report import configured, table

    stdout(100).print(table.summary_table(summary, configured.judged(data, summary)))


def show_campaign(campaign, series):
    """Print the tables of a campaign. results.Campaign, over_time.Series or None"""
    from shefex_nav.campaign.parts import parts
    from shefex_nav.campaign.tables import tables

    stdout(160, highlight=False).print(tables(parts(campaign, series)))
