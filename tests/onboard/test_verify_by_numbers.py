"""The last word on an identification, on catalogues of a few stars: slow searches, and every row counts."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain import plain

from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec
from shefex_nav.onboard.startracker.identify import verify

# a principal point far from the middle: the corner at (0, 0) is the furthest from it
CAMERA = SimpleNamespace(width_px=201, height_px=151, focal_length_px=400.0, cx_px=150.0, cy_px=110.0)
Q_IC = quat_from_rotvec(np.array([0.3, -1.2, 0.7]))
C_IC = dcm_from_quat(Q_IC)


def rays(xy_px):
    """Unit vectors in the camera by places, (n, 3)."""
    xy = (np.array(xy_px, dtype=float) - [CAMERA.cx_px, CAMERA.cy_px]) / CAMERA.focal_length_px
    u = np.column_stack([xy, np.ones(len(xy))])
    return u / np.linalg.norm(u, axis=1)[:, None]


def matched(stars_px, seen_px, vmag=None, gate_px=3.0, margin=0.5, u_i=None, displaced_px=0.0):
    u_i = rays(stars_px) @ C_IC.T if u_i is None else u_i
    vmag = np.zeros(len(u_i)) if vmag is None else np.array(vmag)
    return plain(verify._match_kernel)(
        CAMERA, Q_IC, u_i, vmag, np.array(seen_px, dtype=float), gate_px, margin, displaced_px
    )


@pytest.mark.parametrize("seed", range(6))
def test_each_star_takes_its_nearest_detection_and_that_its_nearest_star(seed):
    rng = np.random.default_rng(seed)
    stars, seen = rng.uniform(20.0, 60.0, (9, 2)), rng.uniform(20.0, 60.0, (7, 2))
    d2 = ((stars[:, None] - seen[None]) ** 2).sum(axis=2)
    wanted, distance2 = np.full(7, -1), np.full(7, 64.0)
    for k in range(7):
        claims = [s for s in range(9) if d2[s].argmin() == k and d2[s, k] < 64.0]
        if claims:
            wanted[k] = min(claims, key=lambda s, k=k: d2[s, k])
            distance2[k] = d2[wanted[k], k]
    got, got2, _ = matched(stars, seen, gate_px=8.0)
    assert got.tolist() == wanted.tolist()
    np.testing.assert_allclose(got2, distance2, rtol=1e-6)


def test_stars_are_looked_for_to_the_gate_beyond_the_furthest_corner():
    seen = [(0.5, 0.5), (199.5, 149.5)]
    star, distance2, _ = matched([(-1.0, -1.0), (201.0, 151.0)], seen)
    assert star.tolist() == [0, 1]
    np.testing.assert_allclose(distance2, 4.5, rtol=1e-6)
    wide = rays([(1e4, 50.0)]) @ C_IC.T  # far outside, with a gate that would reach it: not looked at
    assert matched(None, [(50.0, 50.0)], u_i=wide, gate_px=9.9e3)[0].tolist() == [-1]
    behind = -rays([(50.0, 50.0)]) @ C_IC.T
    assert matched(None, [(50.0, 50.0)], u_i=behind)[0].tolist() == [-1]
    assert matched([(50.0, 50.0)], [(52.9, 50.0)])[0].tolist() == [0]
    assert matched([(50.0, 50.0)], [(53.1, 50.0)])[0].tolist() == [-1]


INNER = [(30.0, 40.0), (60.0, 90.0), (120.0, 30.0), (150.0, 120.0)]


@pytest.mark.parametrize(
    "place, missing",
    [((100.0, 75.0), 1), ((5.1, 75.0), 1), ((4.9, 75.0), 0), ((194.9, 75.0), 1), ((195.1, 75.0), 0),
     ((100.0, 5.1), 1), ((100.0, 4.9), 0), ((100.0, 144.9), 1), ((100.0, 145.1), 0)],
)  # fmt: skip
def test_bright_stars_well_inside_should_be_seen(place, missing):
    """Five pixels inside, and brighter by the margin than the faintest that is matched."""
    seen = INNER
    for bright, counts in ((3.4, missing), (3.6, 0)):
        for order in (1, -1):  # the missing one last, or first in the catalogue
            vmag = np.array([2.0, 4.0, 1.0, 3.0, bright])[::order]
            *_, n_missing = matched([*INNER, place][::order], seen, vmag=vmag)
            assert n_missing == counts
    assert matched(INNER, [(90.0, 140.0)], vmag=[0.0] * 4)[2] == 0  # nothing matched: nothing is said


def test_behind_a_lens_that_displaces_stars_are_looked_for_outside_and_may_be_missing_inside():
    """By 20 pixels: a star 25 from the border need not be seen, one 20 beyond the corner is matched."""
    out = (-14.0, -14.0)  # 19.8 px from the corner pixel
    assert matched([out], [out])[0].tolist() == [-1]
    assert matched([out], [out], displaced_px=20.0)[0].tolist() == [0]
    for place, missing in (((24.9, 75.0), 0), ((25.1, 75.0), 1), ((100.0, 124.9), 1), ((100.0, 125.1), 0)):
        vmag = [2.0, 4.0, 1.0, 3.0, 1.0]
        assert matched([*INNER, place], INNER, vmag=vmag, displaced_px=20.0)[2] == missing


def extended(star, seen=None, stars=None, fewest=3, gate_px=2.0):
    seen, stars = INNER if seen is None else seen, INNER if stars is None else stars
    u_i = rays(stars) @ C_IC.T
    return plain(verify._extend_kernel)(
        CAMERA, u_i, np.zeros(len(u_i)), rays(seen), np.array(star), (gate_px, 0.0), 0.5, fewest
    )


def test_a_first_identification_is_extended_to_the_field():
    star, distance2, n_missing = extended([0, 1, 2, -1])
    assert star.tolist() == [0, 1, 2, 3] and n_missing == 0
    np.testing.assert_allclose(distance2, 0.0, atol=1e-9)
    assert extended([0, 1, -1, -1])[2] == -1  # fewer than are asked for
    assert extended([0, 1, 2, -1], fewest=4)[2] == -1 and extended([0, 1, 2, 3], fewest=4)[2] == 0


def test_what_it_began_with_must_be_in_it():
    """A star of another place, also the first of the catalogue, is not there any more."""
    far = [*INNER, (90.0, 60.0)]
    assert extended([0, 1, 2, -1, 3], seen=far)[2] == -1
    off = [(INNER[0][0] + 6.0, INNER[0][1]), *INNER[1:]]
    assert extended([0, 1, 2, 3], seen=off)[2] == -1
    assert extended([0, 1, 2, 3], seen=off, gate_px=9.0)[2] == 0


def test_odds_count_the_first_of_the_catalogue_like_any_other():
    """One star, brightest first: ln p A/(2 pi s^2 k) - d^2/(2 s^2) for the best k, and the price of k."""
    u_c = rays([*INNER, (90.0, 60.0)])
    camera = SimpleNamespace(width_px=201.0, height_px=151.0, focal_length_px=400.0)
    star, d2, sigma, p = np.array([0, -1, 3, 2, -1]), np.array([0.1, 0.0, 0.3, 0.2, 0.0]), 0.3, 0.9
    known = star >= 0
    F = sum(np.eye(3) - np.outer(u, u) for u in u_c[known]) * (400.0 / sigma) ** 2
    attitude = 0.5 * np.log((2.0 * np.pi) ** 3 / np.linalg.det(F)) - np.log(8.0 * np.pi**2)
    each = np.where(known, np.log(p * 201.0 * 151.0 / (2.0 * np.pi * sigma**2)) - d2 / (2.0 * sigma**2), 0.0)
    best = (np.cumsum(each) - np.cumsum(known) * np.log(np.arange(1, 6))).max()
    got = plain(verify.log_odds)(camera, sigma, p, u_c, star, d2, 2)
    assert got == pytest.approx(attitude + best - np.log(5.0) + 2.0 * np.log(0.1), rel=1e-6)
    vmag, flux = np.array([2.0, 9.0, 3.0, 3.3]), np.array([100.0, 1.0, 30.0, 44.0, 1.0])
    difference = vmag[star[known]] + 2.5 * np.log10(flux[known])
    difference = (difference - np.median(difference)) / 0.3
    peak = 4.0 / (np.sqrt(2.0 * np.pi) * 0.3)
    wanted = np.log(0.8 * peak * np.exp(-0.5 * difference**2) + 0.2).sum() - np.log(peak * np.sqrt(3.0))
    assert plain(verify.brightness_odds)(0.3, vmag, flux, star) == pytest.approx(wanted)
