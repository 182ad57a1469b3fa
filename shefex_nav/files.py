"""Files that are whole or not there, also after a power failure."""

import errno
import hashlib
import json
import os
import stat
import zlib
from contextlib import contextmanager, suppress
from zipfile import BadZipFile

from shefex_nav.errors import UserError


def part(path):
    """Where the file `path` is written until it is whole: beside its place, on the same disk. -> Path"""
    return path.with_name(path.name + ".part")


def finish(path):
    """What has been written to `part(path)` is on the disk, and becomes `path`."""
    with open(part(path), "rb+") as file:
        os.fsync(file.fileno())  # before its name is: else a power failure may leave the name alone
    os.replace(part(path), path)


@contextmanager
def named(path):
    """An error of the disk within the `with` names `path`, if it names no file; most readers name none.

    One without a number is of a library and says what it says: a name would take its place.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None and error.errno is not None:
            error.filename = str(path)
        raise


@contextmanager
def whole(path):
    """Path to write to, which becomes `path` at the end of the `with`; nothing of it is left by a failure,
    which names `path`.
    """
    half = part(path)
    try:
        if half.is_symlink():  # what it leads to is not ours
            half.unlink()
        yield half
        finish(path)
    except OSError as error:
        if error.filename in (None, str(half), half):  # libraries do not say which file
            error.filename = str(path)
        raise
    finally:
        with suppress(OSError):  # of a file that could not even be made
            half.unlink(missing_ok=True)


def refuse_links(folder, names):
    """OSError of the first of these names in a folder that is a symbolic link: it may lead anywhere."""
    for name in names:
        if (folder / name).is_symlink():
            raise OSError(errno.ELOOP, f"{name} is a symbolic link there; remove it")


IRREGULAR = (
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISFIFO, "a pipe"),
)


class IrregularError(UserError, OSError):
    """A folder, a pipe, a device or a socket in the place of a file."""

    def __str__(self):
        return f"{self.filename}: {self.strerror}" if self.filename else super().__str__()


def opened(path):
    """A file of the user, opened to read its bytes; IrregularError of a pipe, a device or a socket.

    There a reader would wait for a writer that never comes, or read what has no end.
    """
    _refuse(path, os.stat(path))
    return open(path, "rb")


def content_of(path):
    """Bytes of a file of the user; IrregularError as of `opened`, and of a folder."""
    if os.path.isdir(path):
        raise IrregularError(errno.EISDIR, "is a folder, expected a file", str(path))
    with opened(path) as file:
        return file.read()


def text_of(path):
    """Text of a file of the user, in UTF-8; ValueError if it is none. The rest is as of `content_of`."""
    return content_of(path).decode()


def refuse_irregular(path):
    """IrregularError of a pipe, a device or a socket, for libraries that open a file by its name."""
    with suppress(FileNotFoundError):
        _refuse(path, os.stat(path))


def _refuse(path, found):
    if what := irregular(found):
        raise IrregularError(errno.EINVAL, f"is {what}, expected a file", str(path))


def irregular(found):
    """`a pipe`: what something is that is neither a file nor a folder, else ''. found : of os.stat"""
    return next((what for is_one, what in IRREGULAR if is_one(found.st_mode)), "")


def from_json(text):
    """What a JSON text holds, of a file that may be anybody's; ValueError if it is none that can be read."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("too many lists and objects within each other") from None


def unpacked(packed, largest):
    """Bytes of what zlib packed; ValueError, without unpacking it, if they are more than `largest`."""
    packer = zlib.decompressobj()
    content = packer.decompress(packed, largest)
    if not packer.eof:
        raise ValueError(f"is cut off, or has more than {largest} bytes unpacked")
    return content


def put(path, content):
    """Write bytes or text to a file. Its name is safe on the disk after `settle` of its folder."""
    with whole(path) as half:
        half.write_bytes(content.encode() if isinstance(content, str) else content)


LARGEST_ARRAYS = 1 << 30  # bytes unpacked; a thousandth of it, packed, may claim as many
UNREADABLE = OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile, zlib.error  # of `arrays`


def arrays(path, names=None):
    """Arrays of an .npz file: {name: array}, or those named alone; nothing in it is run."""
    with opened(path) as file:
        return arrays_of(file, names)


def arrays_of(file, names=None):
    """The same of an open file."""
    import numpy as np  # not for `--help`, whose commands load this file

    try:
        with np.load(file, allow_pickle=False) as archive:
            if sum(entry.file_size for entry in archive.zip.infolist()) > LARGEST_ARRAYS:
                raise ValueError(f"has more than {LARGEST_ARRAYS >> 30} GiB of arrays")
            return {name: archive[name] for name in names or archive.files}
    except MemoryError:  # of the size that an array says it has
        raise ValueError("has an array larger than the memory") from None


def put_arrays(path, content):
    """Write {name: array} as a compressed .npz file."""
    import numpy as np

    with whole(path) as half, half.open("wb") as file:
        np.savez_compressed(file, **content)


def digest(paths, root):
    """Fingerprint of files: their places below `root` and what is in them. -> 16 hexadecimal digits"""
    total = hashlib.sha256()
    for path in sorted(paths):
        total.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return total.hexdigest()[:16]


def settle(folder):
    """Bring the names of a folder to the disk."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows opens no folder, and keeps its names by itself
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def locked(file):
    """Whether this process may use the folder alone from now on; the lock goes when the process does."""
    try:
        import fcntl
    except ImportError:  # Windows has none
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
