"""The log of the default mission as a trajectory: the same truth, and the same filter does as well."""

import numpy as np
import pytest

from shefex_nav import prepare, runs
from shefex_nav.geometry import rotation
from shefex_nav.records import Phase
from shefex_nav.scenario import load


@pytest.fixture(scope="module")
def along(default_run, default_scenario, tmp_path_factory):
    """Scenario of the default's sensors and software along the default's log."""
    file = tmp_path_factory.mktemp("own") / "own.yaml"
    section = f"{{file: {default_run.log}, format: log, pad: 0.1 s, separations: [65 s]}}"
    nothing = "launch: null\nvehicle: null\nprogramme: null\n"
    head = f"extends: {default_scenario}\nmission: {{name: own_log}}\n"
    file.write_text(f"{head}{nothing}trajectory: {section}\n")
    return load.load(file)


@pytest.fixture(scope="module")
def again(along, tmp_path_factory):
    return runs.fly(along, 1, log=tmp_path_factory.mktemp("again") / "own.mcap")


@pytest.mark.slow
def test_truth_is_that_of_the_log(again, default_data):
    was, now = default_data.truth, again.truth
    assert np.allclose(was.t_s, now.t_s, atol=1e-9) and len(was.t_s) == len(now.t_s)
    assert np.linalg.norm(was.r_i - now.r_i, axis=1).max() < 1e-6
    assert np.linalg.norm(was.v_i - now.v_i, axis=1).max() < 1e-6
    tilt = rotation.rotvec_between(was.q_ib, now.q_ib)
    assert np.linalg.norm(tilt, axis=1).max() < 1e-9
    forces = np.linalg.norm(was.f_b - now.f_b, axis=1)
    rates = np.linalg.norm(was.omega_ib_b - now.omega_ib_b, axis=1)
    smooth = np.isin(was.phase, (Phase.BOOST, Phase.DESCENT))  # no valves, which jump between two rows
    assert np.quantile(forces[smooth], 0.99) < 2e-4 and np.quantile(rates[smooth], 0.99) < 1e-6
    assert np.quantile(forces, 0.99) < 0.1 and np.quantile(rates, 0.99) < 1e-3
    assert forces.max() < 2.0 and rates.max() < 0.05  # the end of the rail, a yo-yo
    assert np.array_equal(was.phase, now.phase)


def test_between_its_rows_it_is_the_flight(along, default_scenario):
    """The flight that was logged has four samples a row; the curves are at those between as well."""
    was = prepare.fly_vehicle(load.load(default_scenario), 1).trajectory
    now = prepare.fly_vehicle(along, 1).trajectory
    n = len(now.t_s)
    assert np.linalg.norm(was.r_i[:n] - now.r_i, axis=1).max() < 1e-3
    assert np.linalg.norm(was.v_i[:n] - now.v_i, axis=1).max() < 1e-2
    tilt = rotation.rotvec_between(was.q_ib[:n], now.q_ib)
    assert np.linalg.norm(tilt, axis=1).max() < 1e-5
    gained = np.abs(np.cumsum(was.dv_b[:n] - now.dv_b, axis=0)).max()
    assert gained < 1e-3
    assert np.array_equal(was.burning[:n], now.burning)


@pytest.mark.slow
def test_events_are_those_of_the_log(again, default_data):
    was = {event.name: event.t_s for event in default_data.events}
    now = {event.name: event.t_s for event in again.events}
    assert set(now) <= set(was) and {"lift_off", "burn_out_2", "separation_1", "apogee", "entry"} <= set(now)
    assert all(now[name] == pytest.approx(was[name], abs=1e-9) for name in now)


@pytest.mark.slow
def test_the_filter_does_as_well(again, default_run):
    """Its errors are those of the flown mission but for quanta of the sensors that fall otherwise."""
    was, now = runs.open_run(default_run.log).errors(), again.errors()
    assert len(was.t_s) == len(now.t_s)
    assert np.linalg.norm(was.position_i - now.position_i, axis=1).max() < 0.1
    assert np.linalg.norm(was.velocity_i - now.velocity_i, axis=1).max() < 0.02
    for name, unit in (
        ("position_error_m", 1e-2),
        ("velocity_error_m_s", 1e-3),
        ("attitude_error_deg", 1e-2),
    ):
        flown, along = (one["navigation"][name]["rms"] for one in (default_run.summary, again.summary()))
        assert along == pytest.approx(flown, abs=unit), name


def test_a_part_of_a_log_has_the_events_of_that_part(along, again):
    part = along.with_sections(mission=along.mission.model_copy(update={"time_limit": 390.0}))
    flight, whole = prepare.fly_vehicle(part, 1), {event.name: event for event in again.data.events}
    assert flight.trajectory.t_s[-1] == 390.0
    found = {event.name: event for event in flight.events}
    assert "apogee" in found and not {"entry", "altitude_20km", "impact"} & set(found)
    for name, event in found.items():
        assert event.t_s <= 390.0 and abs(event.altitude_m - whole[name].altitude_m) < 1e-3
