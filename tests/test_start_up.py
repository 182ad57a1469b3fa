"""Commands start without what they do not use: heavy imports do not creep back in."""

import subprocess
import sys

import pytest

OF_FILTER = {  # of the measurement update; its import takes most of a second, so only flights have it
    *("filterpy", "scipy.stats", "scipy.interpolate", "scipy.optimize", "scipy.spatial", "scipy.ndimage"),
}
HEAVY = {  # processor seconds of an import, and more; none is needed by the default mission
    *("scipy.signal", "astropy", "matplotlib", "pandas", "PIL", "pyarrow", "rerun", "mcap", "dask", "pymsis"),
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
    assert "shefex_nav.simulate" in found
    assert found & HEAVY == set()
    assert "searches=0" in found  # a tenth of the time until the first tick, `ending.NEW_OBJECTS`


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
