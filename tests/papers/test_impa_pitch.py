"""The readings of IMPA's compensation of which the mean of pitch is made."""

import numpy as np

from shefex_nav.papers.impa import field, flight, pitch, trackers
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.methods import clusters as cluster

SETTINGS = trackers.DETECT.run_length
TIMES = field.times(pitch.SHUTTER)


def clusters_of(xy_px, extent_px):
    """Clusters of these centroids and extents, centred on them: what `moved` reads of them."""
    xy_px, extent_px = np.array(xy_px, dtype=float), np.array(extent_px, dtype=np.int64)
    first = np.round(xy_px - 0.5 * extent_px).astype(np.int64)
    last = first + extent_px
    blank = np.zeros(len(xy_px))
    return cluster.Clusters(xy_px, blank, first[:, 1], last[:, 1], first[:, 0], last[:, 0], blank,
                            np.zeros((len(xy_px), 2)), np.zeros((0, 2)), blank, 0.0, 0.0, 0.0)  # fmt: skip


def test_as_read_it_is_the_compensation_of_the_chain():
    """Both forms of (22), of the streaks of two frames at 2 deg/s."""
    case, rng = field.Case(np.radians(2.0), 12, 24), np.random.default_rng(1)
    frames = [flight.frame(pitch.SHUTTER, case, n, rng, flight.JOINT.sigma_px) for n in (0, 1)]
    one, two = (cluster.find(trackers.DETECT, trackers.MODEL, image) for image in frames)
    rows, shift_px = chain.fused(SETTINGS, one, two, frames[1].shape)
    assert len(rows) > 3
    for name, form in (("as read by us", "explicit"), ("(22) as printed", "implicit")):
        expected = chain.compensated(SETTINGS, TIMES, two, rows, shift_px, form).xy_px
        np.testing.assert_allclose(pitch.moved(TIMES, two, rows, shift_px, pitch.WAYS[name]), expected)
    expected = chain.compensated(SETTINGS, TIMES, two, rows, shift_px, longer_px=1.0).xy_px
    both_ends = pitch.moved(TIMES, two, rows, shift_px, pitch.WAYS["(7) with both end rows"])
    np.testing.assert_allclose(both_ends, expected)


def test_each_reading_moves_a_streak_as_its_words_say():
    """By hand, 400 rows above the middle row, 40 rows long: one that goes down and one that goes up."""
    above = 400.0
    two = clusters_of([[300.0, TIMES.middle_row - above]] * 2, [[0, 40]] * 2)
    shift_px, rows = np.array([[0.0, 39.0], [0.0, -39.0]]), np.arange(2)
    down, up = np.array([1.0, -1.0])
    exposure, line = TIMES.exposure_s, TIMES.line_s

    def vertical(name):
        return (pitch.moved(TIMES, two, rows, shift_px, pitch.WAYS[name]) - two.xy_px)[:, 1]

    seen_s = exposure + np.array([down, up]) * 40 * line
    np.testing.assert_allclose(vertical("as read by us"), [down, up] * (40 / seen_s) * above * line)
    np.testing.assert_allclose(
        vertical("(11) without dT"), np.array([down, up]) * 40 / exposure * above * line
    )
    swapped = exposure - np.array([down, up]) * 40 * line
    np.testing.assert_allclose(
        vertical("(11) with the sign of (3) as printed"), [down, up] * (40 / swapped) * above * line
    )
    longer_s = exposure + np.array([down, up]) * 41 * line
    np.testing.assert_allclose(
        vertical("(7) with both end rows"), [down, up] * (41 / longer_s) * above * line
    )
    np.testing.assert_allclose(
        vertical("instant five rows later"), [down, up] * (40 / seen_s) * (above + 5.0) * line
    )


def test_the_means_stand_beside_the_published_ones_and_are_not_judged():
    found = np.full((30, 4, len(pitch.WAYS)), np.nan)
    found[..., 0] = np.random.default_rng(2).normal(2.0, 0.1, (30, 4))
    rows = pitch.conclude([found])
    assert [row.published for row in rows] == [1.37, 3.06, 4.03, 4.62]
    for row in rows:
        assert abs(row.measured - 2.0) < 0.1 and row.ci95[0] < row.measured < row.ci95[1]
        assert row.verdict == pitch.Row("", "", None, 0.0).verdict and "30 attitudes" in row.condition
