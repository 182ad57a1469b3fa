"""What `fuzz` knows of every kind of file."""

from pathlib import Path


class Kind:
    """One kind of file. folder : for what is made once and for the case"""

    longest_s = 10.0  # of the processor

    def __init__(self, folder):
        self.folder = Path(folder)

    def case(self, rng):
        """Write the file of a case."""
        raise NotImplementedError

    def read(self, rng):
        """Give it to the program."""
        raise NotImplementedError
