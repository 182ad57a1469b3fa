"""The campaign of the IMPA paper: its directions, attitudes and the order in which they are taken."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.papers.impa import field
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.scenario import yaml_text

TARGETS = Path(__file__).parents[2].parent / "shared" / "papers" / "targets.yaml"


def test_published_figures_are_those_of_the_paper():
    if not TARGETS.is_file():
        pytest.skip(f"{TARGETS} is not here")
    targets = yaml.load(TARGETS.read_text(encoding="utf-8"), Loader=yaml_text.Loader)
    assert targets["impa"] == IMPA


def test_directions_are_the_26_of_the_paper():
    u = field.directions()
    assert u.shape == (26, 3)
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, atol=1e-15)
    cosine = u @ u.T - 2.0 * np.eye(26)
    assert cosine.max() < np.cos(np.radians(35.0))  # distinct
    scaled = u / np.abs(u).max(axis=1, keepdims=True)
    assert set(np.round(scaled, 12).ravel()) == {-1.0, 0.0, 1.0}
    assert Counter((np.abs(scaled) > 0.5).sum(axis=1)) == {1: 6, 2: 12, 3: 8}


def test_attitudes_sample_the_sphere_uniformly():
    """No mean direction, the second moment of the sphere, and cells of nearly equal area."""
    from scipy.spatial import SphericalVoronoi

    z = field.boresights()
    assert z.shape == (200, 3)
    np.testing.assert_allclose(z.mean(axis=0), 0.0, atol=1e-14)
    np.testing.assert_allclose(z.T @ z / 200, np.eye(3) / 3.0, atol=0.01)
    areas = SphericalVoronoi(z).calculate_areas() * 200 / (4.0 * np.pi)
    assert areas.min() > 0.75 and areas.max() < 1.25
    looking = np.array([dcm_from_quat(q)[:, 2] for q in field.attitudes()])
    np.testing.assert_allclose(looking, z, atol=1e-12)


def test_the_whole_campaign_takes_every_case_once():
    counted = Counter(case[:3] for number in range(26000) for case in field.cases(number))
    paper = {case: n for case, n in counted.items() if case[0] in field.RATES}
    assert len(paper) == 26000 and set(paper.values()) == {1}
    rest = [case for case in counted if case[0] == 0.0]
    assert sorted(case[1] for case in rest) == list(range(200)) and {counted[case] for case in rest} == {1}


@pytest.mark.parametrize("samples", [130, 1300, 2600])
def test_a_smaller_campaign_is_even(samples):
    some = [field.cases(number)[0] for number in range(samples)]
    for rate in field.RATES:
        mine = [case for case in some if case.rate == rate]
        assert len(mine) == samples // 5
        directions = Counter(case.direction for case in mine)
        assert len(directions) == 26 and set(directions.values()) == {samples // 130}
        attitudes = Counter(case.attitude for case in mine)
        assert max(attitudes.values()) - min(attitudes.values() if len(attitudes) == 200 else [0]) <= 1
    if samples == 2600:
        at_rest = {c.attitude for k in range(samples) for c in field.cases(k) if c.rate == 0.0}
        assert len(at_rest) == 200


def test_frames_follow_each_other_at_the_constant_rate():
    case = field.Case(np.radians(5.0), 17, 3)
    for n in (1, 7, 59):
        turned = rotvec_between(field.attitude_at(case, n - 1), field.attitude_at(case, n))
        np.testing.assert_allclose(turned, case.omega_c * 0.2, atol=1e-9)


def test_the_rolling_shutter_is_contiguous_and_the_global_one_has_one_time_for_all():
    rolling, all_at_once = field.times("rolling_shutter"), field.times("global_shutter")
    assert rolling.exposure_s == all_at_once.exposure_s == 0.2
    assert rolling.line_s * 1024 == pytest.approx(rolling.exposure_s)
    assert all_at_once.line_s == 0.0


def test_noise_is_that_of_table_2():
    noise = IMPA["noise"]
    variance = noise["stray_light_e"] + noise["dark_std_e"] ** 2 + noise["read_std_e"] ** 2
    assert pytest.approx(variance) == field.BACKGROUND + field.READ_NOISE**2
    assert field.BACKGROUND == noise["stray_light_e"] + noise["dark_mean_e"]


def test_catalogue_is_what_hipparcos_has():
    assert len(field.pairs(False).stars.hip) == 2851
    assert field.stars()[1].max() <= 6.5
    merged = field.pairs(True).stars
    assert 2500 < len(merged.hip) < 2851 and merged.vmag.min() == field.pairs(False).stars.vmag.min()
