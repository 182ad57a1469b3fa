"""Gravity, air and wind of a plug-in: the page's example in flight, what is refused, logs and campaigns."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import plugin_tables
import pytest

from shefex_nav import plugins, prepare
from shefex_nav.environment import gravity
from shefex_nav.environment.models import Gravity
from shefex_nav.log import reader
from shefex_nav.scenario import load as loading
from shefex_nav.scenario import params, surroundings
from shefex_nav.scenario.load import ScenarioError, load

ROOT = Path(__file__).parent.parent
MODELS = """earth: {gravity: my_field}
atmosphere: {model: my_air, my_air: {pressure: 1009 hPa}}
wind: {file: null, model: my_jet, speed: 35 m/s}
"""
SAME = '''"""The standard atmosphere, EGM96 to degree 2 and a wind, as somebody's own."""
import numpy as np
from shefex_nav.environment import gravity
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.models import Air, Atmosphere, Gravity, Wind


def air(heights, site):
    density, pressure, _, sound = np.array([us76(height) for height in heights]).T
    return Air(density, pressure, sound)


def wind(heights, t_s, site):
    return np.full_like(heights, 3.0), np.interp(heights, [0.0, 10e3], [5.0, 25.0])


PROVIDES = [Gravity("same", gravity.egm96), Atmosphere("same", air), Wind("same", wind)]
'''


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Nothing that a test loads, or consents to, is there in the next one."""
    (tmp_path / "config").mkdir()  # astropy warns of one that is not there
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    with plugin_tables.restored():
        yield


@pytest.fixture
def code(tmp_path):
    """The example of the page, as its readers copy it."""
    page = (ROOT / "docs" / "how-to" / "environment.md").read_text()
    for name in ("my_day.py", "my_field.gfc"):
        text = re.search(rf"```\w+\n# {name}\n(.*?)```", page, re.DOTALL)[1]
        (tmp_path / name).write_text(text)
    return tmp_path / "my_day.py"


def scenario(folder, more=MODELS, plugin="my_day.py", base="rexus_like.yaml"):
    path = folder / "mine.yaml"
    path.write_text(f"# Mine.\nextends: {base}\nplugins: [{plugin}]\nmission: {{name: mine}}\n{more}")
    return path


def message(path):
    with pytest.raises(ScenarioError) as caught:
        load(str(path), trust=True)
    return str(caught.value)


def test_the_flight_is_given_the_models(tmp_path, code):
    flown = params.flight_params(load(str(scenario(tmp_path)), trust=True))
    r_e = np.array([6.5e6, 1e5, 2e6])
    expected = gravity.gravity_e(gravity.load("egm96", 3), r_e)
    np.testing.assert_allclose(gravity.gravity_e(flown.gravity, r_e), expected, rtol=1e-12)
    sea = np.exp([np.interp(0.0, flown.air.table[:, 0], flown.air.table[:, k]) for k in (1, 2)])
    assert sea[1] == pytest.approx(100900.0, rel=1e-4)
    assert sea[0] == pytest.approx(100900.0 / (287.05 * 282.0), rel=1e-4)
    assert flown.air.table[-1, 0] == 119.5e3
    speed = [np.interp(11e3, flown.wind[:, 0], column) for column in flown.wind[:, 2::2].T]
    np.testing.assert_allclose(speed, 35.0 * (1.0 + 1e-3 * np.array(flown.wind_times)), atol=0.1)
    assert not flown.wind[:, 1::2].any() and len(flown.wind_times) > 1


@pytest.mark.slow
def test_models_that_are_those_of_the_program_fly_as_they_do(tmp_path):
    """Their tables are off by 1e-4: less than a density that is off by 1e-3, and than another wind."""
    (tmp_path / "same.py").write_text(SAME)
    own = "earth: {gravity: same, gravity_degree: 2}\natmosphere: {model: same}\nwind: same\n"
    winds = np.array([[3.0, 5.0], [3.0, 25.0]])
    speed, whence = np.hypot(*winds.T), np.arctan2(-winds[:, 1], -winds[:, 0])
    table = (
        f"{{height: [0 km, 10 km], speed: [{', '.join(f'{one!r} m/s' for one in speed.tolist())}], "
        f"from: [{', '.join(f'{one!r} rad' for one in whence.tolist())}]}}"
    )
    ours = ["earth.gravity=egm96", "atmosphere.model=us76", f"wind={table}"]
    path = scenario(tmp_path, own, "same.py")

    def flown(overrides=()):
        return prepare.fly_vehicle(load(str(path), overrides, trust=True), 1).trajectory.r_i

    def apart(one, other):
        return np.linalg.norm(one[-1] - other[-1])

    theirs = flown(ours)
    assert apart(flown(), theirs) < 0.25 * apart(flown([*ours, "atmosphere.density=100.1 %"]), theirs)
    assert apart(flown(ours[:1]), flown(["atmosphere.model=same"])) == 0.0
    assert apart(flown(ours[2:]), flown()) < 0.1
    assert apart(flown(["wind=none"]), flown()) > 1000.0


def test_a_name_that_is_not_known_is_refused_with_those_that_are(tmp_path, code):
    wind = "{file: null, model: my_jet, speed: 35 m/s}"
    for old, new, words in (
        ("my_field", "mine", "earth.gravity: 'mine' is not known; choose from: egm96, j2, point, my_field"),
        (
            "model: my_air",
            "model: mine",
            "atmosphere.model: 'mine' is not known; choose from: us76, msis, my",
        ),
        (
            wind,
            "mine",
            "wind: 'mine' is not known; choose from: none, my_jet",
        ),
        ("model: my_jet", "model: mine", "wind.model: 'mine' is not known; choose from: my_jet"),
        (wind, "my_jet", "write {model: my_jet, speed: 40 m/s}"),
        ("speed: 35 m/s", "sped: 35 m/s", "wind.sped: unknown key; did you mean 'speed'?"),
        (", my_air: {pressure: 1009 hPa}", "", "my_air needs it, for example 'my_air: {pressure: 1009 hPa}'"),
        ("1009 hPa", "-1 hPa", "atmosphere.my_air.pressure: must be greater than zero, got"),
    ):
        said = message(scenario(tmp_path, MODELS.replace(old, new)))
        assert words in said and len(said.splitlines()) == 1, said
    assert "wind.model: does not go with file; take one of the two away (null does" in message(
        scenario(tmp_path, MODELS.replace("file: null, ", ""))
    )
    other = scenario(tmp_path, MODELS).read_text().replace("plugins: [my_day.py]\n", "")
    (tmp_path / "other.yaml").write_text(other)
    assert "'my_field' is not known; choose from: egm96, j2, point" in message(tmp_path / "other.yaml")


WRONG = (  # text of the file, what stands in its place, what is said when it is read
    ('Gravity("my_field"', 'Gravity("egm96"', "'egm96': the program has that name already"),
    ('Atmosphere("my_air"', 'Atmosphere("density"', "'density': the program has that name already"),
    ('Wind("my_jet"', 'Wind("My jet"', "its name must be lower case"),
    ('"my_field", coefficients', '"my_field", 7', "its coefficients must be a function, got 7"),
    ('"my_jet", jet, Jet', '"my_jet", jet, 7', "settings must be a class of Settings, got 7"),
    ("np.arange(-500.0, 120e3, 500.0)", "(5.0, 1.0)", "its heights must be two numbers or more, increasing"),
    ("PROVIDES = [", 'PROVIDES = [Wind("my_jet", jet), ', "there is a 'my_jet' already, of a plug-in"),
    ('"1009 hPa"', '"1009 m"', "setting pressure of Day: its example or default"),
)
FAULTS = (  # likewise, what `check` says of the numbers
    ("cosine[n, m], sine[n, m] = c, s", "cosine[n, m] = np.nan", "gravity 'my_field' of my_day.py: cosine"),
    ("(size, size)), np", "(size, size + 1)), np", "must be numbers, shape (4, 4), got shape (4, 5)"),
    ("gfc 0 0", "", "cosine[0, 0] must be 1, got 0"),
    ('float(head["radius"])', "-1.0", "gm and radius must be greater than zero"),
    ("size = 1 +", "size = 90 +", "degree and order are at most 80, got 92"),
    ("return Coefficients(", "return (", "expected Coefficients(gm, radius, cosine, sine), got"),
    ("np.exp(-fallen)", "(1.0 - fallen)", "atmosphere 'my_air' of my_day.py: density must be greater than"),
    ("np.exp(-fallen)", "np.exp(-fallen[1:])", "shape"),
    ("return Air(", "return (", "expected Air(density, pressure, sound), got"),
    (
        "np.interp(heights, grid, kelvin)), pressure)",
        "kelvin[0]),)",
        "missing 1 required positional argument",
    ),
    ("Air, Atmosphere,", "Atmosphere,", "name 'Air' is not defined"),
    ("* np.exp(-(((heights", "* np.nan * np.exp(-(((heights", "wind 'my_jet' of my_day.py: north and east"),
    ("np.zeros_like(heights), speed", "speed", "must be numbers, shape (2, 243), got shape (243,)"),
    ("1e-3 * t_s", "np.sin(50.0 * t_s)", "wind 'my_jet' of my_day.py has too much detail for a"),
    ("speed = site.settings.speed", "speed = site.settings.sped", "has no attribute 'sped'"),
)


@pytest.mark.parametrize(("old", "new", "words"), WRONG)
def test_what_is_wrong_with_a_model_is_one_line(tmp_path, code, old, new, words):
    assert old in code.read_text()
    code.write_text(code.read_text().replace(old, new, 1))
    said = message(scenario(tmp_path))
    assert words in said and "plugins.0: " in said and len(said.splitlines()) == 1, said


def test_what_is_wrong_with_its_numbers_is_told_with_its_name(tmp_path, code, command):
    texts = {path: path.read_text() for path in (code, tmp_path / "my_field.gfc")}
    for old, new, words in FAULTS:
        assert any(old in text for text in texts.values()), old
        for path, text in texts.items():
            path.write_text(text.replace(old, new, 1))
        checked = command("check", scenario(tmp_path), "--trust")
        assert checked.code == 2 and words in checked.err and "my_day" in checked.err, checked.err
        assert "site-packages" not in checked.err


def test_models_of_one_name_and_the_models_of_another_scenario(tmp_path, code):
    """Names are those of their kind; a scenario keeps its models when the file is edited and loaded again."""
    (tmp_path / "same.py").write_text(SAME)
    first = load(str(scenario(tmp_path)), trust=True)
    assert load(str(scenario(tmp_path, "wind: same\n", "same.py")), trust=True).wind == "same"
    code.write_text(
        code.read_text().replace("287.0, 282.0", "287.0, 283.0").replace("(degree)", "(degree=2)")
    )
    second = load(str(scenario(tmp_path)), trust=True)
    assert surroundings.air(first)[0, 1] > surroundings.air(second)[0, 1]
    assert first.MODELS[Gravity]["my_field"] is not second.MODELS[Gravity]["my_field"]
    assert loading.load_text(second.source, "log").model_dump() == second.model_dump()


def test_a_log_says_which_file_and_is_smoothed_with_its_field(tmp_path, code, command):
    log = tmp_path / "a.mcap"
    flown = command("run", scenario(tmp_path), "--trust", "--until", "20s", "--seed", 1, "--out", log)
    assert flown.code == 0, flown.err
    assert [name for name, _ in reader.read(log).mission.plugins] == [str(code)]
    done = command("smooth", log, "--out", tmp_path / "s.mcap")
    assert done.code == 0, done.err
    shutil.rmtree(tmp_path / "config")
    plugins._LOADED.clear()
    code.write_text(code.read_text() + "\n# edited\n")
    again = command("smooth", log, "--out", tmp_path / "t.mcap", "--trust")
    assert again.code == 2 and "is another file than the one that was flown" in again.err


def test_workers_of_a_campaign_have_the_models_and_draw_their_settings(tmp_path, code, command):
    more = MODELS.replace("file: null, ", "") + "dispersions: {wind.speed: {normal: 8 m/s}}\n"
    path = scenario(tmp_path, f"{more}star_tracker: {{enabled: false, off: 3 s}}\n", base="night_sky.yaml")
    path.write_text(path.read_text().replace("{name: mine}", "{name: mine, time_limit: 3 s}"))
    done = command(
        "campaign", path, "--trust", "--runs", 2, "--workers", 2, "--out", tmp_path / "c", "--json"
    )
    assert done.code == 0, done.err
    assert json.loads(done.out)["runs"]
