"""A fit is proved by its own attitude, or not at all."""

import numpy as np

from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec
from shefex_nav.solve import lens, proof, search

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
