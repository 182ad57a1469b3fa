"""The search for the launcher's setting, over places of impact that are a formula of the tilt."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.campaign.impact import aim, landing
from shefex_nav.geometry import wgs84
from shefex_nav.scenario import load
from shefex_nav.world.flight.timeline import FlightError

FAR = 200e3  # m a radian of tilt
SITE = math.radians(67.9), math.radians(21.1)


@pytest.fixture
def launcher(monkeypatch):
    """(scenario of a tilt, deg; tilts that were flown); it lands FAR times the tilt from the launcher."""
    tilts = []

    def land(scenario, seed, ground, *, paths):
        size = 0.5 * math.pi - scenario.launch.elevation
        tilts.append(math.degrees(size))
        assert size <= math.radians(45.0)
        refused = scenario.refused(size)
        if refused:
            raise FlightError(refused)
        azimuth = scenario.launch.azimuth
        level = FAR * size * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        r_e = wgs84.ecef_from_geodetic(*SITE, 0.0) + wgs84.dcm_en(*SITE) @ level
        place = wgs84.geodetic_from_ecef(r_e)[:2]
        return SimpleNamespace(landings=(landing.Landing("payload", 400.0, *place, 100.0, 1.0),))

    monkeypatch.setattr(aim, "land", land)
    monkeypatch.setattr(aim, "followed", lambda scenario: ("payload",), raising=False)

    def scenario(tilt, refused=lambda size: ""):
        launch = {"azimuth": 0.3, "elevation": math.radians(90.0 - tilt), "height": 0.0}
        launch |= dict(zip(("latitude", "longitude"), SITE, strict=True))
        whole = {"refused": refused, "launch": Copied(launch)}
        return Copied(whole)

    return scenario, tilts


class Copied(SimpleNamespace):
    """As much of a scenario as is needed."""

    def __init__(self, values):
        super().__init__(**values)

    def model_copy(self, update):
        return Copied(vars(self) | update)

    def with_sections(self, **sections):
        return self.model_copy(sections)


def wished(tilt, azimuth):
    """Place where a tilt, deg, lands."""
    size = math.radians(tilt)
    level = FAR * size * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    r_e = wgs84.ecef_from_geodetic(*SITE, 0.0) + wgs84.dcm_en(*SITE) @ level
    return wgs84.geodetic_from_ecef(r_e)[:2]


def test_from_the_steepest_tilt_outwards_the_search_ends(launcher):
    scenario, tilts = launcher
    with pytest.raises(landing.ImpactError, match="no setting of the launcher"):
        aim.aim(scenario(45.0), *wished(60.0, 0.3), 1, 0.0)
    assert len(tilts) <= aim.MOST


@pytest.mark.parametrize(("tilt", "azimuth"), [(44.0, 0.3), (44.99, 0.8), (3.0, 2.0)])
def test_from_the_steepest_tilt_a_place_in_range_is_found(launcher, tilt, azimuth):
    scenario, _ = launcher
    found = aim.aim(scenario(45.0), *wished(tilt, azimuth), 1, 0.0)
    assert found.miss < 300.0 and 90.0 - math.degrees(found.elevation) == pytest.approx(tilt, abs=0.1)
    assert found.azimuth == pytest.approx(azimuth, abs=0.01)


def test_a_trial_that_cannot_be_flown_is_taken_back(launcher):
    """The first step is the fourth flight; half of it is flown instead."""
    scenario, tilts = launcher
    start = scenario(8.0, lambda size: "it tumbles" * (len(tilts) == 4))
    found = aim.aim(start, *wished(11.0, 0.3), 1, 0.0)
    assert found.miss < 300.0 and tilts[3] == pytest.approx(11.0, abs=0.1)
    assert tilts[4] == pytest.approx(9.5, abs=0.1)


def test_settings_that_cannot_be_flown_either_side_are_named(launcher):
    scenario, _ = launcher
    only = math.radians(8.0)
    with pytest.raises(aim.TrialError, match=r"azimuth .* deg, elevation 8[12].* deg: it tumbles"):
        aim.aim(scenario(8.0, lambda size: "it tumbles" * (abs(size - only) > 1e-9)), *wished(9.0, 1), 1, 0.0)


def test_a_body_that_is_not_followed_is_refused_before_a_flight(monkeypatch):
    def land(*args, **options):
        raise AssertionError("flown")

    monkeypatch.setattr(aim, "land", land)
    words = r"S44 is not followed to the ground; there is payload, Orion$"
    with pytest.raises(landing.ImpactError, match=words):
        aim.aim(load.load("rexus_like"), 1.18, 0.36, 1, 360.0, "S44")
