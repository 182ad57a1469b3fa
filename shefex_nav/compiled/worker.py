"""A process that compiles kernels for another: their list comes by standard input, their names go back."""

import json
import os
import sys
import threading


def main():
    """Compile what the first line of standard input lists; end at once when standard input is closed."""
    wanted = json.loads(sys.stdin.readline())
    threading.Thread(target=_watch, daemon=True).start()
    from shefex_nav.compiled import signature

    for name, types in wanted:
        signature.find(name).compile(tuple(signature.decode(one) for one in types))
        print(name, flush=True)


def _watch():
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    main()
