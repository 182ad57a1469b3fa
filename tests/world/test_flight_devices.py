"""Devices that act once: the yo-yo against published figures and its Lagrangian; separation by momentum."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from shefex_nav.geometry import rotation
from shefex_nav.world.flight import devices
from shefex_nav.world.flight.settings import Parachute, SpinMotors, YoYo

YO_YO = YoYo(at=219.0, mass=2.0, cord_length=5.0, radius=0.5)
SPIN = 9.3  # rad/s
I_ROLL = 68.0  # kg m^2


def cord_for(spin_ratio, mass_kg, radius_m, i_roll):
    """Length [m] of each cord that leaves this share of the spin: Fedor, TN D-708, solved for the length."""
    return np.sqrt((radius_m**2 + i_roll / mass_kg) * (1.0 - spin_ratio) / (1.0 + spin_ratio))


def spins(row, times):
    return row[2] * np.array([devices.yo_yo_spin(row, t)[0] for t in times])


@pytest.mark.parametrize(("final", "cord_m", "unwinding_s"), [(1.0, 5.902, 0.7869), (0.0, 7.228, 0.9638)])
def test_published_example(final, cord_m, unwinding_s):
    # Curtis, Orbital Mechanics for Engineering Students: two masses of 3 kg, 300 kg m^2, 1.5 m, 5 rad/s
    cord = cord_for(final / 5.0, 6.0, 1.5, 300.0)
    assert cord == pytest.approx(cord_m, abs=5e-4)
    row = devices.yo_yo_row(YoYo(at=0.0, mass=6.0, cord_length=cord, radius=1.5), 5.0, 300.0)
    assert row[1] == pytest.approx(unwinding_s, abs=5e-5)
    assert spins(row, [row[1] - 1e-9])[0] == pytest.approx(final, abs=1e-6)


@pytest.mark.parametrize("spin", [SPIN, -SPIN])
def test_spin_while_unwinding_obeys_the_equations_of_lagrange(spin):
    # T = I omega^2 / 2 + m R^2 (omega^2 + phi^2 (omega + phi')^2) / 2, phi: angle unwound
    r2, m, w0 = YO_YO.radius**2, YO_YO.mass, abs(spin)

    def omega(g):  # angular momentum (I + m R^2) omega + m R^2 g is conserved, g = phi^2 (omega + phi')
        return w0 - m * r2 * g / (I_ROLL + m * r2)

    def slope(_, y):
        phi, g = y
        unwinding = g / phi**2 - omega(g)
        return unwinding, phi * (omega(g) + unwinding) ** 2

    row = devices.yo_yo_row(YO_YO, spin, I_ROLL)
    t_0 = 1e-4 / w0
    times = np.linspace(t_0, row[1] - row[0] - 1e-9, 40)
    y_0 = (w0 * t_0, 2.0 * w0 * (w0 * t_0) ** 2)
    y = solve_ivp(slope, (t_0, times[-1]), y_0, t_eval=times, rtol=1e-11, atol=1e-15, method="DOP853").y
    assert y[0] == pytest.approx(w0 * times, rel=1e-6)  # unwinds at the rate of the spin before
    assert y[0, -1] * YO_YO.radius == pytest.approx(YO_YO.cord_length, rel=1e-6)
    assert spins(row, row[0] + times) == pytest.approx(np.sign(spin) * omega(y[1]), rel=1e-5)


def test_acceleration_is_the_derivative_of_the_spin():
    row = devices.yo_yo_row(YO_YO, SPIN, I_ROLL)
    times = np.linspace(row[0] + 0.01, row[1] - 0.01, 9)
    after, before = spins(row, times + 1e-5), spins(row, times - 1e-5)
    slopes = [devices.yo_yo_acceleration(row, t) for t in times]
    assert slopes == pytest.approx((after - before) / 2e-5, rel=1e-6)
    assert min(slopes) < -1.0
    assert devices.yo_yo_acceleration(row, row[0] - 1e-6) == 0.0 == devices.yo_yo_acceleration(row, row[1])
    # all of the impulse: from the spin before to the spin after
    fine = np.linspace(row[0], row[1], 20001)[:-1] + 0.5 * (row[1] - row[0]) / 20000
    change = sum(devices.yo_yo_acceleration(row, t) for t in fine) * (fine[1] - fine[0])
    k = YO_YO.radius**2 + I_ROLL / YO_YO.mass
    l2 = YO_YO.cord_length**2
    assert SPIN + change == pytest.approx(SPIN * (k - l2) / (k + l2), rel=1e-6)


@pytest.mark.parametrize("ratio", [-0.3, 0.0, 0.1, 0.6])
def test_cord_for_a_final_spin(ratio):
    cord = cord_for(ratio, YO_YO.mass, YO_YO.radius, I_ROLL)
    row = devices.yo_yo_row(replace(YO_YO, cord_length=cord), SPIN, I_ROLL)
    assert spins(row, [row[1] - 1e-10])[0] == pytest.approx(ratio * SPIN, abs=1e-6)


def test_what_is_not_there_never_acts():
    none = devices.yo_yo_row(None, 0.0, 1.0)
    assert devices.yo_yo_acceleration(none, 1e9) == 0.0
    assert devices.spin_motor_rows(None).shape == (0, 3)
    assert devices.parachute_row(None)[0] == np.inf
    assert devices.spin_motor_rows(SpinMotors(at=384.0, duration=2.0, torque=213.0)).tolist() == [
        [384.0, 386.0, 213.0]
    ]


def test_parachute_opens_by_time_or_when_told():
    by_time = Parachute(height=None, at=300.0, drag_area=12.0, inflation=2.0, station=1.5)
    assert devices.parachute_row(by_time).tolist() == [300.0, 2.0, 12.0, 1.5, 0.0]
    by_height = Parachute(height=3e3, at=None, drag_area=12.0, inflation=2.0, station=1.5)
    assert devices.parachute_row(by_height)[0] == np.inf
    assert devices.parachute_row(by_height, 512.5)[0] == 512.5


def test_separation_pushes_the_centre_of_mass_and_is_felt_by_the_imu():
    rng = np.random.default_rng(5)
    x, lever_b, tip_off = rng.normal(size=19), rng.normal(size=3), np.array([0.0, 0.03, -0.02])
    x[6:10] /= np.linalg.norm(x[6:10])
    C_ib = rotation.dcm_from_quat(x[6:10])

    def centre(state):
        return state[3:6] + C_ib @ np.cross(state[10:13], lever_b)

    after = x.copy()
    devices.kick(after, C_ib, 1.7, tip_off, lever_b)
    assert np.allclose(centre(after) - centre(x), 1.7 * C_ib[:, 0], atol=1e-14)
    assert np.allclose(after[10:13] - x[10:13], tip_off, atol=1e-15)
    assert np.allclose(C_ib @ (after[16:19] - x[16:19]), after[3:6] - x[3:6], atol=1e-14)
    assert np.array_equal(after[:3], x[:3]) and np.array_equal(after[13:16], x[13:16])
