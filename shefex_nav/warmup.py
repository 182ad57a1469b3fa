"""Kernels that a job needs are compiled before it begins, in all processes that the machine has cores for."""

import json
import os
import sys
from contextlib import contextmanager
from itertools import count

from shefex_nav.errors import UserError
from shefex_nav.workers import cores

_told = []  # kernels that were compiled when they were called, in this process
_done = set()  # features of jobs for which this process is ready


def get_ready(features):
    """Compile what a job is going to need. A bar on stderr shows how far that is, if anything is missing.

    features : what the job has, str each, as in compiled/entries.json
    """
    from numba import config

    features = frozenset(features)
    if config.DISABLE_JIT or features in _done:
        return
    _done.add(features)
    from shefex_nav.compiled import ahead, numba_hooks

    _note(numba_hooks, features)
    if _say_late not in numba_hooks.begins_to_compile:
        numba_hooks.begins_to_compile.append(_say_late)
    try:
        compile_listed(ahead.missing(features))
    except ahead.CompilerFailed as error:  # such as a process that the system ended for want of memory
        first, *others = str(error).splitlines()
        more = f", and {len(others)} more" if others else ""
        print(
            f"not everything was compiled ahead ({first}{more}); that is compiled when called",
            file=sys.stderr,
        )


def compile_listed(wanted, workers=None):
    """Compile kernels, a list of ahead.Entry, with a bar on stderr. -> how many of them are kept now

    0 where other processes cannot compile for this one, which then does so when a kernel is called: an
    embedded Python cannot start them, and without a folder that can be written their work would be lost.
    ahead.CompilerFailed, when the others are done, if some cannot be compiled.
    """
    from shefex_nav.compiled import ahead, numba_hooks

    store = numba_hooks.store()
    if not wanted or not sys.executable or not store.is_writable():
        return 0
    _say_what_does_not_fit(store)
    try:
        with _bar(ahead.works(wanted)) as step:
            ahead.compile_all(wanted, workers or cores(), step)
    finally:
        store.prune()
    return len(wanted) - len(ahead.without_file(wanted))


def compile_for(jobs, workers=None):
    """Compile the kernels of some jobs, or of all that there are where no job is named.

    jobs : list of sets of features, as for `get_ready`
    -> how many kernels they need, how many of these have been compiled now

    UserError if some cannot be compiled, or are compiled and cannot be kept.
    """
    from shefex_nav.compiled import ahead

    wanted = [one for one in ahead.entries() if not jobs or any(map(one.is_needed, jobs))]
    missing = ahead.without_file(wanted)
    try:
        compiled = compile_listed(missing, workers)
    except ahead.CompilerFailed as error:
        raise UserError(f"some kernels could not be compiled:\n{error}") from error
    if compiled < len(missing):
        raise UserError(
            f"{len(missing) - compiled} kernels are missing and cannot be compiled ahead here, or not be kept"
        )
    return len(wanted), compiled


def _say_what_does_not_fit(store):
    """A line on stderr if compiled kernels are installed, but not those that are needed here."""
    from shefex_nav.compiled.store import shipped_kinds

    kinds = shipped_kinds()
    if kinds is not None and store.kind not in kinds:
        store.say_once(f"the installed shefex-nav-kernels are for {', '.join(kinds)}; here is {store.kind}")
    elif kinds is not None:
        store.say_once("the installed shefex-nav-kernels lack some that this needs: they are compiled")


@contextmanager
def _bar(works):
    """Function to be called with the name of each kernel that is done.

    works : work of each kernel, list of (name, number); the bar shows the work, the count the kernels
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console, total = Console(stderr=True), len(works)
    if not console.is_terminal:
        kernels = f"{total} kernels" if total > 1 else "a kernel"
        print(f"compiling {kernels} for this machine; later runs load what is compiled", file=sys.stderr)
        yield lambda _: None
        return
    left = {}
    for name, work in works:
        left.setdefault(name, []).append(work)
    counted = TextColumn("{task.fields[done]} of " + str(total)), TimeElapsedColumn()
    columns = TextColumn("compiling kernels; later runs load them"), BarColumn(), *counted
    with Progress(*columns, console=console, transient=True) as progress:
        task, done = progress.add_task("compile", total=sum(work for _, work in works), done=0), count(1)
        yield lambda name: progress.update(task, advance=left[name].pop(), done=next(done))


def _say_late(kernel, is_kept):
    """A line on stderr when the first kernel is compiled that was not foreseen, or one that is not kept."""
    if not is_kept:
        words = "its argument has a type without a name, so every process compiles it anew"
        print(f"compiling the kernel {kernel.__name__}: {words}", file=sys.stderr)
    elif not _told:
        from shefex_nav.compiled import numba_hooks

        later = "; later runs load them" if numba_hooks.store().is_writable() else ""
        print(f"compiling kernels that this needs for the first time{later}", file=sys.stderr)
    if is_kept:
        _told.append(kernel.__name__)


def uses_are_noted():
    """Whether a list of the kernels that jobs use is wanted, with those of every way to search a frame."""
    from shefex_nav.compiled import numba_hooks

    return numba_hooks.USES in os.environ


def _note(numba_hooks, features):
    """Append the features of a job to the file in which a list of what is used is wanted."""
    if path := os.environ.get(numba_hooks.USES):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps(sorted(features)) + "\n")
