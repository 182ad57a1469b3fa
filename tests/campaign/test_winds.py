"""In which winds a rocket may be launched: verdicts by hand, drift of a stage, and the command."""

import json
import math

import pytest

from shefex_nav.campaign.impact import landing, winds, winds_shown
from shefex_nav.commands.main import main
from shefex_nav.report import geodesic

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
        (landed(11.0), 4.0, ("stage 11.0 km off",)),
        (landed(1.0, exit_speed=15.9), 4.0, ("angle of attack 14 deg at the end of the rail",)),
        (landed(1.0, exit_speed=16.1), 4.0, ()),
        (None, 4.0, ("it breaks",)),
    ],
)
def test_what_is_go(down, speed, reasons):
    found = winds._cell(ASKED, CALM, "N", speed, down, "it breaks")
    assert found.reasons == pytest.approx(reasons)


def test_go_up_to_the_last_wind_before_the_first_that_is_not():
    cells = [winds.Cell(v, "N", None, {}, reasons) for v, reasons in ((2.0, ()), (4.0, ("far",)), (8.0, ()))]
    table = winds.Table("x", 1, 0.0, 10e3, None, CALM, (), tuple(cells))
    assert winds.most(table, "N") == 2.0 and winds.most(table, "S") is None


def test_a_stage_drifts_as_far_as_the_wind_is_strong(rocket):
    """Weathercocking and fall are nearly linear in a wind of a few m/s, and opposite in opposite winds."""

    def place(speed, whence):
        down, error = winds.launch(rocket, (), 1, 300.0, None, None, speed, whence)
        assert not error
        one = next(one for one in down.landings if one.body == "Orion")
        return one.latitude, one.longitude

    calm = place(0.0, "N")
    north, twice, south = (place(*wind) for wind in ((1.0, "N"), (2.0, "N"), (1.0, "S")))
    drift = geodesic.distance(*calm, *north)
    assert drift > 500.0
    assert geodesic.distance(*calm, *twice) == pytest.approx(2.0 * drift, rel=0.1)
    assert geodesic.distance(*north, *south) == pytest.approx(2.0 * drift, rel=0.1)


def test_the_command(rocket, tmp_path, capsys, monkeypatch):
    words = ["shefex-nav", "winds", rocket, "--within", "30 km", "--speeds", "3 m/s", "--workers", "1"]
    monkeypatch.setattr("sys.argv", [*words, "--json", "--figure", str(tmp_path / "winds.png")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["winds"]) == 8 and {one["speed_m_s"] for one in found["winds"]} == {3.0}
    for one in found["winds"]:
        far = max(one["off_m"].values())
        assert one["go"] == (far <= 30e3 and one["rail_exit_speed_m_s"] >= 12.0)
        assert math.isfinite(far)
    assert (tmp_path / "winds.png").stat().st_size > 20_000


def test_the_table_names_the_reason():
    cells = [winds._cell(ASKED, CALM, whence, 4.0, landed(11.0), "") for whence in winds.DIRECTIONS]
    table = winds.Table("x", 1, 0.0, 10e3, None, CALM, ("Booster",), tuple(cells))
    lines = list(winds_shown.lines(table))
    assert "NO: stage 11.0 km off (4 m/s from N, and 7 more)" in lines
    assert any(line.startswith("Booster is not followed") for line in lines)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--within", "20"], "--within: '20' has no unit"),
        (["--within", "20 km", "--speeds", "3 m"], "--speeds: '3 m' is a length"),
        (["--within", "20 km", "--aim-body", "Orion"], "--aim-body: says what is aimed"),
    ],
)
def test_bad_input(rocket, capsys, monkeypatch, more, words):
    monkeypatch.setattr("sys.argv", ["shefex-nav", "winds", rocket, *more])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert words in capsys.readouterr().err
