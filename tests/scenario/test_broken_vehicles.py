"""Vehicles that cannot fly, each wrong in one thing: one message with file, line, column and field."""

import pytest
from broken import DEFAULT, TEXT, check_one_message, messages, the_message

from shefex_nav.scenario import params
from shefex_nav.scenario.load import ScenarioError, load
from shefex_nav.world.flight import timeline

STAGE = "vehicle.stages.S40M"
MOTOR = """        specific_impulse: 272 s # [E] assumed
        burn_time: 56 s # [E] assumed
        rise: 0.3 s # [E] assumed
        tail_off: 4 s # [E] assumed
        level_ratio: 0.891 # [E] assumed: slowly regressive, 1.10 to 0.98 of the mean
"""
NOZZLE = """        exit_area: 0.45 m2 # [E] assumed
        exit_station: 12.6 m # length of the vehicle
"""
GRAIN = """        mass: 4240 kg # both stages' propellant less that of the second
        station: 9.2 m # [E] assumed
        length: 4.4 m # [E] assumed
        outer_radius: 0.49 m # [E] assumed
        inner_radius: 0.18 m # [E] assumed
"""
CURVE = "        thrust: {time: [0 s, 1 s, 55 s, 56 s], force: [0 N, 210 kN, 210 kN, 0 N]}\n"  # 11.55 MN s
LATE_S = 20.0 * (65.91e3 + 0.45 * 101205.0) / 230e3  # weight along the rail, air on the nozzle at 10 m
AXIAL = "axial: [0.45, 0.45, 0.58, 0.80, 0.78, 0.68, 0.56, 0.44, 0.36, 0.32, 0.32]"
MACH = "mach: [0, 0.6, 0.9, 1.05, 1.2, 1.5, 2, 3, 5, 8, 12]"


def propellant_table(burnt, station, inertia):
    """Text of a propellant of the first stage by its lists."""
    lists = f"burnt: {burnt}, station: {station}, inertia_roll: {inertia}, inertia_pitch: {inertia}"
    return f"        mass: 4240 kg\n        table: {{{lists}}}\n"


# kind: (text in the default scenario, what stands there instead, where "@" is the place complained about,
#        field, words)
BROKEN = {
    "negative mass": (
        "mass: 980 kg",
        "mass: @-980 kg",
        f"{STAGE}.dry.mass",
        "must be greater than zero, got '-980 kg'",
    ),
    "no propellant": (
        "mass: 4240 kg",
        "mass: @0 kg",
        f"{STAGE}.propellant.mass",
        "must be greater than zero",
    ),
    "no motor": (
        f"      motor:\n{MOTOR}{NOZZLE}",
        "",
        f"{STAGE}.motor",
        "is missing; this section is required",
    ),
    "name of a stage": (
        "    S44: #",
        "    @S.44: #",
        "vehicle.stages.S.44",
        "must be one word of letters, digits, '-' and '_'",
    ),
    "negative thrust factor": (
        "exit_area: 0.45 m2",
        "thrust_factor: @0 %\n        exit_area: 0.45 m2",
        f"{STAGE}.motor.thrust_factor",
        "must be greater than zero",
    ),
    "one angle of misalignment": (
        "exit_area: 0.45 m2",
        "misalignment: @[0.1 deg]\n        exit_area: 0.45 m2",
        f"{STAGE}.motor.misalignment",
        "expected a list of 2 values, got 1 values",
    ),
    "two forms of thrust": (
        MOTOR[MOTOR.index("        burn_time") :],
        f"        @burn_time: 56 s\n{CURVE}",
        f"{STAGE}.motor.burn_time",
        "does not go with thrust; take one of the two away",
    ),
    "burn shorter than its ends": (
        "tail_off: 4 s # [E] assumed\n        level_ratio: 0.891 # [E] assumed: slowly",
        "tail_off: 58 s\n        level_ratio: 0.891 #",
        f"{STAGE}.motor.burn_time",
        "56 s must be longer than rise and tail_off together",
    ),
    "impulse against specific impulse": (
        MOTOR,
        f"        specific_impulse: @250 s\n{CURVE}",
        f"{STAGE}.motor.specific_impulse",
        "250 s does not agree within 2 %: the thrust curve has 1.155e+07 N s in vacuum, which from 4240",
    ),
    "thrust in kilonewtons by mistake": (
        MOTOR,
        CURVE.replace("kN", "MN"),
        f"{STAGE}.propellant.mass",
        "2.778e+05 s of specific impulse, not 20 to 500 s as of any motor",
    ),
    "thrust without end": (
        MOTOR,
        CURVE.replace("0 N]", "@1 N]"),
        f"{STAGE}.motor.thrust.force.3",
        "the thrust must end with 0 N, not with 1 N",
    ),
    "thrust that starts late": (
        MOTOR,
        CURVE.replace("[0 s", "[@0.5 s"),
        f"{STAGE}.motor.thrust.time.0",
        "the curve must start at ignition, 0 s, not at 0.5 s",
    ),
    "thrust back in time": (
        MOTOR,
        CURVE.replace("55 s", "@0.9 s"),
        f"{STAGE}.motor.thrust.time.2",
        "times must increase: 0.9 s follows 1 s",
    ),
    "thrust with a hole": (
        MOTOR,
        CURVE.replace("[0 N, 210 kN,", "@[0 N,"),
        f"{STAGE}.motor.thrust.force",
        "3 values for 4 times; give one for each",
    ),
    "negative thrust": (
        MOTOR,
        CURVE.replace("210 kN, 0 N]", "@-210 kN, 0 N]"),
        f"{STAGE}.motor.thrust.force.2",
        "must not be negative",
    ),
    "no thrust": (
        MOTOR,
        CURVE.replace("210 kN", "0 N").replace("force: [", "force: @["),
        f"{STAGE}.motor.thrust.force",
        "must not be zero throughout",
    ),
    "grain inside out": (
        "inner_radius: 0.18 m",
        "inner_radius: @0.5 m",
        f"{STAGE}.propellant.inner_radius",
        "0.5 m must be smaller than outer_radius, 0.49 m",
    ),
    "propellant not from full": (
        GRAIN,
        propellant_table("[@5 %, 100 %]", "[9 m, 9 m]", "[3 kg m2, 0 kg m2]"),
        f"{STAGE}.propellant.table.burnt.0",
        "the table must go from 0 % to 100 %, here it has 5 %",
    ),
    "propellant not monotonic": (
        GRAIN,
        propellant_table(
            "[0 %, 60 %, @50 %, 100 %]", "[9 m, 9 m, 9 m, 9 m]", "[3 kg m2, 2 kg m2, 1 kg m2, 0 kg m2]"
        ),
        f"{STAGE}.propellant.table.burnt.2",
        "shares must increase: 50 % follows 60 %",
    ),
    "propellant with a hole": (
        GRAIN,
        propellant_table("[0 %, 100 %]", "@[9 m]", "[3 kg m2, 0 kg m2]"),
        f"{STAGE}.propellant.table.station",
        "1 values for 2 shares burnt; give one for each",
    ),
    "Mach numbers not monotonic": (
        "mach: [0, 0.6, 0.9",
        "mach: [0, 0.9, @0.6",
        f"{STAGE}.aerodynamics.mach.2",
        "Mach numbers must increase: 0.6 follows 0.9",
    ),
    "column too long": (
        "axial: [0.45,",
        "axial: @[0.45, 0.45,",
        f"{STAGE}.aerodynamics.axial",
        "12 values for 11 Mach numbers",
    ),
    "table too short": (
        "mach: [0, 0.6,",
        "mach: @[0,",
        f"{STAGE}.aerodynamics.mach",
        "10 Mach numbers, but 11 values in every other column",
    ),
    "one Mach number": (
        MACH,
        "mach: @[0]",
        f"{STAGE}.aerodynamics.mach",
        "expected a list of at least 2 values, got 1 values",
    ),
    "Mach numbers of the damping": (
        "pitch_damping: [-600",
        "damping_mach: @[0, 3]\n        pitch_damping: [-600",
        f"{STAGE}.aerodynamics.damping_mach",
        "2 Mach numbers, but 11 values in every other column",
    ),
    "angles without lists": (
        MACH,
        f"{MACH}\n        angle_of_attack: [0 deg, 10 deg]",
        f"{STAGE}.aerodynamics.axial",
        "expected 2 lists, one for each angle of attack, of 11 values",
    ),
    "lists without angles": (
        AXIAL,
        f"axial: @[{AXIAL[7:]}, {AXIAL[7:]}]",
        f"{STAGE}.aerodynamics.axial",
        "angle_of_attack is not given",
    ),
    "air that pushes": (
        "axial: [0.45,",
        "axial: [@-0.45,",
        f"{STAGE}.aerodynamics.axial.0",
        "-0.45 at Mach 0 and 0 deg makes a drag coefficient of -0.45: the air would push the vehicle along",
    ),
    "a letter in a list of lists": (
        AXIAL,
        "axial: [[0.4, @x], [0.4, 0.5]]",
        f"{STAGE}.aerodynamics.axial.0.1",
        "expected a number without unit such as 0.62, got 'x'",
    ),
    "cant without fins": (
        "roll_by_cant: [6.0, 6.0, 6.5, 6.6, 6.2, 5.4, 4.4, 3.2, 2.2, 1.6, 1.4]",
        "roll_by_cant: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]",
        f"{STAGE}.aerodynamics.fin_cant",
        "there are no fins that it could turn: roll_by_cant is zero or missing",
    ),
    "cant of a body": (
        "fin_cant: 0 deg",
        "fin_cant: @1 deg",
        "vehicle.stages.S44.aerodynamics.fin_cant",
        "there are no fins",
    ),
    "thrust below weight": (
        "mass: 980 kg",
        "mass: 30 t",
        f"{STAGE}.motor",
        "S40M gives 177 kN on the rail within a second after "
        "ignition, the weight along the rail is 351 kN; the vehicle would not lift off",
    ),
    "thrust that comes too late": (
        MOTOR,
        "        thrust: {time: [0 s, 20 s, 59 s, 60 s], force: [0 N, 230 kN, 230 kN, 0 N]}\n",
        f"{STAGE}.motor",
        f"would not lift off before {LATE_S:.3g} s, and lift-off counts from ignition",
    ),
    "separation before burn-out": (
        "at: 65 s",
        "at: @50 s",
        f"{STAGE}.separation.at",
        "50 s is before the burn-out of its motor, 56 s",
    ),
    "ignition before separation": (
        "ignition: 149.2 s",
        "ignition: @60 s",
        "vehicle.stages.S44.ignition",
        "60 s is before the separation of S40M below it, 65 s",
    ),
    "burns past the end": (
        "ignition: 149.2 s",
        "ignition: @560 s",
        "vehicle.stages.S44.ignition",
        "the motor burns until 628 s, past mission.time_limit, 600 s",
    ),
    "ignition before lift-off": (
        "ignition: 0 s",
        "ignition: @-1 s",
        f"{STAGE}.ignition",
        "-1 s must not be before lift-off, 0 s",
    ),
    "payload without coefficients": (
        "      ignition: 149.2 s",
        "      separation: {at: 240 s}\n      ignition: 149.2 s",
        "vehicle.payload.aerodynamics",
        "is missing; the payload flies alone",
    ),
    "vibration of a stage missing": (
        "boost: [7 gee, 3.5 gee]",
        "boost: @[7 gee]",
        "imu.vibration.boost",
        "1 value for 2 stages (S40M, S44); give one for each stage",
    ),
    "torque of zero": (
        "[5 N m, 60 N m,",
        "[@0 N m, 60 N m,",
        "vehicle.cold_gas.torque.0",
        "must be greater than zero",
    ),
    "torque as force": (
        "[5 N m, 60 N m,",
        "[@5 N, 60 N m,",
        "vehicle.cold_gas.torque.0",
        "'5 N' is a force, expected a torque or energy such as '60 N m'",
    ),
    "spin motors to nowhere": (
        "torque: 213.6 N m",
        "torque: @0 N m",
        "vehicle.spin_motors.torque",
        "must not be zero",
    ),
    "spin motors past the end": (
        "duration: 2 s",
        "duration: @400 s",
        "vehicle.spin_motors.duration",
        "784 s is after mission.time_limit, 600 s",
    ),
    "yo-yo on the pad": (
        "at: 219 s",
        "at: @-1 s",
        "vehicle.yo_yo.at",
        "-1 s must not be before lift-off, 0 s",
    ),
    "parachute that never opens": (
        "  yo_yo: #",
        "  parachute: @{drag_area: 12 m2, inflation: 2 s, station: 1 m}\n  yo_yo: #",
        "vehicle.parachute",
        "give exactly one of height and at",
    ),
    "parachute that opens twice": (
        "  yo_yo: #",
        "  parachute: @{height: 5 km, at: 400 s, drag_area: 12 m2, inflation: 2 s, station: 1 m}\n  yo_yo: #",
        "vehicle.parachute",
        "give exactly one of height and at",
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_one_message_that_names_place_and_field(tmp_path, kind):
    good, bad, field, words = BROKEN[kind]
    check_one_message(tmp_path, good, bad, field, words)


def test_stages_as_a_list(tmp_path):
    begin, end = TEXT.index("  stages:"), TEXT.index("  yo_yo:")
    path = tmp_path / "list.yaml"
    path.write_text(TEXT[:begin] + "  stages: [S40M, S44]\n" + TEXT[end:], encoding="utf-8")
    assert "vehicle.stages: expected a section with keys of its own, got a list" in the_message(path)


def test_a_rocket_without_a_stage():
    payload = (
        "vehicle.payload.aerodynamics={area: 1 m2, diameter: 1 m, mach: [0, 9], axial: [1, 1], "
        "normal_slope: [2, 2], pressure_station: [1 m, 1 m], pitch_damping: [-9, -9], roll_damping: [-1, -1]}"
    )
    said = the_message(
        DEFAULT,
        ["vehicle.stages={}", payload, "imu.vibration.boost=[]", "gps.outages=[]"],
    )
    assert said == "--set vehicle.stages: is empty; a rocket on its rail needs a stage with a motor"


def test_a_stage_may_be_dropped_at_its_burn_out():
    """0.1 s + 1.1 s is more than 1.2 s by rounding."""
    curve = "{time: [0 s, 0.1 s, 1.1 s], force: [0 N, 1.2 MN, 0 N]}"
    told = ["vehicle.stages.Orion.ignition=0.1 s", "vehicle.stages.Orion.separation.at=1.2 s"]
    told += [f"vehicle.stages.Orion.motor={{thrust: {curve}, exit_area: 0.03 m2, exit_station: 5.6 m}}"]
    timeline.check(params.flight_params(load("rexus_like", told)))


def test_every_fault_of_a_vehicle_at_once():
    """Faults of one stage do not hide those of the other."""
    said = messages(
        DEFAULT,
        [
            "vehicle.stages.S40M.propellant.inner_radius=1 m",
            "vehicle.stages.S44.motor.tail_off=90 s",
            "vehicle.stages.S44.aerodynamics.fin_cant=1 deg",
        ],
    )
    assert [line.split(": ")[0] for line in said if line.startswith("--set")] == [
        "--set vehicle.stages.S40M.propellant.inner_radius",
        "--set vehicle.stages.S44.aerodynamics.fin_cant",
    ]
    assert len(said) == 3
    assert "vehicle.stages.S44.motor.burn_time: 68 s must be longer" in said[2]


def test_a_stage_that_burns_with_another_below():
    attached = ["vehicle.stages.S40M.separation=null", "vehicle.stages.S40M.spent=null", "gps.outages=[]"]
    said = the_message(DEFAULT, attached)
    assert said.endswith(
        "vehicle.stages.S44.ignition: the stage below, S40M, stays attached to it; "
        "give S40M a separation before this ignition"
    )


def test_a_table_that_two_stages_have_is_complained_of_once(tmp_path):
    (tmp_path / "aero.csv").write_text("mach;axial\n0;0,4\n")
    stages = "".join(f"    {name}: {{aerodynamics: {{file: aero.csv}}}}\n" for name in ("S40M", "S44"))
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"extends: shefex2_andoya\nmission: {{name: mine}}\nvehicle:\n  stages:\n{stages}")
    with pytest.raises(ScenarioError) as raised:
        load(mine)
    about = [line for line in raised.value.messages if "aero.csv:1:1" in line]
    assert len(about) == 1 and "columns are separated by commas" in about[0]
