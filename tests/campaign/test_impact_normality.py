"""Mardia's skewness and kurtosis of landings: definition, limits of many, false alarms, what they find."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from shefex_nav.campaign import normality
from shefex_nav.campaign.impact import ellipses, outputs


def by_definition(xy):
    """Equations (2.23) and (3.12) of Mardia (1970), sums over all pairs."""
    away = xy - xy.mean(axis=0)
    products = away @ np.linalg.solve(away.T @ away / len(xy), away.T)
    return (products**3).mean(), (np.diag(products) ** 2).mean()


def normal(n, seed=2):
    return np.random.default_rng(seed).standard_normal((n, 2)) @ np.array([[900.0, 200.0], [0.0, 50.0]])


def two_clusters(n):
    xy = normal(n)
    xy[: n // 5] += [0.0, 700.0]
    return xy


def ring(n):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return 1000.0 * np.column_stack([np.cos(angle), 3.0 * np.sin(angle)])


def test_the_figures_are_those_of_the_definition():
    for xy in (normal(40), two_clusters(60), ring(30)):
        np.testing.assert_allclose(normality.mardia(xy), by_definition(xy), rtol=1e-9, atol=1e-12)


def test_p_values_of_many_are_those_of_the_published_limits():
    """n b1/6 is chi-squared with 4 degrees of freedom, (b2 - 8) sqrt(n/64) normal: at 1000, to 0.02."""
    n = 1000
    for p in (0.5, 0.2, 0.05):
        kurtosis = 8.0 * (n - 1) / (n + 1) + norm.isf(p / 2.0) * np.sqrt(64.0 / n)
        found = normality.p_values(6.0 * chi2.isf(p, 4) / n, kurtosis, n)
        np.testing.assert_allclose(found, p, atol=0.02)


def test_p_values_go_on_smoothly_where_the_limits_begin():
    n = normality.MANY
    for skewness, kurtosis in ((12.0 / n, 8.1), (20.0 / n, 7.8)):
        drawn = normality.p_values(skewness, kurtosis, n - 1)
        # the distribution of the kurtosis is still a little skew
        np.testing.assert_allclose(normality.p_values(skewness, kurtosis, n), drawn, atol=0.03)


@pytest.mark.parametrize("n", [10, 30, 200])
def test_normal_landings_are_rarely_called_odd(n):
    """1500 studies of two bodies: a share of LEVEL, 1 %, at most, within three standard errors."""
    studies, rng = 1500, np.random.default_rng(n)
    alarms = 0
    for _ in range(studies):
        found = normality.shapes(list(rng.standard_normal((2, n, 2))))
        alarms += any(not shape.normal for shape in found)
    assert 0.3 * normality.LEVEL < alarms / studies < normality.LEVEL + 3.0 * np.sqrt(0.01 * 0.99 / studies)


def test_clusters_and_rings_are_found():
    found = normality.shapes([two_clusters(100), normal(100), ring(60)])
    assert [shape.normal for shape in found] == [False, True, False]
    assert found[0].p_skewness < 0.01 and found[2].p_kurtosis < 0.01 <= found[2].p_skewness


def test_few_landings_and_those_on_a_line_are_not_tested():
    line = np.column_stack([np.arange(20.0), 2.0 * np.arange(20.0)])
    assert normality.shapes([normal(9), line]) == [None, None]


def test_what_follows_is_said():
    """Table, map and JSON: how many of how many the ellipses hold, in the place of a normal one's shares."""
    places = np.array([1.18, 0.36]) + two_clusters(100) * 1e-6
    (one,) = ellipses.of_bodies({"payload": places})
    assert one.not_normal and not outputs._ellipse(one)["normality"]["normal"]
    name, said = outputs._normal(outputs._ellipse(one))
    inside = ", ".join(map(str, one.inside))
    assert name == "not normal" and f"the ellipses hold {inside} of 100; use these counts" in said
    assert outputs._held(one, 2) == f"not normal: {one.inside[1]} of 100 landings"


def test_a_normal_sample_keeps_its_shares():
    places = np.array([1.18, 0.36]) + normal(100) * 1e-6
    (one,) = ellipses.of_bodies({"payload": places})
    assert [outputs._held(one, k) for k in ellipses.SIGMAS] == ["38.6 %", "85.4 %", "98.5 %"]
    assert outputs._normal(outputs._ellipse(one))[0] == "normal"


def test_the_figures_do_not_depend_on_units_and_axes():
    xy, turned = two_clusters(50), np.array([[0.0, 2.0], [-3.0, 1.0]])
    np.testing.assert_allclose(normality.mardia(xy), normality.mardia(xy @ turned + 7.0), rtol=1e-9)
