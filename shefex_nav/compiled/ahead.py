"""Compiles missing kernels in several processes before they are needed.

`entries.json` lists the kernels that Python calls, with the types of their arguments and what a job must have
for each to be needed; `benchmarks/kernel_list.py` writes it from what missions used. A kernel that is not in
it, or not foreseen, is compiled when it is called.
"""

import hashlib
import inspect
import json
import os
import subprocess
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from numba import config

from shefex_nav import __version__, children
from shefex_nav.compiled import digest, numba_hooks, signature
from shefex_nav.compiled.numba_hooks import USES, Kernel
from shefex_nav.compiled.store import ENDING

ENTRIES = Path(__file__).with_name("entries.json")
COMPLETE = "complete"  # file of the store with the names of kernels of which none was missing
WORKER = "shefex_nav.compiled.worker"


class Entry(NamedTuple):
    """A kernel that Python calls."""

    kernel: str  # "module:name"
    signature: list  # types of arguments, by `signature.encode`
    needs: list  # of frozensets: a job that has all features of one of them needs it

    def is_needed(self, features):
        """Whether a job with these features, a set of str, needs it."""
        return any(needs <= features for needs in self.needs)


class CompilerFailed(RuntimeError):
    """Some kernels could not be compiled; the others have been. The message has a line for each fault."""


def entries():
    """All that are listed: list of Entry."""
    content = json.loads(ENTRIES.read_text(encoding="utf-8"))
    found = {}
    for group in content["groups"]:
        for kernel, types in group["kernels"]:
            found.setdefault((kernel, tuple(types)), []).append(frozenset(group["needs"]))
    return [
        Entry(kernel, [content["types"][k] for k in types], needs) for (kernel, types), needs in found.items()
    ]


def missing(features):
    """The listed kernels that a job needs and that have no file yet: list of Entry.

    To name the files takes as long as to load them. Where none was missing the names are kept; while neither
    sources nor settings have changed it is enough that the files are there. A mistake would only cost time:
    a kernel without its file is compiled when it is called.

    features : what the job has, set of str
    """
    store, kept_as = numba_hooks.store(), f"{COMPLETE}-{_sources(features)}"
    kept = store.load(kept_as)
    if kept is not None and all(map(store.path, kept.decode(errors="replace").split("\n"))):
        return []
    wanted, known = [one for one in entries() if one.is_needed(features)], {}
    files = [_file(one, known) for one in wanted]
    if None not in files and os.access(store.own, os.W_OK):
        names = {os.path.basename(path).removesuffix(ENDING) for path in files if path}
        store.save(kept_as, "\n".join(sorted(names)).encode())
    return [one for one, path in zip(wanted, files, strict=True) if path is None]


def _sources(features):
    """Digest of features, versions and settings, and of when each file of the program was written: str."""
    settings = [getattr(config, name) for name in numba_hooks.SETTINGS]
    parts = [__version__, *sorted(features), repr(settings)]
    for folder, folders, files in os.walk(Path(__file__).parents[1]):
        folders.sort()
        for name in sorted(files):
            if name.endswith((".py", ".json")):
                stat = os.stat(os.path.join(folder, name))
                parts.append(f"{folder} {name} {stat.st_mtime_ns} {stat.st_size}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:20]


def without_file(wanted):
    """Those of some kernels that are neither kept nor shipped: list of Entry."""
    known = {}
    return [one for one in wanted if _file(one, known) is None]


def _file(entry, known):
    """Path of the file of a kernel; None if it is missing, "" if it cannot be compiled ahead."""
    try:
        kernel = signature.find(entry.kernel)
        args = tuple(signature.decode(one) for one in entry.signature)
    except signature.UnknownType:
        return ""  # the program has another kernel now: it is compiled when it is called
    if not isinstance(kernel, Kernel) or len(args) != n_arguments(kernel):
        return ""
    return kernel.file_of(args, known)


def n_arguments(kernel):
    """Number of arguments of a kernel, those with defaults among them."""
    return len(inspect.signature(kernel.py_func).parameters)


def compile_all(wanted, processes, done=lambda kernel: None):
    """Compile kernels and put them into the store.

    wanted : list of Entry;  processes : how many at the most;  done : called with each kernel's name
    CompilerFailed, when all others are done, if a kernel could not be compiled or a process ended early.
    """
    finished, running, faults = SimpleQueue(), [], []
    try:
        for share in share_out(wanted, processes):
            running.append(_Process(share, finished))
        left = len(running)
        while left:
            news = finished.get()
            if news is None:
                left -= 1
                continue
            kernel, fault = news
            done(kernel)
            if fault:
                faults.append(f"{kernel}: {fault}")
    finally:
        faults += filter(None, [process.end() for process in running])
    if faults:
        raise CompilerFailed("\n".join(faults))


def works(wanted):
    """Work of compiling each kernel by itself, by the length of what it calls: list of (kernel, number)."""
    found = []
    for one in wanted:
        functions = digest.closure(signature.find(one.kernel))
        found.append((one.kernel, sum(map(digest.weight, functions))))
    return found


def share_out(wanted, processes):
    """Divide kernels among processes so that all end together: list of lists of Entry.

    Kernels that call the same functions go to the same process, which compiles these once.
    """
    known = {}
    calls = [set(digest.closure(signature.find(one.kernel), known)) for one in wanted]
    cost = [sum(map(digest.weight, functions)) for functions in calls]
    shares = [([], set()) for _ in range(min(processes, len(wanted)))]

    def total(k, share):
        return sum(map(digest.weight, share[1] | calls[k]))

    for k in sorted(range(len(wanted)), key=lambda k: (-cost[k], wanted[k].kernel)):
        least = min(shares, key=lambda share: total(k, share))
        least[0].append(wanted[k])
        least[1].update(calls[k])
    return [share for share, _ in shares]


class _Process:
    """A process that compiles some kernels; it ends with this one, for its standard input is closed then.

    finished : queue into which it puts (name, fault or "") of each kernel, and None at its end
    """

    def __init__(self, share, finished):
        command, environment = children.of_module(WORKER)
        environment.pop(USES, None)  # what is compiled ahead has not been used
        self._words = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._words,
            text=True,
            encoding="utf-8",
            env=environment,
            start_new_session=True,  # Ctrl-C is not for it
        )
        self._has_ended = False  # by itself
        self._reader = threading.Thread(target=self._read, args=(finished,), daemon=True)
        self._reader.start()
        with suppress(BrokenPipeError):  # it has ended already: its code tells
            self.process.stdin.write(json.dumps([[one.kernel, one.signature] for one in share]) + "\n")
            self.process.stdin.flush()

    def _read(self, finished):
        for line in self.process.stdout:
            finished.put(json.loads(line))
        self._has_ended = True
        finished.put(None)

    def end(self):
        """Stop it if it still works. -> what was wrong with its end, one line; "" if nothing was"""
        by_itself = self._has_ended
        if not by_itself:
            self.process.kill()
        self._reader.join()
        with suppress(BrokenPipeError):
            self.process.stdin.close()
        self.process.stdout.close()
        code = self.process.wait()
        self._words.seek(0)
        last = (self._words.read().strip().splitlines() or [""])[-1]
        self._words.close()
        if not by_itself or code == 0:
            return ""
        return f"a process that compiles kernels ended with code {code}{': ' if last else ''}{last}"
