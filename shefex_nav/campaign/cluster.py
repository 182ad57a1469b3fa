"""Workers of a Dask cluster that is already there; needs the extra `cluster`.

    dask scheduler --host 127.0.0.1 --port 8786
    dask worker tcp://127.0.0.1:8786 --nthreads 1      (as many as wanted, on any machine that reaches it)
    shefex-nav campaign SCENARIO --runs 1000 --engine dask://127.0.0.1:8786

Workers need this package with its extra, and the very same versions of Python and of what results depend on
(`plan.versions`); no common disk, but files of plug-ins where the scenario names them, to run which the
consent of the one who asks is enough. A worker that joins later, or that its nanny starts again, is told what
to fly too, and several campaigns may use one scheduler. Runs of a worker that is killed are flown by another,
which is the scheduler's doing; after so many deaths as it allows (`allowed-failures`) it is the engine's.
"""

import logging
import time
import uuid

from distributed import Client
from distributed.diagnostics.plugin import WorkerPlugin

from shefex_nav import plugins
from shefex_nav.campaign import flight
from shefex_nav.campaign.engine import EngineError
from shefex_nav.scenario import plugged

CONNECT_S = 20.0
AHEAD = 2  # runs that a worker has: the one that it flies and the next
LOOK_S = 2.0  # between two looks at how many workers there are
TALKATIVE = "distributed", "distributed.client", "tornado.application"  # of a scheduler that is gone


class Briefing(WorkerPlugin):
    """Tells a worker what to fly, as long as the campaign is there."""

    def __init__(self, plan):
        self.plan, self.digest = plan, plan.digest
        pins = plugged.pinned_in(plan.source, plan.name)
        self.trusted = [sha256 for _, sha256 in pins if plugins.is_trusted(sha256)]  # by who asks
        self.name = f"shefex_nav campaign {uuid.uuid4()}"  # one of the same name would replace another's

    def setup(self, worker):
        """Before the first run of a worker."""
        for sha256 in self.trusted:
            plugins.consent_here(sha256)
        flight.prepare_worker(self.plan, worker.state.nthreads)

    def teardown(self, worker):
        """After the last run, unless another session flies the same plan."""
        others = (one for one in worker.plugins.values() if isinstance(one, Briefing))
        if all(one.digest != self.digest for one in others):
            flight.dismiss(self.plan)


class ClusterLane:
    """All workers of a scheduler."""

    def __init__(self, address, plan):
        """address: HOST:PORT of the scheduler."""
        self._address, self._client, self._briefing = address, None, Briefing(plan)
        for name in TALKATIVE:  # what matters is an EngineError
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(f"tcp://{address}", timeout=CONNECT_S, set_as_default=False)
            self._client.wait_for_workers(1, timeout=CONNECT_S)
            self._client.register_plugin(self._briefing)
        except (OSError, TimeoutError, ValueError) as error:
            if self._client is not None:
                self._client.close()
            words = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise EngineError(f"dask://{address}: no scheduler with a worker answers: {words}") from None
        self._executor = self._client.get_executor(pure=False)
        self._looked_at, self._slots = -LOOK_S, 1

    @property
    def capacity(self):
        """How many runs it may have at a time."""
        if time.monotonic() - self._looked_at >= LOOK_S:
            self._looked_at, self._slots = time.monotonic(), self.slots()
        return AHEAD * max(self._slots, 1)

    def slots(self):
        """How many runs its workers fly at a time."""
        try:
            return sum(self._client.nthreads().values())
        except (OSError, TimeoutError, RuntimeError) as error:
            raise self._gone(error) from None

    def submit(self, job):
        """Future of a run."""
        try:
            return self._executor.submit(flight.fly, job)
        except (OSError, RuntimeError) as error:
            raise self._gone(error) from None

    def renew(self):
        """After the death of a worker: the scheduler has taken note."""

    def stop(self, at_once=False):
        """Let the cluster go; at once: what it has not flown yet is given up."""
        self._executor.shutdown(wait=not at_once)  # which cancels what is left if it does not wait
        try:
            self._client.unregister_worker_plugin(self._briefing.name)
        except (OSError, TimeoutError, RuntimeError, ValueError):
            pass  # the scheduler is gone, and with it what it told its workers
        self._client.close()

    def _gone(self, error):
        words = str(error).splitlines()[0] if str(error) else type(error).__name__
        return EngineError(f"dask://{self._address}: the scheduler does not answer any more: {words}")
