"""NumPy imported before the package computes what it computes when it is imported after."""

import os
import subprocess
import sys

import pytest

from shefex_nav.compiled import target

PRODUCTS = """
import hashlib
rng = np.random.default_rng(5)
A, x = rng.standard_normal((24, 24)), rng.standard_normal((24, 3))
for value in (x[:, 0] @ x[:, 1], A.T @ x[:, 0], A @ A, np.linalg.inv(A), scipy.linalg.cholesky(A @ A.T)):
    print(hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest())
"""
NUMPY, OURS = "import numpy as np, scipy.linalg\n", "import shefex_nav\n"
WARM = "np.linalg.inv(np.eye(9)); scipy.linalg.cholesky(np.eye(9))\n"  # it has computed before
SET_HERE = "OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS"


def products(script, **environ):
    plain = {name: value for name, value in os.environ.items() if name not in SET_HERE}
    done = subprocess.run(
        [sys.executable, "-c", script + PRODUCTS],
        env={**plain, **environ},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_order_of_imports_moves_no_digit():
    assert products(NUMPY + WARM + OURS) == products(OURS + NUMPY)


def test_what_the_user_has_chosen_stays():
    chosen = {"OPENBLAS_CORETYPE": "Nehalem"}
    assert products(NUMPY + WARM + OURS, **chosen) == products(NUMPY, **chosen)


@pytest.mark.skipif(sys.platform != "linux", reason="what is loaded is read from /proc")
def test_every_loaded_library_chooses_what_is_stated():
    told = "from shefex_nav.compiled import algebra; print(*algebra.choose_again())"
    first = products(NUMPY + OURS + told).splitlines()[0]
    assert set(first.split()) <= {target.baseline().algebra}
