"""In which winds a rocket may be launched: verdicts by hand, drift of a stage, and the command."""

import json
import math

import pytest

from shefex_nav.campaign.impact import landing, winds
from shefex_nav.commands.app import main
from shefex_nav.report import track

ROCKET = """
extends: rexus_like
mission: {name: rexus_winds, description: In which winds}
vehicle:
  stages:
    Orion:
      spent: {area: 0.0995 m2, mach: [0, 0.8, 1.1, 2, 4], drag: [4.0, 4.5, 6.0, 5.0, 4.5]}
"""
CALM = winds.Down((landing.Landing("stage", 300.0, 1.2, 0.35, 100.0, 1.4),), 0.1, 1.4, 40.0)
ASKED = winds.Asked("x", (), (2.0, 4.0, 8.0), 10e3, None, None, None, 1, 1)


@pytest.fixture(scope="module")
def rocket(tmp_path_factory):
    path = tmp_path_factory.mktemp("rocket") / "rocket.yaml"
    path.write_text(ROCKET)
    return str(path)


def landed(north_km, exit_speed=40.0):
    one = landing.Landing("stage", 300.0, 1.2 + north_km / 6394.0, 0.35, 100.0, 1.4)
    return winds.Down((one,), 0.1, 1.4, exit_speed)


@pytest.mark.parametrize(
    ("down", "speed", "reasons"),
    [
        (landed(9.0), 4.0, ()),
        (landed(11.0), 4.0, ("stage off: 11.0 km",)),
        (landed(1.0, exit_speed=15.9), 4.0, ("angle of attack at the end of the rail: 14 deg",)),
        (landed(1.0, exit_speed=16.1), 4.0, ()),
        (None, 4.0, ("it breaks",)),
    ],
)
def test_what_is_go(down, speed, reasons):
    found = winds._cell(ASKED, CALM, "N", speed, down, "it breaks")
    assert tuple(map(str, found.reasons)) == reasons


def test_go_up_to_the_last_wind_before_the_first_that_is_not():
    far = (winds.Reason("far"),)
    cells = [winds.Cell(v, "N", None, {}, reasons) for v, reasons in ((2.0, ()), (4.0, far), (8.0, ()))]
    table = winds.Table("x", 1, 0.0, 10e3, None, CALM, (), tuple(cells))
    assert winds.most(table, "N") == 2.0 and winds.most(table, "S") is None


@pytest.mark.slow
def test_a_stage_drifts_as_far_as_the_wind_is_strong(rocket):
    """Weathercocking and fall are nearly linear in a wind of a few m/s, and opposite in opposite winds."""

    def place(speed, whence):
        down, error = winds.launch(rocket, (), 1, 300.0, None, None, speed, whence)
        assert not error
        one = next(one for one in down.landings if one.body == "Orion")
        return one.latitude, one.longitude

    calm = place(0.0, "N")
    north, twice, south = (place(*wind) for wind in ((1.0, "N"), (2.0, "N"), (1.0, "S")))
    east = place(1.0, "E")
    assert north[0] > calm[0] > south[0] and east[1] > calm[1]  # it turns into the wind, and its burn is long
    drift = track.ground_distance(*calm, *north)
    assert drift > 500.0
    assert track.ground_distance(*calm, *twice) == pytest.approx(2.0 * drift, rel=0.1)
    assert track.ground_distance(*north, *south) == pytest.approx(2.0 * drift, rel=0.1)


def test_the_command(rocket, tmp_path, capsys, monkeypatch):
    words = ["shefex-nav", "winds", rocket, "--within", "12 km", "--speeds", "3 m/s", "--workers", "1"]
    monkeypatch.setattr("sys.argv", [*words, "--json", "--figure", str(tmp_path / "winds.png")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["winds"]) == 8 and {one["speed_m_s"] for one in found["winds"]} == {3.0}
    assert {one["go"] for one in found["winds"]} == {True, False}
    for one in found["winds"]:
        far = max(one["off_m"].values())
        assert one["go"] == (far <= 12e3 and one["rail_exit_speed_m_s"] >= 12.0)
        assert math.isfinite(far)
    assert (tmp_path / "winds.png").stat().st_size > 20_000


def test_a_body_that_does_not_come_off_is_no_go():
    both = winds.Down((*CALM.landings, CALM.landings[0]._replace(body="Booster")), 0.1, 1.4, 40.0)
    found = winds._cell(ASKED, both, "N", 4.0, landed(1.0), "")
    assert [str(reason) for reason in found.reasons] == ["Booster lands in this wind, or in still air, alone"]


def test_bodies_that_differ_by_a_digit_are_told_apart():
    down = winds.Down(tuple(CALM.landings[0]._replace(body=f"Stage{k}") for k in (1, 2)), 0.1, 1.4, 40.0)
    one, two = down.landings
    moved = [down._replace(landings=(one._replace(latitude=1.21), two)),
             down._replace(landings=(one, two._replace(latitude=1.21)))]  # fmt: skip
    cells = [winds._cell(ASKED, down, "N", v, one, "") for v, one in zip((4.0, 8.0), moved, strict=True)]
    lines = list(winds.lines(winds.Table("x", 1, 0.0, 10e3, None, down, (), tuple(cells))))
    assert sum("Stage1 off" in line for line in lines) == sum("Stage2 off" in line for line in lines) == 1


def test_the_launcher_is_set_for_the_wind(rocket):
    """Aimed at where it lands in still air, what is aimed lands there again, by another setting."""
    calm, _ = winds.launch(rocket, (), 1, 300.0, None, None, 0.0, "N")
    stage = next(one for one in calm.landings if one.body == "Orion")
    place = stage.latitude, stage.longitude
    down, error = winds.launch(rocket, (), 1, 300.0, place, "Orion", 3.0, "W")
    assert not error
    found = winds._cell(ASKED._replace(place=place, body="Orion", within=1e3), calm, "W", 3.0, down, "")
    assert found.off["Orion"] < 500.0
    assert abs(down.azimuth - calm.azimuth) + abs(down.elevation - calm.elevation) > 1e-3


def test_the_table_names_the_reason():
    cells = [winds._cell(ASKED, CALM, whence, 4.0, landed(11.0), "") for whence in winds.DIRECTIONS]
    table = winds.Table("x", 1, 0.0, 10e3, None, CALM, ("Booster",), tuple(cells))
    lines = list(winds.lines(table))
    assert "NO: stage off: 11.0 km (4 m/s from N, and in 7 more winds)" in lines
    assert any(line.startswith("Booster is not followed") for line in lines)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--within", "20"], "--within: '20' has no unit"),
        (["--within", "20 km", "--speeds", "3 m"], "--speeds: '3 m' is a length"),
        (["--within", "20 km", "--speeds", "2,4"], "--speeds: '2' has no unit"),
        (["--within", "20 km", "--aim-body", "Orion"], "--aim-body: says what is aimed"),
    ],
)
def test_bad_input(rocket, capsys, monkeypatch, more, words):
    monkeypatch.setattr("sys.argv", ["shefex-nav", "winds", rocket, *more])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert words in capsys.readouterr().err
