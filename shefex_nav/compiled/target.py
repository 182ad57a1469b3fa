"""The processor for which kernels are compiled, and where they are kept.

A kernel compiled for the very processor at hand differs from another one's in the last digits of its results.
So kernels are compiled for a baseline that most processors have; results are the same on all of these.
"""

import os
import platform
import sys
from typing import NamedTuple

ONE_THREAD = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"  # of linear algebra
V2_FLAGS = {"cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"}  # as /proc/cpuinfo names them
V3_FLAGS = V2_FLAGS | {"abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"}
LLVM_NAMES = {"abm": "lzcnt", "bmi1": "bmi", "lahf_lm": "sahf"}  # where these differ


class Target(NamedTuple):
    """A baseline for which code is chosen."""

    kernels: str  # processor as LLVM names it
    algebra: str | None  # processor as OpenBLAS names it; None: it chooses


def choose(environ):
    """Set in `environ` what numba and NumPy read when they are imported, unless the user has.

    Where NumPy has been imported already its linear algebra chooses again (`algebra`). Where numba has, that
    would come too late, and only hide it.
    """
    target, wanted = baseline(), {}
    is_late = "numpy" in sys.modules
    if not is_late:
        wanted.update(dict.fromkeys(ONE_THREAD, "1"))
    if target.algebra and "OPENBLAS_CORETYPE" not in environ:
        wanted["OPENBLAS_CORETYPE"] = target.algebra
    else:
        is_late = False  # it has what it was told when it was loaded
    if "numba" not in sys.modules and "NUMBA_CPU_NAME" not in environ:
        wanted.update(NUMBA_CPU_NAME=target.kernels, NUMBA_CPU_FEATURES="", NUMBA_DISABLE_INTEL_SVML="1")
    for name, value in wanted.items():
        environ.setdefault(name, value)
    if is_late:
        from shefex_nav.compiled import algebra

        algebra.choose_again()


def baseline():
    """The baseline of this machine: Target."""
    machine = platform.machine().lower()
    if machine in ("arm64", "aarch64"):
        return Target("apple-m1", None) if sys.platform == "darwin" else Target("generic", "ARMV8")
    if machine not in ("x86_64", "amd64"):
        return Target("generic", None)
    flags = _flags()
    if flags >= V3_FLAGS:
        return Target("x86-64-v3", "Haswell")
    return Target("x86-64-v2", "Nehalem") if flags >= V2_FLAGS else Target("x86-64", None)


def told(environ):
    """What a process that starts now computes with, in words: str. Results of another end in other digits.

    Not what this very process was compiled for: of one that had imported numba first that is another one.
    """
    target = baseline()
    kernels = environ.get("NUMBA_CPU_NAME", target.kernels)
    if features := environ.get("NUMBA_CPU_FEATURES"):
        kernels += f" {features}"
    if environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        kernels = "Python"
    algebra = environ.get("OPENBLAS_CORETYPE", target.algebra) or "as found"
    return f"{sys.platform} {platform.machine()}, kernels {kernels}, OpenBLAS {algebra}"


def _flags():
    """What this x86-64 processor has, of V3_FLAGS: set of str."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            return set(next((line for line in file if line.startswith("flags")), "").split()) & V3_FLAGS
    except OSError:  # no Linux
        from llvmlite.binding import get_host_cpu_features

        features = get_host_cpu_features()
        return {flag for flag in V3_FLAGS if features.get(LLVM_NAMES.get(flag, flag).replace("_", "."))}


def cache_folder():
    """Folder in which this machine's user keeps compiled kernels: str."""
    if own := os.environ.get("NUMBA_CACHE_DIR"):
        return os.path.join(own, "shefex_nav")
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "shefex_nav", "kernels")
