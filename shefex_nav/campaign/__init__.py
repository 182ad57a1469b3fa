"""Monte Carlo campaigns: many runs of a scenario, each with draws and sensor seeds of its own.

The folder of a campaign
------------------------
campaign.json
    What is flown: the scenario's whole text and its digest, root seed, number of runs asked for,
    dispersions, versions; what the sessions took; whether it is judged at looks, and which numbers of runs
    were asked for before.
runs/000123.json, runs/000123.npz
    One run: its record and its series (`flight.Pilot.fly`). Each is written whole or not at all, the record
    last: a run whose record is there is done.
flight.npz
    The one flight of all runs, if the campaign has `flight: shared`.
logs/000123.mcap
    Runs that were flown again with a log (`--keep`).
results.parquet
    One row a run, sorted by run (`table.row`).

Everything but what was measured with a clock depends on scenario, root seed and number of the run alone.

plan, draws, flight              what all runs have in common; what run k draws; one run
engine, cluster, store, table    runs handed to workers; one file a run; one table
results, statistics, over_time, sensitivity, convergence     what they mean
tolerance, looks, verdicts, until      which requirements the runs show, and when that is looked at
parts, verdict_rows, summary, page, figures    printed; one HTML page
repeating                        one run again
characterise/                    the statistical star tracker, fitted to rendered runs and judged on others
"""
