"""The wiring: what of the attitude control is logged, and the picture that warms the star tracker up."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav import simulate
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.records import ControlSample, Trajectory, row, rows
from shefex_nav.world.flight import record


def history(t_s):
    n = np.arange(len(t_s), dtype=float)
    return SimpleNamespace(
        t_s=np.array(t_s),
        pointing_error=np.outer(n, [1, 2, 3]),
        torque_b=np.outer(n, [4, 5, 6]),
        propellant_kg=n,
    )


def test_attitude_control_is_logged_ten_times_a_second():
    """Fifty controller steps a second, with a pause: the last one of each tenth of a second."""
    t_s = np.concatenate([65.0 + 0.02 * np.arange(51), 70.003 + 0.02 * np.arange(26)])
    start = SimpleNamespace(t_s=np.array([-10.0]))
    samples = record.control_samples(history(t_s), start)
    np.testing.assert_allclose(samples.t_s[:11], 65.0 + 0.1 * np.arange(11))
    np.testing.assert_allclose(samples.t_s[11:], [70.083, 70.183, 70.283, 70.383, 70.483, 70.503])
    for sample in (row(samples, k) for k in range(len(samples.t_s))):
        k = np.argmin(np.abs(t_s - sample.t_s))
        np.testing.assert_array_equal(sample.pointing_error, k * np.array([1.0, 2, 3]))
        np.testing.assert_array_equal(sample.torque_b, k * np.array([4.0, 5, 6]))
        assert sample.propellant_kg == k


def test_records_that_are_made_many_at_once_are_those_made_one_by_one():
    n = 3 * simulate.Rows.AT_ONCE + 5
    arrays = ControlSample(np.arange(n) / 3.0, *np.random.default_rng(1).random((2, n, 3)), np.arange(n))
    by_number, together = simulate.Rows(arrays), rows(arrays)
    assert len(together) == n
    for k in (0, 1, simulate.Rows.AT_ONCE - 1, simulate.Rows.AT_ONCE, 5, 0, n - 1):
        for one in (by_number[k], together[k]):
            assert type(one) is ControlSample
            for a, b in zip(one, row(arrays, k), strict=True):
                assert type(a) is type(b) and np.array_equal(a, b)
    with pytest.raises(IndexError):
        by_number[n]


def test_without_attitude_control_nothing_is_logged():
    assert record.control_samples(None, None) is None
    assert record.control_samples(history([]), None) is None


def test_the_warming_picture_looks_up_and_away_from_the_sun():
    n, up_i = 800, np.array([0.6, 0.0, 0.8])
    column = np.zeros(n)
    trajectory = Trajectory(*[column] * len(Trajectory._fields))._replace(
        r_i=np.tile(7e6 * up_i, (n, 1)), q_ib=np.tile([0.5, 0.5, 0.5, 0.5], (n, 1))
    )
    C_bc = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    for sun_i in (-up_i, np.array([0.8, 0.0, 0.6]), wgs84.perpendicular(up_i)):
        settings = SimpleNamespace(mounting=SimpleNamespace(C_bc=C_bc))
        camera = SimpleNamespace(bodies=SimpleNamespace(sun_u_i=sun_i), settings=settings)
        held = simulate.looking_up(trajectory, camera)
        assert len(held.t_s) == 400 and not held.omega_ib_b.any()
        boresight_i = rotation.dcm_from_quat(held.q_ib[0]) @ C_bc[:, 2]
        assert boresight_i @ sun_i < 1e-9
        assert boresight_i @ up_i > 0.2
