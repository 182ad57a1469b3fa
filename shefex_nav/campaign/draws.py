"""What run k of a campaign draws, from scenario, root seed and k alone.

Each dispersed path has a stream of its own, SeedSequence(root, spawn_key=(k, stream of the path)), so that a
dispersion more changes no other draw; stream 0 gives the seed of the run's sensors. A probability u out of
the stream goes through the inverse of the distribution function, so a draw never takes a second number.

A Latin hypercube (McKay, Beckman, Conover, Technometrics 21, 1979) divides each distribution into N parts of
the same probability and draws one value from each, in random order: a draw then depends on N, too. Within a
correlated group the independent numbers are so stratified, not what they are mixed to, except the first
path's (Stein, Technometrics 29, 1987).
"""

import hashlib
from functools import partial

import numpy as np

from shefex_nav.campaign.plan import Job, writable
from shefex_nav.campaign.table import of_draw
from shefex_nav.errors import UserError

SENSORS = 0  # stream of the seed of a run's sensors
FLIGHT = 1  # of the seed of the one flight that all runs share, of run 0
SEED_BITS = 53  # of such a seed: any reader of JSON keeps it whole
LATIN = 2**32  # in place of the number of a run: the streams of the hypercube
UNIT = 2.0**-53


class Sampler:
    """Draws of a campaign, run by run."""

    def __init__(self, plan, dispersed):
        """plan: Plan; dispersed: list of disperse.Dispersed of its scenario."""
        self.plan, self.dispersed = plan, dispersed
        self._digest = plan.digest
        self._columns = None
        if plan.sampling == "latin_hypercube":
            self._columns = {one.name: _latin_column(plan, one.name) for one in dispersed}

    def job(self, run):
        """Job of run number `run`."""
        return Job(run, sensor_seed(self.plan.seed, run), self.draws(run), self._digest)

    def draws(self, run):
        """{path as written: value in the unit of the dispersion} of a run."""
        return drawn(self.dispersed, partial(self.probability, run), run)

    def probability(self, run, name):
        """Number between 0 and 1, both excluded, of a run and a path."""
        if self._columns is not None:
            return self._columns[name][run]
        return inside(generator(self.plan.seed, run, name).random())


def drawn(dispersed, probability, run):
    """{path as written: value in the unit of the dispersion}.

    dispersed : list of disperse.Dispersed
    probability : function of a path as written: a number between 0 and 1, both excluded
    run : number, by which a table is read
    """
    found = {}
    for one in dispersed:
        if one.group:
            found[one.name] = one.law.sigma * _mixed(one, probability)
        else:
            found[one.name] = one.law.draw(probability(one.name), run)
    return found


def _mixed(one, probability):
    """Standard normal number of a path of a group, correlated with the others."""
    from scipy.special import ndtri

    return float(
        sum(
            factor * ndtri(probability(name))
            for factor, name in zip(one.factors, one.group, strict=True)
            if factor
        )
    )


def stream(name):
    """Stream of a path: a number that depends on its name alone."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")


def generator(root, run, name):
    """Generator of the draws of a path in a run."""
    return np.random.default_rng(np.random.SeedSequence(root, spawn_key=(run, stream(name))))


def sensor_seed(root, run):
    """Seed of all sensors of a run: int."""
    return _seed(root, (run, SENSORS))


def flight_seed(root):
    """Seed of the one flight that all runs share: int."""
    return _seed(root, (0, FLIGHT))


def _seed(root, key):
    state = np.random.SeedSequence(root, spawn_key=key).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(64 - SEED_BITS))


def _latin_column(plan, name):
    """(N,) numbers of a path, one in each Nth part of the unit interval, in random order."""
    rng = generator(plan.seed, LATIN, name)
    return [inside(u) for u in ((rng.permutation(plan.runs) + rng.random(plan.runs)) / plan.runs).tolist()]


def inside(u):
    """A number off 0 and 1, where distribution functions have no inverse."""
    return min(max(u, UNIT), 1.0 - UNIT)


def dispersed_in(source, name):
    """disperse.Dispersed of a scenario, YAML text: list.

    Nothing of a scenario that cannot be read: a table is worth having without.
    """
    from shefex_nav.scenario import load

    try:
        return load.Pattern(source, name).dispersed
    except UserError:
        return []


def units_of(source, name):
    """{path as written: unit} of the dispersions of a scenario; '' without, 'times' of a factor."""
    return {one.name: one.measure for one in dispersed_in(source, name)}


def numeric(given):
    """Paths of the dispersions, list of Dispersed, that draw numbers whatever the run: list."""
    from shefex_nav.scenario import laws

    return [one.name for one in given if not isinstance(one.law, laws.ChoiceLaw | laws.TableLaw)]


def as_numbers(sampler, runs):
    """Seed and draws of each run, and units of those that have one: dict for JSON. Sampler, int"""
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
        scalars = dict(scalar for path, value in job.draws.items() for scalar in of_draw(path, value))
        yield [run, job.seed, *(scalars.get(name) for name in units)]


def _columns(dispersed):
    """Names of the columns that draws of a Dispersed come in, as in the table: several of a list."""
    return dict.fromkeys(
        name for value in dispersed.law.reach() for name, _ in of_draw(dispersed.name, value)
    )
