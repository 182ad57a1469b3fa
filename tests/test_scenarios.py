"""The scenarios that come with the package: what each is meant to show.

Figures are those that the scenario's own comments promise. Flights are flown without errors of the attitude
reference; the runs to the end are short or seed 1.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from shefex_nav import prepare, simulate
from shefex_nav.clock import IMU_HZ
from shefex_nav.environment import ephemeris
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.thinning import thinned
from shefex_nav.onboard.navigator import Columns
from shefex_nav.report import metrics, track
from shefex_nav.scenario import load, params
from shefex_nav.world.flight import fly

ROOT = Path(__file__).parent.parent
SCENARIOS = ROOT / "scenarios"
G_0 = 9.80665  # m/s^2


class Flown(NamedTuple):
    """A scenario and its flight."""

    scenario: object
    earth: object
    trajectory: object
    at: dict  # time of each event, s

    def row(self, t_s):
        """Index of the sample at a time."""
        return int(np.searchsorted(self.trajectory.t_s, t_s - 1e-6))

    def height_km(self, event):
        return self.place(self.at[event])[2] / 1e3

    def place(self, t_s):
        """Latitude, longitude rad, height m."""
        r_e, _ = self.earth_fixed(t_s)
        return wgs84.geodetic_from_ecef(r_e)

    def earth_fixed(self, t_s):
        k = self.row(t_s)
        return frames.ecef_from_inertial(
            self.earth, self.trajectory.t_s[k], self.trajectory.r_i[k], self.trajectory.v_i[k]
        )

    def local(self, t_s):
        """Roll axis and velocity in local level axes: elevations of both, rad."""
        k, (_, v_e) = self.row(t_s), self.earth_fixed(t_s)
        C_ne = wgs84.dcm_en(*self.place(t_s)[:2]).T
        x_i = rotation.dcm_from_quat(self.trajectory.q_ib[k])[:, 0]
        x_n = C_ne @ frames.dcm_ie(self.earth, self.trajectory.t_s[k]).T @ x_i
        v_n = C_ne @ v_e
        return np.arcsin(-x_n[2]), np.arcsin(-v_n[2] / np.linalg.norm(v_n))

    def range_km(self):
        """Along the ellipsoid, and the bearing of the end as seen from the start, deg."""
        (a, b, _), (c, d, _) = self.place(self.trajectory.t_s[0]), self.place(self.trajectory.t_s[-1])
        bearing = np.arctan2(
            np.sin(d - b) * np.cos(c), np.cos(a) * np.sin(c) - np.sin(a) * np.cos(c) * np.cos(d - b)
        )
        return track.ground_distance(a, b, c, d) / 1e3, np.degrees(bearing) % 360.0

    def sky(self, t_s):
        """Boresight of the star camera (3,), its angles to Sun and limb, elevation of the Sun, deg."""
        k = self.row(t_s)
        boresight_i = rotation.dcm_from_quat(self.trajectory.q_ib[k]) @ params.mounting(self.scenario)[:, 2]
        sun_i = ephemeris.sky_bodies(self.scenario.mission.epoch).sun_u_i
        C_ei = frames.dcm_ie(self.earth, self.trajectory.t_s[k]).T
        r_i = self.trajectory.r_i[k]
        up_e = -wgs84.dcm_en(*self.place(t_s)[:2])[:, 2]
        return (
            boresight_i,
            np.degrees(np.arccos(boresight_i @ sun_i)),
            np.degrees(wgs84.limb_angle(C_ei @ r_i, C_ei @ boresight_i)),
            np.degrees(np.arcsin(up_e @ C_ei @ sun_i)),
        )


@cache
def flown(name, *overrides, rate_hz=float(IMU_HZ)):
    """A scenario of the package, flown."""
    return flight_of(load.load(SCENARIOS / f"{name}.yaml", overrides), rate_hz)


def flight_of(scenario, rate_hz=float(IMU_HZ)):
    earth = prepare.earth_rotation(scenario)
    flight = fly.fly(params.flight_params(scenario)._replace(sample_rate_hz=rate_hz), earth, None)
    return Flown(scenario, earth, flight.trajectory, {event.name: event.t_s for event in flight.events})


@cache
def summary(name, *overrides, seed=1, until_s=np.inf):
    """Figures of a run to the end, or until a mission time."""
    scenario = load.load(SCENARIOS / f"{name}.yaml", overrides)
    world = prepare.build_world(scenario, seed)
    mission = prepare.mission(scenario, seed, world.flight.trajectory)
    kept = RunDataBuilder(mission)
    for record in thinned(
        simulate.route(world, scenario, seed, until_s=until_s), scenario.log.rate, mission.start_s
    ):
        kept.add(record)
    return metrics.summarise(kept.build())


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_scenario_is_good_and_says_what_it_is(path):
    scenario = load.load(path)
    assert scenario.mission.name == path.stem
    assert scenario.mission.description
    assert path.read_text().startswith("# ")
    tables = {Path(name).name for name, _ in scenario.files} - {p.name for p in SCENARIOS.glob("*.yaml")}
    places = SCENARIOS / "data", SCENARIOS / "data" / "instruments"
    assert all(any((place / name).is_file() for place in places) for name in tables)


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_pinned_earth_orientation_is_that_of_the_day(path):
    """Against the table of the IERS that astropy brings along; final values move in their last digits."""
    from astropy.time import Time
    from astropy.utils import iers

    scenario = load.load(path)
    earth, epoch = scenario.earth, Time(scenario.mission.epoch, scale="utc")
    with iers.conf.set_temp("auto_download", False):
        table = iers.IERS_Auto.open()
        x, y = table.pm_xy(epoch)
        assert earth.ut1_minus_utc == pytest.approx(float(table.ut1_utc(epoch).to_value("s")), abs=2e-5)
    for pinned, of_table in ((earth.pole_x, x), (earth.pole_y, y)):
        assert pinned == pytest.approx(float(of_table.to_value("rad")), abs=np.radians(2e-4 / 3600.0))


def test_second_burn_along_the_flight_path():
    """172 km, 852 km, 2728 m/s; lit 35 deg above the horizon, and nothing is turned before."""
    flight = flown("shefex2_no_precession")
    assert flight.height_km("apogee") == pytest.approx(172.0, abs=1.0)
    assert flight.range_km()[0] == pytest.approx(852.0, abs=4.0)
    axis, path = flight.local(flight.at["ignition_2"])
    assert np.degrees(path) == pytest.approx(35.1, abs=0.5)
    assert np.degrees(axis) == pytest.approx(np.degrees(path), abs=2.0)
    speed = [np.linalg.norm(flight.earth_fixed(t_s)[1]) for t_s in np.arange(400.0, 480.0)]
    assert max(speed) == pytest.approx(2728.0, abs=15.0)
    assert not any(task.task == "turn" for _, task in flight.scenario.tasks)


def test_woomera_by_night_over_land():
    flight = flown("shefex2_woomera")
    assert flight.height_km("apogee") == pytest.approx(200.0, abs=1.5)
    length, bearing = flight.range_km()
    assert 500.0 < length < 800.0
    assert bearing == pytest.approx(310.0, abs=3.0)  # north-west
    for t_s in np.arange(250.0, 405.0, 5.0):
        boresight_i, sun, limb, sun_elevation = flight.sky(t_s)
        assert sun > 90.0 and limb > 45.0
        assert sun_elevation < -18.0  # astronomical night on the ground below
        assert np.degrees(np.arcsin(boresight_i[2])) < -55.0  # the southern sky


@pytest.mark.parametrize("name", ["shefex2_no_precession", "shefex2_woomera"])
@pytest.mark.slow
def test_navigation_of_the_other_missions(name):
    """The promises of the default hold where nothing was tuned: solved, never wrong, ready for entry."""
    result = summary(name, until_s=flown(name).at["entry"] + 10.0)
    star = result["star_tracker"]
    assert star["in_window"] > 1400
    assert star["wrong"] == 0
    assert star["solved"] >= 0.97 * star["in_window"]
    entry = result["navigation"]["at_entry"]
    assert np.abs(entry["attitude_error_deg"]).max() < 0.17
    assert entry["position_error_m"] < 15.0
    assert entry["velocity_error_m_s"] < 0.3
    # one run: its mean scatters by some four about 9, its errors being correlated
    assert 2.0 < result["navigation"]["nees"]["mean"] < 22.0


def test_rexus_flies_like_rexus():
    """REXUS 9: apogee 80.6 km, 26 s of thrust, peak of 21 g. Spun to 4 Hz, and by the yo-yo to a fiftieth."""
    flight = flown("rexus_like")
    trajectory = flight.trajectory
    assert flight.height_km("apogee") == pytest.approx(80.6, abs=0.5)
    assert flight.at["burn_out_1"] == pytest.approx(26.0)
    burning = trajectory.burning == 1
    assert np.linalg.norm(trajectory.f_b[burning], axis=1).max() / G_0 == pytest.approx(21.0, abs=0.6)
    mass = flight.scenario.vehicle.payload.mass + sum(
        stage.dry.mass + stage.propellant.mass for stage in flight.scenario.vehicle.stages.values()
    )
    assert mass == 542.0
    spin = {
        event: trajectory.omega_ib_b[flight.row(flight.at[event]), 0] for event in ("burn_out_1", "yo_yo_off")
    }
    assert spin["burn_out_1"] / (2.0 * np.pi) == pytest.approx(4.0, abs=0.1)
    assert spin["yo_yo_off"] / (2.0 * np.pi) == pytest.approx(0.08, abs=0.02)


def test_rexus_gives_the_star_tracker_no_chance():
    """Why it is off: never between yo-yo and parachute does the payload turn slowly enough for a picture."""
    flight = flown("rexus_like")
    above_air = slice(flight.row(flight.at["yo_yo_off"]), flight.row(flight.at["parachute"]))
    rate = np.linalg.norm(flight.trajectory.omega_ib_b[above_air], axis=1)
    high = flight.trajectory.t_s[above_air] < flight.at["altitude_60km"]
    assert rate[high].min() > flight.scenario.star_tracker.highest_rate
    assert not flight.scenario.star_tracker.enabled


def test_rexus_comes_down_under_its_parachute():
    flight = flown("rexus_like")
    end_s = flight.trajectory.t_s[-1]
    assert end_s == pytest.approx(flight.at["impact"], abs=0.0025)
    (_, v_e), weight = flight.earth_fixed(end_s), flight.scenario.vehicle.payload.mass * G_0
    up_e = -wgs84.dcm_en(*flight.place(end_s)[:2])[:, 2]
    area = flight.scenario.vehicle.parachute.drag_area
    assert -v_e @ up_e == pytest.approx(np.sqrt(2.0 * weight / (1.225 * area)), rel=0.04)
    # the wind of the first rows, 3 m/s from 200 deg, carries it
    assert np.linalg.norm(v_e - (v_e @ up_e) * up_e) == pytest.approx(3.0, abs=0.5)


@pytest.mark.slow
def test_rexus_navigates_without_a_star_tracker():
    """Boost, spin, yo-yo, tumbling and the way down to the air; the minutes under the parachute are dull."""
    result = summary("rexus_like", until_s=300.0)
    assert result["star_tracker"]["frames"] == 0
    assert result["navigation"]["position_error_m"]["max"] < 15.0
    assert result["navigation"]["attitude_error_deg"]["max"] < 3.0


def test_rexus_spinning_withdraws_its_solution_while_it_spins():
    """4 Hz, gyros up to 2: from T+3 s, when the range is passed, until the air has slowed the payload."""
    flight = flown("rexus_spinning")
    omega = np.abs(flight.trajectory.omega_ib_b[:, 0])
    fastest = omega.max()
    assert fastest / flight.scenario.imu.gyro.range == pytest.approx(2.0, abs=0.05)
    assert "yo_yo_release" not in flight.at
    beyond_s = flight.trajectory.t_s[omega > flight.scenario.imu.gyro.range]
    assert beyond_s[0] == pytest.approx(3.5, abs=0.5)
    columns, world = Columns(10), prepare.build_world(flight.scenario, 1)
    for _ in simulate.route(world, flight.scenario, 1, until_s=200.0, columns=columns):
        pass
    told = columns.read()[0]
    spinning = told.t_s > beyond_s[0] + 0.05
    assert told.do_not_use_attitude[spinning].all()


def test_night_sky_stands_still_and_looks_up():
    flight = flown("night_sky", "mission.time_limit=60 s", "star_tracker.off=60 s")
    r_e = [flight.earth_fixed(t_s)[0] for t_s in (0.0, 30.0, 60.0)]
    assert np.ptp(r_e, axis=0).max() < 1e-6
    up = np.linalg.norm(flight.trajectory.f_b[0])
    assert up == pytest.approx(9.8135, abs=2e-3)  # normal gravity at 53.1 deg north and 50 m
    assert np.linalg.norm(flight.trajectory.omega_ib_b[0]) == pytest.approx(wgs84.OMEGA, rel=1e-6)
    _, sun, limb, sun_elevation = flight.sky(0.0)
    assert sun_elevation == pytest.approx(-32.6, abs=0.2)
    assert sun > 90.0
    assert limb == pytest.approx(80.0, abs=0.5)  # 80 deg up, from 50 m


@pytest.mark.slow
def test_night_sky_through_the_air():
    """The paper solved more than 90 % on the ground; stars are 30 % fainter than in space."""
    default = load.load(SCENARIOS / "shefex2_andoya.yaml").star_camera.optics.zero_magnitude_flux
    here = load.load(SCENARIOS / "night_sky.yaml").star_camera.optics.zero_magnitude_flux
    assert here == pytest.approx(0.7 * default)
    result = summary("night_sky", "mission.time_limit=60 s", "star_tracker.off=60 s")
    star = result["star_tracker"]
    assert star["in_window"] == star["frames"] > 580
    assert star["wrong"] == 0
    assert star["solved"] > 0.97 * star["frames"]
    assert result["navigation"]["position_error_m"]["max"] < 15.0


def test_orbit_keeps_to_its_elements():
    """Height; nodal period and drift of the node as J2 makes them, to first order in J2.

    From node to node 2 pi sqrt(a^3/GM) (1 - k (3 - 5/2 sin^2 i)) with k = 3/2 J2 (R/a)^2, a osculating at the
    node; the node itself moves by -k n cos i.
    """
    flight = flown("orbit", rate_hz=10.0)
    trajectory, orbit = flight.trajectory, flight.scenario.orbit
    height = np.array([flight.place(t_s)[2] for t_s in np.arange(0.0, 11100.0, 60.0)])
    assert 390e3 < height.min() and height.max() < 425e3  # above the flattened Earth
    a = wgs84.A + 0.5 * (orbit.perigee_height + orbit.apogee_height)
    n, k = np.sqrt(wgs84.GM / a**3), 1.5 * 1.0826e-3 * (wgs84.A / a) ** 2
    z = trajectory.r_i[:, 2]
    up = np.flatnonzero((z[:-1] < 0.0) & (z[1:] >= 0.0))
    t_s = trajectory.t_s[up] - z[up] / (z[up + 1] - z[up]) * 0.1
    period_s = 2.0 * np.pi / n * (1.0 - k * (3.0 - 2.5 * np.sin(orbit.inclination) ** 2))
    np.testing.assert_allclose(t_s, [period_s, 2.0 * period_s], rtol=1e-5)
    h_i = np.cross(trajectory.r_i, trajectory.v_i)
    node = np.arctan2(h_i[:, 0], -h_i[:, 1])
    drift = (node[up[-1]] - node[0]) / trajectory.t_s[up[-1]]
    assert drift == pytest.approx(-k * n * np.cos(orbit.inclination), rel=0.01)


def test_orbit_blinds_the_star_camera_most_of_the_time():
    """The camera looks away from the Earth for a third of each orbit; the Sun never comes near."""
    flight = flown("orbit", rate_hz=10.0)
    times = np.arange(130.0, 11090.0, 10.0)
    _, sun, limb, _ = (np.array(column) for column in zip(*(flight.sky(t_s) for t_s in times), strict=True))
    assert sun.min() > 90.0
    assert np.mean(limb >= 45.0) == pytest.approx(0.365, abs=0.02)


@pytest.mark.slow
def test_orbit_navigates_through_an_opening():
    """The first ten minutes: blind at first, then the limb is 45 deg away and the frames must be solved."""
    end = ("mission.time_limit=600 s", "programme.pointing.until=600 s", "star_tracker.off=600 s")
    result = summary("orbit", *end)
    star = result["star_tracker"]
    assert star["frames"] > 900
    assert 200 < star["in_window"] < 320  # from T+467 s on, two a second
    assert star["wrong"] == 0
    assert star["solved"] >= 0.97 * star["in_window"]
    assert result["navigation"]["position_error_m"]["max"] < 25.0


def solved(rows, low, high):
    """Frames and fixes of `by_rate` between two rates, deg/s."""
    inside = [row for row in rows if low <= row["from_deg_s"] < high]
    return sum(row["frames"] for row in inside), sum(row["solved"] for row in inside)


@pytest.mark.slow
def test_high_rate_is_fixed_at_every_rate():
    """Circles of up to 10 deg/s: streaks of 22 pixels, of which no pixel of a faint star stands out."""
    cut = ("mission.time_limit=60 s", "star_tracker.off=59 s", "programme.circle_3.cross_rate=10 deg/s")
    cut += tuple(
        f"programme.{task}=null"
        for task in (
            *("circle_5", "circle_7", "circle_10", "roll_5", "roll_10", "both", "back_and_forth", "up_again"),
            *("spin_up", "spin", "spin_down", "to_the_zenith", "rest"),
        )
    )
    result = summary("high_rate", *cut, "programme.circle_3.until=60 s")
    star = result["star_tracker"]
    assert star["wrong"] == 0
    for low, high, least in ((0.0, 5.0, 0.99), (5.0, 15.0, 0.97)):
        frames, fixed = solved(star["by_rate"], low, high)
        assert frames > 50
        assert fixed >= least * frames
    spots = summary(
        "high_rate", *cut, "programme.circle_3.until=60 s", "star_tracker.detection.scan=sequential"
    )["star_tracker"]
    assert spots["wrong"] == 0
    assert solved(spots["by_rate"], 5.0, 15.0)[1] < 0.9 * fixed  # what the gyro rate is worth


@pytest.mark.slow
def test_rows_one_after_the_other_do_not_disturb_the_mission():
    """From the despin to the entry: nothing is lost up to the highest rate, no fix contradicts the filter."""
    result = summary("shefex2_aps_rolling", until_s=420.0)
    star = result["star_tracker"]
    assert star["wrong"] == 0
    assert star["in_window"] > 1200 and star["solved"] >= 0.99 * star["in_window"]
    frames, fixed = solved(star["by_rate"], 2.0, 10.0)
    assert frames > 60 and fixed >= 0.97 * frames
    assert solved(star["by_rate"], 15.0, np.inf)[1] == 0  # faster than it may be
    assert star["error_arcsec"]["normalised_rms"] < 1.1
    assert np.abs(result["navigation"]["at_entry"]["attitude_error_deg"]).max() < 0.05


@pytest.mark.slow
def test_multi_poles_on_a_satellite():
    """The published chain without a gyro: most frames at 1 deg/s, a few at 2 deg/s, none wrong."""
    result = summary("impa")
    star = result["star_tracker"]
    assert star["wrong"] == 0
    assert star["frames"] > 700
    frames, fixed = solved(star["by_rate"], 0.0, 2.0)
    assert fixed > 0.5 * frames
    assert 0 < solved(star["by_rate"], 2.0, 3.0)[1]
