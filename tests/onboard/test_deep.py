"""Deep matching: names and attitude of the faint objects, and what it does where it is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from star_fields import CAMERA, TRACKER, YEAR, all_stars, random_attitude, tracker_with

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.onboard.startracker import catalogue, deep, tracker
from shefex_nav.records import Detections, Reason

NOISE_PX, DEEPEST, SEED = 0.1, 7.0, 51803
V_I = TRACKER.earth_velocity_i
SHALLOW = tracker.init(tracker_with(TRACKER, identification__method="bayes"), all_stars(), YEAR)
DEEP = tracker.init(
    tracker_with(TRACKER, identification__method="bayes", identification__deepest=DEEPEST), all_stars(), YEAR
)


def objects(rng, q_ic, n_false=3, noise_px=NOISE_PX):
    """Detections of all stars to DEEPEST on the detector and false ones, and the true row of each, -1."""
    stars = DEEP.deep.stars
    xy_px = pixels(CAMERA, np.ascontiguousarray(aberrate(stars.u_i, V_I) @ dcm_from_quat(q_ic)))
    size_px = np.array([CAMERA.width_px, CAMERA.height_px])
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(((xy_px > 5.0) & (xy_px < size_px - 6.0)).all(axis=1))
    places = np.concatenate([xy_px[rows], rng.uniform(5.0, size_px - 6.0, (n_false, 2))])
    places += rng.normal(0.0, noise_px, places.shape)
    mag = np.concatenate([stars.vmag[rows] + rng.normal(0.0, 0.1, len(rows)), rng.uniform(5, 7, n_false)])
    order, truth = np.argsort(mag), np.concatenate([rows, np.full(n_false, -1)])
    n, flux = len(order), 1e5 * 10.0 ** (-0.4 * mag[order])
    P_px = np.tile(NOISE_PX**2 * np.eye(2), (n, 1, 1))
    none = np.zeros(n, dtype=np.int64)
    return Detections(places[order], flux, none + 9, none, P_px), truth[order]


def solved(chain, detections):
    context = tracker.NO_CONTEXT._replace(velocity_i=V_I)
    return tracker.attitude_with_stars(chain, detections, context)


@pytest.fixture(scope="module")
def fields():
    """(q_ic, detections, truth, result shallow, result deep) of fields that are solved."""
    rng, found = np.random.default_rng(SEED), []
    while len(found) < 100:
        q_ic = random_attitude(rng)
        detections, truth = objects(rng, q_ic)
        results = solved(SHALLOW, detections), solved(DEEP, detections)
        if results[0][1] == Reason.NONE:
            found.append((q_ic, detections, truth, *results))
    return found


def squares(q_ic, result):
    d = rotvec_between(q_ic, result[2][0])
    return d @ np.linalg.solve(result[2][1], d)


def test_faint_objects_get_their_names_and_hardly_a_false_one(fields):
    named = right = false = n_false = 0
    for _, _, truth, _, (found, *_) in fields:
        stars = truth >= 0
        named += stars.sum()
        right += (found.star[stars] == truth[stars]).sum()
        assert not ((found.star >= 0) & stars & (found.star != truth)).any()
        n_false += (~stars).sum()
        false += (found.star[~stars] >= 0).sum()
    assert right > 0.97 * named
    assert false <= chi2.ppf(0.999, 2 * (deep.FALSE_MATCH * n_false + 1)) / 2  # Poisson, an upper limit


def test_the_attitude_is_that_of_all_stars_and_its_covariance_holds(fields):
    shallow = np.array([np.diag(one[3][2][1]) for one in fields])
    deeper = np.array([np.diag(one[4][2][1]) for one in fields])
    share = np.array([len(one[3][3].hip) / len(one[4][3].hip) for one in fields])
    assert (deeper[:, :2] < shallow[:, :2] * 1.05).mean() > 0.95
    # stars of equal noise: the variance across falls as their number grows
    assert np.median(deeper[:, :2] / shallow[:, :2] / share[:, None]) == pytest.approx(1.0, abs=0.25)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * len(fields))
    assert low < sum(squares(one[0], one[4]) for one in fields) < high


def test_noise_that_is_twice_what_was_said_makes_no_name_wrong():
    rng, n_wrong, total, n = np.random.default_rng(SEED + 1), 0, 0.0, 0
    for _ in range(60):
        q_ic = random_attitude(rng)
        detections, truth = objects(rng, q_ic, noise_px=2.0 * NOISE_PX)
        result = solved(DEEP, detections)
        if result[1] == Reason.NONE:
            star = result[0].star
            n_wrong += ((star >= 0) & (truth >= 0) & (star != truth)).sum()
            total, n = total + squares(q_ic, result), n + 1
    assert n > 50
    assert n_wrong == 0
    assert total / (3 * n) < 2.0  # four without the misfit of the stars


def test_stars_that_contradict_the_identification_change_nothing():
    rng = np.random.default_rng(SEED + 2)
    for _ in range(20):
        q_ic = random_attitude(rng)
        detections, _ = objects(rng, q_ic, n_false=0)
        before = solved(SHALLOW, detections)
        if before[1] != Reason.NONE:
            continue
        moved = detections.xy_px.copy()
        moved[before[0].star < 0] += [0.45, 0.0]  # all faint ones by 4.5 sigma, within their gates
        result = solved(DEEP, detections._replace(xy_px=moved))
        angle = np.linalg.norm(rotvec_between(before[2][0], result[2][0])[:2])
        limit = np.sqrt(deep.CONTRADICTION * np.linalg.eigvalsh(before[2][1][:2, :2])[-1])
        assert angle < limit


@pytest.mark.parametrize("system", ["V", "Hp", "silicon"])
def test_limit_and_magnitudes_are_of_the_band_that_is_told(system):
    """Every star to the limit in that band, and no other; the magnitudes of both parts are of one band."""
    settings = tracker_with(
        TRACKER, identification__deepest=6.4, catalogue__system=system, catalogue__faintest=5.0,
        catalogue__kind="asymmetric", catalogue__faintest_south=4.8, catalogue__merge_radius=1e-7,
    ).settings  # fmt: skip
    first = catalogue.build(settings.catalogue, all_stars(), YEAR)
    found = deep.build(settings, first, all_stars(), YEAR)
    sky = all_stars()
    told = catalogue.magnitudes(sky, system)
    assert set(found.stars.hip.tolist()) == set(sky.hip[told <= 6.4].tolist())
    row = {hip: n for n, hip in enumerate(sky.hip.tolist())}
    wanted = told[[row[hip] for hip in found.stars.hip.tolist()]]
    assert found.stars.vmag == pytest.approx(wanted, abs=1e-9)
    assert (found.n_first < len(wanted)) and (found.stars.hip[: found.n_first] == first.hip).all()


def test_beyond_the_table_it_is_refused():
    """G of 6.5 is as deep as stars to V 8 are whole."""
    settings = tracker_with(TRACKER, identification__deepest=6.6, catalogue__system="silicon").settings
    with pytest.raises(catalogue.CatalogueError, match=r"identification\.deepest: .* to 6\.5 in silicon"):
        deep.build(settings, DEEP.pairs.stars, all_stars(), YEAR)


def test_it_is_off_unless_it_is_asked_for():
    assert SHALLOW.deep is None
    assert SHALLOW.stars is SHALLOW.pairs.stars
    first = SHALLOW.pairs.stars
    assert (DEEP.stars.hip[: len(first.hip)] == first.hip).all()
    assert len(set(DEEP.stars.hip.tolist())) == len(DEEP.stars.hip)
    assert DEEP.deep.n_first == len(first.hip)
    assert (
        replace(DEEP.params.settings.identification, deepest=None) == SHALLOW.params.settings.identification
    )
