"""The student rocket with a barometer and a receiver without height, until it leaves the dense air."""

import numpy as np
import pytest

from shefex_nav import prepare, simulate
from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, wgs84
from shefex_nav.log import reader, writer
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.records import GateResult, NavSolution
from shefex_nav.replay import rerun, smooth
from shefex_nav.report import figures
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors
from shefex_nav.scenario import load

UNTIL_S = 36.0


@pytest.fixture(scope="module")
def flown():
    scenario = load.load(load.file_of("baro_2d_gps"))
    world = prepare.build_world(scenario, 3)
    mission = prepare.mission(scenario, 3, world.flight.trajectory)
    return mission, list(simulate.route(world, scenario, 3, until_s=UNTIL_S))


def data_of(flown):
    mission, records = flown
    builder = RunDataBuilder(mission)
    for record in records:
        builder.add(record)
    return builder.build()


def test_the_receiver_says_latitude_and_longitude_alone(flown):
    data = data_of(flown)
    valid = [fix for fix in data.gps if fix.valid]
    assert len(valid) > 20
    for fix in valid:
        latitude, longitude, height = wgs84.geodetic_from_ecef(fix.r_ea_e)
        assert fix.horizontal and abs(height) < 1e-6 and np.isnan(fix.v_ea_e).all()
        R_n = wgs84.dcm_en(latitude, longitude).T @ fix.R_r_e @ wgs84.dcm_en(latitude, longitude)
        assert R_n[0, 0] > 0.5 and abs(R_n[2, 2]) < 1e-9


def test_height_stays_inside_its_sigma_and_readings_are_used_where_they_may_be(flown):
    data = data_of(flown)
    errors = navigation_errors(data)
    _, nees, _ = normalised_errors(data, errors)
    assert 3.0 < nees.mean() < 20.0  # of 9
    k = np.searchsorted(errors.t_s, data.covariance.t_s - 1e-6).clip(0, len(errors.t_s) - 1)
    for n in range(0, len(k), 20):
        now_s, r_i = data.covariance.t_s[n], data.truth.r_i[k[n]]
        up_i = r_i / np.linalg.norm(r_i)
        sigma = np.sqrt(up_i @ data.covariance.P[n, :3, :3] @ up_i)
        assert abs(up_i @ errors.position_i[k[n]]) < 4.0 * sigma, now_s
    gates = [gate for gate in data.gates if gate.sensor == "barometer"]
    notes = {gate.note.split(" ")[2] if gate.note else "" for gate in gates}
    assert {"", "Mach"} < notes <= {"", "Mach", "above", "the"}  # 'not used: the sensor is at an end of ...'
    assert all(gate.accepted == (not gate.note) for gate in gates)
    assert {gate.dof for gate in data.gates if gate.sensor == "gps_position"} == {0, 2}


@pytest.mark.slow
def test_a_log_with_a_barometer_gives_the_same_solution_again(flown, tmp_path):
    mission, records = flown
    path = tmp_path / "flight.mcap"
    with writer.LogWriter(path, mission, FramePolicy(0, "none", 4.0)) as log:
        for record in records:
            log.write(record)
    data, again = reader.read(path), list(rerun.run(path))
    assert len(data.readings["barometer"].t_valid_s) == 10 * (10 + UNTIL_S) - 1
    told = [record for record in again if type(record) is NavSolution]
    np.testing.assert_array_equal([one.r_i for one in told], data.nav.r_i)
    notes = [record.note for record in again if type(record) is GateResult]
    assert notes == [gate.note for gate in data.gates]
    smoothed = smooth.run(rerun.open_log(path))
    before, after = (navigation_errors(one).position_i for one in (smoothed.filtered, smoothed.smoothed))
    assert np.sqrt(np.mean(after**2)) < 1.05 * np.sqrt(np.mean(before**2))
    assert figures.draw("barometer", data) is not None


def test_on_the_pad_the_pressure_altitude_is_off_by_the_day_and_the_sensor(flown):
    data = data_of(flown)
    said = data.readings["barometer"]
    h = atmosphere.pressure_height(said.pressure[said.t_valid_s < 0.0])
    r_e = frames.dcm_ie(data.mission.earth, -5.0).T @ data.truth.r_i[500]
    assert 1.0 < abs(h.mean() - wgs84.geodetic_from_ecef(r_e)[2]) < 250.0
    assert h.std() < 2.0


def test_the_filter_remembers_as_far_back_as_readings_come_late():
    """A second, which is longer than a fix of the receiver is late."""
    scenario = load.load(load.file_of("baro_2d_gps"), ["barometer.latency=1 s"])
    world = prepare.build_world(scenario, 3)
    given = simulate.route(world, scenario, 3, until_s=-2.0)
    gates = [one for one in given if isinstance(one, GateResult) and one.sensor == "barometer"]
    used = [gate.accepted for gate in gates if gate.note != "not after the start of the filter"]
    assert len(used) > 50 and all(used)
