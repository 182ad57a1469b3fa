"""Barometer and fixes without height in the filter: Jacobians, what lasts, limits of use, a new bias."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import MODEL, PARAMS
from unpacked import correct

from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.instruments import state_sizes
from shefex_nav.instruments.barometer import Barometer, BarometerReading, BarometerUse, Day, DriftWatch, Port
from shefex_nav.instruments.instrument import Release
from shefex_nav.onboard.navigation import aiding, fusion, integrity_gps, measure_barometer, measurements
from shefex_nav.onboard.navigation.aid import Aid, Block, Renewal
from shefex_nav.onboard.navigation.state import NavState, layout, pack
from shefex_nav.records import Alignment, GpsFix, ImuBlock

EARTH = frames.EarthRotation(
    rotation.dcm_from_rotvec(np.array([1e-3, -2e-3, 5e-4])), np.eye(3), 2.5, 7.292115e-5
)
SITE = np.deg2rad(67.89), np.deg2rad(21.1)
STEP = np.concatenate([np.repeat([1.0, 1e-2, 1e-5, 1e-4, 1e-2], 3), [1.0, 1.0], np.full(8, 1e-5)])
SETTINGS = Barometer(
    rate=10.0,
    latency=0.0,
    bias=100.0,
    drift=0.0,
    drift_time=300.0,
    noise=5.0,
    lag=0.05,
    quantum=0.0,
    lowest=0.0,
    highest=1.2e5,
    port=Port(mach=(0.0, 1.0, 2.0), coefficient=(0.0, 0.02, 0.01), error=0.25),
    day=Day(pressure=800.0, temperature=8.0, depth=8e3),
)
USE = BarometerUse(
    used=True,
    up_to=30e3,
    unused_mach=(0.8, 1.3),
    flow_error=0.005,
    flow_memory=20.0,
    lag_error=0.2,
    drift=DriftWatch(chance=1e-9, fastest=np.inf),
    release=Release(rejections=5, duration=0.4),
)
BAROMETER = measure_barometer.Model(SETTINGS, USE, measure_barometer.of_layers(SETTINGS.day))


def aid_of(model):
    """Aid of a filter."""
    blocks = (
        Block("baro_bias", np.diag([100.0, 65.0]) ** 2, np.array([1.0, 0.0])),
        Block("baro_scale", model.P_scale, np.zeros(8)),
    )
    expect, unfit = (partial(one, model) for one in (measure_barometer.expect, measure_barometer.unfit))
    renewal = Renewal("baro_bias", 1e4, 5, 0.4, "new bias")
    return Aid("barometer", BarometerReading, expect, blocks, unfit=unfit, renewal=renewal)


AID = aid_of(BAROMETER)
LAYOUT = layout(("baro_bias", "baro_scale"), AID.blocks)


def state_at(height, climb=300.0, t_s=50.0, others=True):
    rng = np.random.default_rng(4)
    r_e, C_en = wgs84.ecef_from_geodetic(*SITE, height), wgs84.dcm_en(*SITE)
    r_i, v_i = frames.inertial_from_ecef(EARTH, t_s, r_e, C_en @ np.array([40.0, -20.0, -climb]))
    q_ib = rotation.quat_normalise(rng.standard_normal(4))
    values = np.concatenate([[120.0, -45.0], 0.02 * rng.standard_normal(8)]) if others else np.empty(0)
    return NavState(t_s, r_i, v_i, q_ib, np.zeros(3), np.zeros(3), others=values)


def here(state, order=LAYOUT):
    return aiding.Here(order, EARTH, state.t_s, pack(state))


def reading_of(state, pressure=0.0, order=LAYOUT, model=BAROMETER):
    """z, H, and R with what lasts."""
    seen = measure_barometer.expect(
        model, here(state, order), BarometerReading(state.t_s, state.t_s, pressure)
    )
    return seen.z, seen.H, seen.R + sum(one for one, _ in seen.lasting)


@pytest.mark.parametrize("height", [-50.0, 300.0, 5000.0, 11_500.0, 25_000.0])
def test_the_jacobian_is_what_perturbing_the_state_gives(height):
    """But for what the flow does: the part of q at the port is taken from the state, its Jacobian is not."""
    state, model = state_at(height), BAROMETER._replace(settings=replace(SETTINGS, port=None))
    _, H, _ = reading_of(state, model=model)
    for k in range(LAYOUT.n):
        e = np.zeros(LAYOUT.n)
        e[k] = STEP[k]
        ahead, behind = (reading_of(correct(LAYOUT, state, s * e), model=model)[0] for s in (1.0, -1.0))
        numeric = (behind[0] - ahead[0]) / (2.0 * STEP[k])  # z falls as the expected reading grows
        assert H[0, k] == pytest.approx(numeric, rel=2e-4, abs=2e-6 * abs(H[0]).max()), k


def test_the_reading_of_a_known_place_leaves_no_innovation():
    """Pressure of the Standard at the height that the errors of bias and warmth leave, lagging behind."""
    state = state_at(3000.0)
    felt = 3000.0 - 0.05 * 300.0
    level = felt + 45.0 - state.others[2] * 1500.0 - state.others[3] * (felt - 1500.0)
    density, _, _, sound = atmosphere.us76(3000.0)
    speed = np.sqrt(40.0**2 + 20.0**2 + 300.0**2)
    flow = 0.02 * speed / sound * 0.5 * density * speed**2  # the coefficient rises to 0.02 at Mach 1
    told = atmosphere.us76(level)[1] + 120.0 + flow
    z, _, _ = reading_of(state, told)
    assert abs(z[0]) < 1e-3


def test_layers_of_a_day_that_goes_with_itself():
    """Covariance of the means of the layers over 4000 days, to four of its own standard deviations."""
    rng, step, depth = np.random.default_rng(2), 50.0, 8e3
    hot = Day(pressure=0.0, temperature=100.0, depth=depth)
    n = round(measure_barometer.LAST_TOP / step)
    keeps = np.exp(-step / depth)
    s, days = np.empty((4000, n)), rng.standard_normal((4000, n))
    s[:, 0] = days[:, 0]
    for k in range(1, n):
        s[:, k] = keeps * s[:, k - 1] + np.sqrt(1.0 - keeps**2) * days[:, k]
    s *= [100.0 / atmosphere.us76((k + 0.5) * step)[2] for k in range(n)]
    edges = (np.array([*measure_barometer.LAYERS, measure_barometer.LAST_TOP]) / step).astype(int)
    means = np.column_stack([s[:, a:b].mean(axis=1) for a, b in pairwise(edges)])
    P = measure_barometer.of_layers(hot)
    scatter = np.sqrt((np.outer(np.diag(P), np.diag(P)) + P**2) / 4000.0)
    assert np.abs((np.cov(means.T) - P) / scatter).max() < 4.0
    for height in (500.0, 7500.0, 26_000.0):  # and of what the means leave at a height
        cell, layer = round(height / step), np.searchsorted(edges * step, height, side="right") - 1
        left = step * (s[:, edges[layer] : cell].sum(axis=1) - (cell - edges[layer]) * means[:, layer])
        told = measure_barometer._left(hot, height)
        assert np.var(left) == pytest.approx(told, rel=0.1)


def test_errors_that_last_make_a_reading_count_less_but_pass_the_gate_alike():
    state = state_at(5000.0)
    _, _, R = reading_of(state)
    nav = SimpleNamespace(earth=EARTH, layout=LAYOUT, history=SimpleNamespace(x=pack(state)))
    counted = aiding.sensor(AID).counted(nav, BarometerReading(state.t_s, state.t_s, 0.0), R, 0.1)
    slow = np.exp(-0.1 / USE.flow_memory)
    assert R[0, 0] > SETTINGS.noise**2
    assert counted[0, 0] > 10.0 * R[0, 0]
    assert counted[0, 0] < (1.0 + slow) / (1.0 - slow) * R[0, 0]


def test_a_reading_is_not_used_high_up_in_shocks_and_at_the_end_of_its_range():
    def why(height, climb, **more):
        state = state_at(height, climb)
        fix = BarometerReading(state.t_s, state.t_s, 5e4, **more)
        return AID.unfit(here(state), fix)

    assert why(1000.0, 100.0) == ""
    assert why(31e3, 100.0) == "not used: above 30 km"
    assert why(1000.0, 350.0) == "not used: Mach 1.05, shocks cross the port"
    assert why(1000.0, 500.0) == ""
    assert why(1000.0, 0.0, at_limit=True) == "not used: the sensor is at an end of its range"


# a vehicle that stands on the pad


def stand(readings, seconds, fixes=(), states=("baro_bias", "baro_scale"), climb=0.0, aid=AID):
    """Filter of a vehicle at rest that hears readings and fixes as they become available. -> nav, results

    climb : m/s, of one that is not at rest
    """
    height, rng = 360.0, np.random.default_rng(1)
    r_e, C_en = wgs84.ecef_from_geodetic(*SITE, height), wgs84.dcm_en(*SITE)
    r_i, v_i = frames.inertial_from_ecef(EARTH, 0.0, r_e, -climb * C_en[:, 2])
    q_ib = rotation.quat_from_dcm(frames.dcm_ie(EARTH, 0.0) @ C_en)
    begin = Alignment(0.0, r_i, v_i, q_ib, 3.0, 0.01, 1e-6 * np.eye(3))
    params = PARAMS._replace(states=states, sigma_blocks={}, aids=(aid,), imu=MODEL)
    nav, results = fusion.start(params, begin, EARTH), []
    waiting = sorted([*readings, *fixes], key=lambda one: one.t_available_s)
    from shefex_nav.environment import gravity

    g = float(np.linalg.norm(gravity.normal_gravity_e(r_e)))
    turn = np.array([wgs84.OMEGA * np.cos(SITE[0]), 0.0, -wgs84.OMEGA * np.sin(SITE[0])]) / 400.0
    dtheta_b, dv_b = np.tile(turn, (4, 1)), np.tile([0.0, 0.0, -g / 400.0], (4, 1))
    for k in range(1, round(100 * seconds) + 1):
        noise = 1e-7 * rng.standard_normal((4, 3))
        fusion.advance(nav, ImuBlock(0.01 * k, 0.01 * k, 1.0 / 400.0, dtheta_b + noise, dv_b + noise, False))
        due = [one for one in waiting if one.t_available_s <= 0.01 * k + 1e-6]
        waiting = [one for one in waiting if one.t_available_s > 0.01 * k + 1e-6]
        if due:
            named = [(aid.name if type(one) is BarometerReading else "gps", one) for one in due]
            results += fusion.fuse(nav, named)
    return nav, results


def on_the_pad(seconds, off=180.0, late_s=0.0, step=None):
    """Readings of a pad at 360 m, off by a bias, and by more from a time on."""
    true, rng = atmosphere.us76(360.0)[1], np.random.default_rng(8)
    return [
        BarometerReading(
            0.1 * k, 0.1 * k + late_s,
            true + off + 5.0 * rng.standard_normal() + (step[1] if step and 0.1 * k > step[0] else 0.0),
        )
        for k in range(1, round(10 * seconds) + 1)
    ]  # fmt: skip


def test_the_known_pad_calibrates_the_barometer():
    """Bias and height of the day's pressures add up to what the pad shows; the height stays where it is."""
    nav, results = stand(on_the_pad(5.0), 5.0)
    assert all(result.accepted for result in results)
    state, P = nav.history[-1].state, nav.history[-1].P
    assert here(state).height == pytest.approx(360.0, abs=3.0)
    told = -reading_of(state)[0][0]
    assert told - atmosphere.us76(360.0)[1] == pytest.approx(180.0, abs=12.0)
    _, H, _ = reading_of(state)
    H[0, : nav.layout.places["baro_bias"].start] = 0.0
    of_bias = np.sqrt(P[nav.layout.places["baro_bias"], nav.layout.places["baro_bias"]][0, 0])
    assert np.sqrt(H[0] @ P @ H[0]) < 50.0 < of_bias  # of 800 Pa; the survey of the pad has 3 m, 35 Pa


@pytest.mark.parametrize("name", ["star_baro", "gps_baro"])
def test_an_instrument_is_not_taken_for_gps_or_stars_by_its_name(name):
    """Under a name that begins like theirs a barometer says the same to the last bit."""
    nav, results = stand(on_the_pad(2.0), 2.0)
    other, others = stand(on_the_pad(2.0), 2.0, aid=AID._replace(name=name))
    assert [one._replace(sensor="barometer") for one in others] == results and results
    np.testing.assert_array_equal(pack(other.history[-1].state), pack(nav.history[-1].state))
    np.testing.assert_array_equal(other.history[-1].P, nav.history[-1].P)


def test_readings_that_come_late_say_what_they_would_have_said_in_time():
    in_time, _ = stand(on_the_pad(2.0), 2.5)
    late, _ = stand(on_the_pad(2.0, late_s=0.3), 2.5)
    a, b = in_time.history[-1], late.history[-1]
    np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.P, b.P, rtol=1e-6, atol=1e-12)


def test_a_barometer_that_jumps_has_a_new_bias_and_leaves_the_height_alone():
    """A hatch that opens: 3000 Pa from one reading to the next, some 250 m."""
    nav, results = stand(on_the_pad(8.0, step=(4.0, 3000.0)), 8.0)
    refused = [result for result in results if not result.accepted]
    assert {result.note for result in refused} == {"rejected"}
    assert len(refused) == 4
    assert [result.note for result in results if result.note == "new bias"] == ["new bias"]
    state = nav.history[-1].state
    assert here(state).height == pytest.approx(360.0, abs=4.0)
    assert results[-1].accepted


def test_a_barometer_that_is_stuck_is_not_used_until_it_reads_again():
    """It climbs by 20 m/s; stuck from 3 s to 10 s, at once after that a reading counts again."""
    rng, readings = np.random.default_rng(3), []
    for k in range(1, 121):
        pressure = atmosphere.us76(360.0 + 2.0 * k)[1] + 180.0 + 5.0 * rng.standard_normal()
        stuck = readings[29].pressure if 30 < k <= 100 else pressure
        readings.append(BarometerReading(0.1 * k, 0.1 * k, stuck))
    nav, results = stand(readings, 12.0, climb=20.0)
    used = [result.t_valid_s for result in results if result.accepted]
    notes = {result.note for result in results if 3.95 < result.t_valid_s < 10.05}
    assert notes == {"not used: it repeats itself"}
    assert sum(t_s > 10.05 for t_s in used) == 20
    assert here(nav.history[-1].state).height == pytest.approx(600.0, abs=4.0)
    assert [one.healthy for one in nav.watch.changes() if "repeats" in one.reason or one.healthy] == [
        False,
        True,
    ]


def test_a_barometer_with_coarse_counts_may_repeat_itself_where_nothing_moves():
    readings = [BarometerReading(0.1 * k, 0.1 * k, 97100.0) for k in range(1, 51)]
    _, results = stand(readings, 5.0)
    assert len(results) == 50 and all(result.accepted for result in results)


def test_single_wrong_readings_never_insist():
    readings = on_the_pad(6.0)
    wrong = [
        one._replace(pressure=one.pressure + 4000.0) if k % 3 == 0 else one for k, one in enumerate(readings)
    ]
    _, results = stand(wrong, 6.0)
    refused = [result for result in results if not result.accepted]
    assert len(refused) == sum(k % 3 == 0 for k in range(len(readings)))
    assert not any(result.note == "new bias" for result in results)


# fixes without height


def antenna_of(state, order):
    zero = np.zeros(6)
    return measurements.antenna(order, pack(state), state.t_s, EARTH, np.array([0.6, 0.1, -0.2]), zero, 0.0)


def level_fix(t_s, north, east, height=0.0, sigma=2.0):
    """Horizontal GpsFix, metres from the site."""
    latitude = SITE[0] + north / 6.39e6
    longitude = SITE[1] + east / (6.40e6 * np.cos(SITE[0]))
    r_e = wgs84.ecef_from_geodetic(latitude, longitude, height)
    level = wgs84.dcm_en(latitude, longitude)[:, :2]
    nothing = np.full(3, np.nan), np.full((3, 3), np.nan)
    return GpsFix(
        t_s, t_s, True, r_e, nothing[0], sigma**2 * level @ level.T, nothing[1], 5, 2.0, "", horizontal=True
    )


def test_latitude_and_longitude_say_nothing_of_the_height():
    order, state = layout(("lever_arm",)), state_at(8000.0, others=False)
    a = antenna_of(state, order)
    z, H, R = measurements.gps_horizontal(level_fix(state.t_s, 3.0, -4.0), a)
    again, _, _ = measurements.gps_horizontal(level_fix(state.t_s, 3.0, -4.0, height=5000.0), a)
    np.testing.assert_allclose(z, again, atol=1e-6)
    np.testing.assert_allclose(R, 4.0 * np.eye(2), atol=1e-9)
    up_i = here(state, order).up_i
    assert np.abs(H[:, :3] @ up_i).max() < 1e-5  # the fix is 5 m away: its level is another by 1e-6
    for k in range(order.n):
        e = np.zeros(order.n)
        e[k] = 1e-3
        ahead, behind = (
            measurements.gps_horizontal(
                level_fix(state.t_s, 3.0, -4.0), antenna_of(correct(order, state, s * e), order)
            )[0]
            for s in (1.0, -1.0)
        )
        np.testing.assert_allclose(H[:, k], (behind - ahead) / 2e-3, atol=2e-4, err_msg=str(k))


def test_fixes_without_height_leave_the_height_to_others():
    fixes = [level_fix(float(k), *np.random.default_rng(k).normal(0.0, 2.0, 2)) for k in range(1, 20)]
    nav, results = stand([], 19.5, fixes)
    assert {(result.sensor, result.dof, result.accepted) for result in results} == {("gps_position", 2, True)}
    assert not nav.watch.gps_drift.suspected
    C_in = frames.dcm_ie(EARTH, 19.5) @ wgs84.dcm_en(*SITE)
    P_n = C_in.T @ nav.history.P[:3, :3] @ C_in
    assert np.sqrt(P_n[0, 0]) < 1.5 < 2.9 < np.sqrt(P_n[2, 2])


def test_a_coarse_receiver_below_which_the_vehicle_climbs_does_not_repeat_itself():
    """Straight up, latitude and longitude of a coarse receiver stay; those of one that hangs do not fit."""

    def told(north):
        memory = integrity_gps.memory()
        for k in range(2):
            latitude, longitude = SITE[0] + north * k / 6.39e6, SITE[1]
            r_e = wgs84.ecef_from_geodetic(latitude, longitude, 500.0 * k)
            here = integrity_gps.InertialState(float(k), r_e, np.zeros(3), 0.1, 0.1)
            said, _ = integrity_gps.repeated(memory, level_fix(float(k), 0.0, 0.0), here)
        return said

    assert told(0.0) == {}
    assert "frozen" in told(500.0)["gps_position"]


def test_every_block_of_the_barometer_has_its_size():
    assert state_sizes() | {"baro_bias": 2, "baro_scale": len(measure_barometer.LAYERS)} == state_sizes()


def test_layers_have_the_temperatures_of_the_standard():
    edges = np.array([*measure_barometer.LAYERS, measure_barometer.LAST_TOP])
    middle = 0.5 * (edges[1:] + edges[:-1])
    T = [atmosphere.us76(height)[2] for height in middle]
    np.testing.assert_allclose(measure_barometer.TEMPERATURE, T, atol=0.006)
