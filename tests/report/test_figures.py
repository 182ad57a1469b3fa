"""Figures show the data that they claim to show."""

import re
import subprocess
import sys

import numpy as np
import pytest
import synthetic_run
from made_up import MISSION, gathered, of_records
from matplotlib.text import Text
from scipy.stats import binom, chi2

from shefex_nav import event_words
from shefex_nav import records as rec
from shefex_nav.geometry import wgs84
from shefex_nav.report import figures, innovations, local_level, star_metrics
from shefex_nav.report.configured import NOTHING
from shefex_nav.report.figures import consistency, errors, flight, flown, labels, sky, style
from shefex_nav.report.navigation_errors import chi2_bounds, navigation_errors, normalised_errors
from shefex_nav.report.track import earth_fixed

OPTIONS = synthetic_run.Options(start_s=228.0, end_s=258.0, frame_pixels=False)


@pytest.fixture(scope="module")
def data():
    made = gathered(OPTIONS)
    do_not_use = made.nav.t_s < 236.0
    level = np.where(do_not_use[:, None], 6e-3, 2.5e-3) * np.ones((1, 3))
    nav = made.nav._replace(
        protection_attitude=level,
        protection_position=2e3 * level[:, :2],
        protection_velocity=2e2 * level[:, :2],
        do_not_use_attitude=do_not_use,
        doubt_attitude=do_not_use.astype(np.int64),
    )
    return made._replace(nav=nav)


def drawn(axes, label):
    """(t_s, values) of the line of a label."""
    line = next(line for line in axes.lines if line.get_label() == label)
    return np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)


def panels(figure):
    """Axes with a label at their y axis, as they stand in the figure."""
    return [axes for axes in figure.axes if axes.get_ylabel()]


def assert_is_covered(shown, t_s, values):
    """The curve consists of samples, reaches both extremes and both ends."""
    rows = np.searchsorted(t_s, shown[0] - 1e-7)
    np.testing.assert_allclose(t_s[rows], shown[0], atol=1e-7)
    np.testing.assert_array_equal(values[rows], shown[1])
    assert shown[1].max() == values.max() and shown[1].min() == values.min()
    assert rows[0] == 0 and rows[-1] == len(t_s) - 1


def test_the_envelope_keeps_the_extremes_of_every_stretch_and_opens_gaps():
    rng = np.random.default_rng(3)
    values = rng.normal(size=10007)
    values[4000:4100] = np.nan
    shown = style.envelope(values, 200)
    assert len(shown) <= 205 and (np.diff(shown) > 0).all()
    stretch = -(-10007 // 100)
    for start in range(0, 10007, stretch):
        part = values[start : start + stretch]
        inside = values[shown[(shown >= start) & (shown < start + stretch)]]
        if np.isfinite(part).any():
            assert np.nanmax(inside) == np.nanmax(part) and np.nanmin(inside) == np.nanmin(part)
    assert np.isnan(values[shown]).any()
    np.testing.assert_array_equal(style.envelope(values[:50], 200), np.arange(50))


def test_a_leap_in_time_is_not_bridged():
    t_s = np.concatenate([np.arange(0.0, 2.0, 0.1), np.arange(9.0, 11.0, 0.1)])
    times, values = style.gapped(t_s, t_s)
    assert np.isnan(values).sum() == 1 and np.isnan(times[20]) and len(times) == len(t_s) + 1


def test_a_logger_that_becomes_slower_leaves_no_gaps():
    """100 Hz up, 5 Hz down, and 20 s of silence in between: one gap, not one after every slow sample."""
    fast, slow = np.arange(0.0, 20.0, 0.01), np.arange(40.0, 160.0, 0.2)
    for t_s in (np.concatenate([fast, slow]), np.repeat(np.concatenate([fast, slow]), 3)):
        times, _ = style.gapped(t_s, t_s)
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(times)), [np.searchsorted(t_s, 40.0)])
    no_silence = np.concatenate([fast, slow - 20.0])
    assert not np.isnan(style.gapped(no_silence, no_silence)[0]).any()


def test_attitude_errors_are_those_of_the_metrics_inside_three_sigma(data):
    expected = navigation_errors(data)
    figure = errors.attitude(data)
    for k, axis in enumerate("xyz"):
        axes = panels(figure)[k]
        error_deg = np.degrees(expected.attitude_b[:, k])
        assert_is_covered(drawn(axes, f"error, about {axis}"), expected.t_s, error_deg)
        edges = drawn(axes, "_edges")[1]
        half = 3.0 * np.degrees(synthetic_run.SIGMA_THETA)
        np.testing.assert_allclose(np.abs(edges[np.isfinite(edges)]), half, rtol=1e-12)
        n, share = len(error_deg), 0.9973
        low, high = binom.ppf([1e-4, 1.0 - 1e-4], n, share)
        assert low <= np.sum(np.abs(error_deg) <= half) <= high  # seed 1, errors drawn from the covariance


def test_position_and_velocity_errors_are_those_in_local_level_axes(data):
    t_s, expected, _, sigma_t_s, sigma = local_level.errors_and_sigmas(data)
    position, velocity = errors.level(data)
    for (times, error, own_sigma_t_s, own_sigma), columns in (
        (position, slice(0, 3)),
        (velocity, slice(3, 6)),
    ):
        np.testing.assert_allclose(times, t_s)
        np.testing.assert_allclose(error, expected[:, columns], rtol=1e-9, atol=2e-9)
        np.testing.assert_allclose(own_sigma_t_s, sigma_t_s)
        np.testing.assert_allclose(own_sigma, sigma[:, columns], rtol=1e-9)
    assert_is_covered(drawn(panels(errors.position(data))[1], "error, east"), t_s, position[1][:, 1])
    assert_is_covered(drawn(panels(errors.velocity(data))[2], "error, down"), t_s, velocity[1][:, 2])


def test_biases_are_the_estimates_of_the_log_in_their_units(data):
    covariance = data.covariance._replace(
        gyro_bias=np.tile([1e-6, -2e-6, 3e-6], (len(data.covariance.t_s), 1)),
        accel_bias=np.tile([0.0, 9.80665e-3, 0.0], (len(data.covariance.t_s), 1)),
    )
    figure = errors.biases(data._replace(covariance=covariance))
    gyro_y, accel_y = (drawn(axes, "y, estimate")[1] for axes in figure.axes if _has(axes, "y, estimate"))
    np.testing.assert_allclose(gyro_y, np.degrees(-2e-6) * 3600.0)
    np.testing.assert_allclose(accel_y, 1.0)


def _has(axes, label):
    return any(line.get_label() == label for line in axes.lines)


def test_nees_is_that_of_the_metrics_and_of_its_definition(data):
    t_s, values = consistency.nees_of_blocks(data)
    expected = navigation_errors(data)
    times, nees, _ = normalised_errors(data, expected)
    np.testing.assert_allclose(t_s, times)
    np.testing.assert_allclose(values["all"], nees, rtol=1e-9)
    k = 17
    row = int(np.argmin(np.abs(expected.t_s - t_s[k])))
    P = data.covariance.P[int(np.argmin(np.abs(data.covariance.t_s - t_s[k])))]
    e = expected.velocity_i[row]
    assert values["velocity"][k] == pytest.approx(e @ np.linalg.inv(P[3:6, 3:6]) @ e, rel=1e-9)
    shown = drawn(panels(consistency.nees(data))[3], "NEES")
    assert_is_covered(shown, t_s, values["all"])


def test_bounds_are_those_of_the_chi_square_distribution():
    assert chi2_bounds(3, 0.95) == pytest.approx((0.2158, 9.3484), abs=1e-4)  # tables
    for dof in (1, 3, 9, 60):
        assert chi2_bounds(dof, 0.9) == pytest.approx(tuple(chi2.ppf([0.05, 0.95], dof)), rel=1e-9)


def test_refused_measurements_are_marked_where_they_are(data):
    gates = [gate._replace(nis=20.0 + n, accepted=n % 7 != 0) for n, gate in enumerate(data.gates)]
    refused = [gate for gate in gates if gate.sensor == "star_tracker" and not gate.accepted]
    axes = next(
        a for a in panels(consistency.nis(data._replace(gates=gates))) if a.get_ylabel() == "star tracker"
    )
    t_s, nis = drawn(axes, f"refused ({len(refused)})")
    np.testing.assert_array_equal(t_s, [gate.t_valid_s for gate in refused])
    np.testing.assert_array_equal(nis, [gate.nis for gate in refused])


def test_star_errors_are_those_of_the_metrics_about_their_mean(data):
    expected = star_metrics.star_errors(data)
    arcsec = np.degrees(expected.rotation_c) * 3600.0
    axes = panels(figures.draw("star_errors", data))[0]
    np.testing.assert_allclose(drawn(axes, "error across the boresight, x")[1], arcsec[:, 0])
    edges = drawn(axes, "_edges")[1]
    half = 3.0 * np.degrees(synthetic_run.STAR_SIGMA_C[0]) * 3600.0
    edges = np.unique(np.round(edges[np.isfinite(edges)], 9))
    np.testing.assert_allclose(edges, arcsec[:, 0].mean() + np.array([-half, half]), atol=1e-6)


def test_the_status_counts_every_frame_by_its_reason(data):
    axes = figures.draw("status", data).axes
    labels_ = [text.get_text() for one in axes for text in one.get_yticklabels() if "\n" in text.get_text()]
    good = sum(fix.reason == rec.Reason.NONE for fix in data.star_fixes)
    assert set(labels_) == {f"fix\n({good})", f"too few stars\n({len(data.star_fixes) - good})"}


def _at_one_hertz():
    """The whole made-up flight, one sample a second, and its events."""
    times = np.arange(-10.0, 496.0)
    return of_records(
        MISSION, [*(synthetic_run.truth_at(MISSION, t) for t in times), *synthetic_run._events(MISSION)]
    )


def test_the_path_reaches_apogee_and_events_lie_on_it():
    data = _at_one_hertz()
    figure = flight.trajectory(data)
    track = earth_fixed(MISSION.earth, data.truth)
    lines = [line for line in figure.axes[0].lines if line.get_marker() == "None"]
    top = max(np.nanmax(line.get_ydata()) for line in lines)
    assert top == pytest.approx(track.height.max() / 1e3, rel=1e-12)
    dots = next(line for line in figure.axes[0].lines if line.get_marker() == "o")
    heights = {event.name: event.altitude_m / 1e3 for event in data.events}
    assert dots.get_ydata()[:4] == pytest.approx([h for n, h in heights.items() if n != "impact"], abs=0.2)
    named = {text.get_text() for text in figure.axes[0].texts}
    assert {"lift off", "ignition 2", "impact"} <= named


def test_ground_distance_is_that_of_the_geodesic_on_a_meridian():
    latitude = np.radians(np.linspace(0.0, 90.0, 91))
    zero = np.zeros(91)
    track = flown.Track(zero, zero, latitude, zero, zero)
    assert flown.along_ground(track)[-1] == pytest.approx(10001965.729, abs=0.01)  # quadrant of WGS 84


def test_an_estimate_that_stands_goes_no_way():
    """Ten minutes on the pad with 0.5 m of noise, then 10 s at 100 m/s: 1 km, not 1.4."""
    t_s = np.arange(0.0, 610.5, 0.5)
    north = np.where(t_s < 600.0, 0.5 * np.random.default_rng(6).normal(size=len(t_s)), 100.0 * (t_s - 600.0))
    v_e = np.where(t_s[:, None] < 600.0, 0.05, 100.0) * np.array([0.0, 0.0, 1.0])
    zero = np.zeros(len(t_s))
    track = flown.Track(zero, v_e, 0.5 + north / 6.367e6, zero, zero)
    assert flown.along_ground(track)[-1] > 1400.0
    assert flown.along_ground(track, 1.0)[-1] == pytest.approx(1000.0, rel=0.01)


def test_the_regional_map_keeps_distances_from_its_middle():
    rng = np.random.default_rng(4)
    u = rng.normal(size=(50, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    middle = u[0]
    latitude, longitude = np.arcsin(u[:, 2]), np.arctan2(u[:, 1], u[:, 0])
    xy = flight.equidistant(latitude, longitude, middle)
    expected = np.arccos(np.clip(u @ middle, -1.0, 1.0)) * wgs84.A / 1e3
    np.testing.assert_allclose(np.hypot(*xy.T), expected, rtol=1e-9, atol=1e-3)
    north = flight.equidistant(latitude[0] + 0.1, longitude[0], middle)
    assert north[1] == pytest.approx(0.1 * wgs84.A / 1e3) and abs(north[0]) < 1e-6
    assert flight.equidistant(latitude[0], longitude[0] + 0.1, middle)[0] > 0.0


def test_the_map_of_the_sky_keeps_areas_and_has_east_on_the_left():
    rng = np.random.default_rng(5)
    u = rng.normal(size=(200000, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    xy = sky.hammer(u, 1.0)
    radius2 = (xy[:, 0] / (2.0 * np.sqrt(2.0))) ** 2 + (xy[:, 1] / np.sqrt(2.0)) ** 2
    assert radius2.max() <= 1.0 + 1e-12
    inner = binom.ppf([1e-4, 1.0 - 1e-4], len(u), 0.25)  # half the size, a quarter of the area
    assert inner[0] <= np.sum(radius2 < 0.25) <= inner[1]
    east = np.array([np.cos(1.1), np.sin(1.1), 0.0])
    assert sky.hammer(east, 1.0)[0] < 0.0
    np.testing.assert_allclose(sky.hammer(np.array([0.0, 0.0, 1.0]), 1.0), [0.0, np.sqrt(2.0)], atol=1e-7)


def test_a_sun_that_the_earth_hides_excludes_nothing(data, monkeypatch):
    """90 deg about the Sun are half of the sky, which a camera in the Earth's shadow may look at."""
    limits = NOTHING._replace(sun_exclusion_rad=np.pi / 2, limb_exclusion_rad=-np.pi)
    monkeypatch.setattr(sky, "configured", lambda data: limits)
    words = {}
    for is_hidden in (False, True):
        truths = [frame._replace(sun_hidden=is_hidden) for frame in data.frame_truths]
        axes = sky.sky_map(data._replace(frame_truths=truths)).axes[0]
        paths = [path for one in axes.collections for path in one.get_paths() if len(path.vertices) > 10]
        assert any(path.contains_point(_at_sun(data)) for path in paths) is not is_hidden
        labels_ = axes.get_legend_handles_labels()[1]
        words[is_hidden] = next(text for text in labels_ if text.startswith("excluded"))
    assert "s: 90° to the Sun, " in words[False] and "the Sun is hidden" not in words[False]
    assert "to the Sun" not in words[True] and words[True].endswith("; the Sun is hidden")


def _at_sun(data):
    """Place of the Sun on the map of the whole sky."""
    seen = sky.around(data)
    return sky.hammer(seen.sun_i, float(np.arctan2(*sky._centre(seen)[1::-1])))


def test_a_path_with_and_without_fixes_shows_both(data):
    """An orbit looks at a place once with a fix and once without: neither covers the other."""
    axes = sky.sky_map(data).axes[0]
    with_, without = (
        next(line for line in axes.lines if line.get_label() == f"boresight, {name}")
        for name in ("fix", "no fix")
    )
    order = list(axes.lines)
    assert order.index(without) < order.index(with_) and without.get_ms() > 1.5 * with_.get_ms()


def test_the_limb_is_where_its_angle_is_zero(data):
    edge = sky.limb(data, 240.0)
    for above in (0.0, np.radians(20.0)):
        angles = [wgs84.limb_angle(edge.r_e, edge.C_ie.T @ u) for u in sky.limb_line(edge, above)]
        np.testing.assert_allclose(angles, above, atol=1e-9)


def test_names_neither_cover_each_other_nor_leave_the_figure():
    figure, axes = style.single(4.0, "names")
    rng = np.random.default_rng(6)
    xy = rng.uniform(0.2, 0.8, (12, 2))
    axes.set(xlim=(0, 1), ylim=(0, 1))
    assert labels.place(axes, xy, [f"event number {k}" for k in range(12)]) >= 8
    figure.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in axes.texts]  # without the line to its place
    for k, box in enumerate(boxes):
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_marks_that_cover_each_other_have_one_name():
    """Lengths are points of print; what is counted is the distance from the first of a group."""
    figure, axes = style.single(4.0, "names")
    width = axes.get_window_extent().width * 72.0 / figure.dpi
    axes.set(xlim=(0, width), ylim=(0, 1))
    xy = np.array([[10.0, 0.5], [13.0, 0.5], [16.0, 0.5], [21.0, 0.5], [50.0, 0.5], [21.0, 0.5]])
    assert labels.together(axes, xy, 4.0) == [[0, 1], [2], [3], [4], [5]]


def test_every_event_is_named_in_the_picture_of_the_path(data):
    """Burn-out and largest pressure of a short burn are one dot, whose name says both."""
    moments = (240.0, "max_dynamic_pressure"), (240.1, "burn_out_1"), (250.0, "altitude_60km")
    events = [rec.Event(t_s, name, 1e5, "") for t_s, name in moments]
    (axes,) = flight.trajectory(data._replace(events=events)).axes
    names = [text.get_text() for text in axes.texts]
    assert names == ["max dynamic pressure, burn out 1", "down to 60 km"]


@pytest.mark.parametrize(
    ("name", "words"),
    [("altitude_60km", "down to 60 km"), ("burn_out_1", "burn out 1"), ("fault_gps_end", "fault ends: gps"),
     ("fault_gyro", "fault begins: gyro")],
)  # fmt: skip
def test_events_have_one_name_for_people(name, words):
    assert event_words.in_words(name) == words


@pytest.mark.parametrize("entry", figures.catalogue(), ids=lambda entry: entry.name)
def test_every_figure_is_drawn_and_named(data, entry):
    figure = figures.draw(entry.name, data)
    assert figure.texts[0].get_text()
    for axes in panels(figure):
        assert axes.get_ylabel().strip()
    svg = style.svg(figure)
    assert not re.search(rb' d="[^"]*(nan|inf)', svg, re.IGNORECASE) and len(svg) < 1_000_000


@pytest.mark.parametrize("entry", figures.catalogue(), ids=lambda entry: entry.name)
def test_legends_and_notes_cover_no_curve(data, entry):
    """No vertex of a curve lies below a legend, and above a panel there is room for it; coasts may."""
    figure = figures.draw(entry.name, data)
    figure.draw_without_rendering()
    whole = figure.bbox
    for axes in figure.axes:
        legend = axes.get_legend()
        notes = [text for text in axes.texts if text.get_position()[1] > 1.0 and text.get_fontsize() == 9]
        for box in [one.get_window_extent().padded(-1.5) for one in (legend, *notes) if one is not None]:
            assert whole.x0 <= box.x0 and box.x1 <= whole.x1 and box.y1 <= whole.y1
            for other in figure.axes:
                lines = [
                    one for one in other.lines if entry.name != "ground_track" or one.get_label()[0] != "_"
                ]
                for line in lines:
                    places = line.get_transform().transform(line.get_xydata())
                    places = places[np.isfinite(places).all(axis=1)]
                    places = places[[other.bbox.contains(*place) for place in places]]
                    assert not any(box.contains(*place) for place in places), line.get_label()


def test_what_a_few_frames_cut_off_is_told(data):
    fixes = list(data.star_fixes)
    fixes[7] = fixes[7]._replace(background_dn=4045.0)
    figure = figures.draw("camera", data._replace(star_fixes=fixes))
    grey = next(axes for axes in panels(figure) if "grey" in axes.get_ylabel())
    assert grey.get_ylim()[1] < 30.0  # the others are 12
    assert [text.get_text() for text in grey.texts] == [f"1 of {len(fixes)} lie above, up to 4045 DN"]


def test_a_figure_is_the_same_every_time(data):
    one, other = (style.svg(figures.draw("attitude_control", data)) for _ in range(2))
    assert one == other


def _cut_short(data):
    return {
        "nothing": of_records(MISSION, []),
        "one tick": of_records(MISSION, [synthetic_run.truth_at(MISSION, -10.0)]),
        "no truth": data._replace(
            truth=of_records(MISSION, []).truth, frame_truths=[], control=of_records(MISSION, []).control
        ),
        "no solution": data._replace(
            nav=of_records(MISSION, []).nav, covariance=of_records(MISSION, []).covariance, gates=[]
        ),
        "no fix": data._replace(
            star_fixes=[fix for fix in data.star_fixes if fix.reason != rec.Reason.NONE], gates=[]
        ),
    }


@pytest.mark.parametrize("case", ["nothing", "one tick", "no truth", "no solution", "no fix"])
def test_a_log_that_lacks_things_has_fewer_figures_and_no_error(data, case):
    poorer = _cut_short(data)[case]
    names = [entry.name for entry in figures.catalogue() if figures.draw(entry.name, poorer) is not None]
    missing = {"no truth": "nees", "no solution": "attitude", "no fix": "star_errors"}.get(case)
    assert missing not in names
    if case in ("nothing", "one tick"):
        assert "attitude" not in names and "sky_map" not in names
    else:
        assert len(names) >= 8
    for name in names if case == "one tick" else ():
        style.svg(figures.draw(name, poorer))


def test_what_went_around_the_earth_has_a_map_of_the_whole_earth():
    times = np.linspace(0.0, 5500.0, 500)
    angle = 2.0 * np.pi * times / 5500.0
    start = synthetic_run.truth_at(MISSION, 0.0)
    r = 6.8e6 * np.column_stack([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)])
    samples = [
        start._replace(t_s=t, r_i=r_i, phase=int(rec.Phase.ORBIT)) for t, r_i in zip(times, r, strict=True)
    ]
    axes = flight.ground_track(of_records(MISSION, samples)).axes[0]
    assert axes.get_xlim() == (-180.0, 180.0)
    longitude = drawn(axes, "truth")[0]
    steps = np.abs(np.diff(longitude))
    assert np.nanmax(steps) < 30.0 and np.isnan(longitude).any()


def test_an_unknown_name_is_told(data):
    with pytest.raises(ValueError, match="no figure 'trajectories'; choose from trajectory"):
        figures.draw("trajectories", data)


def test_pictures_are_written_for_all_that_a_log_has(data, tmp_path):
    few = data._replace(covariance=of_records(MISSION, []).covariance, star_fixes=[], frame_truths=[])
    written = figures.save_all(few, tmp_path, "png")
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in written}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)


def test_no_state_of_pyplot_is_touched():
    code = "import sys; from shefex_nav.report.figures import style; style.svg(style.single(2.0, 'x')[0]); "
    code += "sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_what_is_shaded_in_the_figure_of_the_imu_is_named(data):
    saturated, valid = np.zeros(len(data.imu.t_valid_s), bool), np.ones(len(data.imu.t_valid_s), bool)
    saturated[100:200], valid[300:310] = True, False
    drawn_ = figures.draw("imu", data._replace(imu=data.imu._replace(saturated=saturated, valid=valid)))
    named = {
        text.get_text() for axes in panels(drawn_) if axes.get_legend() for text in axes.get_legend().texts
    }
    assert {"saturated", "silent", "y", "z"} <= named


def test_gps_of_recorded_data_shows_what_they_say_and_no_line_across_a_gap(data):
    """Neither 0 satellites in a fix nor a dilution that nobody gave; rows that are missing are a gap."""
    fixes = [
        fix._replace(t_valid_s=t_s, n_satellites=0, pdop=np.nan, valid=True, R_r_e=4.0 * np.eye(3))
        for fix, t_s in zip(data.gps[:1] * 20, [*range(230, 240), *range(248, 258)], strict=True)
    ]
    (axes,) = panels(figures.draw("gps", data._replace(gps=fixes)))
    assert axes.get_ylabel().startswith("position")
    times, sigma = (np.asarray(one, float) for one in axes.lines[0].get_data())
    np.testing.assert_allclose(sigma[np.isfinite(sigma)], np.sqrt(12.0))
    assert axes.get_ylim()[1] > 1.05 * np.sqrt(12.0)
    assert np.isnan(sigma[np.searchsorted(np.nan_to_num(times, nan=240.0), 239.5)])
    told = [fix._replace(n_satellites=7, pdop=2.0) for fix in fixes]
    assert len(panels(figures.draw("gps", data._replace(gps=told)))) == 3


def test_the_mean_of_nis_is_of_refused_measurements_too(data):
    """As the table has it: of those used alone it cannot lie far above 1, whatever the filter does."""
    kept = [gate for gate in data.gates if gate.sensor == "gps_position" and gate.dof][:10]
    gates = [
        gate._replace(nis=3.0 if k < 6 else 300.0, dof=3, limit=16.0, accepted=k < 6)
        for k, gate in enumerate(kept)
    ]
    (axes,) = panels(figures.draw("nis", data._replace(gates=gates)))
    words = {text.get_text() for text in axes.texts}
    mean = (6 * 3.0 + 4 * 300.0) / 30.0
    assert f"mean NIS per degree of freedom {mean:.2f}, refused ones too; of those used: 1.00" in words
    per_dof = innovations.summarise(gates)["gps_position"]["per_dof"]
    assert per_dof == pytest.approx(mean)


def test_sources_without_room_for_a_lane_are_named(data):
    health = [rec.NavHealth(240.0, f"sensor_{k}", False, "broken") for k in range(20)]
    axes = figures.draw("health", data._replace(health=health)).axes[0]
    shown = {label.get_text() for label in axes.get_yticklabels()}
    told = next(text.get_text() for text in axes.texts if "not shown" in text.get_text())
    for k in range(20):
        name = f"sensor {k}"
        assert (name in shown) != (name in told.split(": ")[1].split(", "))
