"""One start of the program for `start_up.py`: a command, and when it got how far.

    python benchmarks/start_up_worker.py MARKS BEGAN COMMAND...

MARKS : file for a list [[stage, processor seconds, wall seconds], ...], JSON
BEGAN : time.time() of the start
"""

import atexit
import sys
import time

MARKS, FILE, BEGAN, COMMAND = [], sys.argv[1], float(sys.argv[2]), sys.argv[3:]


def mark(stage):
    """The process has got so far."""
    MARKS.append((stage, time.process_time(), time.time() - BEGAN))


def marked(module, name, stage):
    """Let a function of a module mark when it is done."""
    function = getattr(module, name)

    def wrapped(*args, **more):
        result = function(*args, **more)
        mark(stage)
        return result

    setattr(module, name, wrapped)


def watch_the_flight(load):
    """Mark what a flight gets through; its modules are imported when the scenario has been read."""
    function = load.load

    def wrapped(*args, **more):
        scenario = function(*args, **more)
        mark("scenario checked")
        from shefex_nav import prepare, runs, simulate  # noqa: F401

        mark("flight imported")
        marked(prepare, "build_world", "world built")
        marked(prepare, "mission", "kernels loaded")
        route = simulate.route
        simulate.route = lambda *args, **more: ticks(route(*args, **more))
        return scenario

    load.load = wrapped


def ticks(records):
    """The same records; the first after the alignment is the first tick's. It counts of the last route."""
    for k, record in enumerate(records):
        if k == 1:
            MARKS[:] = [one for one in MARKS if one[0] != "first tick"]
            mark("first tick")
        yield record


def write():
    """Write the marks at the end of the process."""
    import json

    mark("end")
    with open(FILE, "w", encoding="utf-8") as file:
        json.dump(MARKS, file)


def main():
    """Carry out the command."""
    mark("interpreter")
    atexit.register(write)
    from shefex_nav.commands.app import main as command_line

    mark("command line")
    if COMMAND[0] in ("run", "check"):
        from shefex_nav.scenario import load

        mark("scenario's models")
        if COMMAND[0] == "run":
            watch_the_flight(load)
        else:
            marked(load, "load", "scenario checked")
    sys.argv = ["shefex-nav", *COMMAND]
    command_line()


if __name__ == "__main__":
    main()
