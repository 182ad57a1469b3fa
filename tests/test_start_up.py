"""Commands start without what they do not use: heavy imports do not creep back in."""

import subprocess
import sys

import pytest

OF_FILTER = {"filterpy", "filterpy.kalman.kalman_filter"}  # of the measurement update, of flights alone
HEAVY = {  # processor seconds of an import, and more; none is needed by the default mission
    *("scipy.stats", "scipy.interpolate", "scipy.optimize", "scipy.spatial", "scipy.signal"),
    *("scipy.ndimage", "scipy._lib._array_api", "scipy.special._basic", "scipy.linalg._misc", "numpy.f2py"),
    *("filterpy.common.discretization", "filterpy.kalman.UKF"),
    *("astropy", "matplotlib", "pandas", "PIL", "pyarrow", "rerun", "mcap", "dask", "pymsis"),
    *("numba.np.arraymath", "numba.np.linalg", "numba.np.npyimpl"),  # numba's own, for what it compiles
    *("shefex_nav.trajectory.flight", "shefex_nav.papers.engine", "shefex_nav.solve", "shefex_nav.replay"),
}
FLIGHT = {"numba", "scipy", "erfa", "foxglove", "google.protobuf", "shefex_nav.simulate"}
AT_THE_END = """
import atexit, gc, sys
atexit.register(lambda: print("loaded", f"searches={searches() - before}", *sys.modules, file=sys.stderr))
sys.argv = ["shefex-nav", *sys.argv[1:]]
from shefex_nav.commands.main import main
searches = lambda: gc.get_stats()[0]["collections"]
before = searches()
main()
"""


def loaded(*command):
    """Names of the modules that are loaded at the end of a command, and `searches=` with how often cycles
    were searched for: set.
    """
    done = subprocess.run([sys.executable, "-c", AT_THE_END, *command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    last = done.stderr.strip().splitlines()[-1].split()
    assert last[0] == "loaded" and "shefex_nav.commands.main" in last
    return set(last)


def test_a_flight_loads_nothing_that_it_does_not_use(tmp_path):
    """The second process finds all kernels compiled."""
    command = "run", "shefex2_andoya", "--until", "0.2s", "--force", "--out", str(tmp_path / "flight.mcap")
    loaded(*command)
    found = loaded(*command)
    assert {"shefex_nav.simulate", *OF_FILTER} <= found
    assert found & HEAVY == set()
    assert "searches=0" in found  # a tenth of the time until the first tick, `ending.NEW_OBJECTS`


LIKELIHOODS = """
from types import SimpleNamespace
from shefex_nav.onboard.navigation.eskf import engine
kalman = engine(SimpleNamespace(n=15))
import sys
assert "scipy.stats" not in sys.modules
import filterpy, numpy as np
assert filterpy.stats.gaussian(0.0, 0.0, 1.0) == np.float64(1 / np.sqrt(2 * np.pi))
kalman.update(np.ones((3, 1)), np.eye(3), np.eye(3, 15))
wanted = -1.5 * np.log(2 * np.pi * 2.0) - 0.75  # S = 2 I, y^T y = 3
assert abs(kalman.log_likelihood - wanted) < 1e-12
from filterpy.stats import logpdf, mahalanobis
"""


def test_likelihoods_of_filterpy_are_there_for_those_who_ask():
    """They need scipy.stats, which the filter does without."""
    done = subprocess.run([sys.executable, "-c", LIKELIHOODS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_flight_along_a_trajectory_has_its_splines():
    """Names of these sets are those under which modules are loaded."""
    assert {"shefex_nav.trajectory.flight", "scipy.interpolate"} <= loaded("check", "given_trajectory")


def test_a_scenario_is_checked_without_what_flies_it():
    found = loaded("check", "shefex2_andoya")
    assert found & (HEAVY | OF_FILTER | {"foxglove", "shefex_nav.simulate"}) == set()


@pytest.mark.parametrize("command", [("--help",), ("run", "--help"), ("scenarios",)])
def test_what_only_prints_loads_nothing_of_the_flight(command):
    found = loaded(*command)
    assert found & (HEAVY | OF_FILTER | FLIGHT) == set()
    assert command[-1] != "--help" or "numpy" not in found
