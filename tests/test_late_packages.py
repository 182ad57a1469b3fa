"""Packages of which one file is imported: all that they have is still there for those who ask."""

import subprocess
import sys
import textwrap

import pytest

HELD_BACK = """
import sys
from shefex_nav.late_packages import late, special
from types import SimpleNamespace
from shefex_nav.onboard.navigation.eskf import engine
kalman = engine(SimpleNamespace(n=15))
ndtri = special().ndtri
done = {"scipy._lib._array_api", "scipy.stats", "numpy.f2py", "scipy.special._basic", "scipy.linalg._misc"}
assert not done & set(sys.modules), done & set(sys.modules)
"""
ASKED = {
    "a function of another file": """
        import numpy as np
        from scipy.special import logsumexp
        assert abs(logsumexp([0.0, 0.0]) - np.log(2.0)) < 1e-15
        import scipy.special
        assert scipy.special.ndtri is ndtri and type(scipy.special).__name__ == "module"
    """,
    "all names": """
        from scipy.special import *
        assert expit(0.0) == 0.5
    """,
    "a file of a package that waits": """
        import scipy.linalg.cython_blas, numpy as np
        assert "scipy.linalg._misc" not in sys.modules
        assert np.allclose(scipy.linalg.expm(np.zeros((2, 2))), np.eye(2))
        assert scipy.linalg.cython_blas is sys.modules["scipy.linalg.cython_blas"]
    """,
    "another filter": """
        import filterpy, filterpy.kalman
        from filterpy.common import Q_discrete_white_noise
        assert filterpy.kalman.KalmanFilter is type(kalman)
        assert issubclass(filterpy.kalman.ExtendedKalmanFilter, object)
        assert filterpy.__version__ and filterpy.gh.GHFilter
    """,
    "what leans on them": """
        import scipy.stats, scipy.optimize, scipy.spatial.transform, scipy.interpolate
        assert abs(scipy.stats.chi2.ppf(0.5, 2) - 1.3862943611198906) < 1e-12
    """,
    "a name that nobody has": """
        import scipy.special
        try:
            scipy.special.no_such_function
        except AttributeError as error:
            assert "no_such_function" in str(error)
        else:
            raise AssertionError
        assert scipy.special.gamma(5.0) == 24.0
    """,
    "its list of names": """
        import scipy.special
        assert {"erf", "logsumexp"} <= set(dir(scipy.special))
    """,
    "several threads at once": """
        from threading import Thread
        found = []
        def ask():
            import scipy.special, scipy.linalg
            found.append((scipy.special.softmax, scipy.linalg.block_diag))
        threads = [Thread(target=ask) for _ in range(8)]
        for one in threads: one.start()
        for one in threads: one.join()
        assert len(found) == 8 and len(set(found)) == 1
    """,
}


def carried_out(text):
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("asked", ASKED)
def test_what_waits_is_there_when_it_is_asked_for(asked):
    carried_out(HELD_BACK + textwrap.dedent(ASKED[asked]))


def test_a_package_that_there_is_not():
    carried_out("""
from shefex_nav.late_packages import late
try:
    late("no_such_package_at_all")
except ModuleNotFoundError as error:
    assert error.name == "no_such_package_at_all"
else:
    raise AssertionError
""")


def test_a_package_that_fails_fails_again_and_then_heals(tmp_path):
    """What it raises reaches whoever asks, each time; mended, it is there."""
    package = tmp_path / "late_one"
    package.mkdir()
    (package / "__init__.py").write_text("from late_one.whole import missing\n")
    (package / "whole.py").write_text("here = 1\n")
    carried_out(f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
sys.dont_write_bytecode = True
from pathlib import Path
from shefex_nav.late_packages import late
late("late_one", "whole")
import late_one
assert late_one.here == 1  # of a part, without the package
for _ in range(2):
    try:
        late_one.missing
    except ImportError as error:
        assert "missing" in str(error)
    else:
        raise AssertionError
sys.modules["late_one.whole"].missing = 2
assert late_one.missing == 2
""")
