"""Containment, NEES and NIS over the runs: right covariances pass, wrong ones are found."""

import io

import keeping
import numpy as np
import pytest
import synthetic_campaign
from scipy import stats

from shefex_nav.campaign import over_time, parts
from shefex_nav.campaign.flight import Flown
from shefex_nav.campaign.results import open_campaign
from shefex_nav.campaign.store import Store
from shefex_nav.report import innovations, intervals


def series_of(folder, n=120, **options):
    return over_time.read(open_campaign(synthetic_campaign.write(folder, n, **options)))


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    return series_of(tmp_path_factory.mktemp("right") / "c", seed=4)


@pytest.fixture(scope="module")
def too_small(tmp_path_factory):
    """Errors 1.3 times as large as the covariance says."""
    return series_of(tmp_path_factory.mktemp("wrong") / "c", seed=4, truth_over_sigma=1.3)


def test_epochs_of_all_runs_coincide(right):
    assert right.errors.shape == (120, synthetic_campaign.T, 5, 3)
    assert right.t_s[0] == -3.0 and np.allclose(np.diff(right.t_s), synthetic_campaign.STEP_S)
    assert np.isfinite(right.errors).all() and not (right.phase < 0).any()


def test_runs_of_different_length_are_put_at_their_times(tmp_path):
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "c", 3))
    kept = campaign.series(1)
    late = io.BytesIO()
    np.savez_compressed(late, **{name: values[5:30] for name, values in kept.items()})
    with Store(campaign.folder) as store:
        store.keep(Flown(campaign.record(1), late.getvalue()))
    series = over_time.read(campaign)
    assert len(series.t_s) == synthetic_campaign.T
    assert np.isnan(series.errors[1, :5]).all() and np.isnan(series.errors[1, 30:]).all()
    assert np.allclose(series.errors[1, 5:30, 2], kept["position_error_i"][5:30])
    assert over_time.contained(series).runs.tolist() == [2] * 5 + [3] * 25 + [2] * 10
    assert over_time.anees(series).dof[0] == 6
    assert series.nis_dof["gps"].sum(axis=0).tolist() == [12.0] * 5 + [18.0] * 25 + [12.0] * 10


def test_bounds_are_those_of_scipy(right):
    found = over_time.contained(right)
    p = stats.chi2.cdf(9.0, 1)
    assert found.low[0] == stats.binom.ppf(0.005, 120, p) / 120 and found.high[0] == 1.0
    found = over_time.anees(right)
    assert (found.low[3], found.high[3]) == pytest.approx(stats.chi2.ppf([0.025, 0.975], 360) / 360)


def test_a_right_covariance_passes(right):
    assert all(one.good for one in over_time.judge_containment(right))
    assert all(one.good for one in over_time.judge_nees(right))
    assert all(one.good for one in over_time.judge_nis(right))
    for block, (value, low, high) in over_time.time_averages(right).items():
        assert low <= 1.0 <= high and low < value < high, block
    anees, share = over_time.anees(right), over_time.contained(right).share
    inside = (anees.mean >= anees.low[:, None]) & (anees.mean <= anees.high[:, None])
    assert inside.mean() > 0.9  # 95 % of correlated epochs
    assert share.mean() == pytest.approx(0.9973, abs=0.0015)


def test_a_covariance_that_is_too_small_is_found(too_small):
    verdicts = [
        *over_time.judge_nees(too_small), *over_time.judge_nis(too_small)
    ]  # fmt: skip
    assert not any(one.good for one in verdicts)
    assert verdicts[0].value == pytest.approx(1.69, rel=0.2) and verdicts[0].value > verdicts[0].high
    contained = over_time.judge_containment(too_small)
    # P(inside) is 0.979: at 120 runs some axes still pass, all together do not
    assert sum(not one.good for one in contained) >= 3
    for value, low, _ in over_time.time_averages(too_small).values():
        assert low > 1.0 and value == pytest.approx(1.69, rel=0.1)


def test_a_covariance_that_is_too_large_is_found(tmp_path):
    careful = series_of(tmp_path / "c", seed=5, truth_over_sigma=0.75)
    assert not any(one.good for one in over_time.judge_nees(careful))
    assert all(one.good for one in over_time.judge_containment(careful))  # nothing is outside 3 sigma


def test_chance_alone_seldom_fails_anything():
    # 200 campaigns of 40 runs that are right: a judgement of five blocks fails 5 % of them, not more
    rng = np.random.default_rng(10)
    bad = 0
    for _ in range(200):
        z = rng.standard_normal((40, 1, 5, 3))
        series = over_time.Series(
            np.arange(40), np.zeros(1), z, np.ones_like(z), (z**2).sum(axis=3), np.full((40, 1), 2), {}, {}
        )
        bad += not all(one.good for one in over_time.judge_nees(series))
    assert stats.binomtest(bad, 200, 0.05, alternative="greater").pvalue > 1e-3, bad


def test_an_error_beside_a_sigma_of_zero_is_outside():
    z, sigma = np.full((40, 1, 5, 3), 0.1), np.ones((40, 1, 5, 3))
    sigma[:, :, 0, 0] = 0.0
    phase = np.full((40, 1), 2)
    series = over_time.Series(np.arange(40), np.zeros(1), z, sigma, (z**2).sum(axis=3), phase, {}, {})
    shares = [one.value for one in over_time.judge_containment(series)]
    assert shares == [0.0] + 14 * [1.0]


def test_each_run_is_judged_at_its_own_end_of_a_phase():
    z = np.zeros((2, 6, 5, 3))
    z[0, 2], z[1, 4], z[1, 2] = 7.0, 2.0, 9.0  # boost ends at epoch 2 of the first run, at 4 of the other
    phase = np.array([[1, 1, 1, 2, 2, 2], [1, 1, 1, 1, 1, 2]])
    series = over_time.Series(
        np.arange(2), np.arange(6.0), z, np.ones_like(z), (z**2).sum(axis=3), phase, {}, {}
    )
    ends = over_time.last_epochs(series)
    assert [end.tolist() for end in ends[1]] == [[0, 1], [2, 4]]
    assert [end.tolist() for end in ends[2]] == [[0, 1], [5, 5]]
    boost = [one for one in over_time.judge_containment(series) if "boost" in one.what]
    assert len(boost) == 15 and {one.value for one in boost} == {0.5}


def test_holm_by_hand():
    # sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1, never falling: 0.02, 0.03, 0.06, 0.06
    assert over_time.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert over_time.holm([0.9, 0.8]).tolist() == [1.0, 1.0]


def made_up_nis(sums, dof, sensor="gps"):
    """Series with nothing but NIS. (R, T), (R, T)"""
    z = np.zeros((len(sums), sums.shape[1], 5, 3))
    nis = {sensor: np.asarray(sums, float)}, {sensor: np.asarray(dof, float)}
    phase = np.full(sums.shape, 2)
    return over_time.Series(np.arange(len(sums)), np.arange(sums.shape[1]), z, z, z[..., 0], phase, *nis)


def test_nis_is_judged_over_runs_and_by_what_matters():
    """300 runs of 1500 degrees of freedom each: chi-square of all of them would see a fault of 0.5 %."""
    rng = np.random.default_rng(20)
    dof = np.full((300, 5), 300.0)
    squares = rng.chisquare(dof)
    for factor, good in ((1.0, True), (1.03, True), (0.95, True), (1.2, False), (0.8, False)):
        (one,) = over_time.judge_nis(made_up_nis(factor * squares, dof))
        assert one.good is good and one.value == pytest.approx(factor, rel=0.01)
    # what the innovations of a run have in common: each run's own scale, 1 on the average
    scale = rng.gamma(4.0, 0.25, (12, 1))
    few = made_up_nis(scale / scale.mean() * 1.15 * squares[:12], dof[:12])
    (one,) = over_time.judge_nis(few)
    assert one.good and one.p == pytest.approx(
        stats.ttest_1samp(few.nis_sum["gps"].sum(axis=1) / 1500.0, 1.0).pvalue
    )
    pooled = few.nis_sum["gps"].sum()
    assert stats.chi2.sf(pooled, 12 * 1500) < 1e-10
    (alone,) = over_time.judge_nis(made_up_nis(1.3 * squares[:1], dof[:1]))
    assert not alone.good and alone.samples == 1


@pytest.mark.parametrize(("runs", "each"), [(3, 1), (5, 1), (10, 1), (5, 3)])
def test_few_innovations_a_run_are_called_wrong_no_more_often_than_said(runs, each):
    """Of three sensors with right sigmas; means of one square are so skew that Student calls 28 % wrong."""
    rng, tries, wrong = np.random.default_rng(22), 300, 0
    dof = np.ones((runs, each))
    for _ in range(tries):
        series = made_up_nis(rng.chisquare(dof), dof, "a")
        series.nis_sum.update(b=rng.chisquare(dof), c=rng.chisquare(dof))
        series.nis_dof.update(b=dof, c=dof)
        wrong += any(not one.good for one in over_time.judge_nis(series))
    assert intervals.proportion(wrong, tries)[0] <= over_time.SIGNIFICANT, wrong / tries


def test_nis_is_never_surer_than_chi_square():
    sums, dof = np.array([[3.0], [3.0], [3.1]]), np.full((3, 1), 3.0)  # their scatter is small by chance
    (one,) = over_time.judge_nis(made_up_nis(sums, dof))
    low, high = stats.chi2.ppf([0.025, 0.975], 9) / 9.0
    assert one.good and one.p == pytest.approx(2.0 * stats.chi2.sf(9.1, 9), rel=0.2)
    assert one.low <= low and one.high == pytest.approx(high)


def test_nis_below_1_is_right_where_errors_last():
    """Of right sigmas: half of the variance is one error of the run, which the filter knows after a while."""
    dof = np.full((40, 5), 300.0)
    squares = np.random.default_rng(21).chisquare(dof)
    for factor, good in ((0.3, True), (1.2, False)):
        (one,) = over_time.judge_nis(made_up_nis(factor * squares, dof, "barometer"))
        assert one.good is good and one.low == 0.0
    (alone,) = over_time.judge_nis(made_up_nis(0.3 * squares[:1], dof[:1], "magnetometer"))
    assert alone.good
    fixes = made_up_nis(0.3 * squares, dof, "gps_position")
    for lasting, good in ((innovations.FIXES, True), ((), False)):  # of `gps.errors`
        (one,) = over_time.judge_nis(fixes, lasting)
        assert one.good is good


@pytest.mark.parametrize(
    ("factor", "words", "shown"),
    [
        (1.0, "as chance would have it", None),
        (1.05, "1 of 1 off by less than 10 %", "off by less than 10 %"),
        (0.95, "1 of 1 off by less than 10 %", "off by less than 10 %"),
        (1.2, "1 of 1 are not as they should be", "covariance too small"),
        (0.8, "1 of 1 are not as they should be", "covariance too large"),
    ],
)
def test_what_chance_excludes_is_not_called_chance(tmp_path, factor, words, shown):
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "c", 3))
    dof = np.full((300, 5), 300.0)
    squares = np.random.default_rng(21).chisquare(dof)
    series = made_up_nis(factor * squares, dof)
    rows = parts.covariance(campaign, series._replace(sigmas=series.sigmas + 1.0)).rows
    (k,) = [k for k, row in enumerate(rows) if row[0] == "NIS of the sensors"]
    assert rows[k][-1] == words
    below = rows[k + 1] if k + 1 < len(rows) else ("",)
    if shown is None:
        assert not below[0].startswith("  NIS")
    else:
        assert below[0] == "  NIS of gps, mean of the runs" and below[-1] == shown
        assert below[1] == f"{squares.sum() / dof.sum() * factor:.3f}" and float(below[3]) < 1e-9


def test_series_that_are_missing_or_spoilt_are_left_out_and_counted(tmp_path):
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "c", 6))
    keeping.say(campaign.folder, "DELETE FROM series WHERE run = 0")
    keeping.spoil(campaign.folder, 2)
    whole = keeping.content(campaign.folder, 3)
    keeping.spoil(campaign.folder, 3, whole[: len(whole) // 2])
    with Store(campaign.folder) as store:  # as if it had been written so
        store.keep(Flown(campaign.record(4), whole[: len(whole) // 2]))
    series = over_time.read(campaign)
    assert series.runs.tolist() == [1, 5] and series.unread == 4
    assert series.errors.shape[0] == series.nis_sum["gps"].shape[0] == 2
    assert np.allclose(series.errors[1, :, 2], campaign.series(5)["position_error_i"], rtol=1e-6)
    assert "4 runs have no series" in parts.covariance(campaign, series).lines[0]
    with pytest.raises(
        KeyError, match=r"the series of run 2 are spoilt; `shefex-nav repeat \S+ 2 --keep` flies"
    ):
        campaign.series(2)
    with pytest.raises(KeyError, match="the series of run 4 cannot be read"):
        campaign.series(4)
    with pytest.raises(KeyError, match="the series of run 0 were deleted"):
        campaign.series(0)
    keeping.without_series(campaign.folder)
    assert over_time.read(campaign) is None
    (said,) = [part for part in parts.parts(campaign, None) if part.title == parts.DESCRIBED]
    assert said.lines == ("All 6 runs have no series that could be read: nothing is said of it.",)


def test_no_more_series_are_read_than_memory_is_for(tmp_path):
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "c", 6))
    room_for_two = 2.5 * synthetic_campaign.T * over_time.BYTES_OF_EPOCH
    series = over_time.read(campaign, most_bytes=room_for_two)
    assert series.runs.tolist() == [0, 1] and series.unread == 0
    held = sum(one.nbytes for one in (series.errors, series.sigmas, series.nees, series.phase))
    assert held <= room_for_two
