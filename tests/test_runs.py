"""Runs from Python: flown here or read from a log, they are the same object."""

import numpy as np
import pytest

import shefex_nav
from shefex_nav.records import Reason
from shefex_nav.scenario.load import ScenarioError

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


def test_a_bad_override_is_refused(default_scenario):
    with pytest.raises(ScenarioError, match="unit"):
        shefex_nav.Scenario.load(default_scenario, {"star_tracker.latency": "0.03"})
