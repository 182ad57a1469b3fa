"""Alignment by the course, and of a heading that nobody knows: errors of drawn drives, and their sigmas."""

import drive
import numpy as np
import pytest
from scipy import stats

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.hypotheses import Bank
from shefex_nav.onboard.navigation.state import ATT, X_Q
from shefex_nav.records import Reason, StarFix, row
from shefex_nav.replay import align, external, load, params
from shefex_nav.scenario.data_table import DataError

EARTH = ephemeris.earth_rotation("2020-06-01T12:00:00", 0.0, 0.0, 0.0)
COURSE = "{method: course, speed: 5 m/s, sideslip: 1 deg}"
UNKNOWN = "{method: static, duration: 2 s, heading: unknown}"
SEEDS = 20


def scenario(alignment, **more):
    return load.load_text(drive.scenario_text(alignment, **more), "drive.yaml")


def error(truth, q_ib, t_s):
    """(3,) rad, body axes."""
    q_true = truth.q_ib[round(t_s * drive.RATE)]
    return rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q_ib), q_true))


def nees(e, P):
    return float(e @ np.linalg.solve(P, e))


def mean_within(values, dof, probability=1e-3):
    """Whether a mean of sums of squares is one of so many degrees of freedom."""
    low, high = stats.chi2.ppf([probability / 2, 1.0 - probability / 2], len(values) * dof) / len(values)
    return low < np.mean(values) < high


def test_course_of_ideal_sensors():
    truth = drive.drive(EARTH, 10.0)
    data = drive.sensed(truth, np.random.default_rng(1))
    data = data._replace(imu=data.imu._replace(dtheta_b=truth.dtheta_b, dv_b=truth.dv_b))
    exact = [
        fix._replace(
            r_ea_e=truth.r_e[k] + truth.C_en[k] @ truth.C_nb[k] @ drive.LEVER,
            v_ea_e=truth.v_e[k] + truth.C_en[k] @ truth.C_nb[k] @ np.cross(rate(truth, k), drive.LEVER),
        )
        for fix in data.fixes
        for k in [round(fix.t_valid_s * drive.RATE)]
    ]
    found = align.align(scenario(COURSE), data._replace(fixes=exact), EARTH)
    off = np.degrees(error(truth, found.q_ib, found.t_valid_s))
    assert abs(off[2]) < 0.01  # heading
    assert np.abs(off[:2]).max() < 1.5  # the mean force of a second of turning is not that of its chord


def rate(truth, k):
    """(3,) rad/s against the Earth, body axes."""
    of_earth = (truth.C_en[k] @ truth.C_nb[k]).T @ [0.0, 0.0, EARTH.rate]
    return truth.dtheta_b[k] * drive.RATE - of_earth


def test_errors_of_the_course_are_as_the_covariance_says():
    """20 drives to headings all around; the car does not slip, so its sideslip of 1 deg is not used up."""
    values = []
    for seed in range(1, SEEDS + 1):
        rng = np.random.default_rng(seed)
        truth = drive.drive(EARTH, 6.0, heading=rng.uniform(-np.pi, np.pi))
        found = align.align(scenario(COURSE), drive.sensed(truth, rng), EARTH)
        values.append(nees(error(truth, found.q_ib, found.t_valid_s), found.P_theta_b))
    assert np.mean(values) < stats.chi2.ppf(0.999, 3 * SEEDS) / SEEDS
    assert max(values) < 20.0


@pytest.mark.parametrize("late_s", [-0.003, 0.0, 0.003])
def test_the_fix_of_the_course_is_no_measurement_as_well(late_s):
    """Fixes between the samples of the IMU: that of the alignment must not come again, or its sigma of 2 m
    would be 1.4 m at once."""
    truth = drive.drive(EARTH, 4.0)
    data = drive.sensed(truth, np.random.default_rng(1))
    moved = [
        fix._replace(
            t_valid_s=fix.t_valid_s + late_s,
            t_available_s=fix.t_available_s + late_s,
            r_ea_e=fix.r_ea_e + late_s * fix.v_ea_e,
        )
        for fix in data.fixes
    ]
    found = align.align(scenario(COURSE), data._replace(fixes=moved), EARTH)
    assert moved[1].t_valid_s - 1e-9 <= found.t_valid_s < moved[1].t_valid_s + 1.0 / drive.RATE


def test_a_course_needs_motion_and_velocities():
    slow = drive.sensed(drive.drive(EARTH, 5.0, speed=1.0), np.random.default_rng(1))
    with pytest.raises(
        DataError, match=r"the fastest fix along the ground has 1\.\d m/s, alignment.speed wants 5"
    ):
        align.align(scenario(COURSE), slow, EARTH)
    none = [fix._replace(v_ea_e=np.full(3, np.nan)) for fix in slow.fixes]
    with pytest.raises(DataError, match="a course needs the velocity of GNSS"):
        align.align(scenario(COURSE), slow._replace(fixes=none), EARTH)


def settled(seed, length_s=60.0, speed=9.0):
    """Truth, Dataset and the Alignment found in motion from an unknown heading at its beginning."""
    rng = np.random.default_rng(seed)
    truth = drive.drive(EARTH, length_s, heading=rng.uniform(-np.pi, np.pi), speed=speed)
    data, said = drive.sensed(truth, rng), scenario(UNKNOWN)
    start = unknown(truth, rng)

    def blocks_from(start_s):
        return external.imu_blocks(data.imu, 4, start_s)

    found, since_s = external.settle(said, data, start, EARTH, blocks_from)
    assert since_s == 0.0
    return truth, data, said, found, blocks_from(found.t_valid_s)


def unknown(truth, rng):
    """Alignment of a heading that nobody knows."""
    wrong = rng.uniform(-np.pi, np.pi)  # that the search begins with
    return align.alignment(
        0.0,
        *drive.frames.inertial_from_ecef(
            EARTH, 0.0, truth.r_e[0] + 2.0 * rng.standard_normal(3), truth.v_e[0]
        ),
        rotation.quat_multiply(truth.q_ib[0], rotation.quat_from_rotvec(np.array([0.0, 0.0, wrong]))),
        EARTH,
        2.0,
        0.5,
        np.diag(np.radians([0.5, 0.5, 103.9])) ** 2,
    )


def test_stars_have_no_part_in_the_search():
    """A star fix would end it at once, by a heading that nothing has checked."""
    rng = np.random.default_rng(1)
    truth = drive.drive(EARTH, 3.0, heading=1.0)
    data, said, start = drive.sensed(truth, rng), scenario(UNKNOWN), unknown(truth, rng)
    nav_params, blocks = params.nav_params(said, 0.01), external.imu_blocks(data.imu, 4, 0.0)
    C_bc = rotation.quat_from_dcm(nav_params.C_bc)
    seen = [
        StarFix(
            k, t_s, t_s, Reason.NONE, rotation.quat_multiply(truth.q_ib[round(t_s * drive.RATE)], C_bc),
            1e-8 * np.eye(3), None, None, 0.1, 10.0, 0.05, False, False,
        )
        for k, t_s in enumerate((0.5, 1.5, 2.5))
    ]  # fmt: skip
    banks = [Bank(nav_params, start, EARTH) for _ in range(2)]
    without = [one.sigma for one in external.mixtures(banks[0], blocks, data.received)]
    assert [one.sigma for one in external.mixtures(banks[1], blocks, [*seen, *data.received])] == without
    assert len(without) > 2 and np.degrees(without[0]) > 5.0
    assert all(member.nav.health["star_tracker"].used == 0 for member in banks[1].members)


@pytest.mark.slow
def test_an_unknown_heading_is_found_honestly_and_the_filter_goes_on():
    """20 drives, each with another heading and other errors: the attitude where the filters agree, and at the
    end of the drive, against their covariances; not one falls for another heading."""
    at_once, at_end, times_s = [], [], []
    for seed in range(1, SEEDS + 1):
        truth, data, said, found, blocks = settled(seed)
        times_s.append(found.t_valid_s)
        at_once.append(nees(error(truth, found.q_ib, found.t_valid_s), found.P_theta_b))
        nav = fusion.start(params.nav_params(said, 0.01), found, EARTH)
        waiting = [fix for fix in data.fixes if fix.t_valid_s > found.t_valid_s][::-1]
        for k in range(len(blocks.t_valid_s)):
            fusion.advance(nav, row(blocks, k))
            while waiting and waiting[-1].t_available_s <= blocks.t_valid_s[k] + 1e-6:
                assert all(one.accepted for one in fusion.fuse(nav, [("gps", waiting.pop())]))
        e = error(truth, nav.history.x[X_Q], nav.history.ends_s[-1])
        at_end.append(nees(e, nav.history.P[ATT, ATT]))
        assert np.degrees(np.abs(e[2])) < 5.0
    assert max(times_s) < 20.0 and max(at_once) < 25.0
    assert np.mean(at_once) < stats.chi2.ppf(0.9995, 3 * SEEDS) / SEEDS  # it counts twice: it may be less
    assert mean_within(at_end, 3)


def test_what_does_not_move_is_not_found():
    with pytest.raises(
        DataError, match="what is not known shows when the vehicle accelerates along the ground"
    ):
        settled(1, length_s=15.0, speed=0.0)


def test_words_of_the_scenario():
    from shefex_nav.scenario.load import ScenarioError

    for alignment, words in (
        (
            "{method: static, duration: 2 s, heading: unknown, azimuth: 3 deg}",
            "has no meaning with 'heading: unknown'",
        ),
        ("{method: static, duration: 2 s, gyro_bias: at_rest}", "cannot say both north and the bias"),
        ("{method: rail, duration: 2 s, elevation: 84 deg}", "elevation_error"),
        ("{method: course, sideslip: 3 m}", "sideslip"),
    ):
        with pytest.raises(ScenarioError, match=words):
            scenario(alignment)
