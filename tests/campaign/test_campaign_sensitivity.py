"""What explains the results of a campaign in which it is known."""

from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_campaign
from scipy import stats

from shefex_nav.campaign import parts, sensitivity, spearman
from shefex_nav.campaign.results import open_campaign
from shefex_nav.report import intervals

MASS, ELEVATION = "vehicle.payload.mass", "launch.elevation"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "known"
    return open_campaign(synthetic_campaign.write(folder, 500, seed=11, with_series=False))


@pytest.fixture(scope="module")
def ranks(campaign):
    return sensitivity.ranks(sensitivity.outcomes(campaign), sensitivity.features(campaign.draws))


def test_rank_correlations_are_scipy_s_and_the_known_ones(campaign, ranks):
    one = next(r for r in ranks if r.outcome == "attitude x at entry" and r.feature == MASS)
    x, y = campaign.draws[MASS], campaign.numbers("summary.navigation.at_entry.attitude_error_deg.0")
    rho, p = stats.spearmanr(x, y)
    assert (one.rho, one.p) == pytest.approx((rho, p))
    truth = 6.0 / np.pi * np.arcsin(0.5 * synthetic_campaign.CORRELATION)  # of Pearson's, if both are normal
    assert one.rho == pytest.approx(truth, abs=3.0 * (1.0 - truth**2) * 1.06 / np.sqrt(500))
    assert one.p_holm < 1e-10


def test_what_explains_is_found_and_nothing_else(ranks):
    significant = {(r.outcome, r.feature) for r in ranks if r.p_holm < 0.05}
    expected = {
        ("attitude x at entry", MASS),
        ("position at entry, size", f"|{ELEVATION}|"),  # to both sides, which the draw itself does not show
        ("position, rms of the run", f"|{ELEVATION}|"),
        ("apogee", MASS),
    }
    # the size of the attitude error hardly depends on mass, to both sides: found or not, both are right
    assert significant - {("attitude at entry, size", f"|{MASS}|")} == expected


def test_regression_finds_the_known_coefficient(campaign):
    found = {
        one.outcome: one for one in sensitivity.regressions(sensitivity.outcomes(campaign), campaign.draws)
    }
    one = found["attitude x at entry"]
    first = one.effects[0]
    assert first.feature == MASS and first.low <= synthetic_campaign.CORRELATION <= first.high
    assert one.r2_low <= synthetic_campaign.CORRELATION**2 <= one.r2_high
    assert one.samples == 500 and len(one.effects) == len(sensitivity.features(campaign.draws))
    assert found["apogee"].r2 == pytest.approx(1.0) and found["apogee"].effects[0].value == pytest.approx(1.0)
    assert found["attitude z at entry"].r2 < 0.03


def test_coefficients_are_those_of_least_squares(campaign):
    features = sensitivity.features(campaign.draws)
    y = campaign.numbers("summary.navigation.at_entry.attitude_error_deg.0")
    one = sensitivity.regress("x", y, features)
    x = np.column_stack([np.ones(500), *[stats.zscore(feature.values) for feature in features]])
    beta = np.linalg.lstsq(x, stats.zscore(y), rcond=None)[0][1:]
    found = {effect.feature: effect.value for effect in one.effects}
    assert [found[feature.name] for feature in features] == pytest.approx(beta, abs=1e-9)
    residual = stats.zscore(y) - x[:, 1:] @ beta
    assert one.r2 == pytest.approx(1.0 - residual.var() * 499.0 / (499.0 - len(features)))  # adjusted


@pytest.mark.slow
def test_regression_intervals_hold_the_truth_as_often_as_they_say():
    # b1 = 0.6, b2 = 0.3, R^2 = 0.45; the noise grows with the third draw, which ordinary intervals ignore
    rng = np.random.default_rng(12)
    tries, n = 800, 150
    held = np.zeros(3)
    for _ in range(tries):
        x = rng.standard_normal((n, 2))
        size = rng.uniform(0.5, 1.5, n)
        noise = rng.standard_normal(n) * size / np.sqrt(13.0 / 12.0)
        y = 0.6 * x[:, 0] + 0.3 * x[:, 1] + np.sqrt(0.55) * noise
        features = [sensitivity.Feature(name, v) for name, v in zip("abc", (*x.T, size), strict=True)]
        one = sensitivity.regress("y", y, features)
        effects = {effect.feature: effect for effect in one.effects}
        held += (
            effects["a"].low <= 0.6 <= effects["a"].high,
            effects["b"].low <= 0.3 <= effects["b"].high,
            one.r2_low <= 0.45 <= one.r2_high,
        )
    assert (held / tries > 0.92).all() and (held / tries < 0.98).all(), held / tries


LEAST = sensitivity.RUNS_PER_FEATURE


@pytest.mark.parametrize(("m", "n"), [(1, 10), (1, 20), (4, 25)])
def test_intervals_of_coefficients_hold_the_truth_with_the_fewest_runs(m, n):
    rng, tries, held = np.random.default_rng(13), 600, 0
    for _ in range(tries):
        x = rng.standard_normal((n, m))
        y = x[:, 0] + rng.standard_normal(n)
        given = [sensitivity.Feature(str(k), column) for k, column in enumerate(x.T)]
        (one,) = (one for one in sensitivity.regress("y", y, given).effects if one.feature == "0")
        held += one.low <= np.sqrt(0.5) <= one.high
    assert intervals.proportion(held, tries, 0.99)[1] >= 0.95, held / tries


@pytest.mark.parametrize("m, tails", [(1, "normal"), (10, "normal"), (40, "normal"), (40, "heavy")])
@pytest.mark.parametrize("r2", [0.083, 0.6])
def test_r2_and_its_interval_are_of_the_truth_however_many_draws_there_are(m, tails, r2):
    """At the fewest runs that are regressed: draws that are normal, uniform, distances and words."""
    tries, n = 300, max(LEAST * (m + 1), sensitivity.FEWEST)
    rng = np.random.default_rng([16, m, round(100 * r2)])
    few = min(m, 3)
    held, values = 0, []
    for _ in range(tries):
        x = rng.standard_normal((n, m))
        x[:, 1::4] = (np.abs(x[:, 1::4]) - np.sqrt(2.0 / np.pi)) / np.sqrt(1.0 - 2.0 / np.pi)
        x[:, 2::4] = rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), x[:, 2::4].shape)
        x[:, 3::4] = ((rng.random(x[:, 3::4].shape) < 0.2) - 0.2) / 0.4
        noise = rng.standard_normal(n) if tails == "normal" else rng.standard_t(6, n) / np.sqrt(1.5)
        y = x[:, :few].sum(axis=1) * np.sqrt(r2 / few) + np.sqrt(1.0 - r2) * noise
        one = sensitivity.regress("y", y, [sensitivity.Feature(str(k), v) for k, v in enumerate(x.T)])
        assert one.samples == n and one.r2_low <= one.r2 <= one.r2_high
        held += one.r2_low <= r2 <= one.r2_high
        values.append(one.r2)
    high = intervals.proportion(held, tries, 0.99)[1]
    assert high >= 0.95 and held / tries > 0.92, held / tries
    if m > 1:  # unlike the fit itself, for which 0.083 is 0.26 with 40 draws
        assert np.mean(values) == pytest.approx(r2, abs=0.03)


def test_everything_or_nothing_explained_is_said():
    x = np.random.default_rng(17).standard_normal((2, 60))
    features = [sensitivity.Feature("a", x[0])]
    one = sensitivity.regress("y", 3.0 * x[0] + 1.0, features)
    assert (one.r2, one.r2_low, one.r2_high) == (1.0, 1.0, 1.0)
    one = sensitivity.regress("y", x[1] - x[0] * (x[0] @ x[1]) / (x[0] @ x[0]), features)
    assert one.r2 == one.r2_low == 0.0 and one.r2_high < 0.1
    nearly = sensitivity.regress("y", x[0] + 1e-3 * x[1], features)
    assert 0.9999 < nearly.r2_low < nearly.r2 < nearly.r2_high < 1.0


def test_table_and_picture_print_the_same_r2(campaign):
    part, figure = parts.explained(campaign), campaign.plot.sensitivity()
    pictures = dict(axes.get_title("left").split(": R² ") for axes in figure.axes)
    tables = {row[0]: row[-1] for row in part.rows}
    common = set(pictures) & set(tables)
    assert len(common) > 2 and all(pictures[name] == tables[name] for name in common)
    for words in pictures.values():
        value, low, _, high = words.replace("(", "").replace(")", "").split()
        assert float(low) <= float(value) <= float(high)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "n", [sensitivity.FEWEST, pytest.param(10, marks=SLOW), pytest.param(12, marks=SLOW), 15]
)
@pytest.mark.slow
def test_noise_is_certain_in_no_more_than_5_per_cent_of_small_campaigns(n):
    """35 draws, most with their distances, and 10 results without any connection, one of them a count."""
    rng = np.random.default_rng([18, n])
    tries, wrong = 120, 0
    for _ in range(tries):
        draws = {f"d{k}": rng.standard_normal(n) for k in range(33)}
        draws |= {f"w{k}": np.array(list("aab"), dtype=object)[rng.integers(0, 3, n)] for k in range(2)}
        found = {f"o{k}": rng.standard_normal(n) for k in range(9)}
        found["count"] = 100.0 - rng.poisson(1.0, n)
        wrong += sensitivity.ranks(found, sensitivity.features(draws))[0].p_holm < sensitivity.SIGNIFICANT
    assert intervals.proportion(wrong, tries)[0] <= sensitivity.SIGNIFICANT, wrong / tries


@pytest.mark.slow
def test_words_and_counts_that_hardly_vary_are_not_certain_either():
    rng = np.random.default_rng(20)
    tries, n, wrong = 60, 30, 0
    for _ in range(tries):
        draws = {
            f"w{k}": np.array(list("a" * 11 + "b"), dtype=object)[rng.integers(0, 12, n)] for k in range(30)
        }
        draws |= {f"n{k}": rng.poisson(0.3, n) for k in range(30)}
        found = {f"o{k}": 400.0 - rng.poisson(0.15, n) for k in range(10)}
        wrong += sensitivity.ranks(found, sensitivity.features(draws))[0].p_holm < sensitivity.SIGNIFICANT
    assert intervals.proportion(wrong, tries)[0] <= sensitivity.SIGNIFICANT, wrong / tries


@pytest.mark.parametrize("ties", [False, True])
def test_p_of_few_results_is_the_share_of_all_their_orders(ties):
    rng = np.random.default_rng(19)
    x, y = rng.standard_normal((2, 7))
    if ties:
        x, y = np.round(x), np.round(2.0 * y)
    rho, p = spearman.correlation(spearman.ranked(x), spearman.ranked(y))
    assert rho == pytest.approx(stats.spearmanr(x, y)[0])
    ranks = stats.rankdata(x)
    every = np.array([np.corrcoef(ranks, order)[0, 1] for order in permutations(stats.rankdata(y))])
    assert p == pytest.approx(np.mean(np.abs(every) >= abs(rho) - 1e-9))


@pytest.mark.parametrize("n", [11, 12])
def test_p_of_more_results_is_not_too_small_and_not_far_off(n):
    """Where they still can be counted; Student's is a third of it there."""
    place = tuple(float(k) for k in range(n))
    shares, a = spearman._sums(place, place), spearman.ranked(np.array(place))
    upper = np.cumsum(shares[::-1])[::-1]
    for least in (5e-2, 1e-2, 1e-3, 1e-4):
        k = int(np.argmax(2.0 * upper <= least))
        rho = (k - n * ((n - 1) / 2) ** 2) / a.squares
        p = spearman._approximate(rho - 0.5 / a.squares, n, a.excess, a.excess)
        assert 0.97 < p / (2.0 * upper[k]) < 4.0


def test_two_draws_of_two_words_are_fisher_s_test():
    a, b = np.repeat([0.0, 1.0], [25, 5]), np.r_[np.zeros(22), np.ones(3), np.ones(4), 0.0]
    table = [[22, 3], [1, 4]]
    p = spearman.correlation(spearman.ranked(a), spearman.ranked(b))[1]
    assert p == pytest.approx(stats.fisher_exact(table).pvalue)


def test_few_runs_give_no_regression_and_draws_without_sense_no_feature():
    x = np.random.default_rng(13).standard_normal(20)
    features = sensitivity.features({f"d{k}": x + k for k in range(3)})
    assert sensitivity.regress("y", x, features) is None  # six features, twenty runs
    found = sensitivity.features({"constant": np.ones(5), "two": np.array([1.0, 2.0, 1.0, 2.0, 1.0])})
    assert [feature.name for feature in found] == ["two"]
    words = sensitivity.features({"w": np.array(["a", "b", "a", "c"], dtype=object)})
    assert [(one.name, one.values.tolist()) for one in words] == [
        ("w = b", [0, 1, 0, 0]),
        ("w = c", [0, 0, 0, 1]),
    ]


def test_a_draw_that_another_determines_is_left_out():
    rng = np.random.default_rng(14)
    a, b = rng.standard_normal((2, 100))
    features = [
        sensitivity.Feature("a", a),
        sensitivity.Feature("twice a", 2.0 * a + 3.0),
        sensitivity.Feature("b", b),
    ]
    one = sensitivity.regress("y", a + 0.1 * rng.standard_normal(100), features)
    assert [effect.feature for effect in one.effects] == ["a", "b"]


def test_few_runs_are_explained_without_distances_and_that_is_said():
    rng = np.random.default_rng(15)
    draws = {name: rng.standard_normal(40) for name in "abcdef"}  # 12 features would take 65 runs
    (one,) = sensitivity.regressions({"y": draws["a"] + 0.1 * rng.standard_normal(40)}, draws)
    assert not one.distances and {effect.feature for effect in one.effects} == set("abcdef")
    (one,) = sensitivity.regressions({"y": draws["a"]}, {"a": draws["a"], "b": draws["b"]})
    assert one.distances and len(one.effects) == 4


def test_what_breaks_runs_is_named(tmp_path):
    campaign = open_campaign(
        synthetic_campaign.write(tmp_path / "c", 200, seed=15, breaks=True, with_series=False)
    )
    first, second, *others = sensitivity.separations(campaign)
    assert {first.feature, second.feature} == {MASS, f"|{MASS}|"}
    by_name = {one.feature: one for one in (first, second)}
    assert by_name[MASS].effect == 1.0  # every failed run drew more than every other
    assert by_name[MASS].failed_from > synthetic_campaign.BROKEN_MASS >= by_name[MASS].others_to
    assert first.p_holm < 1e-6 and all(one.p_holm > 0.01 for one in others)
    assert sensitivity.separations(open_campaign(
        synthetic_campaign.write(tmp_path / "good", 10, with_series=False))) == []  # fmt: skip


@pytest.mark.parametrize("failed", [1, 2, 5])
def test_runs_that_fail_by_chance_have_no_word_in_common(failed):
    rng, found = np.random.default_rng(4), 0
    for _ in range(200):
        words = np.array([f"w{k}" for k in rng.integers(20, size=200)], dtype=object)
        numbers = rng.choice([100.0, 250.0, 500.0], p=[0.98, 0.01, 0.01], size=200)
        succeeded = np.ones(200, bool)
        succeeded[rng.permutation(200)[:failed]] = False
        one = SimpleNamespace(succeeded=succeeded, draws={"words": words, "numbers": numbers})
        found += sensitivity.separations(one)[0].p_holm < sensitivity.SIGNIFICANT
    assert stats.binom.sf(found - 1, 200, sensitivity.SIGNIFICANT) > 1e-3  # it was 93 % of one failed run


def test_a_word_that_fails_is_found_with_fisher_s_p():
    words, succeeded = np.array(["a"] * 190 + ["b"] * 10, dtype=object), np.ones(200, bool)
    succeeded[190:196] = False
    (one,) = sensitivity.separations(SimpleNamespace(succeeded=succeeded, draws={"camera": words}))
    assert one.p_holm == pytest.approx(stats.fisher_exact([[6, 0], [4, 190]]).pvalue)
