"""Instruments in the bound: against dense least squares over what the instruments themselves measure."""

import numpy as np
import pytest
from imu_settings import imu_with
from scipy.linalg import eigh
from test_bound import ARM, DT, EARTH, QUIET, Camera, increments, integrate

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.instruments import BUILT_IN
from shefex_nav.instruments.instrument import Truth
from shefex_nav.records import Alignment, GpsFix, Trajectory
from shefex_nav.scenario import aboard, load
from shefex_nav.scenario.of_settings import section, settings
from shefex_nav.verify import bound, bound_instruments, bound_model, over_bound
from shefex_nav.world import gps

END_S = 12.0
R_0 = frames.dcm_ie(EARTH, 0.0) @ wgs84.ecef_from_geodetic(1.1, 0.3, 6000.0)
V_0 = (
    np.cross([0.0, 0.0, wgs84.OMEGA], R_0) + 350.0 * R_0 / np.linalg.norm(R_0) + np.array([60.0, -90.0, 40.0])
)
Q_0 = rotation.quat_normalise(np.array([0.6, 0.2, -0.5, 0.3]))
IMU = imu_with(QUIET, gyro_bias=3e-4, accel_bias=5e-2)
ALIGNMENT = Alignment(0.0, R_0, V_0, Q_0, 30.0, 1.0, np.radians(1.0) ** 2 * np.diag([1.0, 2.0, 0.5]))
STEPS = np.repeat([10.0, 1.0, 1e-4, 1e-5, 1e-3], 3)  # of what is not known at the start
ALONG = {"sun_sensor": np.radians(0.003) ** 2}  # along a direction it says nothing: not quite nothing
SUN_I = rotation.dcm_from_quat(Q_0) @ np.array([0.1, 0.9, -0.3]) / np.sqrt(0.91)
GIVEN = {
    "barometer": {
        **{"rate": "10 Hz", "bias": "30 Pa", "drift": "20 Pa", "drift_time": "5 s", "noise": "10 Pa"},
        **{"lag": "20 ms", "port": {"mach": [0, 3], "coefficient": [-0.03, 0.05], "error": "25 %"}},
        "day": {"pressure": "0.5 hPa", "temperature": "0.6 K", "depth": "2 km"},
    },
    "magnetometer": {"rate": "10 Hz", "hard_iron": "300 nT", "soft_iron": "0.3 %", "noise": "50 nT"},
    "sun_sensor": {
        **{"rate": "10 Hz", "boresight": [0, 1, 0], "field_of_view": "180 deg"},
        **{"noise": "0.1 deg", "alignment": "0.05 deg"},
    },
}


class Numbers:
    """Random numbers that are zero, but for one."""

    def __init__(self, which=None, size=0.0):
        self.which, self.size, self.drawn = which, size, 0

    def standard_normal(self, shape=None):
        out = np.zeros(() if shape is None else shape)
        if self.which is not None and 0 <= self.which - self.drawn < out.size:
            out.flat[self.which - self.drawn] = self.size
        self.drawn += out.size
        return out


def flown(x):
    """Trajectory of which the navigation, that measures the increments of x = 0, does not know x."""
    dtheta_b, dv_b = increments(END_S)
    dtheta_b[1:] -= DT * x[9:12]
    dv_b[1:] -= DT * x[12:15]
    q = rotation.quat_multiply(rotation.quat_from_rotvec(x[6:9]), Q_0)
    r, v, q = integrate(dtheta_b, dv_b, R_0 + x[:3], V_0 + x[3:6], q)
    n, t_s = len(r), DT * np.arange(len(r))
    mach, zero = np.linspace(0.6, 2.5, n), np.zeros(n)  # of the true flight
    return Trajectory(
        t_s, zero, r, v, q, dtheta_b / DT, dv_b / DT, dtheta_b, dv_b, zero, mach, 2e4 * mach**2, zero,
        np.zeros(n, dtype=np.int8), zero,
    )  # fmt: skip


def truth(trajectory):
    return Truth(trajectory, EARTH, 2012.5, SUN_I, np.zeros((0, 4)))


def of(one):
    return settings(section(one.settings).model_validate(GIVEN[one.name]))


def said(one, trajectory, numbers=None):
    """What an instrument senses: (number of readings times rows,)."""
    measured = one.measure(of(one), truth(trajectory), numbers or Numbers())
    rows = [np.atleast_1d(reading[2]) for reading in measured.sensed or measured.readings]
    return np.concatenate(rows)


def navigation(trajectory, reference):
    """Errors against another flight at the end: (9,)."""
    turn = rotation.quat_multiply(trajectory.q_ib[-1], rotation.quat_conjugate(reference.q_ib[-1]))
    return np.concatenate(
        [
            trajectory.r_i[-1] - reference.r_i[-1],
            trajectory.v_i[-1] - reference.v_i[-1],
            rotation.rotvec_from_quat(turn),
        ]
    )


@pytest.fixture(scope="module")
def flights():
    """The flight, and those with each of what is not known at the start."""
    return flown(np.zeros(15)), [flown(step * unit) for step, unit in zip(STEPS, np.eye(15), strict=True)]


def least_squares(one, flights):
    """Covariance of the errors at the end without and with the readings: (9, 9) twice.

    All at once: what is not known at the start moves the readings as flights with it show; every random
    number of the instrument moves them as its own `measure` shows. No state, no order of time.
    """
    flight, others = flights
    begin = said(one, flight)
    J = np.column_stack(
        [(said(one, other) - begin) / step for other, step in zip(others, STEPS, strict=True)]
    )
    counter = Numbers()
    said(one, flight, counter)
    pulses = [said(one, flight, Numbers(n, 1e-3)) for n in range(counter.drawn)]
    noise = (np.array(pulses) - begin) / 1e-3
    P = np.zeros((15, 15))
    layout = bound_model.layout(())
    C_ib = rotation.dcm_from_quat(Q_0)
    P[:9, :9] = bound_model.start(
        layout, ALIGNMENT.sigma_r, ALIGNMENT.sigma_v, C_ib @ ALIGNMENT.P_theta_b @ C_ib.T,
        frames.omega_ie_i(EARTH),
    )  # fmt: skip
    P[9:12, 9:12], P[12:, 12:] = 3e-4**2 * np.eye(3), 5e-2**2 * np.eye(3)
    R = noise.T @ noise
    R += ALONG.get(one.name, 0.0) * np.eye(len(R))
    known = P - P @ J.T @ np.linalg.solve(J @ P @ J.T + R, J @ P)
    end = np.column_stack(
        [navigation(other, flight) / step for other, step in zip(others, STEPS, strict=True)]
    )
    return end @ P @ end.T, end @ known @ end.T


@pytest.mark.parametrize(
    "one",
    [
        pytest.param(one, marks=pytest.mark.slow if name != "sun_sensor" else ())
        for name, one in BUILT_IN.items()
    ],
    ids=list(BUILT_IN),
)
def test_the_bound_with_an_instrument_is_what_dense_least_squares_give(one, flights):
    flight, _ = flights
    readings = one.measure(of(one), truth(flight), Numbers()).readings
    heard = bound_instruments.readings_of(one.name, one.equation(of(one), truth(flight)), readings, flight)
    assert len(heard.k) == 120
    layout = bound_model.sources(IMU, Camera, 0.0, np.inf, heard.sources)
    given = bound.Flight(flight, EARTH, ALIGNMENT, [], [], IMU, Camera, ARM, (heard,))
    *_, (_, output) = bound.outputs(given, layout)
    without, dense = least_squares(one, flights)
    sigma, expected = np.sqrt(np.diag(output.P)[:9]), np.sqrt(np.diag(dense))
    np.testing.assert_allclose(sigma, expected, rtol=0.01)
    scale = np.outer(expected, expected)
    np.testing.assert_allclose(output.P[:9, :9] / scale, dense / scale, atol=0.01)
    assert eigh(dense, without, eigvals_only=True)[0] < 0.2  # the instrument says something


def test_an_instrument_that_does_not_say_what_it_measures_is_refused(monkeypatch):
    scenario = load.load("baro_2d_gps")
    assert over_bound.left_out(scenario) == ""
    table = tuple(one._replace(equation=None) for one in aboard.table_of(scenario))
    monkeypatch.setattr(aboard, "table_of", lambda scenario: table)
    assert over_bound.left_out(scenario) == "barometer (it has no equation of its readings)"
    unused = load.load("baro_2d_gps", ["navigation.barometer.used=false"])
    assert over_bound.left_out(unused) == ""


@pytest.mark.parametrize("is_horizontal", [False, True])
def test_a_fix_without_velocity_or_height_has_so_many_rows_fewer(is_horizontal, flights):
    """Those left are those of a whole fix, along north and east."""
    flight, _ = flights
    r_e = frames.dcm_ie(EARTH, 4.0).T @ flight.r_i[1600]
    noise = np.random.default_rng(1).standard_normal((2, 3, 3))
    R_r, R_v = noise @ noise.transpose(0, 2, 1)
    whole = GpsFix(4.0, 4.2, True, r_e, np.zeros(3), R_r, R_v, 8, 2.0, "")
    few = gps.as_kind([whole], "horizontal" if is_horizontal else "position")[0]
    layout = bound_model.sources(IMU, Camera, 0.0, np.inf)
    given = bound.Flight(flight, EARTH, ALIGNMENT, [], [], IMU, Camera, ARM)
    full, part = (bound._gps(given, layout, DT, 1600, fix) for fix in (whole, few))
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    axes = wgs84.dcm_en(latitude, longitude)[:, :2].T if is_horizontal else np.eye(3)
    np.testing.assert_allclose(part.H, axes @ full.H[:3], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(part.R, axes @ R_r @ axes.T, rtol=1e-9)


def test_an_error_that_goes_with_the_path_keeps_what_the_path_leaves():
    layout = bound_model.layout(
        [
            bound_model.Source("wanders", 1, np.full(1, 3.0), 10.0, 500.0),
            bound_model.Source("constant", 2, np.ones(2), np.inf),
        ]
    )
    keeps, added = bound_model.fading(layout).over(2.0, 100.0)
    assert keeps == pytest.approx([np.exp(-0.4), 1.0, 1.0])
    assert added == pytest.approx([9.0 * (1.0 - np.exp(-0.8)), 0.0, 0.0])
    assert bound_model.fading(layout).over(1e9, 1e9)[0][1:].tolist() == [1.0, 1.0]
