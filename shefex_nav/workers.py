"""Worker processes: how many, how they are started, and how they end when their parent does."""

import gc
import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait

from shefex_nav import children
from shefex_nav.ending import end_quickly, without_folders_of_astropy
from shefex_nav.stopping import deaf, handled, together


def cores():
    """Number of cores that this process may use: int."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def undisturbed():
    """Context in which a second Ctrl-C does not stop the tidying up."""
    return handled({signal.SIGINT: signal.SIG_IGN})


@contextmanager
def environment(variables):
    """Environment variables for processes that are started inside; afterwards they are as before."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def collected_afterwards():
    """Cycles of references are looked for once, at the end, and only among what has been made meanwhile.

    A mission makes a million small tuples and hardly a cycle. Left alone, Python would search all that it and
    the program keep again and again: a twentieth of the time of a mission without pictures.
    """
    was_on = gc.isenabled()
    gc.disable()
    gc.freeze()
    try:
        yield
    finally:
        gc.collect()
        gc.unfreeze()
        if was_on:
            gc.enable()


def bind_to_parent():
    """In a worker: leave Ctrl-C to the parent, and end when the parent is gone, however it ended."""
    deaf()
    children.begun()
    parent = multiprocessing.parent_process()

    def watch():
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class Pool:
    """Worker processes that can be stopped at once.

    Each is a new one (spawn): nothing of the parent leaks into it. It is started by the first call that finds
    no idle one, and ends with its parent.
    """

    def __init__(self, most, prepare=None, *arguments):
        """most : of them;  prepare : called with `arguments` in each, before anything else"""
        context = multiprocessing.get_context("spawn")
        try:
            with children.safe():  # a process that looks after the locks is started with them
                self._executor = ProcessPoolExecutor(most, context, _begin, (prepare, arguments))
        except OSError as error:  # the system says no file
            error.filename = error.filename or "/dev/shm, where processes share their locks"
            raise
        self.processes = set()  # that have been started

    def submit(self, function, *arguments):
        """Future of a call. BrokenExecutor if a worker has been killed before."""
        with together(), children.safe():
            before = set(multiprocessing.active_children())
            future = self._executor.submit(function, *arguments)
            self.processes |= set(multiprocessing.active_children()) - before
        return future

    def stop(self, *, at_once=False):
        """Start no more calls, wait for those that are under way and for the workers' end.

        at_once : end the workers, whatever they are doing
        """
        if at_once:
            for process in self.processes:
                process.terminate()
        self._executor.shutdown(wait=True, cancel_futures=True)

    def abandon(self):
        """Leave a pool whose worker has been killed: it ends by itself."""
        self._executor.shutdown(wait=False)


def each(function, calls, most):
    """Calls in as many workers; an interruption or a fault ends them at once.

    function : of a module;  calls : dict, key -> arguments;  most : of the workers

    Yields
    ------
    key, result : of each call as it is done
    """
    pool = Pool(most)
    try:
        futures = {pool.submit(function, *arguments): key for key, arguments in calls.items()}
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BaseException:
        with undisturbed():
            pool.stop(at_once=True)
        raise
    pool.stop()


def _begin(prepare, arguments):
    """First thing that a worker does. What it prints goes to stderr: standard output is for results."""
    with suppress(OSError):  # one of them is closed
        os.dup2(2, 1)
    bind_to_parent()
    end_quickly()
    without_folders_of_astropy()
    if prepare is not None:
        prepare(*arguments)
