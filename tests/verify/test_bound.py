"""The bound: its matrices against perturbed flights and measurements, and against a filter that knows all."""

from types import SimpleNamespace

import numpy as np
import pytest
from imu_settings import PERFECT, imu_with

from shefex_nav.environment import gravity
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import Alignment, GpsFix, Trajectory, rows
from shefex_nav.verify import bound, bound_model
from shefex_nav.world import imu

EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 1.234, wgs84.OMEGA)
DT = 1.0 / 400.0
ARM = np.array([0.6, 0.05, -0.03])
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
Q_0 = rotation.quat_normalise(np.array([0.6, 0.2, -0.5, 0.3]))
R_0, V_0 = np.array([2.2e6, 0.6e6, 6.0e6]), np.array([100.0, 400.0, 900.0])
QUIET = imu_with(PERFECT, vibration_boost=(0.0,))


class Camera:
    """Tolerances of a camera, all zero."""

    mounting = SimpleNamespace(error=0.0)
    optics = SimpleNamespace(principal_point_error=0.0, focal_length_error=0.0)


def increments(duration_s):
    """Spin-up under thrust until 5 s, coast with a slow tumble: (N, 3) rad, (N, 3) m/s; row 0 is zero."""
    t = DT * (np.arange(round(duration_s / DT) + 1) - 0.5)
    on = 1.0 / (1.0 + np.exp((t - 5.0) / 0.1))
    omega = np.column_stack([6.0 * on, 0.05 * np.sin(0.7 * t), 0.04 * np.cos(0.5 * t)])
    force = np.column_stack([60.0 * on, 1.2 * on, -0.7 * on])
    omega[0] = force[0] = 0.0
    return omega * DT, force * DT


def integrate(dtheta_b, dv_b, r=R_0, v=V_0, q=Q_0, g_i=None):
    """A plain strapdown of its own: rotation and velocity by midpoints, J2. -> r, v (N, 3), q (N, 4)"""
    r, v, path = r.copy(), v.copy(), []
    path.append((r, v, q))
    for k in range(1, len(dtheta_b)):
        half = rotation.quat_multiply(q, rotation.quat_from_rotvec(0.5 * dtheta_b[k]))
        C_ie = frames.dcm_ie(EARTH, (k - 0.5) * DT)
        g = C_ie @ gravity.gravity_j2_e(C_ie.T @ (r + 0.5 * DT * v)) + (0.0 if g_i is None else g_i)
        gain = rotation.dcm_from_quat(half) @ dv_b[k] + g * DT
        r, v = r + DT * v + 0.5 * DT * gain, v + gain
        q = rotation.quat_normalise(rotation.quat_multiply(q, rotation.quat_from_rotvec(dtheta_b[k])))
        path.append((r, v, q))
    return tuple(np.array(column) for column in zip(*path, strict=True))


def flight(duration_s, *, burning=True):
    """Trajectory of `increments`."""
    dtheta_b, dv_b = increments(duration_s)
    r, v, q = integrate(dtheta_b, dv_b)
    n = len(r)
    ones = np.ones(n)
    burns = (np.arange(n) * DT < 5.0).astype(np.int8) if burning else np.zeros(n, dtype=np.int8)
    return Trajectory(
        DT * np.arange(n), burns, r, v, q, dtheta_b / DT, dv_b / DT, dtheta_b, dv_b,
        ones, ones, ones, ones, burns, ones,
    )  # fmt: skip


def errors(truth, estimate):
    """truth (-) estimate at the end: dr, dv and the rotation in inertial axes. (9,)"""
    (r, v, q), (r_hat, v_hat, q_hat) = truth, estimate
    turn = rotation.quat_multiply(q[-1], rotation.quat_conjugate(q_hat[-1]))
    return np.concatenate([r[-1] - r_hat[-1], v[-1] - v_hat[-1], rotation.rotvec_from_quat(turn)])


def transition(trajectory, layout, params, duration_s):
    flown = bound.Flight(trajectory, EARTH, None, [], [], params, Camera, ARM)
    step = bound._interval(flown, layout, DT, 0, round(duration_s / DT))
    return step.Phi, step.Q


def test_every_error_source_grows_as_in_a_flight_with_that_error():
    """Each state against a strapdown whose increments have that error; 6 s of thrust and spin."""
    params = imu_with(QUIET, vibration_boost=(30.0,))
    layout = bound_model.sources(params, Camera, 0.0, np.inf)
    trajectory = flight(6.0)
    Phi, _ = transition(trajectory, layout, params, 6.0)
    dtheta_b, dv_b = trajectory.dtheta_b, trajectory.dv_b
    truth = integrate(dtheta_b, dv_b)
    rms2 = imu.vibration_rms(params, trajectory.burning) ** 2
    gyro, accel = bound_model.imu_columns(layout, dtheta_b, dv_b, rms2, DT)
    gyro[0] = accel[0] = 0.0
    for name, size in (("gyro", 1e-4), ("accel", 1e-2)):
        for source in layout.sources:
            if not source.name.startswith(name):
                continue
            for c in range(layout.places[source.name].start, layout.places[source.name].stop):
                column = c - bound_model.N_NAV
                unit = np.abs(gyro[:, :, column] if name == "gyro" else accel[:, :, column]).max()
                d = size * DT / unit
                estimate = integrate(dtheta_b + d * gyro[:, :, column], dv_b + d * accel[:, :, column])
                change = errors(truth, estimate) / d
                scale = np.repeat([np.linalg.norm(change[i : i + 3]) for i in (0, 3, 6)], 3)
                scale = np.maximum(scale, np.abs(Phi[:9]).max(axis=1) * 1e-6)
                assert np.all(np.abs(Phi[:9, c] - change) < 2e-3 * scale), (source.name, c)


def test_what_the_columns_are():
    """The columns against the instrument itself: one error at a time through world.imu's equation."""
    rng = np.random.default_rng(0)
    dtheta_b, dv_b = rng.standard_normal((2, 5, 3))
    layout = bound_model.sources(QUIET, Camera, 0.0, np.inf)
    gyro, accel = bound_model.imu_columns(layout, dtheta_b, dv_b, np.full(5, 4.0), DT)
    p = rng.standard_normal(layout.n - bound_model.N_NAV)

    def of(name, shape=(3,)):
        place = layout.places[name]
        return p[place.start - 9 : place.stop - 9].reshape(shape)

    M = np.zeros((2, 3, 3))
    for k, name in enumerate(("gyro_misalignment", "accel_misalignment")):
        for (i, j), value in zip(bound_model.OFF_DIAGONAL, of(name, (6,)), strict=True):
            M[k, i, j] = value
    slow = of("gyro_bias") + of("gyro_in_run_bias") + 4.0 * of("gyro_rectification")
    G = of("gyro_g_sensitivity", (3, 3))
    expected = dtheta_b @ (np.diag(of("gyro_scale_factor")) + M[0]).T + dv_b @ G.T + slow * DT
    assert gyro @ p == pytest.approx(expected, rel=1e-12)
    slow = of("accel_bias") + of("accel_in_run_bias") + 4.0 * of("accel_rectification")
    expected = dv_b @ (np.diag(of("accel_scale_factor")) + M[1]).T + slow * DT
    assert accel @ p == pytest.approx(expected, rel=1e-12)


def test_errors_of_the_start_and_of_gravity_grow_as_in_a_flight():
    layout = bound_model.sources(QUIET, Camera, 1.0, np.inf)
    trajectory = flight(6.0)
    Phi, _ = transition(trajectory, layout, QUIET, 6.0)
    dtheta_b, dv_b = trajectory.dtheta_b, trajectory.dv_b
    truth = integrate(dtheta_b, dv_b)
    for k in range(3):
        e = np.eye(3)[k]
        turned = rotation.quat_multiply(rotation.quat_from_rotvec(-1e-5 * e), Q_0)
        cases = (
            (k, 10.0, {"r": R_0 - 10.0 * e}),
            (3 + k, 1.0, {"v": V_0 - 1.0 * e}),
            (6 + k, 1e-5, {"q": turned}),
            (layout.places["gravity"].start + k, 1e-3, {"g_i": -1e-3 * e}),
        )
        for c, d, changed in cases:
            change = errors(truth, integrate(dtheta_b, dv_b, **changed)) / d
            scale = np.repeat([np.linalg.norm(change[i : i + 3]) for i in (0, 3, 6)], 3)
            # J2 moves the gradient of the central field by parts in a thousand
            assert np.all(np.abs(Phi[:9, c] - change) < 1e-4 * scale + 1e-5), c


def test_white_noise_adds_up_as_known():
    """Without forces and turns, in closed form: variance of a random walk and of its integral."""
    params = imu_with(QUIET, gyro_random_walk=1e-4, accel_random_walk=2e-3)
    layout = bound_model.sources(params, Camera, 0.0, np.inf)
    n = round(4.0 / DT)
    far = flight(4.0)._replace(
        dtheta_b=np.zeros((n + 1, 3)),
        dv_b=np.tile([0.0, 0.0, 10.0 * DT], (n + 1, 1)),
        q_ib=np.tile([1.0, 0, 0, 0], (n + 1, 1)),
        r_i=np.full((n + 1, 3), 1e12),  # no gradient
    )
    _, Q = transition(far, layout, params, 4.0)
    T, g2, a2 = 4.0, 1e-4**2, 2e-3**2
    assert Q[6, 6] == pytest.approx(g2 * T, rel=1e-9)
    assert Q[5, 5] == pytest.approx(a2 * T, rel=1e-9)  # along the force
    assert Q[3, 3] == pytest.approx(a2 * T + 100.0 * g2 * T**3 / 3.0, rel=2e-3)
    assert Q[2, 2] == pytest.approx(a2 * T**3 / 3.0, rel=2e-3)
    assert Q[3, 7] == pytest.approx(10.0 * g2 * T**2 / 2.0, rel=2e-3)


def test_carried_remainders_of_counts_walk_with_the_spin():
    """Rounded running sums of a spinning sensor, turned into inertial axes: 400 s, seed 5."""
    q, rate = 1e-4, 8.0
    rng = np.random.default_rng(5)
    walks = []
    for _ in range(30):
        n = 4000
        left = rng.uniform(-0.5, 0.5, (n + 1, 2)) * q  # what is carried on about y and z
        angle = rate * DT * (np.arange(n) + 0.5)
        d = np.diff(left, axis=0)
        total = [np.sum(np.cos(angle) * d[:, 0] - np.sin(angle) * d[:, 1])]
        total += [np.sum(np.sin(angle) * d[:, 0] + np.cos(angle) * d[:, 1])]
        ends = [np.cos(angle[-1]) * left[-1, 0] - np.sin(angle[-1]) * left[-1, 1] - left[0, 0]]
        ends += [np.sin(angle[-1]) * left[-1, 0] + np.cos(angle[-1]) * left[-1, 1] - left[0, 1]]
        walks.append(np.array(total) - ends)
    expected = 4000 * (rate * DT) ** 2 * q**2 / 12.0
    assert np.mean(np.square(walks)) == pytest.approx(expected, rel=0.6)  # 3 sigma of 60 squares


def test_gps_rows_against_perturbed_measurements():
    layout = bound_model.sources(QUIET, Camera, 0.0, np.inf)
    omega_b, t_s = np.array([5.0, 0.3, -0.2]), 12.0
    C_ei = frames.dcm_ie(EARTH, t_s).T
    omega_ie_i = frames.omega_ie_i(EARTH)

    def measured(r, v, q, omega):
        C_ib = rotation.dcm_from_quat(q)
        r_a, v_a = r + C_ib @ ARM, v + C_ib @ np.cross(omega, ARM)
        return np.concatenate([C_ei @ r_a, C_ei @ (v_a - np.cross(omega_ie_i, r_a))])

    gyro_rate = np.random.default_rng(1).standard_normal((3, layout.n - 9))
    C_ib = rotation.dcm_from_quat(Q_0)
    H = bound_model.gps_rows(layout, C_ei, C_ib, ARM, omega_b, omega_ie_i, gyro_rate)
    truth = measured(R_0, V_0, Q_0, omega_b)
    for c in range(layout.n):
        r, v, q, omega, d = R_0, V_0, Q_0, omega_b, 1e-4
        e = np.eye(3)[c % 3]
        if c < 3:
            r, d = R_0 - 100.0 * e, 100.0
        elif c < 6:
            v, d = V_0 - 10.0 * e, 10.0
        elif c < 9:
            q = rotation.quat_multiply(rotation.quat_from_rotvec(-d * e), Q_0)
        else:
            omega = omega_b + d * gyro_rate[:, c - 9]  # the error is in what is measured
        change = (truth - measured(r, v, q, omega)) / d
        assert H[:, c] == pytest.approx(change, rel=1e-3, abs=1e-4), c


def test_star_rows_against_a_fit_to_shifted_stars():
    """A picture taken with another principal point and focal length, solved with the nominal ones."""
    rng = np.random.default_rng(2)
    f, shift, stretch = 2520.0, np.array([0.4, -0.7]), 3e-4
    xy = rng.uniform(-300.0, 300.0, (9, 2))
    ideal = np.column_stack([xy / f, np.ones(9)])
    ideal /= np.linalg.norm(ideal, axis=1)[:, None]
    seen = np.column_stack([((1.0 + stretch) * xy + shift) / f, np.ones(9)])
    seen /= np.linalg.norm(seen, axis=1)[:, None]
    U, _, Vt = np.linalg.svd(ideal.T @ seen)  # Wahba: truth axes = C seen axes
    C = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    error = rotation.rotvec_from_quat(rotation.quat_from_dcm(C.T))  # C_true = 1, C_fix = C
    layout = bound_model.sources(QUIET, Camera, 0.0, np.inf)
    H = bound_model.star_rows(layout, np.eye(3), C_BC, f, xy)
    predicted = H[:, layout.places["principal_point"]] @ shift
    predicted = predicted + H[:, layout.places["focal_length"]][:, 0] * stretch
    assert -predicted == pytest.approx(error, rel=0.02, abs=2e-7)
    assert H[:, bound_model.PSI] == pytest.approx(C_BC.T)
    assert H[:, layout.places["mounting"]] == pytest.approx(C_BC.T)


def test_swing_is_what_the_instrument_makes_of_vibration():
    """Scatter of the summed increments of the simulated instrument: 100 s, three axes, seed 7; 5 %."""
    params = imu_with(QUIET, vibration_boost=(30.0,), vibration_angular=0.0)
    trajectory = flight(6.0)
    n = 40000
    still = trajectory._replace(
        t_s=DT * np.arange(n),
        dtheta_b=np.zeros((n, 3)),
        dv_b=np.zeros((n, 3)),
        burning=np.ones(n, dtype=np.int8),
    )
    params = imu_with(params, gyro_range=np.inf, accel_range=np.inf)
    dv_b = imu.measure(params, still, np.random.default_rng(7)).dv_b
    scatter = np.cumsum(dv_b, axis=0)[1000:].std()
    assert bound.swing(params, 30.0, DT) == pytest.approx(scatter, rel=0.05)


QUANTA = {"gyro_quantum": 2.4e-5, "accel_quantum": 6e-4}


def test_the_moment_has_swing_and_rounding():
    """Increments of the simulated instrument, counted: 100 s, three axes, seed 7; 5 %."""
    params = imu_with(QUIET, vibration_boost=(30.0,), vibration_angular=0.0, **QUANTA)
    params = imu_with(params, gyro_range=np.inf, accel_range=np.inf)
    n = 40000
    still = flight(6.0)._replace(
        t_s=DT * np.arange(n), dtheta_b=np.zeros((n, 3)), dv_b=np.zeros((n, 3)), burning=np.ones(n, np.int8)
    )
    dv_b = imu.measure(params, still, np.random.default_rng(7)).dv_b
    velocity, attitude = bound.momentary(params, 30.0, DT)
    assert velocity == pytest.approx(np.cumsum(dv_b, axis=0)[1000:].std(), rel=0.05)
    assert attitude == pytest.approx(QUANTA["gyro_quantum"] / np.sqrt(12.0))
    assert bound.momentary(params, 0.0, DT)[0] == pytest.approx(QUANTA["accel_quantum"] / np.sqrt(12.0))


def test_fixes_have_the_rounding_in_their_noise():
    """That of the attitude in a star fix; in a velocity that of the IMU, and of the mean rate at the arm."""
    trajectory, k = flight(6.0), 2000
    layout = bound_model.sources(QUIET, Camera, 0.0, np.inf)
    camera = SimpleNamespace(
        detector=SimpleNamespace(columns=640, rows=480, pixel_size=1e-5),
        optics=SimpleNamespace(focal_length=0.025),
        mounting=SimpleNamespace(C_bc=C_BC),
    )
    xy_px = np.array([[100.0, 50.0], [500.0, 300.0], [50.0, 400.0]])
    star = SimpleNamespace(
        hip=np.array([1, 2, 3]), P_c=1e-10 * np.eye(3), t_available_s=6.0,
        detections=SimpleNamespace(xy_px=xy_px),
    )  # fmt: skip
    fix = GpsFix(
        t_valid_s=5.0, t_available_s=5.1, valid=True, r_ea_e=np.array([3e6, 1e6, 5.5e6]), v_ea_e=np.zeros(3),
        R_r_e=np.eye(3), R_v_e=1e-4 * np.eye(3), n_satellites=8, pdop=2.0, reason="",
    )  # fmt: skip
    R = {}
    for name, params in (("none", QUIET), ("counts", imu_with(QUIET, **QUANTA))):
        one = bound.Flight(trajectory, EARTH, None, [], [], params, camera, ARM)
        R[name] = bound._stars(one, layout, DT, k, star).R, bound._gps(one, layout, DT, k, fix).R
    (stars, gps), (least_stars, least_gps) = R["counts"], R["none"]
    angle2, velocity2 = QUANTA["gyro_quantum"] ** 2 / 12.0, QUANTA["accel_quantum"] ** 2 / 12.0
    np.testing.assert_allclose(stars - least_stars, angle2 * np.eye(3), rtol=1e-6, atol=1e-18)
    at_arm = 2.0 * angle2 / (2.0 * DT) ** 2 * 2.0 / 3.0 * ARM @ ARM
    np.testing.assert_allclose(
        (gps - least_gps)[3:, 3:], (velocity2 + at_arm) * np.eye(3), rtol=1e-6, atol=1e-12
    )
    assert not (gps - least_gps)[:3].any()


def filter_alone(trajectory, fixes, params, alignment, every):
    """Variances that the on-board filter reports: (m, 9)."""
    from shefex_nav.onboard.navigation import fusion

    nav = fusion.start(params, alignment, EARTH)
    # a little noise: samples that repeat each other exactly are taken for those of a stuck axis
    noise = np.random.default_rng(8).standard_normal((2, *trajectory.dv_b.shape))
    dtheta_b, dv_b = trajectory.dtheta_b + 1e-9 * noise[0], trajectory.dv_b + 1e-7 * noise[1]
    data = imu.ImuData(trajectory.t_s, dtheta_b, dv_b, np.zeros(len(trajectory.t_s), bool), None)
    waiting, variances = list(fixes), []
    for n, block in enumerate(rows(imu.stacked(data)), 1):
        fusion.advance(nav, block)
        while waiting and waiting[0].t_available_s <= block.t_valid_s + 1e-6:
            fusion.fuse(nav, [("gps", waiting.pop(0))])
        if n % every == 0:
            variances.append(np.diag(nav.history[-1].P)[:9])
    return np.array(variances)


def test_bound_is_the_filters_covariance_where_the_filter_knows_the_world():
    """Only biases and white noise, in the world and in the filter; late GPS, thrust and spin, 30 s."""
    from pathlib import Path

    from shefex_nav.scenario import load, params_onboard

    scenario = load.load(str(Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"))
    nav_params = params_onboard.nav_params(scenario)
    silent = dict.fromkeys(
        ("gyro_bias_walk", "gyro_cross", "gyro_g_sensitivity", "gyro_rectification", "gyro_vibration"), 0.0
    ) | dict.fromkeys(
        (
            "accel_bias_walk",
            "accel_scale",
            "accel_misalignment",
            "accel_rectification",
            "accel_vibration",
            "gravity",
        ),
        0.0,
    )
    nav_params = nav_params._replace(
        imu=nav_params.imu._replace(gyro_quantum=0.0, **silent),
        states=(),
        sigma_blocks={},
        sigma_gyro_bias=5e-5,
        sigma_accel_bias=5e-3,
        l_ba_b=ARM,
        motors=np.zeros((0, 2)),
    )
    model = nav_params.imu
    world = imu_with(
        QUIET,
        gyro_bias=5e-5,
        accel_bias=5e-3,
        gyro_random_walk=model.gyro_random_walk,
        accel_random_walk=model.accel_random_walk,
    )
    trajectory = flight(30.0, burning=False)
    rng = np.random.default_rng(3)
    fixes = []
    for t_s in range(1, 30):
        k = round(t_s / DT)
        C_ib = rotation.dcm_from_quat(trajectory.q_ib[k])
        omega_b = 0.5 * (trajectory.omega_ib_b[k] + trajectory.omega_ib_b[k + 1])
        r_e, v_e = frames.ecef_from_inertial(
            EARTH,
            t_s,
            trajectory.r_i[k] + C_ib @ ARM,
            trajectory.v_i[k] + C_ib @ np.cross(omega_b, ARM),
        )
        A, B = rng.standard_normal((2, 3, 3))
        R_r, R_v = A @ A.T + np.eye(3), 0.01 * (B @ B.T + np.eye(3))
        fixes.append(GpsFix(t_s, t_s + 0.2, True, r_e, v_e, R_r, R_v, 8, 2.0, ""))
    P_theta_b = np.radians(0.1) ** 2 * np.diag([1.0, 2.0, 0.5])  # of larger ones the second order counts
    alignment = Alignment(0.0, R_0, V_0, Q_0, 3.0, 0.1, P_theta_b)
    reported = filter_alone(trajectory, fixes, nav_params, alignment, 50)

    layout = bound_model.sources(world, Camera, 0.0, np.inf)
    flown = bound.Flight(trajectory, EARTH, alignment, fixes, [], world, Camera, ARM)
    known = bound.follow(flown, layout)
    for k, block in enumerate((known.position_i, known.velocity_i, known.attitude_b)):
        sigma = np.sqrt(np.einsum("kii->ki", block))
        assert sigma == pytest.approx(np.sqrt(reported[:, 3 * k : 3 * k + 3]), rel=0.01), k


@pytest.mark.parametrize("tied", [1.0, 0.0])
def test_on_the_ground_a_wrong_place_has_a_wrong_velocity_and_not_in_orbit(tied):
    """`world.pad` draws them so. A place that is 10 km off: 0.73 m/s, where 0.1 m/s are known."""
    trajectory, params = flight(0.5), imu_with(QUIET)
    turn_i = tied * frames.omega_ie_i(EARTH)
    alignment = Alignment(0.0, R_0, V_0, Q_0, 1e4, 0.1, 1e-12 * np.eye(3), omega_i=turn_i)
    flown = bound.Flight(trajectory, EARTH, alignment, [], [], params, Camera, ARM)
    known = bound.follow(flown, bound_model.sources(params, Camera, 0.0, np.inf)).velocity_i[0]
    turn = rotation.skew(turn_i)
    wanted = 0.01 * np.eye(3) + 1e8 * turn @ turn.T
    gravitation = 0.5 * 2.0 * 1.6e-6 * 1e4  # m/s, what 10 km change of it in half a second
    np.testing.assert_allclose(np.sqrt(np.diag(known)), np.sqrt(np.diag(wanted)), atol=gravitation)


def test_a_further_error_source_never_helps():
    """Every sigma with all sources is at least that without them; 20 s without measurements but GPS."""
    trajectory = flight(20.0)
    alignment = Alignment(0.0, R_0, V_0, Q_0, 3.0, 0.1, 1e-4 * np.eye(3))
    fixes = [
        GpsFix(t, t + 0.2, True, None, None, 4.0 * np.eye(3), 0.01 * np.eye(3), 8, 2.0, "")
        for t in range(1, 20, 3)
    ]
    few = imu_with(QUIET, gyro_bias=1e-6, accel_bias=5e-3, gyro_random_walk=1e-5, accel_random_walk=5e-4)
    many = imu_with(
        few,
        gyro_scale_factor=1e-4, accel_scale_factor=3e-4, gyro_g_sensitivity=3e-7, accel_in_run_bias=5e-4,
        gyro_misalignment=5e-5, vibration_boost=np.array([20.0]), vibration_angular=5e-4,
    )  # fmt: skip
    both = []
    for params in (few, many):
        flown = bound.Flight(trajectory, EARTH, alignment, fixes, [], params, Camera, ARM)
        both.append(bound.follow(flown, bound_model.sources(params, Camera, 1e-4, 100.0)))
    for block in ("position_i", "velocity_i", "attitude_b"):
        difference = getattr(both[1], block) - getattr(both[0], block)
        assert np.linalg.eigvalsh(difference).min() > -1e-9 * np.abs(difference).max()


def test_gravity_process_is_what_the_field_has_beyond_j2():
    trajectory = flight(30.0)
    assert bound.gravity_process(gravity.load("j2"), trajectory, EARTH)[0] < 1e-9
    sigma, tau_s = bound.gravity_process(gravity.load("egm96", 12), trajectory, EARTH)
    assert 5e-5 < sigma < 1e-3  # 5 to 100 micro gee
    assert tau_s > 1000.0  # degree 12 has waves of 3300 km: in half a minute next to nothing changes


@pytest.mark.parametrize(("tau_s", "tolerance"), [(40.0, 0.15), (3000.0, 0.6)])
def test_time_of_the_gravity_process_is_that_of_a_process_with_a_known_one(monkeypatch, tau_s, tolerance):
    """Gauss-Markov samples instead of a field, 3000 s: a time that is reached, and one that is not.

    Within 3000 s a memory of 3000 s is known to some half of it, no better; that it is not cut off at half of
    the flight is what counts.
    """
    n, trajectory = 3001, flight(1.0)
    rng, keeps, found = np.random.default_rng(5), np.exp(-1.0 / tau_s), []
    for _ in range(20):
        drawn = [rng.standard_normal(3)]
        for _ in range(n - 1):
            drawn.append(keeps * drawn[-1] + np.sqrt(1.0 - keeps**2) * rng.standard_normal(3))
        path = np.arange(float(n)), np.array(drawn)
        monkeypatch.setattr(bound, "beyond", lambda *_, path=path: path)
        found.append(bound.gravity_process(None, trajectory, EARTH))
    assert np.median([tau for _, tau in found]) == pytest.approx(tau_s, rel=tolerance)
