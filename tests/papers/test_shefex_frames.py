"""The experiments on rendered frames: their measures, and that the methods they compare do the same work."""

import numpy as np
import pytest

from shefex_nav.papers.bright import centroids
from shefex_nav.papers.shefex2 import end_to_end, frames
from shefex_nav.papers.verdict import Verdict


def test_scatter_is_one_minus_r_squared():
    rng = np.random.default_rng(1)
    t = np.arange(40.0)
    assert centroids.scatter(3.0 + 0.7 * t) == pytest.approx(0.0, abs=1e-25)
    noisy = 3.0 + 0.7 * t + rng.normal(0.0, 2.0, (5, 40))
    expected = [1.0 - np.corrcoef(t, row)[0, 1] ** 2 for row in noisy]
    np.testing.assert_allclose(centroids.scatter(noisy), expected)


def test_tables_that_differ_are_told_apart():
    table = np.random.default_rng(2).uniform(10.0, 400.0, (6, 8))
    table[:, frames.scan.PIXELS] = [9, 12, 14, 20, 25, 30]
    assert frames.same_objects(table, table[::-1])
    other = table.copy()
    other[2, frames.scan.X] += 0.5
    assert not frames.same_objects(table, other)
    other = table.copy()
    other[3, frames.scan.PIXELS] += 1
    assert not frames.same_objects(table, other)
    assert not frames.same_objects(table, table[1:])


def test_both_scans_find_the_objects():
    seconds = frames.measure_scan(3, np.random.SeedSequence(3))
    assert seconds.shape == (3, 2, 4)
    assert (seconds[..., 3] == 1.0).all()
    assert (seconds[..., :3] > 0.0).all()


def test_the_ratio_of_the_scans_is_explained_by_more_objects_or_by_nothing():
    """11.1 is published: 8 with fewer and 12 with more objects have it between them, 8 and 9 have not."""
    rng = np.random.default_rng(6)

    def judged(fewer, more):
        seconds = np.ones((30, 2, 4))
        seconds[:, 0, 1], seconds[:, 1, 1] = rng.normal([fewer, more], 0.05, (30, 2)).T
        rows = frames.conclude_scan([seconds])
        return [row for row in rows if row.quantity == frames.RATIO_WORDS and row.verdict != Verdict.NONE]

    (one,) = judged(8.0, 12.0)
    assert one.verdict == Verdict.EXPLAINED and one.run == "shefex-scan/20 objects"
    assert judged(8.0, 9.0)[0].verdict == Verdict.OPEN
    assert judged(11.1, 15.0)[0].verdict == Verdict.REPRODUCED


def test_centroids_follow_the_star():
    distance = centroids.measure_centroids(2, np.random.SeedSequence(4))
    for m, limit_px in enumerate((0.08, 0.15, 0.05)):
        assert np.abs(distance[:, m] - distance[:, -1]).max() < limit_px


def test_the_chain_solves_stills_and_is_told_what_is_wrong():
    rng = np.random.default_rng(5)
    solved = 0
    for _ in range(6):
        q_ic, (u_i, magnitudes) = end_to_end.random_attitude(rng), end_to_end.sky_of(rng)
        light = end_to_end.electrons(end_to_end.SPACE, magnitudes)
        image, _ = end_to_end.still(end_to_end.SPACE, u_i, light, q_ic, rng)
        found = end_to_end.solve_frame(image, "default", "space")
        solved += end_to_end.verdict(found, q_ic)
        if found is not None:
            assert end_to_end.verdict(found, end_to_end.random_attitude(rng)) == -1
    assert end_to_end.verdict(None, q_ic) == 0
    assert solved >= 5


def test_every_column_of_verdicts_has_its_share():
    """Half solved, one wrong of four: in each of the conditions."""
    columns = len(end_to_end.PLACES) * len(end_to_end.WAYS) + 1
    verdicts = np.repeat([[1], [1], [0], [-1]], columns, axis=1)
    rows = end_to_end.conclude_end_to_end([verdicts])
    assert len({row.condition for row in rows}) == columns
    assert any("night_sky" in row.condition for row in rows)
    shares = {float(row.measured) for row in rows if "olved" in row.quantity or "success" in row.quantity}
    assert shares == {0.5}
