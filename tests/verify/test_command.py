"""`shefex-nav verify nesc`, with trajectories written for these tests and the small models."""

import json

import pytest
import small_models
from typer.testing import CliRunner

from shefex_nav.commands.verify import app
from shefex_nav.verify import data, daveml

TITLES = "time,altitudeMsl_ft,longitude_deg,localGravity_ft_s2"
START = "0.0,30000.0,0.0,32.1065359519"
END = "30.0,15598.9043522,5.74552213287E-5,32.15078136923117"


@pytest.fixture
def folder(tmp_path):
    """Folder with the models and case 01 of two simulators, a case of the F-16 and one in orbit."""
    small_models.write(tmp_path / "All_models")
    for simulator in ("04", "06"):
        put(tmp_path / "Atmos_01_DroppedSphere" / f"Atmos_01_sim_{simulator}.csv", START, END)
    put(tmp_path / "Atmos_11_TrimCheckSubsonicF16" / "Atmos_11_sim_02.csv", START, END)
    put(tmp_path / "Orbit_02" / "Orbit_02_sim_A.csv", START, END)
    return tmp_path


def put(path, *rows):
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join((TITLES, *rows)) + "\n", encoding="utf-8")


def verify(*arguments):
    return CliRunner().invoke(app, ["nesc", *map(str, arguments)])


def test_json_says_how_far_each_simulator_is(folder):
    done = verify("--data", folder, "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["ok"] is True
    assert set(result["cases"]) == {"01"}
    altitude = result["cases"]["01"]["altitude"]
    assert altitude["unit"] == "ft"
    assert set(altitude["against"]) == {"04", "06"}
    assert altitude["max_difference"] == max(altitude["against"].values()) < 1e-5
    assert altitude["spread"] == 0.0
    assert altitude["ok"] is True
    assert result["not_flown"] == ["11", "Orbit 02"]
    assert "not flown: 11 (F-16)" in done.stderr
    again = verify("--data", folder)  # with all that is compiled
    assert "compil" not in again.stderr and again.stderr.startswith("case 01: dragless sphere")


def test_the_table_shows_every_case(folder):
    done = verify("--data", folder)
    assert done.exit_code == 0, done.output
    for text in ("01 dragless sphere", "altitude", "latitude, longitude", "gravity", "good"):
        assert text in done.stdout


def test_a_difference_beyond_the_tolerance_is_exit_code_1(folder):
    for simulator in ("04", "06"):
        put(
            folder / "Atmos_01_DroppedSphere" / f"Atmos_01_sim_{simulator}.csv",
            START,
            END.replace("9043", "9044"),
        )
    done = verify("--data", folder, "--json")
    assert done.exit_code == 1
    assert "case 01: altitude" in done.stderr
    assert json.loads(done.stdout)["ok"] is False


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_the_picture_is_drawn(folder, ending):
    picture = folder / f"picture.{ending}"
    done = verify("--data", folder, "--out", picture)
    assert done.exit_code == 0, done.output
    assert picture.stat().st_size > 10_000
    again = verify("--data", folder, "--out", picture)
    assert again.exit_code == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--case", "04"), "no trajectory of case 04"),
        (("--case", "11"), "case 11 is not flown"),
        (("--case", "1,99"), "case 99 is not flown"),
    ],
)
def test_a_case_that_cannot_be_flown_is_an_error(folder, arguments, message):
    done = verify("--data", folder, *arguments)
    assert isinstance(done.exception, data.NescDataError)
    assert message in str(done.exception)


def test_missing_data_and_models_are_errors(folder, tmp_path_factory):
    with pytest.raises(data.NescDataError, match="no trajectory"):
        data.search(tmp_path_factory.mktemp("empty"))
    (folder / "All_models" / "cannonball_aero.dml").unlink()
    done = verify("--data", folder)
    assert isinstance(done.exception, data.NescDataError)
    assert "cannonball_aero.dml" in str(done.exception)
    (folder / "All_models" / "cannonball_aero.dml").write_text("<DAVEfunc>", encoding="utf-8")
    assert isinstance(verify("--data", folder).exception, daveml.DaveMlError)


def test_an_ending_that_cannot_be_drawn_is_refused_before_the_flight(folder):
    assert verify("--data", folder, "--out", folder / "picture.jpg").exit_code == 2
    assert verify("--data", folder, "--out", folder / "nowhere" / "picture.png").exit_code == 2


def test_the_command_ends_with_code_2_and_one_message(command, tmp_path):
    done = command("verify", "nesc", "--data", tmp_path)
    assert done.code == 2
    assert done.out == ""
    assert "no trajectory" in done.err
    assert "Traceback" not in done.err
