"""A prediction that the stars contradict is forgotten: the frame is solved lost in space, as without one."""

import numpy as np
import pytest
from star_fields import CAMERA, centroid_list, random_attitude, ready_tracker

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import quat_conjugate, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.onboard.startracker.identify import bayes

NUMBERS = bayes.Numbers(
    float(CAMERA.width_px), float(CAMERA.height_px), CAMERA.focal_length_px, CAMERA.cx_px, CAMERA.cy_px, 5.0,
    0.15, 0.2, 1e-6, 4, bayes.BUDGET,
)  # fmt: skip
FRAMES = 40


@pytest.mark.parametrize(("sigma_deg", "off_deg", "n_false"), [(3, 12, 15), (5, 20, 15), (10, 40, 5)])
def test_as_many_are_solved_as_without_it(sigma_deg, off_deg, n_false):
    """Four sigma off: so wide a prediction admits stars enough to use up the budget of its own."""
    rng, pairs = np.random.default_rng([902, sigma_deg]), ready_tracker().pairs
    solved = {"with": 0, "without": 0}
    for _ in range(FRAMES):
        q_ic = random_attitude(rng)
        u_c, flux, _ = centroid_list(rng, pairs.stars, q_ic, n_false)
        order = np.argsort(-flux)
        frame = np.ascontiguousarray(pixels(CAMERA, u_c)[order]), -2.5 * np.log10(flux[order]), True
        axis = rng.standard_normal(3)
        turn = quat_from_rotvec(np.radians(off_deg) * axis / np.linalg.norm(axis))
        wrong = (
            True,
            quat_conjugate(quat_multiply(turn, quat_conjugate(q_ic))),
            np.radians(sigma_deg) ** 2 * np.eye(3),
        )
        for name, prediction in (("with", wrong), ("without", bayes.NO_PREDICTION)):
            found = bayes.Solution(*bayes.solve_kernel(*pairs.quick, NUMBERS, *frame, prediction))
            assert found.work < 3 * bayes.BUDGET
            if found.reason == 0:
                solved[name] += 1
                assert np.linalg.norm(rotvec_between(quat_conjugate(found.q_ci), q_ic)) < np.radians(0.5)
    assert solved["with"] >= solved["without"] >= 0.95 * FRAMES
