"""A truth of a part of a flight, such as a track of radar beside a replay, does not end the flight."""

import numpy as np
import pytest
import synthetic_run
from made_up import gathered

from shefex_nav import records as rec
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.report import figures, geography, local_level, metrics, pairing
from shefex_nav.report.figures import flown, style
from shefex_nav.report.table import rows
from shefex_nav.report.track import earth_fixed
from shefex_nav.report.viewer import world

OPTIONS = synthetic_run.Options(start_s=228.0, end_s=258.0, frame_pixels=False)
TRUE_UNTIL_S = 238.0


@pytest.fixture(scope="module")
def whole():
    return gathered(OPTIONS)


@pytest.fixture(scope="module")
def part(whole):
    known = whole.truth.t_s <= TRUE_UNTIL_S
    start = rec.Event(228.0, local_level.REPLAY_START, 1e5, "csv data")
    truth = whole.truth._make(np.asarray(values)[known] for values in whole.truth)
    return whole._replace(truth=truth, events=[start], star_fixes=[], frame_truths=[], control=_none(whole))


def _none(whole):
    return RunDataBuilder(whole.mission).build().control


def test_a_truth_to_the_end_is_that_of_the_flight(whole):
    assert not pairing.is_partly_true(whole)
    assert metrics.summarise(whole)["flight"]["of"] == "truth" and flown.path(whole).name == "truth"


def test_the_flight_goes_on_where_the_truth_ends(part):
    summary = metrics.summarise(part)
    height = earth_fixed(part.mission.earth, part.nav).height
    assert summary["simulated_s"] == pytest.approx(30.0, abs=0.05)
    assert summary["flight"]["height_km"]["max"] == pytest.approx(height.max() / 1e3)
    assert summary["flight"]["climbs_at_km"] in (None, pytest.approx(height[-1] / 1e3))
    shown = {name: str(value) for _, lines in rows(summary) for name, value in lines}
    assert shown["as estimated"] == "the truth is of T+228.0 to +238.0 s alone"
    assert shown["navigated"].startswith("30.0 s")


def test_errors_are_of_the_part_with_truth(part):
    assert metrics.summarise(part)["navigation"]["position_error_m"]["rms"] is not None


def test_figures_and_viewer_show_the_whole_time(part):
    assert style.whole(part) == pytest.approx((228.0, 258.0), abs=0.05)
    assert world.time_span(part) == pytest.approx((228.0, 258.0), abs=0.05)
    assert flown.path(part).name == "estimate"
    axes = figures.draw("imu", part).axes
    assert max(one.get_xlim()[1] for one in axes) == pytest.approx(258.0, abs=0.05)
    lines, _ = geography.lines_and_places(part)
    assert [line.name for line in lines] == ["truth", "estimate"]
    assert len(lines[0].points) < len(lines[1].points)


def test_recorded_data_have_no_phases(whole, part):
    """The truth of a replay is all 'coast', that of a rocket on its pad, too."""
    assert len(figures.draw("imu", whole).axes) == len(figures.draw("imu", part).axes) + 1
    recorded = whole._replace(events=part.events)
    path = figures.draw("trajectory", recorded).axes[0]
    assert path.get_legend() is None


def test_what_recorded_data_do_not_say_has_no_empty_panels(whole, part):
    n = len(whole.truth.t_s)
    truth = whole.truth._replace(
        f_b=np.full((n, 3), np.nan), omega_ib_b=np.full((n, 3), np.nan), angle_of_attack=np.full(n, np.nan)
    )
    drawn = figures.draw("history", whole._replace(truth=truth, events=part.events))
    assert [axes.get_ylabel() for axes in drawn.axes if axes.get_ylabel()] == ["height [km]", "speed [m/s]"]
