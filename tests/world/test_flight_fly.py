"""The chain of sections: staging, devices, other starts than a launch, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from shefex2 import COLD_GAS, DEG, EARTH, PARAMS, PRESCRIBED, PROGRAMME, S40, S44, dwell, part, task
from sounding_rocket import BOX, GAS, ROCKET, SATELLITE, STAGE

from shefex_nav.environment import gravity
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Phase
from shefex_nav.world.flight import params as p
from shefex_nav.world.flight import tasks
from shefex_nav.world.flight.fly import FlightError, fly
from shefex_nav.world.flight.settings import Separation, YoYo


def dropped(stage, at):
    return stage._replace(separation=Separation(at=at, impulse=0.0, tip_off=(0.0, 0.0)))


SEPARATING = STAGE._replace(separation=Separation(at=60.0, impulse=400.0, tip_off=(0.05, -0.08)))


def flown(params, rng=None):
    flight = fly(params, EARTH, rng)
    return flight.trajectory, {event.name: event for event in flight.events}, flight.control


def before_and_after(trajectory, t_s):
    k = int(np.searchsorted(trajectory.t_s, t_s - 1e-9))
    return k - 1, k


def velocity_of_centre(trajectory, k, station):
    """(3,) m/s, inertial, of the centre of mass on the roll axis."""
    lever = np.array([-station, 0.0, 0.0]) - ROCKET.imu_b
    C_ib = rotation.dcm_from_quat(trajectory.q_ib[k])
    return trajectory.v_i[k] + C_ib @ np.cross(trajectory.omega_ib_b[k], lever)


def test_a_rocket_with_a_parachute_that_opens_by_height():
    trajectory, events, control = flown(ROCKET)
    names = ["lift_off", "rail_exit", "burn_out_1", "apogee", "altitude_60km", "altitude_20km", "parachute"]
    assert list(events)[:7] == names and set(list(events)[7:]) == {"max_dynamic_pressure", "impact"}
    assert control is None
    assert 50e3 < events["apogee"].altitude_m < 75e3
    assert events["parachute"].altitude_m == pytest.approx(4000.0, abs=3.0)
    k = before_and_after(trajectory, events["parachute"].t_s)[1]
    assert trajectory.phase[k - 2] == Phase.DESCENT and np.all(trajectory.phase[k:] == Phase.PARACHUTE)
    coasting = (trajectory.t_s > 26.1) & (trajectory.t_s < events["apogee"].t_s)
    assert np.all(trajectory.phase[coasting] == Phase.COAST)
    # at the end the drag carries the weight: m g = rho C_D A v^2 / 2, and the body's own drag is small
    _, v_e = frames.ecef_from_inertial(EARTH, trajectory.t_s[-1], trajectory.r_i[-1], trajectory.v_i[-1])
    assert np.linalg.norm(v_e) == pytest.approx(np.sqrt(2.0 * 245.0 * 9.82 / (1.225 * 20.0)), rel=0.03)


@pytest.mark.parametrize("limit_s", [20.0, 20.04, 20.06, 20.0999])
def test_the_last_sample_is_the_one_before_the_time_limit(limit_s):
    trajectory, _, _ = flown(SATELLITE._replace(time_limit_s=limit_s, programme=()))
    assert np.array_equal(trajectory.t_s, np.arange(201) / 10.0)
    assert all(len(column) == len(trajectory.t_s) and np.isfinite(column).all() for column in trajectory)


def test_a_parachute_that_opens_at_a_time():
    chute = replace(ROCKET.parachute, height=None, at=230.0)
    trajectory, events, _ = flown(ROCKET._replace(parachute=chute))
    assert events["parachute"].t_s == 230.0 < events["impact"].t_s
    assert trajectory.phase[before_and_after(trajectory, 230.0)[1]] == Phase.PARACHUTE


def test_separation_conserves_momentum_and_the_imu_feels_it():
    quiet = ROCKET._replace(stages=(SEPARATING,), sample_rate_hz=400.0)
    trajectory, events, _ = flown(quiet)
    assert events["separation_1"].t_s == 60.0
    a, b = before_and_after(trajectory, 60.0)
    assert (trajectory.mass_kg[a], trajectory.mass_kg[b]) == (245.0, 95.0)
    # at 44 km there is hardly any air: but for gravity the centre of what flies on gains J/m along the axis
    C_ib = rotation.dcm_from_quat(trajectory.q_ib[b])
    dt = 1.0 / 400.0
    gain = C_ib.T @ (velocity_of_centre(trajectory, b, 1.2) - velocity_of_centre(trajectory, a, 1.2))
    assert gain == pytest.approx([400.0 / 95.0, 0.0, 0.0], abs=0.06)  # gravity and drag in a sample: 10 m/s^2
    change = trajectory.omega_ib_b[b] - trajectory.omega_ib_b[a]
    assert change == pytest.approx([0.0, 0.05, -0.08], abs=5e-3)
    felt = C_ib.T @ (trajectory.v_i[b] - trajectory.v_i[a])
    assert trajectory.dv_b[b] == pytest.approx(felt, abs=10.0 * dt)
    assert np.linalg.norm(trajectory.dv_b[b] - trajectory.dv_b[b + 1]) > 4.0
    assert np.linalg.norm(trajectory.r_i[b] - trajectory.r_i[a] - trajectory.v_i[a] * dt) < 1e-3


def test_the_first_stage_may_be_lit_late():
    late = STAGE._replace(t_ignition_s=0.5)
    trajectory, events, _ = flown(ROCKET._replace(stages=(late,)))
    _, usual, _ = flown(ROCKET)
    assert events["lift_off"].t_s == events["ignition_1"].t_s == 0.5
    assert events["rail_exit"].t_s == pytest.approx(usual["rail_exit"].t_s + 0.5, abs=1e-6)
    assert trajectory.phase[before_and_after(trajectory, 0.5)[0]] == Phase.PAD
    assert "ignition_1" not in usual


def test_without_air_an_orbit_closes():
    a = wgs84.A + 650e3
    period = 2.0 * np.pi * np.sqrt(a**3 / SATELLITE.gravity.gm)
    trajectory, events, control = flown(
        SATELLITE._replace(time_limit_s=period, sample_rate_hz=100.0 / period)
    )
    assert len(trajectory.t_s) == 101 and trajectory.t_s[-1] == pytest.approx(period, rel=1e-12)
    assert np.linalg.norm(trajectory.r_i[-1] - trajectory.r_i[0]) < 0.5
    assert np.linalg.norm(trajectory.v_i[-1] - trajectory.v_i[0]) < 5e-4
    radius = np.linalg.norm(trajectory.r_i, axis=1)
    assert radius.min() == pytest.approx(wgs84.A + 400e3, rel=2e-4)
    assert radius.max() == pytest.approx(wgs84.A + 900e3, rel=2e-4)
    normal = np.cross(trajectory.r_i[0], trajectory.v_i[0])
    assert normal[2] / np.linalg.norm(normal) == pytest.approx(np.cos(63.0 * DEG), abs=1e-6)
    ascending = np.cross([0.0, 0.0, 1.0], normal)
    assert np.arctan2(ascending[1], ascending[0]) == pytest.approx(40.0 * DEG, abs=1e-6)
    assert np.all(trajectory.phase == Phase.ORBIT)
    assert not events and control is None


def test_a_satellite_starts_along_its_velocity_at_rest():
    trajectory, _, _ = flown(SATELLITE._replace(time_limit_s=30.0))
    C_ib = rotation.dcm_from_quat(trajectory.q_ib[0])
    v, r = trajectory.v_i[0], trajectory.r_i[0]
    assert C_ib[:, 0] == pytest.approx(v / np.linalg.norm(v), abs=1e-12)
    assert C_ib[:, 2] @ r < -0.99 * np.linalg.norm(r) and abs(C_ib[:, 1] @ r) < 1e-6 * np.linalg.norm(r)
    assert np.abs(trajectory.omega_ib_b).max() < 1e-12
    assert len(trajectory.t_s) == 301 and trajectory.t_s[-1] == pytest.approx(30.0, abs=1e-12)
    # the point that flies on Kepler's orbit is the centre of mass
    centre = r + C_ib @ (np.array([-0.5, 0.0, 0.0]) - SATELLITE.imu_b)
    p_m = 2.0 * (wgs84.A + 900e3) * (wgs84.A + 400e3) / (2.0 * wgs84.A + 1300e3)
    e = 500e3 / (2.0 * wgs84.A + 1300e3)
    assert np.linalg.norm(centre) == pytest.approx(p_m / (1.0 + e * np.cos(20.0 * DEG)), abs=1e-6)


def test_a_satellite_points_and_holds():
    programme = (
        ("slew", task(tasks.Point, 10.0, 210.0, azimuth=1.0, elevation=0.8, roll=0.2)),
        ("pointing", dwell(210.0, 500.0)),
    )
    trajectory, events, control = flown(SATELLITE._replace(programme=programme))
    assert list(events) == ["slew_start", "slew_end", "pointing_start", "pointing_end"]
    marks = [(5.0, Phase.ORBIT), (10.0, Phase.MANOEUVRE), (300.0, Phase.POINTING), (500.1, Phase.ORBIT)]
    for t_s, phase in marks:
        assert trajectory.phase[round(10.0 * t_s)] == phase
    holding = control.t_s > 230.0
    assert np.abs(control.pointing_error[holding]).max() < 0.3 * DEG
    C_ei = frames.dcm_ie(EARTH, 210.0).T
    latitude, longitude, _ = wgs84.geodetic_from_ecef(C_ei @ trajectory.r_i[2100])
    u_n = wgs84.dcm_en(latitude, longitude).T @ C_ei
    u_n = u_n @ rotation.dcm_from_quat(trajectory.q_ib[2100]) @ SATELLITE.C_bc[:, 2]
    assert np.arcsin(-u_n[2]) == pytest.approx(0.8, abs=1.0 * DEG)


@pytest.mark.parametrize(
    ("apogee_height", "eccentricity"), [(400e3, 0.0), (900e3, 500e3 / (2.0 * wgs84.A + 1300e3))]
)
def test_a_satellite_that_turns_with_its_orbit_keeps_one_side_to_the_earth(apogee_height, eccentricity):
    period = 2.0 * np.pi * np.sqrt((wgs84.A + (400e3 + apogee_height) / 2.0) ** 3 / SATELLITE.gravity.gm)
    orbit = replace(SATELLITE.start, perigee_height=400e3, apogee_height=apogee_height, anomaly=0.0)
    programme = (("nadir", task(tasks.TurnWithOrbit, 0.0, period, ramp=5.0)),)
    trajectory, _, _ = flown(
        SATELLITE._replace(
            programme=programme, start=orbit, attitude=p.PRESCRIBED, time_limit_s=period - 10.0
        )
    )
    t_s = trajectory.t_s[trajectory.t_s > 10.0]
    mean = 2.0 * np.pi * t_s / period
    lag = 2.5 * 2.0 * np.pi / period  # half a fade
    ahead = true_anomaly(mean, eccentricity) - mean + lag
    assert nadir_ahead(trajectory)[trajectory.t_s > 10.0] == pytest.approx(ahead, abs=1e-4)


def test_cold_gas_turns_a_satellite_with_its_orbit():
    programme = (("nadir", task(tasks.TurnWithOrbit, 0.0, 600.0, ramp=20.0)),)
    trajectory, _, control = flown(SATELLITE._replace(programme=programme, time_limit_s=500.0))
    holding = control.t_s > 60.0
    assert np.abs(control.pointing_error[holding]).max() < 0.3 * DEG
    rates = np.linalg.norm(trajectory.omega_ib_b[trajectory.t_s > 60.0], axis=1)
    period = 2.0 * np.pi * np.sqrt((wgs84.A + 650e3) ** 3 / SATELLITE.gravity.gm)
    assert rates.mean() == pytest.approx(2.0 * np.pi / period, rel=0.2)


@pytest.mark.parametrize(
    ("params", "seconds", "message"),
    [(SATELLITE, 9.0, "ramp .* does not fit"), (ROCKET, 60.0, "does not start in one")],
)
def test_a_turn_with_the_orbit_that_cannot_be(params, seconds, message):
    programme = (("nadir", task(tasks.TurnWithOrbit, 100.0, 100.0 + seconds, ramp=5.0)),)
    with pytest.raises(ValueError, match=message):
        flown(params._replace(programme=programme, attitude=p.PRESCRIBED))


def test_an_oblate_earth_does_not_carry_the_nadir_away():
    """One revolution later the Earth is where it was, from a start over the equator as over the pole."""
    period = 2.0 * np.pi * np.sqrt((wgs84.A + 505e3) ** 3 / SATELLITE.gravity.gm)
    for perigee in (0.0, 90.0 * DEG):
        orbit = replace(
            SATELLITE.start, perigee_height=500e3, apogee_height=510e3, inclination=97.4 * DEG,
            perigee=perigee, anomaly=0.0,
        )  # fmt: skip
        nadir = task(tasks.TurnWithOrbit, 0.0, 2.2 * period, ramp=5.0)
        trajectory, _, _ = flown(
            SATELLITE._replace(
                programme=(("nadir", nadir),), start=orbit, attitude=p.PRESCRIBED,
                gravity=gravity.load("j2"), time_limit_s=2.1 * period,
            )
        )  # fmt: skip
        one, two = (int(np.searchsorted(trajectory.t_s, k * period)) for k in (1, 2))
        ahead = nadir_ahead(trajectory)
        assert abs(ahead[two] - ahead[one]) < 0.05 * DEG


def test_a_satellite_comes_back_to_the_earth_from_a_star():
    period = 2.0 * np.pi * np.sqrt((wgs84.A + 400e3) ** 3 / SATELLITE.gravity.gm)
    orbit = replace(SATELLITE.start, perigee_height=400e3, apogee_height=400e3)
    programme = (
        ("star", task(tasks.PointInertial, 0.0, 60.0, right_ascension=1.2, declination=0.9, roll=0.5)),
        ("back", task(tasks.PointNadir, 200.0, 300.0)),
        ("nadir", task(tasks.TurnWithOrbit, 300.0, 1000.0, ramp=5.0)),
    )
    trajectory, _, _ = flown(
        SATELLITE._replace(programme=programme, start=orbit, attitude=p.PRESCRIBED, time_limit_s=990.0)
    )
    ahead = nadir_ahead(trajectory)
    assert abs(ahead[trajectory.t_s == 200.0][0]) > 0.5
    assert ahead[trajectory.t_s == 300.0][0] == pytest.approx(0.0, abs=1e-6)
    lag = 2.5 * 2.0 * np.pi / period  # half a fade
    kept = trajectory.t_s > 305.0
    assert ahead[kept] == pytest.approx(lag, abs=1e-5)
    for q, r, v in zip(trajectory.q_ib[kept], trajectory.r_i[kept], trajectory.v_i[kept], strict=True):
        C_ib = rotation.dcm_from_quat(q)
        assert abs(C_ib[:, 1] @ r) < 1e-5 * wgs84.A and C_ib[:, 0] @ v > 0.99999 * np.linalg.norm(v)


def nadir_ahead(trajectory):
    """Angle from body z to the Earth's centre, positive as the orbit turns; (N,) rad."""
    seen = [rotation.dcm_from_quat(q).T @ -r for q, r in zip(trajectory.q_ib, trajectory.r_i, strict=True)]
    x, _, z = np.transpose(seen)
    return np.arctan2(-x, z)


def true_anomaly(mean, eccentricity):
    """By Kepler's equation, rad, without jumps."""
    angle = mean.copy()
    for _ in range(30):
        angle = mean + eccentricity * np.sin(angle)
    root = np.sqrt((1.0 + eccentricity) / (1.0 - eccentricity))
    return np.unwrap(2.0 * np.arctan(root * np.tan(angle / 2.0)), period=2.0 * np.pi)


def test_a_kick_motor_in_orbit_gives_what_the_rocket_equation_says():
    kick = STAGE._replace(
        t_ignition_s=20.0,
        dry=part(20.0, 1.2, 1.0, 2.0),
        propellant=STAGE.propellant._replace(station_m=np.full(33, 1.2)),
    )
    trajectory, events, _ = flown(SATELLITE._replace(stages=(kick,), time_limit_s=60.0))
    assert list(events) == ["ignition_1", "burn_out_1"]
    assert (trajectory.burning[300], trajectory.phase[300]) == (1, Phase.BOOST)
    assert (trajectory.burning[470], trajectory.phase[470]) == (0, Phase.ORBIT)
    gained = trajectory.dv_b.sum(axis=0)
    assert gained[0] == pytest.approx(235.0 * 9.80665 * np.log(390.0 / 100.0), rel=1e-6)
    assert trajectory.mass_kg[-1] == pytest.approx(100.0, abs=1e-6)


def test_a_box_on_the_ground_stands_still():
    trajectory, events, control = flown(BOX)
    assert not events and control is None
    assert len(trajectory.t_s) == 2001 and np.all(trajectory.phase == Phase.GROUND)
    for k in (0, 1000, 2000):
        r_e, v_e = frames.ecef_from_inertial(EARTH, trajectory.t_s[k], trajectory.r_i[k], trajectory.v_i[k])
        assert np.allclose(r_e, wgs84.ecef_from_geodetic(48.0 * DEG, 11.0 * DEG, 500.0), atol=1e-8)
        assert np.linalg.norm(v_e) < 1e-9
    assert np.linalg.norm(trajectory.f_b[0]) == pytest.approx(9.807, abs=0.015)
    assert np.allclose(trajectory.dv_b[1:], trajectory.f_b[0] / 100.0, atol=1e-12)
    assert np.all(trajectory.mass_kg == 80.0)


def test_an_empty_tank_is_an_event():
    programme = (("turn", task(tasks.Turn, 70.0, 110.0, azimuth=1.0, elevation=0.5, at=110.0)),)
    little = ROCKET._replace(
        stages=(SEPARATING,), programme=programme, cold_gas=replace(GAS, propellant=0.02)
    )
    _, events, control = flown(little)
    assert 70.0 < events["cold_gas_empty"].t_s < 110.0
    assert control.propellant_kg[-1] == pytest.approx(0.02, rel=1e-9)
    assert np.all(control.torque_b[control.t_s > events["cold_gas_empty"].t_s + 0.1] == 0.0)
    _, events, _ = flown(little._replace(cold_gas=replace(GAS, propellant=5.0)))
    assert "cold_gas_empty" not in events


def test_the_yo_yo_works_while_a_task_is_flown_too():
    yo_yo = YoYo(at=100.0, mass=0.3, cord_length=4.0, radius=0.178)
    programme = (("damping", task(tasks.Damp, 95.0, 105.0)),)
    trajectory, events, _ = flown(ROCKET._replace(yo_yo=yo_yo, programme=programme))
    i, _ = before_and_after(trajectory, 100.0)
    i_roll, r2 = 1.3 + 4.0, 0.178**2
    before = trajectory.omega_ib_b[i, 0]
    after = trajectory.omega_ib_b[before_and_after(trajectory, events["yo_yo_off"].t_s)[1], 0]
    big_k = r2 + i_roll / 0.3
    assert after / before == pytest.approx((big_k - 16.0) / (big_k + 16.0), abs=2e-3)


def test_errors_of_the_reference_do_not_touch_what_is_not_steered():
    first, _, _ = flown(ROCKET, np.random.default_rng(1))
    second, _, _ = flown(ROCKET, np.random.default_rng(2))
    assert np.array_equal(first.r_i, second.r_i)


SLEW = (("slew", task(tasks.Point, 70.0, 80.0, azimuth=0.0, elevation=0.5, roll=0.0)),)
STEERED = ROCKET._replace(stages=(SEPARATING,), programme=(("hold", task(tasks.Hold, 100.0, 120.0)),))


@pytest.mark.parametrize(
    ("params", "message"),
    [
        (PARAMS._replace(time_limit_s=420.0, sample_rate_hz=100.0), "in the air"),
        (PARAMS._replace(payload=replace(PARAMS.payload, mass=30e3), sample_rate_hz=50.0), "on the rail"),
        (ROCKET._replace(stages=(dropped(STAGE, 900.0),)), "before separation_1"),
        (
            STEERED._replace(programme=(("hold", task(tasks.Hold, 500.0, 1400.0)),), parachute=None),
            "ground .* before hold",
        ),
        (
            ROCKET._replace(yo_yo=YoYo(at=0.0, mass=0.3, cord_length=4.0, radius=0.2)),
            "yo-yo .* does not spin",
        ),
        (  # its law is that of one body, whose inertia the stage takes with it
            ROCKET._replace(
                stages=(dropped(STAGE, 100.1),), yo_yo=YoYo(at=100.0, mass=0.3, cord_length=4.0, radius=0.178)
            ),
            "separation_1 .* while the yo-yo unwinds, until T.10",
        ),
        (
            STEERED._replace(
                attitude=p.PRESCRIBED,
                programme=SLEW,
            ),
            "spins with .* when slew",
        ),
        (
            ROCKET._replace(attitude=p.PRESCRIBED, programme=(("hold", task(tasks.Hold, 233.0, 236.5)),)),
            "height of its para",
        ),
        (
            STEERED._replace(
                attitude=p.PRESCRIBED, parachute=None, programme=(("hold", task(tasks.Hold, 100.0, 900.0)),)
            ),
            "hits the ground",
        ),
    ],
)
def test_flights_that_cannot_go_on(params, message):
    with pytest.raises(FlightError, match=message):
        fly(params, EARTH)


def tasks_with(name, **changes):
    return tuple((one, replace(t, **changes) if one == name else t) for one, t in PROGRAMME)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        (
            PARAMS._replace(stages=(S40, S44._replace(t_ignition_s=60.0))),
            "S44.*before the separation of S40M",
        ),
        (PARAMS._replace(stages=(S40._replace(separation=None), S44)), "S44.*separation of S40M"),
        (PARAMS._replace(stages=(dropped(S40, 50.0), S44)), "before its burn-out"),
        (PARAMS._replace(stages=(S40, dropped(S44, 230.0))), "no aerodynamic coefficients"),
        (PARAMS._replace(stages=()), "nothing burns"),
        (PARAMS._replace(cold_gas=None), "no cold gas"),
        (
            PARAMS._replace(programme=tasks_with("slew", start=230.0)),
            "slew starts at 230.0 s, before despin ends",
        ),
        (PARAMS._replace(programme=tasks_with("slew", end=235.0)), "slew ends at 235.0 s, not after"),
        (PARAMS._replace(programme=tasks_with("pointing", cross_rate=0.01)), "pointing: .* need a ramp"),
        (
            PARAMS._replace(programme=tasks_with("pointing", cross_rate=0.01, ramp=70.0)),
            "ramp .* does not fit twice",
        ),
        (PARAMS._replace(t_start_s=1.0), "after lift-off"),
        (PARAMS._replace(time_limit_s=380.0), "entry_slew_end .* after time_limit_s"),
        (PARAMS._replace(cold_gas=replace(COLD_GAS, bandwidth=30.0)), "too slow for a bandwidth"),
        (PARAMS._replace(time_limit_s=-20.0), "time_limit_s"),
        (PARAMS._replace(yo_yo=replace(PARAMS.yo_yo, at=-5.0)), "yo_yo .* before the start"),
        (BOX._replace(stages=(STAGE,)), "stands on the ground"),
        (ROCKET._replace(stages=(STAGE._replace(t_ignition_s=-0.5),)), "ignition at -0.5 s"),
        (SATELLITE._replace(payload_aerodynamics=None), "no aerodynamic coefficients"),
    ],
)
def test_parameters_in_contradiction_are_refused(params, message):
    with pytest.raises(ValueError, match=message):
        fly(params, EARTH)


def test_prescribed_needs_no_cold_gas():
    flight = fly(PRESCRIBED._replace(cold_gas=None, sample_rate_hz=50.0), EARTH)
    assert flight.control is None
    assert {event.name for event in flight.events} >= {"pointing_start", "impact"}
