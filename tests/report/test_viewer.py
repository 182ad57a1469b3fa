"""What is in a recording, and how it is laid out."""

from collections import Counter

import numpy as np
import pytest
import rerun.blueprint as rrb
import synthetic_run
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from recorded import OPTIONS, chunks, chunks_of, values_of
from rerun.chunk import McapReader, RrdReader

from shefex_nav import records as rec
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.writer import LogWriter
from shefex_nav.report import viewer
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.report.viewer import layout, legend, pages, recording, sensors
from shefex_nav.report.viewer.sender import GREEN, NAMELESS, Sender
from shefex_nav.scenario import load


def test_recording_has_a_layout_and_everything_on_mission_time(log, tmp_path):
    saved = tmp_path / "run.rrd"
    data = viewer.view(log, save=saved)[0]
    assert not data.ended_early
    assert len(RrdReader(saved).blueprints()) == 1
    found = chunks(saved)
    entities = {str(chunk.entity_path) for chunk in found}
    assert {"/star_tracker/image", "/star_tracker/image_full", "/stars/identified", "/tf", "/log"} <= entities
    assert {"/plots/errors/position_x/error", "/plots/errors/attitude_z/plus"} <= entities
    assert {"/states/phase", "/states/star_tracker", "/states/gps"} <= entities
    assert {"/plots/pointing/x", "/plots/pointing/z", "/plots/gas"} <= entities
    for chunk in found:
        if not str(chunk.entity_path).startswith("/__"):
            assert "mission_time" in chunk.timeline_names, chunk.entity_path


def test_error_curves_are_truth_minus_estimate(log, tmp_path):
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    points = {}
    for chunk in chunks(saved):
        if str(chunk.entity_path) == "/plots/errors/position_y/error":
            batch = chunk.to_record_batch()
            times = batch.column("mission_time").cast("int64").to_numpy() / 1e9
            name = next(n for n in batch.schema.names if "scalars" in n)
            points.update(zip(np.round(times, 2), batch.column(name).to_pylist(), strict=True))
    truths, estimates = {}, {}
    for record in synthetic_run.simulate(OPTIONS):
        if type(record).__name__ == "TruthSample":
            truths[round(record.t_s, 2)] = record.r_i
        elif type(record).__name__ == "NavSolution":
            estimates[round(record.t_s, 2)] = record.r_i
    assert 90 <= len(points) <= 105  # ten a second, the least and the largest of each 0.2 s
    errors = [r_i[1] - estimates[t_s][1] for t_s, r_i in truths.items() if t_s in estimates]
    shown = [value[0] for value in points.values()]
    assert (min(shown), max(shown)) == pytest.approx((min(errors), max(errors)), abs=1e-9)
    for t_s, value in points.items():
        assert value[0] == pytest.approx(truths[t_s][1] - estimates[t_s][1], abs=1e-9)


def test_other_logs_are_drawn_over_the_first(log, tmp_path):
    """Two runs of one name: both curves are in one plot, each with its own sigmas."""
    other = tmp_path / "other.mcap"
    options = OPTIONS._replace(seed=2)
    with LogWriter(other, synthetic_run.mission(seed=2), FramePolicy(0, "none", 4.0)) as writer:
        for record in synthetic_run.simulate(options):
            writer.write(record)
    saved = tmp_path / "both.rrd"
    viewer.view([log, other], save=saved)
    entities = {str(chunk.entity_path) for chunk in chunks(saved)}
    assert {"/plots/errors/velocity_x/error", "/plots/errors/velocity_x/made_up-2/error"} <= entities
    assert "/plots/nees/made_up-2" in entities
    everything = {str(chunk.entity_path) for chunk in RrdReader(saved).stream()}
    assert "/world/overlay/made_up-2" in everything
    for logs, told in (([log, other], "Laid over made_up-1"), ([log], None)):
        recording.build(logs, saved)
        texts = [
            chunk.to_record_batch().column("TextDocument:text")[0].as_py()[0]
            for chunk in RrdReader(saved).stream()
            if str(chunk.entity_path).startswith("/legend/")
        ]
        assert len(texts) == len(layout.PAGES)
        assert all((told is not None) == text.startswith("**Logs.** Laid over made_up-1") for text in texts)
        assert all(("orange made_up-2" in text) == (told is not None) for text in texts)


def test_rerun_reads_the_same_messages_as_the_official_library(log):
    """Two implementations of MCAP and protobuf: topics and messages by the index, rows by decoding."""
    legend, rows = Counter(), Counter()
    with log.open("rb") as file:
        for _, channel, _, message in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            legend[channel.topic] += 1
            rows[channel.topic] += len(message.transforms) if channel.topic == "/tf" else 1
    reader, others = McapReader(log), Counter()
    assert {channel.topic: channel.message_count for channel in reader.info().channels} == legend
    for chunk in chunks_of(reader):
        others[str(chunk.entity_path)] += chunk.num_rows
    assert len(legend) > 15
    assert {topic: others[topic] for topic in legend} == rows


def test_curves_are_on_both_timelines(log, tmp_path):
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    for chunk in chunks(saved):
        if str(chunk.entity_path) in ("/plots/height", "/star_tracker/image", "/tf"):
            assert {"mission_time", "utc"} <= set(chunk.timeline_names)
            batch = chunk.to_record_batch()
            seconds = batch.column("mission_time").cast("int64").to_numpy() / 1e9
            utc = batch.column("utc").cast("int64").to_numpy() / 1e9
            assert utc - seconds == pytest.approx(1340392680.0, abs=1e-3)  # 2012-06-22T19:18:00Z


def test_all_frames_are_there_from_the_first_instant_on(tmp_path):
    """The viewer opens at the first instant of the recording: a scene without a frame is an error there."""
    path, saved = tmp_path / "run.mcap", tmp_path / "run.rrd"
    mission = synthetic_run.mission(start_s=OPTIONS.start_s - 0.01)  # the first tick is not the start
    with LogWriter(path, mission, synthetic_run.NO_PIXELS) as writer:
        for record in synthetic_run.simulate(OPTIONS._replace(end_s=233.0)):
            writer.write(record)
    recording.build([path], saved)
    first = {}
    for chunk in chunks(saved):
        batch = chunk.to_record_batch()
        time = batch.column("mission_time").cast("int64").to_numpy().min()
        first[str(chunk.entity_path)] = min(time, first.get(str(chunk.entity_path), time))
    del first["/log"]  # of the made-up mission, whose events begin before it
    assert first["/tf"] == first["/world/level"] == min(first.values()) == 230_990_000_000


def test_every_page_has_a_text_about_it(log, tmp_path):
    saved = tmp_path / "run.rrd"
    recording.build([log], saved)
    entities = {str(chunk.entity_path) for chunk in RrdReader(saved).stream()}
    assert set(legend.TEXTS) == set(layout.PAGES)
    assert {f"/{legend.entity(page)}" for page in layout.PAGES} <= entities


def test_what_was_no_measurement_is_no_mark_among_the_innovations(tmp_path):
    """Two position fixes that are refused: one by its NIS, one because there was none."""
    path, saved = tmp_path / "run.mcap", tmp_path / "run.rrd"
    nan, three = float("nan"), np.zeros(3)
    gate = rec.GateResult(233.0, 232.8, "gps_position", 3, 40.0, 20.0, False, "too far off", three)
    none = gate._replace(t_s=234.0, dof=0, nis=nan, limit=nan, note="no fix: pdop 12", innovation=three[:0])
    with LogWriter(path, synthetic_run.mission(), synthetic_run.NO_PIXELS) as writer:
        for record in (*synthetic_run.simulate(OPTIONS._replace(end_s=235.0)), gate, none):
            writer.write(record)
    recording.build([path], saved)
    times, shares = values_of(saved, "/plots/nis/gps_position/refused", "scalars")
    assert times == [pytest.approx(233.0)] and shares == [pytest.approx(2.0)]


def test_errors_beyond_the_scale_are_told(log):
    """The title names the largest error if its plot cuts it off, and only then."""
    data = recording.read(log)
    errors = navigation_errors(data)
    largest = np.abs(np.hstack([errors.position_i, errors.velocity_i, np.degrees(errors.attitude_b)])).max(
        axis=0
    )
    for (limit, words), most in zip(pages._error_limits(data), largest, strict=True):
        assert words == (pages._cut_off(most) if most > limit else "")
    spike = data.nav.r_i.copy()
    spike[5] += 1e4
    (_, words), *_ = pages._error_limits(data._replace(nav=data.nav._replace(r_i=spike)))
    assert words.startswith("; peak 1000"), "not in powers of ten"
    P = np.full_like(data.covariance.P, np.nan)  # of software that says no sigmas
    unsure = pages._error_limits(data._replace(covariance=data.covariance._replace(P=P)))
    for (limit, _), most in zip(unsure, largest, strict=True):
        assert 0.3 * most < limit < 30.0 * most, "by the errors alone"


def test_names_of_states_are_whole_or_not_there(tmp_path):
    """A state of two seconds in a flight of 500 has no room for its name, one of 100 has."""
    import rerun as rr

    stream = rr.RecordingStream("shefex_nav", recording_id="lanes")
    stream.save(tmp_path / "lanes.rrd")
    lane = Sender(stream, "2012-06-22T19:18:00Z").lane
    lane(
        "states/x",
        [0.0, 100.0, 102.0],
        ["fix", "no fix", "fix"],
        {"fix": GREEN, "no fix": GREEN},
        (0.0, 500.0),
    )
    stream.flush()
    stream.disconnect()
    times, states = values_of(tmp_path / "lanes.rrd", "/states/x", "state")
    assert times == [0.0, 100.0, 102.0]
    assert states == ["fix", f"no fix{NAMELESS}", "fix"]


@pytest.mark.parametrize(("value", "limit"), [(0.7, 1.2), (1.3, 2.4), (2.5, 6.0), (7.0, 12.0), (0.0, 1.2e-6)])
def test_scales_contain_their_values(value, limit):
    assert pages._largest(np.array([-value, np.nan, 0.5 * value])) == pytest.approx(limit)


def with_limit(data, scenario, most):
    """The same run of a scenario whose table of detections has a length."""
    text = load.load(scenario, [f"star_tracker.detection.most_objects={most}"]).source
    return data._replace(mission=data.mission._replace(scenario_text=text))


def test_a_table_of_detections_that_is_full_is_told(log, default_scenario):
    """Of 100 frames, those with the most detections are the ones that a table of that length cuts off."""
    data = recording.read(log)
    found = np.array([len(fix.hip) for fix in data.star_fixes])
    most = int(found.max())
    cut, roomy = (with_limit(data, default_scenario, limit) for limit in (most, most + 1))
    full = legend.limit_of(cut)
    assert full == (most, np.count_nonzero(found == most), len(found))
    assert pages._stars_title(cut).endswith(f"; {most} at most")
    (words,) = legend._at_most(full)
    assert f"{full.reached} of {full.frames} frames" in words and f"No more than {most} objects" in words
    assert legend.limit_of(roomy) == (most + 1, 0, len(found))
    assert "at most" not in pages._stars_title(roomy)
    assert "No frame had so many" in legend._at_most(legend.limit_of(roomy))[0]
    assert (
        legend.limit_of(data) is None and legend._at_most(None) == ()
    )  # the made-up mission has no scenario


def grids(part):
    """All grids in a part of a blueprint."""
    if isinstance(part, rrb.View):
        return []
    deeper = [one for inner in part.contents for one in grids(inner)]
    return [part, *deeper] if isinstance(part, rrb.Grid) else deeper


@pytest.mark.parametrize("errors", [True, False])
@pytest.mark.parametrize("control", [True, False])
def test_no_row_of_plots_is_mostly_empty_or_too_low_for_numbers(log, errors, control):
    """At most one cell of a grid stays free, and the navigation has four rows of plots, not five."""
    data = recording.read(log)
    has = layout.content(data, ["star_tracker/image"], errors)._replace(control=control)
    for make in (pages._overview, pages._mission, pages._navigation):
        for grid in grids(make(data, layout.scene(data.truth.r_i), has)):
            assert -len(grid.contents) % grid.grid_columns <= 1
            assert len(grid.contents) <= 4 * grid.grid_columns


def test_what_the_data_do_not_have_is_not_drawn(log):
    """Neither the field of a camera that is not there, nor a number of satellites that nobody knows."""
    data = recording.read(log)
    fixes = [fix._replace(n_satellites=0) for fix in data.gps]
    assert layout.content(data, []).satellites
    has = layout.content(data._replace(gps=fixes, star_fixes=[]), [])
    assert not has.satellites and "plots/gps" not in origins(pages._sensors(data, None, has))
    seen = layout.scene(data.truth.r_i)
    with_camera = pages._trajectory(seen, has._replace(stars=True)).contents
    assert set(with_camera) - set(pages._trajectory(seen, has).contents) == {"star_tracker/calibration"}


def test_the_texts_about_a_log_without_truth_speak_of_no_errors():
    class Kept:
        """A Sender that keeps what it is sent."""

        def __init__(self):
            self.texts = {}

        def static(self, entity, document):
            self.texts[entity] = document.text.as_arrow_array()[0].as_py()

    with_truth, without = Kept(), Kept()
    legend.send(with_truth, "run")
    legend.send(without, "run", errors=False)
    entity = legend.entity("Navigation")
    assert "truth minus estimate" in with_truth.texts[entity] and "NEES" in with_truth.texts[entity]
    assert "truth minus estimate" not in without.texts[entity] and "NEES" not in without.texts[entity]
    assert without.texts[entity].startswith("**No truth.**")


def test_levels_that_are_large_for_a_while_do_not_flatten_the_rest(log):
    data = recording.read(log)
    level = data.nav.protection_position.copy()
    level[:] = 2.0
    level[: len(level) // 4] = 500.0
    data = data._replace(nav=data.nav._replace(protection_position=level))
    position, *_ = pages._levels(data, layout.content(data, [])._replace(protection=True))
    assert position.name == "Level, position; error white [m]; peak 500 is cut off"
    level[:] = 2.0
    position, *_ = pages._levels(data, layout.content(data, [])._replace(protection=True))
    assert position.name == "Level, position; error white [m]"


def test_the_text_about_the_star_tracker_is_seen_at_once(log, tmp_path):
    """No view but the kinds of pictures shares its place with others."""
    data = recording.read(log)
    has = layout.content(data, ["star_tracker/image"])
    page = pages._star_tracker(data, layout.scene(data.truth.r_i), has)

    def shown(part):
        parts = [] if isinstance(part, rrb.View) else part.contents
        parts = parts[:1] if isinstance(part, rrb.Tabs) else parts
        return [part] + [deeper for one in parts for deeper in shown(one)]

    assert any(isinstance(part, rrb.TextDocumentView) for part in shown(page))


def origins(part):
    """Entities that the views of a part of a blueprint show."""
    if isinstance(part, rrb.View):
        return [str(part.origin)]
    return [name for one in part.contents for name in origins(one)]


@pytest.mark.parametrize("errors", [True, False])
def test_without_truth_there_are_no_empty_plots_of_errors(log, errors):
    """Nor a panel of a camera that saw nothing; what is left are paths, levels and what was refused."""
    data = recording.read(log)
    has = layout.content(data, [], errors)._replace(stars=False)
    for make in (pages._overview, pages._navigation):
        shown = origins(make(data, layout.scene(data.truth.r_i), has))
        assert any(name.startswith("plots/errors") for name in shown) == errors
        assert "stars" not in shown
        assert "plots/nis" in shown or "plots/height" in shown
    """Vibration of a known size, a second without samples, one with a tenth of them, one axis alone."""
    n, sigma = 1000, 0.5
    t_s = 0.01 * np.arange(1, n + 1)
    force = sigma * np.random.default_rng(5).standard_normal((n, 4, 3))
    times, whole = sensors.vibration(t_s, force)
    np.testing.assert_allclose(whole, sigma, rtol=0.2)  # 300 differences: 5 sigma of their scatter
    force[200:300] = np.nan
    force[500:590] = np.nan
    force[700:790, :, 1] = np.nan
    again, scatter = sensors.vibration(t_s, force)
    assert np.array_equal(times, again)
    assert np.isnan(scatter[2]).all()
    np.testing.assert_allclose(scatter[5], sigma, rtol=0.6)  # 30 differences
    np.testing.assert_allclose(scatter[7, 1], sigma, rtol=0.6)
    assert np.array_equal(scatter[7, [0, 2]], whole[7, [0, 2]])
    untouched = [0, 1, 3, 4, 6, 8, 9]
    assert np.array_equal(scatter[untouched], whole[untouched])
