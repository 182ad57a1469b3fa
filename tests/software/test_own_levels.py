"""Protection levels that own software has made of its covariance: k sigma by the risk, and what follows."""

import json

import numpy as np
import pytest
from own_flights import reckoning
from scipy.stats import norm

from shefex_nav import prepare, runs
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard import own_levels, own_navigation
from shefex_nav.onboard.navigation import integrity_protection, protected
from shefex_nav.onboard.own_navigation import Estimate
from shefex_nav.records import Doubt
from shefex_nav.scenario.load import load
from shefex_nav.software import messages

T_S = 100.0
WITH_P = "return Estimate(self.r, self.v, self.q, {P}, levels_of_P={asked})"


@pytest.fixture(scope="module")
def earth():
    return prepare.earth_rotation(load("night_sky"))


def made(earth, scale=1.0):
    """(Estimate, NavSolution without levels) with a covariance in which everything depends on everything."""
    rng = np.random.default_rng(3)
    A = scale * rng.standard_normal((9, 9)) * np.repeat([2.0, 0.05, 1e-4], 3)[:, None]
    r_i = frames.dcm_ie(earth, T_S) @ wgs84.ecef_from_geodetic(1.2, 0.3, 60e3)
    q_ib = rotation.quat_normalise(np.array([0.6, 0.3, -0.5, 0.4]))
    estimate = Estimate(r_i, np.array([900.0, 700.0, 1200.0]), q_ib, A @ A.T)
    return estimate, own_navigation.solution(estimate, T_S, np.zeros(3), earth)


def test_sigmas_are_those_of_the_built_in_filter(earth):
    estimate, told = made(earth)
    x = np.concatenate([told.r_i, told.v_i, told.q_ib])
    nine = protected.sigmas(estimate.P, protected.level_axes(earth, T_S, x))  # compiled, another way
    found = own_levels.sigmas(told, estimate.P, earth)
    assert np.allclose(found[[1, 3]], nine[[2, 5]]) and np.allclose(found[4:], nine[6:])
    for k, (north, east) in ((0, nine[:2]), (2, nine[3:5])):
        assert max(north, east) <= found[k] * (1.0 + 1e-12) and found[k] ** 2 <= north**2 + east**2


def test_levels_are_as_many_sigmas_as_the_risk_asks(earth):
    estimate, told = made(earth)
    wanted = integrity_protection.requirement(100.0, 1.0, np.radians(0.17), 1e-5)
    with_levels = own_levels.added(told, estimate.P, wanted, earth)
    sigmas, share = own_levels.sigmas(told, estimate.P, earth), 1e-5 / 3600.0
    k = norm.isf(0.5 * share / 3.0)
    assert with_levels.protection_attitude == pytest.approx(k * np.sqrt(estimate.P.diagonal()[6:]))
    assert with_levels.protection_position[0] == pytest.approx(
        sigmas[0] * np.sqrt(-2.0 * np.log(share / 2.0))
    )
    assert with_levels.protection_velocity[1] == pytest.approx(sigmas[3] * norm.isf(0.25 * share))


def test_a_level_above_the_limit_withdraws_its_quantity_alone(earth):
    estimate, told = made(earth)
    limits = 1e4, 1e-3, 1e-9
    told = told._replace(do_not_use_attitude=True, doubt_attitude=int(Doubt.SOFTWARE))
    wanted = integrity_protection.requirement(*limits, 1e-5)
    found = own_levels.added(told, estimate.P, wanted, earth)
    assert (found.do_not_use_position, found.do_not_use_velocity, found.do_not_use_attitude) == (0, 1, 1)
    assert found.doubt_velocity == Doubt.LEVEL and found.doubt_attitude == Doubt.SOFTWARE


def test_misleading_and_usable_are_judged_of_software_that_asks_for_levels(tmp_path, command):
    """Its position stands still in inertial axes: it moves off with 300 m/s and more, and P does not grow."""
    for asked, judged in (("False", False), ("True", True)):
        P = "__import__('numpy').diag([4.0] * 3 + [0.01] * 3 + [1e-6] * 3)"
        reckoning(tmp_path, WITH_P.format(P=P, asked=asked))
        path, log = tmp_path / "mine.yaml", tmp_path / f"{asked}.mcap"
        path.write_text(
            "extends: night_sky\nmission: {name: mine, time_limit: 4 s}\n"
            "star_tracker: {enabled: false, off: 4 s}\nrequirements: {misleading: 0 %}\n"
            "navigation: {software: own.py:Reckoning}\n"
        )
        assert command("run", str(path), "--trust", "--out", str(log)).code == 0
        summary = json.loads(command("report", str(log), "--json").out)
        (one,) = [one for one in summary["requirements"] if one["name"] == "misleading"]
        assert (one["met"] is None) != judged
        assert (summary["navigation"]["integrity"] is not None) == judged
    assert one["met"] is False and summary["navigation"]["integrity"]["position"]["misleading_share"] > 0.5


@pytest.mark.parametrize(
    ("here", "words"),
    [
        (WITH_P.format(P="None", asked="True"), "levels_of_P of its Estimate is set, but there is no P"),
        (WITH_P.format(P="None", asked="1"), "levels_of_P of its Estimate must be True or False, got 1"),
    ],
)
def test_what_cannot_be_made_is_said(tmp_path, here, words):
    own = f"navigation.software={reckoning(tmp_path, here)}:Reckoning"
    with pytest.raises(Exception, match=words):
        runs.fly(load("night_sky", [own], trust=True), until_s=1.0)


def test_a_program_asks_for_levels_too(earth):
    estimate = made(earth)[0]
    for asked in (False, True):
        sent = messages.pack(messages.estimate_to_send(estimate._replace(levels_of_P=asked)))
        head = messages.HEAD.size
        size = sent[head - 1]
        name, body = sent[head : head + size].decode(), sent[head + size :]
        back = messages.estimate_received(messages.unpack(name, body))
        assert back.levels_of_P == asked and back.usable == (True, True, True)
        assert np.allclose(back.P, estimate.P)
