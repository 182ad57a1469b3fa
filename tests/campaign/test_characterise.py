"""The fit finds what synthetic runs were drawn from, and the judgement notices what does not agree."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

from shefex_nav import statistical
from shefex_nav.campaign.characterise import fit, flying, judge, model, running
from shefex_nav.campaign.characterise.collect import Collected, Frames, Searches, Sources
from shefex_nav.records import Reason
from shefex_nav.scenario.load import load
from shefex_nav.scenario.star_statistics import StarStatistics
from shefex_nav.world.camera import sightings

DEFAULT = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
NOISE, REPORTED = np.array([4e-4, 1.6, 1.3, 0.01]), np.array([1e-4, 1.4, 1.5, 0.003])
DETECTION, CLUTTER = np.array([-0.2, 0.8, 0.5]), np.array([0.3, 1.5])
MAX_RATE, FULL_DN, WRONG = 0.04, 255.0, np.radians(0.5)


def run(seed, frames=150, stars=12, noise_factor=1.0, focus=0.8):
    """A synthetic run: stars that stay in the field, with errors of the variances above."""
    rng = np.random.default_rng(seed)
    n = frames * stars
    frame = np.repeat(np.arange(frames), stars)
    electrons = np.tile(np.exp(rng.uniform(np.log(150.0), np.log(3e4), stars)), frames)
    along = np.repeat(focus * rng.uniform(1.0, 2.5, frames), stars)
    t_along, t_across, features = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 3))
    for k in range(n):
        t_along[k], t_across[k] = sightings.terms(along[k], focus, electrons[k], 17.0)
        features[k] = sightings.features(along[k], focus, electrons[k], 17.0, 5.5)
    q = sightings.contrast(along, focus, electrons, 17.0)
    found = rng.random(n) < ndtr(features @ DETECTION)
    length_px = rng.uniform(0.0, 40.0, frames)
    strangers = rng.poisson(CLUTTER[0] + CLUTTER[1] * sightings.broken(length_px))
    error = noise_factor * rng.standard_normal((n, 2))
    error *= np.sqrt(np.stack([t_along @ NOISE, t_across @ NOISE], axis=1))
    peak = electrons / (2.0 * np.pi * along * focus)
    sources = Sources(
        frame=frame,
        hip=np.tile(np.arange(1, stars + 1), frames),
        q=q,
        features=features,
        along=t_along,
        across=t_across,
        peak=peak,
        border_px=rng.uniform(20.0, 200.0, n),
        clear=np.ones(n, dtype=bool),
        found=found,
        named=found,
        saturated=peak > 2500.0,
        error=np.where(found[:, None], error, np.nan),
        reported=np.stack([t_along @ REPORTED, t_across @ REPORTED], axis=1),
    )
    ones = np.ones(frames)
    return Collected(
        Frames(
            t_s=0.1 * np.arange(frames), rate=0.03 * ones, exposure_s=0.05 * ones,
            reason=np.zeros(frames, dtype=int), first=ones < 0,
            stars=np.bincount(frame[found], minlength=frames), mean_dn=0.2 * ones, level_dn=20.0 * ones,
            length_px=length_px, objects=np.bincount(frame[found], minlength=frames) + strangers,
            strangers=strangers,
            error=1e-5 * noise_factor * rng.standard_normal((frames, 3)),
            sigma=1e-5 * np.ones((frames, 3)),
        ),
        sources,
        searches(rng, 400),
    )  # fmt: skip


def searches(rng, n):
    """Searches of which 3 stars are enough half of the time, 5 always; one in ten of the few is wrong."""
    stars = rng.integers(1, 9, n)
    first = rng.random(n) < 0.2
    matched = rng.random(n) < np.select([stars < 3, stars < 5], [0.0, 0.5], 1.0)
    good = matched & (rng.random(n) < 0.9)  # the rest is thrown out by what they do not fit
    error = 1e-5 * rng.standard_normal((n, 3))
    error[(stars < 5) & (rng.random(n) < 0.1)] += 0.2
    error[~good] = np.nan
    return Searches(stars, first, matched, good, error)


@pytest.fixture(scope="module")
def runs():
    return [run(seed, 500, focus=focus) for seed, focus in enumerate((0.55, 0.65, 0.8, 1.0))]


def test_fit_finds_the_parameters_of_synthetic_runs(runs):
    found = fit.sightings(runs, MAX_RATE, FULL_DN)
    np.testing.assert_allclose(found.reported, REPORTED, rtol=1e-6)
    # about 30000 errors: 0.8 % of a variance; the parts are less certain than their sum
    np.testing.assert_allclose(found.noise, NOISE, rtol=0.3)
    for electrons, focus in ((300.0, 0.8), (1000.0, 0.55), (10_000.0, 1.0)):
        parts, _ = sightings.terms(1.2, focus, electrons, 17.0)
        np.testing.assert_allclose(found.noise @ parts, NOISE @ parts, rtol=0.08)
    np.testing.assert_allclose(found.detection, DETECTION, rtol=0.15, atol=0.1)
    # 2000 frames of 1.3 strangers each: a tenth is five of their standard deviations
    assert sightings.broken(np.array([0.0, 10.0, 99.0])).tolist() == [0.0, 0.25, 1.0]
    np.testing.assert_allclose(found.clutter, CLUTTER, rtol=0.1, atol=0.12)
    assert found.saturation_electrons == pytest.approx(2500.0, rel=0.1)
    assert found.mean_offset_dn == pytest.approx(0.2)
    assert found.border_px == 0.0


def test_a_centroid_that_is_another_objects_light_does_not_move_the_fit(runs):
    wild = [one._replace(sources=one.sources._replace(error=one.sources.error.copy())) for one in runs]
    rng = np.random.default_rng(3)
    for one in wild:
        rows = rng.choice(len(one.sources.q), 10, replace=False)
        one.sources.error[rows] = 2.0
    a, b = fit.sightings(runs, MAX_RATE, FULL_DN).noise, fit.sightings(wild, MAX_RATE, FULL_DN).noise
    np.testing.assert_allclose(a, b, rtol=0.05, atol=1e-5)


def test_table_of_identification_has_the_shares_that_were_drawn(runs):
    found = fit.identification(runs, MAX_RATE, WRONG)
    expected = {1: 0.0, 2: 0.0, 3: 0.5, 4: 0.5, 5: 1.0, 6: 1.0, 7: 1.0, 8: 1.0}
    assert found.stars.tolist() == list(expected)
    n = 1600 / 8 * 0.8
    for stars, first, later, wrong in zip(*found[:4], strict=True):
        share = expected[stars]
        assert abs(later - share) < 4.5 * np.sqrt(share * (1.0 - share) / n) + 1e-12
        assert abs(first - share) < 4.5 * np.sqrt(share * (1.0 - share) / (n / 4)) + 1e-12
        assert (wrong > 0.0) == (stars in (3, 4))
    assert len(found.wrong_turns) and np.linalg.norm(found.wrong_turns, axis=1).min() > WRONG
    assert found.named == 1.0
    assert found.fastest == pytest.approx(fit.REACH * 0.03)  # far below the 0.04 that the tracker takes
    assert fit.identification(runs, 0.031, WRONG).fastest == 0.031


def test_threshold_and_limits_of_the_fit():
    value = np.array([5.0, 1.0, 3.0, 2.0, 4.0])
    assert fit.threshold(value, value > 2.5) == 2.5
    assert fit.threshold(value, value > 9.0) == np.inf
    assert fit.threshold(value, value > 0.0) <= 1.0
    with pytest.raises(fit.FitError, match="no limit of detection"):
        fit.chances(np.ones((2, 3)), np.array([True, True]))
    z = np.linspace(-3.0, 6.0, 200)
    separable = fit.chances(np.column_stack([np.ones(200), z, 0.0 * z]), z > 1.0)
    assert -separable[0] / separable[1] == pytest.approx(1.0, abs=0.05)
    assert fit.clutter(np.zeros(0), np.zeros(0)).tolist() == [0.0, 0.0]


def test_judgement_passes_what_agrees_and_notices_what_does_not(runs):
    fitted = fit.sightings(runs, MAX_RATE, FULL_DN)
    seeds = range(11, 19)
    fresh = [run(seed) for seed in seeds]
    assert all(test.good for test in judge.centroids(fresh, fitted, MAX_RATE))
    noisy = [run(seed, noise_factor=1.3) for seed in seeds]
    assert sum(test.verdict == judge.OUTSIDE for test in judge.centroids(noisy, fitted, MAX_RATE)) == 2
    lasting = [one._replace(sources=one.sources._replace(error=_lasting(one.sources))) for one in fresh]
    wrong = [test for test in judge.centroids(lasting, fitted, MAX_RATE) if not test.good]
    assert [test.what for test in wrong] == ["correlation of a star's error from frame to frame"]

    one, other = [[judge.of_frames(part.frames) for part in group] for group in (fresh, noisy)]
    (few,) = [test for test in judge.fixes(one, one, WRONG) if not test.good]
    assert few.what.startswith("wrong attitudes: 0 rendered, 0 stat") and few.verdict == judge.TOO_FEW
    assert few.reach == pytest.approx(0.31, abs=0.005)  # per cent: none of 1200 frames, 3.7 / n
    one, other = 4 * one, 4 * other
    assert all(test.good for test in judge.fixes(one, one, WRONG))
    assert {test.what for test in judge.fixes(one, other, WRONG) if not test.good} == {
        "scatter of attitudes across the boresight, statistical over rendered",
        "scatter of attitudes about the boresight, statistical over rendered",
    }
    lost = [part._replace(reason=np.where(np.arange(150) < 6, Reason.NO_MATCH, part.reason)) for part in one]
    assert sum(not test.good for test in judge.fixes(one, lost, WRONG)) == 2  # fewer fixes, another reason


def test_standard_errors_over_runs_are_those_of_the_mean_and_cover_runs_that_differ():
    """Of a mean the jackknife is s / sqrt(n); of a ratio it is what repeating all of it shows."""
    rng = np.random.default_rng(8)
    values = rng.normal(1.0, 0.1, 12)

    def mean(kept):
        return [judge.Test("mean", values[kept].mean(), 0.8, 1.2, 1000 * len(kept))]

    (test,) = judge.with_errors(mean, 12)
    assert test.error == pytest.approx(values.std(ddof=1) / np.sqrt(12), rel=1e-9) and test.runs == 12
    # exposures that a few frames set for a whole run: 35 or 50 ms, at random in either kind of picture
    errors, ratios = [], []
    for _ in range(200):
        group = [[_with_exposure(rng.choice([0.035, 0.050])) for _ in range(8)] for _ in range(2)]
        test = next(one for one in judge.fixes(*group, WRONG) if one.what.startswith("mean exposure"))
        errors.append(test.error)
        ratios.append(test.value)
    # 200 ratios: their scatter is known to 5 %, and the mean square of the errors to about as much
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.std(ratios), rel=0.2)
    assert test.verdict == judge.TOO_FEW and not test.good


def _with_exposure(exposure_s, frames=50):
    ones = np.ones(frames)
    error = np.random.default_rng(0).normal(0.0, 1e-5, (frames, 3))
    return judge.Fixes(0 * ones.astype(int), exposure_s * ones, 9 * ones, error, 1e-5 * np.ones((frames, 3)))


@pytest.mark.parametrize(
    ("value", "error", "verdict", "deciding"),
    [
        (1.0, 0.01, judge.INSIDE, None),
        (1.049, 0.01, judge.INSIDE, None),
        (1.0, 0.03, judge.TOO_FEW, 17),  # 2.262 * 0.03 of 0.05, of ten runs: 18.4 or so many with their t
        (1.06, 0.01, judge.TOO_FEW, None),
        (1.08, 0.01, judge.OUTSIDE, None),
        (0.92, 0.01, judge.OUTSIDE, None),
        (0.92, np.nan, judge.TOO_FEW, None),
        (np.nan, 0.01, judge.OUTSIDE, None),
    ],
)
def test_a_figure_is_inside_or_outside_only_if_chance_does_not_reach_so_far(value, error, verdict, deciding):
    test = judge.Test("x", value, 0.95, 1.05, 100, error, 10)
    assert test.verdict == verdict and test.good == (verdict == judge.INSIDE)
    if deciding:
        again = test._replace(error=error * np.sqrt(10 / test.deciding), runs=test.deciding)
        assert abs(test.deciding - deciding) <= 2 and again.verdict == judge.INSIDE
    elif verdict != judge.TOO_FEW:
        assert test.deciding is None
    none = judge.Test("x", 0.0, -0.1, 0.1, 2950, 0.0, 5, least=0.125)  # in n frames: goes with 1/n
    assert (none.verdict, none.deciding) == (judge.TOO_FEW, 7)
    assert judge.Test("x", 0.0, 0.0, 0.0, 3).good and not judge.Test("x", 1.0, 0.0, 0.0, 3).good


def test_nothing_to_judge_is_not_good_and_can_be_written(runs):
    """Runs without a fix, or without a star that the fit speaks of: figures that are no numbers."""
    fitted = fit.sightings(runs, MAX_RATE, FULL_DN)
    lost = [part._replace(reason=0 * part.reason + Reason.NO_MATCH, error=np.nan * part.error) for part in
            (judge.of_frames(one.frames) for one in runs)]  # fmt: skip
    blind = runs[0]._replace(sources=runs[0].sources._replace(found=runs[0].sources.found & False))
    tests = judge.fixes(lost, lost, WRONG) + judge.centroids([blind], fitted, MAX_RATE)
    none = [test for test in tests if np.isnan(test.value)]
    assert any("from frame to frame" in test.what for test in none)  # of no pair it was 0, within its limits
    assert len(none) >= 8 and not any(test.good for test in none)
    content = model.with_tests({}, [judge.flown_all(3, []), *tests])
    again = json.loads(model.text(content))["tests"]
    assert again[0]["good"] and again[1]["value"] is None
    failed = judge.flown_all(3, [flying.Failed(7, "OutsideModelError: too fast")])
    assert not failed.good and "too fast" in failed.what


def _lasting(sources):
    """The same errors with a part that each star keeps: half of the variance."""
    sigma = np.sqrt(np.stack([sources.along @ NOISE, sources.across @ NOISE], axis=1))
    kept = np.random.default_rng(5).standard_normal((40, 2))[sources.hip]
    kept /= np.sqrt((kept**2).mean(axis=0))
    return np.sqrt(0.5) * (sources.error + sigma * kept)


def test_ranges_of_dispersed_settings():
    runs = [{"a": 1.0, "b": "x", "c": 2.0}, {"a": 1.0, "b": "x", "c": 4.0}, {"a": 1.0, "b": "x", "c": 3.0}]
    assert running.spans(runs) == {"c": (2.0, 4.0)}


def test_the_file_is_a_section_of_a_scenario(runs):
    """Written, read and turned into parameters again, to the digits that are kept."""
    scenario = load(DEFAULT)
    found = fit.sightings(runs, MAX_RATE, FULL_DN), fit.identification(runs, MAX_RATE, WRONG)
    tests = judge.centroids(runs, found[0], MAX_RATE)
    content = model.with_tests(model.section(scenario, *found, {"runs": 4}), tests)
    read = StarStatistics.model_validate(json.loads(model.text(content)))
    again = statistical.models(SimpleNamespace(star_tracker=SimpleNamespace(model=read)))
    for one, other in zip(found, again, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_allclose(b, a, rtol=1e-3)
    assert read.made["scenario"] == "shefex2_andoya" and len(read.tests) == len(tests)
