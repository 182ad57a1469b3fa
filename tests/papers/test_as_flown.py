"""The papers' systems as scenarios: their settings, what they believe, and the flights that compare them."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker import catalogue, tracker
from shefex_nav.onboard.startracker.methods import STEPS
from shefex_nav.onboard.startracker.settings import contradiction
from shefex_nav.papers import flown
from shefex_nav.papers.bright import fields
from shefex_nav.papers.bright import frames as bright_frames
from shefex_nav.papers.bright.methods import brightness
from shefex_nav.papers.bright.published import BRIGHT
from shefex_nav.papers.rows import goal_none
from shefex_nav.papers.shefex2 import chain, end_to_end
from shefex_nav.papers.shefex2 import field as shefex
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.records import Reason
from shefex_nav.report import intervals
from shefex_nav.scenario import load, of_settings, shipped

PUBLISHED = {"pyramid": 4, "brightness": 3, "voting": 4, "multipole": 5}  # method -> fewest stars


def scenario_of(name, *overrides):
    return load.load(shipped.files()[name], overrides)


def on_board(name):
    """Settings of the star tracker of a scenario."""
    return of_settings.settings(scenario_of(name).star_tracker)


def test_shefex_as_flown_is_the_chain_of_the_experiments():
    settings = on_board("shefex2_as_flown")
    flown = chain.FLOWN
    assert replace(settings.detection, grow_sigma=flown.grow_sigma) == flown
    goals, exposure = SHEFEX["identification"], settings.exposure
    identify = settings.identification
    assert identify.method == "pyramid" and identify.acceptance == "published"
    assert identify.cosine_error == chain.COS_ERROR == goals["cos_error"]
    assert identify.most_centroids == goals["max_centroids"]
    assert settings.catalogue.kind == "combined"
    assert settings.catalogue.keep_to == SHEFEX["catalogue"]["keep_all_to_mag"]
    stars = catalogue.build(settings.catalogue, load_catalogue(8.0), 2012.5)
    assert len(stars.hip) == SHEFEX["catalogue"]["stars"] == 2023
    assert 1e3 * np.array([exposure.shortest, exposure.longest]) == pytest.approx([35.0, 50.0])
    scenario = scenario_of("shefex2_as_flown")
    camera = scenario.star_camera
    assert camera.optics.focal_length == pytest.approx(1e-3 * SHEFEX["camera"]["calibrated_focal_length_mm"])
    budget_s = exposure.longest + of_settings.settings(camera.detector).readout + settings.latency
    assert budget_s == pytest.approx(0.1) and settings.rate == 10.0


def test_bright_scenarios_are_the_paper_s_camera_and_identification():
    four, three = on_board("bright_four_star"), on_board("bright_three_star")
    camera = scenario_of("bright_four_star").star_camera
    paper = BRIGHT["camera"]
    assert (camera.detector.columns, camera.detector.rows) == (paper["width_px"], paper["height_px"])
    assert camera.detector.pixel_size == pytest.approx(1e-6 * paper["pixel_um"])
    assert camera.optics.focal_length == pytest.approx(1e-3 * paper["focal_length_mm"])
    assert four.identification.tolerance == pytest.approx(fields.TOLERANCE, rel=0.01)
    assert four.catalogue.merge_radius == pytest.approx(2.0 * 15e-6 / 43.3e-3, rel=0.01)
    assert (four.identification.reference_magnitude, four.identification.fewest_stars) == (None, 4)
    changed = replace(four.identification, reference_magnitude=2.3, fewest_stars=3)
    assert three == replace(four, identification=changed)
    reference = 10.0 ** (-0.4 * three.identification.reference_magnitude)
    assert reference == pytest.approx(bright_frames.REFERENCE_FLUX)


def fields_of(n, **how):
    rng = np.random.default_rng(7)
    stars = fields.pairs()[0].stars
    return [
        fields.draw_field(rng, stars, **{"least": 4, "n_false": 1, "is_round": False} | how) for _ in range(n)
    ]


def settings_of(method, acceptance, **more):
    given = {"method": method, "acceptance": acceptance, "fewest_stars": PUBLISHED[method]} | more
    return replace(fields.IDENTIFY, **given)


CAMERA = fields.MODEL._replace(zero_flux=1.0)


@pytest.mark.parametrize("method", PUBLISHED)
def test_a_published_acceptance_is_the_method_s_own(method):
    """As `match` of the method, with stars enough; and verification believes less, never something else."""
    settings = settings_of(method, "published")
    checked = settings_of(method, "verified", fewest_stars=4)
    identify = STEPS["identification"].ways()[method]
    match = sys.modules[identify.__module__].match
    pairs, believed = fields.pairs()[0], 0
    for field in fields_of(12):
        found = identify(settings, CAMERA, pairs, field.u_c, field.flux)
        own = match(settings, CAMERA, pairs, field.u_c, field.flux)
        if found.reason == Reason.NONE:
            believed += 1
            assert np.array_equal(found.star, own.star) and np.isnan(found.log_odds)
            assert (found.star >= 0).sum() >= settings.fewest_stars
        verified = identify(checked, CAMERA, pairs, field.u_c, field.flux)
        if verified.reason == Reason.NONE:
            known = verified.star >= 0
            assert np.array_equal(verified.star[known], field.star[known]) and verified.log_odds > 0.0
    assert believed >= 6


def test_a_published_pyramid_is_believed_where_it_is_wrong_and_a_verified_one_is_not():
    """With a wide cosError and many false stars, as on the right of SHEFEX figure 9."""
    rng, pairs, wrong = np.random.default_rng(7), shefex.flown_pairs(), {"published": 0, "verified": 0}
    published = replace(shefex.PYRAMID, acceptance="published", cosine_error=3e-4)
    for _ in range(60):
        field = shefex.draw_field(rng, n_false=14)
        u_c = shefex.directions(field, 0.2)
        flux = np.linspace(2.0, 1.0, len(u_c))
        for settings in (published, shefex.PYRAMID):
            found = pyramid.identify(settings, shefex.MODEL, pairs, u_c, flux)
            known = found.star >= 0
            is_right = np.array_equal(found.star[known], field.star[known])
            wrong[settings.acceptance] += found.reason == Reason.NONE and not is_right
    assert wrong["published"] > 5 and wrong["verified"] == 0


def test_a_reference_star_needs_two_others_and_no_other_star_four():
    """Three stars and a false one: with a bright star they are enough, without they are not."""
    stars = fields.pairs()[0].stars
    rng, pairs, counts = np.random.default_rng(3), fields.pairs()[0], {None: 0, 2.4: 0}
    tried = 0
    while tried < 25:
        field = fields.draw_field(rng, stars, least=4, n_false=0, is_round=False)
        real = field.star[:1]
        if field.flux[0] < 10.0 ** (-0.4 * 2.4) or stars.vmag[real[0]] > 3.0:
            continue
        tried += 1
        keep = [0, len(field.flux) - 2, len(field.flux) - 1]
        false = dcm_from_quat(np.array([1.0, 0.03, -0.04, 0.0]) / np.linalg.norm([1.0, 0.03, -0.04, 0.0]))[2]
        u_c = np.vstack([field.u_c[keep], false])
        flux = np.append(field.flux[keep], 0.5 * field.flux[keep[-1]])
        for reference in counts:
            settings = settings_of("brightness", "published", reference_magnitude=reference)
            found = brightness.identify(settings, CAMERA, pairs, u_c, flux)
            right = np.array_equal(found.star, np.append(field.star[keep], -1))
            counts[reference] += found.reason == Reason.NONE and right
    assert counts[None] == 0 and counts[2.4] >= 20


def test_the_reference_flux_is_that_of_the_magnitude_and_needs_a_zero_flux():
    settings = settings_of("brightness", "published", reference_magnitude=2.5)
    assert brightness.flux_of(settings, CAMERA._replace(zero_flux=1000.0)) == pytest.approx(100.0)
    assert brightness.flux_of(settings_of("brightness", "published"), CAMERA) == np.inf
    with pytest.raises(ValueError, match="zero_flux"):
        brightness.flux_of(settings, CAMERA._replace(zero_flux=np.nan))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"method": "bayes"}, "acceptance"),
        ({"acceptance": "verified", "fewest_stars": 3}, "fewest_stars"),
        ({"method": "voting", "cosine_error": 1e-5}, "cosine_error"),
        ({"acceptance": "verified", "cosine_error": 1e-5}, "cosine_error"),
        ({"method": "voting", "reference_magnitude": 2.0}, "reference_magnitude"),
    ],
)
def test_what_contradicts_itself_is_told_by_its_key(change, key):
    good = settings_of("pyramid", "published", tracking=False)
    assert contradiction(good) is None
    assert contradiction(replace(good, cosine_error=5.5e-5)) is None
    settings = replace(good, **change)
    assert contradiction(settings)[0] == key
    params = tracker.TrackerParams(
        replace(end_to_end.STAR_TRACKER, identification=settings), CAMERA, np.zeros(3)
    )
    with pytest.raises(ValueError, match="star identification: "):
        tracker.init(params, load_catalogue(8.0), 2012.5)


def test_each_chain_differs_from_the_default_in_nothing_but_the_star_tracker():
    for flight in flown.FLIGHTS:
        loaded = [scenario_of(name, *overrides) for name, overrides in flight.chains]
        same = [one.with_sections(star_tracker=None, mission=None) for one in loaded]
        assert same[0].star_camera == same[1].star_camera == same[2].star_camera
        assert same[0].programme == same[2].programme and same[0].imu == same[2].imu
        methods = [one.star_tracker.identification for one in loaded]
        assert [one.acceptance for one in methods] == ["published", "verified", "verified"]
        assert [one.method == "bayes" for one in methods] == [False, False, True]
        assert methods[2].tracking and loaded[2].star_tracker.detection.centroid == "fit"


def test_scatter_is_about_the_mean_of_a_flight():
    rng = np.random.default_rng(5)
    sigma = np.array([1e-5, 3e-5, 2e-4])
    errors = np.array([1e-3, -2e-3, 5e-3]) + sigma * rng.standard_normal((4000, 3))
    across, about = flown.scatter(errors)
    assert across == pytest.approx(np.sqrt(0.5 * (1e-10 + 9e-10)), rel=0.05)
    assert about == pytest.approx(2e-4, rel=0.05)
    assert np.isnan(flown.scatter(errors[:1])).all()


def test_a_flight_of_the_bright_scenario_is_solved_by_all_chains(monkeypatch):
    (flight,) = [one for one in flown.FLIGHTS if one.name == "bright_four_star"]
    monkeypatch.setattr(flown, "FLIGHTS", (flight._replace(end_s=35.0),))
    results = [flown.measure(1, np.random.SeedSequence(4))]
    frames, solved, wrong = results[0][0, 0, :, :3].T
    assert (frames >= 5).all() and (solved >= 4).all() and not wrong.any()
    rows = flown.conclude(results)
    of = {(row.quantity, row.condition): row for row in rows}
    assert of["success", "bright_four_star, default"].measured == 1.0
    assert of[flown.GOAL, "bright_four_star"].measured == 0.0


def test_a_wrong_attitude_of_the_default_chain_misses_the_goal():
    table = np.zeros((30, len(flown.FLIGHTS), len(flown.WAYS), len(flown.FIGURES)))
    table[..., 0], table[..., 1], table[..., 5] = 10.0, 9.0, 1e-3
    table[3, 0, -1, 2] = 1.0
    rows = {(row.quantity, row.condition): row for row in flown.conclude([table])}
    assert rows[flown.GOAL, "shefex2_as_flown"].verdict == "own goal missed"
    assert rows[flown.GOAL, "impa"].verdict == goal_none("", "", np.zeros(300, bool)).verdict
    assert rows["success", "impa, default"].measured == pytest.approx(0.9)


def test_what_all_flights_have_alike_is_known_to_their_number():
    """Three flights of 120 frames, all solved, none wrong: no interval without width, and no goal met."""
    table = np.zeros((3, len(flown.FLIGHTS), len(flown.WAYS), len(flown.FIGURES)))
    table[..., 0], table[..., 1], table[..., 5] = 120.0, 120.0, 1e-3
    rows = {(row.quantity, row.condition): row for row in flown.conclude([table])}
    assert rows["success", "impa, default"].ci95 == intervals.proportion(3, 3)
    assert rows["wrong attitudes", "impa, default"].ci95 == intervals.proportion(0, 3)
    goal = rows[flown.GOAL, "impa"]
    assert goal.verdict == "too few" and goal.ci95[1] == pytest.approx(360 * intervals.proportion(0, 3)[1])
