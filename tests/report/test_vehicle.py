"""The vehicle as it is looked at: against the forces, the moments and the swing of the flight itself."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.commands.app import main
from shefex_nav.report import vehicle
from shefex_nav.report.figures import style
from shefex_nav.report.figures import vehicle as figures
from shefex_nav.scenario import load

SCENARIOS = Path(__file__).parents[2] / "scenarios"
STORM = "wind={height: [0 m, 20 km], speed: [15 m/s, 15 m/s], from: [0 deg, 0 deg]}"


@pytest.fixture(scope="module")
def rexus():
    return vehicle.look(load.load("rexus_like"))


@pytest.fixture(scope="module")
def swinging():
    """A rocket that does not spin, pushed by the wind at the end of its rail."""
    told = ["vehicle.stages.Orion.aerodynamics.fin_cant=0 deg", "vehicle.yo_yo=null"]
    told += ["vehicle.stages.Orion.motor.misalignment=[0 deg, 0 deg]"]
    told += ["vehicle.payload.centre_of_mass_offset=[0 mm, 0 mm]"]
    return vehicle.look(load.load("rexus_like", told))


def test_thrust_less_drag_is_what_an_accelerometer_feels(rexus):
    """Along the roll axis at angles of attack of a degree, 1e-3 of the larger force and lever arms apart."""
    seen, trajectory = rexus.profile, rexus.flight.trajectory
    part = (seen.t_s > 2.0) & (seen.t_s < 45.0)
    force = np.interp(seen.t_s, trajectory.t_s, trajectory.f_b[:, 0] * trajectory.mass_kg)
    difference = (seen.thrust - seen.drag - force)[part]
    assert np.abs(difference).max() < 1e-3 * np.abs(force[part]).max()
    coasting = (seen.t_s > 27.0) & (seen.t_s < 40.0)  # drag alone
    np.testing.assert_allclose(seen.drag[coasting], -force[coasting], rtol=0.02)


def test_drag_under_the_parachute_is_the_weight(rexus):
    falling = rexus.profile.t_s > 700.0
    np.testing.assert_allclose(rexus.profile.drag[falling], 112.0 * 9.82, rtol=0.01)


def test_centre_of_mass_and_margin_follow_from_the_table(rexus):
    """Burnt out: payload and empty stage; centre of pressure by the scenario's own rows."""
    seen = rexus.profile
    k = int(np.searchsorted(seen.t_s, 40.0))
    centre = (112.0 * 1.55 + 140.0 * 4.25) / 252.0
    assert seen.centre[k] == pytest.approx(centre, abs=1e-9)
    row = int(np.argmin(np.abs(seen.mach[:200] - 1.5)))
    assert seen.pressure[row] == pytest.approx(4.4, abs=0.02)
    assert seen.margin[row] == pytest.approx((seen.pressure[row] - seen.centre[row]) / 0.356, rel=1e-9)


def test_a_rocket_swings_with_the_frequency_that_is_told(swinging):
    """Without spin the resonance is the pitch frequency but for 1 - I_x/I_t: half turns are counted."""
    seen, trajectory = swinging.profile, swinging.flight.trajectory
    part = (trajectory.t_s > 0.8) & (trajectory.t_s < 4.0)
    rate, t_s = trajectory.omega_ib_b[part], trajectory.t_s[part]
    rate = rate[:, 1] if np.ptp(rate[:, 1]) > np.ptp(rate[:, 2]) else rate[:, 2]
    slope = np.gradient(rate, t_s)
    crossings = t_s[1:][slope[1:] * slope[:-1] < 0.0]
    body = np.interp(crossings, seen.t_s, np.nan_to_num(seen.resonant))
    inertia = 1.0 - 9.0 / 400.0  # I_x/I_t of this rocket, about
    turned = np.trapezoid(np.interp(t_s, seen.t_s, seen.resonant) * np.sqrt(inertia) * (
        (t_s >= crossings[0]) & (t_s <= crossings[-1])), t_s)  # fmt: skip
    assert len(crossings) >= 5 and body.min() > 0.0
    assert turned / np.pi == pytest.approx(len(crossings) - 1, rel=0.05)


def test_the_largest_loads_are_those_of_all_samples():
    """A peak of the igniter of 40 ms, and a parachute that fills at once."""
    curve = (
        "{time: [0 s, 0.02 s, 0.03 s, 0.06 s, 10 s, 26 s], force: [0 N, 150 kN, 200 kN, 30 kN, 29 kN, 0 N]}"
    )
    motor = f"{{thrust: {curve}, measured_at: vacuum, exit_area: 0.03 m2, exit_station: 5.6 m}}"
    told = [f"vehicle.stages.Orion.motor={motor}", "vehicle.parachute.inflation=10 ms"]
    looked = vehicle.look(load.load("rexus_like", told))
    found = vehicle.summary(looked)
    assert 196e3 < found["largest_thrust_n"] < 200e3
    trajectory, open_s = looked.flight.trajectory, vehicle.at(looked.flight, "parachute")
    opening = (trajectory.t_s > open_s) & (trajectory.t_s < open_s + 0.02)
    pressure = trajectory.dynamic_pressure_pa[opening]
    canopy = 27.0 * pressure * np.clip((trajectory.t_s[opening] - open_s) / 0.01, 0.0, 1.0)
    assert canopy.max() < found["largest_drag_n"] < 1.1 * canopy.max()


def test_the_spin_passes_the_resonance_where_the_curves_cross(rexus):
    (t_s, hz, stays), *more = vehicle.resonances(rexus)
    seen = rexus.profile
    assert not more and 4.0 < t_s < 6.0 and 0.0 < stays < 3.0
    k = int(np.searchsorted(seen.t_s, t_s))
    assert (abs(seen.spin[k - 1]) - seen.resonant[k - 1]) * (abs(seen.spin[k]) - seen.resonant[k]) <= 0.0
    assert hz == pytest.approx(abs(seen.spin[k]) / 2.0 / np.pi, rel=0.05)


def test_a_spin_that_a_separation_leaves_beyond_the_resonance_passes_none(rexus):
    """The resonant spin jumps then; the warning said '0.0 s within 10 %'."""
    profile, ((t_s, *_), *more) = rexus.profile, vehicle.resonances(rexus)
    dropped = profile.configuration + (profile.t_s > t_s)
    assert len(vehicle.resonances(rexus._replace(profile=profile._replace(configuration=dropped)))) == len(
        more
    )


def test_a_rocket_without_spin_passes_no_resonance(swinging):
    assert vehicle.resonances(swinging) == []


@pytest.mark.parametrize(
    ("told", "field", "words"),
    [
        ([STORM], "launch.rail_length", "15.0 m/s"),
        (["imu.gyro.range=500 deg/s"], "imu.gyro.range", "axis x reaches"),
        (["vehicle.payload.station=2.9 m"], "vehicle.stages.Orion.aerodynamics", "static margin falls to 0."),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_field(told, field, words):
    found = vehicle.warnings(vehicle.look(load.load("rexus_like", told)))
    assert any(".".join(one.field) == field and words in one.text for one in found), found


def test_angles_beyond_the_table_are_told_and_brake_all_the_same(tmp_path):
    """A payload that tumbles, with a table that ends at 30 deg."""
    lines = (SCENARIOS / "data" / "rexus_payload_aero.csv").read_text().splitlines()
    rows = [one for one in lines if not one[:1].isdigit() or float(one.split(",")[1]) <= 30.0]
    (tmp_path / "short.csv").write_text("\n".join(rows) + "\n")
    told = [f"vehicle.payload.aerodynamics.file={tmp_path / 'short.csv'}"]
    looked = vehicle.look(load.load("rexus_like", told))
    assert looked.profile.drag.min() >= 0.0
    found = [one for one in vehicle.warnings(looked) if "its table ends at 30 deg" in one.text]
    assert [one.field for one in found] == [("vehicle", "payload", "aerodynamics")]


def test_a_good_rocket_is_told_its_resonance_alone(rexus):
    assert [one.text.split(" at ")[0] for one in vehicle.warnings(rexus)] == [
        "the spin passes the resonance with the pitch motion"
    ]


def test_only_what_is_launched_is_looked_at():
    with pytest.raises(vehicle.VehicleError, match="no section launch"):
        vehicle.look(load.load("night_sky"))


def test_the_drawing_is_to_scale(rexus):
    """Grain and nozzle have the numbers of the scenario, both axes one scale."""
    figure = figures.drawing(rexus)
    top = figure.axes[0]
    grains = [(p.get_x(), p.get_width(), p.get_height()) for p in top.patches]
    assert grains == [pytest.approx((2.9, 2.2, 0.105))] * 2
    assert top.get_aspect() == 1.0 and all(axes.get_xlim() == top.get_xlim() for axes in figure.axes)
    style.svg(figure)


def test_command_prints_a_table_and_writes_page_and_picture(tmp_path, monkeypatch, capsys):
    def command(*words):
        monkeypatch.setattr("sys.argv", ["shefex-nav", "vehicle", "rexus_like", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    code, said = command("--output", tmp_path / "v.html")
    assert code == 0 and "least margin, way up" in said.out and "warning:" in said.err
    for name in ("apogee", "total impulse, vacuum", "specific impulse, vacuum", "burn time"):
        assert name in said.out
    page = (tmp_path / "v.html").read_text()
    assert len(re.findall("<figure ", page)) == 2 and "improved_orion_like" not in re.sub(
        "<pre>.*", "", page, flags=re.S
    )
    code, said = command("--json", "--output", tmp_path / "v.png")
    assert json.loads(said.out)["configurations"][0]["mass_kg"][0] == pytest.approx(542.0)
    assert re.search(r"warning: \S*rexus_like\.yaml:\d+", "".join(said.err.split("\n")))
    assert (tmp_path / "v.png").read_bytes()[:4] == b"\x89PNG"
    assert command("--output", tmp_path / "v.png")[0] == 2
    assert command("--output", tmp_path / "v.pdf")[0] == 2
