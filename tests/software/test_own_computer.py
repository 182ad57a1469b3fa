"""A whole computer of a user's own, and star trackers and computers that are programs of their own."""

import sys

import numpy as np
import pytest
from own_flights import flown, same, template

from shefex_nav.errors import SoftwareError
from shefex_nav.geometry import rotation
from shefex_nav.records import CameraCommand, Frame, FrameTruth, NavSolution, Reason, StarFix
from shefex_nav.scenario.load import ScenarioError, load

BOTH = """
from my_filter import MyFilter
from my_tracker import MyTracker

from shefex_nav.onboard.startracker.tracker import NO_CONTEXT
from shefex_nav.records import Frame, StarFix
from shefex_nav.software import CameraCommand


class Both:
    def start(self, alignment, mission):
        self.filter, self.tracker = MyFilter(), MyTracker()
        self.filter.start(alignment, mission)
        self.tracker.start(mission)
        self.on, self.fixes = False, []

    def step(self, imu, arrived):
        given = []
        if not self.on and imu.t_valid_s > 1.0:
            self.on = True
            given.append(CameraCommand(imu.t_valid_s, 0.05, 24.0))
        for frame in [one for one in arrived if isinstance(one, Frame)]:
            solved = self.tracker.step(frame, NO_CONTEXT)._replace(number=frame.number)
            given.append(solved)
            HERE
        return given + self.filter.step(imu, [one for one in arrived if not isinstance(one, Frame)])
"""
PROGRAM = """
import sys

sys.path.insert(0, FOLDER)
from shefex_nav.software import serve
from MODULE import CLASS

serve(CLASS())
"""


@pytest.fixture
def folder(tmp_path):
    """With a filter and a tracker to start from."""
    for name in ("filter.py", "tracker.py"):
        template(name, tmp_path)
    return tmp_path


def both(folder, here="pass"):
    path = folder / "both.py"
    path.write_text(BOTH.replace("HERE", here))
    return path


def program(folder, module, name):
    """Command of a program that serves a class of a module in the folder."""
    path = folder / f"serve_{module}.py"
    text = PROGRAM.replace("FOLDER", repr(str(folder))).replace("MODULE", module).replace("CLASS", name)
    path.write_text(text)
    return f"{{command: [{sys.executable}, {path}]}}"


def of(records, kind):
    return [one for one in records if isinstance(one, kind)]


def test_a_computer_commands_the_camera_and_finds_its_attitude(folder):
    records = flown("night_sky", f"computer.software={both(folder)}:Both", until_s=4.0)
    commands, frames, fixes = (of(records, kind) for kind in (CameraCommand, Frame, StarFix))
    assert commands[0] == CameraCommand(pytest.approx(1.01), 0.05, 24.0)
    assert frames[0].t_start_s == pytest.approx(1.1, abs=0.011)  # the first one that is due
    assert len(frames) == len(fixes) > 25 and {frame.exposure_s for frame in frames} == {0.05}
    truth = {one.number: one for one in of(records, FrameTruth)}
    solved = [one for one in fixes if one.reason == Reason.NONE]
    assert len(solved) > 0.9 * len(fixes)
    for fix in solved:
        error = rotation.rotvec_between(fix.q_ic, truth[fix.number].q_ic)
        assert np.degrees(np.linalg.norm(error)) < 0.1
        assert fix.t_available_s >= next(one for one in frames if one.number == fix.number).t_available_s
    assert len(of(records, NavSolution)) == 400


@pytest.mark.parametrize("exposure", [0.01, 0.03])
def test_exposures_asked_for_with_a_solution_are_those_of_the_next_pictures(folder, exposure):
    here = f"given[-1] = solved._replace(exposure_s={exposure}, gain_db=20.0)"
    records = flown("night_sky", f"computer.software={both(folder, here)}:Both", until_s=2.0)
    frames, commands = of(records, Frame), of(records, CameraCommand)
    assert {(one.exposure_s, one.gain_db) for one in commands[1:]} == {(exposure, 20.0)}
    assert (frames[-1].exposure_s, frames[-1].gain_db) == (exposure, 20.0)


def test_a_camera_that_is_not_commanded_takes_no_picture(folder):
    path = both(folder)
    path.write_text(path.read_text().replace("imu.t_valid_s > 1.0", "False"))
    records = flown("night_sky", f"computer.software={path}:Both", until_s=1.5)
    assert not of(records, Frame) and len(of(records, NavSolution)) == 150


@pytest.mark.parametrize("section", ["computer", pytest.param("star_tracker", marks=pytest.mark.slow)])
def test_a_program_gives_what_the_class_gives(folder, section):
    module, name = {"computer": ("both", "Both"), "star_tracker": ("my_tracker", "MyTracker")}[section]
    both(folder)
    key = f"{section}.software"
    here = flown("night_sky", f"{key}={folder / module}.py:{name}", until_s=2.0)
    apart = flown("night_sky", f"{key}={program(folder, module, name)}", until_s=2.0)
    assert len(of(here, StarFix)) > 5 and same(here, apart)


def test_pictures_of_more_than_eight_bits_reach_a_program_whole(folder):
    wide = "star_camera.detector.bits=12", "star_tracker.detection.saturation=4095 DN"
    path = folder / "looks.py"
    path.write_text(
        "from shefex_nav.software import Solved\n"
        "class Looks:\n"
        "    def start(self, mission): pass\n"
        "    def step(self, frame, context):\n"
        "        assert frame.image_dn.dtype == 'uint16'\n"
        "        seen = int(frame.image_dn.max()) + int(frame.image_dn[3, 5])\n"
        "        return Solved(exposure_s=1e-6 * (1 + seen))\n"
    )
    key = "star_tracker.software"
    here = flown("night_sky", *wide, f"{key}={path}:Looks", until_s=1.6)
    apart = flown("night_sky", *wide, f"{key}={program(folder, 'looks', 'Looks')}", until_s=1.6)
    exposures = {one.exposure_s for one in of(here, CameraCommand)[1:]}
    assert max(exposures) > 256e-6 and same(here, apart)


@pytest.mark.parametrize(
    ("here", "words"),
    [
        ("given[-1] = solved._replace(number=None)", "gave a Solved of frame None, which has not come"),
        ("given.append(solved)", "which has not come, has been answered"),
        ("given[-1] = solved._replace(exposure_s=0.2)", "asked for an exposure of 0.2 s"),
        ("given.append(CameraCommand(imu.t_valid_s + 1.0, 0.05, 24.0))", "of another tick"),
        ("given.append(CameraCommand(imu.t_valid_s, 0.05, 99.0))", "asked for a gain of 99.0 dB"),
        ("given.append(7)", "may give Estimate, NavSolution, .*Solved, CameraCommand"),
        ("frame.image_dn[0, 0] = 0", "failed in step"),
    ],
)
def test_what_a_computer_gives_is_looked_at(folder, here, words):
    with pytest.raises(SoftwareError, match=f"computer both.py:Both, T.* s: .*{words}"):
        flown("night_sky", f"computer.software={both(folder, here)}:Both", until_s=1.5)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            ("navigation.software=shefex_nav.software.built_in:BuiltIn",),
            "leave this out, or computer.software",
        ),
        (("star_tracker.frames=statistical",), "statistics are of the built-in star tracker"),
        (
            ("faults.star_tracker=[{from: 1 s, until: 2 s, fault: bias, angles: [1 deg, 0 deg, 0 deg]}]",),
            "nothing can be bias; blinded goes with it",
        ),
    ],
)
def test_what_does_not_go_with_a_computer(folder, overrides, words):
    with pytest.raises(ScenarioError, match=words):
        load("night_sky", (f"computer.software={both(folder)}:Both", *overrides), trust=True)


def test_a_log_of_it_is_replayed_by_the_built_in_filter_alone(command, folder, tmp_path):
    log = tmp_path / "own.mcap"
    own = f"computer.software={both(folder)}:Both"
    done = command("run", "night_sky", "--set", own, "--until", "2s", "--out", log, "--trust")
    assert done.code == 0 and "both.py:Both" in done.out
    assert "computer.software=built_in runs" in command("replay", log).err
    again = command("replay", log, "--set", "computer.software=built_in", "--json")
    assert again.code == 0


TOLD = """
# {name}
{imports}
from shefex_nav.software import Solved


class Seen:
    def start(self, mission): pass
    def step(self, frame, context): return Solved(exposure_s=told.EXPOSURE)
"""


def seen(folder, exposure, package=False):
    """Path of a tracker that asks for an exposure, which stands in a file or a package beside it."""
    place = folder / "common" if package else folder
    place.mkdir(parents=True, exist_ok=True)
    (place / "told.py").write_text(f"EXPOSURE = {exposure}\n")
    path = folder / "seen.py"
    imports = "from common import told" if package else "import told"
    path.write_text(TOLD.format(name=folder.name, imports=imports))
    return path


@pytest.mark.parametrize("package", [False, True])
def test_files_of_one_name_in_two_folders_are_not_mixed_up(tmp_path, package):
    paths = {exposure: seen(tmp_path / str(exposure), exposure, package) for exposure in (0.01, 0.03)}
    for exposure, path in paths.items():
        records = flown("night_sky", f"star_tracker.software={path}:Seen", until_s=1.5)
        assert {one.exposure_s for one in of(records, CameraCommand)[1:]} == {exposure}


@pytest.mark.parametrize("package", [False, True])
def test_what_lies_beside_a_file_belongs_to_it(tmp_path, package):
    path = seen(tmp_path, 0.01, package)
    override = f"star_tracker.software={path}:Seen"
    first = load("night_sky", [override], trust=True).star_tracker.software.sha256
    assert load("night_sky", [override]).star_tracker.software.sha256 == first  # consent is kept
    seen(tmp_path, 0.03, package)
    with pytest.raises(ScenarioError, match="is code that flying this scenario would run"):
        load("night_sky", [override])
    assert load("night_sky", [override], trust=True).star_tracker.software.sha256 != first
    records = flown("night_sky", override, until_s=1.5)
    assert {one.exposure_s for one in of(records, CameraCommand)[1:]} == {0.03}


def test_what_lies_beside_a_file_is_not_looked_for_in_flight(tmp_path):
    path = seen(tmp_path, 0.01)
    path.write_text(path.read_text().replace("import told\n", "").replace("return", "import told; return"))
    with pytest.raises(
        ScenarioError, match=r"seen.py:8: imports 'told', .* in a function; import it at the top"
    ):
        load("night_sky", [f"star_tracker.software={path}:Seen"], trust=True)


def test_requirements_of_protection_levels_are_not_judged_of_a_computer(command, folder, tmp_path):
    own = f"computer.software={both(folder)}:Both"
    told = "requirements.misleading=0 %"
    done = command("run", "night_sky", "--set", own, "--set", told, "--until", "2s", "--trust",
                   "--out", tmp_path / "own.mcap")  # fmt: skip
    assert done.code == 0 and "cannot be judged" in done.out and "not met" not in done.out
