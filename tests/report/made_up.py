"""Runs of the made-up mission in memory, for the tests of figures, page and export."""

from functools import lru_cache

import synthetic_run

from shefex_nav.log.run_data import RunDataBuilder

MISSION = synthetic_run.mission()


@lru_cache(maxsize=2)
def gathered(options):
    """RunData of synthetic_run.Options."""
    return of_records(MISSION, [*synthetic_run.simulate(options), synthetic_run.summary(options)])


def of_records(mission, records):
    """RunData of some records."""
    builder = RunDataBuilder(mission)
    for record in records:
        builder.add(record)
    return builder.build()
