"""Monte Carlo campaigns: many runs of a scenario, each with draws and sensor seeds of its own.

The folder of a campaign
------------------------
campaign.json
    What is flown: the scenario's whole text and its digest, root seed, number of runs asked for,
    dispersions, versions; what the sessions took; whether it is judged at looks, and which numbers of runs
    were asked for before.
runs.sqlite
    The runs: record and series of each (`flight.Pilot.fly`), in one transaction; a run that is there is done.
    Why others were lost (`runs_file`).
flight.npz
    The one flight of all runs, if the campaign has `flight: shared`.
logs/000123.mcap
    Runs that were flown again with a log (`--keep`).
results.parquet
    One row a run, sorted by run (`table.row`); made of the records whenever a session ends.

Everything but what was measured with a clock depends on scenario, root seed and number of the run alone.

plan, draws, flight              what all runs have in common; what run k draws; one run
engine, cluster                  runs handed to workers
store, runs_file, table, checking      the folder; the file of the runs; one table of all; which values can be
results, statistics, over_time, sensitivity, convergence     what they mean
tolerance, looks, verdicts, until      which requirements the runs show, and when that is looked at
parts, tables, summary, page, figures    printed; one HTML page
repeating                        one run again
subset, rare, rare_events, rare_shown      how probable a rare event is: the algorithm; flights; what is told
characterise/                    the statistical star tracker, fitted to rendered runs and judged on others
"""

MOST_RUNS = 10_000_000  # that may be asked for: numbers and draws of all of them are kept in memory
