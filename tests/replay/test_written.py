"""What a flight measured, written as loggers have it, is read back by a replay as it was."""

import json

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from shefex_nav import runs
from shefex_nav.commands.app import app
from shefex_nav.geometry import wgs84
from shefex_nav.replay import dataset, load
from shefex_nav.replay import written as measured
from shefex_nav.scenario import load as missions

UNTIL_S = 8.0
MAGNETOMETER = "{rate: 20 Hz, hard_iron: 500 nT, soft_iron: 0.3 %, noise: 50 nT}"
STATES = "gyro_scale, gyro_misalignment, gyro_g_sensitivity, accel_scale, accel_misalignment"
FLIGHTS = {
    "fixes": (
        "rexus_like",
        [
            f"magnetometer={MAGNETOMETER}",
            f"navigation.states=[{STATES}, hard_iron]",
            "navigation.told.imu.gyro.bias=7 deg/h",
        ],
    ),
    "barometer": ("baro_2d_gps", []),
}


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(request, tmp_path_factory):
    """(RunData, folder) of a flight that has been written."""
    folder = tmp_path_factory.mktemp(request.param) / "measured"
    name, overrides = FLIGHTS[request.param]
    flown = runs.fly(missions.load(missions.file_of(name), overrides), 3, until_s=UNTIL_S)
    measured.write(flown.data, folder)
    return flown.data, folder


@pytest.fixture
def read(flight):
    data, folder = flight
    scenario, files = load.load(str(folder / measured.REPLAY))
    return data, scenario, dataset.read(scenario, files)


def test_increments_are_those_of_the_flight(read):
    """All but the first, which nothing says the beginning of."""
    data, _, back = read
    assert len(back.imu.t_s) == data.imu.dtheta_b.size // 3 and not back.imu.bridged.any()
    np.testing.assert_allclose(back.imu.dtheta_b[1:], data.imu.dtheta_b.reshape(-1, 3)[1:], atol=1e-15)
    np.testing.assert_allclose(back.imu.dv_b[1:], data.imu.dv_b.reshape(-1, 3)[1:], atol=1e-12)
    last_s = data.imu.t_valid_s[-1] - data.imu.t_valid_s[0]
    assert back.imu.t_s[-1] == pytest.approx(last_s + 3 * 0.0025, abs=1e-9)


def test_fixes_are_those_of_the_flight(read):
    data, scenario, back = read
    first_s = data.imu.t_valid_s[0] - 3 * 0.0025
    was = [fix for fix in data.gps if fix.valid and fix.t_valid_s >= first_s]
    found = [fix for fix in back.fixes if fix.valid]
    assert len(was) == len(found) > 10
    for one, again in zip(was, found, strict=True):
        assert again.t_valid_s == pytest.approx(one.t_valid_s - first_s, abs=1e-9)
        C_ne = wgs84.level_axes(one.r_ea_e).T
        axes = slice(0, 2 if one.horizontal else 3)
        np.testing.assert_allclose((C_ne @ (one.r_ea_e - again.r_ea_e))[axes], 0.0, atol=1e-3)
        R, R_again = C_ne @ one.R_r_e @ C_ne.T, C_ne @ again.R_r_e @ C_ne.T
        np.testing.assert_allclose(np.diag(R_again)[axes], np.diag(R)[axes], rtol=1e-6)
        np.testing.assert_allclose(again.v_ea_e, one.v_ea_e, atol=1e-9)
    assert scenario.gnss.latency == 0.2 and scenario.gnss.lever_arm == (0.6, 0.05, -0.03)


def test_readings_are_those_of_the_flight(read):
    data, _, back = read
    assert [name for name, records in back.readings.items() if records] == [
        name for name in ("barometer", "magnetometer") if len(data.readings[name].t_valid_s)
    ]
    if "barometer" in back.readings:
        found = [one.pressure for one in back.readings["barometer"]]
        np.testing.assert_allclose(found, data.readings["barometer"].pressure, rtol=1e-12)
    else:
        found = [one.field_b for one in back.readings["magnetometer"]]
        np.testing.assert_allclose(found, data.readings["magnetometer"].field_b, rtol=1e-12)


def test_the_replay_knows_what_the_computer_on_board_was_told(flight):
    data, folder = flight
    said = yaml.safe_load((folder / measured.REPLAY).read_text())
    told = data.mission.scenario == "rexus_like"
    assert said["imu"]["gyro"]["bias"] == ("7 deg/h" if told else "0.5 deg/h")
    assert "told" not in said["navigation"] and said["imu"]["vibration"]["boost"] == ["7 gee"]


def test_the_replay_navigates_as_the_flight_did(flight):
    """The same measurements and assumptions, but for the vibration: its errors are within their sigmas."""
    _, folder = flight
    log = folder / "replayed.mcap"
    done = CliRunner().invoke(app, ["replay", str(folder / measured.REPLAY), "--log", str(log)])
    assert done.exit_code == 0, done.output
    again = runs.open_run(log)
    sigma = np.sqrt(np.diag(again.data.covariance.P[-1])[:3])
    assert (np.abs(again.errors().position_i[-1]) < 4.0 * sigma).all() and sigma.max() < 20.0


def test_logs_that_hold_no_whole_measurements_are_refused(tmp_path):
    thin = missions.load(missions.file_of("rexus_like"), ["log.rate=10 Hz"])
    flown = runs.fly(thin, 1, until_s=2.0, log=tmp_path / "thin.mcap")
    with pytest.raises(measured.NoDataError, match=r"every sample of the IMU; fly it with log.rate: 100 Hz"):
        measured.write(flown.data, tmp_path / "no")
    assert not (tmp_path / "no").exists()
    told = CliRunner().invoke(app, ["export", str(tmp_path / "thin.mcap"), "--replay", str(tmp_path / "no")])
    assert told.exit_code == 2 and "thin.mcap: does not hold every sample" in told.output
    twice = ["--csv", str(tmp_path / "both"), "--replay", str(tmp_path / "both")]
    told = CliRunner().invoke(app, ["export", str(tmp_path / "thin.mcap"), *twice])
    assert told.exit_code == 2 and "that of --csv too; give each its own" in " ".join(
        told.output.replace("│", " ").split()
    )
    blind = flown.data._replace(truth=flown.data.truth._replace(t_s=np.zeros(0)))
    with pytest.raises(measured.NoDataError, match="without truth"):
        measured.write(blind, tmp_path / "no")


def test_what_is_written_loads_whatever_fails_and_whatever_is_off(tmp_path):
    """A quantum that is `off`, an IMU silent at the start and for 0.3 s later."""
    silent = [
        {"fault": "dropout", "from": "-10 s", "until": "-6 s"},
        {"fault": "dropout", "from": "0.5 s", "until": "0.8 s"},
    ]
    asked = {"imu.gyro.quantum": "off", "faults.imu": silent}
    flown = runs.fly(missions.Scenario.load("rexus_like", asked), 1, until_s=2.0)
    measured.write(flown.data, tmp_path / "measured")
    scenario, files = load.load(str(tmp_path / "measured" / measured.REPLAY))
    said = yaml.safe_load((tmp_path / "measured" / measured.REPLAY).read_text())
    assert said["imu"]["gyro"]["quantum"] == "off"
    back = dataset.read(scenario, files)
    assert back.imu.bridged.sum() == 120 and back.truth.t_s[0] == pytest.approx(scenario.mission.start)


def test_an_imu_that_is_silent_for_too_long_is_refused(tmp_path):
    for from_s, until_s, words in (
        (1.0, 4.0, r"no sample of the IMU for 3 s after T\+1"),
        (-20.0, 99.0, "no samples"),
    ):
        gap = [{"fault": "dropout", "from": f"{from_s} s", "until": f"{until_s} s"}]
        flown = runs.fly(missions.Scenario.load("rexus_like", {"faults.imu": gap}), 1, until_s=5.0)
        with pytest.raises(measured.NoDataError, match=words):
            measured.write(flown.data, tmp_path / "no")


def test_errors_of_fixes_that_last_are_told_and_what_cannot_be_is_said(tmp_path):
    """2 m of multipath beside 1 m of white noise are four fifths of the variance; told noise is not in it."""
    overrides = ["gps.errors.multipath={range: 2 m, time: 30 s}", "gps.range_noise=1 m"]
    overrides.append("navigation.told.gps.range_noise=9 m")
    flown = runs.fly(missions.load(missions.file_of("rexus_like"), overrides), 3, until_s=-5.0)
    measured.write(flown.data, tmp_path / "measured")
    back, _ = load.load(str(tmp_path / "measured" / measured.REPLAY))
    assert back.gnss.lasting_share == pytest.approx(0.8, abs=1e-3) and back.gnss.lasting_time == 300.0
    (told,) = measured.remarks(flown.data)
    assert told.startswith("navigation.told.gps: ")
    head = (tmp_path / "measured" / measured.REPLAY).read_text(encoding="utf-8")
    assert f"# {told}\n" in head


def test_nothing_is_said_of_a_receiver_whose_errors_are_white(flight):
    assert not measured.remarks(flight[0])


SHAKEN_UNTIL_S = 260.0  # both motors have burnt; no star fix has been used before


@pytest.mark.parametrize("boost", [(7.0, 3.5), (0.0, 0.0)])
def test_the_vibration_of_motors_is_told_to_a_replay(tmp_path, boost):
    """Velocity errors over their sigmas: about 1 with it and without it, 2 and more where it is left out."""
    overrides = [f"imu.vibration.boost=[{boost[0]} gee, {boost[1]} gee]", "star_tracker.enabled=false"]
    shefex = missions.load(missions.file_of("shefex2_andoya"), overrides)
    flown = runs.fly(shefex, 1, until_s=SHAKEN_UNTIL_S)
    measured.write(flown.data, tmp_path / "measured")
    path, ratios = str(tmp_path / "measured" / measured.REPLAY), []
    for left_out in ([], ["--set", "imu.vibration=null"]):
        done = CliRunner().invoke(app, ["replay", path, "--json", *left_out])
        assert done.exit_code == 0, done.output
        over = json.loads(done.stdout)["navigation"]["error_over_sigma"]["velocity_ned"]
        ratios.append(np.sqrt(np.mean(np.square(over))))
    assert ratios[0] < 1.3, ratios
    assert ratios[1] > 1.6 if any(boost) else ratios[1] < 1.3, ratios


def test_the_log_of_a_replayed_flight_is_written_as_the_flight_is(flight, tmp_path):
    """Its scenario is called `rexus_like (replayed)`, which is no word."""
    data, folder = flight
    again = data._replace(mission=data.mission._replace(scenario=f"{data.mission.scenario} (replayed)"))
    measured.write(again, tmp_path / "again")
    one, other = ((place / measured.REPLAY).read_text() for place in (folder, tmp_path / "again"))
    assert one == other


def test_the_log_of_data_of_others_is_refused_before_anything_is_written(tmp_path):
    log, folder = tmp_path / "others.mcap", tmp_path / "no"
    done = CliRunner().invoke(app, ["replay", "csv_example", "--log", str(log)])
    assert done.exit_code == 0, done.output
    assert len(runs.open_run(log).truth.t_s)
    told = CliRunner().invoke(app, ["export", str(log), "--replay", str(folder)])
    assert told.exit_code == 2 and "is of a replay, whose data are in files already" in told.output
    assert not folder.exists()
