"""What `impact` refuses before it flies, and what it writes of few, failed and several winds' runs."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.campaign.impact import figures, landing, outputs, scatter, studying
from shefex_nav.commands.app import main

ROCKET = """
extends: rexus_like
mission: {name: rexus_impact, description: Where it lands}
dispersions:
  launch.elevation: {normal: 0.2 deg}
"""
WIND = "height_m,wind direction_degree,wind speed_m/s\n0,90,2\n30000,90,2\n"


@pytest.fixture(scope="module")
def rocket(tmp_path_factory):
    path = tmp_path_factory.mktemp("rocket") / "rocket.yaml"
    path.write_text(ROCKET)
    return str(path)


@pytest.fixture(scope="module")
def result(rocket):
    """Two runs."""
    return studying.study(studying.Asked(rocket, (), (), None, 2, 1, 1, None, None))


@pytest.fixture
def command(monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr("sys.argv", ["shefex-nav", "impact", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    return run


@pytest.fixture
def no_flight(monkeypatch):
    def land(*args, **options):
        raise AssertionError("flown before it was refused")

    for module in (landing, scatter, studying.aim):
        monkeypatch.setattr(module, "land", land)


def with_runs(result, flown, failed=(), winds=("calm",)):
    """The result of such runs, far apart from each other."""
    places = {"payload": np.radians([[68.0 + 0.01 * run, 21.0 + 0.02 * (run % 3)] for run in flown])}
    return result._replace(
        cases=tuple(result.cases[0]._replace(wind=wind) for wind in winds),
        landed=result.landed * len(winds),
        scattered=scatter.Scattered(places, tuple(flown), tuple(failed)),
        ellipses=studying.ellipses.of_bodies(places),
        runs=len(flown) + len(failed),
    )


# ---- refused ---------------------------------------------------------------------------------------------


def test_a_wind_beside_dispersions_of_wind_is_refused(command, no_flight, tmp_path):
    """The shipped campaign draws the wind; the message was 'must be at most 360 deg, got 440'."""
    (tmp_path / "day.csv").write_text(WIND)
    code, said = command("shefex2_dispersed", "--runs", 2, "--wind", tmp_path / "day.csv")
    told = " ".join(said.err.split())
    assert code == 2 and "dispersions.wind.speed, dispersions.wind.from" in told and "--wind" in told


def test_runs_without_dispersions_are_refused_before_a_flight(command, no_flight):
    code, said = command("rexus_like", "--runs", 2)
    assert code == 2 and "no section dispersions" in " ".join(said.err.split())


def test_an_unknown_body_is_refused_before_a_flight(command, no_flight, rocket):
    code, said = command(rocket, "--aim", "68.1,20.6", "--aim-body", "S44")
    assert code == 2 and "S44 is not followed to the ground; there is payload" in " ".join(said.err.split())


def test_every_wind_is_read_before_a_flight(command, no_flight, rocket, tmp_path):
    (tmp_path / "day.csv").write_text(WIND)
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    winds = "--wind", tmp_path / "day.csv", "--wind", tmp_path / "bad.csv"
    code, said = command(rocket, "--aim", "68.1,20.6", *winds)
    assert code == 2 and "no column for" in " ".join(said.err.split())


@pytest.mark.parametrize(("name", "words"), [("", "is a folder"), ("none.csv", "there is no file")])
def test_a_wind_that_is_no_file_is_told_with_its_option(command, no_flight, rocket, tmp_path, name, words):
    code, said = command(rocket, "--wind", tmp_path / name)
    told = " ".join(said.err.split())
    assert code == 2 and "--wind" in told and words in told


# ---- written ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("runs", "count"), [(1, "1 landing"), (2, "2 landings")])
def test_too_few_runs_for_an_ellipse_are_told(result, runs, count):
    found = outputs.summary(with_runs(result, range(runs)))
    assert found["without_ellipse"] == [{"body": "payload", "landings": runs, "reason": "an ellipse needs 3"}]
    assert ("dispersion", "payload", f"{count}; an ellipse needs 3") in list(outputs.rows(found))


def test_enough_runs_have_an_ellipse_and_no_excuse(result):
    found = outputs.summary(with_runs(result, range(5)))
    assert found["without_ellipse"] == [] and len(found["ellipses"]) == 1


def test_two_flights_are_kept_with_their_runs(result):
    assert result.scattered.flown == (0, 1) and result.scattered.failed == ()
    kept = json.loads(outputs.samples(result))["landings"]["payload"]
    for run, one in enumerate(kept):
        place = np.radians([one["latitude_deg"], one["longitude_deg"]])
        np.testing.assert_allclose(place, result.scattered.landings["payload"][run], atol=1e-12)


def test_landings_are_kept_with_their_run_and_wind(result):
    """Run 1 failed; in two winds the even runs fly in the first."""
    kept = json.loads(outputs.samples(with_runs(result, (0, 2, 3), ((1, "it tumbles"),), ("calm", "gale"))))
    assert [(one["run"], one["wind"]) for one in kept["landings"]["payload"]] == [
        (0, "calm"), (2, "calm"), (3, "gale"),
    ]  # fmt: skip
    assert kept["landings"]["payload"][1]["latitude_deg"] == pytest.approx(68.02)
    assert kept["landings"]["payload"][1]["longitude_deg"] == pytest.approx(21.04)
    assert kept["failed"] == [{"run": 1, "wind": "gale", "reason": "it tumbles"}]


@pytest.mark.parametrize(("failed", "code"), [((), 0), (((1, "it tumbles"),), 1)])
def test_the_exit_code_tells_of_failed_runs(command, monkeypatch, rocket, result, tmp_path, failed, code):
    monkeypatch.setattr(studying, "study", lambda asked, tell: with_runs(result, (0, 2, 3, 4), failed))
    assert command(rocket, "--runs", 5, "--json")[0] == code
    ended, said = command(rocket, "--runs", 5, "--output", tmp_path / "out")
    assert ended == code and (tmp_path / "out" / "landings.json").exists()
    assert ("it tumbles" in said.out) == bool(failed)


def test_the_map_shows_every_landing_and_its_legend_covers_nothing(result):
    """Each run is a dot where it landed, the flight without dispersions has the same mark in both figures."""
    made = with_runs(result, range(12))
    drawn = figures.draw(made)
    (axes,) = drawn["map"].axes
    lines = {line.get_label(): line for line in axes.lines}
    dots = np.column_stack(lines["payload, 12 runs"].get_data())
    apart = np.linalg.norm(np.diff(dots[:2], axis=0))
    north, east = 0.01 * 111.56, 0.02 * 111.41 * np.cos(np.radians(68.005))  # km, of a degree there
    assert apart == pytest.approx(np.hypot(north, east), rel=0.01)
    mark = lines["payload, without dispersions"]
    (other,) = [line for line in drawn["landings"].axes[0].lines if line.get_label() == "without dispersions"]
    assert mark.get_marker() == other.get_marker() != lines["launcher"].get_marker()
    drawn["map"].draw_without_rendering()
    assert axes.get_legend().get_window_extent().y1 < axes.get_window_extent().y0
    assert axes.get_legend().get_window_extent().y0 >= 0.0


def test_a_single_flight_has_a_mark_and_no_runs(result):
    (axes,) = figures.draw(result._replace(scattered=None, ellipses=(), runs=0))["map"].axes
    labels = axes.get_legend_handles_labels()[1]
    assert "payload, nominal" in labels and not any("run" in label for label in labels)


def test_files_of_another_study_are_taken_away(command, monkeypatch, rocket, result, tmp_path):
    monkeypatch.setattr(studying, "study", lambda asked, tell: with_runs(result, range(5)))
    assert command(rocket, "--runs", 5, "--output", tmp_path)[0] == 0
    (tmp_path / "notes.txt").write_text("mine")
    assert {one.name for one in tmp_path.iterdir()} == {*studying.FILES, "notes.txt"}
    once = result._replace(scattered=None, ellipses=(), runs=0)
    monkeypatch.setattr(studying, "study", lambda asked, tell: once)
    assert command(rocket, "--output", tmp_path, "--force")[0] == 0
    left = {one.name for one in tmp_path.iterdir()}
    assert left == {"impact.json", "impact.kml", "impact.geojson", "map.png", "notes.txt"}


def test_a_motor_that_burns_to_the_ground_has_impact_points_until_then():
    """No event of burn-out: a point every second from the rail to the ground."""
    events = [SimpleNamespace(name=name, t_s=t_s) for name, t_s in (("rail_exit", 0.5), ("impact", 4.2))]
    trajectory = SimpleNamespace(t_s=np.arange(0.0, 4.3, 0.1))
    flight = SimpleNamespace(events=events, dropped=(), trajectory=trajectory)
    assert landing._times(flight) == pytest.approx([0.5, 1.5, 2.5, 3.5])


def test_the_legend_of_the_map_says_what_its_coast_lacks(result):
    """Inland too, where no coast is in the map: a launcher in the open sea looked as one there."""
    for place, said in (([69.29, 16.02], "coast: Natural Earth"), ([23.0, 8.0], "no coast here, by Natural")):
        there = np.radians([place])
        points = landing.Points(np.zeros(1), there, there)
        spot = result.landed[0].landings[0]._replace(latitude=there[0, 0], longitude=there[0, 1])
        landed = [one._replace(landings=(spot,), paths=()) for one in result.landed]
        drawn = figures.chart(
            result._replace(site=tuple(there[0]), points=points, landed=landed, scattered=None, ellipses=())
        )
        words = [text.get_text() for text in drawn.axes[0].get_legend().get_texts()]
        assert sum(one.startswith(said) and "smaller islands" in one for one in words) == 1
