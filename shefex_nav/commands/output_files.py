"""Where commands may write: what would be lost or cannot be written is refused before anything is computed.

Each function takes the name of the option that the path was given with, which the message begins with.
"""

import errno
import os
import tempfile
from contextlib import contextmanager
from itertools import combinations

from shefex_nav import files
from shefex_nav.commands.options import bad

OF_CAMPAIGNS = ("campaign.json", "runs.sqlite", "flight.npz", "results.parquet")  # never overwritten
LOG = ".mcap"
OTHER_NAME, OR_FORCE = "choose another name", "choose another name or add --force"


@contextmanager
def not_made_meanwhile(path, option, instead):
    """Refuses a log that another process has made since it was checked, in the words of `check_place`."""
    from shefex_nav.log.topics import LogExists

    try:
        yield
    except LogExists:
        raise bad(option, f"{path} exists already; {instead}") from None


def is_same(one, other):
    """Whether two paths are one file or folder, by a link too; also of what is not there yet."""
    try:
        return os.path.samefile(one, other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def check_apart(outputs, folders=None):
    """Refuse outputs of one command that are one file or folder: the later would overwrite the first.

    outputs : {option: path, or None of what is not given}, of files and folders
    folders : {option of a folder: endings of what is written into it}: no other file has its place there
    """
    there = {option: path for option, path in outputs.items() if path is not None}
    for (first, one), (second, other) in combinations(there.items(), 2):
        if is_same(one, other):
            raise bad(second, f"{other} is that of {first} too; give each its own")
    for option, endings in (folders or {}).items():
        for other, path in there.items():
            inside = option in there and other != option and is_same(path.parent, there[option])
            if inside and path.suffix.lower() in endings:
                words = f"{path} is in the folder of {option}, whose files it may overwrite"
                raise bad(other, f"{words}; give it another place")


def check_file(path, option, *, force, given=()):
    """Refuse an output file that would be lost or cannot be written.

    given : paths of what is read, which nothing may overwrite
    """
    if any(is_same(path, one) for one in given):
        what = "the log itself" if path.suffix == ".mcap" else "a file that is read here"
        raise bad(option, f"{path} is {what}; {OTHER_NAME}")
    if path.is_dir():
        raise bad(option, f"{path} is a folder; give the name of a file")
    check_place(path, option, force=force, instead=OR_FORCE)


def check_place(path, option, *, force=False, instead=OTHER_NAME):
    """Refuse a file that is there already, or whose folder is not.

    instead : what to do in place of overwriting, in words
    """
    if path.exists() and path.name in OF_CAMPAIGNS:
        raise bad(option, f"{path} is a file of a campaign; {OTHER_NAME}")
    if path.exists() and not force:
        raise bad(option, f"{path} exists already; {instead}")
    if not path.parent.is_dir():
        raise bad(option, f"there is no folder {path.parent}")
    if path.exists():
        _check_overwritten(path, option)
    _check_length(path, option)
    check_writable(path.parent, option)


def _check_overwritten(path, option):
    """Refuse to write over what is there but cannot be written, or is no file."""
    if what := files.irregular(os.stat(path)):
        raise bad(option, f"{path} is {what}; give the name of a file")
    if path.suffix == LOG and not os.access(path, os.W_OK):  # others are written beside it first
        raise bad(option, f"{path} cannot be written; {OTHER_NAME}")


def _check_length(path, option):
    """Refuse a name that gets too long by the ending that it has until it is whole."""
    try:
        os.stat(path if path.suffix == LOG else files.part(path))
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise bad(option, f"{path} has a name that is too long") from None


def check_writable(folder, option):
    """Refuse a folder in which no file can be made, or that cannot be made; nothing of it is left."""
    there = folder
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise bad(option, f"{there} is a file; give the name of a folder")
    try:
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        words = f"cannot write into the folder {there}: {os.strerror(error.errno)}"
        raise bad(option, words) from None


def check_picture(path, option, *, force, endings=(".png", ".svg"), given=()):
    """Refuse a picture that has none of these endings, would be lost, or cannot be written.

    given : as of `check_file`
    """
    if path.suffix.lower() not in endings:
        raise bad(option, f"{path} has to end in {' or '.join(endings)}")
    check_file(path, option, force=force, given=given)


def check_pictures(folder, names, option, *, force):
    """Refuse a folder in which one of these pictures (PNG) would be overwritten, or cannot be written."""
    there = [name for name in names if (folder / f"{name}.png").exists()]
    if there and not force:
        more = f" and {len(there) - 1} more exist" if there[1:] else " exists"
        raise bad(option, f"{folder / there[0]}.png{more} already; choose another folder or add --force")
    check_writable(folder, option)


def take_away_pictures(folder, names, written):
    """Take away those of these pictures (PNG) that have not been written now: they are of something else."""
    for path in (folder / f"{name}.png" for name in names):
        if path not in written:
            path.unlink(missing_ok=True)


def check_folder(folder, names, option, *, force, given=()):
    """Refuse a folder in which one of these files would be overwritten, or cannot be written.

    given : as of `check_file`
    """
    if folder.exists() and not folder.is_dir():
        raise bad(option, f"{folder} is no folder")
    there = [name for name in names if (folder / name).exists()]
    if read := [name for name in there if any(is_same(folder / name, one) for one in given)]:
        words = f"{folder / read[0]} is a file that is read here; choose another folder"
        raise bad(option, words)
    if there and not force:
        words = f"{folder / there[0]} exists already; choose another folder or add --force"
        raise bad(option, words)
    check_writable(folder, option)


def make_folder(path, option):
    """Make a folder for results, if it is not there, or say why not."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise bad(option, f"cannot make the folder {path}: {error.strerror}") from None
