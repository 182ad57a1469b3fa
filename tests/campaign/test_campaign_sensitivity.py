"""What explains the results of a campaign in which it is known."""

import numpy as np
import pytest
import synthetic_campaign
from scipy import stats

from shefex_nav.campaign import sensitivity
from shefex_nav.campaign.results import open_campaign

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
    assert found["attitude z at entry"].r2_adjusted < 0.03


def test_coefficients_are_those_of_least_squares(campaign):
    features = sensitivity.features(campaign.draws)
    y = campaign.numbers("summary.navigation.at_entry.attitude_error_deg.0")
    one = sensitivity.regress("x", y, features)
    x = np.column_stack([np.ones(500), *[stats.zscore(feature.values) for feature in features]])
    beta = np.linalg.lstsq(x, stats.zscore(y), rcond=None)[0][1:]
    found = {effect.feature: effect.value for effect in one.effects}
    assert [found[feature.name] for feature in features] == pytest.approx(beta, abs=1e-9)
    residual = stats.zscore(y) - x[:, 1:] @ beta
    assert one.r2 == pytest.approx(1.0 - residual.var())


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
