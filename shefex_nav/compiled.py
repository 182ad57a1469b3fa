"""Where numba keeps compiled kernels.

numba notices an edit in the file of a kernel, but not one in another file whose functions or constants
that kernel uses. The cache folder therefore carries a hash of what is used across files: after an edit there,
every kernel is compiled again.
"""

import hashlib
import os
import sys

SHARED = (  # folders and files
    "clock.py",
    "records.py",
    "geometry",
    "environment",
    "onboard/navigation",
    "onboard/startracker",
    "onboard/startracker/identify",
    "solve",
    "world/camera",
    "world/flight",
)


ONE_THREAD = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"  # of linear algebra


def rows(fields, align=False):
    """NumPy type of the rows of a table whose fields kernels read as attributes, `row.mass`.

    Compiled code can do so with any structured type. NUMBA_DISABLE_JIT=1 runs kernels as Python, for coverage
    and debuggers; there rows have attributes only if they are np.record, whose own (`mean`) are taken.
    ValueError for such a name.
    """
    import numba
    import numpy as np

    plain = np.dtype(fields, align=align)
    if taken := [name for name in plain.names if hasattr(np.record, name)]:
        raise ValueError(f"fields {', '.join(taken)}: NumPy's rows have attributes of these names")
    return np.dtype((np.record, plain)) if numba.config.DISABLE_JIT else plain


def cache_key(package_dir):
    """Hash of the source files whose functions are inlined into other files' kernels: str."""
    digest = hashlib.sha256()
    for place in SHARED:
        path = os.path.join(package_dir, place)
        names = sorted(os.listdir(path)) if os.path.isdir(path) else [""]
        for file in (os.path.join(path, name) if name else path for name in names):
            if file.endswith(".py") and os.path.exists(file):
                with open(file, "rb") as source:
                    digest.update(source.read())
    return digest.hexdigest()[:12]


def place_cache(environ):
    """Set NUMBA_CACHE_DIR in `environ`, unless the user has; must run before numba is imported.

    Likewise one thread for linear algebra: sums in another order would end in other last digits. Where NumPy
    has been imported already, that would come too late, and only hide it.
    """
    for name in ONE_THREAD if "numpy" not in sys.modules else ():
        environ.setdefault(name, "1")
    base = environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    key = cache_key(os.path.dirname(os.path.abspath(__file__)))
    environ.setdefault("NUMBA_CACHE_DIR", os.path.join(base, "shefex_nav", f"numba-{key}"))
