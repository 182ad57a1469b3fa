"""Plug-ins: the same file inside and outside the package, consent, refusals, logs and campaigns with one."""

import json
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from shefex_nav import instruments, plugins, prepare
from shefex_nav.log import reader
from shefex_nav.onboard.startracker.detect import CENTROIDS
from shefex_nav.onboard.startracker.identify import IDENTIFIERS
from shefex_nav.scenario.load import ScenarioError, load, load_text
from shefex_nav.scenario.schema import Scenario

OWN = "sun_sensor: {rate: 10 Hz, boresight: [0, 1, 0], field_of_view: 90 deg, noise: 0.2 deg}"
ALTIMETER = "radar_altimeter: {rate: 5 Hz, bias: 1 m, noise: 2 m}"
METHODS = """
from shefex_nav.onboard.startracker import centroid
from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.plugins import Method


def identify(params, pairs, u_c, flux, P_px=None):
    return bayes.identify(params._replace(min_stars=5), pairs, u_c, flux, P_px)


def centres(params, image_dn, table):
    return centroid.weighted(table, 1.0 / params.electrons_per_dn)


PROVIDES = [Method("identification", "five_stars", identify), Method("centroid", "as_scanned", centres)]
"""


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Nothing that a test loads, or consents to, is there in the next one."""
    tables = instruments.TABLE, IDENTIFIERS, CENTROIDS, plugins._LOADED, plugins._OWNERS
    kept = [dict(one) for one in tables]
    (tmp_path / "config").mkdir()  # astropy warns of one that is not there
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    yield
    for one, before in zip(tables, kept, strict=True):
        one.clear()
        one.update(before)


def altimeter(folder):
    """The example of the pages, as its readers copy it."""
    page = (ROOT / "docs" / "how-to" / "sensor.md").read_text()
    path = folder / "radar_altimeter.py"
    path.write_text(re.search(r"```python\n# radar_altimeter.py\n(.*?)```", page, re.DOTALL)[1])
    return path


def scenario(
    folder, plugin="radar_altimeter.py", more="radar_altimeter: {rate: 5 Hz, bias: 1 m, noise: 2 m}"
):
    path = folder / "mine.yaml"
    name = "mission: {name: mine}\nnavigation: {states: automatic}"
    path.write_text(f"# Mine.\nextends: rexus_like.yaml\nplugins: [{plugin}]\n{name}\n{more}\n")
    return path


def message(path, **how):
    with pytest.raises(ScenarioError) as caught:
        load(str(path), **how)
    return str(caught.value)


def test_the_same_file_outside_the_package_gives_the_same_records(tmp_path):
    """Under another name, for that of the program is taken; with the same stream of random numbers."""
    source = (Path(instruments.__file__).parent / "sun_sensor.py").read_text()
    source = source.replace('name="sun_sensor",', 'name="sun_sensor_too",\n    stream=2013464567,')
    (tmp_path / "too.py").write_text(source + "\n\nPROVIDES = [SUN_SENSOR]\n")
    assert instruments.TABLE["sun_sensor"].stream is None
    both = f"{OWN}\n{OWN.replace('sun_sensor', 'sun_sensor_too')}"
    loaded = load(str(scenario(tmp_path, "too.py", both)), trust=True)
    from shefex_nav.world import noise

    outside = instruments.TABLE["sun_sensor_too"]
    instruments.TABLE["sun_sensor_too"] = outside._replace(stream=noise.key_of("sun_sensor"))
    world = prepare.build_world(loaded, 1)
    inside, out = (world.measured[name].readings for name in ("sun_sensor", "sun_sensor_too"))
    assert len(inside) > 1000 and any(one.seen for one in inside)
    assert type(inside[0]) is not type(out[0])
    for one, other in zip(inside, out, strict=True):
        np.testing.assert_array_equal(np.hstack(one), np.hstack(other))


def test_a_file_is_not_run_without_consent_which_is_kept_for_its_content(tmp_path):
    path, code = scenario(tmp_path), altimeter(tmp_path)
    said = message(path)
    assert "mine.yaml:3:11: plugins.0: " in said and "read it, then give --trust" in said
    assert "radar_altimeter" not in instruments.TABLE
    assert load(str(path), trust=True).radar_altimeter.noise == 2.0
    plugins._LOADED.clear()
    assert load(str(path)).radar_altimeter.noise == 2.0
    code.write_text(code.read_text() + "\n# edited\n")
    assert "read it, then give --trust" in message(path)


def test_a_key_of_a_plugin_is_known_only_to_the_scenarios_that_name_it(tmp_path):
    altimeter(tmp_path)
    load(str(scenario(tmp_path)), trust=True)
    other = tmp_path / "other.yaml"
    other.write_text(scenario(tmp_path).read_text().replace("plugins: [radar_altimeter.py]\n", ""))
    assert "radar_altimeter" in message(other)
    assert "radar_altimeter" not in Scenario.keys()


WRONG = (  # text of the file, what stands in its place, what is said
    ("PROVIDES", "OTHERS", "provides nothing; end it with PROVIDES"),
    ('name="radar_altimeter",', 'name="barometer",', "an instrument 'barometer' already, of the program"),
    ('"""Radar altimeter: height', '1 / 0\n"""', "radar_altimeter.py:1: ZeroDivisionError: division by zero"),
    ('"""Radar altimeter: height', 'def f(:\n"""', "radar_altimeter.py:1: SyntaxError"),
    ("    latency: float", "    late: float", "its settings need latency"),
    ("        use=Use,\n", "", "one with an aid needs a class of settings in `use`"),
    ("    t_available_s: float\n", "", "begins with t_valid_s and t_available_s"),
    ("PROVIDES = [", "PROVIDES = [7, ", "7 in PROVIDES is neither an Instrument"),
)


@pytest.mark.parametrize(("old", "new", "words"), WRONG)
def test_what_is_wrong_with_a_plugin_is_one_line(tmp_path, old, new, words):
    code = altimeter(tmp_path)
    assert old in code.read_text()
    code.write_text(code.read_text().replace(old, new, 1))
    said = message(scenario(tmp_path), trust=True)
    assert words in said and "plugins.0: " in said
    assert len(said.splitlines()) == 1


def test_plugins_that_are_not_there(tmp_path):
    assert "cannot be read: No such file" in message(scenario(tmp_path, "nowhere.py"), trust=True)
    assert "there is no plug-in 'nobody'; none is installed" in message(scenario(tmp_path, "nobody"))
    path = scenario(tmp_path, "radar_altimeter.py")
    path.write_text(path.read_text().replace("[radar_altimeter.py]", "7"))
    assert "plugins: " in message(path)


def test_a_scenario_with_a_plugin_goes_to_another_process_and_into_text(tmp_path):
    altimeter(tmp_path)
    loaded = load(str(scenario(tmp_path)), trust=True)
    assert pickle.loads(pickle.dumps(loaded)).radar_altimeter.rate == 5.0
    assert load_text(loaded.source, "log").plugins[0].sha256 == loaded.plugins[0].sha256
    (tmp_path / "radar_altimeter.py").write_text("PROVIDES = []\n")
    plugins._LOADED.clear()
    with pytest.raises(ScenarioError, match="is another file than the one that was flown"):
        load_text(loaded.source, "log")


def test_a_log_says_which_plugin_and_is_run_again_with_it(tmp_path, command, monkeypatch):
    altimeter(tmp_path)
    path, log = scenario(tmp_path), tmp_path / "a.mcap"
    flown = command("run", path, "--trust", "--until", "3s", "--seed", 1, "--out", log)
    assert flown.code == 0, flown.err
    data = reader.read(log)
    assert len(data.readings["radar_altimeter"].t_valid_s) == 65
    assert [name for name, _ in data.mission.plugins] == [str(tmp_path / "radar_altimeter.py")]
    used = [gate for gate in data.gates if gate.sensor == "radar_altimeter"]
    assert len(used) > 60 and all(gate.accepted for gate in used)
    states = data.covariance.states[-1].split()
    assert states[-1] == "altimeter_bias" and data.covariance.sigmas[-1][-1] < 1.0
    again = command("replay", log, "--log", tmp_path / "b.mcap")
    assert again.code == 0, again.err
    np.testing.assert_array_equal(reader.read(tmp_path / "b.mcap").nav.r_i, data.nav.r_i)
    shutil.rmtree(tmp_path / "config")  # somebody who has not given consent may look at it
    monkeypatch.setenv(plugins.CONSENT, "")
    plugins._LOADED.clear()
    instruments.TABLE.pop("radar_altimeter")
    assert "radar_altimeter" not in reader.read(log).readings


def test_methods_of_a_file_in_a_campaign_with_two_workers(tmp_path, command):
    (tmp_path / "methods.py").write_text(METHODS)
    path = tmp_path / "sky.yaml"
    path.write_text(
        "# Sky.\nextends: night_sky.yaml\nplugins: [methods.py]\n"
        "mission: {name: sky, time_limit: 3 s}\n"
        "star_tracker:\n  off: 3 s\n  detection: {centroid: as_scanned}\n"
        "  identification: {method: five_stars, tracking: false}\n"
    )
    done = command(
        "campaign", path, "--trust", "--runs", 2, "--workers", 2, "--out", tmp_path / "c", "--json"
    )
    assert done.code == 0, done.err
    assert json.loads(done.out)["runs"]
    assert load(str(path)).star_tracker.identification.method == "five_stars"
    path.write_text(path.read_text().replace("five_stars", "four_stars"))
    assert "'four_stars' is not known; choose from: bayes, " in message(path)
