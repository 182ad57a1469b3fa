"""Room for the truth of a long flight: files without a name beside its log.

The truth of a flight is there before its first tick, 226 bytes for each of 400 samples a second: 3.9 GB in
12 h. Large arrays lie in files that are mapped into memory. They are arrays like all others, and every second
of the mission what has been used of them gives its place in memory back to the system.
"""

import math
import mmap
import os
import tempfile
import weakref

import numpy as np

from shefex_nav.errors import UserError

LEAST = 1 << 28  # bytes of an array that lies in a file: of vectors at 400 Hz 7.8 h, of attitudes 5.8 h


class RoomError(UserError):
    """There is no room for the truth of a flight."""


class Room:
    """Where the arrays of a flight lie, `world.flight.record.Memory`.

    folder : of the files, which have no name and are gone with the arrays
    least : bytes of an array from which on it lies in a file
    """

    def __init__(self, folder, least=LEAST):
        self._folder, self._least, self._maps = folder, least, weakref.WeakSet()

    def empty(self, shape):
        """Array of floats, not written."""
        size = math.prod(shape) * np.dtype(float).itemsize
        if size < self._least:
            return np.empty(shape)
        memory = self._mapped(size)
        self._maps.add(memory)
        return np.frombuffer(memory).reshape(shape)

    def part(self, column):
        """As `Memory.part`, but no copy in a file: its other pages take no memory, and a copy takes disk."""
        whole = column if column.base is None else column.base
        return column if whole.nbytes >= self._least else column.copy()

    def release(self):
        """What has been written or read of the files need not be in memory any more."""
        if hasattr(mmap, "MADV_DONTNEED"):  # Windows decides by itself
            for one in self._maps:
                one.madvise(mmap.MADV_DONTNEED)

    def _mapped(self, size):
        """A file of `size` bytes, mapped; all of it is there at once, for want of a page ends a process."""
        try:
            with tempfile.TemporaryFile(dir=self._folder) as file:
                if hasattr(os, "posix_fallocate"):
                    os.posix_fallocate(file.fileno(), 0, size)
                else:
                    file.truncate(size)
                return mmap.mmap(file.fileno(), size)
        except OSError as error:
            words = f"no room for the truth of so long a flight, {size / 1e9:.1f} GB and more"
            raise RoomError(f"{self._folder}: {words}: {os.strerror(error.errno)}") from error
