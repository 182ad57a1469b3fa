"""Check-cases flown, against final values of the published trajectories.

Values: rows at 30 s (case 17: at four instants) of Atmos_<case>_sim_04.csv, of cases 03 and 17 sim_06.csv,
of the NESC check-cases (NASA/TM-2015-218675) as in github.com/nasa/simupy-flight, NESC_data. The first is
printed with twelve digits. Simulator 04 flies the same exact US Standard Atmosphere; 06 has another one in
its fifth digit.
"""

import numpy as np
import pytest
import small_models

from shefex_nav.verify import compare, data, daveml, flight, nesc, vehicles
from shefex_nav.verify.vehicles import CASES, ROUND, WGS84

# case: {quantity: (value at 30 s, tolerance)} in ft, deg, deg/s, ft/s
DROPPED = 1e-3  # ft, of spheres that fall in the air of simulator 04
FINAL = {
    "01": {
        "altitude": (15598.9043522, 2e-6),
        "longitude": (5.74552213287e-5, 1e-12),
        "roll": (-0.125399679189, 1e-10),
        "velocity_east": (2.10101108617, 1e-8),
        "velocity_down": (960.293064507, 1e-7),
        "gravity": (32.15078136923117, 1e-9),
    },
    "02": {
        "altitude": (15598.9043522, 2e-6),
        "yaw": (-4.28935504226, 1e-6),
        "pitch": (-3.81965492189, 1e-6),
        "roll": (-56.1513075938, 1e-6),
        "roll_rate": (12.6183907757, 1e-6),
        "pitch_rate": (-17.3974747619, 1e-6),
        "yaw_rate": (31.1195888868, 1e-6),
    },
    "03": {
        "yaw": (-111.35836388895, 0.01),
        "pitch": (-38.69970978267, 0.01),
        "roll": (-5.148413928481, 0.01),
        "roll_rate": (-0.00118756, 1e-5),
        "pitch_rate": (0.00379005, 1e-5),
        "yaw_rate": (0.00131434, 1e-5),
    },
    "04": {
        "altitude": (16231.3059243, DROPPED),
        "velocity_down": (867.104924472, 1e-3),
        "yaw": (37.4532207898, 1e-6),
        "pitch": (17.7466327886, 1e-6),
        "roll": (17.9253021678, 1e-6),
        "gravity": (32.1686175166, 1e-8),
        "mach": (0.823961313844, 1e-6),
    },
    "05": {
        "altitude": (16276.3845488, DROPPED),
        "longitude": (5.34699823728e-5, 1e-10),
        "velocity_east": (1.84389833728, 1e-5),
        "velocity_down": (864.480181529, 1e-3),
    },
    "06": {
        "altitude": (16284.443772, DROPPED),
        "longitude": (5.33798251362e-5, 1e-10),
        "velocity_east": (1.84293085603, 1e-5),
        "velocity_down": (864.010905567, 1e-3),
        "density": (0.00143455024951, 1e-9),
        "dynamic_pressure": (535.458964683, 2e-3),
    },
    "07": {
        "altitude": (16285.1612472, DROPPED),
        "longitude": (1.28541735128e-4, 1e-9),
        "velocity_east": (4.70837589978, 1e-4),
        "velocity_down": (863.966976848, 1e-3),
        "mach": (0.821278969881, 1e-6),
    },
    "08": {
        "altitude": (16290.9978743, DROPPED),
        "longitude": (2.73579667279e-4, 2e-9),
        "velocity_east": (8.73099985197, 1e-3),
        "velocity_down": (863.694253332, 1e-3),
        "mach": (0.821132869398, 1e-6),
    },
    "09": {
        "altitude": (10160.9897645, 0.01),
        "longitude": (0.0616478507138, 5e-8),
        "velocity_east": (610.746581927, 1e-3),
        "velocity_down": (181.748229037, 1e-3),
    },
    "10": {
        "altitude": (10114.8055114, 0.01),
        "latitude": (0.0621356266972, 5e-8),
        "longitude": (-7.84759050703e-5, 1e-10),
        "velocity_north": (611.535615912, 1e-3),
        "velocity_east": (-1.06377240137, 1e-5),
        "roll_rate": (0.00417807413224, 1e-8),
    },
}
ROCKET = {  # time s: altitude ft, pitch deg
    50.0: (151007.424, 33.9687),
    100.0: (357974.516, 29.1702),
    150.0: (504788.687, 22.0786),
    200.0: (769281.570, 12.1575),
}


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """models(case) -> the models of a case."""
    folder = small_models.write(tmp_path_factory.mktemp("models"))
    return lambda case: [daveml.read(folder / name) for name in vehicles.MODELS[case.body]]


def at(history, quantity, t_s):
    """A quantity of a flight in the units of the trajectories."""
    row = round(t_s / flight.STEP_S)
    assert history.t_s[row] == pytest.approx(t_s)
    return history.values[quantity][row] / compare.QUANTITIES[quantity].si


@pytest.mark.parametrize("number", FINAL)
def test_a_case_ends_where_it_was_published_to_end(models, number):
    case = CASES[number]
    history = flight.fly(case, models(case))
    for quantity, (value, tolerance) in FINAL[number].items():
        assert at(history, quantity, 30.0) == pytest.approx(value, rel=0.0, abs=tolerance), quantity


def test_the_rocket_passes_where_it_was_published_to_pass(models):
    history = flight.fly(CASES["17"], models(CASES["17"]))
    for t_s, (altitude, pitch) in ROCKET.items():
        assert at(history, "altitude", t_s) == pytest.approx(altitude, rel=1e-3)
        assert at(history, "pitch", t_s) == pytest.approx(pitch, rel=0.0, abs=0.1)
    assert at(history, "yaw", 200.0) == pytest.approx(90.0, abs=1e-6)
    assert abs(at(history, "latitude", 200.0)) < 1e-9


@pytest.mark.parametrize(
    ("change", "good"),
    [
        ({}, True),
        ({"j2": 1.0826266e-3}, False),  # that of EGM96
        ({"rate": WGS84.rate * (1.0 + 1e-6)}, False),
        ({"radius_m": WGS84.radius_m + 1.0}, False),
    ],
)
def test_another_earth_fails_the_first_case(models, change, good):
    value = FINAL["01"]["altitude"][0]
    published = data.Series(np.array([0.0, 30.0]), {"altitudeMsl_ft": np.array([30000.0, value])})
    case = CASES["01"]._replace(planet=WGS84._replace(**change))
    history = flight.fly(case, models(case))
    assert compare.compare("01", history, {"04": published})["altitude"].ok is good


@pytest.mark.parametrize(
    ("number", "other"),
    [("05", CASES["05"]._replace(planet=ROUND._replace(rate=0.0))), ("07", CASES["06"]), ("08", CASES["07"])],
)
def test_rotation_wind_and_shear_are_seen(models, number, other):
    """Each differs from its neighbour by more than its tolerance."""
    history = flight.fly(other, models(other))
    value, _ = FINAL[number]["altitude"]
    assert abs(at(history, "altitude", 30.0) - value) > 0.5


@pytest.mark.parametrize("number", ["03", "06"])
def test_the_result_does_not_depend_on_the_tolerance(models, number):
    case = CASES[number]
    coarse, fine = (flight.fly(case, models(case), tolerance=limit) for limit in (1e-9, 1e-11))
    for quantity, limit in (("altitude", 1e-6), ("yaw", 1e-7), ("pitch", 1e-7), ("velocity_down", 1e-6)):
        assert coarse.values[quantity] == pytest.approx(fine.values[quantity], rel=0.0, abs=limit)


def test_all_published_trajectories_at_hand(nesc_data):
    files = data.search(nesc_data)
    chosen, _ = nesc.choose(files)
    assert chosen
    for number in chosen:
        assert nesc.run(files, number).failed == [], number


def test_the_published_rocket_departs_from_its_models_as_noted(nesc_data):
    """Area and moment of the published trajectory, from its own forces: 7.069 m^2, -1/2 dI/dt omega."""
    series = data.read_series(nesc_data / "Atmos_17" / "Atmos_17_sim_06.csv")
    aero, inertia, propulsion = (
        daveml.read(nesc_data / "models" / f"twostage_{name}.dml") for name in ("aero", "inertia", "prop")
    )
    burn = slice(5, 370)
    column = {name: values[burn] for name, values in series.columns.items()}
    pressure = column["dynamicPressure_lbf_ft2"] * compare.POUND / daveml.FOOT**2
    path = np.arctan2(-column["feVelocity_ft_s_Z"], column["feVelocity_ft_s_Y"])
    alpha = np.radians(column["eulerAngle_deg_Pitch"]) - path
    names = ("totalCoefficientOfLift", "totalCoefficientOfDrag", "aeroBodyMomentCoefficient_Pitch")
    lift, drag, turn = (
        np.array([daveml.evaluate(aero, name, alpha=np.degrees(a), beta=0.0) for a in alpha])
        for name in names
    )
    axial = pressure * (drag * np.cos(alpha) - lift * np.sin(alpha))
    area = -column["aero_bodyForce_lbf_X"] * compare.POUND / axial
    assert area == pytest.approx(np.pi * 1.5**2, rel=1e-4)

    flow = daveml.evaluate(propulsion, "mdot", stg1firing=1.0, stg2firing=0.0)
    used = [{"stagedFlag": 0.0, "stg1fuelUsed": flow * t, "stg2fuelUsed": 0.0} for t in series.t_s[burn]]
    forward, pitch = (
        np.array([daveml.evaluate(inertia, name, **inputs) for inputs in used]) for name in ("DXCG", "XIYY")
    )
    across = -pressure * area * (lift * np.cos(alpha) + drag * np.sin(alpha))
    model = pressure * area * 3.0 * turn + forward * across
    moment = column["aero_bodyMoment_ftlbf_M"] * compare.POUND * daveml.FOOT
    rate = np.gradient(pitch, series.t_s[burn]) * np.radians(column["bodyAngularRateWrtEi_deg_s_Pitch"])
    share = rate @ (moment - model) / (rate @ rate)
    assert share == pytest.approx(-0.5, abs=0.01)
    assert np.abs(moment - model - share * rate).max() < 1e-3 * np.abs(moment).max()
