"""What run k of a campaign draws, from the root seed and k alone.

Each drawn path has a stream of its own, SeedSequence(root, spawn_key=(k, stream of the path)), so that a
dispersion more changes no other draw; stream 0 gives the seed of the run's sensors.
"""

import numpy as np

from shefex_nav.campaign.plan import Job

SENSORS = 0  # stream of the seed of a run's sensors
SEED_BITS = 53  # of that seed: any reader of JSON keeps it whole


def sensor_seed(root, run):
    """Seed of all sensors of a run: int."""
    state = np.random.SeedSequence(root, spawn_key=(run, SENSORS)).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(64 - SEED_BITS))


def job(plan, run):
    """Job of run number `run`."""
    return Job(run, sensor_seed(plan.seed, run), {})
