"""The wheel brings what the program needs, and nothing else; made here by the project's own build backend."""

import re
import subprocess
import sys
import tarfile
import zipfile
from email.parser import BytesParser
from pathlib import Path

import pytest

import shefex_nav

ROOT = Path(__file__).parents[1]
OF_PYTHON = {"__pycache__", ".pyc"}
LOADS = """
import sys
sys.path.insert(0, sys.argv[1])  # before the checkout
import shefex_nav
from shefex_nav.replay import load as replays
from shefex_nav.scenario import shipped
assert shefex_nav.__file__.startswith(sys.argv[1]), shefex_nav.__file__
for one in shipped.listed():
    assert one.file.startswith(sys.argv[1]), one
    if one.command == "run":
        print(shefex_nav.Scenario.load(one.name).mission.name)
shefex_nav.Scenario.load("shefex2_dispersed", ["star_tracker.frames=statistical"])
replays.load("csv_example")
"""


def built(target, project, folder):
    """The file that `target` (wheel or sdist) of a project's folder is."""
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", folder],
        cwd=project,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (made,) = folder.iterdir()
    return made


def contents(wheel):
    """{name: content} of the files in a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def files(folder):
    """{path below `folder`: content} of the files there that a version control would keep."""
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    kept = (path for path in found if not OF_PYTHON & {*path.parts, path.suffix})
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in kept}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """What the wheel holds."""
    return contents(built("wheel", ROOT, tmp_path_factory.mktemp("wheel")))


def test_the_wheel_is_the_package_and_the_scenarios(wheel):
    package = {f"shefex_nav/{name}": content for name, content in files(ROOT / "shefex_nav").items()}
    scenarios = {
        f"shefex_nav/scenarios/{name}": content
        for name, content in files(ROOT / "scenarios").items()
        if not name.endswith(
            ".py"
        )  # makes data, is no scenario; campaigns tell programs by their Python files
    }
    assert len(package) > 350 and len(scenarios) > 25
    inside = {name: content for name, content in wheel.items() if ".dist-info/" not in name}
    assert set(inside) == {*package, *scenarios}
    assert inside == package | scenarios


def test_data_of_every_kind_are_in_it(wheel):
    """By name: a rule that drops a kind of file on both sides would not be noticed above."""
    for name in (
        *(
            "data/hipparcos_v8.csv.gz",
            "data/egm96_36x36.csv",
            "data/us76_upper.f8",
            "data/land_110m.json",
            "data/land_10m.json.gz",
            "report/page.css",
        ),
        *("scenarios/shefex2_andoya.yaml", "scenarios/data/star_tracker_shefex2.json"),
        *("scenarios/data/improved_orion_like.eng", "scenarios/replay/csv_example/imu.csv"),
    ):
        assert len(wheel[f"shefex_nav/{name}"]) > 300, name


def test_its_scenarios_load_by_name_from_an_empty_folder(wheel, tmp_path):
    for name, content in wheel.items():
        path = tmp_path / "site" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    (tmp_path / "empty").mkdir()
    done = subprocess.run(
        [sys.executable, "-I", "-c", LOADS, tmp_path / "site"],
        cwd=tmp_path / "empty",
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == sorted(path.stem for path in (ROOT / "scenarios").glob("*.yaml"))


def test_what_the_wheel_says_of_itself(wheel):
    """Version of the package, of CITATION.cff too; licences; the command."""
    said = {name.partition(".dist-info/")[2]: text for name, text in wheel.items() if ".dist-info/" in name}
    metadata = BytesParser().parsebytes(said["METADATA"])
    assert metadata["Name"] == "shefex-nav"
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert metadata["Version"] == shefex_nav.__version__ == cited[1]
    assert {"licenses/LICENSE", "licenses/NOTICE"} <= set(said)
    assert b"shefex-nav = shefex_nav.commands.main:main" in said["entry_points.txt"]


def test_the_source_distribution_makes_the_same_wheel(wheel, tmp_path):
    for name in ("source", "unpacked", "again"):
        (tmp_path / name).mkdir()
    with tarfile.open(built("sdist", ROOT, tmp_path / "source")) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    (project,) = (tmp_path / "unpacked").iterdir()
    assert contents(built("wheel", project, tmp_path / "again")) == wheel
    beside = {path.name for path in project.iterdir()} - {"shefex_nav", "scenarios"}
    assert not beside & {"tests", "docs", "notebooks", "benchmarks", "logs"}
