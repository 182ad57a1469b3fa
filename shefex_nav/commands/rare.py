"""`shefex-nav rare`: how probable a rare event of a flight is.

Exit codes: 0 done, also if the search ends before the event, 2 bad input, or a flight that cannot be.
"""

from pathlib import Path

from shefex_nav.commands.flights import about, warn_of_parts
from shefex_nav.commands.impact import Ground, height, place_of
from shefex_nav.commands.options import (
    DispersedScenario,
    Json,
    Overrides,
    RootSeed,
    Workers,
    option,
    quantity,
)
from shefex_nav.commands.output_files import check_folder, make_folder
from shefex_nav.commands.printing import counter, print_json, say, stdout
from shefex_nav.progress import lines

WORST = 3  # flights that are told, and written with --output
FILES = "rare.json", *(f"worst-{k + 1}.yaml" for k in range(WORST))
Of = option(
    str,
    "Such as 'apogee < 150 km', 'off > 60 km'; quantities: apogee, rail_exit_speed, "
    "dynamic_pressure, range, off, impact_speed. Alone, apogee means below requirements.apogee.",
    metavar="EVENT",
)
Body = option(str | None, "Whose landing; default: what flies last.", metavar="STAGE")
Place = option(str | None, "Where off counts from; default: the nominal impact.", metavar="LAT,LON")
Runs = option(int, "Flights of each level.", min=50, max=1_000_000)
Smallest = option(float, "Probability at which the search gives up.", min=1e-9, max=0.1)
WithoutFailed = option(bool, "Flights that fail count as flights without the event.", "--without-failed")
Folder = option(Path | None, "Folder for the result and the scenarios of the worst.", metavar="DIR")
Overwrite = option(bool, "Overwrite such files in it.", "--force")


def rare(
    scenario: DispersedScenario,
    of: Of,
    body: Body = None,
    place: Place = None,
    ground: Ground = None,
    runs: Runs = 500,
    smallest: Smallest = 1e-6,
    seed: RootSeed = 1,
    without_failed: WithoutFailed = False,
    output: Folder = None,
    force: Overwrite = False,
    workers: Workers = None,
    overrides: Overrides = None,
    json: Json = False,
):
    """Say how probable a rare event of a flight is, by subset simulation over the scenario's dispersions.

    Each level has a tenth of the probability of the one before, so that 1e-4 takes four levels, not a million
    flights. Flights are without sensors and filter.
    """
    if output is not None:
        check_folder(output, FILES, "--output", force=force, given=[scenario])
    counted = None if place is None else place_of(place, "--place")
    from shefex_nav.campaign import rare as study
    from shefex_nav.campaign import rare_events, rare_shown
    from shefex_nav.scenario import load

    loaded = load.load(scenario, tuple(overrides or ()))
    event = rare_events.parsed(of, loaded, lambda text, unit: quantity(text, unit, "--of", f"150 {unit}"))
    asked = study.Asked(
        runs, seed, smallest, workers, WORST, study.LEFT_OUT if without_failed else study.FAILED
    )
    warn_of_parts(scenario, tuple(overrides or ()))
    with about(scenario):
        problem, nominal = study.problem_of(loaded, event, asked, body, height(ground), counted)
    found = _studied(study, rare_shown, (problem, nominal, asked))
    if json:
        print_json(rare_shown.summary(found))
    else:
        stdout(130).print(rare_shown.table(found))
        for line in rare_shown.lines(found):
            stdout(130, highlight=False).print(f"  {line}")
        stdout(130).print(rare_shown.worst(found))
    if output is not None:
        _write(output, found, rare_shown.summary(found))


def _studied(study, shown, what):
    """rare.Found; how far it is is shown on stderr. what : Problem, nominal value, Asked"""
    problem, _, asked = what
    from shefex_nav.campaign import subset

    total, done, now = subset.most(asked.runs, asked.smallest), 0, "level 0"

    def tell(level):
        nonlocal now
        now = f"{shown.words(problem.event, problem.event.sign * level.threshold)}: {level.probability:.1e}"

    note = lines(total, say)
    with counter(total, note) as count:

        def flown():
            nonlocal done
            done += 1
            count(f"{done} flown, {now}")

        return study.study(*what, flown, tell)


def _write(folder, found, summary):
    """The result and the scenarios of the worst flights, in place of those of another study."""
    import json

    from shefex_nav.files import put

    make_folder(folder, "--output")
    put(folder / FILES[0], json.dumps(summary, allow_nan=False, indent=1) + "\n")
    for k, name in enumerate(FILES[1:]):
        if k < len(found.worst) and found.worst[k].source:
            put(folder / name, f"# fly it with --seed {found.worst[k].seed}\n{found.worst[k].source}")
        else:
            (folder / name).unlink(missing_ok=True)
    say(f"wrote {folder}")
