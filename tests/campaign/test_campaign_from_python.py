"""Campaigns flown and looked at from Python."""

import io
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool

import keeping
import numpy as np
import pytest
from rich.console import Console
from short_campaign import HereLane, write
from synthetic_campaign import write as write_synthetic

import shefex_nav
from shefex_nav.campaign import figures, from_python, over_time, results
from shefex_nav.campaign.engine import EngineError
from shefex_nav.campaign.running import BadCampaign
from shefex_nav.campaign.store import StoreError


def test_a_campaign_goes_on_where_it_was(tmp_path, monkeypatch):
    """The first run in a process of its own, what comes after in this one."""
    scenario, said = shefex_nav.Scenario.load(write(tmp_path)), []
    known = {"folder": tmp_path / "kept", "workers": 1, "say": said.append}
    first = shefex_nav.fly_campaign(scenario, 1, **known)
    assert len(first) == 1 and said
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    before = keeping.record(tmp_path / "kept", 0)
    both = shefex_nav.fly_campaign(scenario, 2, **known)
    assert len(both) == 2 and both.succeeded.all()
    assert keeping.record(tmp_path / "kept", 0) == before  # its timing too
    assert "short, seed 1, 2 of 2 runs, 2 flew to their end" in repr(both)
    with pytest.raises(StoreError, match="was flown with --seed 1, not 2"):
        shefex_nav.fly_campaign(scenario, 2, seed=2, **known)


@pytest.mark.parametrize(
    "wrong, says",
    [
        ({"runs": 0}, "runs: 0; expected a whole number, 1 or more"),
        ({"runs": 20.5}, "runs: 20.5; expected"),
        ({"workers": 0}, "workers: 0; expected a whole number, 1 or more"),
        ({"workers": -1}, "workers: -1; expected"),
        ({"workers": True}, "workers: True; expected"),
        ({"seed": -1}, "seed: -1; expected a whole number, 0 or more"),
        ({"engine": "here:8786"}, "'here:8786': expected dask://HOST:PORT"),
        ({"engine": "dask://here:8786", "workers": 2}, "the cluster has its own"),
        ({"keep": ["best:3"]}, "'best:3': expected worst:K, failed or none"),
    ],
)
def test_wrong_arguments_leave_everything_as_it_is(wrong, says, tmp_path):
    scenario, folder = shefex_nav.Scenario.load(write(tmp_path)), tmp_path / "kept"
    with pytest.raises(BadCampaign, match=says):
        shefex_nav.fly_campaign(scenario, **({"runs": 2, "folder": folder, "say": str} | wrong))
    assert not folder.exists()


def test_logs_are_kept_from_python_too(tmp_path, monkeypatch):
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", HereLane)
    scenario, folder = shefex_nav.Scenario.load(write(tmp_path)), tmp_path / "kept"
    shefex_nav.fly_campaign(scenario, 2, folder=folder, workers=1, keep=("worst:1",), say=str)
    assert len(list((folder / "logs").glob("*.mcap"))) == 1


def test_a_worker_flies_no_campaign(tmp_path, monkeypatch):
    monkeypatch.setattr(from_python.multiprocessing, "parent_process", lambda: object())
    with pytest.raises(BadCampaign, match="__main__"):
        shefex_nav.fly_campaign(shefex_nav.Scenario.load(write(tmp_path)), 1, folder=tmp_path / "kept")
    assert not (tmp_path / "kept").exists()


def test_an_interrupted_campaign_says_what_is_kept(tmp_path, monkeypatch):
    scenario, folder = shefex_nav.Scenario.load(write(tmp_path)), tmp_path / "kept"
    monkeypatch.setattr("shefex_nav.campaign.engine.fly", _interrupted)
    with pytest.raises(KeyboardInterrupt, match="0 of 3 runs are kept; the same call goes on"):
        shefex_nav.fly_campaign(scenario, 3, folder=folder, workers=1, say=str)


class Deadly(HereLane):
    """Its worker dies of the first run."""

    def submit(self, job):
        future = super().submit(job)
        if job.run == 0:
            future = type(future)()
            future.set_exception(BrokenProcessPool("a child process terminated abruptly"))
        return future


def test_runs_that_were_lost_are_not_passed_over(tmp_path, monkeypatch):
    """The figures of what came back are of fewer runs than were asked for."""
    monkeypatch.setattr("shefex_nav.campaign.engine.ProcessLane", Deadly)
    scenario, said = shefex_nav.Scenario.load(write(tmp_path)), []
    known = {"folder": tmp_path / "kept", "workers": 1, "say": said.append}
    with pytest.warns(UserWarning, match=r"1 of 2 runs were lost .* every figure is of the 1 others"):
        campaign = shefex_nav.fly_campaign(scenario, 2, **known)
    assert campaign.runs.tolist() == [1] and list(campaign.lost) == [0]
    assert any(line.startswith("run 0 was lost") for line in said)
    known["folder"] = tmp_path / "all"
    with pytest.raises(EngineError, match=r"1 of 1 runs were lost .*; run 0: its worker was killed, in each"):
        shefex_nav.fly_campaign(scenario, 1, **known)


def test_the_table_needs_no_command_line(tmp_path):
    """A library that shows its results in a notebook does not load what reads a command line."""
    folder = write_synthetic(tmp_path / "made", 3, with_series=False)
    code = "shefex_nav.open_campaign(sys.argv[1]).table(); sys.exit('typer' in sys.modules)"
    subprocess.run([sys.executable, "-c", f"import sys, shefex_nav; {code}", str(folder)], check=True)


def _interrupted(*_):
    from shefex_nav.campaign.engine import Interrupted

    raise Interrupted


def test_pictures_by_name_and_the_table(tmp_path):
    campaign = shefex_nav.open_campaign(write_synthetic(tmp_path / "made", 60))
    assert dir(campaign.plot) == sorted(figures.NAMES)
    r2 = [
        float(axes.get_title("left").split("R² ")[1].split()[0]) for axes in campaign.plot.sensitivity().axes
    ]
    assert r2 == sorted(r2, reverse=True) and len(r2) > 1  # the best explained result is not cut off
    assert len(campaign.plot.errors().axes) == 9
    with pytest.raises(AttributeError, match="choose from errors, nees"):
        campaign.plot.nothing()
    said = [text.get_text() for text in campaign.plot.errors().legends[0].get_texts()]
    assert "median" in said and "each run" not in said  # of sixty runs
    console = Console(width=150, record=True, file=io.StringIO())
    console.print(campaign.table())
    assert "Requirements" in console.export_text() and hasattr(campaign.table(), "_repr_mimebundle_")
    bare = shefex_nav.open_campaign(write_synthetic(tmp_path / "bare", 3, with_series=False))
    assert isinstance(bare, results.Campaign)
    with pytest.raises(LookupError, match="no run that flew to its end has a series over time"):
        bare.plot.errors()


def test_a_campaign_without_dispersions_says_why_nothing_explains_it(tmp_path, monkeypatch):
    campaign = shefex_nav.open_campaign(write_synthetic(tmp_path / "campaign", 12))
    monkeypatch.setattr(results.Campaign, "draws", campaign.columns.beginning("of nothing."))
    assert "sensitivity" not in dir(campaign.plot) and "errors" in dir(campaign.plot)
    with pytest.raises(LookupError, match=r"'sensitivity': the scenario has no dispersions"):
        campaign.plot.sensitivity()
    assert "each run" in [text.get_text() for text in campaign.plot.errors().legends[0].get_texts()]


def test_the_mean_of_squares_ends_where_half_of_the_runs_have_landed(tmp_path):
    series = over_time.read(shefex_nav.open_campaign(write_synthetic(tmp_path / "campaign", 12)))
    T = len(series.t_s)
    few, half = np.s_[:7, T - 5 :], np.s_[:6, T - 10 :]  # 5 of 12 fly the last five epochs, 6 the five before
    for landed in (half, few):
        series.phase[landed], series.nees[landed] = -1, np.nan
    line = figures.draw_nees(series).axes[0].lines[0]
    assert line.get_xdata()[-1] == series.t_s[T - 6]


@pytest.mark.filterwarnings("error")
def test_software_that_says_little_of_its_errors_has_pictures_too(tmp_path):
    """Of no biases, or of nothing at all."""
    series = over_time.read(shefex_nav.open_campaign(write_synthetic(tmp_path / "campaign", 12)))
    whole = len(figures.draw_nees(series).axes)
    series.sigmas[:, :, 3:], series.nees[:, :, 3:] = np.nan, np.nan
    assert len(figures.draw_nees(series).axes) == whole - 2
    assert len(figures.draw_errors(series).axes) == 9 and len(figures.draw_containment(series).axes) == 3
    series.sigmas[:], series.nees[:] = np.nan, np.nan
    mute = series._replace(nis_sum={}, nis_dof={})
    assert figures.draw_nees(mute) is None
    assert len(figures.draw_errors(mute).axes) == 9 and figures.draw_containment(mute) is None


def test_the_scale_of_errors_is_told_where_it_has_decades(tmp_path):
    series = over_time.read(shefex_nav.open_campaign(write_synthetic(tmp_path / "campaign", 12)))
    first = series.t_s < series.t_s[len(series.t_s) // 4]
    series.errors[:, first] *= 100.0
    series.sigmas[:, first] *= 100.0
    figure = figures.draw_errors(series)
    assert any("linear between the dotted lines" in text.get_text() for text in figure.legends[0].get_texts())
    axes = figure.axes[0]
    dotted = sorted(line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":")
    ends = axes.yaxis.get_transform().linthresh
    np.testing.assert_allclose(dotted, [-ends, ends])
