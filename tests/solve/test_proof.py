"""A fit is proved by its own attitude, or not at all."""

import numpy as np

from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec, quat_conjugate, quat_from_dcm
from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.solve import centroids, lens, proof, search
from shefex_nav.solve.camera import Camera

SIZE, FOCAL_PX, YEAR = (1000, 800), 2800.0, 2026.0


def picture(rng):
    """(fit, detections, flux) of a random field, the fit that of the truth."""
    while True:
        q = rng.normal(size=4)
        at = lens.Lens(dcm_from_quat(q / np.linalg.norm(q)), FOCAL_PX)
        sky = search.sky_of(at, 45, SIZE, YEAR)
        xy, _ = lens.project(at, sky.u_i, SIZE)
        inside = ((xy > 0) & (xy < [999, 799])).all(axis=1) & (sky.u_i @ at.C_ci[2] > 0.5)
        xy = xy[inside] + rng.normal(0.0, 0.2, (inside.sum(), 2))
        flux = 10 ** (-0.4 * sky.vmag[inside])
        order = np.argsort(-flux)
        xy, flux = np.ascontiguousarray(xy[order]), flux[order]
        fit = lens.fit(at, sky.u_i, xy, SIZE)
        if fit is not None:
            return fit, xy, flux


def proved(fit, xy, flux):
    return proof.prove(fit, search.sky_of(fit.lens, 45, SIZE, YEAR), xy, flux, SIZE, 1.0)


def test_the_truth_is_proved_and_its_turned_copies_are_not():
    rng = np.random.default_rng(1)
    for _ in range(4):
        fit, xy, flux = picture(rng)
        assert proved(fit, xy, flux).is_true
        for turn in ([0.0, 0.0, 0.5], [0.0, 0.0, 2.0], [0.02, 0.0, 0.0], [0.0, 0.004, 0.0]):
            turned = dcm_from_rotvec(np.array(turn)) @ fit.lens.C_ci
            assert not proved(fit._replace(lens=fit.lens._replace(C_ci=turned)), xy, flux).is_true


def test_near_a_prediction_it_is_the_identification_that_flies():
    """The same to the last bit where that confirms its prediction; where it does not, no solution."""
    rng, camera = np.random.default_rng(3), Camera(*SIZE, FOCAL_PX)
    ready = centroids._ready(camera, "V", YEAR, 6.5, 0.2, 0.3, 1e-5)
    P_c = np.diag([1e-3, 1e-3, 2e-3]) ** 2
    confirmed = denied = 0
    for k in range(24):
        fit, xy, flux = picture(rng)
        off = rng.normal(0.0, 5e-4, 3) if k % 2 else rng.normal(0.0, 0.3, 3)
        q_ci = quat_from_dcm(dcm_from_rotvec(off) @ fit.lens.C_ci)
        frame = xy[:30], -2.5 * np.log10(flux[:30])
        sky = ready.sky
        whole = bayes.Solution(
            *bayes.solve_kernel(
                sky.stars, sky.index, ready.numbers, *frame, True, (True, quat_conjugate(q_ci), P_c)
            )
        )
        alone = bayes.Solution(*proof.near(sky.stars, ready.numbers, *frame, (True, q_ci, P_c)))
        assert alone.tracked
        if whole.reason == 0 and whole.tracked:
            confirmed += 1
            for one, other in zip(alone, whole, strict=True):
                np.testing.assert_array_equal(one, other)
        else:
            denied += 1
            assert alone.reason != 0
    assert confirmed >= 10 and denied >= 10
