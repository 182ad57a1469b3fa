"""Rows of the table: readings of instruments that met the gate and were used; frames that were refused."""

import numpy as np

from shefex_nav.log import reader
from shefex_nav.records import Doubt, GateResult
from shefex_nav.report import metrics, page, table, trust
from shefex_nav.report.metrics import instrument_use
from shefex_nav.report.table import _flight_rows, _navigation_rows, loss_rows
from shefex_nav.report.table_rows import star_rows

NONE = np.empty(0)


def gate(sensor, accepted, dof=1):
    return GateResult(1.0, 1.0, sensor, dof, 1.0, 16.0, accepted, "", NONE)


def test_what_never_met_the_gate_does_not_count():
    """Readings beyond a height or too late have no degrees of freedom; GPS and stars have other rows."""
    used = [gate("barometer", True)] * 10 + [gate("barometer", False)] * 2
    unfit = [gate("barometer", False, dof=0)] * 90
    others = [gate(name, True, 3) for name in ("gps_position", "star_tracker", "gps_range", "star_vectors")]
    assert instrument_use([*used, *unfit, *others]) == {"barometer": {"readings": 12, "used": 10}}
    assert instrument_use(others) == {}


def test_the_table_names_each_and_marks_one_that_is_mostly_refused(log):
    navigation = metrics.summarise(reader.read(log))["navigation"]
    assert navigation["instruments"] == {}
    navigation["instruments"] = {
        "radar_altimeter": {"readings": 825, "used": 0}, "barometer": {"readings": 12, "used": 10},
    }  # fmt: skip
    rows = dict(_navigation_rows(navigation))
    assert str(rows["radar altimeter"]) == "0 of 825 readings used" and rows["radar altimeter"].style
    assert str(rows["barometer"]) == "10 of 12 readings used" and not rows["barometer"].style


def test_errors_without_a_truth_have_no_rows(log):
    """Three lines of dashes at the top of a table say nothing; those that are known stay."""
    navigation = metrics.summarise(reader.read(log))["navigation"]
    names = ("position error", "velocity error", "attitude error")
    assert set(names) <= set(dict(_navigation_rows(navigation)))
    none = {"rms": None, "max": None}
    rows = dict(_navigation_rows(navigation | {"position_error_m": none, "attitude_error_deg": none}))
    assert [name in rows for name in names] == [False, True, False]


def test_errors_of_a_part_of_the_flight_say_so(log):
    """Software that has a solution for a fifth of the flight has errors of that fifth."""
    data = reader.read(log)
    navigation = metrics.summarise(data)["navigation"]
    assert "solution" not in dict(_navigation_rows(navigation))
    few = len(data.nav.t_s) // 5
    nav = data.nav._replace(**{name: column[:few] for name, column in data.nav._asdict().items()})
    row = dict(_navigation_rows(metrics.summarise(data._replace(nav=nav))["navigation"]))["solution"]
    assert str(row).startswith("at 20.0 % of the ticks alone; errors and shares of the time are of these")


def test_heights_say_above_what(log):
    flight = metrics.summarise(reader.read(log))["flight"]
    rows = dict(_flight_rows(flight | {"apogee_km": 5.58, "climbs_at_km": None, "events": []}, stood=True))
    assert rows["apogee"] == "5.6 km above the ellipsoid"
    rows = dict(_flight_rows(flight | {"apogee_km": None, "climbs_at_km": 3.5}, stood=True))
    assert rows["height at the end"] == "3.5 km above the ellipsoid, no apogee before it"


def test_frames_refused_for_their_residuals_are_explained(log):
    star = metrics.summarise(reader.read(log))["star_tracker"] | {"frames": 100, "no_fix": {"residuals": 21}}
    assert "centroid_floor" in str(dict(star_rows(star))["residuals"])
    assert "residuals" not in dict(star_rows(star | {"no_fix": {"residuals": 19}}))


def test_frames_refused_for_their_light_are_explained(log):
    """Saturated and too few stars say which figure is behind it, and what changes it."""
    star = metrics.summarise(reader.read(log))["star_tracker"] | {"frames": 100}
    grey = {"saturated_dn": {"median": 136.4, "limit": 100.0}}
    words = str(dict(star_rows(star | grey | {"no_fix": {"saturated": 21}}))["saturated"])
    assert "136 DN (median), above 100 DN (star_tracker.exposure.brightest_mean)" in words
    few = {"no_fix": {"too_few_stars": 21}, "objects_without_fix": 2.0}
    words = str(dict(star_rows(star | few))["too few stars"])
    assert "such a frame: 2 (median)" in words and "exposure.longest" in words
    assert "too few stars" not in dict(star_rows(star | few | {"no_fix": {"too_few_stars": 20}}))


def test_the_constant_part_of_star_errors_is_told_apart(log):
    """3, 4 arcsec of every fix are 5/sqrt(2) rms per axis; the rest is scatter."""
    star = metrics.summarise(reader.read(log))["star_tracker"]
    star["error_arcsec"] |= {"cross_axis_rms": 4.0, "boresight_rms": 5.0, "mean": [3.0, 4.0, -3.0]}
    star["solved"] = 1000
    found = dict(star_rows(star))
    assert found["error across the boresight"] == (
        '4.0" rms per axis: constant 3.5" (principal point), scatter 1.9"'
    )
    assert found["error about the boresight"] == '5.0" rms: constant 3.0", scatter 4.0"'
    star["error_arcsec"] |= {"cross_axis_rms": None, "mean": None}
    assert dict(star_rows(star))["error across the boresight"] == "-"


def test_the_scatter_of_few_fixes_has_what_their_mean_took_of_it(log):
    """Of the same errors drawn again and again: its square is right on average, as that of by_rate is."""
    star, errors = metrics.summarise(reader.read(log))["star_tracker"], np.random.default_rng(3)
    for n in (2, 3):
        squares = []
        for z in 10.0 * errors.standard_normal((4000, n)):
            error = {"boresight_rms": float(np.sqrt(np.mean(z**2))), "mean": [0.0, 0.0, float(z.mean())]}
            words = dict(star_rows(star | {"solved": n, "error_arcsec": star["error_arcsec"] | error}))
            squares.append(float(words["error about the boresight"].rpartition(" ")[2].strip('"')) ** 2)
        assert abs(np.sqrt(np.mean(squares)) / 10.0 - 1.0) < 0.05
    alone = star | {"solved": 1, "error_arcsec": star["error_arcsec"] | {"mean": [3.0, 4.0, -3.0]}}
    assert "scatter" not in dict(star_rows(alone))["error about the boresight"]


def test_the_mounting_error_has_a_row_of_its_own(log):
    star = metrics.summarise(reader.read(log))["star_tracker"]
    words = dict(star_rows(star | {"mounting_error_deg": [0.03, -0.04, 0.12]}))["mounting error"]
    assert words == "0.130 deg, in the attitude of the body alone: not in the errors above"
    assert "mounting error" not in dict(star_rows(star | {"mounting_error_deg": None}))


def test_frames_too_near_to_both_sun_and_limb_are_told(log):
    star = metrics.summarise(reader.read(log))["star_tracker"]
    star |= {"outside": {"sun": 1, "sun_and_earth_limb": 2, "earth_limb": 3}, "fixes": star["solved"]}
    star["no_fix_outside"] = {}
    words = dict(star_rows(star))["outside it"]
    assert words == "6: 1 too near to the Sun, 2 to both Sun and Earth's limb, 3 to the Earth's limb"
    star |= {"outside": {"sun_and_earth_limb": 2}, "fixes": star["solved"] + 1}
    assert (
        dict(star_rows(star))["outside it"]
        == "2: 2 too near to both Sun and Earth's limb; 1 solved all the same"
    )


def test_success_by_rate_has_rows_where_the_rates_differ(log):
    star = metrics.summarise(reader.read(log))["star_tracker"]
    slow = {"from_deg_s": 0.0, "to_deg_s": 0.25, "frames": 9, "solved": 8, "wrong": 1, "nees": 2.94}
    slow |= {"cross_axis_scatter_arcsec": 0.32, "boresight_scatter_arcsec": 2.9}
    fast = {"from_deg_s": 15.0, "to_deg_s": None, "frames": 4, "solved": 0, "wrong": 0, "nees": None}
    rows = dict(star_rows(star | {"by_rate": [slow, fast]}))
    words = '8 of 9 solved, 1 wrong; scatter 0.3" across per axis, 2.9" about; NEES 2.9 of 3'
    assert rows["at 0 to 0.25 deg/s"] == words
    assert rows["at more than 15 deg/s"] == "0 of 4 solved"
    none = slow | {"solved": 0, "wrong": 0, "nees": None}
    rows = dict(star_rows(star | {"by_rate": [slow, none | {"from_deg_s": 3.0, "to_deg_s": 4.0}, fast]}))
    assert rows["at more than 3 deg/s"] == "0 of 13 solved" and len([n for n in rows if "deg/s" in n]) == 2
    assert not any("deg/s" in name for name in dict(star_rows(star | {"by_rate": [slow]})))


def test_frames_without_a_fix_are_told_in_the_window_and_out_of_it(log):
    star = metrics.summarise(reader.read(log))["star_tracker"]
    star |= {"outside": {"rate": 30}, "fixes": star["solved"] + 8, "no_fix_outside": {"smeared": 22}}
    rows = dict(star_rows(star | {"no_fix": {"no_match": 2}}))
    assert rows["no fix in the window"] == "2 no match"
    words = "30: 30 faster than the window's 2 deg/s; 8 solved all the same; no fix: 22 smeared"
    assert rows["outside it"] == words


def noticed(source, from_s, until_s, reason):
    return {"source": source, "from_s": from_s, "until_s": until_s, "reason": reason}


def test_lasting_losses_of_gps_have_a_row_and_short_ones_none():
    short, long = noticed("gps", 5.0, 15.0, "no fix: spin"), noticed("gps", 240.2, 840.2, "no fix: outage")
    never = noticed("gps", 0.1, None, "no fix: beyond its 50 km")
    other = noticed("gyro y", 100.0, 300.0, "stuck")
    assert list(loss_rows([short, other])) == []
    assert list(loss_rows([short, long])) == [("gps", "T+240.2 s to T+840.2 s: no fix: outage")]
    assert list(loss_rows([never])) == [("gps", "T+0.1 s to the end: no fix: beyond its 50 km")]


def test_doubts_have_one_name_and_the_limit_with_it():
    assert trust.doubt_words(Doubt.LEVEL, "attitude", 0.17, True) == (
        "protection level above 0.17 deg (requirements.attitude.limit, by default)"
    )
    assert trust.doubt_words(Doubt.LEVEL, "velocity", 1.0) == (
        "protection level above 1 m/s (requirements.velocity.limit)"
    )
    assert trust.doubt_words(Doubt.LEVEL, "position") == "protection level above requirements.position.limit"
    assert trust.DOUBTS.keys() == set(Doubt) - {Doubt.NONE}


def test_table_and_page_say_the_same_of_a_doubt(log):
    """Of ticks at which the IMU is blind, with a limit that the scenario leaves to the program."""
    data = reader.read(log)
    blind, n = np.full(len(data.nav.t_s), int(Doubt.IMU)), len(data.nav.t_s)
    nav = data.nav._replace(
        do_not_use_attitude=np.ones(n, dtype=bool), doubt_attitude=blind,
        protection_attitude=np.full((n, 3), 0.1),
    )  # fmt: skip
    data = data._replace(nav=nav)
    one = metrics.summarise(data)["navigation"]["integrity"]["attitude"]
    words = table._doubts("attitude", one)
    (incident,) = [one for one in page.incidents(data) if one.what.startswith("attitude not to be")]
    assert words.endswith("the IMU does not measure the motion")
    assert incident.what.endswith("the IMU does not measure the motion")


def test_levels_beyond_half_a_turn_are_unknown():
    one = {"limit_deg": 0.17, "limit_by_default": False}
    one["at_entry"] = {"usable": False, "doubt": "imu", "protection_deg": [0.4, 356.0, 3.2]}
    assert table._entry_words("attitude", one).endswith("protection level unknown")
    one["at_entry"]["protection_deg"][1] = 179.0
    assert "0.400, 179.000, 3.200 deg" in table._entry_words("attitude", one)
