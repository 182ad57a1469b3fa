"""Statistics of a campaign whose answers are known, and how often their intervals hold the truth."""

import keeping
import numpy as np
import pytest
import synthetic_campaign
from scipy import stats

from shefex_nav.campaign import convergence, parts, statistics
from shefex_nav.campaign.results import open_campaign
from shefex_nav.report import intervals

N = 400


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "known"
    return open_campaign(synthetic_campaign.write(folder, N, seed=3, breaks=True, with_series=False))


def success(campaign, name):
    return next(one for one in statistics.successes(campaign) if one.name == name)


def test_success_is_counted_over_succeeded_runs_and_has_scipy_s_interval(campaign):
    one = success(campaign, "attitude_at_entry")
    flew = int(campaign.succeeded.sum())
    assert one.of == flew < N  # failed runs are neither passed nor judged
    worst = np.abs(
        [campaign.numbers(f"summary.navigation.at_entry.attitude_error_deg.{k}") for k in range(3)]
    )
    assert one.passed == int((worst[:, campaign.succeeded].max(axis=0) <= one.limit).sum())
    exact = stats.binomtest(one.passed, one.of).proportion_ci(0.95, method="exact")
    assert one.ci95 == pytest.approx((exact.low, exact.high), rel=1e-9)


def test_known_probabilities_lie_in_the_intervals(campaign):
    # attitude: three normal errors of 0.05 deg within 0.17 deg, of which x is cut at heavy masses, which is
    # a change far below the interval; star fixes: at least 950 of 1000 at 97 %
    limit = success(campaign, "attitude_at_entry").limit / synthetic_campaign.ATTITUDE_SIGMA_DEG
    within = (stats.norm.cdf(limit) - stats.norm.cdf(-limit)) ** 3
    solved = stats.binom.sf(949, synthetic_campaign.FRAMES, synthetic_campaign.AVAILABILITY)
    for name, truth in (("attitude_at_entry", within), ("star_fixes", solved), ("wrong_star_fixes", 1.0)):
        low, high = success(campaign, name).ci95
        assert low <= truth <= high, name


def test_a_run_without_the_figure_has_not_passed(campaign, tmp_path):
    folder = synthetic_campaign.write(tmp_path / "gaps", 10, with_series=False)
    keeping.change(folder, 4, lambda record: record["summary"]["navigation"].update(at_entry=None))
    one = success(open_campaign(folder), "position_at_entry")
    assert (one.passed, one.of, one.without) == (9, 10, 1)


def test_requirements_are_named_when_every_run_failed(tmp_path):
    folder = synthetic_campaign.write(tmp_path / "none", 2, with_series=False)
    for run in range(2):
        keeping.change(folder, run, lambda record: record.update(status="failed", summary={}))
    one = success(open_campaign(folder), "position_at_entry")
    assert (one.passed, one.of, one.ci95) == (0, 0, None)


def test_percentiles_of_a_known_distribution(campaign):
    found = next(one for one in statistics.errors(campaign) if one.name == "attitude y at entry")
    for one in found.percentiles:
        truth = synthetic_campaign.ATTITUDE_SIGMA_DEG * stats.halfnorm.ppf(one.percent / 100.0)
        assert one.low <= truth and (one.high is None or truth <= one.high), one
    y = np.abs(campaign.numbers("summary.navigation.at_entry.attitude_error_deg.1"))
    assert found.worst == np.nanmax(y) and found.worst_run == int(np.nanargmax(y))


def test_a_percentile_beyond_the_sample_has_no_upper_end():
    one = statistics.percentile(np.arange(100.0), 99.0)
    assert one.low is not None and one.high is None
    assert 0.99 ** intervals.values_needed(99.0) <= 0.025
    assert statistics.percentile(np.arange(float(intervals.values_needed(99.0))), 99.0).high is not None


def test_percentile_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    tries, truth = 1500, stats.halfnorm.ppf(0.95)
    inside = 0
    for _ in range(tries):
        one = statistics.percentile(np.abs(rng.standard_normal(200)), 95.0)
        inside += one.low <= truth <= one.high
    assert stats.binomtest(inside, tries, 0.95, alternative="less").pvalue > 1e-4
    assert inside / tries < 0.985


def test_availability_and_wrong_fixes(campaign):
    found = statistics.star_fixes(campaign)
    n = int(campaign.succeeded.sum())
    assert found.availability.low <= synthetic_campaign.AVAILABILITY <= found.availability.high
    assert found.availability.whole == n * synthetic_campaign.FRAMES
    assert found.wrong == 0 and found.most_wrong_runs == pytest.approx(1.0 - 0.05 ** (1.0 / n))
    assert found.most_wrong_runs == pytest.approx(3.0 / n, rel=0.01)  # the rule of three
    fixes = found.availability.part + n * synthetic_campaign.OUTSIDE
    assert found.most_wrong_fixes == pytest.approx(3.0 / fixes, rel=0.002)
    assert found.most_gaps == 1.0  # every run has a frame that was not solved


def test_wrong_fixes_outside_the_window_and_a_window_without_gaps(campaign, monkeypatch):
    """More wrong fixes than frames of the window are no contradiction; that none is missing has a bound."""
    n = int(campaign.succeeded.sum())
    other = {"solved": 3, "in_window": 3, "fixes": 50, "wrong": 4}
    columns = {f"summary.star_tracker.{name}": np.full(len(campaign), value) for name, value in other.items()}
    monkeypatch.setattr(campaign, "columns", dict(campaign.columns) | columns)
    found = statistics.star_fixes(campaign)
    assert found.wrong == 4 * n
    most = stats.beta.ppf(0.95, 4 * n + 1, 50 * n - 4 * n)  # Clopper & Pearson, one-sided
    assert found.most_wrong_fixes == pytest.approx(most)
    assert found.availability.low is None and found.most_gaps == pytest.approx(1.0 - 0.05 ** (1.0 / n))


def test_wrong_fixes_of_one_run_come_together(campaign, monkeypatch):
    """Runs that go wrong have a hundred wrong fixes: as if each were by itself the bound held 60 %."""
    rng, n, held, tries = np.random.default_rng(7), len(campaign), 0, 300
    for _ in range(tries):
        wrong = 100.0 * (rng.random(n) < 4.0 / n)
        other = {"solved": 900.0, "in_window": 900.0, "fixes": 1000.0, "wrong": wrong}
        columns = {f"summary.star_tracker.{name}": value + np.zeros(n) for name, value in other.items()}
        monkeypatch.setattr(campaign, "columns", dict(campaign.columns) | columns)
        found = statistics.star_fixes(campaign)
        held += found.most_wrong_fixes >= 0.1 * 4.0 / n or not found.wrong
    assert stats.binomtest(held, tries, 0.95, alternative="less").pvalue > 1e-3


def test_the_interval_of_a_share_knows_that_frames_of_a_run_belong_together():
    # availability of each run drawn from 90 to 100 %: the pooled share scatters far more than frames alone
    rng = np.random.default_rng(6)
    tries, inside, widths = 1000, 0, []
    for _ in range(tries):
        wholes = rng.integers(500, 1500, 60)
        parts = rng.binomial(wholes, rng.uniform(0.9, 1.0, 60))
        one = statistics.pooled(parts.astype(float), wholes.astype(float))
        inside += one.low <= 0.95 <= one.high
        widths.append(one.high - one.low)
    assert 0.92 < inside / tries < 0.975
    frames_alone = 2.0 * 1.96 * np.sqrt(0.95 * 0.05 / 60_000)
    assert np.mean(widths) > 3.0 * frames_alone


def test_the_ellipse_of_a_known_dispersion(campaign):
    (one,) = statistics.ellipses(campaign)  # no run of this campaign comes to entry
    assert one.what == "apogee" and one.samples == int(campaign.succeeded.sum())
    assert one.altitude_km == pytest.approx(177.0, abs=0.05)
    scale = np.sqrt(stats.chi2.ppf(0.95, 2))
    # the sigma of n normal values scatters by 1/sqrt(2 n): 3.5 %; four of them
    assert one.semi_axes_km[0] == pytest.approx(scale * synthetic_campaign.NORTH_KM, rel=0.15)
    assert one.semi_axes_km[1] == pytest.approx(scale * synthetic_campaign.EAST_KM, rel=0.15)
    assert one.azimuth_deg == pytest.approx(synthetic_campaign.TURN_DEG, abs=4.0)
    assert stats.binomtest(one.inside, one.samples, 0.95).pvalue > 1e-3
    assert abs(one.offsets_km.mean(axis=0)).max() < 1e-9
    assert one.shape.normal


def test_a_dispersion_in_two_clusters_is_called_not_normal(campaign, monkeypatch):
    rows = parts.flights(campaign).rows
    assert "not normal" not in dict(rows)["95 % ellipse at apogee"]
    place = "summary.flight.at_apogee.latitude_deg"
    held = campaign.numbers
    monkeypatch.setattr(
        campaign, "numbers", lambda name: held(name) + (name == place) * (np.arange(len(campaign)) % 5 == 0)
    )
    (one,) = statistics.ellipses(campaign)
    assert not one.shape.normal
    assert "not normal (skewness" in dict(parts.flights(campaign).rows)["95 % ellipse at apogee"]


def test_the_ellipse_of_few_runs_holds_the_next_one_as_often_as_it_says():
    rng = np.random.default_rng(7)
    n, tries, inside = 8, 1500, 0
    for _ in range(tries):
        offsets = rng.standard_normal((n + 1, 2)) * (2.0, 1.0)
        axes = offsets[:n] / 6371.0  # plain enough at the equator, where a degree is the same both ways
        places = np.column_stack([np.degrees(axes), np.full(n, 100.0)])
        one = statistics.ellipse("entry", places)
        km_per_deg = (one.offsets_km[1, :2] - one.offsets_km[0, :2]) / (places[1, :2] - places[0, :2])
        nxt = (np.degrees(offsets[n] / 6371.0) - places[:, :2].mean(axis=0)) * km_per_deg
        turn = np.radians(one.azimuth_deg)
        along, across = nxt @ (np.cos(turn), np.sin(turn)), nxt @ (-np.sin(turn), np.cos(turn))
        inside += (along / one.semi_axes_km[0]) ** 2 + (across / one.semi_axes_km[1]) ** 2 <= 1.0
    assert stats.binomtest(inside, tries, 0.95).pvalue > 1e-3, inside / tries


@pytest.mark.parametrize("n", [statistics.FEWEST - 1, statistics.FEWEST])
def test_few_runs_have_no_ellipse(n, tmp_path):
    """Of 3 runs it is 13 times as long as of many, of 8 half as long again: 2 (n^2 - 1) / (n (n - 2)) F."""
    campaign = open_campaign(synthetic_campaign.write(tmp_path / "few", n, with_series=False))
    assert len(statistics.ellipses(campaign)) == (n == statistics.FEWEST)
    longer = [
        np.sqrt(2.0 * (k * k - 1.0) / (k * (k - 2.0)) * stats.f.ppf(0.95, 2, k - 2) / stats.chi2.ppf(0.95, 2))
        for k in (3, 8)
    ]
    assert longer == pytest.approx([13.3, 1.5], rel=0.01)


def test_one_flight_has_no_dispersion():
    assert statistics.ellipse("apogee", np.tile([71.0, 15.0, 177.0], (9, 1))) is None


def test_runs_still_needed_for_a_rate_are_the_fewest_that_do():
    found = convergence.needed_for_rate(95, 100, 0.01)
    assert found.half_width == pytest.approx(np.diff(intervals.proportion(95, 100))[0] / 2.0)
    low, high = intervals.proportion(round(0.95 * found.total), found.total)
    assert 0.5 * (high - low) <= 0.01
    normal = 1.96**2 * 0.95 * 0.05 / 0.01**2  # 1825, to which the exact interval adds about 1/(2 x 0.01)
    assert normal < found.total < normal + 120
    assert found.still == found.total - 100
    assert convergence.needed_for_rate(9500, 10_000, 0.01).still == 0


def test_runs_still_needed_for_a_percentile_give_that_precision():
    rng = np.random.default_rng(8)
    wanted, widths = 0.1, []
    first = statistics.percentile(np.abs(rng.standard_normal(400)), 95.0)
    asked = convergence.needed_for_percentile(first, 400, wanted)
    assert asked.still > 0
    for _ in range(50):
        one = statistics.percentile(np.abs(rng.standard_normal(asked.total)), 95.0)
        widths.append(0.5 * (one.high - one.low))
    assert np.mean(widths) == pytest.approx(
        wanted, rel=0.35
    )  # the width itself is estimated, from 400 values
    few = convergence.needed_for_percentile(statistics.percentile(np.arange(50.0), 99.0), 50, 1.0)
    assert few.half_width == np.inf and few.total == intervals.values_needed(99.0) and few.still > 300


def test_courses_end_at_the_estimate_and_narrow():
    rng = np.random.default_rng(9)
    passed = rng.uniform(size=1000) < 0.9
    course = convergence.success_course(passed)
    assert course.n[0] == 1 and course.n[-1] == 1000 and course.value[-1] == passed.mean()
    assert (course.low[-1], course.high[-1]) == pytest.approx(intervals.proportion(int(passed.sum()), 1000))
    assert course.high[-1] - course.low[-1] < 0.1 * (course.high[0] - course.low[0])
    values = rng.exponential(size=500)
    course = convergence.percentile_course(values, 95.0)
    assert course.value[-1] == pytest.approx(np.percentile(values, 95.0))
    assert np.isnan(course.high[0]) and np.isfinite(course.high[-1])
    with pytest.raises(ValueError):
        convergence.needed_for_rate(1, 2, 0.0)


def test_places_all_over_the_earth_have_no_ellipse():
    """Orbits whose node is dispersed by 20 deg: the mean of the places lay 100 km below each of them."""
    rng = np.random.default_rng(3)
    longitude = rng.uniform(-20.0, 20.0, 30)
    wide = np.column_stack([rng.normal(50.0, 1.0, 30), longitude, np.full(30, 550.0)])
    assert statistics.ellipse("apogee", wide) is None
    near = wide * [1.0, 0.02, 1.0]
    assert statistics.ellipse("apogee", near).altitude_km == pytest.approx(550.0, abs=2.0)
