"""Runs from Python: flown here or read from a log, they are the same object."""

import copy
import pickle

import numpy as np
import pytest

import shefex_nav
from shefex_nav import runs
from shefex_nav.records import Event, Reason
from shefex_nav.report import figures
from shefex_nav.scenario.load import ScenarioError
from shefex_nav.solve.names import name_of

BRIEF = {"mission.time_limit": "4 s", "star_tracker.off": "4 s"}


@pytest.fixture(scope="module")
def sky(default_scenario):
    """Three seconds of the camera under the night sky."""
    scenario = shefex_nav.Scenario.load(default_scenario.with_name("night_sky.yaml"), BRIEF)
    return shefex_nav.fly(scenario, seed=3)


def test_a_flown_run_reads_back_as_itself(sky):
    again = shefex_nav.open_run(sky.log)
    mine, read = sky.errors(), again.errors()
    for a, b in zip(mine, read, strict=True):
        assert np.array_equal(a, b)
    assert again.summary() == sky.summary()
    assert len(again.frames) == len(sky.frames)


def test_errors_are_truth_minus_solution_with_the_sigmas_of_the_log(sky):
    errors = sky.errors()
    assert len(errors.t_s) > 200
    assert np.allclose(errors.position_i, sky.truth.r_i - sky.solution.r_i, atol=1e-9)
    k = 20
    assert errors.sigma_attitude_b[k] == pytest.approx(np.sqrt(np.diag(sky.data.covariance.P[k])[6:]))


def test_errors_at_an_instant_are_those_of_the_nearest_tick(sky):
    errors, now = sky.errors(), sky.errors().at(1.004)
    k, j = np.argmin(np.abs(errors.t_s - 1.004)), np.argmin(np.abs(errors.sigma_t_s - 1.004))
    assert now.t_s == errors.t_s[k] and abs(now.t_s - 1.004) <= 0.0051
    assert np.array_equal(now.attitude_b, errors.attitude_b[k])
    assert np.array_equal(now.sigma_position_i, errors.sigma_position_i[j])
    for t_s in (100.0, np.nan):
        with pytest.raises(LookupError, match=r"no errors at .*the run has them for T"):
            errors.at(t_s)


def test_an_event_is_found_by_its_name(sky):
    with pytest.raises(LookupError, match="no event 'apogee'; the run has: none"):
        sky.event("apogee")
    first, second = Event(1.0, "entry", 100e3, ""), Event(2.0, "entry", 99e3, "")
    run = runs.Run(sky.data._replace(events=[first, second]), sky.log)
    assert run.event("entry") is first
    with pytest.raises(LookupError, match="the run has: entry"):
        run.event("impact")


def test_a_flight_can_be_looked_at_up_to_a_time(default_scenario, sky):
    scenario = shefex_nav.Scenario.load(default_scenario.with_name("night_sky.yaml"), BRIEF)
    part = shefex_nav.fly(scenario, seed=3, until_s=1.0)
    assert part.truth.t_s[-1] == pytest.approx(1.0)
    n = len(part.truth.t_s)
    assert np.array_equal(part.solution.q_ib, sky.solution.q_ib[:n])
    again = shefex_nav.open_run(part.log)
    assert not again.data.ended_early
    assert part.data.until_s == again.data.until_s == again.summary()["until_s"] == 1.0
    assert "looked at until T+1.0 s" in repr(part)
    labels, words = (list(again.table().columns[k].cells) for k in (1, 2))
    assert str(words[labels.index("looked at")]).startswith("until T+1.0 s")
    whole = shefex_nav.fly(scenario, seed=3, until_s=None)
    assert whole.data.until_s is None and len(whole.truth.t_s) == len(sky.truth.t_s)
    assert sky.data.until_s is None and sky.summary()["until_s"] is None
    assert "looked at" not in list(sky.table().columns[1].cells)


def test_a_frame_is_found_by_its_time_and_shows_its_stars(sky):
    frames = list(sky.frames)
    assert len(frames) == len(sky.frames) > 20
    frame = sky.frames[2.0]
    assert abs(frame.t_s - 2.0) <= 0.06
    assert frame.image_dn.shape == (493, 659)
    good = [f for f in frames if f.fix.reason == Reason.NONE]
    assert good
    x, y = np.round(good[-1].fix.detections.xy_px[0]).astype(int)
    assert good[-1].image_dn[y, x] > 3 * max(1.0, np.median(good[-1].image_dn))
    with pytest.raises(LookupError, match=r"T\+100\.0 s.*the run has them for"):
        sky.frames[100.0]


def test_a_temporary_log_goes_with_its_run_and_can_be_saved(default_scenario, tmp_path):
    short = {"mission.time_limit": "2 s", "star_tracker.off": "2 s", "star_tracker.enabled": "false"}
    scenario = shefex_nav.Scenario.load(default_scenario.with_name("night_sky.yaml"), short)
    run = shefex_nav.fly(scenario)
    kept = run.save(tmp_path / "kept.mcap")
    with pytest.raises(FileExistsError):
        run.save(kept)
    assert "not saved" in repr(run) and str(run.log) not in repr(run)
    assert str(kept) in repr(shefex_nav.open_run(kept))
    assert not any(str(run.log) in str(cell) for column in run.table().columns for cell in column.cells)
    temporary = run.log
    assert temporary.exists()
    del run
    assert not temporary.exists()
    assert shefex_nav.open_run(kept).data.summary is not None


def test_every_figure_can_be_asked_for_by_its_name(sky):
    assert {"attitude", "trajectory", "sky_map"} <= set(dir(sky.plot))
    figure = sky.plot.attitude()
    assert len(figure.axes) >= 3
    with pytest.raises(AttributeError, match="no figure 'nothing'; choose from"):
        sky.plot.nothing()
    blind = runs.Run(sky.data._replace(star_fixes=[]), sky.log)
    with pytest.raises(LookupError, match="nothing to draw for 'star_errors'"):
        blind.plot.star_errors()


def test_a_frame_is_drawn_with_what_was_found_in_it(sky):
    frame = [one for one in sky.frames if one.fix.reason == Reason.NONE][-1]
    axes = frame.plot().axes[0]
    rings = {line.get_label(): line.get_xydata() for line in axes.lines}
    named = frame.fix.hip > 0
    assert np.array_equal(rings[f"{named.sum()} identified"], frame.fix.detections.xy_px[named])
    assert np.array_equal(rings[f"{(~named).sum()} other objects"], frame.fix.detections.xy_px[~named])
    assert len(axes.texts) == named.sum()
    shown = np.asarray(axes.images[0].get_array())
    assert shown.min() >= 0.0 and shown.max() == 1.0 and np.median(shown) < 0.3
    white = frame._replace(image_dn=np.full_like(frame.image_dn, 255), fix=None)
    assert white.plot().axes[0].images[0].get_array().min() == 1.0
    with pytest.raises(LookupError, match=r"no pixels of frame .*log\.frames"):
        frame._replace(image_dn=None).plot()


def test_a_run_is_seen_at_a_glance(sky):
    seen = sky.frames.middle()
    assert seen.fix.reason == Reason.NONE and seen.image_dn is not None
    camera, flight, *attitude = sky.glance().axes
    assert {text.get_text() for text in camera.texts} <= {
        name_of(hip) for hip in seen.fix.hip[seen.fix.hip > 0]
    }
    assert f"{(seen.fix.hip > 0).sum()} stars identified" in camera.get_title(loc="left")
    assert len(flight.lines) >= 2 and len(attitude) == 3
    errors = sky.errors()
    for k, axes in enumerate(attitude):
        drawn = next(line for line in axes.lines if line.get_label() != "_edges").get_ydata()
        assert np.isin(np.float32(drawn), np.float32(np.degrees(errors.attitude_b[:, k]))).all()
    blind = runs.Run(sky.data._replace(star_fixes=[]), sky.log)
    with pytest.raises(LookupError, match="no frame gave an attitude; name the time of one"):
        blind.glance()
    assert len(blind.glance(2.0).axes[0].texts) == 0
    truth = sky.data.truth
    for t_s in (None, 2.0):
        unknown = runs.Run(sky.data._replace(truth=type(truth)(*(column[:0] for column in truth))), sky.log)
        with pytest.raises(LookupError, match="has no truth"):
            unknown.glance(t_s)


def test_a_glance_without_pixels_names_the_key_that_keeps_them(default_scenario):
    keep_none = {"log.frames.full_every": "0", "log.frames.otherwise": "none"}
    scenario = shefex_nav.Scenario.load(default_scenario.with_name("night_sky.yaml"), BRIEF | keep_none)
    run = shefex_nav.fly(scenario, seed=3)
    for t_s, which in ((None, "the frames"), (2.0, r"the frame of T\+2\.\d s")):
        with pytest.raises(LookupError, match=f"keeps no pixels of {which}; log.frames of the scenario says"):
            run.glance(t_s)


def test_figures_are_pictures_in_a_notebook(sky):
    assert sky.plot.attitude()._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(AttributeError):
        sky.plot._repr_html_()


def test_figures_and_their_names_can_be_copied(sky):
    figure = sky.plot.attitude()
    again = pickle.loads(pickle.dumps(figure))
    assert again._repr_png_() == figure._repr_png_()
    for same in (copy.copy(sky.plot), copy.deepcopy(figures.Plots(["one"], len))):
        assert dir(same)
        with pytest.raises(AttributeError, match="choose from"):
            same.nothing()
    unborn = figures.Plots.__new__(figures.Plots)
    with pytest.raises(AttributeError):
        unborn._names  # noqa: B018


def test_changes_need_not_be_texts(default_scenario):
    changes = {
        "star_tracker.enabled": False,
        "requirements.star_fixes": None,
        "earth.gravity_degree": 4,
        "dispersions": {"launch.elevation": {"uniform": ["-1 deg", "1 deg"]}},
        "gps.latency": "0.1 s",
    }
    scenario = shefex_nav.Scenario.load(default_scenario, changes)
    assert scenario.star_tracker.enabled is False and scenario.requirements.star_fixes is None
    assert scenario.earth.gravity_degree == 4 and scenario.gps.latency == 0.1
    assert list(scenario.dispersions) == ["launch.elevation"]


def test_changes_may_be_of_numpy(default_scenario):
    changes = {
        "earth.gravity_degree": np.int64(4),
        "gps.antenna.lever_arm": np.array(["1 m", "0 m", "0.1 m"]),
    }
    scenario = shefex_nav.Scenario.load(default_scenario, changes)
    assert scenario.earth.gravity_degree == 4
    assert list(scenario.gps.antenna.lever_arm) == [1.0, 0.0, 0.1]


def test_changes_that_are_no_values_are_all_named(default_scenario):
    changes = {"earth.gravity_degree": np.inf, "gps.latency": object(), "gps.rate": "5 Hz"}
    with pytest.raises(ScenarioError) as told:
        shefex_nav.Scenario.load(default_scenario, changes)
    message = str(told.value)
    assert "earth.gravity_degree: inf cannot stand" in message and "gps.latency: <object" in message
    assert "gps.rate" not in message


def test_a_bad_override_is_refused(default_scenario):
    with pytest.raises(ScenarioError, match="unit"):
        shefex_nav.Scenario.load(default_scenario, {"star_tracker.latency": "0.03"})


def test_a_scenario_is_flown_by_its_name_too():
    by_name = shefex_nav.fly("night_sky", seed=3, until_s=0.5)
    loaded = shefex_nav.fly(shefex_nav.Scenario.load("night_sky"), seed=3, until_s=0.5)
    assert np.array_equal(by_name.imu.dtheta_b, loaded.imu.dtheta_b)
    with pytest.raises(ScenarioError, match="nowhere"):
        shefex_nav.fly("nowhere.yaml")


def test_a_notebook_shows_the_closing_table(sky):
    shown = sky._repr_mimebundle_()
    assert shown["text/plain"] == repr(sky) and "attitude" in shown["text/html"]


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"scenario": 7}, "path of one or the name"),
        ({"seed": 1.5}, "whole number"),
        ({"seed": -1}, "whole number"),
        ({"seed": 10**30}, "30 digits at most, which a log can say"),
        ({"until_s": -50.0}, "after the start"),
        ({"until_s": "5 s"}, "until_s '5 s': expected a time"),
        ({"until_s": float("nan")}, "after the start"),
    ],
)
def test_what_cannot_be_flown_is_told_in_words(default_scenario, how, words):
    given = {"scenario": shefex_nav.Scenario.load(default_scenario)} | how
    with pytest.raises((TypeError, ValueError), match=words):
        shefex_nav.fly(**given)
