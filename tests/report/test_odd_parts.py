"""Values that are possible by themselves and make no rocket: each slipped unit is told at its field."""

import math
from pathlib import Path

import pytest

from shefex_nav.commands.app import main
from shefex_nav.report import odd_parts, vehicle
from shefex_nav.scenario import load

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STAGE = "vehicle.stages.Orion"


def told(*overrides):
    """{field: text} of the oddities of rexus_like with some values changed."""
    found = list(odd_parts.found(load.load("rexus_like", overrides)))
    fields = [".".join(map(str, path)) for path, _ in found]
    assert len(set(fields)) == len(fields), "a value is told once"
    return dict(zip(fields, (text for _, text in found), strict=True))


@pytest.mark.parametrize(
    "name",
    ["shefex2_andoya", "shefex2_woomera", "rexus_like", "rexus_spinning", "orbit", "night_sky",
     "given_trajectory"],
)  # fmt: skip
def test_the_vehicles_that_come_with_the_program_are_good(name):
    assert list(odd_parts.found(load.load(SCENARIOS / f"{name}.yaml"))) == []


@pytest.mark.parametrize(
    ("override", "field", "words"),
    [
        (f"{STAGE}.motor.exit_station=56 m", f"{STAGE}.motor.exit_station", "157.3 times as long"),
        (f"{STAGE}.aerodynamics.area=995 cm2", None, ""),
        (f"{STAGE}.aerodynamics.area=0.0995 cm2", f"{STAGE}.aerodynamics.area", "times the circle"),
        (f"{STAGE}.propellant.outer_radius=17 m", f"{STAGE}.propellant.outer_radius", "grain of 34 m across"),
        (f"{STAGE}.propellant.station=0.3 m", f"{STAGE}.propellant.station", "0.8 m ahead of the nose tip"),
        (f"{STAGE}.propellant.station=5 m", f"{STAGE}.propellant.station", "ends at 6.1 m, behind"),
        ("vehicle.payload.inertia_roll=40 kg m2", "vehicle.payload.inertia_roll", "gyration of 0.598 m"),
        ("vehicle.payload.inertia_pitch=4e5 kg m2", "vehicle.payload.inertia_pitch", "more than half"),
        ("vehicle.imu=[1.2 m, 0 m, 0 m]", "vehicle.imu", "behind the nose tip has a negative x"),
        ("vehicle.imu=[-120 m, 0 m, 0 m]", "vehicle.imu", "120 m behind the nose tip"),
        ("vehicle.imu=[-1 m, 5 m, 0 m]", "vehicle.imu", "5 m off the roll axis"),
        ("gps.antenna.lever_arm=[-40 m, 0 m, 0 m]", "gps.antenna.lever_arm", "m behind the nose tip"),
        ("vehicle.yo_yo.radius=1.7 m", "vehicle.yo_yo.radius", "more than the reference diameter"),
    ],
)  # fmt: skip
def test_a_place_or_size_that_no_vehicle_has_is_told_at_its_field(override, field, words):
    found = told(override)
    assert found == {} if field is None else words in found[field], found


def centre_of_pressure(station):
    """Override of the whole column."""
    rows = load.load("rexus_like").vehicle.stages["Orion"].aerodynamics.pressure_station
    return f"{STAGE}.aerodynamics.pressure_station=[{', '.join([station] * len(rows))}]"


def test_a_centre_of_pressure_in_another_unit():
    """Far outside, the station itself is told; inside, the margin in calibres that it makes."""
    (outside,) = told(centre_of_pressure("430 m")).items()
    assert outside[0] == f"{STAGE}.aerodynamics.pressure_station.0"
    assert "430 m behind the nose tip" in outside[1]
    assert "is outside a vehicle of 5.6 m" in outside[1]
    (inside,) = told(centre_of_pressure("6.5 m"), f"{STAGE}.aerodynamics.diameter=0.2 m").items()
    burnt = (112.0 * 1.55 + 140.0 * 4.25) / 252.0  # m, centre of mass without propellant
    full = (252.0 * burnt + 290.0 * 4.0) / 542.0
    assert f"reaches {(6.5 - min(burnt, full)) / 0.2:.4g} calibres" in inside[1]


def test_a_centre_of_pressure_ahead_of_the_centre_of_mass_at_lift_off():
    """With all propellant, at the lowest Mach number; what counts is the mass that stands on the launcher."""
    full = (112.0 * 1.55 + 140.0 * 4.25 + 290.0 * 4.0) / 542.0
    assert told(centre_of_pressure(f"{full + 0.01} m")) == {}
    found = told(centre_of_pressure(f"{full - 0.712} m"))
    (words,) = (text for path, text in found.items() if path.endswith("pressure_station.0"))
    assert words.startswith("the static margin at lift-off is -2 calibres, so the rocket turns over")
    assert f"centre of mass {full:.4g} m" in words


def test_the_propellant_of_a_grain_has_a_density():
    """The limits are of the density, whichever of mass, length and radii is wrong."""
    grain = load.load("rexus_like").vehicle.stages["Orion"].propellant
    for density, is_odd in ((450.0, True), (550.0, False), (2900.0, False), (3100.0, True)):
        outer = math.sqrt(grain.mass / (density * math.pi * grain.length) + 0.01**2)
        found = told(f"{STAGE}.propellant.outer_radius={outer!r} m", f"{STAGE}.propellant.inner_radius=1 cm")
        assert (f"{STAGE}.propellant.mass" in found) is is_odd, density
        if is_odd:
            assert f"a density of {density:.3g} kg/m3" in found[f"{STAGE}.propellant.mass"]


@pytest.mark.parametrize(("speed_s", "is_odd"), [(100, True), (125, False), (315, False), (330, True)])
def test_the_specific_impulse_of_a_motor(tmp_path, speed_s, is_odd):
    """A triangle of thrust over ten seconds, in vacuum: its area over the weight of the propellant."""
    base = load.load("rexus_like")
    mass = base.vehicle.stages["Orion"].propellant.mass
    peak = speed_s * mass * 9.80665 / 5.0
    motor = "{exit_area: 0.03 m2, exit_station: 5.6 m, measured_at: vacuum, thrust: {time: [0 s, 1 s, 10 s], "
    found = told(f"{STAGE}.motor={motor}force: [0 N, {peak} N, 0 N]}}}}")
    assert (f"{STAGE}.motor" in found) is is_odd, found
    if is_odd:
        assert f"specific impulse of {speed_s} s" in found[f"{STAGE}.motor"]


@pytest.mark.parametrize(("speed_s", "is_odd"), [(430, False), (500, True)])
def test_what_is_no_grain_may_be_liquid(speed_s, is_odd):
    mass = load.load("rexus_like").vehicle.stages["Orion"].propellant.mass
    table = "{burnt: [0 %, 100 %], station: [4 m, 4 m], inertia_roll: [3 kg m2, 0 kg m2], "
    table += "inertia_pitch: [40 kg m2, 0 kg m2]}"
    motor = "{exit_area: 0.03 m2, exit_station: 5.6 m, measured_at: vacuum, thrust: {time: [0 s, 1 s, 10 s], "
    motor += f"force: [0 N, {speed_s * mass * 9.80665 / 5.0} N, 0 N]}}}}"
    found = told(f"{STAGE}.motor={motor}", f"{STAGE}.propellant={{mass: {mass} kg, table: {table}}}")
    assert (f"{STAGE}.motor" in found) is is_odd, found


def test_a_given_specific_impulse_that_no_propellant_has():
    base = load.load("rexus_like").vehicle.stages["Orion"]
    total, speed = odd_parts.impulse(base)
    assert total == pytest.approx(speed * base.propellant.mass * 9.80665, rel=1e-9)
    assert 120.0 < speed < 320.0


def test_check_and_vehicle_tell_them_and_a_flight_that_fails_is_explained(monkeypatch, capsys):
    def command(*words):
        monkeypatch.setattr("sys.argv", ["shefex-nav", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, "".join(capsys.readouterr().err.split("\n"))

    wide = ("rexus_like", "--set", f"{STAGE}.propellant.outer_radius=17 m")
    for name in ("check", "vehicle"):
        code, said = command(name, *wide)
        assert code == 0 and "grain of 34 m across" in said
    heavy = ("--set", f"{STAGE}.dry.inertia_roll=1e3 kg m2", "--set", f"{STAGE}.aerodynamics.fin_cant=0 deg")
    code, said = command("check", "rexus_like", *heavy, "--set", f"{STAGE}.motor.misalignment=[0 deg, 0 deg]")
    assert code and "radius of gyration" in said and "does not spin" in said


def test_motors_and_apogee_are_in_the_figures_of_a_vehicle():
    looked = vehicle.look(load.load("rexus_like"))
    found = vehicle.summary(looked)
    (motor,) = found["motors"]
    t_s, thrust = looked.profile.t_s, looked.profile.thrust
    burning = thrust > 0.0
    assert motor["burn_time_s"] == pytest.approx(t_s[burning][-1] - t_s[burning][0], abs=0.15)
    in_air = float((0.5 * (thrust[1:] + thrust[:-1]) * (t_s[1:] - t_s[:-1])).sum())
    assert 0.9 * motor["total_impulse_n_s"] < in_air < motor["total_impulse_n_s"]  # less the air's pressure
    assert found["apogee_km"] == pytest.approx(looked.profile.height.max() / 1e3, abs=0.01)
    assert found["apogee_s"] == pytest.approx(t_s[looked.profile.height.argmax()], abs=0.1)
