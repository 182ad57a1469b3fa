"""`shefex-nav campaign --sweep`: a campaign for each combination of some settings, compared in pairs."""

from pathlib import Path

from shefex_nav.campaign.compare import summary, sweep
from shefex_nav.commands.compare import fly
from shefex_nav.commands.printing import print_json, stdout

OUT = Path("logs/campaigns")


def sweep_all(how, given, as_json):
    """Fly what is missing and print what came of it. -> exit code, as of a campaign

    how : flying.How;  given : list of KEY=A,B,C
    """
    axes = [sweep.axis(text) for text in given]
    out = how.out or OUT / f"{Path(how.scenario).stem}-seed{how.seed}-sweep"
    flights, settings = zip(*sweep.planned(how.scenario, axes, how.overrides, out), strict=True)
    lost = fly(flights, how)
    every, found = sweep.compared(flights)
    if as_json:
        print_json(summary.summary(every, found) | {"combinations": sweep.result(every, settings)})
    else:
        from shefex_nav.campaign import tables

        stdout(160, highlight=False).print(tables.tables(sweep.tables(every, found, settings)))
    failed = any(one.failed for side in every for one in side.runs.values())
    return 1 if lost or failed else 0
