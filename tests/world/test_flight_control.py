"""The cold-gas control in a closed loop with Euler's equations: what it reaches and what it costs."""

from dataclasses import replace

import numpy as np
import pytest
from cold_gas_bench import COLD_GAS, DEG, EMPTY, STACK, state, steer, still

from shefex_nav.geometry import rotation
from shefex_nav.world.flight import attitude_program, control
from shefex_nav.world.flight.settings import AttitudeReference

SPIN = 1.5 * 2.0 * np.pi  # rad/s
PER_TORQUE = 1.0 / (2.0 * 68.0 * 9.80665)  # kg/s of gas for a torque of 1 N m about y or z


def across(vectors):
    """Size of the y and z components, (n, 3) -> (n,)."""
    return np.hypot(vectors[:, 1], vectors[:, 2])


def turn(angle, seconds, q_ib=(1.0, 0.0, 0.0, 0.0)):
    """Law and target direction of a turn of the roll axis from the attitude q_ib."""
    target = np.array([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
    return attitude_program.turn_roll_axis(0.0, seconds, 0.0, np.array(q_ib), target), target


def off_target(x, target):
    return np.arccos(rotation.dcm_from_quat(x[6:10])[:, 0] @ target)


@pytest.mark.parametrize("spin", [0.0, SPIN, -SPIN, 3.0 * SPIN])
def test_creeping_and_nutation_decay_with_the_bandwidth(spin):
    # valves fast enough to stand for a continuous torque; no dead bands
    a, lean = 0.4, 0.3 * DEG
    quick = replace(COLD_GAS, period=1e-3, dead_band_angle=(0.0,) * 3, dead_band_rate=(0.0,) * 3, bandwidth=a)
    x = state(rotation.quat_from_rotvec(np.array([0.0, 0.0, lean])), (spin, 0.0, 0.0))
    follow = control.AXIS if spin else control.ATTITUDE
    run = steer(x, still(0.0, 20.0), follow, STACK, 20.0, quick, q_wanted=np.array([1.0, 0.0, 0.0, 0.0]))
    axis = np.array([rotation.dcm_from_quat(q)[:, 0] for q in run.q_ib])
    delta = axis[:, 1] + 1j * axis[:, 2]
    nutation, t = 1j * STACK[0] * spin / STACK[1], run.t_s
    if spin:  # roots -a and i sigma - a, starting at rest but for the spin
        r1, r2 = -a, nutation - a
        expected = lean * (r2 * np.exp(r1 * t) - r1 * np.exp(r2 * t)) / (r2 - r1)
    else:
        expected = lean * (1.0 + a * t) * np.exp(-a * t)
    assert np.abs(delta - expected).max() < 0.02 * lean


def test_precession_of_the_spinning_stack():
    x = state(omega_b=(SPIN, 0.0, 0.0))
    law, target = turn(42.0 * DEG, 75.0)
    run = steer(x, law, control.AXIS, STACK, 79.2)
    assert across(run.error).max() < 0.25 * DEG
    assert off_target(x, target) < 0.25 * DEG
    assert across(run.omega_b)[-1] < 0.1 * DEG
    # the angular momentum has to be turned; square valves on turning axes waste 4/pi - 1 of it
    least = STACK[0] * SPIN * 42.0 * DEG * PER_TORQUE
    assert least < run.gas_kg < 1.06 * 4.0 / np.pi * least
    assert x[10] == pytest.approx(SPIN, rel=1e-9) and run.firings(0) == 0
    assert np.isnan(run.error[:, 0]).all()


def test_spin_in_the_other_sense_precesses_as_well():
    x = state(omega_b=(-SPIN, 0.0, 0.0))
    law, target = turn(42.0 * DEG, 75.0)
    steer(x, law, control.AXIS, STACK, 79.2)
    assert off_target(x, target) < 0.25 * DEG


def test_nutation_is_damped_on_the_way():
    x = state(omega_b=(SPIN, 0.1, 0.0))  # a cone of 10 degrees
    law, target = turn(42.0 * DEG, 75.0)
    run = steer(x, law, control.AXIS, STACK, 79.2)
    assert across(run.error)[0] == 0.0 and across(run.error).max() > 5.0 * DEG
    late = run.t_s > 40.0
    assert across(run.error)[late].max() < 0.4 * DEG
    assert off_target(x, target) < 0.25 * DEG


@pytest.mark.parametrize("bandwidth", [0.3, 1.0])
def test_far_off_and_spinning_it_comes_back(bandwidth):
    # 30 degrees ask for much more torque than there is
    x = state(rotation.quat_from_rotvec(np.array([0.0, 30.0 * DEG, 0.0])), (SPIN, 0.0, 0.0))
    strong = replace(COLD_GAS, bandwidth=bandwidth)
    run = steer(
        x, still(0.0, 120.0), control.AXIS, STACK, 120.0, strong, q_wanted=np.array([1.0, 0.0, 0.0, 0.0])
    )
    assert across(run.error)[-500:].max() < 0.4 * DEG
    assert across(run.error).max() < 31.0 * DEG


def test_damping_takes_the_transverse_rate_and_leaves_the_spin():
    x = state(omega_b=(SPIN, 0.06, -0.04))
    run = steer(x, still(0.0, 5.0), control.RATES, STACK, 5.0, replace(COLD_GAS, bandwidth=1.0))
    assert np.hypot(x[11], x[12]) < 0.15 * DEG
    assert x[10] == pytest.approx(SPIN, rel=1e-9)
    assert np.isnan(run.error).all()  # nothing is wanted of the attitude


def test_spinning_hold_is_quiet():
    x = state(omega_b=(SPIN, 0.002, 0.0))
    run = steer(x, still(0.0, 100.0), control.AXIS, STACK, 100.0)
    assert across(run.error).max() < 0.3 * DEG
    assert run.gas_kg < 0.02


def test_what_the_yo_yo_leaves_is_taken_away():
    x = state(omega_b=(10.0 * DEG, 0.3 * DEG, 0.0))
    law = attitude_program.ramp_spin(0.0, 13.0, 10.0 * DEG, 0.0)
    run = steer(x, law, control.AXIS_AND_SPIN, EMPTY, 14.0)
    assert abs(x[10]) < 0.16 * DEG
    assert across(run.error).max() < 0.5 * DEG
    assert np.isnan(run.error[:, 0]).all()


@pytest.mark.parametrize(("angle", "seconds"), [(57.0, 12.0), (90.0, 15.0)])
def test_slews_arrive_nearly_in_time(angle, seconds):
    x = state()
    axis = np.array([0.2, 0.7, -0.6])
    target = rotation.quat_from_rotvec(angle * DEG * axis / np.linalg.norm(axis))
    law = attitude_program.turn_to(0.0, seconds, x[6:10], target)
    run = steer(x, law, control.ATTITUDE, EMPTY, seconds + 10.0)
    size = np.linalg.norm(run.error, axis=1)
    assert size.max() < 3.0 * DEG
    assert size[run.t_s > seconds + 5.0].max() < 0.6 * DEG
    assert np.abs(x[10:13]).max() < 0.16 * DEG


def test_pointing_holds_within_its_dead_bands_and_hardly_fires():
    x = state(omega_b=(0.4 * DEG, 0.3 * DEG, -0.2 * DEG))
    run = steer(x, still(0.0, 122.0), control.ATTITUDE, EMPTY, 122.0)
    late = run.t_s > 15.0
    assert np.abs(run.error[late]).max() < 0.4 * DEG
    assert np.linalg.norm(run.omega_b[late], axis=1).max() < 0.2 * DEG  # the camera works below 2 deg/s
    assert run.gas_kg < 0.05
    assert max(run.firings(j) for j in range(3)) < 30
    # and no valve chatters: between two firings of an axis a second passes on average, not a tick
    assert (run.torque[late] != 0.0).mean() < 0.005


def test_a_steady_push_does_not_make_the_valves_fight():
    # rate errors outside the dead band again and again: never fires against itself within a second
    x = state(omega_b=(0.0, 0.12 * DEG, 0.0))
    run = steer(x, still(0.0, 60.0), control.ATTITUDE, EMPTY, 60.0)
    fired = np.flatnonzero(run.torque[:, 1])
    signs = np.sign(run.torque[fired, 1])
    opposed = np.diff(run.t_s[fired])[signs[1:] != signs[:-1]]
    assert len(fired) > 1 and (len(opposed) == 0 or opposed.min() > 1.0)


def test_rates_asked_for_are_flown():
    task_rate = 0.5 * DEG
    law = still(0.0, 60.0)._replace(
        steady=np.array([0.0, task_rate, 0.0]), swing=np.zeros((2, 3)), frequency=0.3, ramp=5.0
    )
    x = state()
    run = steer(x, law, control.ATTITUDE, EMPTY, 60.0)
    middle = (run.t_s > 10.0) & (run.t_s < 50.0)
    assert run.omega_b[middle, 1].mean() == pytest.approx(task_rate, rel=0.02)
    assert np.abs(run.error).max() < 0.4 * DEG


def test_valves_give_in_the_mean_what_is_asked_for():
    for spin, sizes in ((0.0, (0.07, 0.35, 0.93)), (SPIN, (0.07, 0.35, 0.6))):
        for size in sizes:
            steering = control.start(COLD_GAS, None, 0)
            given, asked = 0.0, 0.0
            for k in range(500):
                now = np.exp(-1j * spin * 0.02 * k)  # a torque fixed in space, seen from the body
                torque = np.array([size * 5.0, size * 60.0 * now.real, size * 60.0 * now.imag])
                control._open_valves(steering, torque, np.ones(3, dtype=bool), spin * 0.02)
                middle = np.exp(1j * spin * 0.02 * (k + 0.5))
                given += (steering.torque[1] + 1j * steering.torque[2]) * middle
                asked += size * 60.0
                assert abs(given - asked) < 60.0  # never more than a pulse behind or ahead
                assert set(np.abs(steering.torque[1:])) <= {0.0, 60.0} and abs(steering.torque[0]) in (
                    0.0,
                    5.0,
                )


def test_torque_is_what_changes_the_angular_momentum():
    x = state(omega_b=(0.5 * DEG, 0.0, 0.0))
    run = steer(x, still(0.0, 10.0), control.ATTITUDE, EMPTY, 10.0)
    impulse = run.torque[:, 0].sum() * 0.02
    assert EMPTY[0] * (x[10] - run.omega_b[0, 0]) == pytest.approx(impulse, abs=1e-3)
    gas = np.abs(run.torque).sum(axis=0) * 0.02 / (np.array(COLD_GAS.arm) * 68.0 * 9.80665)
    assert run.gas_kg == pytest.approx(gas.sum(), rel=1e-12)


def test_an_empty_tank_pushes_no_more():
    x = state(omega_b=(0.0, 5.0 * DEG, 0.0))
    run = steer(x, still(0.0, 10.0), control.ATTITUDE, EMPTY, 10.0, replace(COLD_GAS, propellant=0.03))
    assert run.gas_kg == pytest.approx(0.03, rel=1e-12)
    assert np.abs(run.torque[-100:]).max() == 0.0
    assert 1.0 * DEG < x[11] < 5.0 * DEG


def test_reference_errors_move_the_attitude_that_is_held():
    error = AttitudeReference(misalignment=1.0 * DEG, drift=0.02 * DEG, roll_scale_factor=0.0)
    drawn = np.random.default_rng(8).standard_normal(7)
    x = state()
    run = steer(
        x,
        still(0.0, 100.0),
        control.ATTITUDE,
        EMPTY,
        100.0,
        replace(COLD_GAS, reference=error),
        q_wanted=np.array([1.0, 0.0, 0.0, 0.0]),
        rng=np.random.default_rng(8),
    )
    # it believes to be right when the truth is off by what the reference is off, the other way round
    expected = -(drawn[0:3] * error.misalignment + drawn[3:6] * error.drift * 100.0)
    assert np.abs(run.error[-50:] - expected).max() < 0.35 * DEG
    assert np.abs(expected).max() > 1.5 * DEG


def test_a_misaligned_reference_does_not_make_a_spinning_vehicle_burn_gas():
    # the axis it believes in wobbles with the spin: nothing to be done about it, and the spin axis is steered
    error = AttitudeReference(misalignment=1.0 * DEG, drift=0.0, roll_scale_factor=0.0)
    skew = replace(COLD_GAS, reference=error)
    used = []
    for cold_gas in (
        replace(COLD_GAS, reference=AttitudeReference(misalignment=0.0, drift=0.0, roll_scale_factor=0.0)),
        skew,
    ):
        x = state(omega_b=(SPIN, 0.0, 0.0))
        misalignment = control.start(cold_gas, np.random.default_rng(8), 0).misalignment
        law, target = turn(42.0 * DEG, 75.0, rotation.quat_from_rotvec(misalignment))
        run = steer(x, law, control.AXIS, STACK, 79.2, cold_gas, rng=np.random.default_rng(8))
        used.append(run.gas_kg)
        assert off_target(x, target) < 0.25 * DEG
    assert used[1] < 1.1 * used[0]
    x = state(omega_b=(SPIN, 0.0, 0.0))
    run = steer(x, still(0.0, 60.0), control.AXIS, STACK, 60.0, skew, rng=np.random.default_rng(8))
    assert run.gas_kg < 0.1  # it turns the spin axis to where it believed its own to be, once
    x = state(omega_b=(SPIN, 0.05, 0.0))
    run = steer(x, still(0.0, 8.0), control.RATES, STACK, 8.0, skew, rng=np.random.default_rng(8))
    assert np.hypot(x[11], x[12]) < 0.15 * DEG


def test_drift_between_tasks_is_that_of_the_ticks():
    rng = np.random.default_rng(2)
    steering = control.start(COLD_GAS, rng, 1000)._replace(
        follow=control.RATES, roll_scale=1e-3, torque_open=np.zeros(3)
    )
    steering.next_s[0], dt = 0.0, 0.02
    x, q, turned = state(omega_b=(SPIN, 0.0, 0.0)), [], []
    for k in range(1000):
        x[6:10] = rotation.quat_from_rotvec(np.array([SPIN * dt * k, 0.0, 0.0]))
        control.command(steering, k * dt, x, *STACK)
        q.append(x[6:10].copy())
        turned.append(x[10:13] * dt)
    by_samples = control.drift_over(
        np.array(q[1:]), np.array(turned[1:]), dt, steering.drift, steering.roll_scale
    )
    assert by_samples == pytest.approx(steering.tilt_i, rel=1e-9)
    # of the spin, the scale factor makes a roll angle: a thousandth of all that was turned
    assert steering.tilt_i[0] == pytest.approx((1e-3 * SPIN + steering.drift[0]) * 999 * dt, rel=1e-9)


def test_errors_of_the_reference_are_drawn_once_and_in_one_order():
    first = control.start(COLD_GAS, np.random.default_rng(3), 0)
    drawn = np.random.default_rng(3).standard_normal(7)
    assert np.array_equal(first.misalignment, drawn[:3] * COLD_GAS.reference.misalignment)
    assert np.array_equal(first.drift, drawn[3:6] * COLD_GAS.reference.drift)
    assert first.roll_scale == drawn[6] * COLD_GAS.reference.roll_scale_factor
    perfect = control.start(COLD_GAS, None, 0)
    assert not perfect.misalignment.any() and not perfect.drift.any() and perfect.roll_scale == 0.0


def test_history_tells_where_the_truth_is():
    x = state(rotation.quat_from_rotvec(np.array([0.0, 0.0, 1.0 * DEG])))
    run = steer(x, still(0.0, 0.1), control.ATTITUDE, EMPTY, 0.1, q_wanted=np.array([1.0, 0.0, 0.0, 0.0]))
    assert run.error[0] == pytest.approx([0.0, 0.0, 1.0 * DEG], abs=1e-12)  # truth = wanted * exp(error)
    spinning = state(rotation.quat_from_rotvec(np.array([0.0, 0.0, 1.0 * DEG])), (SPIN, 0.0, 0.0))
    run = steer(spinning, still(0.0, 0.1), control.AXIS, STACK, 0.1, q_wanted=np.array([1.0, 0.0, 0.0, 0.0]))
    assert run.error[0, 1:] == pytest.approx([0.0, 1.0 * DEG], abs=1e-12)
