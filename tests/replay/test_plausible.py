"""Files that are read otherwise than they were written: refused with what would fit, or warned of."""

import numpy as np
import pytest
from replay_files import CSV, scenario, write_csv

from shefex_nav.geometry import wgs84
from shefex_nav.replay import dataset, load, plausible
from shefex_nav.scenario.data_table import DataError

LATITUDE, LONGITUDE, HEIGHT = np.radians(67.9), np.radians(21.1), 340.0
REST_S, END_S, RATE = 10.0, 40.0, 50.0
THRUST = 40.0  # m/s^2
ELEVATION, AZIMUTH = np.radians(82.0), np.radians(30.0)
C, S = np.cos(ELEVATION), np.sin(ELEVATION)
RAIL = np.array([C * np.cos(AZIMUTH), C * np.sin(AZIMUTH), -S])  # north, east, down
STATIC = f"{{method: static, duration: 8 s, heading: {np.degrees(AZIMUTH):.3f} deg, azimuth: 1 deg}}"
NAMES = "vn", "ve", "vd"
SEED = 4


def flown(t_s, along, thrust):
    """Position (n, 3) m, e, and velocity (n, 3) m/s, n, of a straight way after a rest."""
    since = np.maximum(t_s - REST_S, 0.0)[:, None]
    C_en = wgs84.dcm_en(LATITUDE, LONGITUDE)
    r_e = wgs84.ecef_from_geodetic(LATITUDE, LONGITUDE, HEIGHT) + 0.5 * thrust * since**2 * along @ C_en.T
    v_e = thrust * since * along @ C_en.T
    places = [wgs84.geodetic_from_ecef(r)[:2] for r in r_e]
    return r_e, np.array([wgs84.dcm_en(*place).T @ v for place, v in zip(places, v_e, strict=True)])


def geodetic(r_e):
    """Latitude and longitude deg, height m."""
    place = np.array([wgs84.geodetic_from_ecef(r) for r in r_e])
    return np.column_stack([np.degrees(place[:, :2]), place[:, 2]])


def folder_of(folder, *, along=RAIL, thrust=THRUST, pitch=ELEVATION, noise=1.0, speed=1.0, truth=True):
    """CSVs of a vehicle whose x axis points along `pitch`; y right, z down. -> path of the scenario"""
    rng = np.random.default_rng(SEED)
    t_s = np.arange(0.0, END_S + 1e-9, 1.0 / RATE)
    f_b = np.array([np.sin(pitch), 0.0, -np.cos(pitch)]) * 9.82
    force = f_b + 0.01 * rng.standard_normal((len(t_s), 3)) + np.outer(t_s > REST_S, [thrust, 0.0, 0.0])
    write_csv(folder / "imu.csv", ("t", "wx", "wy", "wz", "fx", "fy", "fz"),
              np.column_stack([t_s, 1e-5 * rng.standard_normal((len(t_s), 3)), force]))  # fmt: skip
    fix_s = np.arange(0.5, END_S, 1.0)
    r_e, v_n = flown(fix_s, along, thrust)
    r_e = r_e + noise * rng.standard_normal(r_e.shape)
    v_n = v_n + 0.01 * noise * rng.standard_normal(v_n.shape)
    write_csv(
        folder / "gnss.csv",
        ("t", "lat", "lon", "h", *NAMES),
        np.column_stack([fix_s, geodetic(r_e), speed * v_n]),
    )
    true_s = np.arange(0.0, END_S + 1e-9, 0.2)
    r_e, v_n = flown(true_s, along, thrust)
    angles = np.tile(np.degrees([0.0, pitch, AZIMUTH]), (len(true_s), 1))
    write_csv(folder / "truth.csv", ("t", "lat", "lon", "h", *NAMES, "roll", "pitch", "heading"),
              np.column_stack([true_s, geodetic(r_e), v_n, angles]))  # fmt: skip
    data = CSV.format(rate=RATE)
    if truth:
        return scenario(folder, data)
    return scenario(folder, data[: data.index("  truth:")], alignment=STATIC)


def check(path, *overrides):
    """Oddities of a scenario, read with overrides."""
    one, files = load.load(path, overrides)
    return plausible.check(one, dataset.read(one, files))


def refused(path, *overrides):
    with pytest.raises(DataError) as info:
        check(path, *overrides)
    said = str(info.value)
    assert "\n" not in said
    return said


@pytest.fixture(scope="module")
def rocket(tmp_path_factory):
    return folder_of(tmp_path_factory.mktemp("rocket"))


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Without truth."""
    return folder_of(tmp_path_factory.mktemp("alone"), truth=False)


CAR = {"along": np.array([0.6, 0.8, 0.0]), "thrust": 1.0, "pitch": 0.0}


@pytest.mark.parametrize("truth", [True, False])
@pytest.mark.parametrize("how", [{}, CAR, {"thrust": 0.0}, {"noise": 5.0}])
def test_what_is_right_passes_without_a_word(tmp_path, how, truth):
    """A rocket, a car, one that stays where it is, and a receiver five times as noisy as it says."""
    assert check(folder_of(tmp_path, truth=truth, **how)) == []


@pytest.mark.parametrize("frame", ["enu", "ecef"])
@pytest.mark.parametrize("section", ["gnss", "truth"])
def test_velocities_in_another_frame(rocket, section, frame):
    field = f"data.{section}.velocity_frame"
    said = refused(rocket, f"{field}={frame}")
    assert said.startswith(f"{field}: ") and f"taken as {frame}" in said
    assert "they fit as 'velocity_frame: ned'" in said


def test_velocities_in_another_frame_of_a_car(tmp_path):
    said = refused(
        folder_of(tmp_path, **CAR | {"along": np.array([0.95, 0.31, 0.0])}), "data.gnss.velocity_frame=enu"
    )
    assert "they fit as 'velocity_frame: ned'" in said


@pytest.mark.parametrize(
    ("factor", "words"), [(3.6, "km/h"), (1.943844, "knots"), (3.28084, "ft/s"), (1e-3, "km/s")]
)
def test_velocities_in_another_unit(tmp_path, factor, words):
    assert f"they fit as velocities in {words}: give them in m/s" in refused(
        folder_of(tmp_path, speed=factor)
    )


def test_velocities_whose_third_column_has_the_other_sign(tmp_path):
    said = refused(folder_of(tmp_path, speed=np.array([1.0, 1.0, -1.0])))
    assert "they fit as velocities with the sign of the third column turned" in said


def test_velocities_that_nothing_explains_are_warned_of(tmp_path):
    (one,) = check(folder_of(tmp_path, speed=np.array([0.2, 5.0, 0.4]), truth=False))
    assert one.field == "data.gnss.velocity_frame" and "of the way" in one.text and "fit" not in one.text


TRUTH = "data.truth.position"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c | {"lat": np.radians(c["lat"]), "lon": np.radians(c["lon"])}, "angle_unit: rad"),
        (lambda c: c | {"lat": c["lon"], "lon": c["lat"]}, "change places"),
        (lambda c: c | {"lon": -c["lon"]}, "the sign of its longitude is turned"),
        (lambda c: c | {"h": c["h"] / 1e3}, "its heights are kilometres"),
        (lambda c: c | {"h": c["h"] / 0.3048}, "its heights are feet"),
        (lambda c: c | {"lat": c["lat"] + 3.0}, "no other unit explains that"),
    ],
)
def test_truth_in_another_unit(tmp_path, change, words):
    path = folder_of(tmp_path)
    head, *rows = (tmp_path / "truth.csv").read_text().splitlines()
    names = head.split(",")
    columns = dict(zip(names, np.array([row.split(",") for row in rows], dtype=float).T, strict=True))
    write_csv(tmp_path / "truth.csv", names, np.column_stack(list(change(columns).values())))
    said = refused(path)
    assert words in said and "truth.csv: truth is " in said


def test_truth_that_is_off_by_the_height_of_the_geoid_is_warned_of(tmp_path):
    path = folder_of(tmp_path)
    head, *rows = (tmp_path / "truth.csv").read_text().splitlines()
    values = np.array([row.split(",") for row in rows], dtype=float) + np.array([0, 0, 0, 32.0, *[0] * 6])
    write_csv(tmp_path / "truth.csv", head.split(","), values)
    (one,) = check(path)
    assert one.field == TRUTH and "truth is 32" in one.text and "heights above the sea" in one.text


@pytest.mark.parametrize(
    ("axes", "up", "side"),
    [
        ("[y, -x, z]", "x", "left"),
        ("[-x, -y, z]", "x", "backward"),
        ("[z, y, -x]", "x", "up"),
        ("[z, x, y]", "x", "right"),
    ],
)
def test_a_wrong_nose_axis(rocket, alone, axes, up, side):
    """The file's x points up: against truth it is refused, against a climb it is warned of."""
    said = refused(rocket, f"data.axes={axes}")
    assert f"data.axes: in axes {axes} the specific force points " in said and "[x, y, z]" in said
    (one,) = check(alone, f"data.axes={axes}")
    assert (
        one.field == "data.axes"
        and f"axis {up} points up, which data.axes calls {side}; then the vehicle climbs" in one.text
    )


def test_axes_of_a_car_against_its_truth(tmp_path):
    path = folder_of(tmp_path, **CAR)
    said = refused(path, "data.axes=[x, -y, -z]")
    assert "deg from where the truth has it" in said and "it fits in [x, y, z]" in said
    (one,) = check(path, "data.axes=[-x, -y, z]")  # what gravity does not tell, 1 m/s^2 does
    assert one.field == "data.axes" and one.text.endswith("it fits in [x, y, z]")


def test_the_command_refuses_and_warns(command, rocket, alone):
    import json

    result = command("replay", rocket, "--set", "data.gnss.velocity_frame=enu")
    assert result.code == 2 and result.out == "" and "velocity_frame: ned" in result.err
    result = command("replay", alone, "--json", "--set", "data.axes=[z, y, -x]")
    assert result.code == 0, result.err
    summary = json.loads(result.out)
    assert [one["field"] for one in summary["warnings"]] == ["data.axes"]
    flight = summary["flight"]
    assert flight["of"] == "solution" and flight["apogee_km"] is None  # it still climbs
    way = 0.5 * THRUST * (END_S - REST_S) ** 2 * np.sin(ELEVATION)
    assert flight["climbs_at_km"] == pytest.approx((HEIGHT + way) / 1e3, rel=0.05)
    shown = command("replay", alone)
    assert "stands on the ground" not in shown.out and "height at the end" in shown.out
    assert "there is no truth" in shown.out
