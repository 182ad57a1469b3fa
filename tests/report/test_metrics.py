"""Figures of runs whose errors are known because they were made."""

import io
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_run
from made_up import frame_truth, star_fix
from scipy.stats import chi2

from shefex_nav import records as rec
from shefex_nav.geometry import rotation
from shefex_nav.geometry.frames import ecef_from_inertial
from shefex_nav.geometry.wgs84 import geodetic_from_ecef
from shefex_nav.log import reader
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.writer import LogWriter
from shefex_nav.report import metrics, pairing, star_metrics
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors
from shefex_nav.report.table import rows, summary_table

MISSION = synthetic_run.mission()
OPTIONS = synthetic_run.Options(start_s=225.0, end_s=415.0, frame_pixels=False)


def gathered(records):
    builder = RunDataBuilder(MISSION)
    for record in records:
        builder.add(record)
    return builder.build()


@pytest.fixture(scope="module")
def records():
    return [*synthetic_run.simulate(OPTIONS), synthetic_run.summary(OPTIONS)]


@pytest.fixture(scope="module")
def data(records):
    return gathered(records)


@pytest.fixture(scope="module")
def summary(data):
    return metrics.summarise(data, log="run.mcap")


def test_log_and_memory_give_one_summary(records, summary, tmp_path):
    path = tmp_path / "run.mcap"
    with LogWriter(path, MISSION, synthetic_run.NO_PIXELS) as log:
        for record in records:
            log.write(record)
    assert metrics.summarise(reader.read(path), log="run.mcap") == summary


def test_the_object_is_plain_json_with_every_key(summary):
    again = json.loads(json.dumps(summary, allow_nan=False))
    assert again == summary
    assert summary["requirements"] == []  # its scenario cannot be read
    assert {"scenario", "seed", "log", "simulated_s", "wall_s", "real_time_factor"} <= set(summary)
    assert {"apogee_km", "range_km", "max_speed_m_s", "events"} <= set(summary["flight"])
    star = summary["star_tracker"]
    assert {"frames", "in_window", "solved", "wrong", "no_fix", "error_arcsec", "chain_ms"} <= set(star)
    assert {"cross_axis_rms", "boresight_rms", "max"} <= set(star["error_arcsec"])
    assert set(star["chain_ms"]) == {"median", "p99"}
    navigation = summary["navigation"]
    for name in ("position_error_m", "velocity_error_m_s", "attitude_error_deg"):
        assert set(navigation[name]) == {"rms", "max"}
    assert len(navigation["at_entry"]["attitude_error_deg"]) == 3
    assert set(navigation["nees"]) == {"mean", "dof", "samples", "why", "times_sigma"}
    assert set(navigation["nees"]["times_sigma"]) == {"position", "velocity", "attitude"}


def test_run_times(summary):
    assert summary["simulated_s"] == pytest.approx(190.0)
    assert (summary["wall_s"], summary["setup_s"]) == (4.0, 1.5)
    assert summary["real_time_factor"] == pytest.approx(190.0 / 4.0)


def test_flight_figures():
    times = np.arange(-1.0, 495.5, 0.5)
    truths = [synthetic_run.truth_at(MISSION, t) for t in times]
    flight = metrics.summarise(gathered([*truths, *synthetic_run._events(MISSION)]))["flight"]
    heights, speeds = [], []
    for truth in truths:
        r_e, v_e = ecef_from_inertial(MISSION.earth, truth.t_s, truth.r_i, truth.v_i)
        heights.append(geodetic_from_ecef(r_e)[2])
        speeds.append(np.linalg.norm(v_e))
    assert flight["apogee_km"] == pytest.approx(max(heights) / 1e3)
    assert flight["max_speed_m_s"] == pytest.approx(max(speeds))
    # 797.6 km in the horizontal plane of the launch site, a little more along the curved Earth
    assert flight["range_km"] == pytest.approx(math.hypot(110.0, 790.0), rel=5e-3)
    assert flight["events"][1] == {
        "name": "burn_out_1", "t_s": 56.0, "altitude_km": pytest.approx(heights[114] / 1e3)
    }  # fmt: skip


def test_window_counts(data, summary):
    star = summary["star_tracker"]
    # slow from 235 to 384 s, frames start at 235.0 ... 383.9 s
    numbers = set(range(130, 1620))
    assert star_metrics.window_frames(data) == (numbers, 0)
    assert star["in_window"] == 1490
    failed = sum(1 for n in numbers if n % 25 == 3)
    assert star["no_fix"] == {"too_few_stars": failed}
    assert star["solved"] == 1490 - failed
    assert star["frames"] == len(data.frame_truths)
    assert star["wrong"] == 0


def test_a_wrong_fix_is_counted_wherever_it_is():
    half = math.radians(0.5)
    times = (230.0, 240.0, 240.1, 390.0)
    frames = [frame_truth(k, t, exclusion_met=t in times[1:3]) for k, t in enumerate(times)]
    fixes = [
        star_fix(0, 230.0, (0.0, 0.0, 1.02 * half)),
        star_fix(1, 240.0, (0.98 * half, 0.0, 0.0)),
        star_fix(2, 240.1, (2.0, 0.0, 0.0), reason=rec.Reason.NO_MATCH),  # not given as good
        star_fix(3, 390.0, (0.0, -1.02 * half, 0.0)),
    ]
    star = metrics.summarise(gathered([*frames, *fixes]))["star_tracker"]
    assert star["wrong"] == 2
    assert (star["in_window"], star["solved"], star["no_fix"]) == (2, 1, {"no_match": 1})


def test_error_axes_of_the_star_tracker():
    arcsec = math.radians(1.0 / 3600.0)
    frames = [frame_truth(k, 240.0 + 0.1 * k) for k in range(3)]
    fixes = [
        star_fix(0, 240.0, (6.0 * arcsec, 0.0, 0.0)),
        star_fix(1, 240.1, (0.0, -6.0 * arcsec, 30.0 * arcsec)),
        star_fix(2, 240.2, (0.0, 0.0, -40.0 * arcsec)),
    ]
    error = metrics.summarise(gathered([*frames, *fixes]))["star_tracker"]["error_arcsec"]
    assert error["cross_axis_rms"] == pytest.approx(math.sqrt(72.0 / 6.0), rel=1e-6)
    assert error["boresight_rms"] == pytest.approx(math.sqrt(2500.0 / 3.0), rel=1e-6)
    assert error["max"] == pytest.approx(40.0, rel=1e-6)
    assert error["mean"] == pytest.approx([2.0, -2.0, -10.0 / 3.0], rel=1e-6)
    data = gathered([*frames, *fixes])
    np.testing.assert_allclose(
        star_metrics.star_errors(data).rotation_c[1] / arcsec, [0.0, -6.0, 30.0], rtol=1e-6, atol=1e-9
    )


def test_what_is_outside_the_window():
    """Rate and exclusion angles decide, not the phase of the mission."""
    frames = [
        frame_truth(0, 20.0),
        frame_truth(1, 240.1, exclusion_met=False),
        frame_truth(2, 240.2, rate=math.radians(2.01)),
        frame_truth(3, 240.3, rate=math.radians(1.99)),
    ]
    assert star_metrics.window_frames(gathered(frames))[0] == {0, 3}


def test_a_hidden_sun_is_no_reason_to_be_outside_the_window():
    """Both angles within their limits; and the Sun behind the Earth."""
    limits = SimpleNamespace(sun_exclusion_rad=2.0, limb_exclusion_rad=1.0)
    lit = frame_truth(0, 240.0, exclusion_met=False)._replace(sun_angle=1.9, limb_angle=0.9)
    frames = [lit, lit._replace(number=1, limb_angle=1.1), lit._replace(number=2, sun_hidden=True)]
    expected = {"earth_limb": 1, "sun": 1, "sun_and_earth_limb": 1}
    assert star_metrics._outside(gathered(frames), set(), limits) == expected


def test_pointing_error_counts_while_pointing(data, summary):
    """Made: 0.3, -0.4, 1.2 deg about x, y, z while pointing, twice that in the manoeuvres around it."""
    control = summary["attitude_control"]
    assert control["pointing_error_deg"]["rms"] == pytest.approx(1.3)
    assert control["pointing_error_deg"]["max"] == pytest.approx(1.3)
    assert control["propellant_kg"] == pytest.approx(0.01 * (393.9 - 65.0))
    phase = pairing.phase_at(data.truth, np.array([224.0, 249.99, 250.0, 371.99, 372.0]))
    assert phase.tolist() == [
        -1,
        *(rec.Phase[name] for name in ("MANOEUVRE", "POINTING", "POINTING", "MANOEUVRE")),
    ]


def test_pointing_error_of_a_spinning_vehicle_is_that_of_its_axis():
    truth = synthetic_run.truth_at(MISSION, 300.0)
    sample = rec.ControlSample(300.0, np.radians([np.nan, 0.3, -0.4]), np.zeros(3), 0.2)
    nothing_wanted = sample._replace(t_s=300.1, pointing_error=np.full(3, np.nan))
    control = metrics.summarise(gathered([truth, sample, nothing_wanted]))["attitude_control"]
    assert control["pointing_error_deg"]["rms"] == pytest.approx(0.5)


def test_a_run_without_attitude_control_has_none():
    records = [synthetic_run.truth_at(MISSION, t) for t in (300.0, 300.01)]
    summary = metrics.summarise(gathered(records))
    assert summary["attitude_control"] is None
    summary_table(summary)


def test_missing_frames_and_results_count_against_the_star_tracker():
    times = [240.0, 240.1, 240.2, 240.5, 240.6, 240.7]
    frames = [frame_truth(k, t) for k, t in enumerate(times)]
    fixes = [star_fix(k, t) for k, t in enumerate(times) if k != 4]
    star = metrics.summarise(gathered([*frames, *fixes]))["star_tracker"]
    assert star["in_window"] == 8
    assert star["solved"] == 5
    assert star["no_fix"] == {"no_frame": 2, "no_result": 1}


def test_navigation_errors_have_the_made_size(summary, data):
    n = len(data.nav.t_s)
    navigation = summary["navigation"]
    for name, sigma in (
        ("position_error_m", synthetic_run.SIGMA_R),
        ("velocity_error_m_s", synthetic_run.SIGMA_V),
        ("attitude_error_deg", math.degrees(synthetic_run.SIGMA_THETA)),
    ):
        low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], 3 * n) / n) * sigma  # 99.9 %
        assert low < navigation[name]["rms"] < high
    errors = navigation_errors(data)
    nav = data.nav
    truth_again = np.array(
        [
            rotation.quat_multiply(q, rotation.quat_from_rotvec(e))
            for q, e in zip(nav.q_ib[:50], errors.attitude_b[:50], strict=True)
        ]
    )
    same = np.abs(np.einsum("ki,ki->k", truth_again, data.truth.q_ib[:50]))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)


def test_nees_epochs_and_value(summary):
    nees = summary["navigation"]["nees"]
    # accepted from 236.1 s (first gate at or after 236.0 s), so whole seconds 237 ... 410; entry at 410.9 s
    assert nees["samples"] == 174
    low, high = chi2.ppf([0.0005, 0.9995], 9 * 174) / 174  # 99.9 %
    assert low < nees["mean"] < high


def test_nees_needs_the_correlations():
    t_s = 250.0
    truth = synthetic_run.truth_at(MISSION, t_s)
    nav = synthetic_run._navigation(MISSION, truth, np.random.default_rng(2))
    root = np.random.default_rng(3).normal(size=(9, 9)) * np.repeat([4.0, 0.1, 1e-3], 3)[:, None]
    P = root @ root.T
    covariance = synthetic_run._covariance(t_s)._replace(P=P)
    data = gathered([truth, nav, covariance])
    errors = navigation_errors(data)
    times, nees, sigma = normalised_errors(data, errors)
    x = np.concatenate([errors.position_i[0], errors.velocity_i[0], errors.attitude_b[0]])
    assert times[0] == t_s
    assert nees[0] == pytest.approx(x @ np.linalg.inv(P) @ x, rel=1e-6)
    np.testing.assert_allclose(sigma[0], np.sqrt(np.diag(P)))


def test_entry_is_the_first_tick_below_100_km(summary, data):
    entry = summary["navigation"]["at_entry"]
    k = np.flatnonzero(np.abs(data.truth.t_s - entry["t_s"]) < 1e-9)[0]
    heights = []
    for j in (k - 1, k):
        r_e, _ = ecef_from_inertial(MISSION.earth, data.truth.t_s[j], data.truth.r_i[j], data.truth.v_i[j])
        heights.append(geodetic_from_ecef(r_e)[2])
    assert heights[0] > 100e3 >= heights[1]
    assert entry["altitude_km"] == pytest.approx(heights[1] / 1e3)
    error = data.truth.r_i[k] - data.nav.r_i[k]
    assert entry["position_error_m"] == pytest.approx(np.linalg.norm(error))
    assert entry["attitude_sigma_deg"] == pytest.approx([math.degrees(synthetic_run.SIGMA_THETA)] * 3)


def test_a_covariance_of_long_before_the_entry_is_not_that_of_entry(summary, data):
    at_s, P = summary["navigation"]["at_entry"]["t_s"], data.covariance
    for last_s, is_known in ((at_s - 0.9, True), (at_s - 1.2, False)):
        cut = P._replace(**{name: column[P.t_s <= last_s] for name, column in P._asdict().items()})
        entry = metrics.summarise(data._replace(covariance=cut))["navigation"]["at_entry"]
        assert (entry["position_sigma_m"] is not None) is is_known
        assert (entry["nees"] is not None) is is_known and entry["position_error_m"] is not None


def test_an_impact_on_the_other_side_of_the_earth_has_no_range(data):
    """Vincenty's iteration has no answer there; the other figures are there all the same."""
    known = data._replace(events=[rec.Event(data.truth.t_s[-1], "impact", 0.0, "")])
    place = metrics.summarise(known)["flight"]["at_impact"]
    latitude, longitude = -math.radians(place["latitude_deg"]), math.radians(place["longitude_deg"]) + math.pi
    mission = data.mission._replace(launch_latitude=latitude, launch_longitude=longitude)
    found = metrics.summarise(known._replace(mission=mission))["flight"]
    assert found["range_km"] is None and found["at_impact"] == place


def test_a_run_without_stars_or_entry_has_nulls():
    few = [
        r for r in synthetic_run.simulate(synthetic_run.Options(start_s=-2.0, end_s=3.0, frame_pixels=False))
    ]
    summary = metrics.summarise(gathered(few))
    assert summary["navigation"]["at_entry"] is None
    nothing = {"mean": None, "dof": 9, "samples": 0, "why": None, "times_sigma": None}
    assert summary["navigation"]["nees"] == nothing
    assert summary["star_tracker"]["error_arcsec"]["max"] is None
    assert summary["star_tracker"]["chain_ms"] == {"median": None, "p99": None}
    assert summary["flight"]["range_km"] is None
    assert summary["wall_s"] is summary["real_time_factor"] is summary["log"] is None
    summary_table(summary)


def circling(record, height=400e3):
    """The record of truth or navigation moved to a height at which it stays: no entry, no impact."""
    away = height * record.r_i / np.linalg.norm(record.r_i)
    return record._replace(r_i=record.r_i + away)


def test_without_entry_the_nees_covers_the_run_to_its_end():
    """As in orbit: above 100 km from the first record to the last."""
    records = []
    for record in synthetic_run.simulate(OPTIONS):
        if isinstance(record, rec.TruthSample | rec.NavSolution):
            record = circling(record)
        if not isinstance(record, rec.Event):
            records.append(record)
    summary = metrics.summarise(gathered(records))
    assert summary["flight"]["range_km"] is None
    assert summary["flight"]["events"] == []
    assert summary["navigation"]["at_entry"] is None
    assert summary["navigation"]["nees"]["samples"] == 179  # whole seconds 237 ... 415
    summary_table(summary)


def test_whole_seconds_count_from_the_start_of_the_run():
    """A run that starts between two seconds has its covariances between them too."""
    options = OPTIONS._replace(start_s=225.034, end_s=260.034)
    mission = synthetic_run.mission(start_s=options.start_s)
    builder = RunDataBuilder(mission)
    for record in synthetic_run.simulate(options):
        builder.add(record)
    nees = metrics.summarise(builder.build())["navigation"]["nees"]
    assert nees["samples"] == 24  # accepted from 236.134 s on: 237.034 ... 260.034 s


def test_an_empty_run_has_nulls():
    summary = metrics.summarise(gathered([]))
    assert summary["flight"]["apogee_km"] is None
    assert summary["navigation"]["position_error_m"] == {"rms": None, "max": None}
    summary_table(summary)


def test_an_apogee_is_one_only_if_it_was_reached(records):
    data = gathered(records)
    apogee = rec.Event(100.0, "apogee", 176e3, "")
    others = [event for event in data.events if event.name != "apogee"]
    cut = data.summary._replace(until_s=data.last_t_s)
    for events, summary, ended_early, given in (
        (others, data.summary, False, True),  # seen to its end: the greatest height is the apogee
        (others, cut, False, False),
        (others, data.summary, True, False),
        ([*others, apogee], cut, False, True),
    ):
        seen = data._replace(events=events, summary=summary, ended_early=ended_early)
        found = metrics.summarise(seen)
        assert (found["flight"]["apogee_km"] is not None) == given
        assert (found["flight"]["at_apogee"] is not None) == given
        assert found["flight"]["max_speed_m_s"] > 100.0
        names = [name for _, lines in rows(found) for name, _ in lines]
        assert ("apogee" in names) == given and "motion" not in names


def test_the_builder_knows_how_far_it_is(records):
    builder = RunDataBuilder(MISSION)
    assert math.isnan(builder.last_t_s)
    for record in records[:500]:
        builder.add(record)
    assert builder.last_t_s == builder.build().last_t_s == builder.build().truth.t_s[-1]


def test_the_table_shows_the_figures(summary):
    from rich.console import Console

    console = Console(width=120, record=True, file=io.StringIO())
    console.print(summary_table(summary | {"ended_early": True}))
    text = console.export_text()
    for expected in (
        "made_up, seed 1", "1490 in the window", "59 too few stars", "at 100 km", "ended early",
        "cold gas used", "3.29 kg", "1.30 deg rms",
    ):  # fmt: skip
        assert expected in text


def test_no_two_rows_of_a_section_have_the_same_name(summary):
    """A log that was cut has a name as well."""
    told = {"ended_early": True, "until_s": 300.0, "log": "run.mcap"}
    for section, lines in dict(rows(summary | told)).items():
        names = [name for name, _ in lines]
        if section == "run":
            assert len(names) == len(set(names))
            assert {"ended early", "looked at", "log"} <= set(names)
