"""The files of compiled kernels: one a kernel and list of argument types, named by what it was made from.

Nothing in a file depends on the folder of the sources, and no file is ever changed: another kernel has
another name. So folders can be copied, shared by processes and checkouts, and shipped in a wheel.
"""

import hashlib
import os
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from importlib.util import find_spec

from shefex_nav.compiled import target

ENDING = ".kernel"
KEPT_DAYS = 30.0  # for which a file is kept that nobody loads
TOUCHED_DAYS = 1.0  # a file that is loaded is marked as used once in that time
BROKEN_OFF = ".lock", ".part"  # endings of what a process leaves that is killed
BROKEN_OFF_DAYS = 1.0
NEWEST = 4  # versions of one kernel that are kept, however old
SHIPPED = "shefex_nav_kernels"  # package that may bring compiled kernels
DAY_S = 86400.0


class Store:
    """Compiled kernels of one kind: processor, versions of Python and of the compiler.

    kind : name of the folder;  folder : of all kinds, None: the user's
    """

    def __init__(self, kind, folder=None):
        self.own = os.path.join(folder or target.cache_folder(), kind)
        self.kind = kind
        folder = shipped_folder()
        self.shipped = os.path.join(folder, kind) if folder else None
        self._told = set()

    def path(self, name):
        """Where a file stands: of this user, or shipped; None: nowhere."""
        paths = (os.path.join(folder, name + ENDING) for folder in (self.own, self.shipped) if folder)
        return next((path for path in paths if os.path.exists(path)), None)

    def load(self, name):
        """Content of a file: bytes; None if there is none, or if it is damaged."""
        path = self.path(name)
        if path is None:
            return None
        try:
            with open(path, "rb") as file:
                whole = file.read()
        except OSError as error:
            self.say_once(f"{path}: {error.strerror}; the kernel is compiled again")
            return None
        with suppress(OSError):  # somebody else's file, which may be read only
            if path.startswith(self.own) and time.time() - os.path.getmtime(path) > TOUCHED_DAYS * DAY_S:
                os.utime(path)
        if hashlib.sha256(whole[32:]).digest() != whole[:32]:
            self.say_once(f"{path} is damaged; the kernel is compiled again")
            return None
        return whole[32:]

    def save(self, name, content):
        """Write a file. Where that fails, one line on stderr says so. -> its path, None if it failed"""
        path = os.path.join(self.own, name + ENDING)
        try:
            os.makedirs(self.own, exist_ok=True)
            handle, part = tempfile.mkstemp(dir=self.own, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(hashlib.sha256(content).digest() + content)
                os.replace(part, path)
            except BaseException:
                with suppress(OSError):
                    os.unlink(part)
                raise
        except OSError as error:
            self._say_unwritable(error)
            return None
        return path

    def is_writable(self):
        """Whether files can be kept; where not, one line on stderr says so."""
        try:
            os.makedirs(self.own, exist_ok=True)
            tempfile.TemporaryFile(dir=self.own).close()
        except OSError as error:
            self._say_unwritable(error)
            return False
        return True

    def _say_unwritable(self, error):
        self.say_once(
            f"compiled kernels cannot be kept in {self.own} ({error.strerror}): "
            "every process compiles them again; set NUMBA_CACHE_DIR to a folder that can be written"
        )

    @contextmanager
    def alone(self, name):
        """Wait while another process compiles the same kernel, until it is done or has ended."""
        try:
            import fcntl

            os.makedirs(self.own, exist_ok=True)
            lock = open(os.path.join(self.own, name + ".lock"), "wb")
        except (ImportError, OSError):  # Windows; a folder that cannot be written: twice is no harm
            yield
            return
        with lock:
            with suppress(OSError):  # file systems without locks
                fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                yield
            finally:
                with suppress(OSError):
                    os.unlink(lock.name)

    def prune(self):
        """Delete what nobody has loaded for a month, but of each kernel the newest.

        What a process left that was killed goes after a day.
        """
        versions, now = {}, time.time()
        for path in _files(os.path.dirname(self.own)):
            with suppress(OSError):  # another process may have deleted it
                age_d = (now - os.path.getmtime(path)) / DAY_S
                if path.endswith(ENDING):
                    versions.setdefault(os.path.basename(path).rpartition("-")[0], []).append((age_d, path))
                elif path.endswith(BROKEN_OFF) and age_d > BROKEN_OFF_DAYS:
                    os.unlink(path)
        for files in versions.values():
            for age_d, path in sorted(files)[NEWEST:]:
                if age_d > KEPT_DAYS:
                    with suppress(OSError):
                        os.unlink(path)

    def say_once(self, line):
        """Say something on stderr, once in a process."""
        if line not in self._told:
            self._told.add(line)
            print(f"shefex_nav: {line}", file=sys.stderr)


def shipped_folder():
    """Folder of the kernels that come in a package of their own: str; "" if it is not installed."""
    spec = find_spec(SHIPPED)
    return spec.submodule_search_locations[0] if spec else ""


def shipped_kinds():
    """Kinds of kernels that the package brings: list of str; None if it is not installed."""
    folder = shipped_folder()
    return sorted(one.name for one in os.scandir(folder) if "numba" in one.name) if folder else None


def _files(folder):
    """Files of all kinds, and what earlier programs left: paths."""
    with suppress(OSError):
        for kind in os.scandir(folder):
            if kind.is_dir():
                yield from (one.path for one in os.scandir(kind.path))
