"""The on-board catalogues and their pairs against the counts of the paper and brute force."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree
from star_fields import CATALOGUE, DEG, YEAR, all_stars

from shefex_nav.environment.stars import load_catalogue, silicon_magnitude
from shefex_nav.onboard.startracker import catalogue

FIELD = 18.57 * DEG  # diagonal of the SHEFEX-2 camera


def separations(u_i, k=2):
    chord, _ = cKDTree(u_i).query(u_i, k=k)
    return 2.0 * np.arcsin(0.5 * chord[:, 1:])


def test_magnitude_limited():
    stars = catalogue.build(CATALOGUE, all_stars(), YEAR)
    n_all = (all_stars().vmag <= 5.5).sum()
    assert n_all == 2851
    assert 2825 <= len(stars.hip) <= 2845  # 17 have a neighbour within 3 px
    assert (np.diff(stars.vmag) >= 0.0).all() and stars.vmag[-1] <= 5.5
    assert len(np.unique(stars.hip)) == len(stars.hip)
    assert separations(stars.u_i).min() > 0.9 * CATALOGUE.merge_radius


def test_proper_motion_is_in_the_positions():
    """Groombridge 1830 (HIP 57939, 7.06 arcsec a year) is too faint; 61 Cygni A moves 5.28."""
    settings = replace(CATALOGUE, merge_radius=1e-6)
    then, now = (catalogue.build(settings, all_stars(), year) for year in (1991.25, YEAR))
    row_then, row_now = (np.flatnonzero(stars.hip == 104214)[0] for stars in (then, now))
    moved = np.linalg.norm(now.u_i[row_now] - then.u_i[row_then]) / DEG * 3600.0
    assert moved == pytest.approx(5.28 * (YEAR - 1991.25), rel=0.01)


def test_combined_catalogue_of_shefex():
    """2023 stars and 54 804 pairs; the recipe is not in the paper, so the pairs are met within 8 per cent."""
    settings = replace(CATALOGUE, kind="combined", faintest=5.75)
    stars = catalogue.build(settings, all_stars(), YEAR)
    assert len(stars.hip) == 2023
    bright = catalogue.build(replace(CATALOGUE, faintest=4.5), all_stars(), YEAR)
    assert set(bright.hip) <= set(stars.hip)
    pairs = catalogue.pair_table(stars, FIELD)
    assert len(pairs.cosine) == pytest.approx(54804, rel=0.08)
    # a filling star is at least 2.5 deg from every other one: the sky has room for no more
    faint = stars.vmag > 4.5
    assert separations(stars.u_i)[faint].min() > 2.5 * DEG


def test_pairs_are_all_pairs_within_the_field():
    stars = catalogue.build(CATALOGUE, all_stars(), YEAR)
    pairs = catalogue.pair_table(stars, FIELD)
    expected = cKDTree(stars.u_i).query_pairs(2.0 * np.sin(0.5 * FIELD), output_type="ndarray")
    found = np.column_stack([pairs.first, pairs.second])
    assert {tuple(p) for p in np.sort(expected, axis=1)} == {tuple(p) for p in found}
    assert (np.diff(pairs.cosine) >= 0.0).all()
    np.testing.assert_allclose(
        pairs.cosine, (stars.u_i[pairs.first] * stars.u_i[pairs.second]).sum(axis=1), atol=1e-15
    )
    assert (stars.vmag[pairs.first] <= stars.vmag[pairs.second]).all()


def test_pairs_know_the_magnitudes_of_their_stars():
    """The five columns P, I, J, B_I, B_J of the brightness-referenced method."""
    pairs = catalogue.pair_table(catalogue.build(CATALOGUE, all_stars(), YEAR), FIELD)
    np.testing.assert_array_equal(pairs.first_vmag, pairs.stars.vmag[pairs.first])
    np.testing.assert_array_equal(pairs.second_vmag, pairs.stars.vmag[pairs.second])
    assert (pairs.first_vmag <= pairs.second_vmag).all()


def test_magnitudes_of_a_silicon_detector():
    """Gaia's G of single stars by V and B-V: Betelgeuse is brighter than in V, Rigel is not; limit in G."""
    settings = replace(CATALOGUE, system="silicon", merge_radius=1e-6)
    stars, sky = catalogue.build(settings, all_stars(), YEAR), all_stars()
    in_band = dict(zip(stars.hip.tolist(), stars.vmag.tolist(), strict=True))
    in_v = dict(zip(sky.hip.tolist(), sky.vmag.tolist(), strict=True))
    assert in_band[27989] < in_v[27989] - 0.5 and abs(in_band[24436] - in_v[24436]) < 0.1
    assert (np.diff(stars.vmag) >= 0.0).all() and 5.49 < stars.vmag[-1] <= 5.5
    wanted = sky.hip[silicon_magnitude(sky.vmag, sky.bv) <= 5.5]
    assert len(set(wanted.tolist()) ^ set(in_band)) < 0.01 * len(wanted)  # close pairs are one
    redder = [hip for hip in in_band if in_v[hip] > 6.5]
    assert len(redder) > 20  # of stars that a limit in V would leave out
    # beside a star that is brighter in V alone, and is itself too faint: the entry is the redder one
    deep = catalogue.build(
        replace(CATALOGUE, system="silicon", faintest=6.5, merge_radius=245.0 / 206265.0), sky, YEAR
    )
    assert 99653 in deep.hip and 99649 not in deep.hip


# Numbers of stars in the literature are counts of Hipparcos entries: nothing merged.
PLAIN = replace(CATALOGUE, kind="magnitude_limited", merge_radius=0.0)


def count(limit, system="V", inclusive=True):
    settings = replace(PLAIN, faintest=limit, system=system)
    return len(catalogue.build(settings, everything(), YEAR, inclusive).hip)


@cache
def everything():
    """With the five stars of Hp < 7 that are fainter than V = 8."""
    return load_catalogue(99.0)


def test_counts_of_the_brightness_referenced_paper():
    """Table 2 (2014) counts stars of Hp in [lo, hi); section 4.1: 1471 brighter than 5."""
    counts = [count(limit, "Hp", inclusive=False) for limit in (3.0, 4.0, 5.0, 6.0, 7.0)]
    assert np.diff([0, *counts]).tolist() == [165, 315, 991, 3088, 9381]
    assert counts[2] == 1471


@pytest.mark.parametrize(
    "limit, inclusive, n", [(4.5, True, 921), (5.5, True, 2851), (5.5, False, 2819), (6.0, True, 5044)]
)
def test_counts_of_johnson_v(limit, inclusive, n):
    """Counted in the file itself, with `awk` on its column of V."""
    assert count(limit, inclusive=inclusive) == n


def test_hp_is_the_magnitude_of_a_catalogue_in_hp():
    settings = replace(CATALOGUE, system="Hp", faintest=5.0)
    stars = catalogue.build(settings, everything(), YEAR, inclusive=False)
    assert (np.diff(stars.vmag) >= 0.0).all() and stars.vmag[-1] < 5.0
    raw = everything()
    sirius = np.flatnonzero(stars.hip == 32349)[0]
    assert stars.vmag[sirius] == pytest.approx(raw.hpmag[raw.hip == 32349][0], abs=0.01)  # -1.09, V = -1.44
    assert stars.epoch == YEAR


def test_asymmetric_catalogue_has_its_own_limit_in_the_south():
    """SHEFEX figure 4: nothing over 5.4, and the stars from 5.2 on are those of one hemisphere alone."""
    settings = replace(PLAIN, kind="asymmetric", faintest=5.2, faintest_south=5.4)
    stars = catalogue.build(settings, all_stars(), YEAR)
    faint = stars.vmag > 5.2
    assert stars.vmag.max() <= 5.4
    assert (stars.u_i[faint, 2] < 0.0).all()
    assert faint.sum() == 249 and len(stars.hip) == 2061 + 249


def test_uniform_catalogue_is_more_even_than_the_sky():
    """SHEFEX figure 5: about 450 stars of 2000 between 5.25 and 5.75."""
    settings = replace(CATALOGUE, kind="uniform", faintest=6.0, size=2000)
    stars = catalogue.build(settings, all_stars(), YEAR)
    assert len(stars.hip) == 2000
    assert separations(stars.u_i).min() > 2.5 * DEG  # on a perfect hexagonal grid: 4.9 deg
    bright = catalogue.build(replace(PLAIN, faintest=5.17), all_stars(), YEAR)
    assert len(bright.hip) == pytest.approx(2000, abs=50)
    assert scatter(stars.u_i) < 0.5 * scatter(bright.u_i)
    assert 380 < ((stars.vmag > 5.25) & (stars.vmag < 5.75)).sum() < 520


def test_combined_catalogue_from_the_asymmetric_one():
    """As the text of SHEFEX 3.3 has it: about 180 stars from 5.2 on, all of them in the south."""
    settings = replace(CATALOGUE, kind="combined", faintest=5.2, faintest_south=5.4)
    stars = catalogue.build(settings, all_stars(), YEAR)
    faint = stars.vmag > 5.2
    assert len(stars.hip) == 2023
    assert (stars.u_i[faint, 2] < 0.0).all()
    assert faint.sum() == pytest.approx(180, abs=20)


def scatter(u_i):
    """Standard deviation of the number of stars within 20 deg, over 500 directions."""
    v = np.random.default_rng(5).standard_normal((500, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    return np.std([len(near) for near in cKDTree(u_i).query_ball_point(v, 2.0 * np.sin(10.0 * DEG))])


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"kind": "round"}, "unknown star catalogue 'round'; choose from: magnitude_limited, asymmetric"),
        ({"system": "silicon", "faintest": 6.6}, "ends at V 8, which is whole to 6.5 in silicon"),
        ({"system": "B"}, "unknown magnitude system 'B'; choose V or Hp or silicon"),
        ({"kind": "combined", "size": 900}, r"900 stars are wanted, but keep_to alone keeps 9\d\d"),
        ({"kind": "combined", "size": 9000}, r"9000 stars are wanted, only 28\d\d are within"),
        ({"kind": "uniform", "size": 9000}, r"9000 stars are wanted, only 28\d\d are within"),
        ({"kind": "uniform", "size": 0}, "0 stars"),
        ({"kind": "asymmetric"}, "faintest_south: an asymmetric catalogue needs it"),
        ({"faintest": -3.0}, "no star is as bright as V -3"),
    ],
)
def test_impossible_catalogues_are_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        catalogue.build(replace(CATALOGUE, **changed), all_stars(), YEAR)


def test_a_table_without_pairs_is_refused():
    stars = catalogue.build(replace(CATALOGUE, faintest=-0.5), all_stars(), YEAR)
    with pytest.raises(ValueError, match="of the 2 stars of the catalogue, no two pairs fit"):
        catalogue.pair_table(stars, FIELD)
