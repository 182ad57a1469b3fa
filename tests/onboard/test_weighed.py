"""An innovation held against its covariance: by the laws of the Cholesky factor, few numbers and many."""

import numpy as np
import pytest

from shefex_nav.onboard.navigation import eskf


@pytest.mark.parametrize("m", [1, 2, 3, 4, 9])
def test_a_whitened_innovation_has_the_normalised_square_and_the_factor_gives_it_back(m):
    rng = np.random.default_rng(m)
    for _ in range(20):
        B = rng.standard_normal((m, m)) * 10.0 ** rng.uniform(-2.0, 2.0, (m, 1))
        S, z = B @ B.T + 1e-3 * np.eye(m), rng.standard_normal(m)
        w, own = eskf.weighed(z, 0.3 * S, S)
        assert w @ w == pytest.approx(z @ np.linalg.inv(S) @ z, rel=1e-6)
        assert np.linalg.cholesky(S) @ w == pytest.approx(z, rel=1e-9, abs=1e-12)
        assert own == pytest.approx(0.3)
        assert eskf.weighed(z, np.zeros((m, m)), S)[1] == 0.0


def test_few_numbers_are_those_of_numpy_to_the_last_digit():
    """The compiled way and NumPy's are one: results do not depend on which is taken."""
    rng = np.random.default_rng(0)
    for m in (1, 2, 3):
        for _ in range(200):
            B = rng.standard_normal((m, m))
            S, R, z = B @ B.T + np.eye(m), np.diag(rng.uniform(0.1, 1.0, m)), rng.standard_normal(m)
            w, own = eskf.weighed(z, R, S)
            np.testing.assert_array_equal(w, np.linalg.solve(np.linalg.cholesky(S), z))
            assert own == float(np.trace(np.linalg.solve(S, R))) / m
