"""The filter of the search, against brute force; and how soon a frame without stars is given up."""

import numpy as np
import pytest
from star_fields import CAMERA, MODEL, centroid_list, random_attitude, ready_tracker

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.onboard.startracker.identify import bayes, evidence, screen, search

SIZE = np.array([CAMERA.width_px, CAMERA.height_px]) - 1.0


def numbers_of(budget=bayes.BUDGET):
    hole = MODEL.pinhole
    return bayes.Numbers(
        float(hole.width_px), float(hole.height_px), hole.focal_length_px, hole.cx_px, hole.cy_px, 5.0,
        0.15, 0.2, 1e-5, 4, budget,
    )  # fmt: skip


def solve(xy_px, magnitude, **options):
    order = np.argsort(magnitude)
    tables = ready_tracker().pairs.quick
    frame = np.ascontiguousarray(xy_px[order]), magnitude[order], True
    return bayes.Solution(*bayes.solve_kernel(*tables, numbers_of(**options), *frame, bayes.NO_PREDICTION))


def test_partners_against_brute_force():
    stars, pairs = ready_tracker().pairs.quick
    rng = np.random.default_rng(3)
    n, tolerance, width = 6, 5e-4, 1.4
    xy, mag = rng.uniform([0.0, 0.0], SIZE, (n, 2)), np.sort(rng.uniform(2.0, 5.5, n))
    u_c = np.column_stack([(xy - [CAMERA.cx_px, CAMERA.cy_px]) / CAMERA.focal_length_px, np.ones(n)])
    u_c /= np.linalg.norm(u_c, axis=1)[:, None]
    found = np.zeros((n, len(stars.vmag)), dtype=np.uint32)
    for i in range(n):
        for j in range(i):
            entries = search.window(pairs, u_c, i, j, tolerance)
            fainter = mag[j] - mag[i]
            screen.mark(pairs, found, (i, j), entries, (fainter - width, fainter + width))
    angle = np.arccos(np.clip(stars.u_i @ stars.u_i.T, -1.0, 1.0))
    for i in range(n):
        for j in range(n):
            if i == j:
                assert not (found[i] & np.uint32(1 << i)).any()
                continue
            apart = np.arccos(u_c[i] @ u_c[j])
            fits = np.abs(angle - apart) < tolerance  # [a, b]: a of i, b of j
            fits &= np.abs(stars.vmag[None] - stars.vmag[:, None] - (mag[j] - mag[i])) < width
            expected = fits.any(axis=1)
            bits = (found[i] & np.uint32(1 << j)) != 0
            assert (bits != expected).sum() <= 2  # rounding at the edge of a gate
            assert expected.any()


@pytest.mark.parametrize("n", [4, 5, 19, 25, 32])
def test_pairs_from_all_are_each_once(n):
    """In turn the brightest of all that are left, and a fair sample: half of the first tenth is spread."""
    order = search.pairs_by_brightness(n)
    mixed = search.from_all(order)
    assert {tuple(pair) for pair in mixed} == {tuple(pair) for pair in order} and len(mixed) == len(order)
    left = list(range(len(order)))
    place = {tuple(pair): k for k, pair in enumerate(order.tolist())}
    for k, pair in enumerate(mixed.tolist()):
        if k % 2 == 0:
            assert place[tuple(pair)] == left[0]
        left.remove(place[tuple(pair)])
    if n >= 19:
        spread = np.sort([place[tuple(pair)] for pair in mixed[1 : len(order) // 5 : 2].tolist()])
        widest = np.diff(np.concatenate([[0], spread, [len(order)]])).max()
        assert widest < 4.0 * len(order) / len(spread)


@pytest.mark.parametrize(
    "bits, need, has", [(0, 0, True), (0, 1, False), (4, 1, True), (4, 2, False), (5, 2, True)]
)
def test_bits_are_counted(bits, need, has):
    assert screen.has_bits(np.uint64(bits), need) == has


def test_the_filter_keeps_right_attitudes():
    """Four stars among fifteen false ones: what is solved with all the time in the world is solved."""
    rng, stars = np.random.default_rng(17), ready_tracker().pairs.stars
    solved = patient = 0
    for _ in range(60):
        u_c, flux, star = centroid_list(rng, stars, random_attitude(rng), 0)
        known = np.flatnonzero(star >= 0)
        if len(known) < 4:
            continue
        four = rng.choice(known, 4, replace=False)
        xy = np.vstack([pixels(CAMERA, u_c[four]), rng.uniform([0.0, 0.0], SIZE, (15, 2))])
        mag = np.concatenate([-2.5 * np.log10(flux[four]), rng.uniform(3.0, 5.5, 15)])
        solved += solve(xy, mag).reason == 0
        patient += solve(xy, mag, budget=4_000_000).reason == 0
    assert patient >= 20
    assert solved >= patient - 1


def test_noise_is_given_up_soon():
    rng = np.random.default_rng(5)
    for n in (6, 12, 24, 32):
        found = solve(rng.uniform([0.0, 0.0], SIZE, (n, 2)), rng.uniform(2.0, 5.5, n))
        assert found.reason != 0
        assert found.work < 1.2 * bayes.BUDGET


def task_of(n):
    rng = np.random.default_rng(6)
    xy, mag = rng.uniform([0.0, 0.0], SIZE, (n, 2)), np.sort(rng.uniform(2.0, 5.5, n))
    stars, hole = ready_tracker().pairs.quick[0], MODEL.pinhole
    scene = evidence.Scene(
        xy, mag, True, float(hole.width_px), float(hole.height_px), hole.focal_length_px, hole.cx_px,
        hole.cy_px, 5.0, 0.15, 0.2, None,
    )  # fmt: skip
    seen = screen.new_seen(scene, None)
    prior = evidence.Prior(False, np.eye(3), np.zeros((3, 3)))
    return search.Task(stars, scene, prior, seen, bayes.new_best(n), evidence.new_view(), 4, 5.0, 11.0)


def test_the_filter_costs_less_than_the_search():
    pairs = ready_tracker().pairs.quick[1]
    for n in (8, search.MOST_FILTERED):
        task = task_of(n)
        assert not search.crowd_of(task, pairs)[0]
        u_c = screen.directions(task.scene, task.scene.focal_px)
        order = search.pairs_by_brightness(n)
        filtered, work = search.with_partners(task, pairs, u_c, order, search.PASSES[1])
        assert filtered.seen.partners.shape == (n, len(task.stars.vmag))
        assert 0 < work < 0.7 * bayes.BUDGET


def test_where_the_filter_does_not_pay_the_search_is_as_long_as_without():
    pairs = ready_tracker().pairs.quick[1]
    assert search.crowd_of(task_of(search.MOST_FILTERED + 1), pairs) == (True, search.MOST_GROWTH)
    vague = task_of(10)
    vague = vague._replace(scene=vague.scene._replace(centroid_error=1.5))
    is_dense, growth = search.crowd_of(vague, pairs)
    assert is_dense and 2.0 < growth <= search.MOST_GROWTH
