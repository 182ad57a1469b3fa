"""Steps by which a sensor was believed against the filter: what of them is still open.

Nothing on board says whether the sensor or the filter was wrong, so each step stays open until it is taken
back. A receiver that is off by A and steps by B besides is still off by A when B is taken back; so the steps
are kept one by one, and what takes back all of them together ends them all.
"""

import numpy as np

BACK = 0.3  # [E] share of a step, to within which one back ends it


class Steps:
    """Memory, changed in place.

    kept : list of (d,) m or m/s, oldest first
    """

    def __init__(self):
        self.kept = []

    def __bool__(self):
        return bool(self.kept)

    @property
    def largest(self):
        """The most that the sensor or the filter is wrong by, m or m/s; 0 without a step."""
        if not self.kept:
            return 0.0
        return max(float(np.linalg.norm(one)) for one in (*self.kept, self._whole()))

    def is_back(self, z):
        """Whether an innovation (d,) takes a step back, or all of them."""
        return self._without(z) is not None

    def add(self, z):
        """A step (d,) that takes nothing back."""
        self.kept.append(z.copy())

    def take_back(self, z):
        """Forget what an innovation (d,) takes back. -> whether it does"""
        left = self._without(z)
        if left is None:
            return False
        self.kept = left
        return True

    def forget(self):
        """It is known who was wrong."""
        self.kept = []

    def _whole(self):
        """The sum of the steps of as many numbers as the last has."""
        return np.sum([one for one in self.kept if len(one) == len(self.kept[-1])], axis=0)

    def _without(self, z):
        """The steps that an innovation leaves: list, None if it takes none back."""
        if not self.kept:
            return None
        if is_back(self._whole(), z):
            return []
        for k in reversed(range(len(self.kept))):
            if is_back(self.kept[k], z):
                return self.kept[:k] + self.kept[k + 1 :]
        return None


def is_back(step, z):
    """Whether an innovation takes a step back. (d,), (d,) -> bool"""
    return len(step) == len(z) and bool(np.linalg.norm(step + z) < BACK * np.linalg.norm(step))
