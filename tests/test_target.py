"""Records are equal to the byte on all processors of one target: others are emulated by switching off parts.

The processor that runs this has more than the target (AVX-512), or there is nothing to emulate. Switched off
is what libraries choose by the processor: NumPy's vector functions and sorting, variants in the C library.
Compiled kernels and linear algebra have what `TARGET` says, whatever the package itself chooses.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

ROOT = Path(__file__).parent.parent
TARGET = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": "", "OPENBLAS_CORETYPE": "Haswell"}
UNTIL_S = 240  # the star tracker is on from T+234 s
BEYOND = [name for name in __cpu_dispatch__ if name.startswith(("X86_V4", "AVX512"))]  # the target has none
HWCAPS = "AVX512F", "AVX512VL", "AVX512BW", "AVX512DQ", "AVX512CD"
OTHERS = {
    "numpy": {"NPY_DISABLE_CPU_FEATURES": " ".join(BEYOND)},
    "libc": {"GLIBC_TUNABLES": f"glibc.cpu.hwcaps={','.join(f'-{name}' for name in HWCAPS)}"},
}
pytestmark = [
    pytest.mark.slow,  # the first time kernels are compiled for the target, for minutes
    pytest.mark.skipif(sys.platform != "linux", reason="processors are emulated with means of Linux"),
    pytest.mark.skipif(
        not any(__cpu_features__.get(name) for name in BEYOND),
        reason="the processor has nothing beyond x86-64-v3 that could be switched off",
    ),
]


def digests(settings):
    """{topic: digest} of the default mission under settings of the environment."""
    done = subprocess.run(
        [sys.executable, "benchmarks/record_digests.py", "default", "--until", str(UNTIL_S), "--json"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, **TARGET, **settings},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["flights"]["default"]["topics"]


@pytest.fixture(scope="module")
def reference():
    """Digests with everything that the processor has."""
    return digests({})


@pytest.mark.parametrize("part", OTHERS)
def test_records_are_those_of_other_processors(reference, part):
    assert digests(OTHERS[part]) == reference


def test_settings_reach_numpy():
    """Otherwise nothing is emulated: with its vector functions switched off NumPy's exp ends otherwise."""
    program = "import numpy as np; print(np.exp(np.linspace(-6.0, 6.0, 2001)).tobytes().hex())"

    def printed(settings):
        command = [sys.executable, "-c", program]
        env = {**os.environ, **settings}
        return subprocess.run(command, capture_output=True, text=True, env=env, check=True).stdout

    x = np.linspace(-6.0, 6.0, 2001)
    assert printed(OTHERS["numpy"]) != printed({})
    assert np.allclose(np.frombuffer(bytes.fromhex(printed(OTHERS["numpy"]))), np.exp(x), rtol=1e-15)
