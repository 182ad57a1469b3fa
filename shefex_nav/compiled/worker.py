"""A process that compiles kernels for another: their list comes by standard input, answers go back.

An answer is a line of JSON, [name, fault]; the fault is "" for a kernel that was compiled.
"""

import json
import os
import sys
import threading


def main():
    """Compile what the first line of standard input lists; end at once when standard input is closed."""
    answers = _own_output()
    wanted = json.loads(sys.stdin.readline())
    threading.Thread(target=_watch, daemon=True).start()
    for name, types in wanted:
        print(json.dumps([name, _fault(name, types)]), file=answers, flush=True)


def _own_output():
    """Standard output for the answers alone: what else is printed meanwhile goes to standard error.

    It is open until the process has ended: its end tells the other one that.
    """
    answers = open(os.dup(1), "w", encoding="utf-8", closefd=False)
    os.dup2(2, 1)
    return answers


def _fault(name, types):
    """Compile a kernel. -> "", or why that failed, in one line"""
    from shefex_nav.compiled import signature

    try:
        signature.find(name).compile(tuple(signature.decode(one) for one in types))
    except Exception as error:  # one kernel that cannot be compiled must not keep the others from it
        return f"{type(error).__name__}: {(str(error).strip().splitlines() or [''])[0]}"
    return ""


def _watch():
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    main()
