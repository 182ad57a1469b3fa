"""Star tracker software of a user's own, and the files that `shefex-nav new` writes."""

import re

import numpy as np
import pytest
from own_flights import flown, template

from shefex_nav.commands.new import KINDS, TEMPLATES
from shefex_nav.errors import SoftwareError
from shefex_nav.geometry import rotation
from shefex_nav.records import CameraCommand, FrameTruth, Reason, StarFix
from shefex_nav.scenario.load import ScenarioError, load


def test_the_tracker_to_start_from_finds_the_attitude_and_says_how_well(tmp_path):
    path = template("tracker.py", tmp_path)
    records = flown("night_sky", f"star_tracker.software={path}:MyTracker", until_s=6.0)
    truth = {one.number: one for one in records if isinstance(one, FrameTruth)}
    fixes = [one for one in records if isinstance(one, StarFix)]
    solved = [one for one in fixes if one.reason == Reason.NONE]
    assert len(fixes) > 40 and len(solved) > 0.9 * len(fixes)
    errors = [rotation.rotvec_between(one.q_ic, truth[one.number].q_ic) for one in solved]
    across = np.degrees(np.linalg.norm(errors, axis=1)) * 3600.0
    assert np.median(across) < 60.0 and across.max() < 300.0  # mounting is in the truth, centres of mass err


SEEN = """
from shefex_nav.software import Solved


class Seen:
    def start(self, mission):
        self.frames = 0

    def step(self, frame, context):
        self.frames += 1
        HERE
"""


def test_commands_of_the_tracker_reach_the_camera(tmp_path):
    path = tmp_path / "seen.py"
    path.write_text(SEEN.replace("HERE", "return Solved(exposure_s=0.02, gain_db=10.0)"))
    records = flown("night_sky", f"star_tracker.software={path}:Seen", until_s=2.0)
    commands = [one for one in records if isinstance(one, CameraCommand)]
    assert {(one.exposure_s, one.gain_db) for one in commands[1:]} == {(0.02, 10.0)}
    fixes = [one for one in records if isinstance(one, StarFix)]
    assert fixes[-1].exposure_s == 0.02 and {one.reason for one in fixes} == {Reason.NO_MATCH}


@pytest.mark.parametrize(
    ("here", "words"),
    [
        ("1 / 0", "failed in step"),
        ("return None", "must give a Solved, got None"),
        ("return Solved((1, 0, 0, 0), 0.0 * frame.image_dn[:3, :3])", "P_c must be positive definite"),
        (
            "return Solved((1, 0, 0, 0), ((4e-9, 3e-9, 0), (0, 4e-9, 0), (0, 0, 4e-9)))",
            "P_c must be positive definite",
        ),
        ("return Solved((1, 0, 0, 1), frame.image_dn[:3, :3])", "q_ic must be a unit quaternion"),
        ("return Solved(exposure_s=3.0)", "asked for an exposure of 3 s; frames come every 0.1 s"),
        ("return Solved(reason=0)", "gave no attitude and no reason"),
        ("return Solved(exposure_s='long')", "exposure_s of its Solved must be numbers, got 'long'"),
        ("return Solved(xy_px=None)", "xy_px must be numbers, got None"),
        ("return Solved(xy_px=[[1, 2]], flux_dn=[1], hip=[2**31])", "hip must be 2147483647 at most, got"),
    ],
)
def test_mistakes_of_the_tracker_are_told(tmp_path, here, words):
    path = tmp_path / "seen.py"
    path.write_text(SEEN.replace("HERE", here))
    with pytest.raises(SoftwareError, match=re.escape(words)) as told:
        flown("night_sky", f"star_tracker.software={path}:Seen", until_s=2.0)
    assert re.match(r"star tracker software seen.py:Seen, T\+\d+\.\d\d s: ", str(told.value))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            "context.q_ic[[1, 2, 3, 0]]",
            "q_ic is the attitude that the navigation predicts with the scalar last",
        ),
        (
            "context.q_ic * [1, -1, -1, -1]",
            "that the navigation predicts the other way round (its conjugate)",
        ),
    ],
)
def test_an_attitude_in_another_convention_is_told_at_once(tmp_path, given, words):
    path = tmp_path / "seen.py"
    here = f"return Solved({given}, 1e-9 * np.eye(3)) if context.P_c is not None else Solved()"
    path.write_text("import numpy as np\n" + SEEN.replace("HERE", here))
    with pytest.raises(SoftwareError, match=re.escape(words)):
        flown("night_sky", f"star_tracker.software={path}:Seen", until_s=3.0)


@pytest.mark.parametrize(
    "here",
    [
        "frame.image_dn[:] = 0",
        "self.mission.C_bc[:] = 0",
        "context.velocity_i is None or context.velocity_i.fill(0)",
    ],
)
def test_a_tracker_does_not_write_into_what_is_logged_or_flies(tmp_path, here):
    path = tmp_path / "seen.py"
    text = SEEN.replace("HERE", f"{here}\n        return Solved()")
    path.write_text(text.replace("self.frames = 0", "self.frames, self.mission = 0, mission"))
    with pytest.raises(SoftwareError, match="read-only"):
        flown("night_sky", f"star_tracker.software={path}:Seen", until_s=3.0)


def test_statistics_are_of_the_built_in_tracker(tmp_path):
    path = tmp_path / "seen.py"
    path.write_text(SEEN.replace("HERE", "return Solved()"))
    how = [f"star_tracker.software={path}:Seen", "star_tracker.frames=statistical"]
    with pytest.raises(ScenarioError, match="statistics are of the built-in star tracker"):
        load("shefex2_andoya", how, trust=True)


def test_new_writes_each_and_overwrites_nothing(tmp_path, command):
    for kind, one in KINDS.items():
        path = tmp_path / f"my_{kind}{one.file[one.file.rindex('.') :]}"
        done = command("new", kind, str(path))
        assert done.code == 0 and f"wrote {path}" in done.err, done.err
        assert path.read_text() and "FILE" not in path.read_text()
        of_a_rocket = kind == "scenario"  # which is no new one: where that is described is told twice
        assert ("docs/describe-your-rocket.md" in done.err) is of_a_rocket
        assert ("docs/describe-your-rocket.md" in path.read_text()) is of_a_rocket
        again = command("new", kind, str(path))
        assert again.code == 2 and "exists already" in again.err
    assert command("check", str(tmp_path / "my_scenario.yaml")).code == 0
    wrong = command("new", "filter", str(tmp_path / "x.yaml"))
    assert wrong.code == 2 and "ends in .py" in wrong.err


@pytest.mark.parametrize("kind", ["sensor", "identification"])
def test_a_plug_in_to_start_from_is_that_of_its_page(kind):
    page = (TEMPLATES.parent.parent / "docs" / "how-to" / f"{kind}.md").read_text(encoding="utf-8")
    assert (TEMPLATES / f"{kind}.py").read_text(encoding="utf-8") in page
