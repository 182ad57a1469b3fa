"""A frame of a log is solved again: as the flight did, by the camera of the log's scenario."""

import json

import numpy as np
import pytest
from PIL import Image

from shefex_nav import runs
from shefex_nav.errors import UserError
from shefex_nav.frames import of_log
from shefex_nav.geometry.rotation import quat_conjugate, quat_normalise, rotvec_between
from shefex_nav.scenario import load
from shefex_nav.solve.image import Record

EVERY = "log.frames.full_every=10"


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Run of a night under the stars with a frame in full every second."""
    log = tmp_path_factory.mktemp("night") / "night.mcap"
    return runs.fly(load.load("night_sky", [EVERY]), 7, until_s=6.0, log=log)


def test_frames_are_solved_as_in_flight(flown):
    """Apart by noise: in flight the search was told more, and the rate of the camera."""
    solved = [of_log.solve(flown.log, t_s) for t_s in (2.0, 3.1, 4.2, 5.0)]
    assert len({one.number for one in solved}) == 4 and all(one.number % 10 == 0 for one in solved)
    for one in solved:
        assert one.solution.status == "ok"
        z = np.linalg.solve(np.linalg.cholesky(one.solution.covariance), _error(flown, one))
        assert z @ z < 25.0  # chance 1.5e-5 of three degrees of freedom
        assert one.from_truth == pytest.approx(np.linalg.norm(_error(flown, one)))
        assert one.from_flight < np.radians(60.0 / 3600.0)


def _error(flown, one):
    """Rotation vector (3,) from the solution to the truth, camera axes."""
    truth = flown.frames[one.t_s].truth
    return rotvec_between(quat_normalise(quat_conjugate(one.solution.q_ci)), truth.q_ic)


def test_command_prints_both(flown, command):
    result = command("solve", flown.log, "--frame", "4s")
    assert result.code == 0, result.err
    assert "frame 30, T+" in " ".join(result.out.split()) and "from the truth" in result.out
    found = json.loads(command("solve", flown.log, "--frame", "4s", "--json").out)
    again = of_log.solve(flown.log, 4.0)
    assert found["frame"] == again.number and found["status"] == "ok"
    assert found["from_truth_arcsec"] == pytest.approx(np.degrees(again.from_truth) * 3600.0)


def test_the_steps_of_a_frame_are_drawn(flown, command, tmp_path):
    """The objects are those of the star tracker that solved the frame; no step of another way is drawn."""
    folder = tmp_path / "steps"
    result = command("solve", flown.log, "--frame", "4s", "--stages", folder)
    assert result.code == 0, result.err
    drawn = sorted(path.name for path in folder.iterdir())
    assert drawn == ["2-objects.png", "3-centroids.png", "6-names.png"]
    for name in drawn:
        assert np.asarray(Image.open(folder / name).convert("L")).std() > 5.0
    record = Record()
    again = of_log.solve(flown.log, 4.0, record)
    np.testing.assert_array_equal(record.field.xy_px, again.solution.xy_px)
    assert command("solve", flown.log, "--frame", "4s", "--stages", folder).code == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "is a log; --frame 240s solves its frame of that time"),
        (("--frame", "4"), "--frame: '4' has no unit"),
        (("--frame", "50s"), "its whole frames are of T+"),
        (("--frame=-5s",), "none is near T-5.00 s"),
        (("--frame", "4s", "--fov", "10"), "--frame: not together with --camera, --fov or --epoch"),
        (("--frame", "4s", "--camera", "night_sky"), "not together with --camera"),
    ],
)
def test_what_does_not_go_together(flown, command, arguments, words):
    result = command("solve", flown.log, *arguments)
    assert result.code == 2 and words in result.err


def test_a_log_without_pictures_is_refused(command, tmp_path):
    log = runs.fly(
        load.load("night_sky", ["log.frames.full_every=0"]), 7, until_s=1.5, log=tmp_path / "a.mcap"
    ).log
    with pytest.raises(UserError, match="keeps no frame whole; fly with --set log"):
        of_log.solve(log, 1.0)
    none = runs.fly(load.load("rexus_like"), 7, until_s=1.0, log=tmp_path / "b.mcap").log
    with pytest.raises(UserError, match="has no frame of a star camera"):
        of_log.solve(none, 1.0)
