"""Fixes whose errors last: drives with drawn errors of that kind, and the sigmas of a filter told of it."""

import drive
import numpy as np
import pytest
from scipy import stats

from shefex_nav.environment import ephemeris
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.state import POS
from shefex_nav.records import row
from shefex_nav.replay import align, external, load, params

EARTH = ephemeris.earth_rotation("2020-06-01T12:00:00", 0.0, 0.0, 0.0)
COURSE = "{method: course, speed: 5 m/s, sideslip: 1 deg}"
SHARE, LASTS_S, SEEDS = 0.75, 40.0, 16


def fixes(data, truth, rng):
    """The fixes of a Dataset with position errors of the same size, of which a share lasts."""
    errors, lasting = [], rng.standard_normal(3)
    for k, fix in enumerate(data.fixes):
        gap_s = fix.t_valid_s - data.fixes[k - 1].t_valid_s if k else np.inf
        kept = np.exp(-gap_s / LASTS_S)
        lasting = kept * lasting + np.sqrt(1.0 - kept**2) * rng.standard_normal(3)
        white = np.sqrt(1.0 - SHARE) * rng.standard_normal(3)
        at = round(fix.t_valid_s * drive.RATE)
        antenna = truth.r_e[at] + truth.C_en[at] @ truth.C_nb[at] @ drive.LEVER
        error = drive.SIGMA_R * (white + np.sqrt(SHARE) * lasting)
        errors.append(fix._replace(r_ea_e=antenna + error))
    return errors


def squares(gnss, seeds=SEEDS, length_s=40.0):
    """Normalised squares of the position error at the end of drives: (seeds,), of 3 degrees of freedom."""
    said, found = load.load_text(drive.scenario_text(COURSE, gnss=gnss), "drive.yaml"), []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        truth = drive.drive(EARTH, length_s, heading=rng.uniform(-np.pi, np.pi))
        data = drive.sensed(truth, rng)
        data = data._replace(fixes=fixes(data, truth, rng))
        start = align.align(said, data, EARTH)
        blocks = external.imu_blocks(data.imu, 4, start.t_valid_s)
        nav = fusion.start(params.nav_params(said, float(blocks.dt_s[0])), start, EARTH)
        waiting = [fix for fix in data.fixes if fix.t_valid_s > start.t_valid_s]
        for k in range(len(blocks.t_valid_s)):
            block, arrived = row(blocks, k), []
            while waiting and waiting[0].t_available_s <= block.t_valid_s + 1e-6:
                arrived.append(waiting.pop(0))
            fusion.advance(nav, block)
            fusion.take(nav, arrived)
        at = round(nav.history.ends_s[-1] * drive.RATE)
        r_i, _ = drive.frames.inertial_from_ecef(EARTH, truth.t_s[at], truth.r_e[at], truth.v_e[at])
        e = nav.history.x[:3] - r_i
        found.append(float(e @ np.linalg.solve(nav.history.P[POS, POS], e)))
    return np.array(found)


@pytest.mark.parametrize(("told", "is_held"), [(True, True), (False, False)])
def test_sigmas_hold_where_the_share_is_told(told, is_held):
    words = f", lasting_share: {100.0 * SHARE} %, lasting_time: {LASTS_S} s" if told else ""
    found = squares("{lever_arm: [1 m, 0.2 m, -1.2 m]" + words + "}")
    most = stats.chi2.ppf(0.9995, 3 * SEEDS) / SEEDS
    assert (np.mean(found) < most) == is_held, found


def test_the_fix_at_the_start_and_the_next_do_not_count_as_two():
    words = f", lasting_share: {100.0 * SHARE} %, lasting_time: {LASTS_S} s"
    found = squares("{lever_arm: [1 m, 0.2 m, -1.2 m]" + words + "}", 48, 5.0)
    assert np.mean(found) < stats.chi2.ppf(0.9995, 3 * 48) / 48, np.mean(found)


def test_a_start_from_the_truth_has_no_errors_of_fixes():
    def starts_at_fix(alignment):
        text = drive.scenario_text(alignment).replace("gnss.mat}", "gnss.mat, truth: truth.mat}")
        said = load.load_text(text, "drive.yaml")
        return params.nav_params(said, 0.01).starts_at_fix

    assert starts_at_fix(COURSE)
    assert starts_at_fix("{method: static, duration: 10 s, heading: unknown}")
    truth = "method: reference, level: 1 deg, position: 1 m, velocity: 0.1 m/s"
    assert not starts_at_fix(f"{{{truth}, azimuth: 2 deg}}")
    assert starts_at_fix(f"{{{truth}, azimuth: 90 deg}}")  # which fixes find before the navigation begins
