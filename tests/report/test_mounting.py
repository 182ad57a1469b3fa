"""The mounting error of the star camera, told apart from the errors of its fixes."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.geometry import rotation
from shefex_nav.report.star_metrics import mounting_error_deg
from shefex_nav.scenario import load

C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
OMEGA_B = np.radians([20.0, -3.0, 5.0])  # a whole turn in 17 s
ERROR_DEG = np.array([0.02, -0.03, 0.05])


def q_ib(t_s):
    begin = np.array([0.5, -0.5, 0.1, 0.7])
    return rotation.quat_multiply(begin / np.linalg.norm(begin), rotation.quat_from_rotvec(OMEGA_B * t_s))


def made(step_s, frames_s, error_deg=ERROR_DEG):
    """A body that turns at OMEGA_B, its truth every step_s, its camera off its mounting by error_deg."""
    t_s = np.arange(0.0, 20.0, step_s)
    truth = SimpleNamespace(
        t_s=t_s, q_ib=np.array([q_ib(t) for t in t_s]), omega_ib_b=np.tile(OMEGA_B, (len(t_s), 1))
    )
    off = rotation.quat_from_rotvec(np.radians(error_deg))
    q_bc = rotation.quat_multiply(rotation.quat_from_dcm(C_BC), off)
    frames = [SimpleNamespace(t_valid_s=t, q_ic=rotation.quat_multiply(q_ib(t), q_bc)) for t in frames_s]
    return SimpleNamespace(truth=truth, frame_truths=frames, mission=SimpleNamespace(C_bc=C_BC))


@pytest.mark.parametrize(
    ("step_s", "frames_s"),
    [
        (0.01, np.arange(1.0, 9.0, 0.1)),
        (1.0, np.arange(1.05, 9.0, 1.0)),  # log.rate: 1 Hz, middle of exposures of 100 ms
        (1.0, np.arange(0.95, 9.0, 1.0)),  # before the nearest sample of truth
        (1.0, [19.4]),  # after the last one
    ],
)
def test_it_is_the_rotation_between_nominal_and_true_mounting(step_s, frames_s):
    assert mounting_error_deg(made(step_s, frames_s)) == pytest.approx(ERROR_DEG, abs=1e-9)


def test_one_frame_of_many_does_not_decide():
    data = made(0.01, np.arange(1.0, 9.0, 0.1))
    data.frame_truths[3].q_ic = np.array([1.0, 0.0, 0.0, 0.0])
    assert mounting_error_deg(data) == pytest.approx(ERROR_DEG, abs=1e-9)


def test_none_without_frames_or_truth():
    assert mounting_error_deg(made(1.0, [])) is None
    data = made(1.0, [2.0])
    data.truth.t_s = data.truth.t_s[:0]
    assert mounting_error_deg(data) is None


def test_fixes_are_as_good_on_a_camera_that_is_mounted_badly():
    """Flights that differ in the mounting alone: the errors of their fixes are the same."""
    from shefex_nav import runs

    quick = ["mission.time_limit=8 s", "star_tracker.off=8 s"]
    found = []
    for error in ("0 deg", "0.2 deg"):
        given = load.load("night_sky", [*quick, f"star_camera.mounting.error={error}"])
        found.append(runs.fly(given, 1, log=None).summary()["star_tracker"])
    straight, off = found
    assert np.linalg.norm(straight["mounting_error_deg"]) == pytest.approx(0.0, abs=1e-9)
    assert 0.02 < np.linalg.norm(off["mounting_error_deg"]) < 0.8  # three draws of 0.2 deg
    means = np.array([one["error_arcsec"]["mean"] for one in found])  # of 0.2 deg, 720 arcsec
    assert means[0, :2] == pytest.approx(means[1, :2], abs=5.0)
