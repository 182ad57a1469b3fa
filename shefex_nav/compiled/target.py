"""The processor for which kernels are compiled, and where they are kept.

A kernel compiled for the very processor at hand differs from another one's in the last digits of its results.
So kernels are compiled for a baseline that most processors have; results are the same on all of these.
"""

import os
import platform
import sys

ONE_THREAD = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"  # of linear algebra
BASELINE = "x86-64-v3"
V3_FLAGS = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "abm"}  # as /proc/cpuinfo names them


def choose(environ):
    """Set in `environ` what numba and NumPy read when they are imported, unless the user has.

    Where NumPy or numba has been imported already, that would come too late, and only hide it.
    """
    if "numpy" not in sys.modules:
        for name in ONE_THREAD:
            environ.setdefault(name, "1")
    if "numba" not in sys.modules and "NUMBA_CPU_NAME" not in environ and has_baseline():
        environ["NUMBA_CPU_NAME"] = BASELINE
        environ.setdefault("NUMBA_CPU_FEATURES", "")


def has_baseline():
    """Whether this processor has all of x86-64-v3: bool."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return False
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            flags = next((line for line in file if line.startswith("flags")), "")
    except OSError:  # no Linux
        from llvmlite.binding import get_host_cpu_features

        features = get_host_cpu_features()
        return all(features.get(name) for name in ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"))
    return V3_FLAGS <= set(flags.split())


def cache_folder(environ=os.environ):
    """Folder in which this machine's user keeps compiled kernels: str."""
    if own := environ.get("NUMBA_CACHE_DIR"):
        return os.path.join(own, "shefex_nav")
    base = environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "shefex_nav", "kernels")
