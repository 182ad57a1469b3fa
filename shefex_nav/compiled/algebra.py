"""OpenBLAS's kernels, chosen once more where NumPy or SciPy had been imported before this package.

OpenBLAS chooses by the processor when it is loaded, or as `OPENBLAS_CORETYPE` says. A program that imports
NumPy first would compute other last digits than the command line, and thrusters that switch make another
flight of them (docs/decisions/0021). Where a library shows how it chooses, it is made to choose again, while
nothing of it runs; others stay as they are. A thread that multiplies matrices at the moment at which this
package is imported would be left without its kernels: import it before such threads start.
"""

import ctypes
import os
import re

LIBRARY = re.compile(r"lib\w*openblas\S*\.so")


def choose_again():
    """Let each loaded OpenBLAS choose by the environment as it is now. -> names of the kernels chosen"""
    chosen = []
    for path in _loaded():
        try:
            library = ctypes.CDLL(path)
        except OSError:  # gone, or no library
            continue
        if hasattr(library, "gotoblas_dynamic_quit") and hasattr(library, "gotoblas_dynamic_init"):
            library.gotoblas_dynamic_quit()
            library.gotoblas_dynamic_init()
            library.gotoblas_corename.restype = ctypes.c_char_p
            chosen.append(library.gotoblas_corename().decode())
    return chosen


def _loaded():
    """Paths of the libraries of OpenBLAS in this process: set of str; none where nothing tells."""
    try:
        with open("/proc/self/maps", encoding="utf-8", errors="replace") as file:
            paths = {line.split(maxsplit=5)[-1].rstrip("\n") for line in file if "openblas" in line}
    except OSError:  # no Linux
        return set()
    return {path for path in paths if LIBRARY.match(os.path.basename(path)) and os.path.isfile(path)}
