"""A lane of a campaign that flies in this process, whose kernels are loaded, not in one of its own."""

from concurrent.futures import Future

from shefex_nav.campaign.flight import Pilot


class HereLane:
    """Flies in this process, at once; what a run raises is in its future, as from a worker."""

    capacity = 1

    def __init__(self, plan, before=lambda job: None):
        self._pilot, self._before = Pilot(plan), before
        self.renewed = 0

    def submit(self, job):
        """Future that is done."""
        future = Future()
        try:
            self._before(job)
            future.set_result(self._pilot.fly(job))
        except Exception as error:
            future.set_exception(error)
        return future

    def renew(self):
        self.renewed += 1

    def stop(self, at_once=False):
        """Nothing is left running."""
