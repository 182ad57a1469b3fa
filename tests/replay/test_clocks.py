"""Offset of the clocks of IMU and GNSS, from the motion alone and by the filter."""

import drive
import numpy as np
import pytest

from shefex_nav.environment import ephemeris, gravity
from shefex_nav.geometry import wgs84
from shefex_nav.records import GpsFix
from shefex_nav.replay import clocks, external, load, params, said
from shefex_nav.replay.dataset import Increments
from shefex_nav.scenario.data_table import DataError

EARTH = ephemeris.earth_rotation("2020-06-01T12:00:00", 0.0, 0.0, 0.0)
COURSE = "{method: course, speed: 5 m/s, sideslip: 1 deg}"


def late(data, shift_s):
    """The same, stamped later by shift_s."""
    moved = [
        fix._replace(t_valid_s=fix.t_valid_s + shift_s, t_available_s=fix.t_available_s + shift_s)
        for fix in data.fixes
    ]
    return data._replace(fixes=moved)


@pytest.fixture(scope="module")
def drives():
    rng = np.random.default_rng(7)
    return [drive.sensed(drive.drive(EARTH, 60.0, heading=h), rng) for h in (0.3, 2.9)]


@pytest.mark.parametrize("shift_s", [0.0, 0.15, -0.8, 2.0, 3.0, -7.0, 18.0])
def test_an_offset_is_found(shift_s, drives):
    for data in drives:
        found = clocks.find(data.imu, late(data, shift_s).fixes, drive.LEVER)
        assert 0.02 < found.sigma_s < 0.1
        assert abs(found.offset_s - shift_s) < 0.03


def test_it_is_told_if_it_matters(drives):
    scenario = load.load_text(drive.scenario_text(COURSE), "drive.yaml")
    data, common = clocks.made_one(scenario, late(drives[0], 0.6))
    ((field, words),) = clocks.oddities(common)
    assert field == "gnss.clock_offset" and common.applied_s == 0.0
    assert float(words.partition("stamped ")[2].partition(" s")[0]) == pytest.approx(0.6, abs=0.03)
    assert data.fixes[0].t_valid_s == pytest.approx(1.1)
    _, common = clocks.made_one(scenario, drives[0])
    assert not list(clocks.oddities(common))


def test_a_given_offset_and_one_to_be_found(drives):
    for word, tolerance in (("0.6 s", 1e-12), ("find", 0.05)):
        gnss = f"{{lever_arm: [1 m, 0.2 m, -1.2 m], clock_offset: {word}}}"
        scenario = load.load_text(drive.scenario_text(COURSE, gnss=gnss), "drive.yaml")
        data, common = clocks.made_one(scenario, late(drives[0], 0.6))
        assert common.applied_s == pytest.approx(0.6, abs=tolerance)
        assert data.fixes[3].t_valid_s == pytest.approx(drives[0].fixes[3].t_valid_s, abs=tolerance)
        assert not list(clocks.oddities(common))


def test_what_stands_still_shows_no_clock():
    data = drive.sensed(drive.drive(EARTH, 40.0, speed=0.0), np.random.default_rng(1))
    assert clocks.find(data.imu, data.fixes) is None
    gnss = "{clock_offset: find}"
    scenario = load.load_text(drive.scenario_text(COURSE, gnss=gnss), "drive.yaml")
    with pytest.raises(
        DataError, match=r"gnss\.clock_offset: 'find': within 20 s the motion does not show it"
    ):
        clocks.made_one(scenario, data)
    without = [fix._replace(v_ea_e=np.full(3, np.nan)) for fix in data.fixes]
    assert clocks.find(data.imu, without) is None


def climb(acceleration, times_s, rng, late_s=0.0, length_s=30.0, step_s=0.01):
    """Increments of a vehicle that climbs with acceleration(t_s) [m/s^2], and fixes stamped late_s later."""
    t_s = np.arange(0.0, length_s, step_s)
    r_e = wgs84.ecef_from_geodetic(1.1, 0.3, 300.0)
    up_e, g = -wgs84.level_axes(r_e)[:, 2], float(np.linalg.norm(gravity.normal_gravity_e(r_e)))
    dv_b = np.zeros((len(t_s), 3))
    dv_b[:, 0] = step_s * (g + acceleration(t_s)) + 1e-3 * rng.standard_normal(len(t_s))
    imu = Increments(t_s, np.zeros_like(dv_b), dv_b, np.zeros(len(t_s), dtype=bool))
    v = step_s * np.cumsum(acceleration(t_s))
    h = step_s * np.cumsum(v)
    fixes = []
    for t in times_s:
        v_e = np.interp(t, t_s, v) * up_e + 0.05 * rng.standard_normal(3)
        place = r_e + np.interp(t, t_s, h) * up_e
        noise = np.eye(3), 0.05**2 * np.eye(3)
        stamp = t + late_s
        fixes.append(GpsFix(stamp, stamp, True, place, v_e, *noise, n_satellites=9, pdop=1.0, reason=""))
    return imu, fixes


def lift_off(times_s):
    """Of 30 s of a rocket that stands until 9.3 s and then climbs with 20 m/s^2."""
    return climb(lambda t_s: 20.0 * (t_s > 9.3), times_s, np.random.default_rng(11))


@pytest.mark.parametrize("period_s", [4.23, 4.88, 5.51, 6.17, 6.94])
def test_a_motion_that_repeats_itself_tells_no_offset(period_s):
    """A swing of one period looks the same a period later; one that begins in the middle does not."""
    rng, times_s = np.random.default_rng(3), np.arange(0.5, 59.0, 1.0)

    def swings(t_s):
        return 6.0 * np.sin(2.0 * np.pi * t_s / period_s)

    def begins(t_s):
        return np.where(t_s < 20.0, 0.0, swings(t_s))

    for _ in range(3):
        assert clocks.find(*climb(swings, times_s, rng, 0.2, 60.0)) is None
    found = clocks.find(*climb(begins, times_s, rng, 0.2, 60.0))
    assert abs(found.offset_s - 0.2) < 4.0 * found.sigma_s < 0.1


def kind_of(times_s, felt):
    """A _Kind of pairs of fixes that begin at these times, a second apart; GNSS says zero of each."""
    zero = np.zeros(len(times_s))
    return clocks._Kind(
        times_s, times_s + 1.0, zero, zero + 0.1, lambda shift_s: felt(times_s + shift_s), 0.0
    )


def test_kinds_that_no_shift_has_in_common_and_pairs_that_none_has_tell_nothing():
    """Pairs before and after the 20 s of the IMU: no shift brings both kinds into its data."""
    data = climb(lambda t_s: 0.0 * t_s, [], np.random.default_rng(1), length_s=20.0)[0]
    seen, shifts_s = clocks.Seen(data, np.zeros(3)), np.arange(-20.0, 20.0, 0.05)
    before, after = kind_of(np.arange(-19.0, -1.0), np.sin), kind_of(np.arange(21.0, 39.0), np.sin)
    assert clocks._least([before, after], seen, shifts_s) is None
    assert clocks._excess([before], seen, -15.0, 15.0) == 0.0


def test_an_offset_that_the_fixes_do_not_fix_is_not_told():
    """Without the fix around lift-off the motion between two of them may begin anywhere: no offset at all."""
    times_s = np.arange(0.5, 29.0, 1.0)
    found = clocks.find(*lift_off(times_s))
    assert abs(found.offset_s) < 4.0 * found.sigma_s < 0.2
    gone = times_s[np.abs(times_s - 9.3) > 0.9]
    assert len(gone) < len(times_s) and clocks.find(*lift_off(gone)) is None


def test_the_filter_estimates_what_is_left(drives):
    """A rest of 40 ms is in the state gps_latency, with its sign: fixes that are older than they say."""
    more = "\nnavigation: {states: [gps_latency], sensors: {gps_latency_error: 50 ms}}\n"
    scenario = load.load_text(drive.scenario_text(COURSE) + more, "drive.yaml")
    data = late(drives[1], 0.04)
    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.replay import align

    start = align.align(scenario, data, EARTH)
    blocks = external.imu_blocks(data.imu, 4, start.t_valid_s)
    ready = external.Replay(scenario, data, EARTH, start, blocks, None)
    kept = RunDataBuilder(external.mission(ready))
    for record in external.run(ready, external.Clock()):
        kept.add(record)
    found = said.clocks(clocks.Clocks(None, 0.0), kept.build())
    assert found["sigma_gps_latency_s"] < 0.01
    assert abs(found["gps_latency_s"] - 0.04) < 4.0 * found["sigma_gps_latency_s"]
    assert params.nav_params(scenario, 0.01).states[-1] == "gps_latency"
