"""Plug-ins: the same file inside and outside the package, consent, refusals, logs and campaigns with one."""

import json
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import plugin_tables
import pytest

from shefex_nav import instruments, plugin_checks, plugins, prepare
from shefex_nav.errors import CodeError
from shefex_nav.log import reader, topics
from shefex_nav.onboard.startracker import tracker
from shefex_nav.records import Frame, Reason, Scan
from shefex_nav.report import figures
from shefex_nav.scenario.load import Pattern, Scenario, ScenarioError, load, load_text
from shefex_nav.world import noise

ROOT = Path(__file__).parent.parent
OWN = (
    "sun_sensor: {rate: 10 Hz, boresight: [0, 1, 0], field_of_view: 90 deg, "
    "noise: 0.2 deg, alignment: 0.1 deg}"
)
ALTIMETER = "radar_altimeter: {rate: 5 Hz, bias: 1 m, noise: 2 m}"
METHODS = """
from dataclasses import replace

from shefex_nav.onboard.startracker import (scan)
from shefex_nav.onboard.startracker import scan
from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.plugins import Method


def identify(settings, camera, pairs, u_c, flux, P_px=None):
    return bayes.identify(replace(settings, fewest_stars=5), camera, pairs, u_c, flux, P_px)


def centres(settings, camera, image_dn, table):
    return scan.weighted(table, 1.0 / camera.electrons_per_dn)


def search(image_dn, blocks, background, sigma, rules):
    return scan.maximum_search(image_dn, blocks, background, sigma, rules)


PROVIDES = [
    Method("identification", "five_stars", identify),
    Method("centroid", "as_scanned", centres),
    Method("scan", "brightest_first", search),
]
"""


@pytest.fixture(autouse=True)
def forgotten(monkeypatch, tmp_path):
    """Nothing that a test loads, or consents to, is there in the next one."""
    (tmp_path / "config").mkdir()  # astropy warns of one that is not there
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv(plugins.CONSENT, "")
    with plugin_tables.restored():
        yield


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
    source = source.replace("sun_alignment", "sun_alignment_too")
    stream = noise.key_of("sun_sensor")
    source = source.replace('name="sun_sensor",', f'name="sun_sensor_too",\n    stream={stream},')
    (tmp_path / "too.py").write_text(source + "\n\nPROVIDES = [SUN_SENSOR]\n")
    assert instruments.TABLE["sun_sensor"].stream is None
    both = f"{OWN}\n{OWN.replace('sun_sensor', 'sun_sensor_too')}"
    loaded = load(str(scenario(tmp_path, "too.py", both)), trust=True)
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


def test_settings_may_be_called_like_keys_of_dispersions(tmp_path):
    """An altimeter whose noise is called sigma."""
    code = altimeter(tmp_path)
    code.write_text(code.read_text().replace("noise", "sigma"))
    path = scenario(tmp_path, more=ALTIMETER.replace("noise", "sigma"))
    setting = "radar_altimeter.sigma"
    loaded = load(str(path), [f"dispersions.{setting}={{uniform: [0.1 m, 0.2 m]}}"], trust=True)
    assert list(loaded.dispersions) == [setting]
    drawn = Pattern(loaded.source, "text").with_draws({setting: 0.15})
    assert drawn.radar_altimeter.sigma == 2.15


WRONG = (  # text of the file, what stands in its place, what is said
    ("PROVIDES", "OTHERS", "provides nothing; end it with PROVIDES"),
    (
        'name="radar_altimeter",',
        'name="barometer",',
        "'barometer': there is an instrument of that name already, of the program",
    ),
    ('"""Radar altimeter: height', '1 / 0\n"""', "radar_altimeter.py:1: ZeroDivisionError: division by zero"),
    ('"""Radar altimeter: height', 'def f(:\n"""', "radar_altimeter.py:1: SyntaxError"),
    ("class RadarAltimeter(Sampled)", "class RadarAltimeter(Use)", "settings must be a class of Sampled"),
    ("        use=Use,\n", "", "one with an aid needs a class of settings in `use`"),
    ("    t_available_s: float\n", "", "begins with t_valid_s and t_available_s"),
    ("PROVIDES = [", "PROVIDES = [7, ", "7 in PROVIDES is none of Instrument, OwnState"),
    ('name="radar_altimeter",', 'name="nees",', "that name means something else"),
    ('name="radar_altimeter",', 'name="star_finder",', "that name means something else"),
    (
        'StateBlock("altimeter_bias"',
        'StateBlock("accel_bias"',
        "there is a block of states 'accel_bias' already",
    ),
)


FAULTS = (  # likewise, of what shows when it flies only
    ("np.zeros(1))", "np.zeros(1), F=np.array([[-50.0]]))", "must add up to at most 10 /s"),
    ("np.zeros(1))", "np.zeros(1), drives=lambda felt: felt.nothing)", "has no attribute 'nothing'"),
    ("np.zeros(1))", "np.zeros(1), drives=lambda felt: np.zeros((6, 2)))", "shape (6, 1), got shape (6, 2)"),
    ("    return Measured(", "    settings.nothing\n    return Measured(", "has no attribute 'nothing'"),
    (
        "flight.t_s[k], height)",
        "flight.t_s[k][::-1], height)",
        "times of its readings must be numbers in asc",
    ),
    (
        "    return Linearised(z, H",
        "    return Linearised(z, H[:, :5]",
        "what lasts have shapes [(1,), (1, 5)",
    ),
    ("here.rows(1)", "here.rows(1) + np.nan", "z and H must be numbers"),
    ('here.columns("altimeter_bias")', 'here.columns("altimeter")', "there is no block 'altimeter'"),
    ('Block("altimeter_bias"', 'Block("altimeter_error"', "expected the same name and record, and states"),
)


@pytest.mark.parametrize(("old", "new", "words"), WRONG)
def test_what_is_wrong_with_a_plugin_is_one_line(tmp_path, old, new, words):
    code = altimeter(tmp_path)
    assert old in code.read_text()
    code.write_text(code.read_text().replace(old, new, 1))
    said = message(scenario(tmp_path), trust=True)
    assert words in said and "plugins.0: " in said
    assert len(said.splitlines()) == 1


def test_what_a_file_was_is_forgotten_when_it_is_edited_and_known_again_when_it_is_as_before(tmp_path):
    code, path = altimeter(tmp_path), scenario(tmp_path)
    first, text = load(str(path), trust=True), altimeter(tmp_path).read_text()
    code.write_text(text.replace("radar_altimeter", "laser_altimeter"))
    assert "radar_altimeter: unknown key" in message(path, trust=True)
    window = 'window: float = quantity("m", "1 m", "of an echo", "1 m")'
    code.write_text(text.replace("bias: float", f"{window}\n    bias: float"))
    assert load(str(path), trust=True).radar_altimeter.window == 1.0
    assert "window" not in first.radar_altimeter.model_dump()
    code.write_text(text)
    again = load(str(path))
    assert again.radar_altimeter == first.radar_altimeter
    assert pickle.loads(pickle.dumps(again)).radar_altimeter == first.radar_altimeter


def test_the_names_that_mean_something_else_are_those_of_the_program():
    """A section, topic, table, figure, sensor or stream that comes later is refused as well."""
    own = set(instruments.BUILT_IN)
    names = {*Scenario.keys(), *noise.STREAMS, *(entry.name for entry in figures.catalogue())}
    names |= {topic.topic.split("/")[1] for topic in topics.topics()}
    assert {
        name for name in names - own if not name.startswith(plugin_checks.PREFIXES)
    } <= plugin_checks.TAKEN


FAULTS_OF_FLIGHT = [*FAULTS[:3], *(pytest.param(*one, marks=pytest.mark.slow) for one in FAULTS[3:])]


@pytest.mark.parametrize(("old", "new", "words"), FAULTS_OF_FLIGHT)
def test_code_that_goes_wrong_in_flight_is_named_with_its_line(old, new, words, tmp_path, command):
    code = altimeter(tmp_path)
    text = code.read_text()
    assert old in text
    code.write_text(text.replace(old, new, 1))
    flown = command("run", scenario(tmp_path), "--trust", "--until", "1s", "--out", tmp_path / "a.mcap")
    assert flown.code != 0
    assert words in flown.err and "radar_altimeter" in flown.err, flown.err


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
    without_consent(tmp_path, monkeypatch)  # somebody who has not given it may look at the log
    assert "radar_altimeter" not in reader.read(log).readings
    for shown in (command("report", log), command("export", log, "--csv", tmp_path / "tables")):
        assert shown.code == 0 and shown.err.count("without what a plug-in brought: ") == 1, shown.err
        assert (
            f"{log}: without what a plug-in brought: '{tmp_path / 'radar_altimeter.py'}' is code" in shown.err
        )
    assert "without what" not in command("report", log, "--trust").err


def without_consent(folder, monkeypatch):
    """As in a process of somebody else."""
    shutil.rmtree(folder / "config")
    (folder / "config").mkdir()
    monkeypatch.setenv(plugins.CONSENT, "")
    plugins._LOADED.clear()
    instruments.TABLE.pop("radar_altimeter", None)


def test_a_worker_of_a_cluster_has_the_consent_of_the_one_who_asks(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="uv sync --extra cluster")
    from shefex_nav.campaign import cluster, flight, plan

    altimeter(tmp_path)
    briefing = cluster.Briefing(plan.of_scenario(load(str(scenario(tmp_path)), trust=True), 1, 1))
    without_consent(tmp_path, monkeypatch)
    for name in flight.ONE_THREAD:
        monkeypatch.setenv(name, "1")
    worker = SimpleNamespace(state=SimpleNamespace(nthreads=1))
    try:
        pickle.loads(pickle.dumps(briefing)).setup(worker)
        pilot = flight._pilots[briefing.digest]
        assert isinstance(pilot, flight.Pilot), pilot
        assert pilot.pattern.scenario.radar_altimeter.noise == 2.0
    finally:
        flight._pilots.pop(briefing.digest, None)
    assert not (tmp_path / "config" / "shefex_nav" / "trusted").exists()  # for this campaign only


KERNELS = """
from shefex_nav.compiled import inner, kernel


@inner
def twice(x):
    return 2.0 * x


@kernel
def total(values):
    s = 0.0
    for x in values:
        s += twice(x)
    if s < 0.0:
        raise ValueError("below zero")
    return s
"""
USE = """
from beside import total
from shefex_nav.plugins import Method

PROVIDES = [Method("scan", "totals", total)]
"""
CALL = """
import sys
import numpy as np
from shefex_nav import plugins
function = plugins.load(sys.argv[1], trust=True)[1][0].function
print(function(np.ones(3)))
function(-np.ones(3))
"""


def test_a_kernel_that_lies_beside_a_plug_in_is_kept_and_loaded(tmp_path):
    """The second process failed, and all workers of a campaign: its module is none of the process."""
    (tmp_path / "beside.py").write_text(KERNELS)
    (tmp_path / "mine.py").write_text(USE)
    settings = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "XDG_CONFIG_HOME": str(tmp_path / "config")}
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", CALL, tmp_path / "mine.py"],
            env={**os.environ, **settings},
            capture_output=True,
            text=True,
        )
        assert done.stdout == "6.0\n", done.stderr
        assert "ValueError: below zero" in done.stderr
    assert len(list((tmp_path / "cache").rglob("beside.total*.kernel"))) == 1


WITH_TABLE = """
from pathlib import Path

from shefex_nav.plugins import Method

TABLE = Path(__file__).with_name("table.csv").read_text()
PROVIDES = [Method("scan", "mine", lambda: TABLE)]


class Mine:
    table = TABLE
"""


def test_the_same_file_in_two_folders_reads_what_lies_beside_it(tmp_path):
    """The second folder was flown with the table of the first."""
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.py").write_text(WITH_TABLE)
        (tmp_path / name / "table.csv").write_text(name)
    for name in "aba":
        path = str(tmp_path / name / "mine.py")
        plugin, (method,) = plugins.load(path, trust=True)
        assert (plugin.path, method.function()) == (path, name)
        assert plugins.software(f"{path}:Mine")[1].table == name


SEARCH = """
from shefex_nav.onboard.startracker import objects
from shefex_nav.plugins import Method


def search(params, stars, memory, frame, context):
    for found in objects.as_spots(params, stars, memory, frame, context):
        yield found._replace(memory=1 if memory is None else memory + 1)


PROVIDES = [Method("search", "counting", search)]
"""


def test_a_search_of_a_file_is_given_what_it_kept_of_the_frame_before(tmp_path):
    (tmp_path / "search.py").write_text(SEARCH)
    path = scenario(tmp_path, "search.py", "star_tracker: {detection: {scan: counting}}")
    path.write_text(path.read_text().replace("rexus_like", "night_sky"))
    loaded = load(str(path), trust=True)
    world = prepare.build_world(loaded, 1)
    used = tracker.init(world.computer.tracker, world.catalogue, 2012.5)
    (state, _), dark = (
        tracker.start(used, 0.0),
        np.random.default_rng(1).integers(18, 22, (493, 659), np.uint8),
    )
    for number in range(3):
        assert state.memory == (number or None)
        frame = Frame(number, 0.1 * number, 0.1 * number, 0.1 * number, 0.05, 0.0, dark)
        state, _, _ = tracker.step(used, state, frame, tracker.NO_CONTEXT)
    assert state.memory == 3


@pytest.mark.parametrize(
    ("step", "name"), [("scan", "streaks"), ("search", "maximum"), ("scan", "run_length")]
)
def test_a_name_at_a_key_of_the_scenario_is_taken_whatever_step_has_it(step, name, tmp_path):
    text = SEARCH.replace('"search", "counting"', f'"{step}", "{name}"')
    (tmp_path / "search.py").write_text(text)
    said = message(scenario(tmp_path, "search.py", ""), trust=True)
    assert f"'{name}': there is a way of {step} of that name already, of the program" in said


@pytest.mark.slow
def test_an_instrument_of_a_file_can_fail_like_any_other(tmp_path):
    """And in ways of its own."""
    own = (
        "\n\nfrom typing import Literal\n\nfrom shefex_nav.instruments.instrument import Fault, FaultKind\n"
        "from shefex_nav.settings import choice\n\n\nclass Iced(Fault):\n"
        '    fault: Literal["iced"] = choice()\n\n\n'
        "PROVIDES = [PROVIDES[0]._replace(faults=(FaultKind(Iced, lambda fault, reading, last: WHAT),))]\n"
    )
    code = altimeter(tmp_path)
    text = code.read_text() + own
    code.write_text(text.replace("WHAT", "reading._replace(height=-1.0)"))
    faults = (
        "faults: {radar_altimeter: [{fault: bias, height: 50 m, from: 1 s, until: 2 s}, "
        "{fault: iced, from: 3 s, until: 4 s}]}"
    )
    path = scenario(tmp_path, more=f"{ALTIMETER}\n{faults}")
    world = prepare.build_world(load(str(path), trust=True), 1)
    healthy = prepare.build_world(load(str(path), ("faults.radar_altimeter=[]",)), 1)
    t_s, height = np.array([one[::2] for one in world.measured["radar_altimeter"].readings]).T
    more = height - [one.height for one in healthy.measured["radar_altimeter"].readings]
    np.testing.assert_allclose(more[(t_s > 0.95) & (t_s < 1.95)], 50.0, atol=1e-9)
    assert set(height[(t_s > 2.95) & (t_s < 3.95)]) == {-1.0} and not more[t_s < 0.95].any()
    names = [event.name for event in world.flight.events if event.name.startswith("fault_")]
    assert names == [f"fault_radar_altimeter_{kind}" for kind in ("bias", "bias_end", "iced", "iced_end")]
    path.write_text(path.read_text().replace("height: 50 m", "hight: 50 m"))
    assert "faults.radar_altimeter.0.hight: unknown key; did you mean 'height'?" in message(path)
    path.write_text(path.read_text().replace("hight: 50 m", "height: 50 m"))
    code.write_text(text.replace("WHAT", "7"))
    with pytest.raises(CodeError, match="fault 'iced' must give a reading of Height, got 7"):
        prepare.build_world(load(str(path), trust=True), 1)
    code.write_text(text.replace('"iced"', '"stuck"'))
    assert "there is a kind of fault 'stuck' already" in message(path, trust=True)


def test_methods_of_a_file_in_a_campaign_with_two_workers(tmp_path, command, monkeypatch):
    (tmp_path / "methods.py").write_text(METHODS)
    path = tmp_path / "sky.yaml"
    path.write_text(
        "# Sky.\nextends: night_sky.yaml\nplugins: [methods.py]\n"
        "mission: {name: sky, time_limit: 3 s}\n"
        "star_tracker:\n  off: 3 s\n  detection: {scan: brightest_first, centroid: as_scanned}\n"
        "  identification: {method: five_stars, tracking: false}\n"
    )
    done = command(
        "campaign", path, "--trust", "--runs", 2, "--workers", 2, "--out", tmp_path / "c", "--json"
    )
    assert done.code == 0, done.err
    assert json.loads(done.out)["runs"]
    config = tmp_path / "config"
    config.rename(tmp_path / "kept")  # somebody else looks at the results
    config.mkdir()
    with monkeypatch.context() as other, plugin_tables.restored():
        other.setenv(plugins.CONSENT, "")
        plugins._LOADED.clear()
        shown = command("report", tmp_path / "c")
    assert shown.code == 0 and shown.err.count("without what a plug-in brought: ") == 1, shown.err
    shutil.rmtree(config)
    (tmp_path / "kept").rename(config)
    assert load(str(path)).star_tracker.identification.method == "five_stars"
    flown = command("run", path, "--trust", "--until", "2.5s", "--seed", 1, "--out", tmp_path / "sky.mcap")
    assert flown.code == 0, flown.err
    fixes = reader.read(tmp_path / "sky.mcap").star_fixes
    assert {fix.scan for fix in fixes} == {Scan.OTHER} and any(fix.reason == Reason.NONE for fix in fixes)
    path.write_text(path.read_text().replace("five_stars", "four_stars"))
    assert "'four_stars' is not known; choose from: bayes, " in message(path)
