"""Verdicts: what a sample may say, and what it leaves open."""

from math import inf, nan

import numpy as np
import pytest

from shefex_nav.papers import registry, rows
from shefex_nav.papers.engine import Outcome
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.shefex2 import end_to_end
from shefex_nav.papers.verdict import NO_FIGURE, POINTS, TOO_FEW_WORDS, Verdict, compare, judgement
from shefex_nav.report import intervals


def share(k, n, least):
    return judgement(k / n, intervals.proportion(k, n), "because", least=least, resolves=POINTS)


@pytest.mark.parametrize("k, n, least", [(0, 1, 0.3), (1, 1, 0.95), (0, 3, 0.3), (11, 12, 0.9), (5, 12, 0.3)])
def test_a_small_sample_leaves_open_what_its_interval_holds(k, n, least):
    """One failure is no proof of a small share, nor one success of a large one."""
    assert share(k, n, least) == (None, TOO_FEW_WORDS)


@pytest.mark.parametrize(
    "k, n, least, agrees",
    [
        (78, 520, 0.1571, False),  # the intervals of these reach across the criterion, but not far
        (468, 520, 0.8769, True),
        (200, 200, 0.995, True),
        (0, 40, 0.3, False),  # and these not at all
        (60, 60, 0.9, True),
        (3, 12, 0.8, False),
        (0, 1, -0.02, True),  # no share is below it
    ],
)
def test_a_sample_that_can_tell_does(k, n, least, agrees):
    assert share(k, n, least) == (agrees, "" if agrees else "because")


def test_a_range_is_left_open_on_both_sides():
    def of(measured, ci95):
        return judgement(measured, ci95, "because", least=0.75, most=1.25, resolves=0.25)[0]

    assert of(1.0, (0.9, 1.1)) is True and of(1.0, (0.7, 1.3)) is None
    assert of(1.2, (1.0, 1.4)) is True and of(1.3, (1.1, 1.5)) is False  # as narrow as the tolerance
    assert of(0.2, (0.0, 0.7)) is False and of(9.0, (2.0, 20.0)) is False  # wide, but all on one side
    assert of(1.0, (0.0, inf)) is None and of(1.0, (nan, nan)) is None and of(1.0, None) is None


def test_a_criterion_that_must_be_refuted():
    def of(ci95):
        return judgement(1.3, ci95, "because", most=1.1, resolves=0.3, refuted=True)[0]

    assert of((1.2, 1.4)) is False and of((1.05, 1.55)) is True and of((0.9, 1.9)) is None


def test_no_figure_is_no_verdict():
    assert judgement(nan, None, "because", most=1.0, resolves=1.0) == (None, NO_FIGURE)


def verdict_of(published, measured, ci95, n=100, **how):
    return compare(published, measured, ci95, n, **({"resolves": 0.2} | how)).verdict


def test_a_figure_is_reproduced_within_the_errors_of_both_and_the_rounding():
    of_paper = (0.96, 1.04)
    assert compare(1.0, 1.04, (1.01, 1.07), 100, resolves=0.2, of_paper=of_paper).tolerance == pytest.approx(
        0.05
    )
    assert verdict_of(1.0, 1.049, (1.019, 1.08), of_paper=of_paper) == Verdict.REPRODUCED
    assert verdict_of(1.0, 1.051, (1.021, 1.08), of_paper=of_paper) == Verdict.OPEN
    assert verdict_of(1.0, 1.051, (1.021, 1.08), of_paper=of_paper, rounding=0.005) == Verdict.REPRODUCED
    assert verdict_of(1.0, 1.04, (1.01, 1.07)) == Verdict.OPEN  # of the paper no error is known


@pytest.mark.parametrize(
    "better, high, low", [("more", "BETTER", "OPEN"), ("less", "OPEN", "BETTER"), ("", "OPEN", "OPEN")]
)
def test_both_directions_are_judged_and_better_is_a_class_of_its_own(better, high, low):
    assert verdict_of(1.0, 1.5, (1.4, 1.6), better=better) == Verdict[high]
    assert verdict_of(1.0, 0.5, (0.4, 0.6), better=better) == Verdict[low]


def test_an_interval_without_width_says_nothing_of_a_small_sample():
    assert verdict_of(1.0, 1.0, (1.0, 1.0), n=2) == Verdict.TOO_FEW
    assert verdict_of(1.0, 9.0, (9.0, 9.0), n=2) == Verdict.TOO_FEW
    assert verdict_of(1.0, 1.0, (1.0, 1.0), n=20) == Verdict.REPRODUCED
    assert verdict_of(1.0, 1.0, None) == verdict_of(1.0, nan, None) == Verdict.TOO_FEW


def test_a_wide_interval_judges_only_what_it_excludes():
    assert (
        verdict_of(1.0, 1.1, (0.5, 1.7)) == Verdict.TOO_FEW
        and verdict_of(1.0, 9.0, (5.0, 13.0)) == Verdict.OPEN
    )


def test_a_rare_event_that_did_not_occur_is_not_reproduced_by_few():
    def row(k, n, published=0.0075):
        return rows.published_share("wrong", "c", published, k, n, n_published=10000).verdict

    assert (
        row(0, 300) == Verdict.TOO_FEW
        and row(0, 10000) == Verdict.OPEN
        and row(74, 10000) == Verdict.REPRODUCED
    )
    assert row(300, 300, 1.0) == Verdict.TOO_FEW and row(10000, 10000, 1.0) == Verdict.REPRODUCED
    assert row(9, 10000, 0.0) == Verdict.OPEN


def test_inputs_calibrations_and_goals_are_not_reproductions():
    assert rows.given("stars", "c", 2023, 2023).verdict == Verdict.INPUT
    assert rows.given("stars", "c", 2023, 2022).verdict == Verdict.OPEN
    same, other = (rows.figure("q", "c", 1.0, x, (x - 0.1, x + 0.1), 50, resolves=0.2) for x in (1.0, 2.0))
    assert (
        rows.calibrated(same).verdict == Verdict.CALIBRATED and rows.calibrated(other).verdict == Verdict.OPEN
    )
    assert rows.goal("q", "c", None, 0.5, (0.4, 0.6), 50, most=1.0, resolves=0.1).verdict == Verdict.GOAL_MET
    assert (
        rows.goal("q", "c", None, 5.0, (4.0, 6.0), 50, most=1.0, resolves=0.1).verdict == Verdict.GOAL_MISSED
    )
    none = np.zeros(50, dtype=bool)
    assert rows.goal_none("q", "c", none).verdict == Verdict.GOAL_MET
    assert rows.goal_none("q", "c", none[:3]).verdict == Verdict.TOO_FEW
    one = np.array([True, False, False])
    assert rows.goal_none("q", "c", one).verdict == Verdict.GOAL_MISSED  # however few


def test_a_difference_is_explained_by_a_run_that_reaches_the_figure_and_by_no_other():
    def of(measured):
        return rows.figure("q", "c", 1.0, measured, (measured - 0.05, measured + 0.05), 50, resolves=0.2)

    done = rows.explained(of(0.5), of(1.02), "toy/wide", "with a wide one")
    assert done.verdict == Verdict.EXPLAINED and done.run == "toy/wide"
    assert done.why == "with a wide one, it is 1.02 (toy/wide)"  # the figure is that of the run
    assert rows.explained(of(0.5), of(0.8), "toy/wide", "w") == of(0.5)
    assert rows.explained(of(0.5), of(1.5), "toy/wide", "w") == of(0.5)
    assert rows.explained(of(0.5), of(1.5), "toy/wide", "w", passes=True).verdict == Verdict.EXPLAINED
    assert rows.explained(of(0.5), of(0.8), "toy/wide", "w", passes=True) == of(0.5)
    assert rows.explained(of(1.0), of(1.02), "toy/wide", "w") == of(1.0)  # nothing to explain
    assert rows.variant(of(1.02)) == Row("q", "c", 1.0, 1.02, of(1.02).ci95)


def test_differences_are_explained_across_experiments():
    def row(measured):
        return rows.figure("q", "c", 1.0, measured, (measured - 0.05, measured + 0.05), 50, resolves=0.2)

    ran = {
        "impa-images": Outcome([], [row(0.5)], 1, 1, 0.0),
        "impa-joint": Outcome([], [row(1.0)], 1, 1, 0.0),
    }
    made = rows.linked(ran)
    assert made["impa-images"].rows[0].run == "impa-joint" and made["impa-joint"] == ran["impa-joint"]
    alone = {"impa-images": ran["impa-images"]}
    assert rows.linked(alone) == alone
    assert set(rows.EXPLAINED_BY) | {other for other, _ in rows.EXPLAINED_BY.values()} <= set(
        registry.EXPERIMENTS
    )


def test_trials_of_one_cluster_are_no_independent_trials():
    """Half of 40 clusters of 6 alike: the interval is that of 40, and none of them is that of 40 as well."""
    which = np.repeat(np.arange(40) % 2 == 0, 6).reshape(40, 6)
    row = rows.share_together("wrong", "all rates", which)
    low, high = intervals.proportion(20, 40)
    assert row.measured == 0.5
    assert row.ci95[0] == pytest.approx(low, abs=0.01) and row.ci95[1] == pytest.approx(high, abs=0.01)
    none = rows.share_together("wrong", "all rates", np.zeros((40, 6), dtype=bool))
    assert none.ci95 == intervals.proportion(0, 40)
    assert rows.share_together("wrong", "all rates", which[:1]).ci95 is None
    goal = rows.goal_none("wrong", "all rates", np.zeros((40, 6), dtype=bool))
    assert goal.verdict == Verdict.GOAL_MET and goal.ci95 == pytest.approx((0.0, 240 * none.ci95[1]))


def test_frames_of_one_direction_are_not_a_sample():
    """Four directions of 50 frames, all solved: nobody knows of a fifth, and the row judges nothing."""
    results = [np.ones((50, 7), dtype=np.int64) for _ in range(4)]
    *stills, success, wrong = end_to_end.conclude_end_to_end(results)
    assert success.condition == "scenario night_sky, 4 directions" and success.measured == 1.0
    assert success.ci95 == intervals.proportion(4, 4) and success.verdict == Verdict.TOO_FEW
    assert wrong.ci95 == intervals.proportion(0, 4)
    assert stills[0].ci95 == intervals.proportion(200, 200)
