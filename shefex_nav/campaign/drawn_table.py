"""What each run of a campaign is going to draw, before anything is flown."""

from shefex_nav.campaign.plan import writable
from shefex_nav.campaign.table import of_draw


def as_numbers(sampler, runs):
    """Seed and draws of each run, and units of those that have one: dict for JSON. draws.Sampler, int"""
    jobs = [sampler.job(run) for run in range(runs)]
    return {
        "units": {one.name: one.measure for one in sampler.dispersed if one.measure},
        "runs": [{"run": job.run, "seed": job.seed, "draws": writable(job.draws)} for job in jobs],
    }


def rows(sampler, runs):
    """The same as rows of a table, the heads with their units first; a scalar of a draw has a column."""
    units = {name: one.measure for one in sampler.dispersed for name in _columns(one)}
    yield ["run", "seed", *(f"{name} [{unit}]" if unit else name for name, unit in units.items())]
    for run in range(runs):
        job = sampler.job(run)
        drawn = dict(scalar for path, value in job.draws.items() for scalar in of_draw(path, value))
        yield [run, job.seed, *(drawn.get(name) for name in units)]


def _columns(dispersed):
    """Names of the columns that draws of a Dispersed come in, as in the table: several of a list."""
    return dict.fromkeys(
        name for value in dispersed.law.reach() for name, _ in of_draw(dispersed.name, value)
    )
