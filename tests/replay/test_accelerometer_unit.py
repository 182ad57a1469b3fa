"""Accelerometers in another unit than told: gravity at rest shows it, or nothing is said."""

import numpy as np
import pytest
from replay_files import turntable_folder
from test_plausible import RATE, REST_S, folder_of
from turntable import Turntable, increments

from shefex_nav.geometry import wgs84
from shefex_nav.replay import dataset, imu_units, load
from shefex_nav.scenario.data_table import DataError

UNIT = "data.imu.accelerometer_unit"
AS_ANGLES = ["data.imu.gyro_unit=rad"]  # one kind with m/s
LOOSE = ["imu.accelerometer.bias=50 mgee", "imu.accelerometer.scale_factor=1 %"]


def loaded(path, *overrides):
    """Scenario and Dataset."""
    scenario, files = load.load(path, overrides)
    return scenario, dataset.read(scenario, files)


def scaled(data, factor):
    return data._replace(imu=data.imu._replace(dv_b=factor * data.imu.dv_b))


def refused(scenario, data):
    with pytest.raises(DataError) as info:
        imu_units.accelerometers(scenario, data)
    said = str(info.value)
    assert said.startswith(f"{UNIT}: at rest, ") and "\n" not in said
    return said


@pytest.fixture(scope="module")
def rocket(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("rocket"))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Without truth."""
    return folder_of(tmp_path_factory.mktemp("alone"), truth=False)


SIZES = [*imu_units.ACCELERATIONS.items()]


@pytest.mark.parametrize(("meant", "size"), SIZES)
@pytest.mark.parametrize(("told", "size_told"), SIZES)
def test_every_unit_taken_for_every_other(rocket, told, size_told, meant, size):
    """Values in one unit, read as another; mgee and cm/s2, 2 % apart, are told as either."""
    scenario, data = loaded(rocket, f"{UNIT}={told}")
    data = scaled(data, 1.0 / size)  # the file has m/s2
    if abs(size / size_told - 1.0) < 0.05:
        assert imu_units.accelerometers(scenario, data) == []
        return
    said = refused(scenario, data)
    names = said.split("they fit as ")[1].split(" or ")
    assert names[0] == meant
    assert "gravity there is 9.824 m/s2" in said


@pytest.mark.parametrize(
    ("told", "factor", "words"),
    [
        ("m/s2", 1.0 / RATE, "they fit as increments of a sample, in m/s (sample interval 0.02 s)"),
        ("m/s2", RATE, "they fit as m/s2 divided by the sample interval once more (0.02 s)"),
        ("m/s2", 9.80665, "they fit as m/s2 multiplied by 9.80665 once more"),
        ("gee", 1.0 / 9.80665 / RATE, "they fit as increments of a sample, in gee s (sample interval"),
        ("m/s", 1.0, "they fit as rates, in m/s2 (sample interval 0.02 s)"),
        ("m/s", 1.0 / 9.80665, "they fit as rates, in gee (sample interval 0.02 s)"),
        ("m/s", 1.0 / RATE / 9.80665, "they fit as gee s"),
        ("m/s", 1.0 / RATE**2, "they fit as m/s multiplied by the sample interval once more (0.02 s)"),
    ],
)
def test_increments_and_rates(rocket, alone, told, factor, words):
    """By the truth and by the velocities of GNSS. factor : of the file, which has m/s2"""
    for path, who in ((rocket, "the truth"), (alone, "the velocities of GNSS")):
        scenario, data = loaded(path, f"{UNIT}={told}", *(AS_ANGLES if told == "m/s" else ()))
        said = refused(scenario, scaled(data, factor))
        assert words in said and f" s by {who}, the accelerometers, taken as {told}, sense " in said


def test_what_is_felt_and_expected_is_said(rocket):
    scenario, data = loaded(rocket)
    said = refused(scenario, scaled(data, 1.0 / 9.80665))
    assert f"at rest, 0.0 s to {REST_S:.1f} s" in said
    assert said.endswith("taken as m/s2, sense 1.001 m/s2; gravity there is 9.824 m/s2; they fit as gee")


def test_gravity_that_was_taken_away(rocket):
    scenario, data = loaded(rocket)
    up_b = data.imu.dv_b[1:400].sum(axis=0)
    step_s = np.diff(data.imu.t_s, prepend=data.imu.t_s[0])[:, None]
    left = data.imu.dv_b - step_s * up_b / (data.imu.t_s[399] - data.imu.t_s[0])
    said = refused(scenario, data._replace(imu=data.imu._replace(dv_b=left)))
    assert "they fit as accelerations without gravity" in said


def test_the_alignment_says_that_it_stands_still(tmp_path):
    """Where the receiver has no velocities."""
    path = folder_of(tmp_path, truth=False)
    path.write_text(path.read_text().replace(", velocity: [vn, ve, vd]}", "}"))
    scenario, data = loaded(path)
    assert imu_units.accelerometers(scenario, data) == []
    assert "by alignment.duration" in refused(scenario, scaled(data, 9.80665))


def test_what_no_unit_explains_is_warned_of(rocket):
    scenario, data = loaded(rocket)
    ((field, text),) = imu_units.accelerometers(scenario, scaled(data, 2.0))
    assert field == UNIT and "sense 19.6" in text and "no other unit explains that" in text


@pytest.mark.parametrize(("factor", "odd"), [(0.92, 0), (1.08, 0), (0.8, 1), (1.25, 1)])
def test_the_margin(rocket, factor, odd):
    """A scale factor of some percent is no unit; sensors that are told to be that bad may have it."""
    scenario, data = loaded(rocket)
    assert len(imu_units.accelerometers(scenario, scaled(data, factor))) == odd
    loose, data = loaded(rocket, *LOOSE)
    assert imu_units.accelerometers(loose, scaled(data, factor)) == []


@pytest.mark.parametrize("truth", [True, False])
def test_what_does_not_rest_is_not_looked_at(tmp_path, truth):
    """Free fall from the first row on, and a rest of 2 s; no force at all would be told otherwise."""
    path = folder_of(tmp_path, truth=truth)
    scenario, data = loaded(path)
    assert imu_units.at_rest(scenario, data) is not None
    for begin_s in (REST_S + 1.0, REST_S - 2.0):
        later = data.imu.t_s >= begin_s
        imu = data.imu._replace(**{name: getattr(data.imu, name)[later] for name in data.imu._fields})
        fixes = [fix for fix in data.fixes if fix.t_valid_s >= begin_s]
        cut = scaled(data._replace(imu=imu, fixes=fixes), 0.0)
        assert imu_units.accelerometers(scenario, cut) == []


def test_a_receiver_that_is_found_again_on_the_ground(alone):
    """It is lost before lift-off and stands still when it is back: the fall between is no rest."""
    scenario, data = loaded(alone)
    still = [fix for fix in data.fixes if fix.t_valid_s < REST_S - 1.0]
    back = [fix._replace(t_valid_s=fix.t_valid_s + 30.0) for fix in still]
    rest = imu_units.at_rest(scenario, data._replace(fixes=still + back))
    assert rest.end_s <= REST_S


def test_velocities_that_are_zero_because_they_are_unknown(tmp_path):
    """The places say that the vehicle moves."""
    scenario, data = loaded(folder_of(tmp_path, speed=0.0, truth=False))
    assert imu_units.at_rest(scenario, data).end_s < REST_S + 3.0


def test_what_hangs_over_one_place_without_weight():
    """A geostationary satellite stands still and feels nothing, as it should."""
    scenario, data = loaded("csv_example")
    r_e = np.array([42164.17e3, 0.0, 0.0])
    fixes = [fix._replace(r_ea_e=r_e, v_ea_e=np.zeros(3)) for fix in data.fixes]
    weightless = scaled(data._replace(fixes=fixes, truth=None), 0.0)
    assert imu_units.at_rest(scenario, weightless) is not None
    assert imu_units.accelerometers(scenario, weightless) == []


@pytest.mark.parametrize("rate", [0.0, 12.0, 90.0])
def test_a_turntable_at_any_rate(tmp_path, rate):
    """About the vertical and a tilted one: what turns too fast for a mean is left out, not refused."""
    table = Turntable(roll=np.radians(60.0), rate=np.radians(rate))
    path = turntable_folder(tmp_path, table, increments, 100.0, 10.0)
    scenario, data = loaded(path)
    assert wgs84.geodetic_from_ecef(data.truth.r_e[0])[2] == pytest.approx(520.0)
    assert imu_units.accelerometers(scenario, data) == []
    if rate < 30.0:
        assert "they fit as gee" in refused(scenario, scaled(data, 1.0 / 9.80665))


def test_the_shipped_half_minute_passes():
    scenario, data = loaded("csv_example")
    assert imu_units.at_rest(scenario, data) is not None
    assert imu_units.accelerometers(scenario, data) == []


def test_the_command_refuses(command, alone):
    """Exit code 2 and one line, before anything is navigated."""
    result = command("replay", alone, "--set", f"{UNIT}=gee")
    assert result.code == 2 and result.out == ""
    assert "taken as gee, sense 96.3" in result.err and "they fit as m/s2" in result.err
