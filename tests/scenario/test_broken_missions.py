"""Missions that cannot be flown: start, air, wind, programme, outages; one message for each fault."""

import importlib.util

import pytest
from broken import DEFAULT, TEXT, check_one_message, messages, the_message

from shefex_nav.scenario import checks_flight
from shefex_nav.scenario.load import load

LAUNCH = TEXT[TEXT.index("launch: #") : TEXT.index("vehicle:")]
ORBIT = (
    "orbit: {perigee_height: 500 km, apogee_height: 520 km, inclination: 97 deg, node: 0 deg, "
    "perigee: 0 deg, anomaly: 0 deg}\n"
)
DWELL = "    task: dwell\n    from: 250 s\n    until: 372 s\n"

# kind: (text in the default scenario, what stands there instead, where "@" is the place complained about,
#        field, words)
BROKEN = {
    "no start": (
        LAUNCH,
        "",
        "launch",
        "is missing; a flight starts from exactly one of launch, orbit and ground",
    ),
    "two starts": (
        "launch: #",
        f"{ORBIT[:7]}@{ORBIT[7:]}launch: #",
        "orbit",
        "from exactly one of launch, orbit and ground, here are launch and orbit; launch: null takes away",
    ),
    "gravity": ("gravity: egm96", "gravity: @egm69", "earth.gravity", "did you mean 'egm96'?"),
    "degree of gravity": (
        "gravity_degree: 12",
        "gravity_degree: @1",
        "earth.gravity_degree",
        "must be at least 2, got 1",
    ),
    "air without its Sun": (
        "model: us76 # or 'msis', NRLMSIS 2, with the Sun of the day below\n  density: 100 %\n"
        "  msis: {f107: 97.7, f107_average: 127.3, ap: 4} # 22 June 2012\n",
        "model: msis\n",
        "atmosphere.msis",
        "is missing; msis needs it, for example",
    ),
    "no air": ("density: 100 %", "density: @0 %", "atmosphere.density", "must be greater than zero"),
    "wind from a word": ("wind: none", "wind: @calm", "wind", "'calm' is not known; choose from: none"),
    "wind with a hole": (
        "wind: none",
        "wind: {height: [0 m, 1 km], speed: [3 m/s, 5 m/s], from: @[90 deg]}",
        "wind.from",
        "1 values for 2 heights; give one for each",
    ),
    "wind upside down": (
        "wind: none",
        "wind: {height: [1 km, @0 m], speed: [3 m/s, 5 m/s], from: [90 deg, 90 deg]}",
        "wind.height.1",
        "heights must increase: 0 m follows 1000 m",
    ),
    "wind with a negative speed": (
        "wind: none",
        "wind: {height: [0 m], speed: [@-3 m/s], from: [90 deg]}",
        "wind.speed.0",
        "must not be negative, got '-3 m/s'",
    ),
    "wind without direction": (
        "wind: none",
        "@wind: {height: [0 m], speed: [3 m/s]}",
        "wind.from",
        "is missing",
    ),
    "wind without unit": (
        "wind: none",
        "wind: {height: [0 m], speed: [@3], from: [90 deg]}",
        "wind.speed.0",
        "3 has no unit; write it with one, for example '3 m/s'",
    ),
    "unknown task": ("task: damp", "task: @dampen", "programme.damping.task", "did you mean 'damp'?"),
    "no task": ("  damping:\n    task: damp\n", "  @damping:\n", "programme.damping.task", "is missing"),
    "value for a task": (
        "  damping:\n    task: damp\n    from: 65 s\n    until: 70 s\n",
        "  damping: @70 s\n",
        "programme.damping",
        "expected a section with keys of its own, got '70 s'",
    ),
    "key of another task": (
        "    task: damp\n",
        "    task: damp\n    @rate: 1 Hz\n",
        "programme.damping.rate",
        "does not go with damp; take one of the two away",
    ),
    "misspelt key of a task": (
        "    until: 70 s\n",
        "    @untill: 70 s\n",
        "programme.damping.untill",
        "unknown key; did you mean 'until'?",
    ),
    "task without end": (
        "    task: damp\n    from: 65 s\n    until: 70 s\n",
        "    task: damp\n    from: 65 s\n",
        "programme.damping.until",
        "is missing; expected for example 'until: 145 s'",
    ),
    "choice without a word": (
        "    shutter: global # or rolling, with a line_time\n",
        "",
        "star_camera.detector.shutter",
        "is missing; choose from: global, rolling",
    ),
    "turning with an orbit on a rocket": (
        "    task: damp\n",
        "    task: @turn_with_orbit\n",
        "programme.damping.task",
        "turn_with_orbit is for a vehicle in orbit: the scenario has no section orbit",
    ),
    "pointing to nadir on a rocket": (
        "    task: damp\n",
        "    task: @point_nadir\n",
        "programme.damping.task",
        "point_nadir is for a vehicle in orbit: the scenario has no section orbit",
    ),
    "task that ends before it starts": (
        "until: 145 s",
        "until: @60 s",
        "programme.precession.until",
        "60 s must be later than from, 70 s",
    ),
    "tasks that overlap": (
        "from: 70 s",
        "from: @69 s",
        "programme.precession.from",
        "69 s is before the end of damping, 70 s; tasks must not overlap",
    ),
    "task on the pad": (
        "from: 65 s",
        "from: @-5 s",
        "programme.damping.from",
        "-5 s must not be before lift-off, 0 s",
    ),
    "task past the end": (
        "until: 384 s\n    at: 405 s",
        "until: @700 s\n    at: 405 s",
        "programme.entry_slew.until",
        "700 s is after mission.time_limit, 600 s",
    ),
    "aim in the past": (
        "at: 405 s",
        "at: @300 s",
        "programme.entry_slew.at",
        "300 s must not be before the task, which starts at 372 s",
    ),
    "aim past the end": (
        "at: 405 s",
        "at: @700 s",
        "programme.entry_slew.at",
        "700 s is after mission.time_limit, 600 s",
    ),
    "elevation": (
        "elevation: 52 deg",
        "elevation: @95 deg",
        "programme.slew.elevation",
        "must be at most 90 deg",
    ),
    "spin in radians without saying so": (
        "rate: 0 deg/s",
        "rate: @6.28",
        "programme.despin.rate",
        "6.28 has no unit",
    ),
    "rates without fading": (
        DWELL,
        f"{DWELL}    boresight_rate: 0.1 deg/s\n",
        "programme.pointing.ramp",
        "is missing; rates must fade in and out, expected for example 'ramp: 5 s'",
    ),
    "turning rate without period": (
        DWELL,
        f"{DWELL}    cross_rate: 0.1 deg/s\n    ramp: 5 s\n",
        "programme.pointing.cross_period",
        "is missing; cross_rate needs it, for example 'cross_period: 40 s'",
    ),
    "fading longer than the task": (
        DWELL,
        f"{DWELL}    boresight_rate: 0.1 deg/s\n    ramp: @70 s\n",
        "programme.pointing.ramp",
        "fading in and out takes 140 s, the task lasts 122 s only",
    ),
    "name of a task": (
        "  damping:\n",
        "  @damp.ing:\n",
        "programme.damp.ing",
        "'damp.ing' must be one word of letters, digits, '-' and '_'",
    ),
    "attitude": ("attitude: flown", "attitude: @flow", "attitude", "did you mean 'flown'?"),
    "unknown event": (
        "event: lift_off",
        "event: @liftoff",
        "gps.outages.0.event",
        "'liftoff' is no event of this flight; did you mean 'lift_off'?; choose from: lift_off, rail_exit",
    ),
    "event of another flight": (
        "event: separation_1",
        "event: @separation_2",
        "gps.outages.2.event",
        "'separation_2' is no event of this flight; did you mean 'separation_1'?",
    ),
    "outage inside out": (
        "shortest: 0 s, longest: 2 s",
        "shortest: @3 s, longest: 2 s",
        "gps.outages.0.shortest",
        "3 s is longer than longest, 2 s",
    ),
    "rate of the log": (
        "  rate: 100 Hz # of",
        "  rate: @25 Hz # of",
        "log.rate",
        "25 Hz is not offered; choose from: 10 Hz",
    ),
    "too long": ("time_limit: 600 s", "time_limit: @13 h", "mission.time_limit", "must be at most 12 h"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_one_message_that_names_place_and_field(tmp_path, kind):
    check_one_message(tmp_path, *BROKEN[kind])


def test_a_mission_too_short_says_what_does_not_fit():
    said = messages(DEFAULT, ["mission.time_limit=390 s"])
    assert [line.split(": ")[1] for line in said] == ["programme.entry_slew.at"]
    assert "405 s is after mission.time_limit, 390 s" in said[0]


def test_a_flight_too_short_for_its_programme_says_how_to_shorten_it():
    """One message, of the first task that does not fit, and what it says works."""
    path = DEFAULT.parent / "impa.yaml"
    said = [line for line in messages(path, ["mission.time_limit=60 s"]) if "programme" in line]
    words = (
        "105 s is after mission.time_limit, 60 s; for a shorter flight give 60 s here and null for what comes"
    )
    assert len(said) == 1 and said[0].split(": ", 1)[1].startswith("programme.pointing.until: ")
    assert f"{words} after it (faster)" in said[0]
    said = [line for line in messages(path, ["mission.time_limit=30 s"]) if "programme" in line]
    words = "30 s is not before mission.time_limit, 30 s; for a shorter flight give null for pointing, faster"
    assert len(said) == 1 and f"programme.pointing.from: {words}" in said[0]
    shorter = ["mission.time_limit=60 s", "programme.pointing.until=60 s", "programme.faster=null"]
    scenario = load(path, [*shorter, "star_tracker.off=59 s"])
    assert [task.end for _, task in scenario.tasks] == [30.0, 60.0]


def test_what_a_variant_contradicts_is_to_be_changed_in_the_variant(tmp_path):
    path = tmp_path / "variant.yaml"
    path.write_text(f"extends: {DEFAULT}\nmission:\n  time_limit: 390 s\n", encoding="utf-8")
    said = the_message(path)
    assert said.startswith(f"{DEFAULT}:") and "405 s is after mission.time_limit, 390 s" in said
    assert said.endswith(f" (set in {DEFAULT}; change it in {path}, which extends it)")
    path.write_text(f"extends: {DEFAULT}\nprogramme: {{entry_slew: {{at: 700 s}}}}\n", encoding="utf-8")
    assert "change it in" not in the_message(path)  # it is written there
    assert "change it in" not in the_message(DEFAULT, ["mission.time_limit=390 s"])


def test_valves_keep_up_with_the_bandwidth():
    said = the_message(DEFAULT, ["vehicle.cold_gas.period=1 s"])
    assert "bandwidth: 1 rad/s is too fast for valves that work every 1000 ms; at most 0.5 rad/s" in said


def test_flown_tasks_need_cold_gas():
    said = the_message(DEFAULT, ["vehicle.cold_gas=null"])
    assert said.endswith(
        "vehicle.cold_gas: is missing; tasks are flown by a cold-gas system (or write attitude: prescribed)"
    )


def test_msis_without_its_package(monkeypatch):
    """One message says what to install."""
    monkeypatch.setattr(checks_flight, "find_spec", lambda _: None)
    said = the_message(DEFAULT, ["atmosphere.model=msis"])
    assert said == (
        "--set atmosphere.model: msis needs the package pymsis, which is not installed: "
        "pip install 'shefex-nav[msis]'; or take us76"
    )
    assert importlib.util.find_spec("shefex_nav") is not None  # the real one is untouched


def test_a_vehicle_on_the_ground_does_nothing():
    """Everything that it cannot do is named, each once."""
    ground = (
        "ground={latitude: 48 deg, longitude: 11 deg, height: 600 m, azimuth: 0 deg, elevation: 0 deg, "
        "roll: 0 deg}"
    )
    said = messages(DEFAULT, ["launch=null", ground])
    fields = sorted(line.split(": ")[1] for line in said)
    assert fields == sorted(
        [
            "vehicle.stages.S40M",
            "vehicle.stages.S44",
            *(
                f"programme.{name}"
                for name in ("damping", "precession", "despin", "slew", "pointing", "entry_slew")
            ),
            "vehicle.spin_motors",
            "vehicle.yo_yo",
            "vehicle.cold_gas",
            *(f"gps.outages.{n}" for n in range(5)),
        ]
    )


def test_an_orbit_inside_out():
    orbit = ORBIT.strip().replace("orbit: ", "orbit=").replace("520 km", "400 km")
    overrides = ["launch=null", orbit, "gps.outages=[]", "mission.start=0 s"]
    assert (
        the_message(DEFAULT, overrides)
        == "--set orbit: orbit.apogee_height: must not be below perigee_height, 500 km"
    )


NOT_THERE = {
    "star_tracker.colour=null": "--set star_tracker.colour: null takes away what the scenario gives; "
    "star_tracker.colour is not given",
    "gps.outages.0=null": "--set gps.outages.0: an item of gps.outages cannot be taken away; "
    "give the whole list",
    "vehicle.cold_gas.torque=null": "expected a list of 3 values; for example [60 N m, 60 N m, 60 N m]",
    "gps.outages=null": "is missing; expected a list, 'outages: []' is one without any",
    "vehicle.stages.S44.aerodynamics.roll_damping=null": "'roll_damping: [-5, -5]'",
    "gps.latency=null": "is missing; expected for example 'latency: 0.2 s'",
}


@pytest.mark.parametrize("override", NOT_THERE)
def test_taking_away_what_is_needed_or_not_there(override):
    assert the_message(DEFAULT, [override]).endswith(NOT_THERE[override])


def test_taking_away_in_a_file_what_its_base_does_not_give(tmp_path):
    path = tmp_path / "top.yaml"
    path.write_text(f"extends: {DEFAULT}\nvehicle:\n  parachut: null\n", encoding="utf-8")
    assert the_message(path) == (
        f"{path}:3:3: vehicle.parachut: null takes away what the extended file gives, "
        "which is nothing; leave it out"
    )


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["programme.damping.from=0 s"], "0 s must be later than the first ignition, 0 s"),
        (["vehicle.yo_yo.at=200 s"], "200 s is before the burn-out of S44, 217.2 s"),
        (["gps.antenna.lever_arm=[1e9 m, 0 m, 0 m]"], "must be at most 1 km, got '1e9 m'"),
        (["pad_alignment.azimuth=1e5 deg"], "must be at most 180 deg, got '1e5 deg'"),
        (["star_camera.detector.readout=1e6 s"], "must be at most 100 s, got '1e6 s'"),
        (["vehicle.payload.station=2600 m"], "2600 m is behind the last nozzle exit, 12.6 m"),
        (
            ["vehicle.stages.S44.aerodynamics.roll_damping=[" + ", ".join(["0.15"] * 11) + "]"],
            "must be at most 0.0, got 0.15",
        ),
    ],
)
def test_slips_that_would_fly_nonsense(overrides, words):
    assert words in "\n".join(messages(DEFAULT, overrides))
