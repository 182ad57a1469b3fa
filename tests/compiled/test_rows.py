"""Rows of tables that kernels read have attributes, compiled or not."""

import os
import subprocess
import sys

import numpy as np
import pytest

from shefex_nav import compiled


def test_fields_of_rows_do_not_hide_behind_what_numpy_has():
    """As Python, `row.mean` would be a method: what a kernel reads must not depend on how it runs."""
    plain = compiled.rows([("run", float), ("state", int)])
    assert plain.names == ("run", "state")
    row = np.zeros(1, dtype=np.dtype((np.record, plain)))[0]
    row.run = 2.0
    assert row.run == row["run"] == 2.0
    with pytest.raises(ValueError, match="fields mean, T: NumPy's rows have attributes of these names"):
        compiled.rows([("mean", float), ("run", float), ("T", float)])


def test_kernels_run_as_python(tmp_path):
    """Rows have attributes where nothing is compiled, and what is written into one is in its table."""
    code = (
        "import numpy as np\n"
        "from shefex_nav.onboard.navigation import integrity_imu as it\n"
        "watch = it.start(it.NO_RULES, 4)\n"
        "it._charge(1.0, 1.0, watch.axes[2], 5.0)\n"
        "watch.axes[3].mean_rate = 7.0\n"
        "assert watch.axes['mean_rate'][3] == 7.0 and type(watch.axes[0]) is np.record\n"
        "assert not hasattr(it._charge, 'py_func')\n"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
