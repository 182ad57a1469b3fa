"""A flight of RocketPy, exported by RocketPy itself, felt by an inertial unit without errors."""

import numpy as np
import pytest
from given_flight import at, dead_reckoning, scenario
from imu_settings import PERFECT

from shefex_nav import prepare
from shefex_nav.geometry import frames, wgs84
from shefex_nav.scenario import surroundings
from shefex_nav.world import imu

rocketpy = pytest.importorskip("rocketpy", reason="RocketPy is not installed: pip install rocketpy")
PLACE, HEIGHT_M = (69.2942, 16.0190), 42.0
NAMES = ("x", "y", "z", "vx", "vy", "vz", "e0", "e1", "e2", "e3")


def flight():
    """A student rocket with canted fins, a drogue at the apogee and a main parachute."""
    environment = rocketpy.Environment(latitude=PLACE[0], longitude=PLACE[1], elevation=HEIGHT_M)
    environment.set_atmospheric_model(type="standard_atmosphere")
    motor = rocketpy.SolidMotor(
        thrust_source=[[0, 0], [0.02, 2200], [3.6, 1800], [3.9, 0]], dry_mass=1.8, burn_time=3.9,
        dry_inertia=(0.125, 0.125, 0.002), nozzle_radius=0.033, throat_radius=0.011, nozzle_position=0,
        grain_number=5, grain_density=1815, grain_outer_radius=0.033, grain_initial_inner_radius=0.015,
        grain_initial_height=0.12, grain_separation=0.005, grains_center_of_mass_position=0.397,
        center_of_dry_mass_position=0.317, coordinate_system_orientation="nozzle_to_combustion_chamber",
    )  # fmt: skip
    rocket = rocketpy.Rocket(
        radius=0.0635, mass=14.4, inertia=(6.32, 6.32, 0.034), power_off_drag=0.45, power_on_drag=0.42,
        center_of_mass_without_motor=0, coordinate_system_orientation="tail_to_nose",
    )  # fmt: skip
    rocket.add_motor(motor, position=-1.255)
    rocket.set_rail_buttons(0.0818, -0.618, 45)
    rocket.add_nose(length=0.558, kind="vonKarman", position=1.278)
    rocket.add_trapezoidal_fins(
        n=4, root_chord=0.12, tip_chord=0.06, span=0.11, position=-1.05, cant_angle=0.3
    )
    rocket.add_parachute("drogue", cd_s=0.6, trigger="apogee", sampling_rate=105, lag=1.5, noise=(0, 0, 0))
    rocket.add_parachute("main", cd_s=6.0, trigger=400, sampling_rate=105, lag=1.5, noise=(0, 0, 0))
    return rocketpy.Flight(
        rocket=rocket, environment=environment, rail_length=5.2, inclination=84, heading=20, max_time_step=0.5
    )


def test_an_imu_without_errors_integrates_back_to_it(tmp_path):
    made, file = flight(), tmp_path / "rocketpy.csv"
    exporter = getattr(made, "export_data", None)  # of RocketPy before 1.11
    if exporter is None:
        from rocketpy.simulation.flight_data_exporter import FlightDataExporter

        exporter = FlightDataExporter(made).export_data
    exporter(str(file), *NAMES)
    place = {"latitude": f"{PLACE[0]} deg", "longitude": f"{PLACE[1]} deg"}
    one = scenario({"file": file, "format": "rocketpy", "origin": place})
    earth, flown = prepare.earth_rotation(one), prepare.fly_vehicle(one, 1)
    t = flown.trajectory

    rows = np.loadtxt(file, delimiter=",")
    C_el, r_0 = wgs84.dcm_el(*np.radians(PLACE)), wgs84.ecef_from_geodetic(*np.radians(PLACE), 0.0)
    felt = imu.measure(PERFECT, t, np.random.default_rng(1))
    r_i, _ = dead_reckoning(t, t.t_s, (felt.dtheta_b, felt.dv_b), earth, surroundings.gravity(one))
    assert np.linalg.norm(r_i - t.r_i, axis=1).max() < 0.1
    inside = rows[:, 0] < t.t_s[-1]
    k = at(t, rows[inside, 0])
    near = np.abs(t.t_s[k] - rows[inside, 0]) < 1.0  # the sample after a row: its place at the row's instant
    v_i, away = t.v_i[k], t.t_s[k] - rows[inside, 0]
    there_i = r_i[k] - away[:, None] * v_i
    there_e = np.einsum("kji,kj->ki", frames.dcms_ie(earth, rows[inside, 0]), there_i)
    off = np.linalg.norm((there_e - r_0) @ C_el - rows[inside, 1:4], axis=1)
    assert near.all() and off.max() < 1.0

    names = {event.name: event.t_s for event in flown.events}
    assert names["apogee"] == pytest.approx(made.apogee_time, abs=0.1)
    assert names["burn_out_1"] == pytest.approx(3.9, abs=0.1)
    assert names["impact"] == pytest.approx(made.t_final, abs=0.01)
    climbs = (t.t_s > 1.0) & (t.t_s < 3.5)
    assert np.degrees(np.median(t.angle_of_attack[climbs])) < 1.0  # body axes and sense are RocketPy's
    assert np.median(t.omega_ib_b[climbs, 0]) == pytest.approx(
        np.median(made.w3(t.t_s[climbs])), rel=0.01
    )  # it turns the way RocketPy says
